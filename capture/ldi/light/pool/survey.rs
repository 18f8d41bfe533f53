//! What the parts of one surface in one of the smallest blocks have in common: how many samples they are asked for.
//!
//! Where samples go is decided by what windows hold, which are nearly the same for all of a block; so it is decided once for them. What
//! is found in the end is pooled part by part.

use super::around::{Reader, Windows};
use super::blocks::{Blocks, Members};
use super::surface::Surface;
use super::window::SHARE;
use super::{Place, Pooled, SMALL_LEVEL, pooled};
use headbox_core::cube_face::Face;
use rayon::prelude::*;

/// Share of the window of [`SMALL_LEVEL`] that a surface fills less of if its parts take as many samples as a part alone.
const ENOUGH_SHARE: f32 = 0.125;

/// The middle of a block on one of its surfaces.
struct Middle {
    surface: Surface,
    /// Pixels.
    position: [f32; 2],
    /// Width of a pixel there, metres.
    width_m: f32,
    /// Share of the window of [`SMALL_LEVEL`] that the surface fills.
    share: f32,
    /// Parts of the widest window.
    widest: f32,
}

/// A face's surfaces, block by block.
pub(crate) struct Survey<'a> {
    members: &'a Members,
    middles: Vec<Middle>,
}

impl<'a> Survey<'a> {
    /// Of blocks and windows over them that need not hold light yet.
    pub(crate) fn new(
        face: Face,
        size_px: u32,
        blocks: &Blocks,
        windows: &Windows,
        members: &'a Members,
    ) -> Self {
        let middle = |readers: &mut Vec<Reader>, (surface, position): (Surface, [f32; 2])| {
            let (mut small, mut widest) = (0.0, 0.0f32);
            for (number, reader) in readers.iter_mut().enumerate() {
                let share = reader.at(&surface, position)[SHARE];
                if number <= SMALL_LEVEL {
                    small = share;
                }
                widest = widest.max(share * reader.level.parts());
            }
            let width_m = surface.pixel_width(face, position, size_px);
            Middle {
                surface,
                position,
                width_m,
                share: small,
                widest,
            }
        };
        let middles = blocks
            .middles(size_px)
            .into_par_iter()
            .map_init(|| windows.readers(), middle)
            .collect();
        Self { members, middles }
    }

    fn middle(&self, part: usize) -> &Middle {
        &self.middles[self.members.of(part)]
    }

    /// Parts of the widest window about a part.
    pub(crate) fn widest(&self, part: usize) -> f32 {
        self.middle(part).widest
    }

    /// Width of a part's pixel on its surface, metres, about.
    pub(crate) fn width_m(&self, part: usize) -> f32 {
        self.middle(part).width_m
    }

    /// How many samples a part takes at most, of so many that one alone takes: as many as make up for what its surface lacks of
    /// the window.
    pub(crate) fn most_samples(&self, part: usize, samples: f32) -> f32 {
        (samples * ENOUGH_SHARE / self.middle(part).share).clamp(1.0, samples.max(1.0))
    }

    /// What windows over blocks hold about each part, by [`Self::of`], on surfaces where samples vary by so much.
    pub(crate) fn pooled(&self, windows: &Windows, expected: &[f32]) -> Vec<Pooled> {
        let place = |number: usize| {
            let Middle {
                surface,
                position,
                width_m,
                ..
            } = &self.middles[number];
            let expected = expected[surface.class as usize];
            Place {
                surface,
                position: *position,
                width_m: *width_m,
                expected,
            }
        };
        pooled(self.middles.len(), place, windows, None)
    }

    /// The number of what is known of a part.
    pub(crate) fn of(&self, part: usize) -> usize {
        self.members.of(part)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::part;
    use super::*;
    use crate::surfaces::surface_samples::FaceParts;

    #[test]
    fn what_is_decided_for_a_block_is_decided_where_its_parts_are() {
        const SIZE: u32 = 64;
        // A narrow strip of one wall beside another, and in each pixel a leaf of its own.
        let of_pixel = |p: u32| {
            [
                part(if p % SIZE < 6 { 1 } else { 2 }, 5.0),
                part(3, 4.0 - 0.01 * p as f32 / SIZE as f32),
            ]
        };
        let parts = (0..SIZE * SIZE).flat_map(of_pixel).collect();
        let face = FaceParts {
            size_px: SIZE,
            offsets: (0..=SIZE * SIZE).map(|p| 2 * p).collect(),
            parts,
        };
        let (blocks, members) = Blocks::new(&face);
        let windows = Windows::new(Face::NegZ, SIZE, &blocks, [None; 6]);
        let survey = Survey::new(Face::NegZ, SIZE, &blocks, &windows, &members);
        for (p, part) in face.parts.iter().enumerate() {
            let (middle, pixel) = (survey.middle(p), [p as u32 / 2 % SIZE, p as u32 / 2 / SIZE]);
            assert!(middle.surface.is_same(&Surface::of(part)), "part {p}");
            // Blocks are four pixels wide.
            let is_near = |c: usize| (middle.position[c] - pixel[c] as f32 - 0.5).abs() <= 1.5;
            assert!(
                is_near(0) && is_near(1),
                "part {p} at {pixel:?}: {:?}",
                middle.position
            );
        }
        let [strip, wall] = [2, 40].map(|x| 2 * (32 * SIZE + x) as usize);
        assert!(
            survey.widest(strip) < 0.3 * survey.widest(wall),
            "{} {}",
            survey.widest(strip),
            survey.widest(wall)
        );
        // At 5 m each pixel of 64 of a face is 2 / 64 of that wide, a little more beside the middle.
        assert!(
            (survey.width_m(wall) / 0.15625 - 1.0).abs() < 0.1,
            "{}",
            survey.width_m(wall)
        );
        assert_eq!(survey.most_samples(wall, 4.0), 1.0);
    }
}
