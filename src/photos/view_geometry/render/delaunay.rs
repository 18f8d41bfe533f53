//! Delaunay triangulation of a frame's nodes (E8), from scratch in every frame.
//!
//! A general triangulation spends most of its time on finding neighbours. Here they are known: each
//! node lies in its own cell of a lattice. The nodes of four cells around a lattice corner form a
//! quadrilateral whose sides cannot cross (its upper side lies in the upper two cells, its lower in
//! the lower two, and so on), so that one of its diagonals lies inside, and all of them together
//! are a triangulation. From there few of Lawson's flips lead to Delaunay's, because the nodes are
//! close to their lattice. Cells without a sample take part with a node at their centre; triangles
//! at such nodes are not drawn. So points on a line, or all in one position, are no special case:
//! they lack neighbours, and give no triangle.
//!
//! Positions are integers and all predicates exact. So the flips terminate, and the mesh is the
//! same on every machine and with any number of threads, as strips have a fixed height.

use super::fuse::Grid;
use rayon::prelude::*;

/// Marks a half-edge without an opposite one.
const NONE: u32 = u32::MAX;

/// Rows of quadrilaterals in a strip; strips are triangulated independently, in parallel.
const STRIP_ROWS: usize = 16;

/// Triangle mesh of half-edges, three per triangle.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Mesh {
    /// Start node of each half-edge; half-edge 3 t + k goes from corner k of triangle t to the
    /// next.
    pub(super) corners: Vec<u32>,
    /// The opposite half-edge of each, or [`NONE`].
    twins: Vec<u32>,
    /// Number of edge flips in the last frame.
    pub(super) flips: u64,
}

impl Mesh {
    /// Triangulates all nodes of a grid, with and without a sample: first strips in parallel, then
    /// the seams between them.
    pub(super) fn triangulate(&mut self, grid: &Grid) {
        let across = grid.lattice.columns as usize - 1;
        let down = grid.lattice.rows as usize - 1;
        self.corners.resize(6 * across * down, 0);
        self.twins.resize(6 * across * down, NONE);
        let half_edges = 6 * across * STRIP_ROWS;
        let strips = self
            .corners
            .par_chunks_mut(half_edges)
            .zip(self.twins.par_chunks_mut(half_edges));
        let strips = strips.enumerate().map(|(number, (corners, twins))| {
            let mut part = MeshPart {
                grid,
                corners,
                twins,
                stack: Vec::new(),
                flips: 0,
            };
            let first_row = number * STRIP_ROWS;
            part.connect_lattice(first_row);
            part.legalise_all();
            let flips = part.flips;
            (
                part.into_seams(first_row, (number * half_edges) as u32),
                flips,
            )
        });
        let seams: Vec<(Seams, u64)> = strips.collect();
        let mut whole = MeshPart {
            grid,
            corners: &mut self.corners,
            twins: &mut self.twins,
            stack: Vec::new(),
            flips: 0,
        };
        for pair in seams.windows(2) {
            for (&above, &below) in pair[0].0.lower.iter().zip(&pair[1].0.upper) {
                whole.link(above, below);
                whole.stack.push(above);
            }
            whole.legalise();
        }
        self.flips = whole.flips + seams.iter().map(|(_, flips)| flips).sum::<u64>();
    }

    /// Corners of all triangles, including those at nodes without a sample.
    pub(crate) fn triangles(&self) -> &[[u32; 3]] {
        self.corners.as_chunks().0
    }
}

/// Mesh of nodes at chosen positions, for tests of numerical stability.
pub struct NodeMesh {
    /// Columns and rows of the nodes.
    pub size: [usize; 2],
    /// Position of each node, row by row, subpixels.
    pub positions: Vec<[i64; 2]>,
    /// Nodes at the corners of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl NodeMesh {
    /// Triangulates the grid of a frame with nodes `spacing_px` apart. `offset` displaces the node
    /// of a column and row from the centre of its cell, subpixels, given the side of a cell; a node
    /// stays in its cell.
    pub fn new(
        frame_px: [u32; 2],
        spacing_px: f32,
        mut offset: impl FnMut([usize; 2], i32) -> [i32; 2],
    ) -> Self {
        let mut grid = Grid::default();
        grid.reset(frame_px[0], frame_px[1], spacing_px);
        let side = grid.lattice.spacing;
        let size = [grid.lattice.columns, grid.lattice.rows].map(|count| count as usize);
        for node in 0..size[0] * size[1] {
            let in_cell = |offset: i32| offset.clamp(-(side / 2), side - side / 2 - 1);
            let [x, y] = offset([node % size[0], node / size[0]], side).map(in_cell);
            grid.x[node] += x;
            grid.y[node] += y;
        }
        let mut mesh = Mesh::default();
        mesh.triangulate(&grid);
        Self {
            size,
            positions: (0..grid.x.len() as u32)
                .map(|node| position(&grid, node))
                .collect(),
            triangles: mesh.triangles().to_vec(),
        }
    }
}

