//! All plane textures of a cube, at every mip level.

use super::mips::{Filter, LazyMips, Mip};
use super::planes::{Plane, PlaneTile};
use crate::pack::plane_textures::mips;
use rayon::prelude::*;

/// All plane textures of a cube.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlaneSet {
    /// Error bound of each plane texture, in pixels of the reference frame of `planes::Bound`; 0 if
    /// there are none.
    pub error_px: f64,
    /// The planes.
    pub planes: Vec<Plane>,
    /// Plane textures, ordered by plane, face and position.
    pub tiles: Vec<PlaneTile>,
    /// Rows from top to bottom: sRGB premultiplied by alpha, and alpha, so that filtering does not
    /// darken the rim of transparent texels.
    pub texels: Vec<[u8; 4]>,
    /// Number of samples that the plane textures replace.
    pub samples: u64,
    /// Mip levels, computed when frames need them.
    pub mips: LazyMips,
}

impl PlaneSet {
    /// Premultiplies a straight colour.
    pub fn covered([r, g, b, alpha]: [u8; 4]) -> [u8; 4] {
        let times = |c: u8| ((u32::from(c) * u32::from(alpha) + 127) / 255) as u8;
        [times(r), times(g), times(b), alpha]
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.planes[..]) + size_of_val(&self.tiles[..]) + size_of_val(&self.texels[..])
    }

    /// Returns the texels of a tile at a level, in rows of [`mips::side`] of its width; empty if
    /// there are none.
    pub(crate) fn mip_texels(&self, index: usize, level: usize) -> &[[u8; 4]] {
        if level > 0 {
            return self
                .mips
                .level(level, || self.compute_mip(level))
                .texture(index);
        }
        self.tiles
            .get(index)
            .and_then(|tile| self.texels.get(tile.texel_range()))
            .unwrap_or(&[])
    }

    /// Computes a level in advance, for the tasks of a frame.
    pub(crate) fn make_level(&self, level: usize) {
        self.mip_texels(0, level);
    }

    fn compute_mip(&self, level: usize) -> Mip {
        let filter = Filter::for_level(level);
        let source = level - filter.step;
        let textures: Vec<Vec<[u8; 4]>> = (0..self.tiles.len())
            .into_par_iter()
            .map(|i| {
                filter.apply(
                    self.mip_texels(i, source),
                    mip_size(&self.tiles[i], source),
                    mip_size(&self.tiles[i], level),
                )
            })
            .collect();
        Mip::new(textures)
    }
}

/// Returns the columns and rows of a tile at a level.
fn mip_size(tile: &PlaneTile, level: usize) -> [usize; 2] {
    [
        mips::side(tile.width, level),
        mips::side(tile.height, level),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pack::plane_textures::mips::{LEVELS, halvings, side};
    use bytemuck::Zeroable;

    /// Creates a set of one opaque tile.
    fn one_tile(width: u16, height: u16, texel: impl Fn(u32) -> [u8; 4]) -> PlaneSet {
        let tile = PlaneTile {
            width,
            height,
            opaque: 1,
            ..PlaneTile::zeroed()
        };
        PlaneSet {
            tiles: vec![tile],
            texels: (0..tile.texel_count() as u32).map(texel).collect(),
            ..PlaneSet::default()
        }
    }

    #[test]
    fn mips_keep_corners_and_ramps() {
        let ramps = |i| [(i % 65 * 3) as u8, 7, (i / 65 * 9) as u8, 255];
        let set = one_tile(65, 7, ramps);
        for level in 1..=LEVELS {
            let (width, height, apart) = (side(65, level), side(7, level), 1 << halvings(level));
            let found = set.mip_texels(0, level);
            assert_eq!((found.len(), width), (width * height, 64 / apart + 1));
            for (i, [r, g, b, a]) in found.iter().enumerate() {
                assert!(
                    (i32::from(*r) - 3 * (i % width * apart) as i32).abs() <= 1,
                    "{level} {i}: {r}"
                );
                assert!((*g, *a) == (7, 255) && *b <= 54);
            }
        }
    }

    #[test]
    fn mips_remove_high_frequencies() {
        let set = one_tile(33, 33, |i| [(i % 2 * 200) as u8, 0, 0, 255]);
        for (i, texel) in set.mip_texels(0, 2).iter().enumerate() {
            let is_border = [i % 17, i / 17].iter().any(|v| v % 16 == 0);
            assert!(is_border || texel[0].abs_diff(100) <= 1, "{i}: {texel:?}");
        }
    }
}
