//! Progress strip along the frame's upper edge during background work: task, progress, remaining
//! time.

use crate::panels::theme;
use egui::{Align2, Color32, FontId, Painter, Rect, pos2, vec2};
use headbox_core::view::Ongoing;
use std::time::Duration;

/// Height of the strip, points.
pub(crate) const HEIGHT_POINTS: f32 = 20.0;
const BAR_POINTS: f32 = 3.0;
const MARGIN_POINTS: f32 = 8.0;

/// Paints the strip over a frame that fills `rect`; its text starts at `left`.
pub(crate) fn paint(painter: &Painter, rect: Rect, left: f32, ongoing: &Ongoing) {
    let strip = Rect::from_min_size(rect.min, vec2(rect.width(), HEIGHT_POINTS));
    let painter = painter.with_clip_rect(strip.intersect(painter.clip_rect()));
    painter.rect_filled(strip, 0.0, theme::STRIP);
    let done = vec2(
        strip.width() * ongoing.share.clamp(0.0, 1.0) as f32,
        BAR_POINTS,
    );
    painter.rect_filled(
        Rect::from_min_size(pos2(strip.left(), strip.bottom() - BAR_POINTS), done),
        0.0,
        theme::ACCENT,
    );
    let at = pos2(left + MARGIN_POINTS, strip.center().y - BAR_POINTS / 2.0);
    painter.text(
        at,
        Align2::LEFT_CENTER,
        describe(ongoing),
        FontId::proportional(12.0),
        Color32::WHITE,
    );
}

/// Describes ongoing work: task, progress, remaining time.
pub(crate) fn describe(ongoing: &Ongoing) -> String {
    // Unfinished work never shows 100 %.
    let share = format!(
        "{}: {:.0} %",
        ongoing.what,
        (ongoing.share * 100.0).floor().min(99.0)
    );
    match ongoing.left {
        Some(left) => format!("{share}, {} left", duration(left)),
        None => share,
    }
}

/// Formats a duration: seconds up to 90, then minutes.
fn duration(left: Duration) -> String {
    let s = left.as_secs_f64();
    if s < 90.0 {
        format!("{:.0} s", s.max(1.0))
    } else {
        format!("{:.0} min", s / 60.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_and_remaining_time_are_described() {
        let ongoing = |share, left_s: Option<f64>| Ongoing {
            what: "light".into(),
            share,
            left: left_s.map(Duration::from_secs_f64),
        };
        assert_eq!(describe(&ongoing(0.0, None)), "light: 0 %");
        assert_eq!(
            describe(&ongoing(0.5, Some(12.4))),
            "light: 50 %, 12 s left"
        );
        assert_eq!(
            describe(&ongoing(0.999, Some(0.01))),
            "light: 99 %, 1 s left"
        );
        assert_eq!(
            describe(&ongoing(0.1, Some(600.0))),
            "light: 10 %, 10 min left"
        );
    }
}
