//! Windows of eight surface samples, in lanes, and the choice among them for each.

use super::{GatheredLight, PooledLight};
use fearless_simd::{Simd, f32x8, mask32x8, prelude::*};
use glam::Vec3;
use headbox_core::color::LUMINANCE;

/// Number of surface samples that are pooled together.
pub(super) const LANES: usize = 8;

/// Means over the pixels of a window: of light (three channels), samples, squared luminances,
/// nearness; the share of the window that the surface fills; and padding to whole registers.
pub(super) type Sums = [f32; 8];

/// Index of the number of samples in [`Sums`].
pub(super) const SAMPLES: usize = 3;

/// Index of the squared luminances in [`Sums`].
const SQUARES: usize = 4;

/// Index of the luminances in [`Sums`] of gradients.
pub(super) const LUMINANCES: usize = SQUARES;

/// Index of the samples' nearness in [`Sums`].
pub(super) const NEARNESS: usize = 5;

/// Index of the share of the window that the surface fills in [`Sums`].
pub(super) const SHARE: usize = 6;

/// Number of samples whose own variance has the weight of that of their class.
pub(super) const FEW_SAMPLES: f32 = 32.0;

/// The wider window's mean counts in full where it differs from the narrower one's by less than the
/// first of these standard errors, and not at all where it differs by more than the second.
const TOLERANCE: [f32; 2] = [1.0, 2.5];

/// Numbers of samples of the narrower window from which that difference starts to count, and from
/// which it counts in full: means of fewer are off by several standard errors wherever one sample
/// has hit something small and bright.
const MANY: [f32; 2] = [64.0, 256.0];

/// Standard errors of difference from which it starts to count in a window of fewer samples, and
/// from which it counts in full: at the edge of a shadow.
const STRIKING: [f32; 2] = [2.5, 5.0];

/// Numbers of samples from which a window's nearness and light start to count, and from which they
/// count in full.
const TRUSTED_SAMPLES: [f32; 2] = [8.0, 32.0];

/// Squared ratios of a window's light to its standard error from which its nearness starts to
/// count, and from which it counts in full.
const TRUSTED_RATIO: [f32; 2] = [4.0, 16.0];

/// Approximate change of irradiance over a window, as a share of the square of the window's radius
/// over the harmonic mean distance.
const CURVATURE: f32 = 1.0;

/// Limit of the radius of a window in harmonic mean distances, whose fourth power is finite.
/// Windows beyond are equally biased.
const FARTHEST_REACH: f32 = 1e4;

/// Radius in harmonic mean distances at which a window is biased by about a hundredth of its light.
const NEAR: f32 = 0.1;

/// Support of a Gaussian window with a standard deviation of `radius_px` on a surface without gaps:
/// one over the sum of its squared weights.
pub(super) fn gaussian_support(radius_px: f32) -> f32 {
    4.0 * std::f32::consts::PI * radius_px * radius_px
}

/// The window of a single surface sample.
pub(super) fn sums(gathered: &GatheredLight) -> Sums {
    let [r, g, b] = gathered.light.to_array();
    [
        r,
        g,
        b,
        gathered.samples,
        gathered.squares,
        gathered.nearness,
        1.0,
        0.0,
    ]
}

/// Adds sums with a weight.
#[inline(always)]
pub(super) fn add(to: &mut Sums, sums: &Sums, weight: f32) {
    to.iter_mut()
        .zip(sums)
        .for_each(|(to, value)| *to += weight * value);
}

/// [`Sums`] of surface samples in lanes, `[sum][lane]`.
#[derive(Clone, Copy, Default)]
pub(super) struct SumLanes([[f32; LANES]; 8]);

impl SumLanes {
    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, sums: &Sums) {
        for (lanes, &sum) in self.0.iter_mut().zip(sums) {
            lanes[lane] = sum;
        }
    }

    #[inline(always)]
    pub(super) fn load<S: Simd>(&self, simd: S, sum: usize) -> f32x8<S> {
        f32x8::load_array(simd, self.0[sum])
    }
}

/// One window of each surface sample.
#[derive(Clone, Copy)]
pub(super) struct Window<S: Simd> {
    light: [f32x8<S>; 3],
    /// Luminance of `light`.
    level: f32x8<S>,
    variance: f32x8<S>,
    /// 1/m.
    nearness: f32x8<S>,
    samples: f32x8<S>,
    /// See [`PooledLight::support`].
    support: f32x8<S>,
}

