//! What was found over windows of some parts side by side, and which of them the light of each comes from.

use super::{Gathered, Pooled};
use fearless_simd::{Simd, f32x8, mask32x8, prelude::*};
use glam::Vec3;
use headbox_core::color::LUMINANCE;

/// Parts that are pooled side by side.
pub(super) const LANES: usize = 8;

/// Means over the pixels of a window: of light, samples, squared luminances, nearness; the share of the window that the surface fills;
/// and nothing, so that they fill whole registers.
pub(super) type Sums = [f32; 8];

/// Which of [`Sums`] is the number of samples.
pub(super) const SAMPLES: usize = 3;

const SQUARES: usize = 4;

/// Which of [`Sums`] is that of the samples' nearness.
pub(super) const NEARNESS: usize = 5;

/// Which of [`Sums`] is the share of the window that the surface fills.
pub(super) const SHARE: usize = 6;

/// As many samples tell as much of their variance as all of their kind of surface do.
pub(super) const FEW_SAMPLES: f32 = 32.0;

/// The wider window's mean counts in full where it differs from the narrower one's by less than the first of these standard
/// errors, and not at all where it differs by more than the second.
const TOLERANCE: [f32; 2] = [1.0, 2.5];

/// A window has a say in that from the first of these numbers of samples on, and all of it from the second: means
/// of fewer are off by some standard errors wherever one has met something small and bright.
const MANY: [f32; 2] = [64.0, 256.0];

/// Fewer samples have a say where they differ by more than the first of these standard errors, and all of it from the second on: at
/// the edge of a shadow.
const STRIKING: [f32; 2] = [2.5, 5.0];

/// A window's nearness and light count from the first of these numbers of samples on, and in full from the second...
const TRUSTED_SAMPLES: [f32; 2] = [8.0, 32.0];

/// ...and likewise by the squared ratio of its light to its standard error.
const TOLD: [f32; 2] = [4.0, 16.0];

/// Irradiance changes over a window by this share of the square of the window's radius over the harmonic mean distance, about.
const CURVATURE: f32 = 1.0;

/// Windows of more than so many harmonic mean distances are none better or worse than of these; the fourth power of it is a number.
const FARTHEST_REACH: f32 = 1e4;

/// A window of this share of the harmonic mean distance is biased by a hundredth of its light, about.
const NEAR: f32 = 0.1;

/// Parts that count in full of a Gaussian window of a standard deviation of so many pixels, on a surface without gaps: one over the sum of
/// its squared weights.
pub(super) fn parts_within(radius_px: f32) -> f32 {
    4.0 * std::f32::consts::PI * radius_px * radius_px
}

/// The window of a part alone.
pub(super) fn sums_of(gathered: &Gathered) -> Sums {
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

/// [`Sums`] of parts side by side, `[sum][part]`.
#[derive(Clone, Copy, Default)]
pub(super) struct Beside([[f32; LANES]; 8]);

impl Beside {
    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, sums: &Sums) {
        for (all, &sum) in self.0.iter_mut().zip(sums) {
            all[lane] = sum;
        }
    }

    #[inline(always)]
    pub(super) fn of<S: Simd>(&self, simd: S, sum: usize) -> f32x8<S> {
        f32x8::load_array(simd, self.0[sum])
    }
}

/// What was found over one window of each part.
#[derive(Clone, Copy)]
pub(super) struct Window<S: Simd> {
    light: [f32x8<S>; 3],
    level: f32x8<S>,
    variance: f32x8<S>,
    /// 1/m.
    nearness: f32x8<S>,
    samples: f32x8<S>,
    /// Parts over which the mean is as good as that over all of a box.
    parts: f32x8<S>,
}

