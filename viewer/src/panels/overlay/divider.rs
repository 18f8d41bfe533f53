//! Divider between A and B.

use crate::panels::theme;
use egui::{Align2, Color32, FontId, Painter, Rect, Response, Stroke, pos2, vec2};

/// Radius of the handle, points.
const HANDLE_POINTS: f32 = 7.0;

/// Paints a divider at each of `xs` over the height of `rect`, with the letters of the two sides.
pub(crate) fn paint(painter: &Painter, rect: Rect, xs: Vec<f32>, response: &Response) {
    let held = response.dragged() || response.hovered();
    let color = if held {
        theme::ACCENT
    } else {
        Color32::from_white_alpha(200)
    };
    for x in xs {
        painter.vline(x, rect.y_range(), Stroke::new(1.5, color));
        let handle = pos2(x, rect.center().y);
        painter.circle(
            handle,
            HANDLE_POINTS,
            Color32::from_black_alpha(160),
            Stroke::new(1.5, color),
        );
        for (letter, side, align) in [("A", -1.0, Align2::RIGHT_TOP), ("B", 1.0, Align2::LEFT_TOP)]
        {
            let at = pos2(x, rect.top()) + vec2(side * 10.0, 10.0);
            let tag = Rect::from_center_size(at + vec2(side * 6.0, 8.0), vec2(20.0, 20.0));
            painter.rect_filled(tag, 4.0, Color32::from_black_alpha(140));
            painter.text(
                at,
                align,
                letter,
                FontId::proportional(15.0),
                Color32::WHITE,
            );
        }
    }
}
