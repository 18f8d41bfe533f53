//! Compositing of the resolved pixels of a canvas over the environment.

use crate::pack::CubeLdi;
use crate::render::canvas::linear::{ALPHA_SHIFT, LinearLight};
use crate::render::setup::plan::FramePlan;
use fearless_simd::{Level, Simd, dispatch, prelude::*, u32x16};
use glam::{DVec3, Vec3};
use headbox_core::camera::Camera;
use headbox_core::environment::Environment;
use headbox_core::frame::Coverage;
use rayon::prelude::*;

/// Rows of pixels of the frame, to be overwritten.
pub struct Pixels<'a> {
    /// From a canvas: straight colour, and the share of 255 that splats cover. In the frame: colour
    /// and alpha, 255.
    pub colors: &'a mut [[u8; 4]],
    /// Source of each pixel.
    pub coverages: &'a mut [Coverage],
    /// Eye depth, m, infinite where there is no splat. Empty if not requested.
    pub depths_m: &'a mut [f32],
    /// 1 / eye depth, 1/m, for hole filling. Empty if not requested.
    pub inverse_depths: &'a mut [f32],
}

impl<'a> Pixels<'a> {
    /// Splits the pixels into rows of `width` pixels.
    pub fn rows(self, width: u32) -> impl Iterator<Item = Pixels<'a>> {
        let width = width as usize;
        let mut depths_m = self.depths_m.chunks_mut(width);
        let mut inverse_depths = self.inverse_depths.chunks_mut(width);
        let rows = self
            .colors
            .chunks_mut(width)
            .zip(self.coverages.chunks_mut(width));
        rows.map(move |(colors, coverages)| Pixels {
            colors,
            coverages,
            depths_m: depths_m.next().unwrap_or_default(),
            inverse_depths: inverse_depths.next().unwrap_or_default(),
        })
    }
}

/// Splits depths into chunks of `size`, or returns `count` empty chunks if there are no depths.
pub fn depth_chunks(
    depths: &mut [f32],
    size: usize,
    count: usize,
) -> impl IndexedParallelIterator<Item = &mut [f32]> {
    let missing = if depths.is_empty() { count } else { 0 };
    depths
        .par_chunks_mut(size)
        .chain((0..missing).into_par_iter().map(|_| Default::default()))
}

/// Background of a frame: the environment, and the hole colour where that is unknown.
pub struct EnvironmentBackground<'a> {
    /// The environment.
    pub environment: &'a Environment,
    /// The frame's camera.
    pub camera: &'a Camera,
    /// Colour of holes, sRGB.
    pub hole_color_srgb: [u8; 3],
    /// SIMD level; all give the same pixels.
    pub level: Level,
}

/// Pixels that are composited at once.
const CHUNK: usize = 16;

impl<'a> EnvironmentBackground<'a> {
    /// Creates the background of a planned frame.
    pub fn new(plan: &FramePlan, cube: &'a CubeLdi, camera: &'a Camera) -> Self {
        Self {
            environment: &cube.environment,
            camera,
            hole_color_srgb: plan.settings.hole_color_srgb,
            level: plan.level,
        }
    }

    /// Composites the resolved pixels of frame row `y` over the background, and returns the number
    /// of holes.
    pub fn composite_row(&self, y: u32, pixels: Pixels) -> u64 {
        let start = self.camera.direction(0.5, f64::from(y) + 0.5);
        let step = self.camera.direction(1.5, f64::from(y) + 0.5) - start;
        dispatch!(self.level, simd => self.composite_chunks(simd, [start, step], pixels))
    }

