//! Merged layers of a frame, and their mapping to texels.

use crate::Lumigraph;
use crate::grid::PlaneView;

/// Consecutive layers that a frame draws as one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MergedLayer {
    /// Index of the farthest and of the nearest layer.
    pub(crate) indices: [u16; 2],
    /// The same, extended by the adjacent merged layers in front and behind, if their distance is
    /// not much above the allowed disagreement of cameras.
    pub(crate) with_neighbours: [u16; 2],
    /// Disparity at which they are drawn, 1/m.
    pub(crate) drawn: f64,
    /// Level of the pyramid.
    pub(crate) level: usize,
}

/// Mapping of a merged layer in a frame: the texel of a ray with slopes (a, b) in the image of a
/// camera at (s, t) is `(scale * a + add.x - shift * s, -scale * b + add.y + shift * t)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LayerInView {
    pub(super) scale: f32,
    pub(super) add: [f32; 2],
    pub(super) shift: f32,
    pub(super) indices: [u16; 2],
    /// See [`MergedLayer::with_neighbours`].
    pub(super) with_neighbours: [u16; 2],
    /// Level of the pyramid.
    pub(super) level: usize,
    /// Set of its buckets, and the set including its neighbours'.
    pub(super) sets: [u64; 2],
}

impl LayerInView {
    pub(super) fn new(lumigraph: &Lumigraph, view: &PlaneView, layer: &MergedLayer) -> Self {
        let grid = lumigraph.grid();
        let coarser = 0.5f64.powi(layer.level as i32);
        let focal = grid.focal_px() * coarser;
        let [x, y] = grid.size_px().map(|side| f64::from(side) / 2.0 * coarser);
        let MergedLayer {
            indices,
            with_neighbours,
            drawn,
            level,
        } = *layer;
        Self {
            scale: (focal * (1.0 - view.eye.z * drawn)) as f32,
            add: [
                (x + focal * view.eye.x * drawn) as f32,
                (y - focal * view.eye.y * drawn) as f32,
            ],
            shift: (focal * (drawn - grid.convergence())) as f32,
            indices,
            with_neighbours,
            level,
            sets: [indices, with_neighbours]
                .map(|[first, last]| lumigraph.buckets.set(first..=last)),
        }
    }
}
