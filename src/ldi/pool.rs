//! Soft light pooled over a surface: neighbouring depth pixels of one plane share their light samples.
//!
//! Light from the sky, from lamps and from bounces varies slowly over a surface but is noisy per sample; a few samples a
//! depth pixel leave it grainy. A depth pixel therefore averages the soft light of its neighbours on the face, but only
//! of those on the same surface: same kind ([`super::accumulate::Accumulator::class`]: material, side, octant) and same
//! plane. Sunlight, whose shadows have edges, and albedo are never pooled.

use super::shade::LitPart;
use crate::capture::light::luminance;
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
    fn range(&self, x: u32, y: u32) -> Range<usize> {
        let p = y as usize * self.size_px as usize + x as usize;
        self.offsets[p] as usize..self.offsets[p + 1] as usize
    }
}

/// Radius in pixels at which a part with `samples` light samples pools about [`POOLED_SAMPLES`].
fn radius_for(samples: u32) -> u32 {
    let pixels = POOLED_SAMPLES.checked_div(samples).unwrap_or(0);
    (pixels.isqrt().saturating_sub(1) / 2).min(MAX_RADIUS_PX)
}

/// Soft light of one depth pixel rests on about so many samples.
const POOLED_SAMPLES: u32 = 1024;

/// The narrower window's radius, at most.
const MAX_RADIUS_PX: u32 = 6;

/// The wider window's radius, in radii of the narrower one.
const WIDER: u32 = 2;

/// Share of the wider window that a surface fills at least if its light is pooled by rows and columns, and over the wider window.
/// Of smaller ones (leaves) rows and columns find too little.
const LARGE_SHARE: f32 = 0.6;

/// Share of the wider window that a surface fills at least if one sample there is as good as `WIDER` squared in the narrower one.
const ENOUGH_SHARE: f32 = 0.5;

/// The wider window's mean counts in full where it differs from the narrower one's by less than the first of these standard
/// errors, and not at all where it differs by more than the second.
const TOLERANCE: [f32; 2] = [2.0, 6.0];

/// How the soft light of a face is pooled: over a window, and over a wider one where the two agree within their noise, which is
/// where light changes slowly (Katkovnik 1999, "A new method for varying adaptive bandwidth selection": intersecting confidence
/// intervals).
pub(super) struct Pooling {
    radius: u32,
    surfaces: Vec<Surface>,
    /// Share of the wider window that each part's surface fills.
    shares: Vec<f32>,
}

/// Sums over a window, weighted by samples and a tent: light, weight, squared luminance; and parts, weighted by the tent alone.
type Sums = [f32; 6];

impl Pooling {
    /// For parts which take at most `samples` light samples.
    pub(super) fn new(parts: &FaceParts, samples: u32) -> Self {
        let radius = radius_for(samples);
        let surfaces: Vec<Surface> = parts.parts.par_iter().map(Surface::of).collect();
        let full = ((WIDER * radius + 1) as f32).powi(4);
        let ones = vec![[1.0; 1]; surfaces.len()];
        let shares = both_passes(parts, &surfaces, &ones, WIDER * radius).into_iter().map(|[sum]| sum / full).collect();
        Self { radius, surfaces, shares }
    }

    /// How many samples each part takes: as many as make up for what its surface lacks of the wider window, a power of two.
    pub(super) fn samples(&self, samples: u32) -> Vec<u16> {
        let most = samples.min(32_768);
        let wanted = |share: &f32| {
            let wanted = samples as f32 * ENOUGH_SHARE / ((WIDER * WIDER) as f32 * share);
            (wanted.min(most as f32).ceil() as u32).next_power_of_two().min(most) as u16
        };
        self.shares.par_iter().map(wanted).collect()
    }

