//! Triangulation of polygons.

use glam::{DVec2, DVec3};

/// Triangulates a simple polygon (at least three corners, nearly planar). Triangles are indices
/// into `corners` and keep the winding. Convex polygons become a fan about the first corner; others
/// are cut ear by ear (Meisters 1975), so that a concave outline is covered exactly once. The rest
/// of a polygon that intersects itself, when no ear is left, becomes a fan.
pub fn triangulate(corners: &[DVec3]) -> Vec<[usize; 3]> {
    let mut remaining: Vec<usize> = (0..corners.len()).collect();
    let mut triangles = Vec::with_capacity(corners.len().saturating_sub(2));
    if corners.len() > 3 {
        let flat = flatten(corners);
        let convex = |i: usize| doubled_area(&flat, neighbours(&remaining, i)) >= 0.0;
        if !(0..remaining.len()).all(convex) {
            while remaining.len() > 3 {
                let Some(ear) = (0..remaining.len()).find(|&i| is_ear(&flat, &remaining, i)) else {
                    break;
                };
                triangles.push(neighbours(&remaining, ear));
                remaining.remove(ear);
            }
        }
    }
    if let Some((&first, rest)) = remaining.split_first() {
        triangles.extend(rest.windows(2).map(|edge| [first, edge[0], edge[1]]));
    }
    triangles
}

/// Projects the polygon onto its own plane (Newell's normal), counter-clockwise, scaled to about 1.
fn flatten(corners: &[DVec3]) -> Vec<DVec2> {
    let origin = corners[0];
    let scale = corners
        .iter()
        .map(|&c| (c - origin).abs().max_element())
        .fold(0.0, f64::max);
    let relative: Vec<DVec3> = corners.iter().map(|&c| (c - origin) / scale).collect();
    let next = relative.iter().cycle().skip(1);
    let normal = relative
        .iter()
        .zip(next)
        .map(|(a, b)| a.cross(*b))
        .sum::<DVec3>();
    let (x_axis, y_axis) = normal
        .try_normalize()
        .unwrap_or(DVec3::Z)
        .any_orthonormal_pair();
    relative
        .iter()
        .map(|p| DVec2::new(p.dot(x_axis), p.dot(y_axis)))
        .collect()
}

/// Returns corner `i` of the remaining polygon between its two neighbours.
fn neighbours(remaining: &[usize], i: usize) -> [usize; 3] {
    let count = remaining.len();
    [
        remaining[(i + count - 1) % count],
        remaining[i],
        remaining[(i + 1) % count],
    ]
}

/// Returns twice the signed area: positive for a left turn.
fn doubled_area(flat: &[DVec2], [a, b, c]: [usize; 3]) -> f64 {
    (flat[b] - flat[a]).perp_dot(flat[c] - flat[a])
}

/// Returns true if a corner turns left and its triangle contains no other remaining corner.
fn is_ear(flat: &[DVec2], remaining: &[usize], i: usize) -> bool {
    let [a, b, c] = neighbours(remaining, i);
    let outside = |p: usize| {
        let same_place = [a, b, c].iter().any(|&corner| flat[corner] == flat[p]);
        same_place
            || doubled_area(flat, [a, b, p]) < 0.0
            || doubled_area(flat, [b, c, p]) < 0.0
            || doubled_area(flat, [c, a, p]) < 0.0
    };
    doubled_area(flat, [a, b, c]) > 0.0 && remaining.iter().all(|&p| outside(p))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    /// Returns the area of the triangles; fails if one has not the winding of `normal`.
    fn area(corners: &[DVec3], triangles: &[[usize; 3]], normal: DVec3) -> f64 {
        let one = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|i| corners[i]);
            let doubled = (b - a).cross(c - a).dot(normal);
            assert!(doubled >= 0.0, "winding of {t:?}");
            doubled / 2.0
        };
        triangles.iter().map(one).sum()
    }

    #[test]
    fn convex_polygon_becomes_fan() {
        let square = [
            dvec3(0.0, 0.0, 0.0),
            dvec3(1.0, 0.0, 0.0),
            dvec3(1.0, 1.0, 0.0),
            dvec3(0.0, 1.0, 0.0),
        ];
        assert_eq!(triangulate(&square), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(triangulate(&square[..3]), [[0, 1, 2]]);
        assert!(triangulate(&[]).is_empty());
    }

    #[test]
    fn concave_polygon_is_covered_once() {
        // An L of area 3 in the plane x = 1e7, from any corner. A fan would leave its outline.
        let l = [
            (0.0, 0.0),
            (2.0, 0.0),
            (2.0, 1.0),
            (1.0, 1.0),
            (1.0, 2.0),
            (0.0, 2.0),
        ];
        for start in 0..l.len() {
            let mut corners = l.map(|(y, z)| dvec3(1e7, y, z));
            corners.rotate_left(start);
            let triangles = triangulate(&corners);
            assert_eq!(triangles.len(), 4);
            assert!(
                (area(&corners, &triangles, DVec3::X) - 3.0).abs() < 1e-9,
                "start {start}"
            );
        }
    }

    #[test]
    fn invalid_polygon_terminates() {
        let crossing = [(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0), (0.5, 2.0)]
            .map(|(x, y)| dvec3(x, y, 0.0));
        assert_eq!(triangulate(&crossing).len(), 3);
        assert_eq!(triangulate(&[DVec3::NAN; 6]).len(), 4);
        assert_eq!(triangulate(&[DVec3::ONE; 5]).len(), 3);
    }
}
