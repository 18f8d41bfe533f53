//! What was found over windows of one part, and which of them its light comes from.

use super::{Gathered, Pooled};
use crate::capture::light::luminance;
use glam::Vec3;

/// Means over the pixels of a window: of light, samples, squared luminances, nearness; the share of the window that the surface fills;
/// and nothing, so that they fill whole registers.
pub(super) type Sums = [f32; 8];

/// Which of [`Sums`] is the number of samples.
pub(super) const SAMPLES: usize = 3;

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

/// A window of this share of the harmonic mean distance is biased by a hundredth of its light, about.
const NEAR: f32 = 0.1;

/// The window of a part alone.
pub(super) fn sums_of(gathered: &Gathered) -> Sums {
    let [r, g, b] = gathered.light.to_array();
    [r, g, b, gathered.samples, gathered.squares, gathered.nearness, 1.0, 0.0]
}

/// What was found over one window.
#[derive(Clone, Copy)]
pub(super) struct Window {
    light: Vec3,
    level: f32,
    variance: f32,
    /// 1/m.
    nearness: f32,
    samples: f32,
    /// Parts over which the mean is as good as that over all of a box.
    pub(super) parts: f32,
}

impl Window {
    /// Of means over a window of so many parts, on a surface where samples vary by so much.
    pub(super) fn new(&[r, g, b, samples, squares, nearness, share, _]: &Sums, parts: f32, expected: f32) -> Self {
        let per_sample = 1.0 / samples.max(1e-20);
        let light = Vec3::new(r, g, b) * per_sample;
        let level = luminance(light.to_array());
        let variance = (squares * per_sample - level * level).max(0.0);
        let (samples, parts) = (samples * parts, share * parts);
        // Few samples may have missed what is rare and bright.
        let variance = (variance * samples + expected * FEW_SAMPLES) / (samples + FEW_SAMPLES);
        Self { light, level, variance, nearness: nearness * per_sample, samples, parts }
    }

    /// Squared standard error of its mean if a sample has this variance.
    fn error2(&self, variance: f32) -> f32 {
        variance / self.samples.max(1e-3)
    }
}

/// The window chosen so far.
pub(super) struct Chosen {
    pub(super) pooled: Pooled,
    /// The last window that was looked at.
    last: Window,
    /// 1 as long as wider windows may count.
    open: f32,
}

impl Chosen {
    pub(super) fn first(window: Window) -> Self {
        let Window { light, variance, samples, parts, .. } = window;
        let pooled = Pooled { light, variance, samples, parts };
        Self { pooled, last: window, open: 1.0 }
    }

    /// True if light comes from so near that a window with a standard deviation of `radius_m` would be biased.
    pub(super) fn is_near(&self, radius_m: f32) -> bool {
        radius_m * self.last.nearness > NEAR
    }

    /// True if a wider window may still count, which has not left out most of the surface as too small to follow.
    pub(super) fn may_take(&self, wide: &Window) -> bool {
        self.open > 0.0 && 2.0 * wide.parts > self.last.parts
    }

    /// Looks at a wider window with a standard deviation of `radius_m`.
    pub(super) fn widen(&mut self, wide: &Window, radius_m: f32) {
        // The narrower window may have missed what is rare and bright, or it is all that it has met.
        let variance = wide.variance.max(self.last.variance);
        let error2 = self.last.error2(variance) + 1e-8 * self.last.level * self.last.level;
        let apart = (wide.level - self.last.level).abs() / error2.sqrt().max(1e-20);
        let samples = self.last.samples;
        let told = samples * wide.level.powi(2) / variance.max(1e-20);
        let trusted = smooth_step(TRUSTED_SAMPLES, samples);
        let judges = smooth_step(MANY, samples).max(trusted * smooth_step(STRIKING, apart));
        self.open *= 1.0 - judges * smooth_step(TOLERANCE, apart);
        let trusted = trusted * smooth_step(TOLD, told);
        let bias = CURVATURE * self.last.level * (radius_m * wide.nearness).powi(2);
        self.open *= 1.0 - trusted * bias * bias / (bias * bias + error2);
        let pooled = &mut self.pooled;
        let toward = |from: f32, to: f32| from + (to - from) * self.open;
        pooled.light += (wide.light - pooled.light) * self.open;
        pooled.variance += (wide.variance - pooled.variance) * self.open.max(1.0 - trusted);
        pooled.samples = toward(pooled.samples, wide.samples);
        pooled.parts = toward(pooled.parts, wide.parts);
        self.last = *wide;
    }
}

#[inline]
pub(super) fn smooth_step([from, to]: [f32; 2], x: f32) -> f32 {
    // One over a difference of constants is one, too.
    let share = ((x - from) * (1.0 / (to - from))).clamp(0.0, 1.0);
    share * share * (3.0 - 2.0 * share)
}
