//! Fusion of the samples of several cameras in a grid over the frame (E7): each node holds the
//! sample nearest to the eye.
//!
//! Cameras come best first, and a later one takes a node only if it is nearer by a margin, so that
//! noise does not assign nodes to lower ranked cameras (C27). Two things that the paper leaves to
//! its triangles are done here, where neighbours are known: nodes where background shows between
//! the samples of a foreground surface are emptied, and small holes are closed along rows and
//! columns.
//!
//! Invariant: a node lies in its own cell of the lattice, with or without a sample. `delaunay`
//! relies on it.

use super::project::{Hit, Projection};
use crate::view_geometry::cameras::lattice::Lattice;
use crate::view_geometry::cameras::samples::Points;
use crate::view_geometry::{EdgeRule, GeometrySettings};
use headbox_core::image::triangle_scan::SUBPIXELS;
use rayon::prelude::*;

/// Owner of a node without a sample.
pub(crate) const NO_OWNER: u16 = u16::MAX;

/// Grid of nodes over the frame, row by row: the paper's 5-tuples as one array per component. A
/// node's point in space follows from its position and inverse depth.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Grid {
    pub(super) lattice: Lattice,
    /// Positions in the frame, subpixels.
    pub(crate) x: Vec<i32>,
    pub(crate) y: Vec<i32>,
    /// Inverse eye depth, 1/m; 0 for a node without a sample.
    pub(crate) inverse_depth: Vec<f32>,
    /// Squared distance from the eye, m^2; infinite for a node without a sample.
    distance_squared: Vec<f32>,
    /// Rank of the sample's camera, or [`NO_OWNER`].
    pub(crate) owner: Vec<u16>,
}

impl Grid {
    /// Empties the grid and adapts it to a frame's size.
    pub(super) fn reset(&mut self, width: u32, height: u32, spacing_px: f32) {
        let lattice = Lattice::new(width, height, spacing_px);
        let [columns, rows] = [lattice.columns, lattice.rows].map(|count| count as usize);
        self.lattice = lattice;
        self.x.clear();
        self.y.clear();
        for row in 0..rows {
            self.x
                .extend((0..columns).map(|column| lattice.cell_centre(column, row)[0]));
            self.y
                .resize((row + 1) * columns, lattice.cell_centre(0, row)[1]);
        }
        let count = columns * rows;
        self.inverse_depth.clear();
        self.inverse_depth.resize(count, 0.0);
        self.distance_squared.clear();
        self.distance_squared.resize(count, f32::INFINITY);
        self.owner.clear();
        self.owner.resize(count, NO_OWNER);
    }

    /// Returns true if all corners of a triangle have a sample.
    #[inline]
    pub(crate) fn has_samples(&self, corners: &[u32; 3]) -> bool {
        corners
            .iter()
            .all(|&node| self.owner[node as usize] != NO_OWNER)
    }

    /// Number of nodes with a sample.
    pub(super) fn sample_count(&self) -> usize {
        self.owner
            .iter()
            .filter(|owner| **owner != NO_OWNER)
            .count()
    }

    /// Adds the projected samples of the camera with a rank; ranks come in ascending order.
    pub(super) fn add(&mut self, rank: u16, hits: &[Hit], margin: f32) {
        let keep = (1.0 - margin).max(0.0).powi(2);
        for hit in hits {
            let node = hit.node as usize;
            let (Some(nearest), Some(owner)) = (
                self.distance_squared.get_mut(node),
                self.owner.get_mut(node),
            ) else {
                continue;
            };
            let bound = if *owner == rank {
                *nearest
            } else {
                *nearest * keep
            };
            if hit.distance_squared < bound {
                (*nearest, *owner) = (hit.distance_squared, rank);
                [self.x[node], self.y[node]] = hit.at;
                self.inverse_depth[node] = hit.inverse_depth;
            }
        }
    }

    /// Empties nodes behind most of their neighbours: where samples of a near surface are farther
    /// apart than nodes, background shows between them.
    pub(super) fn drop_leaks(&mut self, edge: &EdgeRule) {
        /// Number of nearer neighbours, of eight, that make a node an outlier. A node at a straight
        /// silhouette has three nearer ones, in a corner five.
        const NEARER: usize = 6;
        let columns = self.lattice.columns as usize;
        let spacing = self.lattice.spacing as f32 / SUBPIXELS as f32;
        let leaks: Vec<usize> = self
            .inner_nodes()
            .filter(|&node| {
                let here = self.inverse_depth[node];
                if here <= 0.0 {
                    return false;
                }
                let bound = here + edge.max_difference(here, spacing);
                let around = [
                    node - columns - 1,
                    node - columns,
                    node - columns + 1,
                    node - 1,
                    node + 1,
                    node + columns - 1,
                    node + columns,
                    node + columns + 1,
                ];
                around
                    .into_iter()
                    .filter(|&other| self.inverse_depth[other] > bound)
                    .count()
                    >= NEARER
            })
            .collect();
        for node in leaks {
            self.owner[node] = NO_OWNER;
            self.inverse_depth[node] = 0.0;
            self.distance_squared[node] = f32::INFINITY;
            [self.x[node], self.y[node]] = self.lattice.cell_centre(node % columns, node / columns);
        }
    }

