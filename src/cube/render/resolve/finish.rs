//! From a canvas to the frame: the environment is put under what splats leave open.

use crate::pack::PackedCube;
use crate::render::FramePlan;
use crate::render::canvas::linear::LinearLight;
use fearless_simd::{Level, Simd, dispatch, prelude::*, u32x16};
use glam::{DVec3, Vec3};
use headbox_core::camera::Camera;
use headbox_core::environment::Environment;
use headbox_core::frame::Coverage;
use rayon::prelude::*;

/// Pixels of the frame, row by row. What they hold before does not matter.
pub struct Pixels<'a> {
    /// From a canvas: straight colour, and the share of 255 that splats cover. In the frame: colour and alpha, 255.
    pub colors: &'a mut [[u8; 4]],
    pub coverages: &'a mut [Coverage],
    /// Eye depth, m, infinite where no splat is. Empty if nobody wants it.
    pub depths_m: &'a mut [f32],
    /// 1 / eye depth, for whoever fills holes. Empty if nobody does.
    pub inverse_depths: &'a mut [f32],
}

impl<'a> Pixels<'a> {
    /// Its rows, each `width` pixels long.
    pub(crate) fn rows(self, width: u32) -> impl Iterator<Item = Pixels<'a>> {
        let width = width as usize;
        let mut depths_m = self.depths_m.chunks_mut(width);
        let mut inverse_depths = self.inverse_depths.chunks_mut(width);
        let rows = self
            .colors
            .chunks_mut(width)
            .zip(self.coverages.chunks_mut(width));
        rows.map(move |(colors, coverages)| {
            let (depths_m, inverse_depths) = (depths_m.next(), inverse_depths.next());
            let [depths_m, inverse_depths] =
                [depths_m, inverse_depths].map(Option::unwrap_or_default);
            Pixels {
                colors,
                coverages,
                depths_m,
                inverse_depths,
            }
        })
    }
}

/// The pieces of `depths_m`, or as many empty ones if it is empty.
pub(crate) fn depth_pieces(
    depths_m: &mut [f32],
    piece: usize,
    count: usize,
) -> impl IndexedParallelIterator<Item = &mut [f32]> {
    let missing = if depths_m.is_empty() { count } else { 0 };
    depths_m
        .par_chunks_mut(piece)
        .chain((0..missing).into_par_iter().map(|_| Default::default()))
}

/// What shows where splats leave a frame open.
pub struct Background<'a> {
    pub environment: &'a Environment,
    pub camera: &'a Camera,
    pub hole_color_srgb: [u8; 3],
    pub level: Level,
}

/// Pixels that are finished at a time.
const CHUNK: usize = 16;

impl<'a> Background<'a> {
    pub(crate) fn new(plan: &FramePlan, cube: &'a PackedCube, camera: &'a Camera) -> Self {
        let FramePlan {
            level,
            hole_color_srgb,
            ..
        } = *plan;
        Self {
            environment: &cube.environment,
            camera,
            hole_color_srgb,
            level,
        }
    }

    /// Makes the resolved pixels of a canvas in row `y` those of the frame, and returns how many of them are holes.
    pub fn put_under(&self, y: u32, pixels: Pixels) -> u64 {
        let start = self.camera.direction(0.5, f64::from(y) + 0.5);
        let step = self.camera.direction(1.5, f64::from(y) + 0.5) - start;
        dispatch!(self.level, simd => self.put_under_row(simd, [start, step], pixels))
    }

