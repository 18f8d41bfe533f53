//! Dynamic resolution: scale of the frame while the eye moves, chosen to keep the frame rate.
//!
//! Fewer pixels are worth their blur only if they save time, and an image-based renderer may spend
//! its time on depth pixels instead. So each lower step is judged: unless it saves a fair share of
//! what its number of pixels promises, the step above returns and stays.

use headbox_core::statistics::median;
use std::collections::VecDeque;

/// Scales of each side of the frame that are tried while moving.
pub(crate) const SCALES: [f64; 5] = [1.0, 0.75, 0.5, 0.375, 0.25];

/// Minimum saving of time by a lower step, as a share of its saving of pixels.
const MIN_SAVING_SHARE: f64 = 0.5;
/// Share of the target time that a higher step may take by prediction to be tried again.
const HEADROOM: f64 = 0.8;
/// Number of frames after which a step is judged: a single time may be an outlier.
const JUDGED_FRAMES: u32 = 3;
/// Multiple of the target time from which a single frame suffices to go lower.
const SLOW: f64 = 3.0;
/// Number of last frames whose median is the time of a step.
const MEDIAN_FRAMES: usize = 5;
/// Change of a step's time, as a factor, after which a rejected lower step is tried again.
const CHANGED: f64 = 1.5;
/// Number of frames at a lower step after which the step above is tried in any case; doubled by
/// each such try, up to the maximum.
const RETRY_FRAMES: u32 = 120;
const MAX_RETRY_FRAMES: u32 = 16 * RETRY_FRAMES;

/// Choice of the scale while moving, from the times of earlier frames.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ResolutionPolicy {
    /// Index into [`SCALES`].
    step: usize,
    /// Number of frames since the step was chosen.
    frames: u32,
    /// Times of the last of them, ms.
    last_ms: VecDeque<f64>,
    /// Time of the step above, until this one is judged against it, ms.
    above_ms: Option<f64>,
    /// Time of each step as a share of the time of the step above.
    time_shares: [f64; SCALES.len()],
    /// Step below which there is nothing to gain, and its time then, ms.
    rejected: Option<(usize, f64)>,
    retry_frames: u32,
}

impl Default for ResolutionPolicy {
    fn default() -> Self {
        Self {
            step: 0,
            frames: 0,
            last_ms: VecDeque::new(),
            above_ms: None,
            time_shares: std::array::from_fn(pixel_share),
            rejected: None,
            retry_frames: RETRY_FRAMES,
        }
    }
}

/// Number of pixels of a step as a share of that of the step above.
fn pixel_share(step: usize) -> f64 {
    let above = SCALES[step.saturating_sub(1)];
    (SCALES[step] / above).powi(2)
}

impl ResolutionPolicy {
    /// Scale of each side of the frame while moving.
    pub(crate) fn moving_scale(&self) -> f64 {
        SCALES[self.step]
    }

    /// Adds the time `ms` of a frame at `scale`, and chooses the next step for frames of at most
    /// `target_ms`. A frame of another step, requested before the last choice, does not count.
    pub(crate) fn observe(&mut self, scale: f64, ms: f64, target_ms: f64) {
        if scale != self.moving_scale() || !ms.is_finite() {
            return;
        }
        self.frames += 1;
        self.last_ms.push_back(ms);
        if self.last_ms.len() > MEDIAN_FRAMES {
            self.last_ms.pop_front();
        }
        let Some(now_ms) = median(self.last_ms.iter().copied()) else {
            return;
        };
        if self.frames < JUDGED_FRAMES && now_ms < target_ms * SLOW {
            return;
        }
        if let Some(above_ms) = self.above_ms.take()
            && !self.is_worth_it(now_ms, above_ms)
        {
            self.rejected = Some((self.step - 1, above_ms));
            self.go_to(self.step - 1);
            return;
        }
        if now_ms > target_ms && self.may_go_lower(now_ms) {
            self.go_to(self.step + 1);
            self.above_ms = Some(now_ms);
        } else if self.step > 0 {
            self.consider_above(now_ms, target_ms);
        }
    }

    /// Discards all times (other settings, another window size).
    pub(crate) fn reset(&mut self) {
        *self = Self::default();
    }

    fn go_to(&mut self, step: usize) {
        self.step = step;
        self.frames = 0;
        self.last_ms.clear();
    }

    /// Judges the current step by its time and that of the step above.
    fn is_worth_it(&mut self, now_ms: f64, above_ms: f64) -> bool {
        let (time_share, pixel_share) = (now_ms / above_ms, pixel_share(self.step));
        self.time_shares[self.step] = time_share.clamp(pixel_share, 1.0);
        1.0 - time_share >= MIN_SAVING_SHARE * (1.0 - pixel_share)
    }

    fn may_go_lower(&mut self, now_ms: f64) -> bool {
        if let Some((step, ms)) = self.rejected
            && step == self.step
        {
            if now_ms < ms * CHANGED && now_ms * CHANGED > ms {
                return false;
            }
            self.rejected = None;
        }
        self.step + 1 < SCALES.len()
    }

