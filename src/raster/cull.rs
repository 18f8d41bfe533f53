//! Frustum culling of clusters (the homogeneous box test of C17).

use super::GroupWindow;
use super::mesh::{Cluster, RasterMesh};
use super::view::{LocalCamera, NEAR_M};
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// A cluster that may be visible.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct VisibleCluster {
    /// Index of the cluster.
    pub(super) cluster: u32,
    /// Number of triangles.
    pub(super) triangles: u32,
    /// Rows of the frame that it can touch.
    rows: Range<u32>,
}

impl VisibleCluster {
    /// Returns true if the cluster may touch any of `rows`.
    pub(super) fn touches(&self, rows: &Range<u32>) -> bool {
        self.rows.start < rows.end && rows.start < self.rows.end
    }
}

/// Margin for rounding and snapping of corners, px; both are far smaller.
const MARGIN_PX: f32 = 1.0;

/// Minimum eye depth of corners that bound the rows, metres.
const MIN_BOUND_DEPTH_M: f32 = 0.01;

/// Fills `visible` with the clusters of the groups that may be visible, in the order of the groups,
/// and returns the number of triangles of the groups.
pub(super) fn visible_clusters(
    mesh: &RasterMesh,
    view: &LocalCamera,
    groups: &[GroupWindow],
    visible: &mut Vec<VisibleCluster>,
) -> u64 {
    visible.clear();
    let mut triangles = 0;
    for group in groups {
        let Some(run) = mesh.groups.get(group.group as usize) else {
            continue;
        };
        let clusters = &mesh.clusters[run.start as usize..run.end as usize];
        triangles += clusters
            .iter()
            .map(|cluster| cluster.triangles.len() as u64)
            .sum::<u64>();
        let window = group
            .window
            .clone()
            .unwrap_or([0..view.width, 0..view.height]);
        let touched = clusters
            .par_iter()
            .enumerate()
            .with_min_len(512)
            .filter_map(|(i, cluster)| {
                let rows = touched_rows(cluster, view, &window)?;
                Some(VisibleCluster {
                    cluster: run.start + i as u32,
                    triangles: cluster.triangles.len() as u32,
                    rows,
                })
            });
        visible.par_extend(touched);
    }
    triangles
}

/// Finds the rows of the window that a cluster may touch; `None` if it is outside.
fn touched_rows(
    cluster: &Cluster,
    view: &LocalCamera,
    [columns, rows]: &[Range<u32>; 2],
) -> Option<Range<u32>> {
    let [low, high] = cluster.bounds;
    let corners: [Vec3; 8] = std::array::from_fn(|i| {
        let pick = |axis: usize| [low, high][i >> axis & 1][axis];
        view.project(Vec3::new(pick(0), pick(1), pick(2)))
    });
    let all = |outside: &dyn Fn(&Vec3) -> bool| corners.iter().all(outside);
    let with_margin =
        |range: &Range<u32>| [range.start as f32 - MARGIN_PX, range.end as f32 + MARGIN_PX];
    let ([left, right], [top, bottom]) = (with_margin(columns), with_margin(rows));
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
    if corners.iter().any(|h| h.z < MIN_BOUND_DEPTH_M) {
        return Some(rows.clone());
    }
    let y = corners.map(|h| h.y / h.z);
    let first = y.into_iter().fold(f32::INFINITY, f32::min) - MARGIN_PX;
    let last = y.into_iter().fold(f32::NEG_INFINITY, f32::max) + MARGIN_PX;
    Some(
        (first as u32).clamp(rows.start, rows.end)
            ..(last.ceil() as u32).clamp(rows.start, rows.end),
    )
}
