//! Planar convex polygons in space.

use super::box_tree::{Bounds, bounds_of};
use glam::DVec3;

/// Defect of a polygon that must be planar and convex.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Shape {
    /// Fewer than three corners.
    #[error("has {0} corners, fewer than three")]
    Corners(usize),
    /// A corner is NaN or infinite.
    #[error("has a corner that is not finite")]
    NotFinite,
    /// The corners lie on a line, or in a point.
    #[error("has no area")]
    NoArea,
    /// A corner is off the plane of the others.
    #[error("is not planar: a corner lies {0:.4} m off its plane")]
    NotPlanar(f64),
    /// Two edges cross.
    #[error("crosses itself")]
    CrossesItself,
    /// A corner points inward.
    #[error("is not convex")]
    NotConvex,
}

/// A planar convex polygon.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Polygon<'a> {
    /// Corners, counter-clockwise about `normal`.
    pub(crate) corners: &'a [DVec3],
    /// Mean of the corners.
    pub(crate) centroid: DVec3,
    /// Unit normal.
    pub(crate) normal: DVec3,
}

/// Maximum distance of a corner from the plane, as a share of the polygon's size ...
const FLAT_SHARE: f64 = 1e-4;
/// ... or in metres, whichever is more: files store centimetres with a few decimals.
const FLAT_M: f64 = 1e-4;

/// Sine of the maximum angle between two edges that counts as straight: corners may lie on an edge.
const STRAIGHT: f64 = 1e-6;

impl<'a> Polygon<'a> {
    /// Checks that `corners` (world metres) make a planar convex polygon.
    ///
    /// # Errors
    /// The first defect.
    pub(crate) fn new(corners: &'a [DVec3]) -> Result<Self, Shape> {
        let count = corners.len();
        if count < 3 {
            return Err(Shape::Corners(count));
        }
        if !corners.iter().all(|corner| corner.is_finite()) {
            return Err(Shape::NotFinite);
        }
        let centroid = corners.iter().sum::<DVec3>() / count as f64;
        let size = corners
            .iter()
            .map(|corner| corner.distance(centroid))
            .fold(0.0, f64::max);
        let edge = |i: usize| corners[(i + 1) % count] - corners[i % count];
        // Newell's sum: twice the area times the normal. It is zero for a figure of eight, which is
        // told apart from a polygon without area by the largest cross product of corners.
        let newell: DVec3 = (0..count)
            .map(|i| (corners[i] - centroid).cross(edge(i)))
            .sum();
        let largest = (0..count)
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .map(|(i, j)| (corners[i] - centroid).cross(corners[j] - centroid))
            .fold(DVec3::ZERO, |a, b| {
                if b.length_squared() > a.length_squared() {
                    b
                } else {
                    a
                }
            });
        if largest.length() <= size * size * STRAIGHT {
            return Err(Shape::NoArea);
        }
        let cancelled = newell.length() <= size * size * STRAIGHT;
        let normal = if cancelled { largest } else { newell }.normalize_or_zero();
        let offset = corners
            .iter()
            .map(|corner| (*corner - centroid).dot(normal).abs())
            .fold(0.0, f64::max);
        if offset > FLAT_M.max(FLAT_SHARE * size) {
            return Err(Shape::NotPlanar(offset));
        }
        if crosses_itself(corners, normal) {
            return Err(Shape::CrossesItself);
        }
        let turns_inward = |i: usize| {
            let (before, after) = (edge(i), edge(i + 1));
            before.cross(after).dot(normal) < -STRAIGHT * before.length() * after.length()
        };
        if cancelled || (0..count).any(turns_inward) {
            return Err(Shape::NotConvex);
        }
        Ok(Self {
            corners,
            centroid,
            normal,
        })
    }

    /// Returns a box around the polygon grown by `margin` metres, as [`Self::hit`] grows it: at a
    /// corner, the lines beside its edges meet farther away than that.
    pub(crate) fn grown_bounds(&self, margin: f64) -> Bounds {
        let mut corners = self.corners.to_vec();
        corners.dedup(); // an edge without length grows nothing
        while corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        let count = corners.len();
        let edge = |i: usize| (corners[(i + 1) % count] - corners[i % count]).normalize_or_zero();
        // Corners may be off the plane, and points of rays are rounded.
        let distances = corners.iter().map(|corner| corner.distance(self.centroid));
        let off_plane = FLAT_M.max(FLAT_SHARE * distances.fold(0.0, f64::max));
        let rounding = 1e-9 * self.centroid.abs().max_element();
        let grown = (0..count).flat_map(|i| {
            // The sine of half the turn at a corner is half the difference of its edges.
            let sine = (edge(i) - edge(i + count - 1)).length() / 2.0;
            let cosine = (1.0 - (sine * sine).min(1.0)).sqrt();
            let reach = margin / cosine.max(1e-9) + off_plane + rounding;
            [corners[i] - reach, corners[i] + reach]
        });
        bounds_of(grown)
    }

    /// Intersects a ray with the polygon grown by `margin` metres. Returns the ray parameter, if it
    /// is not negative.
    pub(crate) fn hit(&self, origin: DVec3, direction: DVec3, margin: f64) -> Option<f64> {
        let t = (self.centroid - origin).dot(self.normal) / direction.dot(self.normal);
        let p = origin + direction * t;
        let inside = |i: usize| {
            let (a, b) = (self.corners[i], self.corners[(i + 1) % self.corners.len()]);
            let inward = self.normal.cross(b - a).normalize_or_zero();
            (p - a).dot(inward) >= -margin
        };
        (t >= 0.0 && t.is_finite() && (0..self.corners.len()).all(inside)).then_some(t)
    }
}

/// Returns the normal of a closed outline times twice its area (Newell).
pub(super) fn area_normal(corners: &[DVec3]) -> DVec3 {
    let next = corners.iter().cycle().skip(1);
    let triangle = |(a, b): (&DVec3, &DVec3)| (*a - corners[0]).cross(*b - corners[0]);
    corners.iter().zip(next).map(triangle).sum()
}

/// Returns true if two edges of a closed outline that are not adjacent cross in the projection
/// along `normal`.
pub(super) fn crosses_itself(corners: &[DVec3], normal: DVec3) -> bool {
    let count = corners.len();
    let side = |a: DVec3, b: DVec3, p: DVec3| (b - a).cross(p - a).dot(normal);
    let edge = |i: usize| (corners[i], corners[(i + 1) % count]);
    (0..count).any(|i| {
        (i + 2..count).filter(|j| (j + 1) % count != i).any(|j| {
            let ((a, b), (c, d)) = (edge(i), edge(j));
            side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
        })
    })
}
