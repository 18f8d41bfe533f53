//! Times of the last frames, for the rolling chart and the frame rate.

use headbox_core::statistics::median;
use headbox_core::view::Stage;
use std::collections::VecDeque;

/// Times of one shown frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct FrameTimes {
    /// Time of display, seconds on any monotonic clock.
    pub shown_s: f64,
    /// Wall time of rendering all its pictures, ms.
    pub render_ms: f64,
    /// Time from the request of this view to its display, ms.
    pub latency_ms: f64,
    /// Time by stage, as the source reports it.
    pub stages: Vec<Stage>,
}

/// Ring buffer of the last frames.
#[derive(Clone, Debug, Default)]
pub(crate) struct History {
    frames: VecDeque<FrameTimes>,
}

impl History {
    /// Maximum number of frames.
    pub(crate) const CAPACITY: usize = 120;
    /// Averaging window of the frame rate, seconds.
    const RATE_WINDOW_S: f64 = 1.0;

    /// Appends a frame; drops the oldest if full.
    pub(crate) fn push(&mut self, frame: FrameTimes) {
        if self.frames.len() == Self::CAPACITY {
            self.frames.pop_front();
        }
        self.frames.push_back(frame);
    }

    /// Removes all frames.
    pub(crate) fn clear(&mut self) {
        self.frames.clear();
    }

    /// The frames, oldest first.
    pub(crate) fn frames(
        &self,
    ) -> impl DoubleEndedIterator<Item = &FrameTimes> + ExactSizeIterator {
        self.frames.iter()
    }

    /// Frame rate over the last second before the newest frame, or 0 if there are too few frames.
    pub(crate) fn shown_per_s(&self) -> f64 {
        let Some(newest) = self.frames.back() else {
            return 0.0;
        };
        let recent = || {
            self.frames
                .iter()
                .filter(|f| newest.shown_s - f.shown_s <= Self::RATE_WINDOW_S)
        };
        let (count, first) = (
            recent().count(),
            recent().next().map_or(newest.shown_s, |f| f.shown_s),
        );
        if newest.shown_s > first {
            (count - 1) as f64 / (newest.shown_s - first)
        } else {
            0.0
        }
    }

    /// Names of the stages, in the order of their first appearance.
    pub(crate) fn stage_names(&self) -> Vec<&'static str> {
        let mut names = Vec::new();
        for stage in self.frames.iter().flat_map(|f| &f.stages) {
            if !names.contains(&stage.name) {
                names.push(stage.name);
            }
        }
        names
    }

    /// Median of `value` over the stored frames, or `None` if there is none.
    pub(crate) fn median(&self, value: impl Fn(&FrameTimes) -> f64) -> Option<f64> {
        median(self.frames.iter().map(value))
    }
}

/// Adds the times of `stages` to those of the same name in `sum`.
pub(crate) fn add_stages(sum: &mut Vec<Stage>, stages: &[Stage]) {
    for stage in stages {
        match sum.iter_mut().find(|s| s.name == stage.name) {
            Some(same) => same.ms += stage.ms,
            None => sum.push(*stage),
        }
    }
}

/// Smallest of 1, 2, 5 times a power of ten that is at least `value`: the maximum of a chart axis.
pub(crate) fn nice_ceiling(value: f64) -> f64 {
    if !(value > 0.0 && value.is_finite()) {
        return 1.0;
    }
    let power = 10_f64.powf(value.log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .map(|m| m * power)
        .into_iter()
        .find(|top| *top >= value)
        .unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(shown_s: f64, render_ms: f64) -> FrameTimes {
        FrameTimes {
            shown_s,
            render_ms,
            ..FrameTimes::default()
        }
    }

    #[test]
    fn rate_and_median_of_regular_frames() {
        let mut history = History::default();
        assert_eq!(history.shown_per_s(), 0.0);
        assert_eq!(history.median(|f| f.render_ms), None);
        for i in 0..1000 {
            history.push(frame(f64::from(i) * 0.02, f64::from(i % 5)));
        }
        assert_eq!(history.frames().len(), History::CAPACITY);
        assert!((history.shown_per_s() - 50.0).abs() < 1e-6);
        assert_eq!(history.median(|f| f.render_ms), Some(2.0));
    }

    #[test]
    fn a_pause_does_not_count_as_a_slow_frame() {
        let mut history = History::default();
        for t in [0.0, 0.01, 100.0, 100.01, 100.02] {
            history.push(frame(t, 1.0));
        }
        assert!((history.shown_per_s() - 100.0).abs() < 1e-6);
    }

    #[test]
    fn stages_add_by_name() {
        let mut sum = vec![Stage {
            name: "warp",
            ms: 1.0,
        }];
        add_stages(
            &mut sum,
            &[
                Stage {
                    name: "splat",
                    ms: 2.0,
                },
                Stage {
                    name: "warp",
                    ms: 3.0,
                },
            ],
        );
        assert_eq!(
            sum,
            [
                Stage {
                    name: "warp",
                    ms: 4.0
                },
                Stage {
                    name: "splat",
                    ms: 2.0
                }
            ]
        );
        let mut history = History::default();
        history.push(FrameTimes {
            stages: sum,
            ..FrameTimes::default()
        });
        assert_eq!(history.stage_names(), ["warp", "splat"]);
    }

    #[test]
    fn axes_end_on_round_numbers() {
        for (value, top) in [
            (0.7, 1.0),
            (1.0, 1.0),
            (1.1, 2.0),
            (3.0, 5.0),
            (7.0, 10.0),
            (16.7, 20.0),
            (0.0, 1.0),
        ] {
            assert_eq!(nice_ceiling(value), top, "{value}");
        }
        assert_eq!(median([3.0, 1.0]), Some(2.0));
    }
}