    /// Replaces the soft light of each part by its mean over its window.
    pub(super) fn pool(&self, parts: &mut FaceParts) {
        if self.radius == 0 {
            return;
        }
        let own = |part: &LitPart| -> Sums {
            let weight = f32::from(part.light_samples);
            let [r, g, b] = (part.soft * weight).to_array();
            let level = luminance(part.soft.to_array());
            [r, g, b, weight, level * level * weight, 1.0]
        };
        let own: Vec<Sums> = parts.parts.par_iter().map(own).collect();
        let narrow = both_passes(parts, &self.surfaces, &own, self.radius);
        let wide = both_passes(parts, &self.surfaces, &own, WIDER * self.radius);
        let this = &*parts;
        let size = this.size_px;
        let row = |y: u32| {
            let mut pooled = Vec::new();
            for x in 0..size {
                for p in this.range(x, y) {
                    pooled.push(match self.shares[p] >= LARGE_SHARE {
                        true => self.blend(&narrow[p], &wide[p]),
                        false => self.whole_window(this, p, x, y),
                    });
                }
            }
            pooled
        };
        let rows: Vec<Vec<Vec3>> = (0..size).into_par_iter().map(row).collect();
        parts.parts.iter_mut().zip(rows.into_iter().flatten()).for_each(|(part, soft)| part.soft = soft);
    }

    /// The wider window's mean as far as the narrower one's does not speak against it.
    fn blend(&self, narrow: &Sums, wide: &Sums) -> Vec3 {
        let mean = |sums: &Sums| Vec3::new(sums[0], sums[1], sums[2]) / sums[3];
        let [fine, coarse] = [mean(narrow), mean(wide)];
        let level = luminance(fine.to_array());
        let variance = (narrow[4] / narrow[3] - level * level).max(0.0);
        // A tent averages noise as a box of 3/2 of its width does.
        let pixels = 2.25 * narrow[5] / ((self.radius + 1) as f32).powi(2);
        let error = (variance / pixels.max(1.0)).sqrt().max(1e-6 * level);
        let apart = (luminance(coarse.to_array()) - level).abs() / error.max(1e-20);
        let against = ((apart - TOLERANCE[0]) / (TOLERANCE[1] - TOLERANCE[0])).clamp(0.0, 1.0);
        coarse + (fine - coarse) * (against * against * (3.0 - 2.0 * against))
    }

    /// The mean over all of the narrower window, on whatever way it is connected.
    fn whole_window(&self, parts: &FaceParts, part: usize, x: u32, y: u32) -> Vec3 {
        let window = |c: u32| c.saturating_sub(self.radius)..(c + self.radius + 1).min(parts.size_px);
        let tent = |a: u32, b: u32| (self.radius + 1 - a.abs_diff(b)) as f32;
        let (here, mut sum, mut total) = (self.surfaces[part], Vec3::ZERO, 0.0);
        for ny in window(y) {
            for nx in window(x) {
                for other in parts.range(nx, ny).filter(|&other| here.is_same(&self.surfaces[other])) {
                    let other = &parts.parts[other];
                    let weight = tent(x, nx) * tent(y, ny) * f32::from(other.light_samples);
                    sum += other.soft * weight;
                    total += weight;
                }
            }
        }
        if total > 0.0 { sum / total } else { parts.parts[part].soft }
    }
}

/// Weighted sums over the square windows about all parts, first along rows and then along columns. On a surface without gaps they
/// are those over the whole window.
fn both_passes<const N: usize>(
    parts: &FaceParts,
    surfaces: &[Surface],
    from: &[[f32; N]],
    radius: u32,
) -> Vec<[f32; N]> {
    let across = pass(parts, surfaces, from, radius, true);
    pass(parts, surfaces, &across, radius, false)
}

fn pass<const N: usize>(
    parts: &FaceParts,
    surfaces: &[Surface],
    from: &[[f32; N]],
    radius: u32,
    across: bool,
) -> Vec<[f32; N]> {
    let size = parts.size_px;
    let row = |y: u32| {
        let mut sums = Vec::new();
        for x in 0..size {
            let at = if across { x } else { y };
            for here in &surfaces[parts.range(x, y)] {
                let mut sum = [0.0; N];
                for near in at.saturating_sub(radius)..(at + radius + 1).min(size) {
                    let weight = (radius + 1 - at.abs_diff(near)) as f32;
                    for other in if across { parts.range(near, y) } else { parts.range(x, near) } {
                        if here.is_same(&surfaces[other]) {
                            for (sum, from) in sum.iter_mut().zip(&from[other]) {
                                *sum += from * weight;
                            }
                        }
                    }
                }
                sums.push(sum);
            }
        }
        sums
    };
    let rows: Vec<Vec<[f32; N]>> = (0..size).into_par_iter().map(row).collect();
    rows.concat()
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
}

