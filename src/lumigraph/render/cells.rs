//! Rectangles of the images with the set of layers in each, so that a frame skips layers where they
//! are absent, and skips lookups where a whole rectangle contains one layer (L10).
//!
//! The paper stores the range of layers of each rectangle. Here rectangles are squares of a few
//! pixels, of twice as many, four times and so on. Each has a range, which decides what a whole
//! tile sees, and a set of layers, since the range of a square with a near object in front of a far
//! wall includes all layers. A square is united with the next ones to the right, below and
//! diagonally: then a single lookup covers every rectangle that begins in the square and is not
//! larger.

use super::lanes::taps::LANES;
use super::layer_in_view::LayerInView;
use super::pyramid::{Level, Pyramid};
use fearless_simd::{Simd, f32x16, i32x16, prelude::*, u32x16};
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// Edge of the smallest squares, pixels.
const EDGE_PX: usize = 2;

/// Error bound of positions, pixels: they have 24 bits, and differ in rounding from those of single
/// rays.
const ROUNDING_PX: f32 = 0.125;

/// Mapping of layers to the bits of a set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Buckets {
    /// Number of layers, plus one for infinity.
    indices: usize,
}

impl Buckets {
    pub(crate) fn new(layers: usize) -> Self {
        Self {
            indices: layers + 1,
        }
    }

    /// Returns the set of buckets of a range of indices.
    pub(super) fn set(self, indices: RangeInclusive<u16>) -> u64 {
        let bucket = |index: u16| (usize::from(index) * 64 / self.indices).min(63) as u32;
        let (first, last) = (bucket(*indices.start()), bucket(*indices.end()));
        (u64::MAX << first) & (u64::MAX >> (63 - last))
    }

    /// Returns the set of each index; that of unknown pixels is empty.
    fn by_index(self) -> Vec<u64> {
        let indices = (0..=u16::MAX).take(self.indices + 1).enumerate();
        indices
            .map(|(i, index)| {
                if i < self.indices {
                    self.set(index..=index)
                } else {
                    0
                }
            })
            .collect()
    }
}

/// Layers that occur in a square.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LayerSquare {
    /// Set of buckets.
    set: u64,
    /// Smallest and largest index.
    range: [u16; 2],
}

impl LayerSquare {
    /// A square without pixels.
    const EMPTY: Self = Self {
        set: 0,
        range: [u16::MAX, 0],
    };
    /// A square outside the image: no layers, but a full range, so that lookups are not skipped.
    const OUTSIDE: Self = Self {
        set: 0,
        range: [0, u16::MAX],
    };

    fn union(self, other: Self) -> Self {
        Self {
            set: self.set | other.set,
            range: [
                self.range[0].min(other.range[0]),
                self.range[1].max(other.range[1]),
            ],
        }
    }
}

/// Squares of one size, with a border of one square on every side.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Scale {
    columns: usize,
    rows: usize,
    /// Index of the first square in each camera's squares.
    first: usize,
    edge_px: usize,
}

/// Squares of all images at all sizes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cells {
    scales: Vec<Scale>,
    /// Number of squares of a camera.
    stride: usize,
    sets: Vec<u64>,
    ranges: Vec<[u16; 2]>,
}

impl Cells {
    pub(crate) fn new(pyramid: &Pyramid, buckets: Buckets) -> Self {
        let image = pyramid.levels[0];
        let mut scales: Vec<Scale> = Vec::new();
        let (mut stride, mut edge_px) = (0, EDGE_PX);
        loop {
            let [columns, rows] =
                [image.width, image.height].map(|side| side.div_ceil(edge_px) + 2);
            scales.push(Scale {
                columns,
                rows,
                first: stride,
                edge_px,
            });
            stride += columns * rows;
            if edge_px >= image.width.max(image.height) {
                break;
            }
            edge_px *= 2;
        }
        let cameras = pyramid.texels.len() / pyramid.stride.max(1);
        let (mut sets, mut ranges) = (vec![0; stride * cameras], vec![[0; 2]; stride * cameras]);
        let by_index = buckets.by_index();
        let cameras = sets
            .par_chunks_mut(stride)
            .zip(ranges.par_chunks_mut(stride));
        cameras
            .zip(pyramid.texels.par_chunks(pyramid.stride.max(1)))
            .for_each(|((sets, ranges), texels)| {
                let indices = texels.iter().map(|texel| texel[3]);
                let mut squares = smallest_squares(&scales[0], image, indices, &by_index);
                for (i, scale) in scales.iter().enumerate() {
                    if i > 0 {
                        squares = coarsen(&squares, &scales[i - 1], scale);
                    }
                    for (at, square) in unite_with_next(&squares, scale).enumerate() {
                        (sets[scale.first + at], ranges[scale.first + at]) =
                            (square.set, square.range);
                    }
                }
            });
        Self {
            scales,
            stride,
            sets,
            ranges,
        }
    }

