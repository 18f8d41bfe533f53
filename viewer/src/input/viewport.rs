//! The viewport: steers the eye, requests frames and paints them.

use crate::input::bounds::EyeBounds;
use crate::input::keymap::{self, Command};
use crate::input::motion::{Steering, SteeringResponse};
use crate::input::navigation::place_in_frame;
use crate::panels;
use crate::playback::path_recorder::Replay;
use crate::thread::exchange::Job;
use crate::window::app::{ViewRequest, Viewer};
use crate::window::{layout, views};
use egui::{CursorIcon, Painter, PointerButton, Pos2, Rect, Response, Sense, Ui, pos2, vec2};
use headbox_core::camera::Camera;
use headbox_core::view::SettingValues;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time after the last movement from which on the eye counts as resting, seconds. Longer than a
/// pause between two drags.
const REST_S: f64 = 0.12;
/// Maximum time step of the simulation, seconds: the eye must not jump after a stall.
const MAX_STEP_S: f64 = 0.1;
/// Time between passes while moving, if no frame is being rendered.
const MOVING_PASS: Duration = Duration::from_millis(15);
/// Maximum time between passes while moving, if a frame is being rendered. The finished frame wakes
/// the window, which then requests the next one; repainting the old frame earlier would only take
/// time from the renderer where there is no GPU. At most [`MAX_STEP_S`], or the eye would lag
/// behind the input.
const AWAITING_PASS: Duration = Duration::from_millis(100);
/// Points of scrolling in one notch of the wheel.
const POINTS_PER_NOTCH: f64 = 50.0;
/// Width of the area in which the divider can be grabbed, points.
const DIVIDER_GRAB_POINTS: f32 = 14.0;

impl Viewer {
    /// Moves the eye, and shows the frame in the remaining area of the window.
    pub(crate) fn show_viewport(&mut self, ui: &mut Ui, now_s: f64) {
        let (rect, response) = ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
        let divider = self.drag_divider(ui, rect);
        self.drag_handles(ui, rect);
        if response.double_clicked_by(PointerButton::Primary) {
            self.commands.push(Command::Centre);
        }
        let pointer = response.hover_pos();
        let places = self.display.stereo.places();
        self.pointed = pointer.and_then(|at| place_in_frame(at, rect, places));
        self.steer(ui, &response, now_s);
        // The eye never rests between two poses of a replay, however slow their frames are.
        let moving = now_s - self.eye.moved_s < REST_S || self.path_recorder.is_playing();
        self.request_frame(ui, rect, moving);
        if moving || self.eye.motion.is_moving() {
            let awaiting = self
                .shown
                .as_ref()
                .is_none_or(|shown| shown.job.number < self.jobs_issued);
            ui.ctx()
                .request_repaint_after(if awaiting { AWAITING_PASS } else { MOVING_PASS });
        }
        self.paint(ui.painter(), rect);
        if let Some(divider) = divider {
            panels::overlay::divider::paint(ui.painter(), rect, self.divider_x(rect), &divider);
        }
        self.paint_headboxes(ui.painter(), rect);
        self.paint_pivot(ui.painter(), rect);
        self.paint_insets(ui.painter(), rect);
        self.paint_legend(ui.painter(), rect);
        self.paint_strip(ui.painter(), rect);
    }

    /// Moves the eye by the user's input or by the replay.
    fn steer(&mut self, ui: &Ui, response: &Response, now_s: f64) {
        let before = self.eye.pose;
        match self.path_recorder.step(now_s) {
            Replay::LumigraphOverlay(pose) => self.eye.pose = pose,
            Replay::Ended(pose) => {
                self.eye.pose = pose;
                self.replay_ended = true;
            }
            Replay::Idle => self.advance(ui, response, now_s),
        }
        if self.eye.pose != before {
            self.eye.moved_s = now_s;
        }
        self.path_recorder.record_pose(now_s, self.eye.pose);
    }

