//! Rolling chart of milliseconds by stage: one column per frame, stages stacked.

use crate::panels::theme;
use crate::thread::history::{FrameTimes, History, nice_ceiling};
use egui::{Align2, Color32, FontId, Mesh, Painter, Rect, Sense, Shape, Stroke, Ui, pos2, vec2};

const HEIGHT_POINTS: f32 = 96.0;

/// Minimum height of a bar, points. Lower bars are invisible, but cost a software rasteriser two
/// triangles each.
const MIN_BAR_POINTS: f32 = 0.2;

/// Shows the chart and its legend.
pub(crate) fn show(ui: &mut Ui, history: &History) {
    let (rect, response) =
        ui.allocate_exact_size(vec2(ui.available_width(), HEIGHT_POINTS), Sense::hover());
    let names = history.stage_names();
    let highest = history.frames().map(|f| f.render_ms).fold(0.0, f64::max);
    let axis = Axis {
        rect: rect.shrink2(vec2(0.0, 1.0)),
        top_ms: nice_ceiling(highest),
    };
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 3.0, theme::BACKDROP);
    axis.paint_lines(&painter);
    axis.paint_columns(&painter, history, &names);
    axis.paint_labels(&painter);
    let tip = "Milliseconds by stage for the last frames, the newest on the right; the lines are labelled in ms.";
    let hovered = response
        .hover_pos()
        .and_then(|at| axis.frame_at(at.x, history));
    match hovered {
        Some(frame) => response.on_hover_text_at_pointer(describe(frame)),
        None => response.on_hover_text(tip),
    };
    ui.horizontal_wrapped(|ui| {
        for (i, name) in names.iter().enumerate() {
            let (swatch, _) = ui.allocate_exact_size(vec2(9.0, 9.0), Sense::hover());
            ui.painter().rect_filled(swatch, 2.0, color(i));
            let stage_ms = |f: &FrameTimes| {
                f.stages
                    .iter()
                    .find(|s| s.name == *name)
                    .map_or(0.0, |s| s.ms)
            };
            let median = history.median(stage_ms).unwrap_or(0.0);
            ui.small(format!("{name} {median:.1}"))
                .on_hover_text(format!(
                    "Median time of the stage \"{name}\" over the chart, in milliseconds."
                ));
        }
    });
}

struct Axis {
    rect: Rect,
    top_ms: f64,
}

impl Axis {
    fn y(&self, ms: f64) -> f32 {
        self.rect.bottom() - self.rect.height() * (ms / self.top_ms) as f32
    }

    fn column_width(&self) -> f32 {
        self.rect.width() / History::CAPACITY as f32
    }

    fn grid(&self) -> [f64; 2] {
        [self.top_ms / 2.0, self.top_ms]
    }

    fn paint_lines(&self, painter: &Painter) {
        for ms in self.grid() {
            painter.hline(
                self.rect.x_range(),
                self.y(ms),
                Stroke::new(1.0, Color32::from_gray(45)),
            );
        }
    }

    fn paint_labels(&self, painter: &Painter) {
        for ms in self.grid() {
            let at = pos2(self.rect.left() + 3.0, self.y(ms) + 1.0);
            painter.text(
                at,
                Align2::LEFT_TOP,
                format!("{ms} ms"),
                FontId::proportional(10.0),
                theme::LINE,
            );
        }
    }

    fn paint_columns(&self, painter: &Painter, history: &History, names: &[&str]) {
        let width = self.column_width();
        let mut mesh = Mesh::default();
        for (age, frame) in history.frames().rev().enumerate() {
            let right = self.rect.right() - age as f32 * width;
            let mut column = |from_ms: f64, to_ms: f64, color| {
                let (top, bottom) = (self.y(to_ms), self.y(from_ms));
                if bottom - top < MIN_BAR_POINTS {
                    return;
                }
                mesh.add_colored_rect(
                    Rect::from_min_max(pos2(right - width, top), pos2(right, bottom)),
                    color,
                );
            };
            let mut stacked_ms = 0.0;
            for stage in &frame.stages {
                let index = names
                    .iter()
                    .position(|name| *name == stage.name)
                    .unwrap_or(0);
                column(stacked_ms, stacked_ms + stage.ms, color(index));
                stacked_ms += stage.ms;
            }
            // Time outside of all stages.
            column(stacked_ms, frame.render_ms.max(stacked_ms), theme::FAINT);
        }
        painter.add(Shape::mesh(mesh));
    }

    fn frame_at<'a>(&self, x: f32, history: &'a History) -> Option<&'a FrameTimes> {
        let age = ((self.rect.right() - x) / self.column_width()).max(0.0) as usize;
        history.frames().rev().nth(age)
    }
}

fn color(stage: usize) -> Color32 {
    theme::STAGES[stage % theme::STAGES.len()]
}

fn describe(frame: &FrameTimes) -> String {
    let mut text = format!("{:.2} ms in all", frame.render_ms);
    for stage in &frame.stages {
        text += &format!("\n{:.2} ms {}", stage.ms, stage.name);
    }
    text
}
