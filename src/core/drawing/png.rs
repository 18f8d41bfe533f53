//! The picture of a drawing.

use crate::drawing::letters;
use super::marks::{Anchor, BORDER_PX, Color, Drawing, HALO_PX, Mark};
use image::RgbImage;
use tiny_skia::{FillRule, LineCap, LineJoin, Paint, PathBuilder, Pixmap, Rect, Stroke, StrokeDash, Transform};

impl Drawing {
    /// The drawing as a picture; `None` if its size is none.
    pub fn to_image(&self) -> Option<RgbImage> {
        let [width, height] = [self.width, self.height].map(|side| (side as f32 * self.fineness) as u32);
        let mut pixmap = Pixmap::new(width, height)?;
        pixmap.fill(tiny_skia::Color::WHITE);
        for mark in &self.marks {
            draw(mark, self.fineness, &mut pixmap);
        }
        // Opaque from the start, so that premultiplied is straight.
        let rgb = pixmap.data().chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        RgbImage::from_raw(width, height, rgb)
    }
}

fn paint([r, g, b]: Color) -> Paint<'static> {
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color_rgba8(r, g, b, 255);
    paint
}

fn stroke(width: f64) -> Stroke {
    Stroke { width: width as f32, line_cap: LineCap::Round, line_join: LineJoin::Round, ..Stroke::default() }
}

/// Goes from point to point.
fn add(path: &mut PathBuilder, points: &[[f64; 2]]) {
    for (i, [x, y]) in points.iter().enumerate() {
        let (x, y) = (*x as f32, *y as f32);
        if i == 0 { path.move_to(x, y) } else { path.line_to(x, y) }
    }
}

fn draw(mark: &Mark, fineness: f32, pixmap: &mut Pixmap) {
    let scale = Transform::from_scale(fineness, fineness);
    match mark {
        Mark::Line { points, color, width, dashed } => {
            let mut path = PathBuilder::new();
            add(&mut path, points);
            let dash = if *dashed { StrokeDash::new(vec![4.0, 4.0], 0.0) } else { None };
            if let Some(path) = path.finish() {
                pixmap.stroke_path(&path, &paint(*color), &Stroke { dash, ..stroke(*width) }, scale, None);
            }
        }
        Mark::Strokes { ends, color, width } => {
            let mut path = PathBuilder::new();
            ends.iter().for_each(|line| add(&mut path, line));
            if let Some(path) = path.finish() {
                pixmap.stroke_path(&path, &paint(*color), &stroke(*width), scale, None);
            }
        }
        Mark::Area { outlines, color } => {
            for outline in outlines {
                let mut path = PathBuilder::new();
                add(&mut path, outline);
                path.close();
                if let Some(path) = path.finish() {
                    pixmap.fill_path(&path, &paint(*color), FillRule::EvenOdd, scale, None);
                }
            }
        }
        Mark::Box { at, size, color } => {
            let [x, y, width, height] = [at[0], at[1], size[0], size[1]].map(|v| v as f32);
            if let Some(rectangle) = Rect::from_xywh(x, y, width, height) {
                pixmap.fill_rect(rectangle, &paint([255; 3]), scale, None);
                let border = PathBuilder::from_rect(rectangle);
                pixmap.stroke_path(&border, &paint(*color), &stroke(BORDER_PX), scale, None);
            }
        }
        Mark::Dot { at: [x, y], radius, color, filled } => {
            if let Some(path) = PathBuilder::from_circle(*x as f32, *y as f32, *radius as f32) {
                let inside = if *filled { *color } else { [255; 3] };
                pixmap.fill_path(&path, &paint(inside), FillRule::Winding, scale, None);
                pixmap.stroke_path(&path, &paint(*color), &stroke(1.6), scale, None);
            }
        }
        Mark::Text { at: [x, y], size, color, anchor, upright, halo, text } => {
            let width = letters::width_px(text, *size);
            let back = match anchor {
                Anchor::Start => 0.0,
                Anchor::Middle => width / 2.0,
                Anchor::End => width,
            };
            let place = scale.pre_translate(*x as f32, *y as f32);
            let place = if *upright { place } else { place.pre_rotate(-90.0) };
            if let Some(path) = letters::outlines(text, *size) {
                let place = place.pre_translate(-back as f32, 0.0);
                if *halo {
                    pixmap.stroke_path(&path, &paint([255; 3]), &stroke(HALO_PX), place, None);
                }
                pixmap.fill_path(&path, &paint(*color), FillRule::Winding, place, None);
            }
        }
    }
}
