//! Legend of false colours, in the corner of the frame.

use crate::panels::theme;
use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, pos2, vec2};
use headbox_core::view::Swatch;

const LINE_POINTS: f32 = 17.0;
const SWATCH_POINTS: f32 = 11.0;
const BORDER_POINTS: f32 = 8.0;

/// Paints a legend whose bottom left corner is `corner`.
pub(crate) fn paint(painter: &Painter, corner: Pos2, legend: &[Swatch]) {
    let font = FontId::proportional(12.0);
    let texts: Vec<_> = legend
        .iter()
        .map(|line| painter.layout_no_wrap(line.label.clone(), font.clone(), Color32::WHITE))
        .collect();
    let widest = texts.iter().map(|text| text.size().x).fold(0.0, f32::max);
    let size = vec2(
        widest + SWATCH_POINTS + 3.0 * BORDER_POINTS,
        texts.len() as f32 * LINE_POINTS + BORDER_POINTS,
    );
    let rect = Rect::from_min_size(pos2(corner.x, corner.y - size.y), size);
    painter.rect_filled(rect, 5.0, theme::LEGEND);
    for (i, line) in legend.iter().enumerate() {
        let middle = rect.top() + BORDER_POINTS / 2.0 + (i as f32 + 0.5) * LINE_POINTS;
        let [r, g, b] = line.color;
        let at = pos2(rect.left() + BORDER_POINTS + SWATCH_POINTS / 2.0, middle);
        painter.rect_filled(
            Rect::from_center_size(at, vec2(SWATCH_POINTS, SWATCH_POINTS)),
            2.0,
            Color32::from_rgb(r, g, b),
        );
        let text = pos2(rect.left() + 2.0 * BORDER_POINTS + SWATCH_POINTS, middle);
        painter.text(
            text,
            Align2::LEFT_CENTER,
            &line.label,
            font.clone(),
            Color32::WHITE,
        );
    }
}
