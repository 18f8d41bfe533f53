//! Headboxes in the frame: their edges, and the handles that size and move the next one.

use crate::input::bounds::EyeBounds;
use crate::input::pose::Pose;
use crate::panels::overlay::inset::edges;
use crate::panels::side::headbox::HeadboxPanel;
use crate::panels::theme;
use crate::source::Headboxes;
use egui::{Color32, CursorIcon, Painter, Pos2, Rect, Sense, Stroke, Ui, vec2};
use glam::{DMat3, DVec3, dvec3};
use std::ops::RangeInclusive;

/// Depth at which edges are clipped and handles vanish, relative to the box's half-size.
const NEAR_SHARE: f64 = 1e-3;
/// Radius of a handle, points.
const HANDLE_POINTS: f32 = 5.0;
/// Side of the square in which a handle can be grabbed, points.
const GRAB_POINTS: f32 = 22.0;

/// Handles of a box: their directions from its centre, in half-sizes. The last is its centre, which
/// lies over those of faces that are seen behind one another.
const HANDLES: [DVec3; 7] = [
    DVec3::X,
    DVec3::NEG_X,
    DVec3::Y,
    DVec3::NEG_Y,
    DVec3::Z,
    DVec3::NEG_Z,
    DVec3::ZERO,
];

/// Projection of the world to a rectangle of the window.
struct Projection {
    eye: DVec3,
    world_from_eye: DMat3,
    middle: Pos2,
    focal_points: f64,
}

impl Projection {
    fn new(rect: Rect, pose: &Pose) -> Self {
        let half_height = (pose.fov_y_deg.to_radians() / 2.0).tan();
        Self {
            eye: pose.eye,
            world_from_eye: pose.world_from_eye(),
            middle: rect.center(),
            focal_points: f64::from(rect.height()) / 2.0 / half_height,
        }
    }

    /// Position relative to the eye, which looks along -Z.
    fn in_eye(&self, world: DVec3) -> DVec3 {
        self.world_from_eye.transpose() * (world - self.eye)
    }

    /// Projects a point in front of the eye, relative to the eye.
    fn project(&self, in_eye: DVec3) -> Pos2 {
        let points = in_eye.truncate() * (self.focal_points / -in_eye.z);
        self.middle + vec2(points.x as f32, -points.y as f32)
    }

    /// Direction from the eye through a position in the window; 1 along the viewing axis.
    fn ray(&self, at: Pos2) -> DVec3 {
        let points = at - self.middle;
        let in_eye = dvec3(
            f64::from(points.x) / self.focal_points,
            f64::from(-points.y) / self.focal_points,
            -1.0,
        );
        self.world_from_eye * in_eye
    }

    /// Position of a handle in the window; `None` behind the eye.
    fn handle(&self, next: &EyeBounds, direction: DVec3) -> Option<Pos2> {
        let in_eye = self.in_eye(next.centre + next.half_size * direction);
        let near = next.half_size.max_element() * NEAR_SHARE;
        (-in_eye.z > near).then(|| self.project(in_eye))
    }
}

/// Moves and sizes the next headbox as the user drags its handles.
pub(crate) fn drag_handles(
    ui: &Ui,
    rect: Rect,
    pose: &Pose,
    panel: &mut HeadboxPanel,
    sizes_m: &RangeInclusive<f64>,
) {
    let Some(next) = panel.next() else { return };
    let projection = Projection::new(rect, pose);
    for (i, direction) in HANDLES.into_iter().enumerate() {
        let at = projection.handle(&next, direction);
        let Some(at) = at.filter(|at| rect.contains(*at)) else {
            continue;
        };
        let square = Rect::from_center_size(at, vec2(GRAB_POINTS, GRAB_POINTS));
        let id = ui.scope_id().with(("headbox handle", i));
        let response = ui.interact(square, id, Sense::drag());
        let response = response.on_hover_and_drag_cursor(if direction == DVec3::ZERO {
            CursorIcon::Move
        } else {
            CursorIcon::Grab
        });
        let pointer = response.interact_pointer_pos();
        let Some(pointer) = pointer.filter(|_| response.dragged()) else {
            continue;
        };
        let ray = projection.ray(pointer);
        if direction == DVec3::ZERO {
            // In the plane through the centre that faces the eye.
            let depth = -projection.in_eye(next.centre).z;
            panel.placed = Some(pose.eye + ray * depth);
        } else if let Some(size) = nearest_on_axis(next.centre - pose.eye, direction, ray) {
            panel.half_size_m = size.clamp(*sizes_m.start(), *sizes_m.end());
        }
    }
}