    /// Returns the size of all squares, bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.sets[..]) + size_of_val(&self.ranges[..])
    }

    /// Returns the smallest and the largest index in a square and the next ones; the full range if
    /// the square does not exist.
    #[inline(always)]
    pub(super) fn range(&self, square: u32) -> [u16; 2] {
        self.ranges
            .get(square as usize)
            .copied()
            .unwrap_or([0, u16::MAX])
    }
}

/// Builds the smallest squares from indices, row by row.
fn smallest_squares(
    scale: &Scale,
    image: Level,
    indices: impl Iterator<Item = u16>,
    by_index: &[u64],
) -> Vec<LayerSquare> {
    let mut squares = vec![LayerSquare::EMPTY; scale.columns * scale.rows];
    for (i, index) in indices.take(image.width * image.height).enumerate() {
        let (x, y) = (i % image.width / EDGE_PX + 1, i / image.width / EDGE_PX + 1);
        let square = &mut squares[y * scale.columns + x];
        *square = square.union(LayerSquare {
            set: by_index[usize::from(index)],
            range: [index; 2],
        });
    }
    // A square that crosses the image's border is also outside it.
    for (at, square) in squares.iter_mut().enumerate() {
        let (x, y) = (at % scale.columns, at / scale.columns);
        if x == 0 || y == 0 || x * EDGE_PX > image.width || y * EDGE_PX > image.height {
            *square = square.union(LayerSquare::OUTSIDE);
        }
    }
    squares
}

/// Builds squares of twice the edge.
fn coarsen(finer: &[LayerSquare], from: &Scale, to: &Scale) -> Vec<LayerSquare> {
    let mut squares = vec![LayerSquare::EMPTY; to.columns * to.rows];
    let halves = |at: usize, count: usize| (2 * at).saturating_sub(1)..(2 * at + 1).min(count);
    for (at, square) in squares.iter_mut().enumerate() {
        let columns = halves(at % to.columns, from.columns);
        let rows = halves(at / to.columns, from.rows);
        if columns.len() < 2 || rows.len() < 2 {
            *square = LayerSquare::OUTSIDE;
        }
        let parts = rows.flat_map(|y| columns.clone().map(move |x| finer[y * from.columns + x]));
        *square = parts.fold(*square, LayerSquare::union);
    }
    squares
}

/// Unites each square with the next ones to the right, below, and diagonally.
fn unite_with_next<'a>(
    squares: &'a [LayerSquare],
    scale: &'a Scale,
) -> impl Iterator<Item = LayerSquare> + 'a {
    squares.iter().enumerate().map(|(at, square)| {
        let (x, y) = (at % scale.columns, at / scale.columns);
        let neighbour = |x: usize, y: usize| {
            if x < scale.columns && y < scale.rows {
                squares[y * scale.columns + x]
            } else {
                LayerSquare::OUTSIDE
            }
        };
        square
            .union(neighbour(x + 1, y))
            .union(neighbour(x, y + 1))
            .union(neighbour(x + 1, y + 1))
    })
}

/// Bundle of rays between the same four cameras.
#[derive(Clone, Copy)]
pub(crate) struct Bundle {
    /// Smallest and largest slope, to the right and up.
    pub(super) slopes: [[f32; 2]; 2],
    /// Low and high camera positions along the columns and along the rows, metres.
    pub(super) positions: [[f32; 2]; 2],
    /// Camera indices: low and high column of the low row, then of the high row.
    pub(super) cameras: [usize; 4],
}

