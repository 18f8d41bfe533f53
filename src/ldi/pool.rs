//! Soft light pooled over a surface: neighbouring depth pixels of one plane share their light samples.
//!
//! Light from the sky, from lamps and from bounces varies slowly over a surface but is noisy per sample. So it is kept apart from
//! albedo, and each part takes the mean over a window of its surface on the face: parts of the same kind
//! ([`super::accumulate::Accumulator::class`]: material, side, octant) in the same plane, in whatever layer. How wide the window is,
//! is decided part by part, from narrow to wide:
//!
//! * The wider window's mean counts as far as it agrees with the narrower one's within the noise of both (Katkovnik 1999, "A new
//!   method for varying adaptive bandwidth selection": intersecting confidence intervals). Edges of shadows stay.
//! * It counts as far as what irradiance may change over it is less than the noise of the narrower one: by the harmonic mean of
//!   the distances to what light comes from, with which Ward, Rubinstein and Clear (1988, "A ray tracing solution for diffuse
//!   interreflection") bound the gradient of irradiance. Contact shadows stay.
//!
//! Windows are sums over dilated rows and columns, each of twice the width of the one before, as in the a-trous wavelet
//! transform (Dammertz et al. 2010, "Edge-avoiding a-trous wavelet transform for fast global illumination filtering").
//! Sunlight, whose shadows have edges, and albedo are never pooled.

use super::shade::LitPart;
use crate::capture::light::luminance;
use crate::capture::rig::Face;
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// The lit parts of a face, by pixel.
pub struct FaceParts {
    /// Pixels a side.
    pub size_px: u32,
    /// Prefix sums over the pixels in row-major order.
    pub offsets: Vec<u32>,
    /// All parts; of a pixel sorted by bin and class.
    pub parts: Vec<LitPart>,
}

impl FaceParts {
    /// The parts of pixel (x, y).
    pub fn pixel(&self, x: u32, y: u32) -> &[LitPart] {
        &self.parts[self.range(x, y)]
    }

    /// The numbers of the parts of pixel (x, y).
    pub(super) fn range(&self, x: u32, y: u32) -> Range<usize> {
        let p = y as usize * self.size_px as usize + x as usize;
        self.offsets[p] as usize..self.offsets[p + 1] as usize
    }

    /// The pixel of every part.
    fn pixels(&self) -> Vec<[u16; 2]> {
        let mut pixels = Vec::with_capacity(self.parts.len());
        for (y, row) in (0..).zip(self.offsets.windows(self.size_px as usize + 1).step_by(self.size_px as usize)) {
            for (x, run) in (0..).zip(row.windows(2)) {
                pixels.extend(std::iter::repeat_n([x, y], (run[1] - run[0]) as usize));
            }
        }
        pixels
    }
}

/// What the light samples of a part found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Gathered {
    /// Sum of the samples, exposed.
    pub(super) light: Vec3,
    /// Sum of their squared luminances.
    pub(super) squares: f32,
    /// Sum of one over the distance to what each sample's first ray met, 1/m.
    pub(super) nearness: f32,
    /// How many there are.
    pub(super) samples: f32,
}

/// What pooling made of them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Pooled {
    /// Radiosity per albedo.
    pub(super) light: Vec3,
    /// Variance of the luminance of a single sample.
    pub(super) variance: f32,
    /// Samples of the window, about.
    pub(super) samples: f32,
    /// Parts of the window, about: those over which the mean is as good as that over all of a box.
    pub(super) parts: f32,
}

/// The widest window is the result of so many doublings.
const LEVELS: u32 = 7;

/// The narrowest.
const FIRST_LEVEL: u32 = 2;

/// As many samples tell as much of their variance as all of their kind of surface do.
const FEW_SAMPLES: f32 = 32.0;

/// Half of the width of the square in which the light of a small surface is pooled, pixels.
const SMALL_RADIUS: u32 = 6;

/// Share of the window of [`SMALL_LEVEL`] that a surface fills less of if its parts take as many samples as a part alone.
const ENOUGH_SHARE: f32 = 0.125;

/// Share of the window of [`SMALL_LEVEL`] that a surface fills at least if its light is not pooled over that square. Of smaller
/// ones (leaves) rows and columns find too little.
const LARGE_SHARE: f32 = 0.6;
const SMALL_LEVEL: u32 = 4;