/// Distance along `axis`, a unit vector, from the point `start` to the place nearest to the line
/// through the origin in direction `ray`; `None` if the two are parallel.
fn nearest_on_axis(start: DVec3, axis: DVec3, ray: DVec3) -> Option<f64> {
    let ray = ray.normalize();
    let along = axis.dot(ray);
    let sine_squared = 1.0 - along * along;
    let distance = (start.dot(ray) * along - start.dot(axis)) / sine_squared;
    (sine_squared > 1e-6).then_some(distance)
}

/// Paints the edges of the headboxes over the frame, and the next one with its handles.
pub(crate) fn paint(
    painter: &Painter,
    rect: Rect,
    headboxes: &Headboxes,
    next: Option<&EyeBounds>,
    pose: &Pose,
) {
    let painter = painter.with_clip_rect(rect.intersect(painter.clip_rect()));
    let projection = Projection::new(rect, pose);
    for (i, bounds) in headboxes.bounds.iter().enumerate() {
        let color = if i == headboxes.shown {
            theme::ACCENT
        } else {
            theme::LINE
        };
        paint_edges(&painter, &projection, bounds, color);
    }
    if let Some(next) = next {
        paint_edges(&painter, &projection, next, theme::NEXT);
        for at in HANDLES.iter().filter_map(|it| projection.handle(next, *it)) {
            let rim = Stroke::new(1.5, theme::BACKDROP);
            painter.circle(at, HANDLE_POINTS, theme::NEXT, rim);
        }
    }
}

fn paint_edges(painter: &Painter, projection: &Projection, bounds: &EyeBounds, color: Color32) {
    let near = bounds.half_size.max_element() * NEAR_SHARE;
    for (a, b) in edges() {
        let [a, b] =
            [a, b].map(|corner| projection.in_eye(bounds.centre + bounds.half_size * corner));
        if let Some(ends) = clip(a, b, near) {
            let ends = ends.map(|end| projection.project(end));
            painter.line_segment(ends, Stroke::new(1.5, color));
        }
    }
}

/// Clips a segment in eye space (the eye looks along -Z) at a depth of `near`; `None` if it is
/// nearer everywhere.
fn clip(a: DVec3, b: DVec3, near: f64) -> Option<[DVec3; 2]> {
    let (depth_a, depth_b) = (-a.z, -b.z);
    if depth_a < near && depth_b < near {
        return None;
    }
    let at_near = || a.lerp(b, (near - depth_a) / (depth_b - depth_a));
    Some([
        if depth_a < near { at_near() } else { a },
        if depth_b < near { at_near() } else { b },
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::pos2;

    #[test]
    fn segments_are_clipped_at_the_eye() {
        let ahead = dvec3(1.0, 0.0, -3.0);
        let behind = dvec3(1.0, 0.0, 1.0);
        assert_eq!(clip(ahead, ahead, 0.5), Some([ahead, ahead]));
        assert_eq!(clip(behind, behind, 0.5), None);
        let cut = dvec3(1.0, 0.0, -0.5);
        assert_eq!(clip(behind, ahead, 0.5), Some([cut, ahead]));
        assert_eq!(clip(ahead, behind, 0.5), Some([ahead, cut]));
    }

    #[test]
    fn rays_go_back_to_what_was_projected() {
        let rect = Rect::from_min_size(pos2(30.0, 10.0), vec2(400.0, 300.0));
        let pose = Pose::looking_at(dvec3(1.0, 2.0, 3.0), dvec3(4.0, 1.0, -2.0), 50.0);
        let projection = Projection::new(rect, &pose);
        let point = dvec3(3.0, 1.8, -1.0);
        let in_eye = projection.in_eye(point);
        let back = pose.eye + projection.ray(projection.project(in_eye)) * -in_eye.z;
        assert!(back.distance(point) < 1e-5, "{back}");
    }

    #[test]
    fn axis_follows_the_pointer() {
        // Seen from the origin, a point 2 along +X of a centre 5 ahead.
        let centre = dvec3(0.0, 1.0, -5.0);
        let toward = centre + DVec3::X * 2.0;
        let size = nearest_on_axis(centre, DVec3::X, toward).expect("not parallel");
        assert!((size - 2.0).abs() < 1e-9, "{size}");
        let above = toward + dvec3(0.0, 0.3, 0.0);
        let size = nearest_on_axis(centre, DVec3::X, above).expect("not parallel");
        assert!((size - 2.0).abs() < 0.2, "{size}");
        assert_eq!(nearest_on_axis(centre, DVec3::Z, DVec3::Z), None);
    }
}