impl<S: Simd> Window<S> {
    /// Windows from sums. `support` is that of a window without gaps, `expected` the expected
    /// variance of light samples.
    #[inline(always)]
    pub(super) fn new(simd: S, sums: &SumLanes, support: f32x8<S>, expected: f32x8<S>) -> Self {
        let samples = sums.load(simd, SAMPLES);
        let per_sample = f32x8::splat(simd, 1.0) / samples.max(1e-20);
        let red = sums.load(simd, 0) * per_sample;
        let green = sums.load(simd, 1) * per_sample;
        let blue = sums.load(simd, 2) * per_sample;
        let level = red * LUMINANCE[0] + green * LUMINANCE[1] + blue * LUMINANCE[2];
        let variance = (sums.load(simd, SQUARES) * per_sample - level * level).max(0.0);
        let samples = samples * support;
        let support = sums.load(simd, SHARE) * support;
        // Few samples may have missed rare bright light.
        let variance = (variance * samples + expected * FEW_SAMPLES) / (samples + FEW_SAMPLES);
        let nearness = sums.load(simd, NEARNESS) * per_sample;
        Self {
            light: [red, green, blue],
            level,
            variance,
            nearness,
            samples,
            support,
        }
    }

    /// Selects the lanes of `others` where the mask is set.
    #[inline(always)]
    fn or(&self, others: &Self, mask: mask32x8<S>) -> Self {
        let [a, b] = [self, others];
        Self {
            light: [
                mask.select(b.light[0], a.light[0]),
                mask.select(b.light[1], a.light[1]),
                mask.select(b.light[2], a.light[2]),
            ],
            level: mask.select(b.level, a.level),
            variance: mask.select(b.variance, a.variance),
            nearness: mask.select(b.nearness, a.nearness),
            samples: mask.select(b.samples, a.samples),
            support: mask.select(b.support, a.support),
        }
    }
}

/// The windows chosen so far for each surface sample.
pub(super) struct WindowChoice<S: Simd> {
    /// The pooled light; its level and nearness are unused.
    pooled: Window<S>,
    /// The last windows that were compared.
    last: Window<S>,
    /// Weight of the next wider windows; 1 as long as they may count in full.
    weight: f32x8<S>,
    /// Lanes for which a window was chosen.
    chosen: mask32x8<S>,
}

impl<S: Simd> WindowChoice<S> {
    /// The choice of these windows in the lanes of a mask.
    #[inline(always)]
    pub(super) fn first(window: Window<S>, chosen: mask32x8<S>) -> Self {
        Self {
            pooled: window,
            last: window,
            weight: f32x8::splat(window.level.token(), 1.0),
            chosen,
        }
    }

    /// No choice in any lane.
    #[inline(always)]
    pub(super) fn none(simd: S) -> Self {
        let zero = f32x8::splat(simd, 0.0);
        Self::first(
            Window::new(simd, &SumLanes::default(), zero, zero),
            mask32x8::from_bitmask(simd, 0),
        )
    }

    /// Lanes in which light comes from so near that a window with a standard deviation of
    /// `radius_m` would be biased.
    #[inline(always)]
    pub(super) fn is_near(&self, radius_m: f32x8<S>) -> mask32x8<S> {
        (radius_m * self.last.nearness).simd_gt(NEAR) & self.chosen
    }

    /// Proceeds to wider windows with a standard deviation of `radius_m` where they may still
    /// count, and where they have not left out most of the surface as too small to follow. Lanes
    /// without a window begin with these.
    #[inline(always)]
    pub(super) fn take(&mut self, wide: &Window<S>, radius_m: f32x8<S>) {
        let may_count = (wide.support * 2.0).simd_gt(self.last.support)
            & self.weight.simd_gt(0.0)
            & self.chosen;
        let begins = !self.chosen;
        self.widen(wide, radius_m, may_count);
        self.pooled = self.pooled.or(wide, begins);
        self.last = self.last.or(wide, begins);
        self.weight = (may_count | begins).select(self.weight, f32x8::splat(radius_m.token(), 0.0));
        self.chosen |= begins;
    }

    /// Returns true if wider windows may count in any lane.
    #[inline(always)]
    pub(super) fn may_widen(&self) -> bool {
        self.weight.simd_gt(0.0).any_true()
    }

