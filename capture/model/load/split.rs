//! Cuts of polygons by planes.

use glam::{DVec3, Vec2, Vec3};

/// A corner of a polygon with its vertex attributes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Corner {
    pub(super) position: DVec3,
    pub(super) normal: Vec3,
    pub(super) texcoord: Vec2,
    pub(super) color: Vec3,
    /// Its vertex, unless it is new.
    pub(super) vertex: Option<u32>,
}

/// Distance from the plane within which a corner is on it, metres: cuts must not leave slivers.
const ON_PLANE_M: f64 = 1e-4;

impl Corner {
    /// Interpolates on the edge to `other`, at `t` (0 to 1) of the way.
    fn toward(&self, other: &Self, t: f64) -> Self {
        let s = t as f32;
        Self {
            position: self.position.lerp(other.position, t),
            normal: self.normal.lerp(other.normal, s),
            texcoord: self.texcoord.lerp(other.texcoord, s),
            color: self.color.lerp(other.color, s),
            vertex: None,
        }
    }
}

/// Splits a convex polygon by the plane through `from` perpendicular to `across`; returns the
/// polygon itself if it is on one side.
pub(super) fn split_by_plane(polygon: Vec<Corner>, from: DVec3, across: DVec3) -> Vec<Vec<Corner>> {
    let Some(across) = across.try_normalize() else {
        return vec![polygon];
    };
    let distance = |corner: &Corner| (corner.position - from).dot(across);
    let distances: Vec<f64> = polygon.iter().map(distance).collect();
    let lies_beyond = |sign: f64| distances.iter().any(|d| d * sign > ON_PLANE_M);
    if !(lies_beyond(1.0) && lies_beyond(-1.0)) {
        return vec![polygon];
    }
    let (mut front, mut back) = (Vec::new(), Vec::new());
    for (i, corner) in polygon.iter().enumerate() {
        let j = (i + 1) % polygon.len();
        let (here, there) = (distances[i], distances[j]);
        if here >= -ON_PLANE_M {
            front.push(*corner);
        }
        if here <= ON_PLANE_M {
            back.push(*corner);
        }
        if (here > ON_PLANE_M && there < -ON_PLANE_M) || (here < -ON_PLANE_M && there > ON_PLANE_M)
        {
            let cut = cut_edge((corner, here), (&polygon[j], there));
            front.push(cut);
            back.push(cut);
        }
    }
    [front, back]
        .into_iter()
        .filter(|piece| piece.len() >= 3)
        .collect()
}

/// Intersects an edge with the plane. The result has the same bits from either end, so that
/// adjacent triangles meet.
fn cut_edge((a, at_a): (&Corner, f64), (b, at_b): (&Corner, f64)) -> Corner {
    if a.position.to_array() <= b.position.to_array() {
        a.toward(b, at_a / (at_a - at_b))
    } else {
        b.toward(a, at_b / (at_b - at_a))
    }
}
