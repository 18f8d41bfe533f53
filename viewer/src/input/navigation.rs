//! Orbiting a point of the scene, approaching one, and going to bookmarks.

use crate::input::flight::Flight;
use crate::input::pose::Pose;
use crate::panels;
use crate::thread::exchange::{Order, Probe, ProbeGoal};
use crate::window::app::Viewer;
use crate::window::messages::Kind;
use egui::{Painter, Pos2, Rect, Stroke};
use glam::DVec3;
use headbox_core::view::Navigation;
use std::sync::Arc;

/// Half the side of the square of pixels whose depth is measured.
const PROBE_PX: u32 = 4;
/// Share of the way to a point that an approach goes.
const APPROACH_SHARE: f64 = 0.5;
/// Radius of the mark of the pivot, points.
const MARK_POINTS: f32 = 5.0;

impl Viewer {
    /// Navigation mode: that of the source, unless the user orbits a point.
    pub(crate) fn navigation(&self) -> Navigation {
        let of_source = self.info.as_ref().map(|info| info.navigation);
        match (of_source.unwrap_or_default(), self.eye.orbit) {
            (Navigation::Fly | Navigation::Walk, Some(pivot)) => Navigation::Orbit {
                pivot,
                nearest: self.eye.speed_m_per_s * 0.01,
            },
            (own, _) => own,
        }
    }

    /// Starts to orbit the point in the middle of the frame, or ends the orbit.
    pub(crate) fn toggle_orbit(&mut self, now_s: f64) {
        let Some(info) = &self.info else { return };
        if matches!(info.navigation, Navigation::Orbit { .. }) {
            let text = "This view always orbits what it shows.";
            return self.messages.add(Kind::Done, text, now_s);
        }
        if self.eye.orbit.take().is_none() {
            self.probe(ProbeGoal::Orbit, None);
        }
    }

    /// Turns to the point under the pointer, or else in the middle of the frame, and approaches it.
    pub(crate) fn approach(&mut self) {
        self.probe(ProbeGoal::Approach, self.pointed);
    }

    /// Requests the depth at `place`, a share of the frame's width and height.
    fn probe(&mut self, goal: ProbeGoal, place: Option<[f64; 2]>) {
        let (Some(info), Some(request)) = (&self.info, &self.view_request) else {
            return;
        };
        let pose = self.eye.pose;
        let [width, height] = request.size_px;
        let width = (width / request.stereo.places()).max(1);
        let place = place.unwrap_or([0.5, 0.5]);
        let around = |share: f64, side: u32| {
            let middle = (share * f64::from(side)).round() as u32;
            middle.saturating_sub(PROBE_PX)..middle.saturating_add(PROBE_PX)
        };
        let whole = pose.camera(width, height);
        // Sides are clamped to the limits of a camera, so this never fails.
        let Ok(camera) = whole
            .and_then(|whole| whole.cropped(around(place[0], width), around(place[1], height)))
        else {
            return;
        };
        self.session.order(Order::Probe(Probe {
            source_id: info.id,
            pose,
            camera,
            settings: Arc::clone(&self.sets.a),
            goal,
        }));
    }

    /// Handles a measured point.
    pub(crate) fn handle_probed(&mut self, probe: &Probe, point: Option<DVec3>, now_s: f64) {
        let info = self.info.as_ref();
        if info.is_none_or(|info| info.id != probe.source_id) {
            return;
        }
        match (probe.goal, point) {
            (ProbeGoal::Orbit, point) => {
                let ahead = |distance_m: f64| probe.pose.eye + probe.pose.forward() * distance_m;
                // Without a depth: as far away as the eye goes in a second.
                let pivot = point.unwrap_or_else(|| ahead(self.eye.speed_m_per_s));
                self.eye.orbit = Some(pivot);
                self.eye.motion.stop();
            }
            (ProbeGoal::Approach, Some(point)) => {
                let by = (point - probe.pose.eye) * APPROACH_SHARE;
                let from = probe.pose.eye;
                let eye = self
                    .eye_bounds()
                    .map_or(from + by, |bounds| bounds.clip(from, by));
                let to = Pose::upright(eye, point, probe.pose.up, probe.pose.fov_y_deg);
                if self.eye.orbit.is_some() {
                    self.eye.orbit = Some(point);
                }
                self.fly_to(to, now_s);
            }
            (ProbeGoal::Approach, None) => {
                let text = "The distance of what is shown there is not known.";
                self.messages.add(Kind::Done, text, now_s);
            }
        }
    }