/// Half-edges along the upper and the lower side of a strip, from left to right.
struct Seams {
    upper: Vec<u32>,
    lower: Vec<u32>,
}

/// Some triangles of a mesh; their half-edges are numbered from 0.
struct MeshPart<'a> {
    grid: &'a Grid,
    corners: &'a mut [u32],
    twins: &'a mut [u32],
    /// Half-edges to check.
    stack: Vec<u32>,
    flips: u64,
}

impl MeshPart<'_> {
    /// Makes two triangles of each quadrilateral of adjacent nodes, from row `first_row` on.
    fn connect_lattice(&mut self, first_row: usize) {
        let columns = self.grid.lattice.columns as usize;
        let across = columns - 1;
        self.twins.fill(NONE);
        // Half-edge of the right side of the quadrilateral to the left.
        let mut right_of_last = NONE;
        for quad in 0..self.corners.len() / 6 {
            let (column, row) = (quad % across, quad / across);
            let a = ((first_row + row) * columns + column) as u32;
            let (b, c, d) = (a + 1, a + columns as u32, a + columns as u32 + 1);
            let first = 6 * quad as u32;
            // Half-edges of the sides; the upper one is the first, the lower one the fifth in
            // either case.
            let (left, right, diagonal) = if splits_down_left(self.grid, [a, b, c, d]) {
                self.corners[6 * quad..6 * quad + 6].copy_from_slice(&[a, b, c, b, d, c]);
                (first + 2, first + 3, [first + 1, first + 5])
            } else {
                self.corners[6 * quad..6 * quad + 6].copy_from_slice(&[a, b, d, a, d, c]);
                (first + 5, first + 1, [first + 2, first + 3])
            };
            self.link(diagonal[0], diagonal[1]);
            if column > 0 {
                self.link(left, right_of_last);
            }
            if row > 0 {
                self.link(first, 6 * (quad - across) as u32 + 4);
            }
            right_of_last = right;
        }
    }

    fn legalise_all(&mut self) {
        for edge in 0..self.corners.len() as u32 {
            // Each edge is checked from one side only.
            if edge < self.twins[edge as usize] && self.twins[edge as usize] != NONE {
                self.stack.push(edge);
                self.legalise();
            }
        }
    }

    /// Flips edges until no fourth corner lies inside the circumcircle of the other three.
    fn legalise(&mut self) {
        while let Some(edge) = self.stack.pop() {
            let twin = self.twins[edge as usize];
            if twin == NONE {
                continue;
            }
            let (next, previous) = neighbours(edge);
            let (twin_next, twin_previous) = neighbours(twin);
            let [from, to, apex, other] =
                [edge, next, previous, twin_previous].map(|e| self.corners[e as usize]);
            if !in_circle([from, to, apex, other].map(|node| position(self.grid, node))) {
                continue;
            }
            self.flips += 1;
            self.corners[edge as usize] = other;
            self.corners[twin as usize] = apex;
            self.link(edge, self.twins[twin_previous as usize]);
            self.link(twin, self.twins[previous as usize]);
            self.link(previous, twin_previous);
            self.stack.extend([edge, next, twin, twin_next]);
        }
    }

    fn link(&mut self, one: u32, other: u32) {
        self.twins[one as usize] = other;
        if other != NONE {
            self.twins[other as usize] = one;
        }
    }

    /// Renumbers the half-edges for the whole mesh, where they begin at `base`. No flip changes the
    /// sides of a strip, but they may belong to another of its triangles now.
    fn into_seams(self, first_row: usize, base: u32) -> Seams {
        let columns = self.grid.lattice.columns;
        let upper_row = first_row as u32;
        let lower_row = first_row as u32 + (self.corners.len() / 6) as u32 / (columns - 1);
        let mut seams = Seams {
            upper: vec![NONE; columns as usize - 1],
            lower: vec![NONE; columns as usize - 1],
        };
        for edge in 0..self.corners.len() as u32 {
            let twin = &mut self.twins[edge as usize];
            if *twin != NONE {
                *twin += base;
                continue;
            }
            let from = self.corners[edge as usize];
            let to = self.corners[neighbours(edge).0 as usize];
            let left = (from.min(to) % columns) as usize;
            match (from / columns, to / columns) {
                (a, b) if a != b => {} // the left or the right rim
                (row, _) if row == upper_row => seams.upper[left] = base + edge,
                (row, _) if row == lower_row => seams.lower[left] = base + edge,
                _ => {}
            }
        }
        seams
    }
}

