//! Reduction of surfels to a budget: neighbours on one surface are merged in the quadtree of their
//! face, those first whose merging costs the least of what is visible from the headbox.
//!
//! * [`leaves`]: all samples, and their visibility from the headbox.
//! * [`cluster`]: moments of merged samples, and the error of drawing them as one surfel.
//!
//! A node of the quadtree groups the clusters of its four children that lie on one plane. A group
//! costs `lambda`, the squared error that it adds per surfel that it saves, at least that of its
//! members. All groups up to some `lambda` are merged: the smallest one that meets the budget, as
//! trees are pruned in classification (Breiman et al. 1984, "Classification and Regression Trees",
//! chapter 3). A merged surfel has the moments of its samples, as in Kerbl et al. 2024, "A
//! Hierarchical 3D Gaussian Representation", but those of areas instead of points, so that it
//! covers what they covered.

mod cluster;
mod leaves;

use super::surfels::Surfel;
use cluster::{Cluster, FaceGrid};
use headbox_core::progress::Progress;
use headbox_cube::pack::CubeLdi;
use leaves::{Leaf, LeafFace};
use rayon::prelude::*;

/// Number of levels of the quadtree below which a task works: blocks of 64 x 64 pixels.
const BLOCK_LEVELS: u32 = 6;
/// Number of levels of the quadtree above a pixel: more than the largest face has.
const LEVELS: u32 = 15;
/// Largest displacements of merged samples, face pixels: the first one with which the budget can be
/// met. With the last one samples are dropped.
const MAX_DISPLACEMENTS_PX: [f64; 4] = [0.25, 1.0, 4.0, 16.0];
/// Number of groups of a node that are compared with a cluster, those of the most similar depth.
const CANDIDATES: usize = 16;

/// Surfels within a budget.
pub(crate) struct Reduced {
    pub(crate) surfels: Vec<Surfel>,
    /// Number of samples whose surfels were dropped.
    pub(crate) dropped_samples: u64,
    /// Root mean square error of colours, levels of 255, weighted by solid angle and visibility:
    /// an estimate from the colours, displacements and rims of merged samples.
    pub(crate) error_levels: f64,
}

/// Surfel of merged samples.
struct MergedSurfel {
    surfel: Surfel,
    /// Sum of solid angle x visibility x coverage.
    weight: f64,
    /// Squared error of colours times weight.
    error: f64,
    /// Number of samples.
    samples: u64,
}

/// Reduces the samples of a cube, with `sky` those of the environment too, to at most `budget`
/// surfels.
pub(crate) fn reduce(cube: &CubeLdi, sky: bool, budget: usize, progress: &dyn Progress) -> Reduced {
    let mut faces = leaves::faces(cube, sky, progress);
    let total: usize = faces.iter().map(|face| face.leaves.len()).sum();
    let mut lambda = f64::INFINITY;
    for max_displacement_px in MAX_DISPLACEMENTS_PX {
        for face in &mut faces {
            face.grid.max_displacement_px = max_displacement_px;
        }
        progress.begin("finding neighbours", "samples", total as u64);
        let merges = faces.iter().flat_map(|face| {
            let tree = Tree { face, progress };
            tree.walk(|merged, members, merges| merges.push((merged.lambda, members.len() - 1)))
                .0
        });
        if let Some(found) = pruning(merges.collect(), total, budget) {
            lambda = found;
            break;
        }
    }
    progress.begin("merging", "samples", total as u64);
    let mut found: Vec<MergedSurfel> = Vec::new();
    for face in &faces {
        let tree = Tree { face, progress };
        let merged_surfel = |cluster: &Cluster| MergedSurfel {
            surfel: face.surfel(cluster),
            weight: cluster.weight,
            error: cluster.error,
            samples: cluster.count as u64,
        };
        let is_whole = |cluster: &&Cluster| cluster.lambda <= lambda;
        let (parts, roots) = tree.walk(|merged, members, parts| {
            if merged.lambda > lambda {
                parts.extend(members.iter().filter(is_whole).map(merged_surfel));
            }
        });
        found.extend(parts);
        found.extend(roots.iter().filter(is_whole).map(merged_surfel));
    }
    keep_heaviest(found, budget)
}

/// Returns the smallest `lambda` up to which merges, of a `lambda` and a number of saved surfels,
/// reduce `total` surfels to the budget; `None` if all do not.
fn pruning(mut merges: Vec<(f64, usize)>, total: usize, budget: usize) -> Option<f64> {
    merges.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut left = total;
    for (lambda, saved) in merges {
        left -= saved;
        if left <= budget {
            return Some(lambda);
        }
    }
    None
}

/// Drops the surfels with the smallest weight beyond the budget.
fn keep_heaviest(found: Vec<MergedSurfel>, budget: usize) -> Reduced {
    let mut order: Vec<usize> = (0..found.len()).collect();
    order.sort_by(|a, b| found[*b].weight.total_cmp(&found[*a].weight).then(a.cmp(b)));
    let mut is_kept = vec![false; found.len()];
    order.iter().take(budget).for_each(|i| is_kept[*i] = true);
    let (mut weight, mut error) = (0.0f64, 0.0f64);
    let mut dropped_samples = 0;
    let mut surfels = Vec::with_capacity(budget.min(found.len()));
    for (merged, is_kept) in found.into_iter().zip(is_kept) {
        weight += merged.weight;
        if is_kept {
            error += merged.error;
            surfels.push(merged.surfel);
        } else {
            error += merged.weight * cluster::RIM_ERROR;
            dropped_samples += merged.samples;
        }
    }
    Reduced {
        surfels,
        dropped_samples,
        error_levels: (error / (3.0 * weight).max(f64::MIN_POSITIVE)).sqrt(),
    }
}

