//! Pictures on planes at half, a quarter and an eighth of their size, for frames whose pixels are larger than texels.

use super::planes::{PlaneSet, PlaneTile};
use rayon::prelude::*;
use std::sync::OnceLock;

/// Sizes below the first.
pub(crate) const LEVELS: usize = 3;

/// All pictures of a set at one size.
#[derive(Debug, Default)]
pub(crate) struct Mip {
    /// Of each picture, its first texel; and the end.
    starts: Vec<usize>,
    texels: Vec<[u8; 4]>,
}

/// [`Mip`]s that are made when they are first asked for. A copy has none.
#[derive(Debug, Default)]
pub struct LazyMips([OnceLock<Mip>; LEVELS]);

impl Clone for LazyMips {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl PartialEq for LazyMips {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// Texels along a side that has `length` of them, `level` sizes below: every second one, and the last.
pub(crate) fn side(length: u16, level: usize) -> usize {
    usize::from(length).saturating_sub(1).div_ceil(1 << level) + 1
}

impl PlaneSet {
    /// The texels of a picture `level` sizes below the first, in rows of [`side`] of its width; empty if there are none.
    pub(crate) fn texels_at(&self, index: usize, level: usize) -> &[[u8; 4]] {
        match level {
            0 => self.tiles.get(index).and_then(|tile| self.texels.get(tile.texel_range())).unwrap_or(&[]),
            _ => {
                let mip = self.mips.0[(level - 1).min(LEVELS - 1)].get_or_init(|| self.halved(level));
                mip.starts.get(index..index + 2).and_then(|ends| mip.texels.get(ends[0]..ends[1])).unwrap_or(&[])
            }
        }
    }

    fn halved(&self, level: usize) -> Mip {
        let pictures: Vec<Vec<[u8; 4]>> = (0..self.tiles.len())
            .into_par_iter()
            .map(|i| halve(&self.tiles[i], self.texels_at(i, level - 1), level))
            .collect();
        let mut mip = Mip { starts: vec![0], texels: Vec::new() };
        for picture in pictures {
            mip.texels.extend(picture);
            mip.starts.push(mip.texels.len());
        }
        mip
    }
}

/// Every second texel of the next larger size, of which each is a mean with its neighbours: 1, 2, 1 along both axes.
fn halve(tile: &PlaneTile, from: &[[u8; 4]], level: usize) -> Vec<[u8; 4]> {
    let [larger, smaller] = [level - 1, level].map(|level| [side(tile.width, level), side(tile.height, level)]);
    if from.len() != larger[0] * larger[1] {
        return Vec::new();
    }
    let around = |i: usize, length: usize| (2 * i).saturating_sub(1)..(2 * i + 2).min(length);
    let mut texels = Vec::with_capacity(smaller[0] * smaller[1]);
    for y in 0..smaller[1] {
        for x in 0..smaller[0] {
            let (columns, rows) = (around(x, larger[0]), around(y, larger[1]));
            // The last texel of an even side stands beyond it, and repeats it.
            let (mut sum, mut whole) = ([0u32; 4], 0);
            for (row, column) in rows.flat_map(|row| columns.clone().map(move |column| (row, column))) {
                let weight = (2 - row.abs_diff(2 * y) as u32) * (2 - column.abs_diff(2 * x) as u32);
                for (sum, c) in sum.iter_mut().zip(from[row * larger[0] + column]) {
                    *sum += weight * u32::from(c);
                }
                whole += weight;
            }
            texels.push(sum.map(|sum| ((sum + whole / 2) / whole.max(1)) as u8));
        }
    }
    texels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smaller_pictures_have_the_same_corners_and_means() {
        let tile = PlaneTile { plane: 0, first_texel: 0, x0: 0, y0: 0, width: 65, height: 6, face: 0, opaque: 1 };
        let texels: Vec<[u8; 4]> = (0..65 * 6).map(|i| [(i % 65 * 3) as u8, 7, (i / 65 * 9) as u8, 255]).collect();
        let set = PlaneSet { tiles: vec![tile], texels, ..PlaneSet::default() };
        for level in 1..=LEVELS {
            let (width, height) = (side(65, level), side(6, level));
            let found = set.texels_at(0, level);
            assert_eq!((found.len(), width), (width * height, (64 >> level) + 1));
            for (i, [r, g, b, a]) in found.iter().enumerate() {
                // A ramp stays one but at its ends, where half of the neighbours are missing.
                let expected = (i % width) << level;
                assert!((i32::from(*r) - 3 * expected as i32).abs() <= 3 << level, "{level} {i}");
                assert!((*g, *a) == (7, 255) && *b <= 45);
            }
        }
    }
}
