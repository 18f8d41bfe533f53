//! The frame itself: steering in it, asking for it, painting it.

use crate::input::keymap;
use crate::input::keymap::Command;
use crate::input::motion::{Steering, SteeringResponse};
use crate::panels;
use crate::playback::tape::Replay;
use crate::thread::exchange::Job;
use crate::window::app::{FrameWishes, Viewer};
use crate::window::{layout, views};
use egui::{CursorIcon, Painter, PointerButton, Pos2, Rect, Response, Sense, Ui, pos2, vec2};
use headbox_core::camera::Camera;
use std::time::{Duration, Instant};

/// Time after the last movement from which on the eye counts as resting, seconds: a pause between
/// two drags is not a rest.
const REST_S: f64 = 0.12;
/// The longest step of time that is simulated at once, seconds: after a stall the eye must not
/// leap.
const MAX_STEP_S: f64 = 0.1;
/// Time between passes while moving, if no frame is being made.
const MOVING_PASS: Duration = Duration::from_millis(15);
/// The longest wait for a frame in the making while moving. Its arrival wakes the window, which
/// then asks for the next one; drawing the old frame again meanwhile would only take time from the
/// renderer where there is no GPU. No more than [`MAX_STEP_S`], or the eye would lag behind the
/// hands.
const AWAITING_PASS: Duration = Duration::from_millis(100);
/// Points of scrolling in one notch of the wheel.
const POINTS_PER_NOTCH: f64 = 50.0;
/// Width of the strip in which the divider can be grabbed, points.
const DIVIDER_GRAB_POINTS: f32 = 14.0;

impl Viewer {
    /// Shows the frame in the rest of the window, and moves the eye.
    pub(crate) fn look(&mut self, ui: &mut Ui, now_s: f64) {
        let (rect, response) = ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
        let divider = self.drag_divider(ui, rect);
        if response.double_clicked_by(PointerButton::Primary) {
            self.commands.push(Command::Centre);
        }
        self.steer(ui, &response, now_s);
        // Between two poses of a replay the eye does not rest, however long their frames take.
        let moving = now_s - self.eye.moved_s < REST_S || self.tape.is_playing();
        self.ask(ui, rect, moving);
        if moving || self.eye.motion.is_moving() || self.tape.is_playing() {
            // The eye coasts, or rests soon: either way there is another pass to come.
            let awaiting = self
                .shown
                .as_ref()
                .is_none_or(|shown| shown.job.number < self.jobs_issued);
            ui.ctx()
                .request_repaint_after(if awaiting { AWAITING_PASS } else { MOVING_PASS });
        }
        self.paint(ui.painter(), rect);
        if let Some(divider) = divider {
            panels::divider::paint(ui.painter(), rect, self.divider_x(rect), &divider);
        }
        self.paint_insets(ui.painter(), rect);
        self.paint_legend(ui.painter(), rect);
        self.paint_strip(ui.painter(), rect);
    }

    /// Moves the eye by what the hands or the replay want.
    fn steer(&mut self, ui: &Ui, response: &Response, now_s: f64) {
        let before = self.eye.pose;
        match self.tape.step(now_s) {
            Replay::Show(pose) => self.eye.pose = pose,
            Replay::Ended(pose) => {
                self.eye.pose = pose;
                self.path_ended = true;
            }
            Replay::Idle => self.advance(ui, response),
        }
        if self.eye.pose != before {
            self.eye.moved_s = now_s;
        }
        self.tape.note(now_s, self.eye.pose);
    }