impl<S: Simd> Window<S> {
    /// Of means over windows of so many parts, on surfaces where samples vary by so much.
    #[inline(always)]
    pub(super) fn new(simd: S, sums: &Beside, parts: f32x8<S>, expected: f32x8<S>) -> Self {
        let samples = sums.of(simd, SAMPLES);
        let per_sample = f32x8::splat(simd, 1.0) / samples.max(1e-20);
        let (red, green) = (sums.of(simd, 0) * per_sample, sums.of(simd, 1) * per_sample);
        let blue = sums.of(simd, 2) * per_sample;
        let level = red * LUMINANCE[0] + green * LUMINANCE[1] + blue * LUMINANCE[2];
        let variance = (sums.of(simd, SQUARES) * per_sample - level * level).max(0.0);
        let (samples, parts) = (samples * parts, sums.of(simd, SHARE) * parts);
        // Few samples may have missed what is rare and bright.
        let variance = (variance * samples + expected * FEW_SAMPLES) / (samples + FEW_SAMPLES);
        let nearness = sums.of(simd, NEARNESS) * per_sample;
        Self {
            light: [red, green, blue],
            level,
            variance,
            nearness,
            samples,
            parts,
        }
    }

    /// These, and where a mask says so, `others`.
    #[inline(always)]
    fn or(&self, others: &Self, where_: mask32x8<S>) -> Self {
        let [a, b] = [self, others];
        Self {
            light: [
                where_.select(b.light[0], a.light[0]),
                where_.select(b.light[1], a.light[1]),
                where_.select(b.light[2], a.light[2]),
            ],
            level: where_.select(b.level, a.level),
            variance: where_.select(b.variance, a.variance),
            nearness: where_.select(b.nearness, a.nearness),
            samples: where_.select(b.samples, a.samples),
            parts: where_.select(b.parts, a.parts),
        }
    }
}

/// The windows chosen so far.
pub(super) struct Chosen<S: Simd> {
    /// What is known by them; its level and nearness mean nothing.
    pooled: Window<S>,
    /// The last windows that were looked at.
    last: Window<S>,
    /// 1 as long as wider windows may count.
    open: f32x8<S>,
    /// Of which parts a window was chosen.
    begun: mask32x8<S>,
}

impl<S: Simd> Chosen<S> {
    /// These, for the parts for which a mask says so.
    #[inline(always)]
    pub(super) fn first(window: Window<S>, begun: mask32x8<S>) -> Self {
        Self {
            pooled: window,
            last: window,
            open: f32x8::splat(window.level.token(), 1.0),
            begun,
        }
    }

    /// Of no part yet.
    #[inline(always)]
    pub(super) fn none(simd: S) -> Self {
        let nothing = f32x8::splat(simd, 0.0);
        Self::first(
            Window::new(simd, &Beside::default(), nothing, nothing),
            mask32x8::from_bitmask(simd, 0),
        )
    }

    /// Of which parts light comes from so near that a window with a standard deviation of `radius_m` would be biased.
    #[inline(always)]
    pub(super) fn is_near(&self, radius_m: f32x8<S>) -> mask32x8<S> {
        (radius_m * self.last.nearness).simd_gt(NEAR) & self.begun
    }

    /// Goes on to wider windows with a standard deviation of `radius_m`, where they may still count: not where they have left out most
    /// of the surface as too small to follow. Parts without a window begin with these.
    #[inline(always)]
    pub(super) fn take(&mut self, wide: &Window<S>, radius_m: f32x8<S>) {
        let may_count =
            (wide.parts * 2.0).simd_gt(self.last.parts) & self.open.simd_gt(0.0) & self.begun;
        let begins = !self.begun;
        self.widen(wide, radius_m, may_count);
        self.pooled = self.pooled.or(wide, begins);
        self.last = self.last.or(wide, begins);
        self.open = (may_count | begins).select(self.open, f32x8::splat(radius_m.token(), 0.0));
        self.begun |= begins;
    }

    /// Whether any part may go on.
    #[inline(always)]
    pub(super) fn is_open(&self) -> bool {
        self.open.simd_gt(0.0).any_true()
    }

