//! Models of *cells* and *portals*: rooms, and the openings through which one room is visible from
//! another (R1, P1). Geometry and topology only; captures of rooms belong to the walkthrough.
//!
//! * A **cell** is a region of space: a set of vertical prisms, and the triangles in it. At most
//!   one cell is the *outside*: all space that no other cell contains.
//! * A **portal** is a planar convex polygon shared by exactly two cells. Cells are visible from
//!   each other only through portals.

pub mod bake;
mod borders;
mod box_tree;
mod check;
mod coplanar;
mod joins;
mod leaks;
pub mod load;
mod polygon;

pub use check::{Finding, Flaw, Severity};
pub use polygon::Shape;

use box_tree::{BoxTree, bounds_of, contains};
use glam::{DVec2, DVec3};
use headbox_scene::scene::Scene;
use headbox_trace::bvh::Tracer;
use std::ops::Range;
use std::sync::Arc;

/// An upright prism: a simple polygon in plan, from its floor to its ceiling.
#[derive(Clone, Debug, PartialEq)]
pub struct Prism {
    /// Corners in plan, (x, z) of the world in metres; a simple polygon, either way round, not
    /// closed.
    pub outline: Vec<DVec2>,
    /// Height of the floor, world metres.
    pub floor_y: f64,
    /// Height of the ceiling, world metres.
    pub ceiling_y: f64,
}

impl Prism {
    /// Returns a point where one can stand, at eye height (1.6 m, or lower in a low room), world
    /// metres: in the middle of the widest stretch in the X direction through the outline's middle.
    /// `None` without an area.
    pub fn standing_point(&self) -> Option<DVec3> {
        let heights = || self.outline.iter().map(|corner| corner.y);
        let low = heights().fold(f64::INFINITY, f64::min);
        let z = low.midpoint(heights().fold(f64::NEG_INFINITY, f64::max));
        let edges = self.outline.iter().zip(self.outline.iter().cycle().skip(1));
        let mut crossings: Vec<f64> = edges
            .filter(|(a, b)| (a.y <= z) != (b.y <= z))
            .map(|(a, b)| a.x + (b.x - a.x) * (z - a.y) / (b.y - a.y))
            .collect();
        crossings.sort_unstable_by(f64::total_cmp);
        let stretches = crossings.as_chunks::<2>().0.iter();
        let [from, to] = stretches.max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))?;
        let height = (self.ceiling_y - self.floor_y).max(0.0);
        let y = self.floor_y + (0.8 * height).min(1.6);
        Some(DVec3::new(from.midpoint(*to), y, z))
    }

    /// Returns true if the prism contains a point (world metres); of two prisms that share a wall,
    /// at most one contains a point of it in plan.
    pub fn contains(&self, p: DVec3) -> bool {
        if !(self.floor_y..self.ceiling_y).contains(&p.y) {
            return false;
        }
        let mut inside = false;
        let mut previous = match self.outline.last() {
            Some(&corner) => corner,
            None => return false,
        };
        for &corner in &self.outline {
            if (corner.y > p.z) != (previous.y > p.z) {
                let t = (p.z - corner.y) / (previous.y - corner.y);
                inside ^= p.x < corner.x + t * (previous.x - corner.x);
            }
            previous = corner;
        }
        inside
    }
}

/// A region of space and the triangles in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Name in messages and plans.
    pub name: String,
    /// Its space; empty for the outside cell.
    pub space: Vec<Prism>,
    /// Its triangles, a run of [`Scene::triangles`].
    pub triangles: Range<u32>,
}

impl Cell {
    /// Creates a cell without triangles.
    pub(crate) fn new(name: impl Into<String>, space: Vec<Prism>) -> Self {
        Self {
            name: name.into(),
            space,
            triangles: 0..0,
        }
    }
}

/// An opening between two cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Portal {
    /// Name in messages and plans.
    pub name: String,
    /// The two cells, by index into [`PortalModel::cells`]; they differ.
    pub cells: [u32; 2],
    /// Corners of the opening, world metres: planar, convex, at least three, counter-clockwise seen
    /// from `cells[0]`.
    pub polygon: Vec<DVec3>,
}

