//! Pictures on planes at half, a quarter and an eighth of their size, and each of these softened, for frames whose pixels are
//! larger than texels.
//!
//! A lookup between four texels is a tent as wide as their distance. Where that is less than a pixel, texels fall between
//! pixels; a picture of half the size at once would blur. So the sizes come in steps of the square root of 2 or so: an odd
//! level is the one before it, softened by 1, 10, 1 (twelfths), an even one every second texel of the one two before it, of which
//! each is a mean with its neighbours by -1, 4, 10, 4, -1 (sixteenths). That neither blurs (its variance is 0) nor keeps what
//! half as many texels cannot show (0 at the highest frequency). The outermost lines of texels are taken as they are, so that
//! tiles that share one still meet. What that brings: docs/decisions.md: what half a pixel costs.

use super::planes::{PlaneSet, PlaneTile};
use rayon::prelude::*;
use std::sync::OnceLock;

/// Levels after the first.
pub(crate) const LEVELS: usize = 6;

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

/// How often a level halves the size.
pub(crate) fn halvings(level: usize) -> usize {
    level / 2
}

/// Texels at a level along a side that has `length` of them: with each halving every second one, and the last.
pub(crate) fn side(length: u16, level: usize) -> usize {
    usize::from(length).saturating_sub(1).div_ceil(1 << halvings(level)) + 1
}

impl PlaneSet {
    /// The texels of a picture at a level, in rows of [`side`] of its width; empty if there are none.
    pub(crate) fn texels_at(&self, index: usize, level: usize) -> &[[u8; 4]] {
        match level {
            0 => self.tiles.get(index).and_then(|tile| self.texels.get(tile.texel_range())).unwrap_or(&[]),
            _ => {
                let mip = self.mips.0[(level - 1).min(LEVELS - 1)].get_or_init(|| self.made(level));
                mip.starts.get(index..index + 2).and_then(|ends| mip.texels.get(ends[0]..ends[1])).unwrap_or(&[])
            }
        }
    }

    fn made(&self, level: usize) -> Mip {
        let filter = if level % 2 == 1 { &SOFTEN } else { &HALVE };
        let from = level - filter.step;
        let pictures: Vec<Vec<[u8; 4]>> = (0..self.tiles.len())
            .into_par_iter()
            .map(|i| {
                filter.apply(self.texels_at(i, from), size_at(&self.tiles[i], from), size_at(&self.tiles[i], level))
            })
            .collect();
        let mut mip = Mip { starts: vec![0], texels: Vec::new() };
        for picture in pictures {
            mip.texels.extend(picture);
            mip.starts.push(mip.texels.len());
        }
        mip
    }
}

/// Columns and rows at a level.
fn size_at(tile: &PlaneTile, level: usize) -> [usize; 2] {
    [side(tile.width, level), side(tile.height, level)]
}

/// Means of neighbours along both axes.
struct Filter {
    /// Of a texel, of each of its neighbours, and of theirs.
    weights: [i32; 3],
    /// Of every how many texels there is one left.
    step: usize,
}

const SOFTEN: Filter = Filter { weights: [10, 1, 0], step: 1 };

const HALVE: Filter = Filter { weights: [10, 4, -1], step: 2 };

impl Filter {
    /// The sum of all weights along an axis.
    const fn total(&self) -> i32 {
        self.weights[0] + 2 * (self.weights[1] + self.weights[2])
    }

    /// A picture of some columns and rows as one of others.
    fn apply(&self, from: &[[u8; 4]], [width, height]: [usize; 2], [columns, rows]: [usize; 2]) -> Vec<[u8; 4]> {
        if from.len() != width * height {
            return Vec::new();
        }
        let mut narrow = Vec::with_capacity(columns * height);
        for row in from.chunks_exact(width) {
            narrow.extend((0..columns).map(|x| self.mean(x, width, |i| row[i].map(i32::from))));
        }
        let (total, mut texels) = (self.total().pow(2), Vec::with_capacity(columns * rows));
        for y in 0..rows {
            for x in 0..columns {
                let sums = self.mean(y, height, |i| narrow[i * columns + x]);
                let [r, g, b, alpha] = sums.map(|sum| ((sum + total / 2) / total).clamp(0, 255) as u8);
                // Colours are multiplied by alpha.
                texels.push([r.min(alpha), g.min(alpha), b.min(alpha), alpha]);
            }
        }
        texels
    }

    /// The weighted sum about the texel that the `i`th of a line comes from, of a line of `length`.
    fn mean(&self, i: usize, length: usize, at: impl Fn(usize) -> [i32; 4]) -> [i32; 4] {
        let (middle, last) = (i * self.step, length.saturating_sub(1));
        if middle == 0 || middle >= last {
            return at(middle.min(last)).map(|c| c * self.total());
        }
        let [own, near, far] = self.weights;
        let pair = |k: usize| [at(middle.saturating_sub(k)), at((middle + k).min(last))];
        let (here, [a, b], [c, d]) = (at(middle), pair(1), pair(2));
        std::array::from_fn(|k| own * here[k] + near * (a[k] + b[k]) + far * (c[k] + d[k]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smaller_pictures_have_the_same_corners_and_ramps() {
        let tile = PlaneTile { plane: 0, first_texel: 0, x0: 0, y0: 0, width: 65, height: 7, face: 0, opaque: 1 };
        let texels: Vec<[u8; 4]> = (0..65 * 7).map(|i| [(i % 65 * 3) as u8, 7, (i / 65 * 9) as u8, 255]).collect();
        let set = PlaneSet { tiles: vec![tile], texels, ..PlaneSet::default() };
        for level in 1..=LEVELS {
            let (width, height, apart) = (side(65, level), side(7, level), 1 << halvings(level));
            let found = set.texels_at(0, level);
            assert_eq!((found.len(), width), (width * height, 64 / apart + 1));
            for (i, [r, g, b, a]) in found.iter().enumerate() {
                assert!((i32::from(*r) - 3 * (i % width * apart) as i32).abs() <= 1, "{level} {i}: {r}");
                assert!((*g, *a) == (7, 255) && *b <= 54);
            }
        }
    }

    #[test]
    fn what_half_as_many_texels_cannot_show_is_gone() {
        let tile = PlaneTile { plane: 0, first_texel: 0, x0: 0, y0: 0, width: 33, height: 33, face: 0, opaque: 1 };
        let stripes: Vec<[u8; 4]> = (0..33 * 33).map(|i| [(i % 2 * 200) as u8, 0, 0, 255]).collect();
        let set = PlaneSet { tiles: vec![tile], texels: stripes, ..PlaneSet::default() };
        for (i, texel) in set.texels_at(0, 2).iter().enumerate() {
            let is_border = [i % 17, i / 17].iter().any(|v| v % 16 == 0);
            assert!(is_border || texel[0].abs_diff(100) <= 1, "{i}: {texel:?}");
        }
    }
}