/// Up to sixteen layers of a frame, from near to far, laid out so that all are tested at once; in
/// pixels of the images.
#[derive(Default)]
pub(super) struct Batch {
    pub(super) layers: Vec<LayerInView>,
    scale: [f32; LANES],
    add: [[f32; LANES]; 2],
    shift: [f32; LANES],
    largest_scale: f32,
    coarsest: usize,
}

/// Layers of a batch that may be visible.
#[derive(Default)]
pub(super) struct BatchLayers {
    /// Bit mask of the layers, from the nearest.
    pub(super) layers: u32,
    /// Square of each layer in the four cameras' images; `None` if the bundle is larger than all
    /// squares.
    pub(super) squares: Option<[[u32; LANES]; 4]>,
}

impl Batch {
    pub(super) fn new(layers: &[LayerInView]) -> Self {
        let mut batch = Self {
            layers: layers.to_vec(),
            ..Self::default()
        };
        for (i, layer) in layers.iter().enumerate().take(LANES) {
            let texel_px = (1u32 << layer.level) as f32;
            batch.scale[i] = layer.scale * texel_px;
            (batch.add[0][i], batch.add[1][i]) = (layer.add[0] * texel_px, layer.add[1] * texel_px);
            batch.shift[i] = layer.shift * texel_px;
            batch.largest_scale = batch.largest_scale.max(batch.scale[i]);
            batch.coarsest = batch.coarsest.max(layer.level);
        }
        batch
    }

    /// Returns all layers, without squares.
    pub(super) fn all(&self) -> BatchLayers {
        BatchLayers {
            layers: (1u32 << self.layers.len()) - 1,
            squares: None,
        }
    }

    /// Returns the layers that may be visible to any ray of a bundle, optionally including their
    /// neighbours.
    #[inline(always)]
    pub(super) fn visible<S: Simd>(
        &self,
        simd: S,
        cells: &Cells,
        bundle: &Bundle,
        with_neighbours: bool,
    ) -> BatchLayers {
        let [[left, right], [low, high]] = bundle.slopes;
        let extent = (right - left).max(high - low) * self.largest_scale + 2.0 * ROUNDING_PX;
        // Squares are at least as large as texels, so that a texel lies in one square.
        let is_enough =
            |scale: &&Scale| scale.edge_px as f32 >= extent && scale.edge_px >> self.coarsest > 0;
        let Some(squares) = cells.scales.iter().find(is_enough) else {
            return self.all();
        };
        let per_edge = 1.0 / squares.edge_px as f32;
        let last = [(squares.columns - 2) as f32, (squares.rows - 2) as f32];
        let scale = f32x16::load_array_ref(simd, &self.scale);
        let shift = f32x16::load_array_ref(simd, &self.shift);
        let u = scale * left + f32x16::load_array_ref(simd, &self.add[0]) - ROUNDING_PX;
        let v = f32x16::load_array_ref(simd, &self.add[1]) - scale * high - ROUNDING_PX;
        let [columns, rows] = bundle.positions;
        let column = [
            square_index((u - shift * columns[0]) * per_edge, last[0]),
            square_index((u - shift * columns[1]) * per_edge, last[0]),
        ];
        let width = squares.columns as i32;
        let row = [
            square_index((v + shift * rows[0]) * per_edge, last[1]) * width,
            square_index((v + shift * rows[1]) * per_edge, last[1]) * width,
        ];
        let mut at = [[0; LANES]; 4];
        for k in 0..4 {
            let first = (bundle.cameras[k] * cells.stride + squares.first) as u32;
            at[k] = ((row[k / 2] + column[k % 2]).bitcast::<u32x16<S>>() + first).to_array();
        }
        let mut layers = 0;
        for (i, layer) in self.layers.iter().enumerate().take(LANES) {
            let set = |k: usize| {
                cells
                    .sets
                    .get(at[k][i] as usize)
                    .copied()
                    .unwrap_or(u64::MAX)
            };
            let occurring = set(0) | set(1) | set(2) | set(3);
            layers |= u32::from(occurring & layer.sets[usize::from(with_neighbours)] != 0) << i;
        }
        BatchLayers {
            layers,
            squares: Some(at),
        }
    }
}

