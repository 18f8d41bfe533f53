//! Soft light pooled over a surface: neighbouring depth pixels of one plane share their light samples.
//!
//! Light from the sky, from lamps and from bounces varies slowly over a surface but is noisy per sample; eight samples a
//! depth pixel leave it grainy. A depth pixel therefore averages the soft light of its neighbours on the face, but only
//! of those on the same surface: same kind ([`super::accumulate::Accumulator::class`]: material, side, octant) and same
//! plane. Sunlight, whose shadows have edges, and albedo are never pooled.

use super::shade::LitPart;
use glam::Vec3;
use rayon::prelude::*;

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
        let p = y as usize * self.size_px as usize + x as usize;
        &self.parts[self.offsets[p] as usize..self.offsets[p + 1] as usize]
    }

    /// Replaces the soft light of each part by the mean over the square of `2 * radius + 1` pixels about it, weighted by
    /// samples and by a tent.
    pub fn pool_soft_light(&mut self, radius: u32) {
        if radius == 0 {
            return;
        }
        let this = &*self;
        let rows: Vec<Vec<Vec3>> = (0..self.size_px).into_par_iter().map(|y| this.pooled_row(y, radius)).collect();
        self.parts.iter_mut().zip(rows.into_iter().flatten()).for_each(|(part, soft)| part.soft = soft);
    }

    fn pooled_row(&self, y: u32, radius: u32) -> Vec<Vec3> {
        let window = |c: u32| c.saturating_sub(radius)..(c + radius + 1).min(self.size_px);
        let tent = |a: u32, b: u32| (radius + 1 - a.abs_diff(b)) as f32;
        let mut pooled = Vec::new();
        for x in 0..self.size_px {
            for part in self.pixel(x, y) {
                let (mut sum, mut total) = (Vec3::ZERO, 0.0);
                for ny in window(y) {
                    for nx in window(x) {
                        for other in self.pixel(nx, ny).iter().filter(|other| same_surface(part, other)) {
                            let weight = tent(x, nx) * tent(y, ny) * f32::from(other.light_samples);
                            sum += other.soft * weight;
                            total += weight;
                        }
                    }
                }
                pooled.push(if total > 0.0 { sum / total } else { part.soft });
            }
        }
        pooled
    }
}

/// Radius in pixels at which a part with `samples` light samples pools about [`POOLED_SAMPLES`].
pub fn radius_for(samples: u32) -> u32 {
    let pixels = POOLED_SAMPLES.checked_div(samples).unwrap_or(0);
    (pixels.isqrt().saturating_sub(1) / 2).min(MAX_RADIUS_PX)
}

/// Soft light of one depth pixel rests on about so many samples.
const POOLED_SAMPLES: u32 = 1024;

/// Contact shadows narrower than this are blurred, whatever the noise.
const MAX_RADIUS_PX: u32 = 6;

/// True if two parts lie on one plane of one kind of surface: normals within 4 degrees, planes no farther apart than a
/// thousandth of their distance from the centre.
pub(super) fn same_surface(a: &LitPart, b: &LitPart) -> bool {
    const MIN_COS: f32 = 0.9976;
    let apart = (a.plane_distance - b.plane_distance).abs();
    a.class == b.class
        && apart <= 1e-3 * a.plane_distance.abs().max(b.plane_distance.abs())
        && a.plane_normal.dot(b.plane_normal) >= MIN_COS
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
            sharp: Vec3::ZERO,
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
        face.pool_soft_light(1);
        for pixel in face.parts.chunks(3) {
            assert!((pixel[0].soft.x - 0.5).abs() < 0.17, "the alternation is averaged: {}", pixel[0].soft.x);
            assert_eq!((pixel[1].soft.x, pixel[2].soft.x), (7.0, 9.0));
        }
    }

    #[test]
    fn the_radius_shrinks_as_samples_grow() {
        assert_eq!([0, 1, 8, 16, 64, 2048].map(radius_for), [0, 6, 5, 3, 1, 0]);
    }
}