    fn advance(&mut self, ui: &Ui, response: &Response, now_s: f64) {
        let listening = !ui.ctx().text_edit_focused();
        let (mut steering, dt_s) = ui.input(|i| {
            // After a rest, the time since the last pass is not the duration of the motion.
            let dt_s = if self.eye.motion.is_moving() {
                i.unstable_dt
            } else {
                i.predicted_dt
            };
            (
                keymap::steering(i, listening),
                f64::from(dt_s).min(MAX_STEP_S),
            )
        });
        if response.dragged_by(PointerButton::Primary) {
            let delta = response.drag_delta();
            steering.drag_points = [delta.x, delta.y].map(f64::from);
        }
        if response.hovered() {
            let (scroll, zoom) = ui.input(|i| (i.smooth_scroll_delta().y, i.zoom_delta()));
            steering.wheel_notches =
                f64::from(scroll) / POINTS_PER_NOTCH + f64::from(zoom).log(1.1);
        }
        let idle = Steering {
            speed_factor: steering.speed_factor,
            ..Steering::default()
        };
        if steering != idle {
            self.eye.flight = None;
        }
        if let Some(flight) = &self.eye.flight {
            let (pose, is_over) = flight.pose_at(now_s);
            self.eye.pose = pose;
            self.eye.flight = self.eye.flight.take().filter(|_| !is_over);
            return;
        }
        if steering == idle && !self.eye.motion.is_moving() {
            return;
        }
        let handling = self.steering_response(response.rect);
        let eye = &mut self.eye;
        eye.pose = eye.motion.advance(&eye.pose, &steering, &handling, dt_s);
    }

    /// Box in which the eye stays; `None` if it may go anywhere.
    pub(crate) fn eye_bounds(&self) -> Option<EyeBounds> {
        self.headbox.bounds(self.info.as_ref()?)
    }

    /// Lets the user drag the handles of the next headbox; in stereo they are only painted.
    fn drag_handles(&mut self, ui: &Ui, rect: Rect) {
        let headboxes = self.info.as_ref().and_then(|info| info.headboxes.as_ref());
        let sizes_m = headboxes.and_then(panels::side::headbox::size_range_m);
        if let (Some(sizes_m), 1) = (sizes_m, self.display.stereo.places()) {
            let (panel, pose) = (&mut self.headbox, &self.eye.pose);
            panels::overlay::headboxes::drag_handles(ui, rect, pose, panel, &sizes_m);
        }
    }

    /// Paints the edges of the headboxes while the eye may leave them.
    fn paint_headboxes(&self, painter: &Painter, rect: Rect) {
        let headboxes = self.info.as_ref().and_then(|info| info.headboxes.as_ref());
        if let Some(headboxes) = headboxes.filter(|_| self.headbox.leaves) {
            let places = self.display.stereo.places() as usize;
            for place in 0..places {
                let rect = place_rect(rect, place, places);
                let (next, pose) = (self.headbox.next(), &self.eye.pose);
                panels::overlay::headboxes::paint(painter, rect, headboxes, next.as_ref(), pose);
            }
        }
    }

    fn steering_response(&self, rect: Rect) -> SteeringResponse {
        let apart = if self.display.stereo.places() > 1 {
            self.display.separation_m / 2.0
        } else {
            0.0
        };
        SteeringResponse {
            navigation: self.navigation(),
            speed_m_per_s: self.eye.speed_m_per_s,
            grab_scene: self.eye.grab_scene,
            bounds: self.eye_bounds().map(|bounds| bounds.shrunk(apart)),
            view_height_points: f64::from(rect.height()),
        }
    }