    /// Goes one step higher if that should be fast enough, or from time to time to find out.
    fn consider_above(&mut self, now_ms: f64, target_ms: f64) {
        let predicted_ms = now_ms / self.time_shares[self.step];
        if predicted_ms <= target_ms * HEADROOM {
            self.retry_frames = RETRY_FRAMES;
            self.go_to(self.step - 1);
        } else if self.frames >= self.retry_frames {
            self.retry_frames = (self.retry_frames * 2).min(MAX_RETRY_FRAMES);
            self.go_to(self.step - 1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TARGET_MS: f64 = 16.0;

    /// Runs `frames` frames of a renderer whose time is `ms(frame, scale)`, and returns the scales.
    fn simulate(
        policy: &mut ResolutionPolicy,
        frames: usize,
        ms: impl Fn(usize, f64) -> f64,
    ) -> Vec<f64> {
        let frame = |i| {
            let scale = policy.moving_scale();
            policy.observe(scale, ms(i, scale), TARGET_MS);
            scale
        };
        (0..frames).map(frame).collect()
    }

    /// Scale of most of the last `frames` frames.
    fn usual(scales: &[f64], frames: usize) -> f64 {
        let last = &scales[scales.len() - frames..];
        let count = |scale: &f64| last.iter().filter(|s| *s == scale).count();
        let most = SCALES.iter().max_by_key(|scale| count(scale));
        *most.unwrap()
    }

    fn switches(scales: &[f64]) -> usize {
        scales.windows(2).filter(|pair| pair[0] != pair[1]).count()
    }

    /// Scale that a renderer ends at whose time is `fixed_ms` and, at full size, `pixels_ms` more.
    fn end(fixed_ms: f64, pixels_ms: f64) -> f64 {
        let ms = |_, scale: f64| fixed_ms + pixels_ms * scale * scale;
        usual(&simulate(&mut ResolutionPolicy::default(), 600, ms), 100)
    }

    #[test]
    fn fast_frames_keep_full_resolution() {
        let scales = simulate(&mut ResolutionPolicy::default(), 50, |_, _| 10.0);
        assert_eq!((end(10.0, 0.0), switches(&scales)), (1.0, 0));
    }

    #[test]
    fn slow_frames_lower_resolution_to_target() {
        // 40 ms at full size: 3/4 gives 22.5, 1/2 gives 10.
        assert_eq!(end(0.0, 40.0), 0.5);
        assert_eq!(end(0.0, 4000.0), 0.25);
    }

    #[test]
    fn very_slow_frames_are_not_awaited() {
        let scales = simulate(&mut ResolutionPolicy::default(), 5, |_, scale| {
            4000.0 * scale * scale
        });
        assert_eq!(scales, SCALES);
    }

    #[test]
    fn resolution_stays_if_little_is_saved() {
        assert_eq!(end(40.0, 0.0), 1.0, "nothing is saved");
        // A quarter of the time depends on pixels: 3/4 saves 11 % of the time for 44 % of the
        // pixels.
        assert_eq!(end(30.0, 10.0), 1.0);
        // Half: the first step saves 22 %, just enough; the second 18 of 28 %.
        assert_eq!(end(19.0, 21.0), 0.75);
    }

    #[test]
    fn rejected_step_is_not_tried_again() {
        let scales = simulate(&mut ResolutionPolicy::default(), 3000, |_, _| 40.0);
        assert_eq!(switches(&scales), 2, "down once, and back");
    }

    #[test]
    fn rejected_step_is_tried_again_after_change() {
        let mut policy = ResolutionPolicy::default();
        simulate(&mut policy, 50, |_, _| 40.0);
        let scales = simulate(&mut policy, 50, |_, scale| 120.0 * scale * scale);
        assert!(usual(&scales, 20) < 0.5, "{scales:?}");
    }

    #[test]
    fn resolution_rises_for_faster_frames() {
        let mut policy = ResolutionPolicy::default();
        simulate(&mut policy, 50, |_, scale| 40.0 * scale * scale);
        let scales = simulate(&mut policy, 50, |_, scale| 8.0 * scale * scale);
        assert_eq!(usual(&scales, 20), 1.0);
    }

    #[test]
    fn outlier_does_not_lower_resolution() {
        let stall = |i, _| if i % 20 == 0 { 45.0 } else { 14.0 };
        let scales = simulate(&mut ResolutionPolicy::default(), 400, stall);
        assert_eq!(switches(&scales), 0);
    }

    #[test]
    fn resolution_returns_after_busy_spell() {
        // While others use the processor everything takes four times as long.
        let ms = |i, scale: f64| (5.0 + 9.0 * scale * scale) * if i < 60 { 4.0 } else { 1.0 };
        let scales = simulate(&mut ResolutionPolicy::default(), 1000, ms);
        assert!(usual(&scales[..60], 30) < 1.0, "{scales:?}");
        assert_eq!(usual(&scales, 300), 1.0);
    }

    #[test]
    fn tries_of_the_step_above_become_rare() {
        let ms = |_, scale: f64| 40.0 * scale * scale;
        let scales = simulate(&mut ResolutionPolicy::default(), 6000, ms);
        let sharper = scales[50..].iter().filter(|scale| **scale > 0.5).count();
        assert!((1..40).contains(&sharper), "{sharper} slower frames");
    }

    #[test]
    fn times_of_other_scales_do_not_switch() {
        let mut policy = ResolutionPolicy::default();
        policy.observe(0.3, 1000.0, TARGET_MS);
        policy.observe(0.5, 1000.0, TARGET_MS);
        assert_eq!(policy.moving_scale(), 1.0);
    }
}
