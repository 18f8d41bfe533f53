//! Statistics of the last frame.

use crate::panels::side::chart;
use crate::thread::exchange::{FinishedFrame, SourceInfo};
use crate::thread::history::{History, add_stages};
use egui::{Grid, Ui};
use headbox_core::view::Figure;

/// Shows the frame rate, the chart, and the figures that the source reports (one column each for A
/// and B).
pub(crate) fn show(
    ui: &mut Ui,
    info: &SourceInfo,
    shown: Option<&FinishedFrame>,
    history: &History,
) {
    ui.label(rate(history)).on_hover_text(
        "Frames shown per second while something moves; median over the frames of the chart of the milliseconds from the \
         wish for a view to its image.",
    );
    chart::show(ui, history);
    let Some(shown) = shown else { return };
    let sets = shown.job.sets.len();
    Grid::new("figures")
        .num_columns(1 + sets)
        .spacing([12.0, 2.0])
        .striped(true)
        .show(ui, |ui| {
            if sets > 1 {
                ui.label("");
                for letter in ["A", "B"] {
                    ui.strong(letter);
                }
                ui.end_row();
            }
            let mut stages: Vec<Vec<_>> = vec![Vec::new(); sets];
            for (i, picture) in shown.pictures.iter().enumerate() {
                add_stages(&mut stages[i % sets], &picture.report.stages);
            }
            for stage in &stages[0] {
                ui.label(stage.name).on_hover_text(
                    "A stage of the frame, in milliseconds; both eyes of a stereo pair together.",
                );
                for set in &stages {
                    let ms = set
                        .iter()
                        .find(|s| s.name == stage.name)
                        .map_or(0.0, |s| s.ms);
                    ui.monospace(format!("{ms:.2} ms"));
                }
                ui.end_row();
            }
            // Facts and figures of the left eye: those of the right eye are nearly the same.
            for fact in &shown.pictures[0].report.facts {
                ui.label(fact.name).on_hover_text(
                    info.term(fact.name)
                        .unwrap_or("Said by the view of this frame."),
                );
                for picture in shown.pictures.iter().take(sets) {
                    let same = picture.report.facts.iter().find(|f| f.name == fact.name);
                    ui.label(same.map_or("", |f| f.text.as_str()));
                }
                ui.end_row();
            }
            for figure in &shown.pictures[0].report.figures {
                ui.label(figure.name).on_hover_text(tooltip(info, figure));
                for picture in shown.pictures.iter().take(sets) {
                    let same = picture
                        .report
                        .figures
                        .iter()
                        .find(|f| f.name == figure.name);
                    ui.monospace(same.map_or_else(String::new, value));
                }
                ui.end_row();
            }
        });
}

/// Formats the frame rate (omitted at rest) and the latency.
fn rate(history: &History) -> String {
    let latency = history.median(|f| f.latency_ms).unwrap_or(0.0);
    let per_s = history.shown_per_s();
    if per_s >= 1.0 {
        format!("{per_s:.0} frames/s, latency {latency:.0} ms")
    } else {
        format!("latency {latency:.0} ms")
    }
}

fn tooltip(info: &SourceInfo, figure: &Figure) -> String {
    let unit = if figure.unit.is_empty() {
        "a number without unit"
    } else {
        figure.unit
    };
    match info.term(figure.name) {
        Some(sentence) => format!("{sentence} ({unit})"),
        None => format!("{}: {unit}, said by the view of this frame.", figure.name),
    }
}

/// Formats a figure with its unit: integers without decimals, others with three or four digits.
fn value(figure: &Figure) -> String {
    let v = figure.value;
    let number = match v.abs() {
        a if v.fract() == 0.0 && a < 1e15 => format!("{v:.0}"),
        a if a >= 100.0 => format!("{v:.0}"),
        a if a >= 1.0 => format!("{v:.2}"),
        a if a >= 1e-3 => format!("{v:.4}"),
        _ => format!("{v:.2e}"),
    };
    if figure.unit.is_empty() {
        number
    } else {
        format!("{number} {}", figure.unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_rate_is_shown_at_rest() {
        let mut history = History::default();
        assert_eq!(rate(&history), "latency 0 ms");
        for i in 0..20 {
            history.push(crate::thread::history::FrameTimes {
                shown_s: f64::from(i) * 0.05,
                ..Default::default()
            });
        }
        assert_eq!(rate(&history), "20 frames/s, latency 0 ms");
        history.push(crate::thread::history::FrameTimes {
            shown_s: 9.0,
            ..Default::default()
        });
        assert_eq!(rate(&history), "latency 0 ms");
    }

    #[test]
    fn figures_have_three_or_four_digits() {
        let show = |v, unit| {
            value(&Figure {
                name: "x",
                value: v,
                unit,
            })
        };
        assert_eq!(show(123_456.0, ""), "123456");
        assert_eq!(show(1.234_56, "px"), "1.23 px");
        assert_eq!(show(0.012_34, "%"), "0.0123 %");
        assert_eq!(show(1.5e-7, ""), "1.50e-7");
    }
}