/// Returns the next and the previous half-edge of a triangle.
#[inline]
fn neighbours(edge: u32) -> (u32, u32) {
    match edge % 3 {
        0 => (edge + 1, edge + 2),
        1 => (edge + 1, edge - 1),
        _ => (edge - 2, edge - 1),
    }
}

#[inline]
fn position(grid: &Grid, node: u32) -> [i64; 2] {
    [
        i64::from(grid.x[node as usize]),
        i64::from(grid.y[node as usize]),
    ]
}

/// Returns twice the signed area of a triangle; positive if its corners go from right to down.
#[inline]
pub(super) fn doubled_area([a, b, c]: [[i64; 2]; 3]) -> i64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Returns true if the quadrilateral (a, b above; c, d below) is split from b down to c instead of
/// from a to d.
#[inline]
fn splits_down_left(grid: &Grid, nodes: [u32; 4]) -> bool {
    let [a, b, c, d] = nodes.map(|node| position(grid, node));
    let inside =
        |one: [[i64; 2]; 3], other: [[i64; 2]; 3]| doubled_area(one) > 0 && doubled_area(other) > 0;
    if !inside([a, b, d], [a, d, c]) {
        return true;
    }
    inside([a, b, c], [b, d, c]) && !in_circle([a, b, c, d])
}