/// True if two parts lie on one plane of one kind of surface: normals within 4 degrees, planes no farther apart than a
/// thousandth of their distance from the centre.
pub(super) fn same_surface(a: &LitPart, b: &LitPart) -> bool {
    Surface::of(a).is_same(&Surface::of(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::sampler::RayKey;
    use crate::ldi::EncodedNormal;

    fn part(class: u16, plane_distance: f32, soft: f32) -> LitPart {
        LitPart {
            key: RayKey(0),
            count: 1,
            area: 1.0,
            bin: 0,
            class,
            position: 0.0,
            light_samples: 8,
            albedo: [0; 3],
            primitive: 0,
            barycentric: [0; 2],
            emission: Vec3::ZERO,
            sun: Vec3::ZERO,
            soft: Vec3::splat(soft),
            normal: EncodedNormal::new(Vec3::Z),
            plane_normal: Vec3::Z,
            plane_distance,
        }
    }

    #[test]
    fn light_is_shared_on_a_surface_and_never_across() {
        // A row of four pixels, each with two surfaces: a wall whose light alternates, and others that must not mix.
        let wall = |i: u16| part(1, 5.0, f32::from(i % 2));
        let other = |i: u16| part(2 + i, 5.0, 7.0);
        let step = |i: u16| part(1, 5.1 + 0.1 * f32::from(i), 9.0);
        let mut parts: Vec<LitPart> = (0..4).flat_map(|i| [wall(i), other(i), step(i)]).collect();
        parts.extend((4..16).flat_map(|i| [wall(i), other(i), step(i)]));
        let mut face = FaceParts { size_px: 4, offsets: (0..=16).map(|p| 3 * p).collect(), parts };
        let pooling = Pooling { radius: 1, ..Pooling::new(&face, 8) };
        pooling.pool(&mut face);
        for pixel in face.parts.chunks(3) {
            assert!((pixel[0].soft.x - 0.5).abs() < 0.17, "the alternation is averaged: {}", pixel[0].soft.x);
            assert_eq!((pixel[1].soft.x, pixel[2].soft.x), (7.0, 9.0));
        }
    }

    #[test]
    fn small_surfaces_take_more_samples_than_large_ones() {
        const SIZE: u32 = 64;
        // A wall on the left, and on the right pixels that have nothing to do with each other.
        let part_at = |p: u32| if p % SIZE < 40 { part(1, 5.0, 1.0) } else { part(2 + p as u16, 5.0, 1.0) };
        let parts: Vec<LitPart> = (0..SIZE * SIZE).map(part_at).collect();
        let face = FaceParts { size_px: SIZE, offsets: (0..=SIZE * SIZE).collect(), parts };
        let samples = Pooling::new(&face, 4).samples(4);
        let at = |x: u32, y: u32| samples[(y * SIZE + x) as usize];
        assert_eq!([at(20, 32), at(39, 32), at(0, 0), at(50, 32)], [1, 1, 2, 4], "middle, edge, corner, alone");
    }

    #[test]
    fn a_shadow_on_a_wall_stays_where_it_is() {
        const SIZE: u32 = 64;
        let noise = |p: u32| crate::capture::sampler::unit_float(crate::capture::sampler::random4([p, 1, 2, 3])[0]);
        let level = |p: u32| (if p % SIZE < 32 { 1.0 } else { 0.1 }) * (0.9 + 0.2 * noise(p));
        let parts: Vec<LitPart> = (0..SIZE * SIZE).map(|p| part(1, 5.0, level(p))).collect();
        let mut face = FaceParts { size_px: SIZE, offsets: (0..=SIZE * SIZE).collect(), parts };
        Pooling::new(&face, 4).pool(&mut face);
        let at = |x: u32| face.pixel(x, 32)[0].soft.x;
        for (x, expected) in [(10, 1.0), (24, 1.0), (39, 0.1), (50, 0.1)] {
            // The edge is farther away than the narrower window reaches; the wider one alone errs by 0.08.
            assert!((at(x) - expected).abs() < 0.02, "{} at {x}", at(x));
        }
    }

    #[test]
    fn the_radius_shrinks_as_samples_grow() {
        assert_eq!([0, 1, 8, 16, 64, 2048].map(radius_for), [0, 6, 5, 3, 1, 0]);
    }
}