    /// Flies to a pose; jumps if that is not possible.
    pub(crate) fn fly_to(&mut self, to: Pose, now_s: f64) {
        self.path_recorder.stop();
        self.eye.motion.stop();
        // Yaw keeps its number of turns, so that the flight and the pose agree.
        self.eye.flight = Flight::new(self.eye.pose, to, now_s);
        if self.eye.flight.is_none() {
            self.eye.pose = to;
        }
        self.eye.moved_s = now_s;
    }

    /// Goes to a bookmark, if there is one of this number.
    pub(crate) fn go_to_bookmark(&mut self, index: usize, now_s: f64) {
        let Some(info) = &self.info else { return };
        match self.bookmarks.pose(index, &info.file_frame, &self.eye.pose) {
            Some(pose) => {
                self.eye.orbit = None;
                self.fly_to(pose, now_s);
            }
            None => {
                let text = format!("There is no bookmark {}: M adds one.", index + 1);
                self.messages.add(Kind::Done, text, now_s);
            }
        }
    }

    /// Bookmarks the present pose.
    pub(crate) fn add_bookmark(&mut self, name: &str, now_s: f64) {
        let Some(info) = &self.info else { return };
        let added = self.bookmarks.add(name, &self.eye.pose, &info.file_frame);
        let added = added.map(|()| {
            let name = self.bookmarks.list().last().map_or("", |last| &last.name);
            format!("Bookmarked as \"{name}\".")
        });
        self.report_bookmarks(added, now_s);
    }

    /// Removes a bookmark.
    pub(crate) fn remove_bookmark(&mut self, index: usize, now_s: f64) {
        let removed = self.bookmarks.remove(index);
        self.report_bookmarks(removed.map(|()| "Removed the bookmark.".into()), now_s);
    }

    fn report_bookmarks(&mut self, result: std::io::Result<String>, now_s: f64) {
        match result {
            Ok(text) => self.messages.add(Kind::Done, text, now_s),
            Err(error) => {
                let text = format!("The bookmarks cannot be written: {error}.");
                self.messages.add(Kind::Error, text, now_s);
            }
        }
    }

    /// Paints a mark on the point about which the user orbits.
    pub(crate) fn paint_pivot(&self, painter: &Painter, rect: Rect) {
        let (Some(pivot), 1) = (self.eye.orbit, self.display.stereo.places()) else {
            return;
        };
        let size = [rect.width(), rect.height()].map(|side| (side as u32).max(1));
        let camera = self.eye.pose.camera(size[0], size[1]).ok();
        if let Some([x, y, _]) = camera.and_then(|camera| camera.project(pivot)) {
            let at = rect.min + egui::vec2(x as f32, y as f32);
            let shadow = Stroke::new(3.0, egui::Color32::from_black_alpha(140));
            painter.circle_stroke(at, MARK_POINTS, shadow);
            painter.circle_stroke(at, MARK_POINTS, Stroke::new(1.5, panels::theme::ACCENT));
        }
    }
}

/// Place of the pointer in a frame: its share of the width and height of the view that it is in.
pub(crate) fn place_in_frame(pointer: Pos2, rect: Rect, places: u32) -> Option<[f64; 2]> {
    if !rect.contains(pointer) {
        return None;
    }
    let share = (pointer - rect.min) / rect.size();
    let x = f64::from(share.x) * f64::from(places);
    Some([x.fract(), f64::from(share.y)])
}