    /// Compares wider windows with a standard deviation of `radius_m` in the lanes of a mask, and
    /// blends them in.
    #[inline(always)]
    pub(super) fn widen(&mut self, wide: &Window<S>, radius_m: f32x8<S>, mask: mask32x8<S>) {
        let last = self.last;
        let one = f32x8::splat(radius_m.token(), 1.0);
        // The narrower window may have missed rare bright light, or sampled nothing else.
        let variance = wide.variance.max(last.variance);
        let error2 = variance / last.samples.max(1e-3) + last.level * last.level * 1e-8;
        let difference = (wide.level - last.level).abs() / error2.sqrt().max(1e-20);
        let ratio = last.samples * wide.level * wide.level / variance.max(1e-20);
        let trusted = smooth_steps(TRUSTED_SAMPLES, last.samples);
        let confidence =
            smooth_steps(MANY, last.samples).max(trusted * smooth_steps(STRIKING, difference));
        let agreement = one - confidence * smooth_steps(TOLERANCE, difference);
        let trusted = trusted * smooth_steps(TRUSTED_RATIO, ratio);
        let reach = (radius_m * wide.nearness).min(FARTHEST_REACH);
        let bias = last.level * reach * reach * CURVATURE;
        let bias2 = bias * bias;
        let weight =
            self.weight * agreement * (one - trusted * (bias2 / (bias2 + error2).max(1e-30)));
        let from = &self.pooled;
        let widened = Window {
            light: [
                from.light[0] + (wide.light[0] - from.light[0]) * weight,
                from.light[1] + (wide.light[1] - from.light[1]) * weight,
                from.light[2] + (wide.light[2] - from.light[2]) * weight,
            ],
            variance: from.variance + (wide.variance - from.variance) * weight.max(one - trusted),
            samples: from.samples + (wide.samples - from.samples) * weight,
            support: from.support + (wide.support - from.support) * weight,
            ..*wide
        };
        self.pooled = self.pooled.or(&widened, mask);
        self.last = self.last.or(wide, mask);
        self.weight = mask.select(weight, self.weight);
    }

    /// The pooled light of each lane.
    #[inline(always)]
    pub(super) fn pooled(&self) -> [PooledLight; LANES] {
        let Window {
            light: [red, green, blue],
            variance,
            samples,
            support,
            ..
        } = &self.pooled;
        let mut pooled = [PooledLight::default(); LANES];
        for (i, pooled) in pooled.iter_mut().enumerate() {
            let light = Vec3::new(red[i], green[i], blue[i]);
            *pooled = PooledLight {
                light,
                variance: variance[i],
                samples: samples[i],
                support: support[i],
            };
        }
        pooled
    }
}

/// Smooth step from 0 at the first number to 1 at the second.
#[inline]
pub(super) fn smooth_step([from, to]: [f32; 2], x: f32) -> f32 {
    let share = ((x - from) / (to - from)).clamp(0.0, 1.0);
    share * share * (3.0 - 2.0 * share)
}

