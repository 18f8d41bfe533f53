//! Cuts of polygons by planes.

use glam::DVec3;
use headbox_scene::scene::Vertex;

/// A corner of a polygon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Corner {
    pub(super) vertex: Vertex,
    /// Index of the vertex in the scene, unless it is new.
    pub(super) index: Option<u32>,
}

/// Distance from the plane within which a corner is on it, metres: cuts must not leave slivers.
const ON_PLANE_M: f64 = 1e-4;

impl Corner {
    /// Interpolates on the edge to `other`, at `t` (0 to 1) of the way.
    fn toward(&self, other: &Self, t: f64) -> Self {
        let (a, b) = (self.vertex, other.vertex);
        let s = t as f32;
        let vertex = Vertex {
            position: a.position.lerp(b.position, t),
            normal: a.normal.lerp(b.normal, s),
            texcoord: a.texcoord.lerp(b.texcoord, s),
            emission_texcoord: a.emission_texcoord.lerp(b.emission_texcoord, s),
            color: a.color.lerp(b.color, s),
            opacity: a.opacity + (b.opacity - a.opacity) * s,
        };
        Self {
            vertex,
            index: None,
        }
    }
}

/// Splits a convex polygon by the plane through `from` perpendicular to `across`; returns the
/// polygon itself if it is on one side.
pub(super) fn split_by_plane(polygon: Vec<Corner>, from: DVec3, across: DVec3) -> Vec<Vec<Corner>> {
    let Some(across) = across.try_normalize() else {
        return vec![polygon];
    };
    let distance = |corner: &Corner| (corner.vertex.position - from).dot(across);
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
    if a.vertex.position.to_array() <= b.vertex.position.to_array() {
        a.toward(b, at_a / (at_a - at_b))
    } else {
        b.toward(a, at_b / (at_b - at_a))
    }
}