/// A scene divided into cells that see each other through portals.
///
/// Invariants: the cells' runs of triangles follow each other and cover all of [`Scene::triangles`]
/// (a triangle belongs to exactly one cell); portals refer to existing cells; `outside` is one of
/// the cells.
#[derive(Clone, Debug)]
pub struct PortalModel {
    /// All geometry, light and materials, triangles sorted by cell.
    pub scene: Scene,
    /// The cells.
    pub cells: Vec<Cell>,
    /// The portals.
    pub portals: Vec<Portal>,
    /// The cell that is all space outside the others, if the model has one.
    pub outside: Option<u32>,
}

impl PortalModel {
    /// Calls a function with a tracer of the scene, during which the model has no scene.
    pub(crate) fn with_tracer<T>(&mut self, function: impl FnOnce(&mut Self, &Tracer) -> T) -> T {
        let [low, high] = self.scene.bounds();
        let scene = Arc::new(std::mem::take(&mut self.scene));
        let tracer = Tracer::new(Arc::clone(&scene), (low + high) / 2.0);
        let result = function(self, &tracer);
        drop(tracer);
        self.scene = Arc::unwrap_or_clone(scene);
        result
    }

    /// Returns the cell that contains a point (world metres): the first whose space does, else the
    /// outside cell, else `None` (a point in a wall of a model without an outside).
    pub fn cell_at(&self, p: DVec3) -> Option<u32> {
        let inside = self
            .cells
            .iter()
            .position(|cell| cell.space.iter().any(|prism| prism.contains(p)));
        inside.map_or(self.outside, |cell| u32::try_from(cell).ok())
    }

    /// Builds the search structure of [`CellIndex`] over the cells' current spaces.
    fn cell_index(&self) -> CellIndex<'_> {
        let cells = (0_u32..).zip(&self.cells);
        let prisms: Vec<(u32, &Prism)> = cells
            .flat_map(|(cell, it)| it.space.iter().map(move |prism| (cell, prism)))
            .collect();
        let bounds = |prism: &Prism| {
            let ends = [prism.floor_y, prism.ceiling_y];
            let corners = prism.outline.iter();
            bounds_of(corners.flat_map(|p| ends.map(|y| DVec3::new(p.x, y, p.y))))
        };
        let boxes = prisms.iter().map(|(_, prism)| bounds(prism)).enumerate();
        CellIndex {
            tree: BoxTree::new(boxes.collect()),
            prisms,
            outside: self.outside,
        }
    }

    /// Returns the portals of a cell, as (index of the portal, the cell behind it).
    pub fn portals_from(&self, cell: u32) -> impl Iterator<Item = (usize, u32)> + '_ {
        self.portals
            .iter()
            .enumerate()
            .filter_map(move |(index, portal)| match portal.cells {
                [a, b] if a == cell => Some((index, b)),
                [a, b] if b == cell => Some((index, a)),
                _ => None,
            })
    }
}

/// Search structure for many calls of [`PortalModel::cell_at`].
struct CellIndex<'a> {
    tree: BoxTree,
    /// All prisms with their cells, in the order of the model.
    prisms: Vec<(u32, &'a Prism)>,
    outside: Option<u32>,
}

impl CellIndex<'_> {
    /// Returns what [`PortalModel::cell_at`] returns.
    fn cell_at(&self, p: DVec3) -> Option<u32> {
        let near = self.tree.items(|bounds| contains(bounds, p));
        let inside = near.filter(|&prism| self.prisms[prism].1.contains(p)).min();
        inside.map_or(self.outside, |prism| Some(self.prisms[prism].0))
    }
}

/// Visible side of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    /// The side to which its normal points.
    Front,
    /// The other side.
    Back,
    /// Unknown, or both.
    Any,
}

