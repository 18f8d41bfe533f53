//! Which layers show in which part of an image, so that a frame looks for no layer where none is (L10).
//!
//! The paper keeps the range of layers of each rectangle; a rectangle of a near thing before a far wall then has them all. Here it
//! keeps a set: the layers are dealt out to 64 buckets, one bit each.

use super::{CameraGrid, Picture};
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// Edge of a rectangle, pixels.
const EDGE_PX: usize = 16;

/// Sets of layers in all rectangles of all images.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rectangles {
    columns: usize,
    rows: usize,
    /// Layers, and one for infinity.
    indices: usize,
    sets: Vec<u64>,
}

impl Rectangles {
    pub(super) fn new(grid: &CameraGrid, pictures: &[Picture], layers: usize) -> Self {
        let [width, height] = grid.size_px().map(|side| side as usize);
        let (columns, rows) = (width.div_ceil(EDGE_PX), height.div_ceil(EDGE_PX));
        let mut found = Self { columns, rows, indices: layers + 1, sets: Vec::new() };
        let sets_of = |picture: &Picture| {
            let mut sets = vec![0; columns * rows];
            for (y, row) in picture.index.chunks_exact(width).enumerate() {
                // What is not known shows no layer.
                for (x, index) in row.iter().enumerate().filter(|(_, index)| usize::from(**index) <= layers) {
                    sets[y / EDGE_PX * columns + x / EDGE_PX] |= found.set(*index..=*index);
                }
            }
            sets
        };
        found.sets = pictures.par_iter().flat_map_iter(sets_of).collect();
        found
    }

    /// Of all sets.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.sets[..])
    }

    /// The buckets of a range of indices.
    pub(super) fn set(&self, indices: RangeInclusive<u16>) -> u64 {
        let bucket = |index: u16| (usize::from(index) * 64 / self.indices).min(63) as u32;
        let (first, last) = (bucket(*indices.start()), bucket(*indices.end()));
        (u64::MAX << first) & (u64::MAX >> (63 - last))
    }

    /// Whether any of the buckets of `set` shows in a part of a camera's image: columns and rows from and to, pixels, which may
    /// lie outside.
    pub(super) fn any(&self, camera: usize, set: u64, [left, right]: [f32; 2], [top, bottom]: [f32; 2]) -> bool {
        let span = |from: f32, to: f32, count: usize| {
            // Casts saturate; what lies before the image is cut off first.
            let first = (from * (1.0 / EDGE_PX as f32)) as usize;
            let end = if to < 0.0 { 0 } else { ((to * (1.0 / EDGE_PX as f32)) as usize).saturating_add(1) };
            first..end.min(count)
        };
        let (columns, rows) = (span(left, right, self.columns), span(top, bottom, self.rows));
        if columns.is_empty() {
            return false;
        }
        rows.into_iter().any(|row| {
            let first = (camera * self.rows + row) * self.columns;
            self.sets[first + columns.start..first + columns.end].iter().any(|found| found & set != 0)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lumigraph::grid::tests::any_grid;

    #[test]
    fn a_layer_is_found_where_it_shows_and_far_from_it_is_not() {
        let grid = any_grid();
        let [width, height] = grid.size_px().map(|side| side as usize);
        let mut pictures = vec![Picture { color: Vec::new(), index: vec![1; width * height] }; grid.camera_count()];
        pictures[4].index[20 * width + 37] = 200;
        let rectangles = Rectangles::new(&grid, &pictures, 255);
        let set = rectangles.set(190..=255);
        assert!(rectangles.any(4, set, [36.5, 37.5], [19.5, 20.5]));
        assert!(rectangles.any(4, set, [-1e30, 1e30], [-5.0, 17.0]));
        assert!(!rectangles.any(4, set, [0.0, 31.0], [0.0, 47.0]), "beside it");
        assert!(!rectangles.any(3, set, [0.0, 64.0], [0.0, 48.0]), "another camera");
        assert!(
            !rectangles.any(4, set, [70.0, 90.0], [0.0, 48.0]) && !rectangles.any(4, set, [-9.0, -1.0], [0.0, 9.0])
        );
        assert!(rectangles.any(0, rectangles.set(0..=1), [0.0, 1.0], [0.0, 1.0]));
    }

    #[test]
    fn sets_of_ranges_hold_the_sets_of_their_members() {
        let grid = any_grid();
        for layers in [0, 1, 3, 63, 64, 255, 65_535] {
            let rectangles = Rectangles::new(&grid, &[], layers);
            for (first, last) in [(0, 0), (0, layers), (layers / 3, layers / 2), (layers, layers)] {
                let (first, last) = (first as u16, last as u16);
                let whole = rectangles.set(first..=last);
                assert!((first..=last).step_by(7).all(|index| rectangles.set(index..=index) & !whole == 0));
                assert_ne!(whole, 0);
            }
        }
    }
}
