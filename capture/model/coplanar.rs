//! Surfaces that lie in one plane over each other: which of them shows is left to rounding, so that
//! they flicker.

use super::{Finding, PortalModel};
use glam::{DVec2, DVec3};
use std::collections::{BTreeMap, HashMap};

/// Two planes are one if they are no farther apart, metres: a depth buffer tells what is farther
/// apart at a room's distance.
const ONE_PLANE_M: f64 = 1e-4;
/// Components of unit normals are told apart by this.
const ONE_NORMAL: f64 = 1e-3;
/// Less in a cell is not said, square metres: joints of furniture.
const LEAST_M2: f64 = 0.1;

/// A triangle in its plane.
struct Flat {
    cell: u32,
    material: u32,
    corners: [DVec2; 3],
    low: DVec2,
    high: DVec2,
}

/// A plane that faces one way: its normal and offset on a grid.
type Plane = [i64; 4];

impl PortalModel {
    /// Finds triangles of different materials that overlap in one plane, facing the same way: one
    /// finding for each cell, with the area and the centre of the largest overlap.
    pub fn coplanar(&self) -> Vec<Finding> {
        let mut planes: HashMap<Plane, Vec<Flat>> = HashMap::new();
        for (cell, it) in (0_u32..).zip(&self.cells) {
            for triangle in it.triangles.clone() {
                if let Some((plane, flat)) = self.flat(cell, triangle) {
                    planes.entry(plane).or_default().push(flat);
                }
            }
        }
        // For each cell: the area in all, the largest place and its middle.
        let mut cells: BTreeMap<u32, (f64, f64, DVec3)> = BTreeMap::new();
        let mut sorted: Vec<(Plane, Vec<Flat>)> = planes.into_iter().collect();
        sorted.sort_by_key(|(plane, _)| *plane);
        for (plane, mut flats) in sorted {
            flats.sort_by(|a, b| a.low.x.total_cmp(&b.low.x));
            for (i, a) in flats.iter().enumerate() {
                for b in flats[i + 1..].iter().take_while(|b| b.low.x < a.high.x) {
                    if a.material == b.material
                        || a.cell != b.cell
                        || b.low.y >= a.high.y
                        || a.low.y >= b.high.y
                    {
                        continue;
                    }
                    let (area, middle) = overlap(&a.corners, &b.corners);
                    let entry = cells.entry(a.cell).or_insert((0.0, 0.0, DVec3::ZERO));
                    entry.0 += area;
                    if area > entry.1 {
                        (entry.1, entry.2) = (area, lift(plane, middle));
                    }
                }
            }
        }
        let finding = |(cell, (area, _, at)): (u32, (f64, f64, DVec3))| {
            let name = self.cells[cell as usize].name.clone();
            (area >= LEAST_M2).then_some(Finding::Coplanar {
                cell: name,
                area,
                at,
            })
        };
        cells.into_iter().filter_map(finding).collect()
    }

    fn flat(&self, cell: u32, triangle: u32) -> Option<(Plane, Flat)> {
        let [a, b, c] = self.scene.corners(triangle);
        let normal = (b - a).cross(c - a).try_normalize()?;
        let direction = normal / ONE_NORMAL;
        let on_grid = |x: f64| x.round() as i64;
        // By the normal on the grid, so that all corners of one plane are projected alike.
        let axes = [direction.x, direction.y, direction.z].map(on_grid);
        let rounded = DVec3::from(axes.map(|x| x as f64)).try_normalize()?;
        let plane = [
            axes[0],
            axes[1],
            axes[2],
            on_grid(a.dot(rounded) / ONE_PLANE_M),
        ];
        let [u, v] = frame(plane);
        let corners = [a, b, c].map(|p| DVec2::new(p.dot(u), p.dot(v)));
        let (low, high) = (
            corners[0].min(corners[1]).min(corners[2]),
            corners[0].max(corners[1]).max(corners[2]),
        );
        let material = self.scene.triangles.get(triangle as usize)?.material;
        Some((
            plane,
            Flat {
                cell,
                material,
                corners,
                low,
                high,
            },
        ))
    }
}

/// Two unit vectors along a plane, counter-clockwise about its normal.
fn frame(plane: Plane) -> [DVec3; 2] {
    let normal = DVec3::from([plane[0], plane[1], plane[2]].map(|x| x as f64)).normalize_or_zero();
    let u = normal.any_orthonormal_vector();
    [u, normal.cross(u)]
}

/// A point of a plane in space.
fn lift(plane: Plane, p: DVec2) -> DVec3 {
    let [u, v] = frame(plane);
    u * p.x + v * p.y + u.cross(v) * (plane[3] as f64 * ONE_PLANE_M)
}

/// Area that two counter-clockwise triangles share, and the middle of its corners
/// (Sutherland-Hodgman).
fn overlap(a: &[DVec2; 3], b: &[DVec2; 3]) -> (f64, DVec2) {
    let mut polygon = a.to_vec();
    for i in 0..3 {
        let (from, to) = (b[i], b[(i + 1) % 3]);
        let side = |p: DVec2| (to - from).perp_dot(p - from);
        let mut kept = Vec::with_capacity(polygon.len() + 1);
        for (k, &p) in polygon.iter().enumerate() {
            let q = polygon[(k + 1) % polygon.len()];
            let (at_p, at_q) = (side(p), side(q));
            if at_p >= 0.0 {
                kept.push(p);
            }
            if (at_p > 0.0 && at_q < 0.0) || (at_p < 0.0 && at_q > 0.0) {
                kept.push(p.lerp(q, at_p / (at_p - at_q)));
            }
        }
        polygon = kept;
    }
    let next = polygon.iter().cycle().skip(1);
    let doubled: f64 = polygon.iter().zip(next).map(|(p, q)| p.perp_dot(*q)).sum();
    (
        doubled / 2.0,
        polygon.iter().sum::<DVec2>() / polygon.len().max(1) as f64,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_share_what_both_cover() {
        let at = |corners: [[f64; 2]; 3]| corners.map(DVec2::from);
        let whole = at([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]]);
        assert_eq!(overlap(&whole, &whole).0, 2.0);
        assert_eq!(
            overlap(&whole, &at([[1.0, 0.0], [3.0, 0.0], [1.0, 2.0]])).0,
            0.5
        );
        assert_eq!(
            overlap(&whole, &at([[2.0, 2.0], [0.0, 2.0], [2.0, 0.0]])).0,
            0.0,
            "side by side"
        );
        assert_eq!(
            overlap(&whole, &at([[5.0, 5.0], [6.0, 5.0], [5.0, 6.0]])).0,
            0.0
        );
    }
}