/// The wider window's mean counts in full where it differs from the narrower one's by less than the first of these standard
/// errors, and not at all where it differs by more than the second.
const TOLERANCE: [f32; 2] = [1.0, 2.5];

/// A window has a say in that from the first of these numbers of samples on, and all of it from the second.
const TRUSTED_SAMPLES: [f32; 2] = [8.0, 32.0];

/// Irradiance changes over a window by this share of the square of the window's radius over the harmonic mean distance, about.
const CURVATURE: f32 = 1.0;

/// Standard deviation of the window of a level in each direction, pixels: of [1 2 1] / 4, dilated by 1, 2, 4...
fn radius_of(level: u32) -> f32 {
    (((1 << (2 * level)) - 1) as f32 / 6.0).sqrt()
}

/// Parts of the window of a level that count in full, on a surface without gaps: one over the sum of its squared weights.
fn parts_of(level: u32) -> f32 {
    4.0 * std::f32::consts::PI * radius_of(level).powi(2)
}

/// How the soft light of a face is pooled.
pub(super) struct Pooling {
    size_px: u32,
    /// Of each part.
    pixels: Vec<[u16; 2]>,
    surfaces: Vec<Surface>,
    /// Width of the parts' pixels on their surfaces, metres.
    pub(super) widths: Vec<f32>,
    /// Share of the window of [`SMALL_LEVEL`] that each part's surface fills.
    shares: Vec<f32>,
    /// Parts of the widest window about each part.
    pub(super) widest: Vec<f32>,
}

/// Means over a window: of light, samples, squared luminances, nearness; the share of the window that the surface fills; and nothing,
/// so that they fill whole registers.
type Sums = [f32; 8];

impl Pooling {
    pub(super) fn new(parts: &FaceParts, face: Face) -> Self {
        let surfaces: Vec<Surface> = parts.parts.par_iter().map(Surface::of).collect();
        let (size_px, pixels) = (parts.size_px, parts.pixels());
        let width = |(surface, pixel): (&Surface, &[u16; 2])| surface.pixel_width(face, pixel.map(u32::from), size_px);
        let widths = surfaces.par_iter().zip(&pixels).map(width).collect();
        let [shares, widest] = [Vec::new(), Vec::new()];
        let mut pooling = Self { size_px, pixels, surfaces, widths, shares, widest };
        let mut shares = vec![[1.0; 1]; parts.parts.len()];
        for level in 1..=LEVELS {
            shares = pooling.doubled(parts, &shares, level);
            if level == SMALL_LEVEL {
                pooling.shares = shares.iter().map(|[share]| *share).collect();
            }
        }
        pooling.widest = shares.into_iter().map(|[share]| share * parts_of(LEVELS)).collect();
        pooling
    }

    /// How many samples a part takes at most, of so many that one alone takes: as many as make up for what its surface lacks of
    /// the window.
    pub(super) fn most_samples(&self, part: usize, samples: f32) -> f32 {
        (samples * ENOUGH_SHARE / self.shares[part]).clamp(1.0, samples.max(1.0))
    }

    /// The light of each part over its window; roughly on small surfaces unless this is the last time.
    pub(super) fn pool(&self, parts: &FaceParts, gathered: &[Gathered], is_last: bool) -> Vec<Pooled> {
        let sums_of = |g: &Gathered| -> Sums {
            let [r, gr, b] = g.light.to_array();
            [r, gr, b, g.samples, g.squares, g.nearness, 1.0, 0.0]
        };
        let mut sums: Vec<Sums> = gathered.par_iter().map(sums_of).collect();
        let expected = variances(parts, gathered);
        let expected = |p: usize| expected[usize::from(parts.parts[p].class)];
        let mut found: Vec<Chosen> = Vec::new();
        for level in 1..=LEVELS {
            sums = self.doubled(parts, &sums, level);
            if level == FIRST_LEVEL {
                let window = |p: usize| match self.shares[p] >= LARGE_SHARE || !is_last {
                    true => Window::of(&sums[p], level, expected(p)),
                    false => self.small_window(parts, gathered, p, expected(p)),
                };
                found = (0..sums.len()).into_par_iter().map(|p| Chosen::first(window(p))).collect();
            } else if level > FIRST_LEVEL {
                found.par_iter_mut().enumerate().for_each(|(p, chosen)| {
                    chosen.widen(&Window::of(&sums[p], level, expected(p)), radius_of(level) * self.widths[p]);
                });
            }
        }
        found.into_iter().map(|chosen| chosen.pooled).collect()
    }