/// [`smooth_step`] in lanes.
#[inline(always)]
fn smooth_steps<S: Simd>([from, to]: [f32; 2], x: f32x8<S>) -> f32x8<S> {
    let share = ((x - from) * (1.0 / (to - from))).max(0.0).min(1.0);
    share * share * (f32x8::splat(x.token(), 3.0) - share * 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::dispatch;
    use headbox_core::simd;
    use headbox_trace::sampler::{random4, unit_float};

    /// A window of one sample: sums, support, and its standard deviation, metres.
    type TestWindow = (Sums, f32, f32);

    const EXPECTED: f32 = 0.3;

    /// Five random windows of a sample, from narrow to wide; some are empty.
    fn random_windows(seed: u32) -> Vec<TestWindow> {
        let window = |number: u32| {
            let [a, b, c, d] = random4([seed, number, 5, 6]).map(unit_float);
            let samples = if a < 0.1 { 0.0 } else { 0.02 + 2.0 * b };
            let light = samples * (0.5 + 0.3 * c) * if d < 0.2 { 0.2 } else { 1.0 };
            let share = if d > 0.9 { 0.01 } else { c };
            let sums = [
                light,
                0.9 * light,
                1.1 * light,
                samples,
                light * light + 0.2 * samples,
                samples * d * d,
                share,
                0.0,
            ];
            (
                sums,
                30.0 * 4f32.powi(number as i32),
                0.02 * 2f32.powi(number as i32),
            )
        };
        (0..5).map(window).collect()
    }

    /// [`WindowChoice`] of one sample in f64: light, variance, samples, support.
    fn oracle(windows: &[TestWindow]) -> [f64; 6] {
        struct Statistics {
            light: [f64; 3],
            level: f64,
            variance: f64,
            nearness: f64,
            samples: f64,
            support: f64,
        }
        let statistics = |(sums, support, _): &TestWindow| {
            let [r, g, b, samples, squares, nearness, share, _] = sums.map(f64::from);
            let support = f64::from(*support);
            let light = [r, g, b].map(|c| c / samples.max(1e-20));
            let level: f64 = light
                .iter()
                .zip(LUMINANCE)
                .map(|(c, weight)| c * f64::from(weight))
                .sum();
            let variance = (squares / samples.max(1e-20) - level * level).max(0.0);
            let nearness = nearness / samples.max(1e-20);
            let all = samples * support;
            let few = f64::from(FEW_SAMPLES);
            let variance = (variance * all + f64::from(EXPECTED) * few) / (all + few);
            Statistics {
                light,
                level,
                variance,
                nearness,
                samples: all,
                support: share * support,
            }
        };
        let step = |[from, to]: [f32; 2], x: f64| {
            let share = ((x - f64::from(from)) / f64::from(to - from)).clamp(0.0, 1.0);
            share * share * (3.0 - 2.0 * share)
        };
        let mut last = statistics(&windows[0]);
        let mut weight = 1.0;
        let mut all = [
            last.light[0],
            last.light[1],
            last.light[2],
            last.variance,
            last.samples,
            last.support,
        ];
        for window in &windows[1..] {
            let wide = statistics(window);
            if weight <= 0.0 || 2.0 * wide.support <= last.support {
                break;
            }
            let variance = wide.variance.max(last.variance);
            let error2 = variance / last.samples.max(1e-3) + 1e-8 * last.level * last.level;
            let difference = (wide.level - last.level).abs() / error2.sqrt();
            let trusted = step(TRUSTED_SAMPLES, last.samples);
            let confidence = step(MANY, last.samples).max(trusted * step(STRIKING, difference));
            weight *= 1.0 - confidence * step(TOLERANCE, difference);
            let trusted = trusted
                * step(
                    TRUSTED_RATIO,
                    last.samples * wide.level * wide.level / variance,
                );
            let bias = last.level * (f64::from(window.2) * wide.nearness).powi(2);
            weight *= 1.0 - trusted * bias * bias / (bias * bias + error2);
            let mut shares = [weight; 6];
            shares[3] = weight.max(1.0 - trusted);
            let [r, g, b] = wide.light;
            for ((all, wide), share) in all
                .iter_mut()
                .zip([r, g, b, wide.variance, wide.samples, wide.support])
                .zip(shares)
            {
                *all += (wide - *all) * share;
            }
            last = wide;
        }
        all
    }

    #[inline(always)]
    fn choose<S: Simd>(simd: S, windows: &[Vec<TestWindow>; LANES]) -> [PooledLight; LANES] {
        let mut choice = WindowChoice::none(simd);
        for number in 0..windows[0].len() {
            let mut sums = SumLanes::default();
            (0..LANES).for_each(|lane| sums.set(lane, &windows[lane][number].0));
            let (_, support, radius_m) = windows[0][number];
            let window = Window::new(
                simd,
                &sums,
                f32x8::splat(simd, support),
                f32x8::splat(simd, EXPECTED),
            );
            choice.take(&window, f32x8::splat(simd, radius_m));
        }
        choice.pooled()
    }

    #[test]
    fn window_choice_in_lanes_equals_the_oracle() {
        for first in (0..4000).step_by(LANES) {
            let windows: [Vec<TestWindow>; LANES] =
                std::array::from_fn(|lane| random_windows(first + lane as u32));
            let mut first_level = None;
            for level in simd::levels() {
                let pooled = dispatch!(level, simd => choose(simd, &windows));
                assert_eq!(pooled, *first_level.get_or_insert(pooled), "{level:?}");
            }
            for (windows, pooled) in windows.iter().zip(first_level.expect("there are levels")) {
                let [r, g, b] = pooled.light.to_array();
                let values =
                    [r, g, b, pooled.variance, pooled.samples, pooled.support].map(f64::from);
                for (value, expected) in values.iter().zip(oracle(windows)) {
                    // Variances are differences of squares of about 1 in f32, and decide by how
                    // much wider windows count.
                    let tolerance = 2e-6 + 2e-4 * expected.abs();
                    assert!(
                        (value - expected).abs() <= tolerance,
                        "{value} for {expected}: {windows:?}"
                    );
                }
            }
        }
    }
}