impl Side {
    /// Distance before and behind a surface at which its cell is looked up, metres: less than the
    /// thickness of a wall.
    pub(crate) const PROBE_M: f64 = 0.02;
}

impl PortalModel {
    /// Returns the side of each triangle that is visible from its cell: one side if the cell is
    /// somewhere in front of the triangle and nowhere on both sides of it. Besides the middle, the
    /// corners are tested: the middle of a jamb is in the wall, but its edge is visible.
    pub(crate) fn sides(&self) -> Vec<Side> {
        let mut sides = vec![Side::Any; self.scene.triangles.len()];
        for (cell, it) in (0_u32..)
            .zip(&self.cells)
            .filter(|(cell, _)| !self.is_outside(*cell))
        {
            for triangle in it.triangles.clone() {
                sides[triangle as usize] = self.side_toward(cell, self.scene.corners(triangle));
            }
        }
        sides
    }

    fn side_toward(&self, cell: u32, corners: [DVec3; 3]) -> Side {
        /// Share of the way from a corner to the middle at which a corner is tested.
        const INWARD: f64 = 0.05;
        let [a, b, c] = corners;
        let (normal, middle) = ((b - a).cross(c - a).normalize_or_zero(), (a + b + c) / 3.0);
        let positions = [middle]
            .into_iter()
            .chain(corners.map(|corner| corner.lerp(middle, INWARD)));
        let mut visible = [false; 2];
        for position in positions {
            match [1.0, -1.0]
                .map(|side| self.cell_at(position + normal * (side * Side::PROBE_M)) == Some(cell))
            {
                [true, true] => return Side::Any,
                [front, back] => visible = [visible[0] || front, visible[1] || back],
            }
        }
        match visible {
            [true, false] => Side::Front,
            [false, true] => Side::Back,
            _ => Side::Any,
        }
    }
}

/// Returns twice the signed area of a closed outline.
pub(crate) fn doubled_area(outline: &[DVec2]) -> f64 {
    let next = outline.iter().cycle().skip(1);
    outline.iter().zip(next).map(|(a, b)| a.perp_dot(*b)).sum()
}

/// Returns the distance in plan from a point to the nearest edge of a closed outline.
pub(crate) fn distance_to_outline(outline: &[DVec2], p: DVec2) -> f64 {
    let edges = outline.iter().zip(outline.iter().cycle().skip(1));
    let distance = |(&a, &b): (&DVec2, &DVec2)| {
        let along =
            ((p - a).dot(b - a) / (b - a).length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        p.distance(a.lerp(b, along))
    };
    edges.map(distance).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An L-shaped room: points in its two arms are inside, the notch is not, and of two rooms that
    /// share a wall exactly one contains a point of it.
    #[test]
    fn l_shaped_prism_contains_arms_only() {
        let corners = [
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 2.0],
            [2.0, 2.0],
            [2.0, 4.0],
            [0.0, 4.0],
        ];
        let room = Prism {
            outline: corners.map(DVec2::from).to_vec(),
            floor_y: 0.0,
            ceiling_y: 2.5,
        };
        for (p, inside) in [
            ([3.0, 1.0, 1.0], true),
            ([1.0, 1.0, 3.0], true),
            ([3.0, 1.0, 3.0], false),
        ] {
            assert_eq!(room.contains(DVec3::from(p)), inside, "{p:?}");
        }
        assert_eq!(room.standing_point(), Some(DVec3::new(1.0, 1.6, 2.0)));
        assert!(
            !room.contains(DVec3::new(1.0, 2.6, 1.0)) && !room.contains(DVec3::new(1.0, -0.1, 1.0))
        );
        let next_corners = [[4.0, 0.0], [6.0, 0.0], [6.0, 2.0], [4.0, 2.0]];
        let next = Prism {
            outline: next_corners.map(DVec2::from).to_vec(),
            floor_y: 0.0,
            ceiling_y: 2.5,
        };
        let on_the_wall = DVec3::new(4.0, 1.0, 1.0);
        assert!(room.contains(on_the_wall) != next.contains(on_the_wall));
    }
}