    /// The square about a part, on whatever way its surface is connected.
    fn small_window(&self, parts: &FaceParts, gathered: &[Gathered], part: usize, expected: f32) -> Window {
        const R: u32 = SMALL_RADIUS;
        let [x, y] = self.pixels[part].map(u32::from);
        let window = |c: u32| c.saturating_sub(R)..(c + R + 1).min(parts.size_px);
        let tent = |a: u32, b: u32| (R + 1 - a.abs_diff(b)) as f32;
        let (here, mut sums) = (self.surfaces[part], Sums::default());
        for ny in window(y) {
            for nx in window(x) {
                for other in parts.range(nx, ny).filter(|&other| here.is_same(&self.surfaces[other])) {
                    let weight = tent(x, nx) * tent(y, ny);
                    let g = &gathered[other];
                    let [r, gr, b] = g.light.to_array();
                    for (sum, value) in sums.iter_mut().zip([r, gr, b, g.samples, g.squares, g.nearness, 1.0]) {
                        *sum += weight * value;
                    }
                }
            }
        }
        // A tent averages noise as a box of 3/2 of its width does.
        let full = ((R + 1) as f32).powi(4);
        Window::new(&sums.map(|sum| sum / full), (1.5 * (R + 1) as f32).powi(2), expected)
    }

    /// The windows of a level from those of the level below it, first along rows and then along columns.
    fn doubled<const N: usize>(&self, parts: &FaceParts, from: &[[f32; N]], level: u32) -> Vec<[f32; N]> {
        let step = 1 << (level - 1);
        let across = self.pass(parts, from, [step, 0]);
        self.pass(parts, &across, [0, step])
    }

    /// Half of what each part's surface has in its own pixel, and a quarter of what it has in those one step away in either
    /// direction.
    fn pass<const N: usize>(&self, parts: &FaceParts, from: &[[f32; N]], [step_x, step_y]: [u32; 2]) -> Vec<[f32; N]> {
        let (size, step) = (self.size_px, (step_y * self.size_px + step_x) as usize);
        let of_part = |p: usize| {
            let (here, [x, y]) = (&self.surfaces[p], self.pixels[p].map(u32::from));
            let pixel = (y * size + x) as usize;
            let mut all = [0.0; N];
            self.add(parts, from, here, (pixel, 0.5), &mut all);
            if x >= step_x && y >= step_y {
                self.add(parts, from, here, (pixel - step, 0.25), &mut all);
            }
            if x + step_x < size && y + step_y < size {
                self.add(parts, from, here, (pixel + step, 0.25), &mut all);
            }
            all
        };
        (0..from.len()).into_par_iter().map(of_part).collect()
    }

    /// Adds what a surface has in a pixel, with a weight. In a pixel that it crosses slantwise it has several parts, of which the
    /// mean counts.
    #[inline]
    fn add<const N: usize>(
        &self,
        parts: &FaceParts,
        from: &[[f32; N]],
        here: &Surface,
        (pixel, weight): (usize, f32),
        all: &mut [f32; N],
    ) {
        let run = parts.offsets[pixel] as usize..parts.offsets[pixel + 1] as usize;
        let (mut sum, mut count) = ([0.0; N], 0.0);
        for (other, values) in self.surfaces[run.clone()].iter().zip(&from[run]) {
            if here.is_same(other) {
                sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
                count += 1.0;
            }
        }
        if count > 0.0 {
            all.iter_mut().zip(sum).for_each(|(all, sum)| *all += sum * (weight / count));
        }
    }
}

/// Variance of the luminance of single samples by class of surface, and of all where there are few of a class.
fn variances(parts: &FaceParts, gathered: &[Gathered]) -> Vec<f32> {
    let mut sums = vec![[0.0f64; 3]; 1 << 16];
    let mut all = [0.0f64; 3];
    for (part, g) in parts.parts.iter().zip(gathered).filter(|(_, g)| g.samples > 0.0) {
        let found = [g.samples, luminance(g.light.to_array()), g.squares].map(f64::from);
        for sums in [&mut sums[usize::from(part.class)], &mut all] {
            sums.iter_mut().zip(found).for_each(|(sum, found)| *sum += found);
        }
    }
    let variance = |[samples, light, squares]: [f64; 3]| {
        let per_sample = 1.0 / samples.max(1e-20);
        (squares * per_sample - (light * per_sample).powi(2)).max(0.0)
    };
    let few = f64::from(FEW_SAMPLES);
    let of_class = |of: &[f64; 3]| ((variance(*of) * of[0] + variance(all) * few) / (of[0] + few)) as f32;
    sums.iter().map(of_class).collect()
}