    /// Composites a row whose view directions are `start + column * step`: [`CHUNK`] pixels at a
    /// time from column 0 on, so that no pixel depends on which others are open.
    #[inline(always)]
    fn composite_chunks<S: Simd>(&self, simd: S, [start, step]: [DVec3; 2], pixels: Pixels) -> u64 {
        let mut holes = 0;
        let Pixels {
            colors,
            coverages,
            depths_m,
            ..
        } = pixels;
        let chunks = colors.chunks_mut(CHUNK).zip(coverages.chunks_mut(CHUNK));
        for (i, (colors, coverages)) in chunks.enumerate() {
            let from = (start + step * (i * CHUNK) as f64).as_vec3();
            if let (Some(colors), Some(coverages)) =
                (colors.first_chunk_mut(), coverages.first_chunk_mut())
            {
                holes += self.composite_chunk(simd, [from, step.as_vec3()], colors, coverages);
                continue;
            }
            // The end of the row, padded with covered pixels.
            let mut padded = [[255; 4]; CHUNK];
            let mut padded_coverages = [Coverage::FULL; CHUNK];
            padded[..colors.len()].copy_from_slice(colors);
            holes += self.composite_chunk(
                simd,
                [from, step.as_vec3()],
                &mut padded,
                &mut padded_coverages,
            );
            colors.copy_from_slice(&padded[..colors.len()]);
            coverages.copy_from_slice(&padded_coverages[..coverages.len()]);
        }
        for (depth_m, coverage) in depths_m.iter_mut().zip(coverages) {
            if coverage.splat_share() == 0 {
                *depth_m = f32::INFINITY;
            }
        }
        holes
    }

    /// Composites pixels whose view directions are `start + i * step`.
    #[inline(always)]
    fn composite_chunk<S: Simd>(
        &self,
        simd: S,
        [start, step]: [Vec3; 2],
        colors: &mut [[u8; 4]; CHUNK],
        coverages: &mut [Coverage; CHUNK],
    ) -> u64 {
        let color = u32x16::load_array(simd, bytemuck::cast(*colors));
        let share = (color >> ALPHA_SHIFT) & 255;
        let open = share.simd_lt(255);
        if !open.any_true() {
            *coverages = [Coverage::FULL; CHUNK];
            return 0;
        }
        let sampled = self
            .environment
            .sample_sixteen(simd, open.to_bitmask(), start, step);
        let sampled = u32x16::load_array(simd, bytemuck::cast(sampled));
        let empty = share.simd_eq(0);
        let known = (sampled >> ALPHA_SHIFT).simd_ne(0);
        let [r, g, b] = self.hole_color_srgb;
        let hole = u32x16::splat(simd, u32::from_ne_bytes([r, g, b, 255]));
        let color = empty.select(
            known.select(sampled, hole),
            color | u32::from_ne_bytes([0, 0, 0, 255]),
        );
        let uncovered = known.select(u32x16::splat(simd, ENVIRONMENT), u32x16::splat(simd, HOLE));
        let covered = share.max(u32::from(Coverage::from_splat_share(0).splat_share()));
        let shares = share.to_array();
        let mut mixed = (open & !empty & known).to_bitmask();
        let sampled = sampled.to_array();
        *colors = bytemuck::cast(color.to_array());
        for (coverage, byte) in coverages
            .iter_mut()
            .zip(empty.select(uncovered, covered).to_array())
        {
            *coverage = Coverage::from_byte(byte as u8);
        }
        while mixed != 0 {
            let i = mixed.trailing_zeros() as usize;
            mixed &= mixed - 1;
            let rgb = |[r, g, b, _]: [u8; 4]| [r, g, b];
            let mixed_colors = [rgb(colors[i]), rgb(sampled[i].to_ne_bytes())];
            let [r, g, b] = LinearLight::tables().mix(mixed_colors, [shares[i], 255 - shares[i]]);
            colors[i] = [r, g, b, 255];
        }
        u64::from((empty & !known).to_bitmask().count_ones())
    }
}

/// Coverage bytes in lanes.
const ENVIRONMENT: u32 = Coverage::ENVIRONMENT.byte() as u32;
const HOLE: u32 = Coverage::HOLE.byte() as u32;

#[cfg(test)]
mod tests {
    //! Composited rows against a scalar reference.

    use super::*;
    use headbox_core::random::Rng;
    use headbox_core::simd;

