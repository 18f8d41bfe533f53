//! Coincident triangles: visibility by orientation.
//!
//! Models represent a wall with differently painted sides as two triangles on the same three
//! points. Rounding decides which of them is closer along a ray, so that a captured wall would be
//! speckled with the colour of its other side. Here the ray hits the first triangle that faces it,
//! or, if none does, the first one.

use super::Hit;
use crate::bvh::build;
use glam::{DVec3, Vec3};
use headbox_scene::scene::Scene;
use rustc_hash::FxHashMap;

/// Replacement of a triangle by a coincident one.
#[derive(Clone, Copy, Debug)]
struct Replacement {
    primitive: u32,
    /// Index of its corner at each corner of the triangle that was hit.
    corner: [u8; 3],
}

/// All coincident triangles of a scene.
#[derive(Debug)]
pub(super) struct CoincidentTriangles {
    /// Replacements of each coincident triangle for rays that hit its front and its back.
    replacements: FxHashMap<u32, [Replacement; 2]>,
    /// Bit set of the coincident triangles: a fast test at every hit, nearly always false.
    shared: Vec<u64>,
}

/// A triangle with its corners in a canonical order.
struct Member {
    corners: [[u32; 3]; 3],
    /// Position of each of its corners in that order.
    rank: [u8; 3],
    primitive: u32,
}

impl Member {
    fn new(primitive: u32, corners: [Vec3; 3]) -> Self {
        // Adding zero makes -0 equal to 0.
        let bits = corners.map(|corner| (corner + Vec3::ZERO).to_array().map(f32::to_bits));
        let mut order = [0usize, 1, 2];
        order.sort_by_key(|&i| bits[i]);
        let mut rank = [0; 3];
        (0..)
            .zip(order)
            .for_each(|(position, corner)| rank[corner] = position);
        Self {
            corners: order.map(|i| bits[i]),
            rank,
            primitive,
        }
    }

    /// Returns true if the triangle has the orientation of the canonical order.
    fn is_even(&self) -> bool {
        matches!(self.rank, [0, 1, 2] | [1, 2, 0] | [2, 0, 1])
    }

    /// Returns the replacement of `self` by the coincident `other`.
    fn replace_by(&self, other: &Self) -> Replacement {
        let corner = self
            .rank
            .map(|rank| other.rank.iter().position(|&r| r == rank).unwrap_or(0) as u8);
        Replacement {
            primitive: other.primitive,
            corner,
        }
    }
}

impl CoincidentTriangles {
    /// Finds coincident triangles, except those with cut-outs, whose holes may differ.
    pub(super) fn find(scene: &Scene, origin: DVec3) -> Self {
        let is_whole = |primitive: &u32| {
            let material = scene.triangles[*primitive as usize].material;
            scene
                .materials
                .get(material as usize)
                .is_some_and(|material| material.cutout.is_none())
        };
        let mut members: Vec<Member> = (0..scene.triangles.len() as u32)
            .filter(is_whole)
            .filter_map(|primitive| {
                Some(Member::new(
                    primitive,
                    build::local_triangle(scene, origin, primitive)?,
                ))
            })
            .collect();
        members.sort_unstable_by_key(|member| (member.corners, member.primitive));
        let mut replacements = FxHashMap::default();
        let mut shared = vec![0; scene.triangles.len().div_ceil(64)];
        for group in members
            .chunk_by(|a, b| a.corners == b.corners)
            .filter(|group| group.len() > 1)
        {
            for member in group {
                let oriented = |even: bool| {
                    group
                        .iter()
                        .find(|other| other.is_even() == even)
                        .unwrap_or(&group[0])
                };
                let sides = [oriented(member.is_even()), oriented(!member.is_even())];
                replacements.insert(
                    member.primitive,
                    sides.map(|other| member.replace_by(other)),
                );
                shared[member.primitive as usize / 64] |= 1 << (member.primitive % 64);
            }
        }
        Self {
            replacements,
            shared,
        }
    }

    /// Returns true if no triangles coincide.
    pub(super) fn is_empty(&self) -> bool {
        self.replacements.is_empty()
    }

    /// Returns true if a triangle coincides with another.
    #[inline]
    fn is_shared(&self, primitive: u32) -> bool {
        self.shared
            .get(primitive as usize / 64)
            .is_some_and(|bits| bits >> (primitive % 64) & 1 == 1)
    }

    /// Replaces a hit by that on the coincident triangle that faces the ray; `corners` returns
    /// those of a triangle.
    pub(super) fn facing(
        &self,
        direction: Vec3,
        hit: Hit,
        corners: impl Fn(u32) -> [Vec3; 3],
    ) -> Hit {
        if !self.is_shared(hit.primitive) {
            return hit;
        }
        let Some(sides) = self.replacements.get(&hit.primitive) else {
            return hit;
        };
        let [a, b, c] = corners(hit.primitive);
        let hits_back = (b - a).cross(c - a).dot(direction) > 0.0;
        let Replacement { primitive, corner } = sides[usize::from(hits_back)];
        let mut weights = [0.0; 3];
        (corner.into_iter().zip([1.0 - hit.u - hit.v, hit.u, hit.v]))
            .for_each(|(i, w)| weights[usize::from(i)] = w);
        Hit {
            t: hit.t,
            primitive,
            u: weights[1],
            v: weights[2],
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::bvh::{Ray, RayPacket, Tracer};
    use glam::{DVec3, Vec3, dvec3};
    use headbox_scene::material::Material;
    use headbox_scene::scene::{Scene, Triangle};
    use std::sync::Arc;

    #[test]
    fn ray_hits_first_facing_triangle() {
        let orders = [[0, 2, 1], [1, 2, 0], [1, 0, 2], [2, 0, 1]];
        let triangles = orders.map(|vertices| Triangle {
            vertices,
            material: 0,
        });
        let scene = Arc::new(Scene {
            positions: vec![
                dvec3(-1.0, -1.0, -0.0),
                dvec3(2.0, -1.0, 0.0),
                dvec3(0.0, 3.0, 0.0),
            ],
            triangles: triangles.to_vec(),
            materials: vec![Material::default()],
            ..Scene::default()
        });
        let tracer = Tracer::new(Arc::clone(&scene), DVec3::ZERO);
        // From +Z the corners 0, 1, 2 run counter-clockwise: the front of triangles 1 and 3.
        for (z, expected) in [(5.0, 1), (-5.0, 0)] {
            for i in 0..20 {
                let target = Vec3::new(0.05 * i as f32 - 0.4, 0.3 * (i % 5) as f32 - 0.6, 0.0);
                let origin = Vec3::new(0.3, 0.1, z);
                let ray = Ray::new(origin, target - origin);
                let hit = tracer.closest(&ray).expect("inside the triangle");
                assert_eq!(hit.primitive, expected);
                let [a, b, c] = tracer.triangle(expected);
                let point = a + (b - a) * hit.u + (c - a) * hit.v;
                assert!(
                    (point - target).length() < 1e-5,
                    "{point} {target}: rounding of f32"
                );
                assert_eq!(
                    tracer.closest_packet(&RayPacket::from_rays(&[ray])).hit(0),
                    Some(hit)
                );
            }
        }
        let alone = Scene {
            triangles: triangles[..1].to_vec(),
            ..(*scene).clone()
        };
        let tracer = Tracer::new(Arc::new(alone), DVec3::ZERO);
        let hit = tracer.closest(&Ray::new(Vec3::Z, -Vec3::Z));
        assert_eq!(hit.map(|hit| hit.primitive), Some(0));
    }
}