/// Returns the square indices of positions: 0 is the border before the first square, `last + 1` the
/// one after the last.
#[inline(always)]
fn square_index<S: Simd>(position: f32x16<S>, last: f32) -> i32x16<S> {
    (position.max(-1.0).min(last) + 1.0).to_int::<i32x16<S>>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Picture;
    use crate::grid::tests::any_grid;
    use fearless_simd::dispatch;

    /// A layer that every camera shows as it is, from its left upper corner on: slopes are pixels.
    fn plain(index: u16, buckets: Buckets) -> LayerInView {
        let indices = [index; 2];
        let sets = [buckets.set(index..=index); 2];
        LayerInView {
            scale: 1.0,
            add: [0.0; 2],
            shift: 0.0,
            indices,
            with_neighbours: indices,
            level: 0,
            sets,
        }
    }

    #[test]
    fn layer_cells_match_visibility() {
        let grid = any_grid();
        let [width, height] = grid.size_px().map(|side| side as usize);
        let mut pictures = vec![
            Picture {
                color: vec![[0; 3]; width * height],
                index: vec![1; width * height]
            };
            grid.camera_count()
        ];
        pictures[4].index[20 * width + 37] = 200;
        let buckets = Buckets::new(255);
        let cells = Cells::new(&Pyramid::new(&grid, &pictures), buckets);
        let batch = Batch::new(&[plain(200, buckets), plain(1, buckets), plain(90, buckets)]);
        let near = |cameras: [usize; 4], [left, right]: [f32; 2], [top, bottom]: [f32; 2]| {
            let slopes = [[left, right], [-bottom, -top]];
            let bundle = Bundle {
                slopes,
                positions: [[0.0; 2]; 2],
                cameras,
            };
            let level = headbox_core::simd::level();
            dispatch!(level, simd => batch.visible(simd, &cells, &bundle, false))
        };
        for size in [0.1, 1.2, 7.0, 30.0] {
            for x in -3..70 {
                for y in -3..50 {
                    let ([left, right], [top, bottom]) = (
                        [x as f32 + 0.3, x as f32 + 0.3 + size],
                        [y as f32 + 0.6, y as f32 + 0.6 + size],
                    );
                    let found = near([4, 0, 0, 0], [left, right], [top, bottom]);
                    let covers = left < 38.0 && right >= 37.0 && top < 21.0 && bottom >= 20.0;
                    assert!(!covers || found.layers & 1 == 1, "{x} {y} {size}");
                    // Two squares, each less than twice as large as it must be.
                    let edge = 2.0 * (2.0 * size + 0.5).max(2.0) + 1.0;
                    let far = left > 37.0 + edge
                        || right < 38.0 - edge
                        || top > 20.0 + edge
                        || bottom < 21.0 - edge;
                    assert!(!far || found.layers & 1 == 0, "{x} {y} {size}");
                    assert_eq!(found.layers & 4, 0, "a layer that is nowhere");
                    let range = cells.range(found.squares.expect("large squares")[0][0]);
                    let all =
                        left >= 0.0 && top >= 0.0 && right < width as f32 && bottom < height as f32;
                    assert!(
                        range[1] > 1 || (all && !covers),
                        "{range:?} at {x} {y} {size}"
                    );
                    assert_eq!(
                        near([3, 0, 0, 0], [left, right], [top, bottom]).layers & 1,
                        0,
                        "another camera"
                    );
                }
            }
        }
        assert_eq!(
            near([4, 0, 0, 0], [0.0, 500.0], [0.0, 1.0]).layers,
            7,
            "no square is so large"
        );
    }

    #[test]
    fn sets_of_ranges_hold_the_sets_of_their_members() {
        for layers in [0, 1, 3, 63, 64, 255, 65_535] {
            let buckets = Buckets::new(layers);
            for (first, last) in [
                (0, 0),
                (0, layers),
                (layers / 3, layers / 2),
                (layers, layers),
            ] {
                let (first, last) = (first as u16, last as u16);
                let whole = buckets.set(first..=last);
                assert!(
                    (first..=last)
                        .step_by(7)
                        .all(|index| buckets.set(index..=index) & !whole == 0)
                );
                assert_ne!(whole, 0);
            }
        }
    }
}