    /// Looks at wider windows with a standard deviation of `radius_m` where a mask says so.
    #[inline(always)]
    pub(super) fn widen(&mut self, wide: &Window<S>, radius_m: f32x8<S>, where_: mask32x8<S>) {
        let (last, one) = (self.last, f32x8::splat(radius_m.token(), 1.0));
        // The narrower window may have missed what is rare and bright, or it is all that it has met.
        let variance = wide.variance.max(last.variance);
        let error2 = variance / last.samples.max(1e-3) + last.level * last.level * 1e-8;
        let apart = (wide.level - last.level).abs() / error2.sqrt().max(1e-20);
        let told = last.samples * wide.level * wide.level / variance.max(1e-20);
        let trusted = smooth_steps(TRUSTED_SAMPLES, last.samples);
        let judges = smooth_steps(MANY, last.samples).max(trusted * smooth_steps(STRIKING, apart));
        let agrees = one - judges * smooth_steps(TOLERANCE, apart);
        let trusted = trusted * smooth_steps(TOLD, told);
        let reach = (radius_m * wide.nearness).min(FARTHEST_REACH);
        let bias = last.level * reach * reach * CURVATURE;
        let bias2 = bias * bias;
        let open = self.open * agrees * (one - trusted * (bias2 / (bias2 + error2).max(1e-30)));
        let from = &self.pooled;
        let widened = Window {
            light: [
                from.light[0] + (wide.light[0] - from.light[0]) * open,
                from.light[1] + (wide.light[1] - from.light[1]) * open,
                from.light[2] + (wide.light[2] - from.light[2]) * open,
            ],
            variance: from.variance + (wide.variance - from.variance) * open.max(one - trusted),
            samples: from.samples + (wide.samples - from.samples) * open,
            parts: from.parts + (wide.parts - from.parts) * open,
            ..*wide
        };
        self.pooled = self.pooled.or(&widened, where_);
        self.last = self.last.or(wide, where_);
        self.open = where_.select(open, self.open);
    }

    #[inline(always)]
    pub(super) fn pooled(&self) -> [Pooled; LANES] {
        let Window {
            light: [red, green, blue],
            variance,
            samples,
            parts,
            ..
        } = &self.pooled;
        let mut pooled = [Pooled::default(); LANES];
        for (i, pooled) in pooled.iter_mut().enumerate() {
            let light = Vec3::new(red[i], green[i], blue[i]);
            *pooled = Pooled {
                light,
                variance: variance[i],
                samples: samples[i],
                parts: parts[i],
            };
        }
        pooled
    }
}

/// From 0 at the first number to 1 at the second.
#[inline]
pub(super) fn smooth_step([from, to]: [f32; 2], x: f32) -> f32 {
    let share = ((x - from) / (to - from)).clamp(0.0, 1.0);
    share * share * (3.0 - 2.0 * share)
}

