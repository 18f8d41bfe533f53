//! Floor plan of the rooms with the eye on it.

use crate::input::pose::Pose;
use crate::panels::theme;
use egui::{Align2, FontId, Painter, Pos2, Rect, Shape, Stroke, pos2, vec2};
use headbox_core::view::RoomMap;

/// Length of the drawn view wedge, points.
const WEDGE_POINTS: f32 = 18.0;

/// Paints the plan to fit `rect`; highlights and names the room that contains the eye.
pub(crate) fn paint(painter: &Painter, rect: Rect, plan: &RoomMap, pose: &Pose) {
    let Some(page) = Page::new(rect, plan) else {
        return;
    };
    let here = plan.room_at(pose.eye);
    for (i, room) in plan.rooms.iter().enumerate() {
        let stroke = if here == Some(i) {
            Stroke::new(1.8, theme::ACCENT)
        } else {
            Stroke::new(1.0, theme::LINE)
        };
        let outline = room.outline.iter().map(|p| page.point(*p)).collect();
        painter.add(Shape::closed_line(outline, stroke));
    }
    for opening in &plan.openings {
        painter.line_segment(
            opening.map(|p| page.point(p)),
            Stroke::new(2.5, theme::BACKDROP),
        );
    }
    let eye = page.point([pose.eye.x, pose.eye.z]);
    let forward = pose.forward();
    let ahead = vec2(forward.x as f32, forward.z as f32).normalized() * WEDGE_POINTS;
    for side in [-0.5, 0.5] {
        painter.line_segment(
            [eye, eye + egui::emath::Rot2::from_angle(side) * ahead],
            Stroke::new(1.2, theme::ACCENT),
        );
    }
    painter.circle_filled(eye, 3.0, theme::ACCENT);
    let name = here.map_or("outside", |i| plan.rooms[i].name.as_str());
    painter.text(
        rect.right_bottom(),
        Align2::RIGHT_BOTTOM,
        name,
        FontId::proportional(10.0),
        theme::INSET_TEXT,
    );
}

/// Transform from metres of the plan to points, fitted to a rectangle.
struct Page {
    min: [f64; 2],
    origin: Pos2,
    points_per_m: f64,
}

impl Page {
    fn new(rect: Rect, plan: &RoomMap) -> Option<Self> {
        let area = rect.shrink2(vec2(6.0, 16.0));
        let corners = || plan.rooms.iter().flat_map(|room| &room.outline);
        let low = corners().fold([f64::INFINITY; 2], |m, p| [m[0].min(p[0]), m[1].min(p[1])]);
        let high = corners().fold([f64::NEG_INFINITY; 2], |m, p| {
            [m[0].max(p[0]), m[1].max(p[1])]
        });
        let size = [high[0] - low[0], high[1] - low[1]];
        if !size.iter().all(|s| s.is_finite() && *s > 0.0) {
            return None;
        }
        let points_per_m =
            (f64::from(area.width()) / size[0]).min(f64::from(area.height()) / size[1]);
        let used = vec2(
            (size[0] * points_per_m) as f32,
            (size[1] * points_per_m) as f32,
        );
        Some(Self {
            min: low,
            origin: area.center() - used / 2.0,
            points_per_m,
        })
    }

    fn point(&self, [x, z]: [f64; 2]) -> Pos2 {
        let [x, z] = [x - self.min[0], z - self.min[1]].map(|d| (d * self.points_per_m) as f32);
        pos2(self.origin.x + x, self.origin.y + z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::view::Room;

    #[test]
    fn plans_fit_and_keep_their_proportions() {
        let rect = Rect::from_min_size(pos2(5.0, 5.0), vec2(136.0, 136.0));
        let room = Room {
            name: "hall".into(),
            outline: vec![[-3.0, 1.0], [9.0, 1.0], [9.0, 3.0], [-3.0, 3.0]],
        };
        let page = Page::new(
            rect,
            &RoomMap {
                rooms: vec![room.clone()],
                openings: vec![],
            },
        )
        .unwrap();
        assert!(room.outline.iter().all(|p| rect.contains(page.point(*p))));
        let (a, b, c) = (
            page.point([0.0, 1.0]),
            page.point([1.0, 1.0]),
            page.point([0.0, 2.0]),
        );
        assert!((a.distance(b) - a.distance(c)).abs() < 1e-3);
        assert!(
            Page::new(rect, &RoomMap::default()).is_none(),
            "a plan without rooms draws nothing"
        );
    }
}
