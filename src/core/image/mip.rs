//! Mip levels: images at half the size, each texel reduced from four of the finer level.

/// Treatment of an odd last column or row of the finer level. A single column or row is repeated
/// except with [`Self::Pad`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OddEdge<T> {
    /// Dropped: sizes are rounded down, to at least 1.
    Drop,
    /// Repeated: sizes are rounded up.
    Repeat,
    /// Followed by this texel: sizes are rounded up.
    Pad(T),
}

/// Image at one mip level.
#[derive(Clone, Debug, PartialEq)]
pub struct MipLevel<T> {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Texels, row by row.
    pub texels: Vec<T>,
}

/// Returns the size of the next level, rounded up.
pub fn half_size(size: [usize; 2]) -> [usize; 2] {
    size.map(|side| side.div_ceil(2))
}

impl<T: Copy> MipLevel<T> {
    /// Returns the next level; `reduce` combines the upper left, upper right, lower left and lower
    /// right texel.
    #[must_use]
    pub fn halved(&self, edge: OddEdge<T>, reduce: impl Fn([T; 4]) -> T) -> Self {
        let [width, height] = self.size;
        let size = match edge {
            OddEdge::Drop => self.size.map(|side| (side / 2).max(1)),
            OddEdge::Repeat | OddEdge::Pad(_) => half_size(self.size),
        };
        let texel = |x: usize, y: usize| match edge {
            OddEdge::Pad(padding) if x >= width || y >= height => padding,
            _ => self.texels[y.min(height - 1) * width + x.min(width - 1)],
        };
        let mut texels = Vec::with_capacity(size[0] * size[1]);
        for y in (0..size[1]).map(|y| 2 * y) {
            for x in (0..size[0]).map(|x| 2 * x) {
                texels.push(reduce([
                    texel(x, y),
                    texel(x + 1, y),
                    texel(x, y + 1),
                    texel(x + 1, y + 1),
                ]));
            }
        }
        Self { size, texels }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Texels are their own coordinates, so that reducing by a table shows what was read.
    fn halve(size: [usize; 2], edge: OddEdge<u32>) -> MipLevel<u32> {
        let texels = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (10 * y + x) as u32));
        let level = MipLevel {
            size,
            texels: texels.collect(),
        };
        level.halved(edge, |[a, b, c, d]| ((a * 100 + b) * 100 + c) * 100 + d)
    }

    #[test]
    fn even_image_has_same_half_at_any_edge() {
        for edge in [OddEdge::Drop, OddEdge::Repeat, OddEdge::Pad(99)] {
            let half = halve([4, 2], edge);
            assert_eq!(half.size, [2, 1]);
            assert_eq!(half.texels, [1_10_11, 2_03_12_13]);
        }
    }

    #[test]
    fn odd_edge_is_dropped_repeated_or_padded() {
        let dropped = halve([3, 3], OddEdge::Drop);
        assert_eq!(
            (dropped.size, &dropped.texels[..]),
            ([1, 1], &[1_10_11][..])
        );
        let repeated = halve([3, 3], OddEdge::Repeat);
        assert_eq!(repeated.size, [2, 2]);
        assert_eq!(
            repeated.texels,
            [1_10_11, 2_02_12_12, 20_21_20_21, 22_22_22_22]
        );
        let padded = halve([3, 3], OddEdge::Pad(99));
        assert_eq!(padded.size, [2, 2]);
        assert_eq!(
            padded.texels,
            [1_10_11, 2_99_12_99, 20_21_99_99, 22_99_99_99]
        );
    }

    #[test]
    fn single_column_keeps_one_column() {
        let dropped = halve([1, 2], OddEdge::Drop);
        assert_eq!((dropped.size, &dropped.texels[..]), ([1, 1], &[10_10][..]));
        assert_eq!(half_size([5, 1]), [3, 1]);
        assert_eq!(half_size([0, 0]), [0, 0]);
    }
}