/// As [`smooth_step`].
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

    /// A window of a part: sums, parts, and its standard deviation, metres.
    type Level = (Sums, f32, f32);

    const EXPECTED: f32 = 0.3;

    /// Some five windows of a part, from narrow to wide; some find nothing.
    fn levels(part: u32) -> Vec<Level> {
        let level = |number: u32| {
            let [a, b, c, d] = random4([part, number, 5, 6]).map(unit_float);
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
        (0..5).map(level).collect()
    }

    /// [`Chosen`] of one part, step by step in f64: light, variance, samples, parts.
    fn oracle(levels: &[Level]) -> [f64; 6] {
        struct Found {
            light: [f64; 3],
            level: f64,
            variance: f64,
            nearness: f64,
            samples: f64,
            parts: f64,
        }
        let found = |(sums, parts, _): &Level| {
            let ([r, g, b, samples, squares, nearness, share, _], parts) =
                (sums.map(f64::from), f64::from(*parts));
            let light = [r, g, b].map(|c| c / samples.max(1e-20));
            let level: f64 = light
                .iter()
                .zip(LUMINANCE)
                .map(|(c, weight)| c * f64::from(weight))
                .sum();
            let variance = (squares / samples.max(1e-20) - level * level).max(0.0);
            let (nearness, all, few) = (
                nearness / samples.max(1e-20),
                samples * parts,
                f64::from(FEW_SAMPLES),
            );
            let variance = (variance * all + f64::from(EXPECTED) * few) / (all + few);
            Found {
                light,
                level,
                variance,
                nearness,
                samples: all,
                parts: share * parts,
            }
        };
        let step = |[from, to]: [f32; 2], x: f64| {
            let share = ((x - f64::from(from)) / f64::from(to - from)).clamp(0.0, 1.0);
            share * share * (3.0 - 2.0 * share)
        };
        let (mut last, mut open) = (found(&levels[0]), 1.0);
        let mut all = [
            last.light[0],
            last.light[1],
            last.light[2],
            last.variance,
            last.samples,
            last.parts,
        ];
        for at in &levels[1..] {
            let wide = found(at);
            if open <= 0.0 || 2.0 * wide.parts <= last.parts {
                break;
            }
            let variance = wide.variance.max(last.variance);
            let error2 = variance / last.samples.max(1e-3) + 1e-8 * last.level * last.level;
            let apart = (wide.level - last.level).abs() / error2.sqrt();
            let trusted = step(TRUSTED_SAMPLES, last.samples);
            let judges = step(MANY, last.samples).max(trusted * step(STRIKING, apart));
            open *= 1.0 - judges * step(TOLERANCE, apart);
            let trusted = trusted * step(TOLD, last.samples * wide.level * wide.level / variance);
            let bias = last.level * (f64::from(at.2) * wide.nearness).powi(2);
            open *= 1.0 - trusted * bias * bias / (bias * bias + error2);
            let shares = [open, open, open, open.max(1.0 - trusted), open, open];
            let [r, g, b] = wide.light;
            for ((all, wide), share) in all
                .iter_mut()
                .zip([r, g, b, wide.variance, wide.samples, wide.parts])
                .zip(shares)
            {
                *all += (wide - *all) * share;
            }
            last = wide;
        }
        all
    }

    #[inline(always)]
    fn chosen<S: Simd>(simd: S, parts: &[Vec<Level>; LANES]) -> [Pooled; LANES] {
        let mut chosen = Chosen::none(simd);
        for number in 0..parts[0].len() {
            let mut sums = Beside::default();
            (0..LANES).for_each(|lane| sums.set(lane, &parts[lane][number].0));
            let (_, count, radius_m) = parts[0][number];
            let window = Window::new(
                simd,
                &sums,
                f32x8::splat(simd, count),
                f32x8::splat(simd, EXPECTED),
            );
            chosen.take(&window, f32x8::splat(simd, radius_m));
        }
        chosen.pooled()
    }

    #[test]
    fn windows_are_chosen_side_by_side_as_one_by_one_at_every_level() {
        for first in (0..4000).step_by(LANES) {
            let parts: [Vec<Level>; LANES] =
                std::array::from_fn(|lane| levels(first + lane as u32));
            let mut of_lowest = None;
            for level in simd::levels() {
                let found = dispatch!(level, simd => chosen(simd, &parts));
                assert_eq!(found, *of_lowest.get_or_insert(found), "{level:?}");
            }
            for (levels, found) in parts.iter().zip(of_lowest.expect("there are levels")) {
                let [r, g, b] = found.light.to_array();
                let found = [r, g, b, found.variance, found.samples, found.parts].map(f64::from);
                for (found, expected) in found.iter().zip(oracle(levels)) {
                    // Variances are differences of squares of about 1 in f32, and decide by how much wider windows count.
                    let tolerance = 2e-6 + 2e-4 * expected.abs();
                    assert!(
                        (found - expected).abs() <= tolerance,
                        "{found} for {expected}: {levels:?}"
                    );
                }
            }
        }
    }
}
