//! Dynamic resolution: scale of the frame while the eye moves, chosen to keep the frame rate.

use std::collections::HashMap;

/// Scales of each side of the frame that are tried while moving.
pub(crate) const SCALES: [f64; 5] = [1.0, 0.75, 0.5, 0.375, 0.25];

/// Minimum share of the frame time that a lower scale must save. Less is not worth the blur: the
/// time of an image-based renderer may depend on depth pixels rather than frame pixels.
const MIN_SAVING: f64 = 0.15;
/// Share of the target time that a higher scale may take by prediction to be tried again.
const HEADROOM: f64 = 0.8;
/// Weight of the newest time in the running mean.
const NEWEST_WEIGHT: f64 = 0.25;

/// Choice of the scale while moving, from the times of earlier frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ResolutionPolicy {
    /// Index into [`SCALES`].
    step: usize,
    /// Running mean of the render time at each step tried, ms.
    mean_ms: HashMap<usize, f64>,
}

impl ResolutionPolicy {
    /// Scale of each side of the frame while moving.
    pub(crate) fn moving_scale(&self) -> f64 {
        SCALES[self.step]
    }

    /// Adds the time `ms` of a frame at `scale`, and chooses the next step for frames of at most
    /// `target_ms`.
    pub(crate) fn observe(&mut self, scale: f64, ms: f64, target_ms: f64) {
        let Some(step) = SCALES.iter().position(|s| *s == scale) else {
            return;
        };
        let mean = self.mean_ms.entry(step).or_insert(ms);
        *mean += (ms - *mean) * NEWEST_WEIGHT;
        if step == self.step {
            self.step = self.choose(target_ms);
        }
    }

    /// Discards all times (other settings, another window size).
    pub(crate) fn reset(&mut self) {
        *self = Self::default();
    }

    fn choose(&self, target_ms: f64) -> usize {
        let step = self.step;
        let Some(&now) = self.mean_ms.get(&step) else {
            return step;
        };
        let above = step
            .checked_sub(1)
            .and_then(|above| Some((above, *self.mean_ms.get(&above)?)));
        if let Some((above, above_ms)) = above
            && now > above_ms * (1.0 - MIN_SAVING)
        {
            return above;
        }
        if now > target_ms {
            let below = step + 1;
            let helps = self
                .mean_ms
                .get(&below)
                .is_none_or(|&ms| ms <= now * (1.0 - MIN_SAVING));
            return if below < SCALES.len() && helps {
                below
            } else {
                step
            };
        }
        let predicted = |above: usize| now * (SCALES[above] / SCALES[step]).powi(2);
        match step.checked_sub(1) {
            Some(above) if predicted(above) <= target_ms * HEADROOM => above,
            _ => step,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TARGET_MS: f64 = 16.0;

    /// Runs `frames` frames of a renderer whose time is `ms(scale)`, and returns the last scale.
    fn settle(policy: &mut ResolutionPolicy, frames: usize, ms: impl Fn(f64) -> f64) -> f64 {
        for _ in 0..frames {
            let scale = policy.moving_scale();
            policy.observe(scale, ms(scale), TARGET_MS);
        }
        policy.moving_scale()
    }

    #[test]
    fn fast_frames_keep_full_resolution() {
        assert_eq!(settle(&mut ResolutionPolicy::default(), 50, |_| 10.0), 1.0);
    }

    #[test]
    fn slow_frames_lower_resolution_to_target() {
        // 40 ms at full size: 3/4 gives 22.5, 1/2 gives 10.
        assert_eq!(
            settle(&mut ResolutionPolicy::default(), 50, |scale| 40.0
                * scale
                * scale),
            0.5
        );
        assert_eq!(
            settle(&mut ResolutionPolicy::default(), 50, |scale| 4000.0
                * scale
                * scale),
            0.25
        );
    }

    #[test]
    fn resolution_stays_if_nothing_is_saved() {
        assert_eq!(settle(&mut ResolutionPolicy::default(), 50, |_| 40.0), 1.0);
    }

    #[test]
    fn resolution_rises_for_faster_frames() {
        let mut policy = ResolutionPolicy::default();
        settle(&mut policy, 50, |scale| 40.0 * scale * scale);
        assert_eq!(settle(&mut policy, 200, |scale| 8.0 * scale * scale), 1.0);
    }

    #[test]
    fn times_of_other_scales_do_not_switch() {
        let mut policy = ResolutionPolicy::default();
        policy.observe(0.3, 1000.0, TARGET_MS);
        policy.observe(0.5, 1000.0, TARGET_MS);
        assert_eq!(policy.moving_scale(), 1.0);
    }
}