/// What was found over one window.
#[derive(Clone, Copy)]
struct Window {
    light: Vec3,
    level: f32,
    variance: f32,
    /// 1/m.
    nearness: f32,
    samples: f32,
    parts: f32,
}

impl Window {
    fn of(sums: &Sums, level: u32, expected: f32) -> Self {
        Self::new(sums, parts_of(level), expected)
    }

    /// Of means over a window of so many parts, on a surface where samples vary by so much.
    fn new(&[r, g, b, samples, squares, nearness, share, _]: &Sums, parts: f32, expected: f32) -> Self {
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
struct Chosen {
    pooled: Pooled,
    /// The last window that was looked at.
    last: Window,
    /// 1 as long as wider windows may count.
    open: f32,
}

impl Chosen {
    fn first(window: Window) -> Self {
        let Window { light, variance, samples, parts, .. } = window;
        let pooled = Pooled { light, variance, samples, parts };
        Self { pooled, last: window, open: 1.0 }
    }

    /// Looks at a wider window with a standard deviation of `radius_m`.
    fn widen(&mut self, wide: &Window, radius_m: f32) {
        // The narrower window may have missed what is rare and bright, or it is all that it has met.
        let variance = wide.variance.max(self.last.variance);
        let error2 = self.last.error2(variance) + 1e-8 * self.last.level * self.last.level;
        let apart = (wide.level - self.last.level).abs() / error2.sqrt().max(1e-20);
        let trusted = smooth_step(TRUSTED_SAMPLES, self.last.samples);
        self.open *= 1.0 - trusted * smooth_step(TOLERANCE, apart);
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

fn smooth_step([from, to]: [f32; 2], x: f32) -> f32 {
    let share = ((x - from) / (to - from)).clamp(0.0, 1.0);
    share * share * (3.0 - 2.0 * share)
}

/// What tells a part's surface from others.
#[derive(Clone, Copy)]
struct Surface {
    normal: Vec3,
    distance: f32,
    class: u32,
}

impl Surface {
    fn of(part: &LitPart) -> Self {
        Self { normal: part.plane_normal, distance: part.plane_distance, class: u32::from(part.class) }
    }

    /// See [`same_surface`].
    #[inline]
    fn is_same(&self, other: &Self) -> bool {
        const MIN_COS: f32 = 0.9976;
        let apart = (self.distance - other.distance).abs();
        self.class == other.class
            && apart <= 1e-3 * self.distance.abs().max(other.distance.abs())
            && self.normal.dot(other.normal) >= MIN_COS
    }

    /// Width of a pixel on the surface where it is widest, metres; infinite for what is edge-on.
    fn pixel_width(&self, face: Face, [x, y]: [u32; 2], size_px: u32) -> f32 {
        let direction = face.direction(f64::from(x) + 0.5, f64::from(y) + 0.5, size_px).as_vec3();
        let facing = self.normal.dot(direction).abs();
        let eye_depth = self.distance.abs() / facing;
        2.0 * eye_depth / size_px as f32 * direction.length() / facing
    }
}

/// True if two parts lie on one plane of one kind of surface: normals within 4 degrees, planes no farther apart than a
/// thousandth of their distance from the centre.
pub(super) fn same_surface(a: &LitPart, b: &LitPart) -> bool {
    Surface::of(a).is_same(&Surface::of(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::sampler::{RayKey, random4, unit_float};
    use crate::ldi::EncodedNormal;

    const SIZE: u32 = 64;

    fn part(class: u16, plane_distance: f32) -> LitPart {
        LitPart {
            key: RayKey(0),
            count: 1,
            area: 1.0,
            bin: 0,
            class,
            position: 0.0,
            albedo: [0; 3],
            primitive: 0,
            barycentric: [0; 2],
            emission: Vec3::ZERO,
            sun: Vec3::ZERO,
            soft: Vec3::ZERO,
            normal: EncodedNormal::new(Vec3::Z),
            plane_normal: Vec3::Z,
            plane_distance,
        }
    }

    /// One sample.
    fn sample(light: f32, nearness: f32) -> Gathered {
        Gathered { light: Vec3::splat(light), squares: light * light, nearness, samples: 1.0 }
    }

    /// Pooled light of a wall 5 m away, of which each part has a sample of `light` within a share of `noise`: the mean of each column.
    fn wall(noise: f32, light: impl Fn(u32) -> f32, nearness: impl Fn(u32) -> f32) -> Vec<f32> {
        let factor = |p: u32| 1.0 + noise * (2.0 * unit_float(random4([p, 1, 2, 3])[0]) - 1.0);
        let gathered: Vec<Gathered> =
            (0..SIZE * SIZE).map(|p| sample(light(p % SIZE) * factor(p), nearness(p % SIZE))).collect();
        let parts = vec![part(1, 5.0); gathered.len()];
        let face = FaceParts { size_px: SIZE, offsets: (0..=SIZE * SIZE).collect(), parts };
        let pooled = Pooling::new(&face, Face::NegZ).pool(&face, &gathered, true);
        let column = |x: u32| (0..SIZE).map(|y| pooled[face.range(x, y).start].light.x).sum::<f32>() / SIZE as f32;
        (0..SIZE).map(column).collect()
    }

    #[test]
    fn light_is_shared_on_a_surface_and_never_across() {
        // In each pixel two parts of a wall whose light alternates, a part of nothing else, and a step in front of the wall.
        let of_pixel = |p: u32| {
            let step = (part(1, 5.1 + 0.1 * p as f32), sample(9.0, 0.0));
            let wall = |light: u32| (part(1, 5.0), sample(light as f32, 0.0));
            [wall((p ^ (p / SIZE)) % 2), wall((p ^ (p / SIZE)) % 2), (part(2 + p as u16, 5.0), sample(7.0, 0.0)), step]
        };
        let (parts, gathered): (Vec<LitPart>, Vec<Gathered>) = (0..SIZE * SIZE).flat_map(of_pixel).unzip();
        let face = FaceParts { size_px: SIZE, offsets: (0..=SIZE * SIZE).map(|p| 4 * p).collect(), parts };
        for pixel in Pooling::new(&face, Face::NegZ).pool(&face, &gathered, true).chunks(4) {
            let [a, b, other, step] = [0, 1, 2, 3].map(|i| pixel[i].light.x);
            assert!((a - 0.5).abs() < 0.05 && (b - 0.5).abs() < 0.05, "the alternation is averaged: {a} {b}");
            // Rounding of sums and quotients of up to a hundred terms.
            assert!((other - 7.0).abs() < 1e-4 && (step - 9.0).abs() < 1e-4, "{other} {step}");
        }
    }

    #[test]
    fn the_edge_of_a_shadow_stays_where_it_is() {
        let light = |x: u32| if x < 32 { 1.0 } else { 0.1 };
        let found = wall(0.1, light, |_| 0.0);
        for x in (0..27).chain(37..SIZE) {
            // The widest window alone errs by 0.4 here.
            assert!((found[x as usize] - light(x)).abs() < 0.05, "{} at {x}", found[x as usize]);
        }
    }

    #[test]
    fn a_contact_shadow_stays_in_noise_that_hides_it() {
        // Light beside something that stands on the wall: its distance is that to the wall's left edge.
        let distance_m = |x: u32| (x as f32 + 0.5) * 10.0 / SIZE as f32;
        let light = |x: u32| distance_m(x) / (distance_m(x) + 0.5);
        let bias = |found: Vec<f32>| (2..SIZE).map(|x| (found[x as usize] - light(x)).abs()).fold(0.0, f32::max);
        let (with, without) = (bias(wall(1.0, light, |x| 1.0 / distance_m(x))), bias(wall(1.0, light, |_| 0.0)));
        assert!(with < 0.1 && with < 0.8 * without, "{with}, and {without} without distances");
    }

    #[test]
    fn walls_are_pooled_far() {
        let found = wall(0.1, |_| 1.0, |_| 0.01);
        let error = (found.iter().map(|light| (light - 1.0).powi(2)).sum::<f32>() / SIZE as f32).sqrt();
        // Of single samples 0.058, and of 700 of them 0.002.
        assert!(error < 0.004, "{error}");
    }
}