    /// Requests the current view from the render thread, unless it was requested last.
    fn request_frame(&mut self, ui: &Ui, rect: Rect, moving: bool) {
        let Some(info) = &self.info else { return };
        let (scale_px, max_side) = ui.input(|i| (i.pixels_per_point, i.max_texture_side));
        let max_side = u32::try_from(max_side)
            .unwrap_or(u32::MAX)
            .min(Camera::MAX_SIDE_PX);
        let side = |points: f32| ((points * scale_px).round() as u32).clamp(1, max_side);
        let size_px = [side(rect.width()), side(rect.height())];
        let scale = if moving && self.display.lower_resolution {
            self.policy.moving_scale()
        } else {
            1.0
        };
        let request = ViewRequest {
            pose: self.eye.pose,
            size_px,
            scale,
            moving,
            stereo: self.display.stereo,
            separation: self.display.separation_m,
            sets: self.sets_shown(),
        };
        let answered = self
            .shown
            .as_ref()
            .is_some_and(|shown| shown.job.number == self.jobs_issued);
        let forced = (self.automation.wants_frames() || self.path_recorder.pose_index().is_some())
            && answered;
        if self.view_request.as_ref() == Some(&request) && !forced {
            return;
        }
        if self
            .view_request
            .as_ref()
            .is_some_and(|old| !old.has_same_cost(&request))
        {
            self.policy.reset();
        }
        let [width, height] = size_px.map(|side| ((f64::from(side) * scale).round() as u32).max(1));
        // Sides are clamped to the limits of a camera, so this never fails.
        let stereo = request.stereo;
        let Ok(cameras) = stereo.cameras(&request.pose, request.separation, width, height) else {
            return;
        };
        self.jobs_issued += 1;
        self.session.request(Job {
            source_id: info.id,
            number: self.jobs_issued,
            cameras,
            sets: request.sets.clone(),
            moving,
            scale,
            issued: Instant::now(),
            round: 0,
            replayed: self.path_recorder.pose_index(),
        });
        self.view_request = Some(request);
    }

    /// Setting sets of the pictures on the screen: A, or A and B.
    pub(crate) fn sets_shown(&self) -> Vec<Arc<SettingValues>> {
        let mut sets = vec![self.sets.a.clone()];
        if self.display.compare {
            sets.push(self.sets.b.clone());
        }
        sets
    }