    /// Closes holes of at most `most` nodes between samples in the same row or column, whichever
    /// gap is narrower. Inverse depth is interpolated linearly, as by a triangle over the hole;
    /// where the two sides are different surfaces, the farther one continues behind the other.
    pub(super) fn close_holes(&mut self, most: u32, edge: &EdgeRule) {
        let columns = self.lattice.columns as usize;
        let spacing = self.lattice.spacing as f32 / SUBPIXELS as f32;
        let most = most as usize;
        let find_sample = |mut node: usize, step: isize, limit: usize| {
            (1..=most.min(limit)).find_map(|steps| {
                node = node.wrapping_add_signed(step);
                (self.owner[node] != NO_OWNER).then_some((steps, node))
            })
        };
        let closed: Vec<(usize, f32, u16)> = (0..self.owner.len())
            .filter(|&node| most > 0 && self.owner[node] == NO_OWNER)
            .filter_map(|node| {
                let (column, row) = (node % columns, node / columns);
                let pair = |step: isize, before: usize, after: usize| {
                    let first = find_sample(node, -step, before)?;
                    let second = find_sample(node, step, after)?;
                    (first.0 + second.0 <= most + 1).then_some((first, second))
                };
                let along_row = pair(1, column, columns - 1 - column);
                let along_column =
                    pair(columns as isize, row, self.lattice.rows as usize - 1 - row);
                let ((a, first), (b, second)) = along_row
                    .into_iter()
                    .chain(along_column)
                    .min_by_key(|((a, _), (b, _))| a + b)?;
                let [ia, ib] = [first, second].map(|node| self.inverse_depth[node]);
                let farther = ia.min(ib);
                let value = if edge.is_edge(ia, ib, (a + b) as f32 * spacing) {
                    farther
                } else {
                    (ia * b as f32 + ib * a as f32) / (a + b) as f32
                };
                let takes_first = if value == farther { ia <= ib } else { a <= b };
                let owner = self.owner[if takes_first { first } else { second }];
                Some((node, value, owner))
            })
            .collect();
        for (node, inverse_depth, owner) in closed {
            self.inverse_depth[node] = inverse_depth;
            self.owner[node] = owner;
        }
    }

    /// Iterates over the nodes with eight neighbours.
    fn inner_nodes(&self) -> impl Iterator<Item = usize> {
        let (columns, rows) = (self.lattice.columns as usize, self.lattice.rows as usize);
        (1..rows - 1)
            .flat_map(move |row| (1..columns - 1).map(move |column| row * columns + column))
    }
}

/// Number of cameras whose samples are projected in parallel.
const PARALLEL_CAMERAS: usize = 8;

