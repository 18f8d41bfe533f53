//! Triangulation of polygons.

use glam::{DVec2, DVec3};
use headbox_core::random;
use spade::handles::FixedVertexHandle;
use spade::{
    ConstrainedDelaunayTriangulation, HierarchyHintGenerator, InsertionError, Point2,
    Triangulation, mitigate_underflow,
};
use std::collections::HashSet;

/// Triangulates a polygon (at least three corners, nearly planar). Triangles are indices into
/// `corners` and keep the winding. Convex polygons become a fan about the first corner; others are
/// triangulated by Delaunay with their edges as constraints, so that a concave outline is covered
/// exactly once. Outlines may touch themselves, as those of polygons with holes do; one that
/// crosses itself is covered in part. A polygon without area becomes a fan, too.
pub fn triangulate(corners: &[DVec3]) -> Vec<[usize; 3]> {
    if corners.len() > 3 {
        let flat = flatten(corners);
        let count = flat.len();
        let is_convex =
            |i: usize| doubled_area(&flat, [i, (i + 1) % count, (i + 2) % count]) >= 0.0;
        // A repeated corner or a spike hides a reflex corner, but not from the fan.
        let is_fan = |i: usize| doubled_area(&flat, [0, i, i + 1]) >= 0.0;
        if !(0..count).all(is_convex) || !(1..count - 1).all(is_fan) {
            let triangles = delaunay(&flat).unwrap_or_default();
            if !triangles.is_empty() {
                return triangles;
            }
        }
    }
    let last = corners.len().saturating_sub(1);
    (1..last).map(|i| [0, i, i + 1]).collect()
}

type Delaunay =
    ConstrainedDelaunayTriangulation<Point2<f64>, (), (), (), HierarchyHintGenerator<f64>>;

/// Triangulates an outline by the even-odd rule; counter-clockwise triangles.
///
/// # Errors
/// If a coordinate is not finite.
fn delaunay(outline: &[DVec2]) -> Result<Vec<[usize; 3]>, InsertionError> {
    let mut mesh = Delaunay::new();
    // Corners at the same place share a vertex.
    let mut vertices = vec![FixedVertexHandle::from_index(0); outline.len()];
    let mut first_corners = Vec::new();
    for corner in shuffled(outline.len()) {
        let DVec2 { x, y } = outline[corner];
        let vertex = mesh.insert(mitigate_underflow(Point2::new(x, y)))?;
        if vertex.index() == first_corners.len() {
            first_corners.push(corner);
        }
        vertices[corner] = vertex;
    }
    // Undirected edges that the outline follows an odd number of times: the bridge to a hole is
    // followed twice.
    let mut borders = HashSet::new();
    let next = vertices.iter().cycle().skip(1);
    for (&a, &b) in vertices.iter().zip(next).filter(|(a, b)| a != b) {
        for edge in mesh.try_add_constraint(a, b) {
            let edge = edge.as_undirected();
            if !borders.remove(&edge) {
                borders.insert(edge);
            }
        }
    }
    // From the outer face inwards, each border changes the side.
    let mut is_reached = vec![false; mesh.num_all_faces()];
    let outer = mesh.outer_face();
    is_reached[outer.index()] = true;
    let mut edges: Vec<_> = mesh.convex_hull().map(|edge| (edge.rev(), false)).collect();
    let mut triangles = Vec::new();
    while let Some((edge, is_inside)) = edges.pop() {
        // The edge belongs to the face on its near side; the face beyond is entered.
        let face = edge.face();
        if std::mem::replace(&mut is_reached[face.index()], true) {
            continue;
        }
        let is_inside = is_inside != borders.contains(&edge.as_undirected().fix());
        let Some(face) = face.as_inner() else {
            continue;
        };
        if is_inside {
            triangles.push(face.vertices().map(|vertex| first_corners[vertex.index()]));
        }
        edges.extend(face.adjacent_edges().map(|edge| (edge.rev(), is_inside)));
    }
    Ok(triangles)
}

