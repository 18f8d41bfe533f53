//! Which clusters can show: in the frame (the homogeneous box test of inventory C17), and in front of what is drawn already.

use super::GroupWindow;
use super::mesh::{Cluster, RasterMesh};
use super::view::{NEAR_M, View};
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// A cluster that may show.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct VisibleCluster {
    /// Index of the cluster.
    pub(super) cluster: u32,
    /// How many triangles it has.
    pub(super) triangles: u32,
    /// Columns and rows of the frame that it can touch.
    columns: Range<u32>,
    rows: Range<u32>,
    /// No point of it has a larger 1 / eye depth, 1/m; infinite if it reaches as far as the eye.
    nearest: f32,
}

impl VisibleCluster {
    /// Whether it can touch any of these rows.
    pub(super) fn touches(&self, rows: &Range<u32>) -> bool {
        self.rows.start < rows.end && rows.start < self.rows.end
    }
}

/// Rounding of positions and snapping move a corner by far less than this, px.
const MARGIN_PX: f32 = 1.0;

/// Corners nearer than this are not trusted to bound anything, metres.
const TRUSTED_M: f32 = 0.01;

/// Depth in `f32` is off by less than this part of the distance: four roundings of 2^-24 in each of three terms.
const DEPTH_ERROR: f32 = 1e-6;

/// Fills `visible` with the clusters of the groups that can show, those that come nearest first, and returns how many
/// triangles the groups have.
pub(super) fn visible_clusters(
    mesh: &RasterMesh,
    view: &View,
    groups: &[GroupWindow],
    visible: &mut Vec<VisibleCluster>,
) -> u64 {
    visible.clear();
    let mut triangles = 0;
    for group in groups {
        let Some(run) = mesh.groups.get(group.group as usize) else { continue };
        let clusters = &mesh.clusters[run.start as usize..run.end as usize];
        triangles += clusters.iter().map(|cluster| cluster.triangles.len() as u64).sum::<u64>();
        let window = group.window.clone().unwrap_or([0..view.width, 0..view.height]);
        let found = clusters
            .par_iter()
            .enumerate()
            .with_min_len(512)
            .filter_map(|(i, cluster)| touched(cluster, run.start + i as u32, view, &window));
        visible.par_extend(found);
    }
    visible.par_sort_unstable_by_key(|visible| (u32::MAX - visible.nearest.to_bits(), visible.cluster));
    triangles
}

/// The part of the window that a cluster can touch; `None` if it is outside.
fn touched(cluster: &Cluster, number: u32, view: &View, [columns, rows]: &[Range<u32>; 2]) -> Option<VisibleCluster> {
    let [low, high] = cluster.bounds;
    let corners: [Vec3; 8] = std::array::from_fn(|i| {
        let pick = |axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
        view.homogeneous(Vec3::new(pick(0), pick(1), pick(2)))
    });
    let all = |outside: &dyn Fn(&Vec3) -> bool| corners.iter().all(outside);
    let (left, right) = (columns.start as f32 - MARGIN_PX, columns.end as f32 + MARGIN_PX);
    let (top, bottom) = (rows.start as f32 - MARGIN_PX, rows.end as f32 + MARGIN_PX);
    let hidden = columns.is_empty()
        || rows.is_empty()
        || all(&|h| h.z < NEAR_M)
        || all(&|h| h.x < left * h.z)
        || all(&|h| h.x > right * h.z)
        || all(&|h| h.y < top * h.z)
        || all(&|h| h.y > bottom * h.z);
    if hidden {
        return None;
    }
    let triangles = cluster.triangles.len() as u32;
    let (columns, rows) = (columns.clone(), rows.clone());
    let least = corners.iter().fold(f32::INFINITY, |least, h| least.min(h.z)) - DEPTH_ERROR * view.reach(low, high);
    if least < TRUSTED_M {
        return Some(VisibleCluster { cluster: number, triangles, columns, rows, nearest: f32::INFINITY });
    }
    let between = |values: [f32; 8], within: Range<u32>| {
        let first = values.into_iter().fold(f32::INFINITY, f32::min) - MARGIN_PX;
        let last = values.into_iter().fold(f32::NEG_INFINITY, f32::max) + MARGIN_PX;
        (first as u32).clamp(within.start, within.end)..(last.ceil() as u32).clamp(within.start, within.end)
    };
    Some(VisibleCluster {
        cluster: number,
        triangles,
        columns: between(corners.map(|h| h.x / h.z), columns),
        rows: between(corners.map(|h| h.y / h.z), rows),
        nearest: 1.0 / least,
    })
}

/// Pixels of a tile, along a row and down.
const TILE_PX: [usize; 2] = [32, 8];

/// Pixels of the band for which one triangle has to be drawn before the tiles are looked at again: looking at that many
/// takes about as long as drawing a triangle.
const PIXELS_A_TRIANGLE: usize = 64;

/// The least 1 / eye depth of each tile of a band, as of some time ago: what comes no nearer is hidden.
pub(super) struct Farthest {
    /// Tiles of a row.
    across: usize,
    tiles: Vec<f32>,
    /// Triangles that were drawn since.
    drawn: usize,
}

impl Farthest {
    /// Of a band that is empty.
    pub(super) fn new(width: u32, rows: &Range<u32>) -> Self {
        let across = (width as usize).div_ceil(TILE_PX[0]);
        Self { across, tiles: vec![0.0; across * rows.len().div_ceil(TILE_PX[1])], drawn: 0 }
    }

    /// Whether nothing of a cluster can show in a band of these rows, the pixels of which are so deep by now.
    pub(super) fn hides(
        &mut self,
        visible: &VisibleCluster,
        width: u32,
        rows: &Range<u32>,
        inverse_depth: &[f32],
    ) -> bool {
        if self.drawn * PIXELS_A_TRIANGLE > inverse_depth.len() {
            self.look(width as usize, inverse_depth);
        }
        let start = visible.rows.start.max(rows.start).saturating_sub(rows.start) as usize / TILE_PX[1];
        let end = (visible.rows.end.min(rows.end).saturating_sub(rows.start) as usize).div_ceil(TILE_PX[1]);
        let columns = visible.columns.start as usize / TILE_PX[0]..(visible.columns.end as usize).div_ceil(TILE_PX[0]);
        let of_row = |row: usize| self.tiles.get(row * self.across..(row + 1) * self.across);
        let hides = (start..end).filter_map(of_row).all(|row| {
            row.get(columns.clone()).is_some_and(|tiles| tiles.iter().all(|farthest| *farthest > visible.nearest))
        });
        self.drawn += if hides { 0 } else { visible.triangles as usize };
        hides
    }

    fn look(&mut self, width: usize, inverse_depth: &[f32]) {
        self.drawn = 0;
        for (tiles, rows) in self.tiles.chunks_mut(self.across).zip(inverse_depth.chunks(TILE_PX[1] * width)) {
            tiles.fill(f32::INFINITY);
            for row in rows.chunks(width) {
                for (tile, pixels) in tiles.iter_mut().zip(row.chunks(TILE_PX[0])) {
                    *tile = pixels.iter().fold(*tile, |least, depth| least.min(*depth));
                }
            }
        }
    }
}
