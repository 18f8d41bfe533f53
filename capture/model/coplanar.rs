//! Overlapping surfaces in one plane: rounding decides which of them is visible, so that they
//! flicker (z-fighting).

use super::{Finding, PortalModel, doubled_area};
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;

/// Quantisation step of plane offsets, metres. A depth buffer separates planes that are farther
/// apart at a room's distance.
const OFFSET_STEP_M: f64 = 1e-4;
/// Quantisation step of the components of unit normals.
const NORMAL_STEP: f64 = 1e-3;
/// Minimum reported overlap of a cell, square metres; joints of furniture have less.
const MIN_AREA_M2: f64 = 0.1;

/// A triangle projected onto its plane.
struct PlanarTriangle {
    cell: u32,
    material: u32,
    corners: [DVec2; 3],
    low: DVec2,
    high: DVec2,
}

/// An oriented plane: its quantised unit normal and offset.
type Plane = [i64; 4];

impl PortalModel {
    /// Finds triangles of different materials that overlap in one plane, facing the same way: one
    /// finding for each cell, with the area and the centre of the largest overlap.
    pub(crate) fn find_coplanar(&self) -> Vec<Finding> {
        let mut planes: BTreeMap<Plane, Vec<PlanarTriangle>> = BTreeMap::new();
        for (cell, it) in (0_u32..).zip(&self.cells) {
            for triangle in it.triangles.clone() {
                if let Some((plane, planar)) = self.project(cell, triangle) {
                    planes.entry(plane).or_default().push(planar);
                }
            }
        }
        // For each cell: total area, area of the largest overlap and its centre.
        let mut cells: BTreeMap<u32, (f64, f64, DVec3)> = BTreeMap::new();
        for (plane, mut triangles) in planes {
            triangles.sort_by(|a, b| a.low.x.total_cmp(&b.low.x));
            for (i, a) in triangles.iter().enumerate() {
                for b in triangles[i + 1..].iter().take_while(|b| b.low.x < a.high.x) {
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
                        (entry.1, entry.2) = (area, unproject(plane, middle));
                    }
                }
            }
        }
        let finding = |(cell, (area, _, at)): (u32, (f64, f64, DVec3))| {
            (area >= MIN_AREA_M2).then(|| Finding::Coplanar {
                cell: self.cells[cell as usize].name.clone(),
                area,
                at,
            })
        };
        cells.into_iter().filter_map(finding).collect()
    }

    /// Projects a triangle onto its plane; `None` if it has no area.
    fn project(&self, cell: u32, triangle: u32) -> Option<(Plane, PlanarTriangle)> {
        let [a, b, c] = self.scene.corners(triangle);
        let normal = (b - a).cross(c - a).try_normalize()?;
        let quantise = |x: f64| x.round() as i64;
        // The projection uses the quantised normal, so that it is the same for all triangles of a
        // plane.
        let [x, y, z] = (normal / NORMAL_STEP).to_array().map(quantise);
        let rounded = DVec3::from([x, y, z].map(|x| x as f64)).try_normalize()?;
        let plane = [x, y, z, quantise(a.dot(rounded) / OFFSET_STEP_M)];
        let [u, v] = basis(plane);
        let corners = [a, b, c].map(|p| DVec2::new(p.dot(u), p.dot(v)));
        let planar = PlanarTriangle {
            cell,
            material: self.scene.triangles[triangle as usize].material,
            corners,
            low: corners[0].min(corners[1]).min(corners[2]),
            high: corners[0].max(corners[1]).max(corners[2]),
        };
        Some((plane, planar))
    }
}

/// Returns two unit vectors along a plane, counter-clockwise about its normal.
fn basis(plane: Plane) -> [DVec3; 2] {
    let normal = DVec3::from([plane[0], plane[1], plane[2]].map(|x| x as f64)).normalize_or_zero();
    let u = normal.any_orthonormal_vector();
    [u, normal.cross(u)]
}

/// Returns the world position of a point on a plane.
fn unproject(plane: Plane, p: DVec2) -> DVec3 {
    let [u, v] = basis(plane);
    u * p.x + v * p.y + u.cross(v) * (plane[3] as f64 * OFFSET_STEP_M)
}

/// Clips two counter-clockwise triangles against each other (Sutherland-Hodgman). Returns the area
/// of the overlap and the mean of its corners.
fn overlap(a: &[DVec2; 3], b: &[DVec2; 3]) -> (f64, DVec2) {
    let mut polygon = a.to_vec();
    for i in 0..3 {
        let (from, to) = (b[i], b[(i + 1) % 3]);
        let side = |p: DVec2| (to - from).perp_dot(p - from);
        let mut clipped = Vec::with_capacity(polygon.len() + 1);
        for (k, &p) in polygon.iter().enumerate() {
            let q = polygon[(k + 1) % polygon.len()];
            let (at_p, at_q) = (side(p), side(q));
            if at_p >= 0.0 {
                clipped.push(p);
            }
            if (at_p > 0.0 && at_q < 0.0) || (at_p < 0.0 && at_q > 0.0) {
                clipped.push(p.lerp(q, at_p / (at_p - at_q)));
            }
        }
        polygon = clipped;
    }
    let mean = polygon.iter().sum::<DVec2>() / polygon.len().max(1) as f64;
    (doubled_area(&polygon) / 2.0, mean)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlap_is_common_area() {
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