/// Fuses the samples of cameras, best first; `hits` are buffers for projected samples.
pub(super) fn fuse(
    grid: &mut Grid,
    hits: &mut Vec<Vec<Hit>>,
    samples: &[Points],
    frame: &Projection,
    edge: &EdgeRule,
    settings: &GeometrySettings,
) {
    let [width, height] = frame.size;
    grid.reset(width, height, settings.grid_px);
    hits.resize_with(PARALLEL_CAMERAS, Vec::new);
    for (cameras, first) in samples
        .chunks(PARALLEL_CAMERAS)
        .zip((0..NO_OWNER).step_by(PARALLEL_CAMERAS))
    {
        let lattice = &grid.lattice;
        cameras
            .par_iter()
            .zip(hits.par_iter_mut())
            .for_each(|(points, hits)| frame.project(*points, lattice, hits));
        for (hits, rank) in hits.iter().zip(first..).take(cameras.len()) {
            grid.add(rank, hits, settings.margin);
        }
    }
    grid.drop_leaks(edge);
    // Where samples are farther apart than nodes, the first pass fills the rows and columns with
    // samples, the second those between them.
    for _ in 0..2 {
        grid.close_holes(settings.close_nodes, edge);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    pub(crate) use crate::view_geometry::tests::frame_at;
    use glam::{DVec3, Vec3};
    use headbox_core::camera::Camera;
    use headbox_core::simd;

    fn settings(margin: f32) -> GeometrySettings {
        GeometrySettings {
            grid_px: 4.0,
            margin,
            close_nodes: 0,
            ..GeometrySettings::default()
        }
    }

    fn edge() -> EdgeRule {
        EdgeRule::new(50.0, 0.0)
    }

    fn fused(cameras: &[Vec<Vec3>], frame: &Camera, settings: &GeometrySettings) -> Grid {
        let axes = |points: &Vec<Vec3>| {
            [0, 1, 2].map(|axis| points.iter().map(|p| p[axis]).collect::<Vec<_>>())
        };
        let cameras: Vec<[Vec<f32>; 3]> = cameras.iter().map(axes).collect();
        let samples: Vec<Points> = cameras
            .iter()
            .map(|axes| axes.each_ref().map(Vec::as_slice))
            .collect();
        let mut grid = Grid::default();
        let projection = Projection::new(frame, DVec3::ZERO, simd::level());
        fuse(
            &mut grid,
            &mut Vec::new(),
            &samples,
            &projection,
            &edge(),
            settings,
        );
        grid
    }

    /// A position in f32 differs from one in f64 by less than this, px.
    const POSITION: f64 = 0.01;

    #[test]
    fn nodes_hold_nearest_visible_sample() {
        let frame = frame_at(DVec3::new(0.1, -0.2, 0.5), [64, 48]);
        let points: Vec<Vec3> = (0..900u32)
            .map(|i| {
                let [a, b, c] =
                    [i * 37 % 101, i * 53 % 97, i * 71 % 89].map(|n| n as f32 / 45.0 - 1.0);
                Vec3::new(2.0 * a, 2.0 * b, -2.0 + c)
            })
            .collect();
        let grid = fused(std::slice::from_ref(&points), &frame, &settings(0.0));
        let mut nearest = vec![None::<(f64, [f64; 3])>; grid.owner.len()];
        for point in &points {
            let Some(at) = frame.project(point.as_dvec3()) else {
                continue;
            };
            let cell = |px: f64, count: u32| {
                Some((px / 4.0 + 1.5).floor()).filter(|n| (0.0..f64::from(count)).contains(n))
            };
            let (Some(column), Some(row)) = (
                cell(at[0], grid.lattice.columns),
                cell(at[1], grid.lattice.rows),
            ) else {
                continue;
            };
            let distance = (point.as_dvec3() - frame.eye()).length();
            let node = &mut nearest[row as usize * grid.lattice.columns as usize + column as usize];
            if node.is_none_or(|(nearest, _)| distance < nearest) {
                *node = Some((distance, at));
            }
        }
        let mut emptied = 0;
        for (node, expected) in nearest.iter().enumerate() {
            let Some((_, [x, y, depth])) = expected else {
                assert_eq!(grid.owner[node], NO_OWNER);
                continue;
            };
            if grid.owner[node] == NO_OWNER {
                emptied += 1; // a leak
                continue;
            }
            let found =
                [grid.x[node], grid.y[node]].map(|part| f64::from(part) / f64::from(SUBPIXELS));
            assert!(
                (found[0] - x).abs() < POSITION && (found[1] - y).abs() < POSITION,
                "{found:?} {x} {y}"
            );
            assert!((f64::from(grid.inverse_depth[node]) * depth - 1.0).abs() < 1e-5);
        }
        assert!(
            grid.sample_count() > 150 && emptied < 20,
            "{} {emptied}",
            grid.sample_count()
        );
    }

    #[test]
    fn better_camera_keeps_node_within_margin() {
        let frame = frame_at(DVec3::ZERO, [64, 48]);
        let at = |depth: f32| vec![Vec3::new(0.01, 0.01, -depth)];
        let owner = |cameras: &[Vec<Vec3>], margin| {
            let grid = fused(cameras, &frame, &settings(margin));
            grid.owner.iter().copied().find(|owner| *owner != NO_OWNER)
        };
        assert_eq!(
            owner(&[at(2.0), at(1.99)], 0.0),
            Some(1),
            "the paper's rule"
        );
        assert_eq!(owner(&[at(2.0), at(1.99)], 0.02), Some(0));
        assert_eq!(
            owner(&[at(2.0), at(1.9)], 0.02),
            Some(1),
            "nearer by more than the margin"
        );
        assert_eq!(owner(&[[at(2.0), at(1.99)].concat()], 0.02), Some(0));
        assert_eq!(
            owner(&[vec![Vec3::Z, Vec3::ZERO, Vec3::NAN]], 0.02),
            None,
            "behind, at the eye, nowhere"
        );
    }

    #[test]
    fn sparse_samples_leave_no_holes() {
        let frame = frame_at(DVec3::ZERO, [96, 72]);
        let focal = frame.focal_px() as f32;
        // Every third node, and every fourth, both ways.
        for apart in [12, 16] {
            let of_row =
                |y: u32| (0..8u32).map(move |x| [x, y].map(|at| (at * apart) as f32 + 1.0));
            let point =
                |[x, y]: [f32; 2]| Vec3::new((x - 48.0) / focal, (36.0 - y) / focal, -1.0) * 3.0;
            let points: Vec<Vec3> = (0..6).flat_map(of_row).map(point).collect();
            let settings = GeometrySettings {
                grid_px: 4.0,
                ..GeometrySettings::default()
            };
            let grid = fused(&[points], &frame, &settings);
            let columns = grid.lattice.columns as usize;
            let open = |node: &usize| grid.owner[*node] == NO_OWNER;
            // Between the first sample, in the node that is one from the rim, and the last in the
            // frame.
            let (last_column, last_row) = (1 + 80 / apart * apart / 4, 1 + 60 / apart * apart / 4);
            let within = (1..=last_row as usize).flat_map(|row| {
                (1..=last_column as usize).map(move |column| row * columns + column)
            });
            assert_eq!(within.filter(open).count(), 0, "{apart} px apart");
        }
    }

    #[test]
    fn positions_stay_in_their_cells() {
        let frame = frame_at(DVec3::ZERO, [97, 61]);
        for spacing in [1.0, 3.3, 7.004, 400.0] {
            let points: Vec<Vec3> = (0..5000u32)
                .map(|i| {
                    Vec3::new(
                        (i % 71) as f32 / 35.0 - 1.0,
                        (i % 67) as f32 / 33.0 - 1.0,
                        -1.0 - (i % 3) as f32,
                    )
                })
                .collect();
            let settings = GeometrySettings {
                grid_px: spacing,
                close_nodes: 2,
                ..GeometrySettings::default()
            };
            let grid = fused(&[points], &frame, &settings);
            let Lattice {
                columns, spacing, ..
            } = grid.lattice;
            let columns = columns as i32;
            for node in 0..grid.owner.len() as i32 {
                for (at, number) in [
                    (grid.x[node as usize], node % columns),
                    (grid.y[node as usize], node / columns),
                ] {
                    let from_middle = at - (number - 1) * spacing;
                    assert!(-(spacing / 2) <= from_middle && from_middle <= (spacing - 1) / 2);
                }
            }
        }
    }

    /// A grid whose rows all hold these inverse depths, 0 for nothing.
    fn rows_of(values: &[f32]) -> Grid {
        let mut grid = Grid::default();
        grid.reset(4 * (values.len() as u32 - 4), 40, 4.0);
        assert_eq!(grid.lattice.columns as usize, values.len());
        for node in 0..grid.owner.len() {
            let value = values[node % values.len()];
            grid.inverse_depth[node] = value;
            grid.owner[node] = if value > 0.0 {
                (node % values.len()) as u16
            } else {
                NO_OWNER
            };
        }
        grid
    }

    #[test]
    fn holes_filled_from_both_sides_or_behind() {
        let mut grid = rows_of(&[1.0, 1.0, 0.0, 0.0, 1.3, 1.3, 1.3]);
        grid.close_holes(2, &EdgeRule::new(5.0, 0.0));
        assert!(
            (grid.inverse_depth[2] - 1.1).abs() < 1e-6
                && (grid.inverse_depth[3] - 1.2).abs() < 1e-6
        );
        assert_eq!(grid.owner[..7], [0, 1, 1, 4, 4, 5, 6]);
        let mut grid = rows_of(&[1.0, 1.0, 0.0, 0.0, 4.0, 4.0, 4.0]);
        grid.close_holes(2, &EdgeRule::new(500.0, 0.0));
        assert_eq!(
            grid.inverse_depth[..4],
            [1.0; 4],
            "the farther surface goes on"
        );
        let mut grid = rows_of(&[1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0]);
        grid.close_holes(2, &edge());
        assert_eq!(
            grid.inverse_depth[..7],
            [1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0],
            "too wide, or open to one side"
        );
    }

    #[test]
    fn background_leaks_are_dropped() {
        let mut grid = rows_of(&[1.0, 1.0, 1.0, 1.0, 1.0, 3.0, 3.0, 3.0]);
        let before = grid.clone();
        let edge = EdgeRule::new(50.0, 0.0);
        grid.drop_leaks(&edge);
        assert_eq!(grid, before, "a straight rim stays");
        let middle = 5 * grid.lattice.columns as usize + 6;
        grid.inverse_depth[middle] = 1.0;
        grid.drop_leaks(&edge);
        assert_eq!(grid.owner[middle], NO_OWNER);
        assert_eq!(grid.sample_count() + 1, before.sample_count());
    }
}
