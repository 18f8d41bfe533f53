//! Survey of the surfaces in the smallest blocks: the number of light samples that their surface
//! samples request.
//!
//! Requests follow from windows, which are nearly the same for a whole block; so they are computed
//! once for each surface of a block. The final light is pooled for each surface sample.

use super::block_windows::{BlockWindows, WindowReader};
use super::blocks::{BlockMembership, Blocks};
use super::lanes::{PoolingPoint, pool_points};
use super::surface_key::SurfaceKey;
use super::window::SHARE;
use super::{PooledLight, SMALL_LEVEL};
use headbox_core::cube_face::Face;
use rayon::prelude::*;

/// Share of the window of [`SMALL_LEVEL`] from which the samples of a surface need fewer light
/// samples than an isolated sample.
const ENOUGH_SHARE: f32 = 0.125;

/// A surface in one of the smallest blocks.
struct BlockSurface {
    key: SurfaceKey,
    /// Middle of the block, pixels.
    position: [f32; 2],
    /// Width of a pixel there, metres.
    width_m: f32,
    /// Share of the window of [`SMALL_LEVEL`] that the surface fills.
    share: f32,
    /// Support of the widest window.
    widest: f32,
}

/// Survey of a face's surfaces, block by block.
pub(crate) struct BlockSurvey<'a> {
    membership: &'a BlockMembership,
    surfaces: Vec<BlockSurface>,
}

impl<'a> BlockSurvey<'a> {
    /// Surveys blocks and windows over them, which need not contain light yet.
    pub(crate) fn new(
        face: Face,
        size_px: u32,
        blocks: &Blocks,
        windows: &BlockWindows,
        membership: &'a BlockMembership,
    ) -> Self {
        let survey = |readers: &mut Vec<WindowReader>, (key, position): (SurfaceKey, [f32; 2])| {
            let mut small_share = 0.0;
            let mut widest = 0.0f32;
            for (number, reader) in readers.iter_mut().enumerate() {
                let share = reader.read(&key, position)[SHARE];
                if number <= SMALL_LEVEL {
                    small_share = share;
                }
                widest = widest.max(share * reader.level.support());
            }
            BlockSurface {
                key,
                position,
                width_m: key.pixel_width(face, position, size_px),
                share: small_share,
                widest,
            }
        };
        let surfaces = blocks
            .middles(size_px)
            .into_par_iter()
            .map_init(|| windows.readers(), survey)
            .collect();
        Self {
            membership,
            surfaces,
        }
    }

    fn surface(&self, i: usize) -> &BlockSurface {
        &self.surfaces[self.index(i)]
    }

    /// Support of the widest window about surface sample `i`.
    pub(crate) fn widest(&self, i: usize) -> f32 {
        self.surface(i).widest
    }

    /// Share of the window of [`SMALL_LEVEL`] that the surface of sample `i` fills, 0..=1.
    pub(crate) fn share(&self, i: usize) -> f32 {
        self.surface(i).share.min(1.0)
    }

    /// Approximate width of the pixel of surface sample `i` on its surface, metres.
    pub(crate) fn width_m(&self, i: usize) -> f32 {
        self.surface(i).width_m
    }

    /// Maximum number of light samples of surface sample `i`: more, the less of the window its
    /// surface fills, up to the `samples` of an isolated sample.
    pub(crate) fn max_samples(&self, i: usize, samples: f32) -> f32 {
        (samples * ENOUGH_SHARE / self.surface(i).share).clamp(1.0, samples.max(1.0))
    }

    /// Light of each surface over windows of blocks. `expected` is the expected variance of light
    /// samples by class.
    pub(crate) fn pool(&self, windows: &BlockWindows, expected: &[f32]) -> Vec<PooledLight> {
        let point = |number: usize| {
            let surface = &self.surfaces[number];
            PoolingPoint {
                key: &surface.key,
                position: surface.position,
                width_m: surface.width_m,
                expected: expected[surface.key.class as usize],
            }
        };
        pool_points(self.surfaces.len(), point, windows, None)
    }

    /// Index of the surface of surface sample `i` in [`Self::pool`].
    pub(crate) fn index(&self, i: usize) -> usize {
        self.membership.surface[i] as usize
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::sample_on_plane;
    use super::*;
    use crate::surfaces::surface_samples::FaceSurfaces;

    #[test]
    fn sample_has_the_survey_of_its_block_and_surface() {
        const SIZE: u32 = 64;
        // A narrow strip of one wall beside another, and a separate leaf in each pixel.
        let pixel_samples = |p: u32| {
            [
                sample_on_plane(if p % SIZE < 6 { 1 } else { 2 }, 5.0),
                sample_on_plane(3, 4.0 - 0.01 * p as f32 / SIZE as f32),
            ]
        };
        let face = FaceSurfaces {
            size_px: SIZE,
            offsets: (0..=SIZE * SIZE).map(|p| 2 * p).collect(),
            samples: (0..SIZE * SIZE).flat_map(pixel_samples).collect(),
        };
        let (blocks, membership) = Blocks::new(&face);
        let windows = BlockWindows::new(Face::NegZ, SIZE, &blocks, [None; 6]);
        let survey = BlockSurvey::new(Face::NegZ, SIZE, &blocks, &windows, &membership);
        for (i, sample) in face.samples.iter().enumerate() {
            let surface = survey.surface(i);
            let pixel = [i as u32 / 2 % SIZE, i as u32 / 2 / SIZE];
            assert!(surface.key.is_same(&SurfaceKey::new(sample)), "sample {i}");
            // Blocks are four pixels wide.
            let is_near = |c: usize| (surface.position[c] - pixel[c] as f32 - 0.5).abs() <= 1.5;
            assert!(
                is_near(0) && is_near(1),
                "sample {i} at {pixel:?}: {:?}",
                surface.position
            );
        }
        let [strip, wall] = [2, 40].map(|x| 2 * (32 * SIZE + x) as usize);
        assert!(
            survey.widest(strip) < 0.3 * survey.widest(wall),
            "{} {}",
            survey.widest(strip),
            survey.widest(wall)
        );
        // At 5 m each pixel of 64 of a face is 2 / 64 of that wide, a little more off the middle.
        assert!(
            (survey.width_m(wall) / 0.15625 - 1.0).abs() < 0.1,
            "{}",
            survey.width_m(wall)
        );
        assert_eq!(survey.max_samples(wall, 4.0), 1.0);
    }
}