/// Quadtree over a face.
struct Tree<'a> {
    face: &'a LeafFace,
    progress: &'a dyn Progress,
}

/// Node of a quadtree: its Morton number among those of its level, and its clusters.
type Node = (u32, Vec<Cluster>);

impl Tree<'_> {
    /// Visits each group of at least two clusters with the clusters that it consists of, children
    /// before parents. Returns the results in a fixed order, and the clusters of the root.
    fn walk<T: Send>(
        &self,
        visit: impl Fn(&Cluster, &[Cluster], &mut Vec<T>) + Sync,
    ) -> (Vec<T>, Vec<Cluster>) {
        let grid = &self.face.grid;
        let block = |leaf: &Leaf| leaf.morton >> (2 * BLOCK_LEVELS);
        let blocks: Vec<&[Leaf]> = self
            .face
            .leaves
            .chunk_by(|a, b| block(a) == block(b))
            .collect();
        let walk_block = |leaves: &&[Leaf]| {
            let mut results = Vec::new();
            let mut nodes: Vec<Node> = leaves
                .chunk_by(|a, b| a.morton == b.morton)
                .map(|pixel| {
                    let clusters = pixel.iter().map(|leaf| grid.cluster(leaf)).collect();
                    (
                        pixel[0].morton,
                        merge_node(grid, clusters, &visit, &mut results),
                    )
                })
                .collect();
            for _ in 0..BLOCK_LEVELS {
                nodes = raise(grid, nodes, &visit, &mut results);
            }
            self.progress.advance(leaves.len() as u64);
            (results, nodes)
        };
        let walked: Vec<(Vec<T>, Vec<Node>)> = blocks.par_iter().map(walk_block).collect();
        let (mut results, mut nodes) = (Vec::new(), Vec::new());
        for (block_results, block_nodes) in walked {
            results.extend(block_results);
            nodes.extend(block_nodes);
        }
        for _ in BLOCK_LEVELS..LEVELS {
            nodes = raise(grid, nodes, &visit, &mut results);
        }
        let roots = nodes.into_iter().flat_map(|(_, clusters)| clusters);
        (results, roots.collect())
    }
}

/// Returns the nodes of the next level.
fn raise<T>(
    grid: &FaceGrid,
    nodes: Vec<Node>,
    visit: &impl Fn(&Cluster, &[Cluster], &mut Vec<T>),
    results: &mut Vec<T>,
) -> Vec<Node> {
    let mut parents: Vec<Node> = Vec::with_capacity(nodes.len() / 4 + 1);
    for (number, clusters) in nodes {
        match parents.last_mut() {
            Some((parent, siblings)) if *parent == number >> 2 => siblings.extend(clusters),
            _ => parents.push((number >> 2, clusters)),
        }
    }
    for (_, clusters) in &mut parents {
        *clusters = merge_node(grid, std::mem::take(clusters), visit, results);
    }
    parents
}

/// Groups the clusters of a node: each joins the group on whose plane it lies and which it costs
/// the least.
fn merge_node<T>(
    grid: &FaceGrid,
    mut clusters: Vec<Cluster>,
    visit: &impl Fn(&Cluster, &[Cluster], &mut Vec<T>),
    results: &mut Vec<T>,
) -> Vec<Cluster> {
    if clusters.len() < 2 {
        return clusters;
    }
    clusters.sort_by(|a, b| {
        let near_first = b.inverse_depth().total_cmp(&a.inverse_depth());
        a.surface.cmp(&b.surface).then(near_first)
    });
    let mut groups: Vec<(Cluster, Vec<Cluster>)> = Vec::new();
    for cluster in clusters {
        let first = groups.len().saturating_sub(CANDIDATES);
        let mut best: Option<(f64, usize, Cluster)> = None;
        for (i, (group, _)) in groups.iter().enumerate().skip(first) {
            if let Some(merged) = grid.merged(group, &cluster) {
                let cost = merged.error - group.error;
                if best.as_ref().is_none_or(|(least, ..)| cost < *least) {
                    best = Some((cost, i, merged));
                }
            }
        }
        match best {
            Some((_, i, merged)) => {
                groups[i].0 = merged;
                groups[i].1.push(cluster);
            }
            None => groups.push((cluster.clone(), vec![cluster])),
        }
    }
    let close = |(mut merged, members): (Cluster, Vec<Cluster>)| {
        if members.len() > 1 {
            let before: f64 = members.iter().map(|member| member.error).sum();
            let added = (merged.error - before).max(0.0) / (members.len() - 1) as f64;
            let least = members
                .iter()
                .map(|member| member.lambda)
                .fold(0.0, f64::max);
            merged.lambda = added.max(least);
            visit(&merged, &members, results);
        }
        merged
    };
    groups.into_iter().map(close).collect()
}