/// Returns true if d lies inside the circle through a, b, c, which go from right to down. The
/// result is exact: sides are below 2^23 subpixels, so that both factors of each product fit in 48
/// bits; for sides below `NEAR` everything fits in 64.
#[inline]
fn in_circle([a, b, c, d]: [[i64; 2]; 4]) -> bool {
    const NEAR: u64 = 1 << 14;
    let [a, b, c] = [a, b, c].map(|p| [p[0] - d[0], p[1] - d[1]]);
    let square = |p: [i64; 2]| p[0] * p[0] + p[1] * p[1];
    let cross = |p: [i64; 2], q: [i64; 2]| p[0] * q[1] - p[1] * q[0];
    let products = [
        (square(a), cross(b, c)),
        (square(b), cross(c, a)),
        (square(c), cross(a, b)),
    ];
    if [a, b, c]
        .as_flattened()
        .iter()
        .all(|side| side.unsigned_abs() < NEAR)
    {
        return products
            .iter()
            .map(|(square, cross)| square * cross)
            .sum::<i64>()
            > 0;
    }
    products
        .iter()
        .map(|(square, cross)| i128::from(*square) * i128::from(*cross))
        .sum::<i128>()
        > 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use spade::{DelaunayTriangulation, Point2, Triangulation};
    use std::collections::BTreeSet;

    /// A grid whose nodes lie anywhere in their cells.
    fn scattered(size: [u32; 2], spacing_px: f32, seed: u32) -> Grid {
        let mut grid = Grid::default();
        grid.reset(size[0], size[1], spacing_px);
        let spacing = grid.lattice.spacing;
        let mut state = seed;
        let mut off = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as i32 % spacing - spacing / 2
        };
        for node in 0..grid.owner.len() {
            grid.x[node] += off();
            grid.y[node] += off();
            grid.owner[node] = 0;
        }
        grid
    }

    fn edges(triangles: impl Iterator<Item = [u32; 3]>) -> BTreeSet<[u32; 2]> {
        triangles
            .flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]])
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect()
    }

    fn valid(mesh: &Mesh, grid: &Grid) -> Vec<[u32; 3]> {
        mesh.triangles()
            .iter()
            .filter(|corners| grid.has_samples(corners))
            .copied()
            .collect()
    }

    #[test]
    fn mesh_matches_general_triangulation() {
        for seed in 0..6 {
            // Of one strip, and of several.
            let grid = scattered(if seed < 3 { [60, 44] } else { [40, 205] }, 4.0, seed);
            let mut mesh = Mesh::default();
            mesh.triangulate(&grid);
            let mut general = DelaunayTriangulation::<Point2<f64>>::new();
            let mut node_of = std::collections::BTreeMap::new();
            for node in 0..grid.owner.len() {
                let handle = general.insert(Point2::new(
                    f64::from(grid.x[node]),
                    f64::from(grid.y[node]),
                ));
                node_of.insert(handle.expect("a vertex").index(), node as u32);
            }
            let theirs = edges(
                general
                    .inner_faces()
                    .map(|face| face.vertices().map(|v| node_of[&v.fix().index()])),
            );
            let ours = edges(valid(&mesh, &grid).into_iter());
            // The general one fills up to the convex hull; away from the rim both are the same.
            let inner = |node: u32| {
                let (column, row) = (node % grid.lattice.columns, node / grid.lattice.columns);
                (2..grid.lattice.columns - 2).contains(&column)
                    && (2..grid.lattice.rows - 2).contains(&row)
            };
            let is_inner = |edge: &&[u32; 2]| edge.iter().all(|node| inner(*node));
            let [ours, theirs] = [&ours, &theirs]
                .map(|edges| edges.iter().filter(is_inner).copied().collect::<Vec<_>>());
            assert!(
                ours.len() > 200 && ours == theirs,
                "seed {seed}: {} and {} edges",
                ours.len(),
                theirs.len()
            );
        }
    }

    #[test]
    fn mesh_is_delaunay_cover_of_grid() {
        for (size, spacing, seed) in [
            ([64, 40], 4.0, 1),
            ([1, 1], 4.0, 2),
            ([300, 7], 1.0, 3),
            ([90, 90], 33.3, 4),
            ([33, 500], 3.7, 5),
        ] {
            let grid = scattered(size, spacing, seed);
            let mut mesh = Mesh::default();
            mesh.triangulate(&grid);
            let area = |corners: &[u32; 3]| doubled_area(corners.map(|node| position(&grid, node)));
            let triangles = valid(&mesh, &grid);
            assert!(triangles.iter().all(|corners| area(corners) > 0));
            // The area within the rim, once more by the shoelace formula.
            let (columns, rows) = (grid.lattice.columns, grid.lattice.rows);
            let mut rim: Vec<u32> = (0..columns).collect();
            rim.extend((1..rows).map(|row| row * columns + columns - 1));
            rim.extend(
                (0..columns - 1)
                    .rev()
                    .map(|column| (rows - 1) * columns + column),
            );
            rim.extend((1..rows - 1).rev().map(|row| row * columns));
            let cross = |a: [i64; 2], b: [i64; 2]| a[0] * b[1] - a[1] * b[0];
            let around = rim.iter().zip(rim.iter().cycle().skip(1));
            let expected: i64 = around
                .map(|(a, b)| cross(position(&grid, *a), position(&grid, *b)))
                .sum();
            assert_eq!(triangles.iter().map(area).sum::<i64>(), expected);
            for edge in 0..mesh.corners.len() as u32 {
                let twin = mesh.twins[edge as usize];
                if twin == NONE {
                    continue;
                }
                assert_eq!(mesh.twins[twin as usize], edge);
                let (next, previous) = neighbours(edge);
                let corner = |e: u32| position(&grid, mesh.corners[e as usize]);
                let other = corner(neighbours(twin).1);
                assert!(!in_circle([
                    corner(edge),
                    corner(next),
                    corner(previous),
                    other
                ]));
            }
        }
    }

    #[test]
    fn nodes_without_samples_have_no_triangles() {
        let mut grid = Grid::default();
        grid.reset(64, 40, 4.0);
        let mut mesh = Mesh::default();
        mesh.triangulate(&grid);
        assert_eq!(valid(&mesh, &grid).len(), 0, "nothing");
        let line = 5 * grid.lattice.columns as usize;
        grid.owner[line..line + 12].fill(0);
        assert_eq!(valid(&mesh, &grid).len(), 0, "nodes on a line");
        grid.owner[line + 5 + grid.lattice.columns as usize] = 0;
        assert!(!valid(&mesh, &grid).is_empty(), "and one beside it");
    }

    #[test]
    fn circles_are_exact() {
        let far = 1 << 22;
        let square = [[0, 0], [far, 0], [far, far]];
        assert!(
            !in_circle([square[0], square[1], square[2], [0, far]]),
            "on the circle"
        );
        assert!(
            in_circle([square[0], square[1], square[2], [1, far]]),
            "a part of a pixel inside"
        );
        let near = (1 << 14) - 1;
        let square = |far: i64, off: i64| in_circle([[0, 0], [far, 0], [far, far], [off, far]]);
        for far in [near, near + 1] {
            assert_eq!(
                [-1, 0, 1].map(|off| square(far, off)),
                [false, false, true],
                "{far}"
            );
        }
        let square = [[0, 0], [far, 0], [far, far]];
        assert!(!in_circle([square[0], square[1], square[2], [-1, far]]));
    }
}