    fn advance(&mut self, ui: &Ui, response: &Response) {
        let listening = !ui.ctx().text_edit_focused();
        let (mut steering, dt_s) = ui.input(|i| {
            // After a rest the time since the last pass says nothing about the motion that begins
            // now.
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
        if steering == idle && !self.eye.motion.is_moving() {
            return;
        }
        let handling = self.handling(response.rect);
        self.eye.pose = self
            .eye
            .motion
            .advance(&self.eye.pose, &steering, &handling, dt_s);
    }

    fn handling(&self, rect: Rect) -> SteeringResponse {
        let info = self.info.as_ref();
        let apart = if self.display.stereo.places() > 1 {
            self.display.separation_m / 2.0
        } else {
            0.0
        };
        SteeringResponse {
            navigation: info.map(|info| info.navigation).unwrap_or_default(),
            speed_m_per_s: self.eye.speed_m_per_s,
            grab_scene: self.eye.grab_scene,
            bounds: info
                .and_then(|info| info.bounds)
                .map(|bounds| bounds.shrunk(apart)),
            view_height_points: f64::from(rect.height()),
        }
    }

    /// Asks the render thread for the current view, if it is not the one asked for last.
    fn ask(&mut self, ui: &Ui, rect: Rect, moving: bool) {
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
        let (stereo, separation) = (self.display.stereo, self.display.separation_m);
        let wish = FrameWishes {
            pose: self.eye.pose,
            size_px,
            scale,
            moving,
            stereo,
            separation,
            sets: self.sets_shown(),
        };
        let answered = self
            .shown
            .as_ref()
            .is_some_and(|shown| shown.job.number == self.jobs_issued);
        let forced =
            (self.automation.wants_frames() || self.tape.pose_index().is_some()) && answered;
        if self.wish.as_ref() == Some(&wish) && !forced {
            return;
        }
        if self.wish.as_ref().is_some_and(|old| !old.costs_as(&wish)) {
            self.policy.reset();
        }
        let [width, height] = size_px.map(|side| ((f64::from(side) * scale).round() as u32).max(1));
        // Sides are clamped to what a camera allows, so there is always a camera.
        let Ok(cameras) = stereo.cameras(&wish.pose, separation, width, height) else {
            return;
        };
        self.jobs_issued += 1;
        self.session.request(Job {
            source_id: info.id,
            number: self.jobs_issued,
            cameras,
            sets: wish.sets.clone(),
            moving,
            scale,
            issued: Instant::now(),
            round: 0,
            replayed: self.tape.pose_index(),
        });
        self.wish = Some(wish);
    }

    /// The setting sets on the screen.
    pub(crate) fn sets_shown(&self) -> Vec<std::sync::Arc<crate::SettingValues>> {
        let mut sets = vec![self.sets.a.clone()];
        if self.display.compare {
            sets.push(self.sets.b.clone());
        }
        sets
    }

    /// Paints the pictures of the latest frame over the whole of `rect`, whatever size they were
    /// rendered at.
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

    /// Positions of the divider, one per place.
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

    /// Lets the divider between A and B be dragged; `None` if there is none.
    fn drag_divider(&mut self, ui: &Ui, rect: Rect) -> Option<Response> {
        if !self.display.compare {
            return None;
        }
        let mut grabbed: Option<Response> = None;
        let places = self
            .shown
            .as_ref()
            .map_or(1, |shown| shown.job.cameras.len());
        for (place, x) in self.divider_x(rect).into_iter().enumerate() {
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
        let mut corner =
            rect.right_bottom() - vec2(panels::inset::MARGIN_POINTS, panels::inset::MARGIN_POINTS);
        if let Some(bounds) = &info.bounds
            && let Some(area) = panels::inset::frame(painter, rect, &mut corner, "Headbox")
        {
            let aspect = f64::from(rect.width() / rect.height().max(1.0))
                / f64::from(self.display.stereo.places());
            panels::inset::paint(painter, area, bounds, &self.eye.pose, aspect);
        }
        if let Some(plan) = &info.plan
            && let Some(area) = panels::inset::frame(painter, rect, &mut corner, "Plan")
        {
            panels::room_map::paint(painter, area, plan, &self.eye.pose);
        }
    }
}

impl Viewer {
    /// Says what is going on in the background.
    fn paint_strip(&self, painter: &Painter, rect: Rect) {
        let mut pictures = self.shown.iter().flat_map(|shown| &shown.pictures);
        if let Some(ongoing) = pictures.find_map(|picture| picture.report.ongoing.as_ref()) {
            // Beside the button that unfolds the panel.
            let folded = self.show_panels && layout::is_narrow(painter.ctx());
            let left = if folded {
                rect.left() + layout::UNFOLD_WIDTH_POINTS
            } else {
                rect.left()
            };
            panels::strip::paint(painter, rect, left, ongoing);
        }
    }

    /// Says what colours mean, where they are not what is seen: of A, or else of B.
    fn paint_legend(&self, painter: &Painter, rect: Rect) {
        let legends = self
            .shown
            .iter()
            .flat_map(|shown| &shown.pictures)
            .map(|picture| &picture.report.legend);
        if let Some(legend) = legends.into_iter().find(|legend| !legend.is_empty()) {
            let margin = panels::inset::MARGIN_POINTS;
            panels::legend::paint(painter, rect.left_bottom() + vec2(margin, -margin), legend);
        }
    }
}

impl FrameWishes {
    /// Returns true if frames of both requests should take about as long, moving at full size.
    fn costs_as(&self, other: &Self) -> bool {
        (self.size_px, self.stereo) == (other.size_px, other.stereo) && self.sets == other.sets
    }
}

/// The part of the frame's rectangle that one place of a stereo pair takes.
fn place_rect(rect: Rect, place: usize, places: usize) -> Rect {
    let width = rect.width() / places as f32;
    Rect::from_min_size(
        rect.min + vec2(width * place as f32, 0.0),
        vec2(width, rect.height()),
    )
}

impl Viewer {
    /// The frame on the screen as one image (stereo pairs side by side, A and B parted by the
    /// divider): a closure, so that the work can be done on another thread.
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