/// Returns the numbers below `count` in a random order, the same for each count. Vertices that are
/// inserted in random order take n log n steps on average, whatever the outline; from its middle
/// outwards a smooth curve takes n^2, and along the outline two facing rows do.
fn shuffled(count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_cached_key(|&i| random::hash(i as u64));
    order
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

/// Returns twice the signed area: positive for a left turn.
fn doubled_area(flat: &[DVec2], [a, b, c]: [usize; 3]) -> f64 {
    (flat[b] - flat[a]).perp_dot(flat[c] - flat[a])
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
    fn concave_polygon_with_repeated_corner_or_spike_is_covered_once() {
        let l = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)];
        let repeated = [[(1, 1), (1, 1)], [(1, 2), (1, 1)]];
        for inserted in repeated {
            let mut outline = [&l[..4], &inserted, &l[4..]].concat();
            for _ in 0..outline.len() {
                outline.rotate_left(1);
                let corners: Vec<DVec3> = outline
                    .iter()
                    .map(|&(x, y)| dvec3(f64::from(x), f64::from(y), 0.0))
                    .collect();
                let covered = area(&corners, &triangulate(&corners), DVec3::Z);
                assert!((covered - 3.0).abs() < 1e-12, "{outline:?}");
            }
        }
    }

    #[test]
    fn hole_with_bridge_stays_open() {
        let outline = [
            (0.0, 0.0),
            (3.0, 0.0),
            (3.0, 3.0),
            (0.0, 3.0),
            (0.0, 0.0),
            (1.0, 1.0),
            (1.0, 2.0),
            (2.0, 2.0),
            (2.0, 1.0),
            (1.0, 1.0),
        ];
        let corners = outline.map(|(x, y)| dvec3(x, y, 0.0));
        assert!((area(&corners, &triangulate(&corners), DVec3::Z) - 8.0).abs() < 1e-12);
    }

    #[test]
    fn star_of_many_corners_is_covered_once() {
        let count = 5000;
        let corner = |i: usize| {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / count as f64).sin_cos();
            let radius = if i.is_multiple_of(2) { 1.0 } else { 1.3 };
            dvec3(cos * radius, sin * radius, 0.0)
        };
        let corners: Vec<DVec3> = (0..count).map(corner).collect();
        let triangles = triangulate(&corners);
        assert_eq!(triangles.len(), count - 2);
        let sine = (std::f64::consts::TAU / count as f64).sin();
        let expected = count as f64 * 1.3 * sine / 2.0;
        assert!((area(&corners, &triangles, DVec3::Z) - expected).abs() < 1e-9);
    }

    /// A smooth curve takes a minute from its middle outwards, two rows half of one along them.
    #[test]
    fn no_outline_is_quadratic() {
        let count = 100_000;
        let on_parabola = |i: usize| {
            let x = i as f64 / count as f64;
            dvec3(x, x * x, 0.0)
        };
        let notched = (0..count).map(on_parabola).chain([dvec3(0.5, 0.4, 0.0)]);
        let near = (0..count / 2).map(|i| dvec3(i as f64, 0.0, 0.0));
        let far = near.clone().rev().enumerate();
        let far = far.map(|(i, corner)| corner + DVec3::Y * (3e4 + (i % 3) as f64));
        let start = std::time::Instant::now();
        for corners in [notched.collect::<Vec<_>>(), near.chain(far).collect()] {
            assert_eq!(triangulate(&corners).len(), corners.len() - 2);
        }
        assert!(start.elapsed().as_secs() < 10, "took {:?}", start.elapsed());
    }

    #[test]
    fn invalid_polygon_terminates() {
        let crossing = [(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0), (0.5, 2.0)]
            .map(|(x, y)| dvec3(x, y, 0.0));
        // Its second crossing edge is no constraint, so that the sides are not certain.
        assert!((1..=3).contains(&triangulate(&crossing).len()));
        assert_eq!(triangulate(&[DVec3::NAN; 6]).len(), 4);
        assert_eq!(triangulate(&[DVec3::ONE; 5]).len(), 3);
    }
}