    /// Tolerated difference of sixteen environment samples at once from single ones, levels:
    /// directions are f32 along a row.
    const LEVELS: u8 = 1;

    #[test]
    fn open_pixels_are_composited_over_environment() {
        let mut random = Rng::keyed(2);
        // Some texels are unknown.
        let texels = (0..6 * 16 * 16).map(|i| {
            if i / 16 % 16 < 3 {
                [0; 4]
            } else {
                [(i % 16 * 12) as u8, 90, 200, 255]
            }
        });
        let environment = Environment {
            size_px: 16,
            texels: texels.collect(),
        };
        let camera = Camera::look_at(
            DVec3::ZERO,
            DVec3::new(1.0, 0.8, 0.2),
            DVec3::Y,
            100.0,
            [37, 20],
        )
        .expect("valid");
        let width = 37;
        let mut mixed = 0;
        let mut all_holes = 0;
        for y in 0..20 {
            let resolved: Vec<[u8; 4]> = (0..width)
                .map(|_| {
                    let share = [0, 255, random.below(256) as u8][random.below(3) as usize];
                    [
                        random.below(256) as u8,
                        random.below(256) as u8,
                        random.below(256) as u8,
                        share,
                    ]
                })
                .collect();
            let mut holes = 0;
            let expected: Vec<([u8; 3], Coverage, bool)> = (0..)
                .zip(&resolved)
                .map(|(x, &[r, g, b, share])| {
                    let sampled = environment.sample(
                        camera
                            .direction(f64::from(x) + 0.5, f64::from(y) + 0.5)
                            .as_vec3(),
                    );
                    let covered = Coverage::from_splat_share(share);
                    match (share, sampled) {
                        (255, _) => ([r, g, b], Coverage::FULL, true),
                        (0, Some(sampled)) => (sampled, Coverage::ENVIRONMENT, false),
                        (0, None) => {
                            holes += 1;
                            ([1, 2, 3], Coverage::HOLE, false)
                        }
                        (_, None) => ([r, g, b], covered, true),
                        (_, Some(sampled)) => {
                            mixed += 1;
                            let shares = [u32::from(share), 255 - u32::from(share)];
                            (
                                LinearLight::tables().mix([[r, g, b], sampled], shares),
                                covered,
                                true,
                            )
                        }
                    }
                })
                .collect();
            for level in simd::levels() {
                let mut colors = resolved.clone();
                let mut depths_m = vec![3.0; width];
                let mut coverages = vec![Coverage::HOLE; width];
                let background = EnvironmentBackground {
                    environment: &environment,
                    camera: &camera,
                    hole_color_srgb: [1, 2, 3],
                    level,
                };
                let pixels = Pixels {
                    colors: &mut colors,
                    coverages: &mut coverages,
                    depths_m: &mut depths_m,
                    inverse_depths: &mut [],
                };
                assert_eq!(background.composite_row(y, pixels), holes);
                for (x, (color, coverage, has_depth)) in expected.iter().enumerate() {
                    assert!(
                        (0..3).all(|c| colors[x][c].abs_diff(color[c]) <= LEVELS),
                        "{x}, {y}: {:?} {color:?}",
                        colors[x]
                    );
                    assert_eq!(
                        (colors[x][3], coverages[x], depths_m[x].is_finite()),
                        (255, *coverage, *has_depth),
                        "{x}, {y}"
                    );
                }
            }
            all_holes += holes;
        }
        assert!(mixed > 50 && all_holes > 10, "{mixed} {all_holes}");
    }

    #[test]
    fn depth_chunks_match_number_of_color_chunks() {
        let lengths = |depths: &mut [f32]| -> Vec<usize> {
            depth_chunks(depths, 4, 3)
                .map(|chunk| chunk.len())
                .collect()
        };
        assert_eq!(lengths(&mut [0.0; 10]), [4, 4, 2]);
        assert_eq!(lengths(&mut []), [0, 0, 0]);
    }
}