    /// Paints the pictures of the latest frame, scaled to `rect`.
    fn paint(&self, painter: &Painter, rect: Rect) {
        let Some(shown) = &self.shown else { return };
        let (places, sets) = (shown.job.cameras.len(), shown.job.sets.len());
        let whole = Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0));
        for place in 0..places {
            let place_rect = place_rect(rect, place, places);
            let split = place_rect.left() + place_rect.width() * self.display.divider;
            for set in 0..sets {
                let Some(texture) = self.textures.get(place * sets + set) else {
                    continue;
                };
                let clip = match (sets, set) {
                    (1, _) => place_rect,
                    (_, 0) => place_rect.with_max_x(split),
                    _ => place_rect.with_min_x(split),
                };
                let clip = clip.intersect(painter.clip_rect());
                painter.with_clip_rect(clip).image(
                    texture.id(),
                    place_rect,
                    whole,
                    egui::Color32::WHITE,
                );
            }
        }
    }

    /// Horizontal positions of the divider, one per view of a stereo pair.
    fn divider_x(&self, rect: Rect) -> Vec<f32> {
        let places = self
            .shown
            .as_ref()
            .map_or(1, |shown| shown.job.cameras.len());
        let x = |place| {
            let rect = place_rect(rect, place, places);
            rect.left() + rect.width() * self.display.divider
        };
        (0..places).map(x).collect()
    }

    /// Moves the divider between A and B as the user drags it; `None` if there is no divider.
    fn drag_divider(&mut self, ui: &Ui, rect: Rect) -> Option<Response> {
        if !self.display.compare {
            return None;
        }
        let mut grabbed: Option<Response> = None;
        let xs = self.divider_x(rect);
        let places = xs.len();
        for (place, x) in xs.into_iter().enumerate() {
            let strip = Rect::from_center_size(
                pos2(x, rect.center().y),
                vec2(DIVIDER_GRAB_POINTS, rect.height()),
            );
            let response =
                ui.interact(strip, ui.scope_id().with(("divider", place)), Sense::drag());
            let response = response.on_hover_and_drag_cursor(CursorIcon::ResizeHorizontal);
            if let (true, Some(at)) = (response.dragged(), response.interact_pointer_pos()) {
                let rect = place_rect(rect, place, places);
                self.display.divider =
                    ((at.x - rect.left()) / rect.width().max(1.0)).clamp(0.0, 1.0);
            }
            grabbed = Some(grabbed.map_or_else(|| response.clone(), |g| g.union(response.clone())));
        }
        grabbed
    }

    fn paint_insets(&self, painter: &Painter, rect: Rect) {
        let Some(info) = &self.info else { return };
        if !self.display.insets {
            return;
        }
        let mut corner = rect.right_bottom()
            - vec2(
                panels::overlay::inset::MARGIN_POINTS,
                panels::overlay::inset::MARGIN_POINTS,
            );
        if let Some(bounds) = &info.bounds
            && let Some(area) = panels::overlay::inset::frame(painter, rect, &mut corner, "Headbox")
        {
            let aspect = f64::from(rect.width() / rect.height().max(1.0))
                / f64::from(self.display.stereo.places());
            let (file_frame, pose) = (&info.file_frame, &self.eye.pose);
            panels::overlay::inset::paint(painter, area, bounds, file_frame, pose, aspect);
        }
        if let Some(plan) = &info.plan
            && let Some(area) = panels::overlay::inset::frame(painter, rect, &mut corner, "Plan")
        {
            panels::overlay::room_map::paint(painter, area, plan, &self.eye.pose);
        }
    }

    /// Paints the progress of background work.
    fn paint_strip(&self, painter: &Painter, rect: Rect) {
        let mut pictures = self.shown.iter().flat_map(|shown| &shown.pictures);
        if let Some(ongoing) = pictures.find_map(|picture| picture.report.ongoing.as_ref()) {
            // Keeps the text clear of the button that unfolds the panel.
            let folded = self.show_panels && layout::is_narrow(painter.ctx());
            let left = if folded {
                rect.left() + layout::UNFOLD_WIDTH_POINTS
            } else {
                rect.left()
            };
            panels::overlay::strip::paint(painter, rect, left, ongoing);
        }
    }

    /// Paints the legend of false colours: that of A, or else of B.
    fn paint_legend(&self, painter: &Painter, rect: Rect) {
        let legends = self
            .shown
            .iter()
            .flat_map(|shown| &shown.pictures)
            .map(|picture| &picture.report.legend);
        if let Some(legend) = legends.into_iter().find(|legend| !legend.is_empty()) {
            let margin = panels::overlay::inset::MARGIN_POINTS;
            panels::overlay::legend::paint(
                painter,
                rect.left_bottom() + vec2(margin, -margin),
                legend,
            );
        }
    }

    /// The frame on the screen as one image (stereo pairs side by side, A and B separated by the
    /// divider): a closure, so that another thread can assemble it.
    pub(crate) fn frame_on_screen(
        &self,
    ) -> Option<impl FnOnce() -> (usize, Vec<[u8; 4]>) + Send + use<>> {
        let shown = self.shown.as_ref()?;
        let pictures: Vec<_> = shown
            .pictures
            .iter()
            .map(|picture| picture.image.clone())
            .collect();
        let (places, divider) = (shown.job.cameras.len(), f64::from(self.display.divider));
        Some(move || {
            let refs: Vec<_> = pictures
                .iter()
                .map(|image| views::PictureRef {
                    width: image.size[0],
                    pixels: bytemuck::cast_slice(&image.pixels),
                })
                .collect();
            views::compose(&refs, places, divider)
        })
    }
}

impl ViewRequest {
    /// Returns true if frames of both requests should take about the same time at full resolution.
    fn has_same_cost(&self, other: &Self) -> bool {
        (self.size_px, self.stereo) == (other.size_px, other.stereo) && self.sets == other.sets
    }
}

/// Part of the frame's rectangle for one view of a stereo pair.
fn place_rect(rect: Rect, place: usize, places: usize) -> Rect {
    let width = rect.width() / places as f32;
    Rect::from_min_size(
        rect.min + vec2(width * place as f32, 0.0),
        vec2(width, rect.height()),
    )
}
