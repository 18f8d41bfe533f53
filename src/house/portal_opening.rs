//! A portal as seen from one of its two cells.

use glam::{DVec2, DVec3};
use headbox_model::Portal;

/// Opening of a portal with its local frame, on the side of one of its cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Opening {
    /// Middle of the polygon's bounding rectangle, world metres.
    pub centre: DVec3,
    /// Unit vector to the right, as seen from the cell; horizontal unless the portal lies in a
    /// floor.
    pub right: DVec3,
    /// Unit vector upward in the portal's plane.
    pub up: DVec3,
    /// Unit normal, towards the viewing cell.
    pub normal: DVec3,
    /// Half of the bounding rectangle's width and height, metres.
    pub half: DVec2,
    /// Corners, world metres, counter-clockwise seen from the cell.
    pub corners: Vec<DVec3>,
}

/// Returns the edges of a closed polygon: each corner with the next one.
pub(crate) fn polygon_edges<T: Copy>(corners: &[T]) -> impl Iterator<Item = (T, T)> + '_ {
    let next = corners.iter().cycle().skip(1);
    corners.iter().copied().zip(next.copied())
}

impl Opening {
    /// Creates the opening of a portal as seen from `portal.cells[side]` (side 0 or 1); `None` if
    /// it has no area.
    pub fn new(portal: &Portal, side: usize) -> Option<Self> {
        let mut corners = portal.polygon.clone();
        if side != 0 {
            corners.reverse();
        }
        if corners.len() < 3 || corners.iter().any(|corner| !corner.is_finite()) {
            return None;
        }
        let anchor = corners[0];
        let normal: DVec3 = polygon_edges(&corners)
            .map(|(a, b)| (a - anchor).cross(b - anchor))
            .sum();
        let normal = normal.try_normalize()?;
        let right = DVec3::Y.cross(normal);
        let right = if right.length() > 0.1 {
            right
        } else {
            DVec3::Z.cross(normal)
        }
        .try_normalize()?;
        let up = normal.cross(right);
        let in_plane = |p: &DVec3| DVec2::new((*p - anchor).dot(right), (*p - anchor).dot(up));
        let [low, high] = corners
            .iter()
            .map(in_plane)
            .fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], p| {
                [low.min(p), high.max(p)]
            });
        let middle = (low + high) / 2.0;
        let centre = anchor + right * middle.x + up * middle.y;
        let half = (high - low) / 2.0;
        (half.min_element() > 0.0).then_some(Self {
            centre,
            right,
            up,
            normal,
            half,
            corners,
        })
    }

    /// Returns the distance of a point from the portal's plane, metres, positive on the side of the
    /// viewing cell.
    pub fn distance_in_front(&self, p: DVec3) -> f64 {
        self.normal.dot(p - self.centre)
    }

    /// Returns true if a point's projection on the portal's plane lies in the polygon.
    pub fn contains(&self, p: DVec3) -> bool {
        polygon_edges(&self.corners).all(|(a, b)| (b - a).cross(p - a).dot(self.normal) >= 0.0)
    }

    /// Returns the point on the plane at a position in -1..1 of the bounding rectangle, world
    /// metres.
    pub fn point(&self, at: DVec2) -> DVec3 {
        self.centre + self.right * (self.half.x * at.x) + self.up * (self.half.y * at.y)
    }

    /// Returns the distance of a point from the polygon's bounding rectangle, metres.
    pub fn distance(&self, p: DVec3) -> f64 {
        let d = p - self.centre;
        let aside = DVec2::new(d.dot(self.right), d.dot(self.up)).abs() - self.half;
        aside.max(DVec2::ZERO).extend(d.dot(self.normal)).length()
    }

    /// Returns eye positions for images: `2 * n + 1` points on a semicircle about the portal's
    /// middle, in front of it, `eye_height_m` above its lower edge (at most at its upper edge). The
    /// central one is first, then alternately to the right and to the left, from near to far (the
    /// order of P2).
    ///
    /// The papers do not specify the extent of the semicircle. An image at 90 degrees would be
    /// empty, so the outermost are at 90 n / (n + 0.5) degrees.
    pub fn semicircle(&self, n: u32, radius_m: f64, eye_height_m: f64) -> Vec<DVec3> {
        let height = (eye_height_m - self.half.y).clamp(-self.half.y, self.half.y);
        let eye = |k: i32| {
            let angle = f64::from(k) / (f64::from(n) + 0.5) * std::f64::consts::FRAC_PI_2;
            self.centre
                + self.up * height
                + (self.right * angle.sin() + self.normal * angle.cos()) * radius_m
        };
        std::iter::once(0)
            .chain((1..=n as i32).flat_map(|k| [k, -k]))
            .map(eye)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    #[test]
    fn door_has_two_sides() {
        let polygon = vec![
            dvec3(1.0, 0.0, 5.0),
            dvec3(2.0, 0.0, 5.0),
            dvec3(2.0, 2.0, 5.0),
            dvec3(1.0, 2.0, 5.0),
        ];
        let portal = Portal {
            name: "door".into(),
            cells: [0, 1],
            polygon,
        };
        let (front, back) = (
            Opening::new(&portal, 0).expect("an area"),
            Opening::new(&portal, 1).expect("an area"),
        );
        assert_eq!(
            (front.normal, front.right, front.up),
            (DVec3::Z, DVec3::X, DVec3::Y)
        );
        assert_eq!(
            (back.normal, back.right, back.centre),
            (-DVec3::Z, -DVec3::X, dvec3(1.5, 1.0, 5.0))
        );
        assert_eq!(front.half, DVec2::new(0.5, 1.0));
        let eye = dvec3(1.2, 1.6, 6.0);
        assert_eq!(
            (front.distance_in_front(eye), back.distance_in_front(eye)),
            (1.0, -1.0)
        );
        assert!(front.contains(eye) && back.contains(eye) && !front.contains(dvec3(2.2, 1.0, 5.0)));
        assert!((front.distance(dvec3(2.3, 1.0, 5.4)) - 0.5).abs() < 1e-12);
        let places = front.semicircle(6, 2.0, 1.6);
        assert_eq!(places.len(), 13);
        assert!(
            (places[0] - dvec3(1.5, 1.6, 7.0)).length() < 1e-12
                && places[1].x > 1.5
                && places[2].x < 1.5
        );
        assert!(
            places
                .iter()
                .all(|p| front.distance_in_front(*p) > 0.2 && p.y == 1.6)
        );
        let thin = Portal {
            polygon: vec![DVec3::ZERO, DVec3::X, DVec3::X * 2.0],
            ..portal
        };
        assert_eq!(Opening::new(&thin, 0), None);
    }
}