    /// The same for a row that looks along `start + column * step`: [`CHUNK`] pixels at a time, from those of column 0 on, so that
    /// no pixel depends on where others are open.
    #[inline(always)]
    fn put_under_row<S: Simd>(&self, simd: S, [start, step]: [DVec3; 2], pixels: Pixels) -> u64 {
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
                holes += self.put_under_chunk(simd, [from, step.as_vec3()], colors, coverages);
                continue;
            }
            // The end of the row: beyond it, as if there were splats.
            let (mut all, mut all_coverages) = ([[255; 4]; CHUNK], [Coverage::FULL; CHUNK]);
            all[..colors.len()].copy_from_slice(colors);
            holes +=
                self.put_under_chunk(simd, [from, step.as_vec3()], &mut all, &mut all_coverages);
            colors.copy_from_slice(&all[..colors.len()]);
            coverages.copy_from_slice(&all_coverages[..coverages.len()]);
        }
        for (depth_m, coverage) in depths_m.iter_mut().zip(coverages) {
            if coverage.splat_share() == 0 {
                *depth_m = f32::INFINITY;
            }
        }
        holes
    }

    /// The same for the colours and coverages of pixels that look along `start + i * step`.
    #[inline(always)]
    fn put_under_chunk<S: Simd>(
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
        let seen = self
            .environment
            .sample_sixteen(simd, open.to_bitmask(), start, step);
        let seen = u32x16::load_array(simd, bytemuck::cast(seen));
        let (empty, known) = (share.simd_eq(0), (seen >> ALPHA_SHIFT).simd_ne(0));
        let [r, g, b] = self.hole_color_srgb;
        let hole = u32x16::splat(simd, u32::from_ne_bytes([r, g, b, 255]));
        let color = empty.select(
            known.select(seen, hole),
            color | u32::from_ne_bytes([0, 0, 0, 255]),
        );
        let alone = known.select(u32x16::splat(simd, ENVIRONMENT), u32x16::splat(simd, HOLE));
        let from_splat_share = share.max(u32::from(Coverage::from_splat_share(0).splat_share()));
        let shares = share.to_array();
        let mut mixed = (open & !empty & known).to_bitmask();
        let seen = seen.to_array();
        *colors = bytemuck::cast(color.to_array());
        for (coverage, byte) in coverages
            .iter_mut()
            .zip(empty.select(alone, from_splat_share).to_array())
        {
            *coverage = Coverage::from_byte(byte as u8);
        }
        while mixed != 0 {
            let i = mixed.trailing_zeros() as usize;
            mixed &= mixed - 1;
            let ([r, g, b, _], [sr, sg, sb, _]) = (colors[i], seen[i].to_ne_bytes());
            let [r, g, b] =
                LinearLight::tables().mix([[r, g, b], [sr, sg, sb]], [shares[i], 255 - shares[i]]);
            colors[i] = [r, g, b, 255];
        }
        u64::from((empty & !known).to_bitmask().count_ones())
    }
}

/// Where alpha lies in four bytes as they lie in memory.
const ALPHA_SHIFT: u32 = u32::from_ne_bytes([0, 0, 0, 1]).trailing_zeros();

/// The bytes of two coverages.
const ENVIRONMENT: u32 = Coverage::ENVIRONMENT.byte() as u32;
const HOLE: u32 = Coverage::HOLE.byte() as u32;

#[cfg(test)]
mod tests {
    //! Rows of a frame, put over the environment pixel after pixel.

    use super::*;
    use headbox_core::random::Rng;
    use headbox_core::simd;

    /// Levels by which the environment's sixteen samples at a time may differ from one: directions run in f32 along a row.
    const LEVELS: u8 = 1;

    #[test]
    fn what_splats_leave_open_shows_the_environment_pixel_by_pixel() {
        let mut random = Rng::keyed(2);
        // Some texels of it are not known.
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
        let (width, mut mixed, mut all_holes) = (37, 0, 0);
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
                    let seen = environment.sample(
                        camera
                            .direction(f64::from(x) + 0.5, f64::from(y) + 0.5)
                            .as_vec3(),
                    );
                    let from_splat_share = Coverage::from_splat_share(share);
                    match (share, seen) {
                        (255, _) => ([r, g, b], Coverage::FULL, true),
                        (0, Some(seen)) => (seen, Coverage::ENVIRONMENT, false),
                        (0, None) => {
                            holes += 1;
                            ([1, 2, 3], Coverage::HOLE, false)
                        }
                        (_, None) => ([r, g, b], from_splat_share, true),
                        (_, Some(seen)) => {
                            mixed += 1;
                            let shares = [u32::from(share), 255 - u32::from(share)];
                            (
                                LinearLight::tables().mix([[r, g, b], seen], shares),
                                from_splat_share,
                                true,
                            )
                        }
                    }
                })
                .collect();
            for level in simd::levels() {
                let (mut colors, mut depths_m) = (resolved.clone(), vec![3.0; width]);
                let mut coverages = vec![Coverage::HOLE; width];
                let background = Background {
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
                assert_eq!(background.put_under(y, pixels), holes);
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
    fn pieces_of_depths_are_as_many_as_those_of_colours() {
        assert_eq!(
            depth_pieces(&mut [0.0; 10], 4, 3)
                .map(|piece| piece.len())
                .collect::<Vec<_>>(),
            [4, 4, 2]
        );
        assert_eq!(
            depth_pieces(&mut [], 4, 3)
                .map(|piece| piece.len())
                .collect::<Vec<_>>(),
            [0, 0, 0]
        );
    }
}
