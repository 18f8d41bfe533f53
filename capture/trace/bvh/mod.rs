//! Ray tracing: the tree, its traversal, and the intersection of rays with triangles.
//!
//! `obvhs` builds a binary tree (`build`); `tree` turns it into nodes of eight children with the
//! triangles in leaf order. Packets of 16 coherent rays (`packet`) walk it together while they
//! agree and one by one below that (`single`).
//!
//! # What makes a hit
//!
//! A hit is a function of the ray, the triangle and the leaf that holds it, never of the order of
//! traversal, the SIMD level or the other rays of a packet:
//!
//! 1. the edge functions of the sheared triangle all have one sign, zero included (Woop, Benthin
//!    and Wald, "Watertight Ray/Triangle Intersection", JCGT 2013; `triangle` says why no ray slips
//!    between two triangles);
//! 2. the ray passes the box of the triangle's leaf, enlarged so that no rounding error can lose a
//!    hit (`prepared`);
//! 3. `t` is not less than where the ray enters that box. Entering distances never fall from a box
//!    to one inside it, because every operation in them is monotone. So a box that is entered
//!    beyond the closest hit so far holds no closer one, whatever the traversal;
//! 4. a cut-out texture, where there is one, is opaque there.
//!
//! The closest hit is the smallest (t, primitive index), with overlapping triangles in one plane
//! resolved by orientation and order ([`headbox_scene::coplanar`]). No operation is contracted or
//! approximated.

mod build;
mod cutout;
mod lanes;
mod packet;
mod prepared;
mod single;
mod tree;
mod triangle;
mod triangle_cache;

pub use lanes::{HitPacket, PACKET, RayPacket};
pub use triangle_cache::triangle_extent;

use cutout::Cutouts;
use fearless_simd::{Level, dispatch};
use glam::{DVec3, Vec3};
use headbox_scene::coplanar::CoplanarTriangles;
use headbox_scene::scene::{Scene, Surface};
use std::sync::Arc;
use tree::Tree;
use triangle_cache::CachedTriangle;

/// A ray in the tracer's local frame (world axes, metres, relative to the tracer's origin).
///
/// A ray whose origin is farther than [`MAX_COORDINATE`] from the tracer's origin in any
/// coordinate, whose direction is zero, not finite, or has a largest component outside
/// [`DIRECTION_RANGE`], or whose `t_min` is negative, hits nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start.
    pub origin: Vec3,
    /// Direction, need not be normalised.
    pub direction: Vec3,
    /// Minimum distance of hits, in units of the direction's length.
    pub t_min: f32,
    /// Maximum distance of hits, in the same unit.
    pub t_max: f32,
}

impl Ray {
    /// Creates a ray without limits of distance.
    #[inline]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self {
            origin,
            direction,
            t_min: 0.0,
            t_max: f32::INFINITY,
        }
    }
}

/// Intersection of a ray with a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in units of the ray direction's length.
    pub t: f32,
    /// Index into [`headbox_scene::scene::Scene::triangles`].
    pub primitive: u32,
    /// Barycentric weight of the triangle's second vertex.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex.
    pub v: f32,
}

/// The largest absolute coordinate of a ray's origin or of a triangle's vertex, metres: 2^40.
/// Beyond it the products in the box tests could overflow; such triangles are not hit and such rays
/// hit nothing.
pub const MAX_COORDINATE: f32 = 1.099_511_6e12;

/// Bounds of the largest absolute component of a ray's direction: 2^-40 to 2^40, for the same
/// reason.
pub const DIRECTION_RANGE: std::ops::RangeInclusive<f32> = 9.094_947e-13..=1.099_511_6e12;

/// Acceleration structure of a scene.
///
/// Triangles with a vertex that is not finite or exceeds [`MAX_COORDINATE`], and triangles without
/// area, are left out and never hit.
#[derive(Debug)]
pub struct Tracer {
    scene: Arc<Scene>,
    origin: DVec3,
    tree: Tree,
    cutouts: Cutouts,
    coplanar: CoplanarTriangles,
    cached: Vec<CachedTriangle>,
    level: Level,
}

impl Tracer {
    /// Builds the tree over `scene`. `origin` (world metres) is subtracted from its positions in
    /// `f64` before they become `f32`; rays and hits are in that local frame. Uses the best SIMD
    /// level of the CPU.
    pub fn new(scene: Arc<Scene>, origin: DVec3) -> Self {
        Self::with_level(scene, origin, headbox_core::simd::level())
    }

    /// Builds the tree like [`Self::new`] for a given SIMD level; every level gives the same bits.
    pub fn with_level(scene: Arc<Scene>, origin: DVec3, level: Level) -> Self {
        let cutouts = Cutouts::new(&scene);
        let (tree, coplanar) = rayon::join(
            || build::build(&scene, origin, &cutouts),
            || CoplanarTriangles::find(&scene),
        );
        let cached = triangle_cache::cache_triangles(&scene, origin);
        Self {
            scene,
            origin,
            tree,
            cutouts,
            coplanar,
            cached,
            level,
        }
    }

    /// Returns the scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Returns the world position of the local frame's origin, metres.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Returns the local positions of a triangle's vertices, metres; NaN if there is no such
    /// triangle.
    pub fn triangle(&self, primitive: u32) -> [Vec3; 3] {
        build::local_triangle(&self.scene, self.origin, primitive).unwrap_or([Vec3::NAN; 3])
    }

    /// Returns the cached [`Scene::geometric_normal`]; +Y if there is no such triangle.
    #[inline]
    pub fn geometric_normal(&self, primitive: u32) -> Vec3 {
        self.cached
            .get(primitive as usize)
            .map_or(Vec3::Y, |cached| cached.normal)
    }

    /// Returns the largest absolute coordinate of a triangle in the local frame, metres; 0 if there
    /// is no such triangle.
    #[inline]
    pub fn extent(&self, primitive: u32) -> f32 {
        self.cached
            .get(primitive as usize)
            .map_or(0.0, |cached| cached.extent)
    }

    /// Returns true if a triangle is visible to a ray along `direction` at barycentric weights `u`
    /// and `v`: not cut out, not the back of a single-sided surface, and not replaced by a coplanar
    /// triangle.
    pub fn is_visible(&self, direction: Vec3, primitive: u32, u: f32, v: f32) -> bool {
        let hit = Hit {
            t: 0.0,
            primitive,
            u,
            v,
        };
        let is_absent = || {
            build::is_single_sided(&self.scene, primitive)
                && self.geometric_normal(primitive).dot(direction) > 0.0
        };
        self.cutouts.is_opaque(&self.scene, primitive, [u, v])
            && !is_absent()
            && self.resolve_coplanar(direction, hit).primitive == primitive
    }

    /// Replaces a hit by that on the coplanar triangle that a ray along `direction` meets
    /// ([`CoplanarTriangles::resolve`]).
    #[inline]
    fn resolve_coplanar(&self, direction: Vec3, hit: Hit) -> Hit {
        if !self.coplanar.is_shared(hit.primitive) {
            return hit;
        }
        let is_facing = self.geometric_normal(hit.primitive).dot(direction) < 0.0;
        let (primitive, u, v) = self.coplanar.resolve(
            is_facing,
            (hit.primitive, hit.u, hit.v),
            |primitive, weights| self.cutouts.is_opaque(&self.scene, primitive, weights),
        );
        Hit {
            t: hit.t,
            primitive,
            u,
            v,
        }
    }

    /// Returns [`Scene::surface`] with the cached normal.
    pub fn surface(&self, primitive: u32, u: f32, v: f32) -> Surface {
        self.scene
            .surface_facing(primitive, self.geometric_normal(primitive), u, v)
    }

    /// Returns the closest hit of a ray, the smallest (t, primitive) of all its hits; of
    /// overlapping triangles in one plane the last one that faces the ray, or else the last one.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        let mut closest = single::ClosestQuery::new(ray.t_max);
        dispatch!(self.level, simd => single::search(simd, self, ray, &mut closest));
        closest
            .hit()
            .map(|hit| self.resolve_coplanar(ray.direction, hit))
    }

    /// Returns true if the ray hits anything between `t_min` and `t_max`.
    pub fn occluded(&self, ray: &Ray) -> bool {
        let mut occluded = single::OcclusionQuery::new(ray.t_max);
        dispatch!(self.level, simd => single::search(simd, self, ray, &mut occluded));
        occluded.blocked()
    }

    /// Calls `visit` with every hit on the ray exactly once, in the order of (t, primitive).
    pub fn all_hits(&self, ray: &Ray, visit: &mut dyn FnMut(Hit)) {
        let mut all = single::AllHitsQuery::new(ray.t_max);
        dispatch!(self.level, simd => single::search(simd, self, ray, &mut all));
        all.into_sorted().into_iter().for_each(visit);
    }

    /// Returns the closest hits of the active rays of a packet, bit-identical to those of
    /// [`Self::closest`].
    pub fn closest_packet(&self, rays: &RayPacket) -> HitPacket {
        let mut hits = HitPacket::MISS;
        self.closest_packets(std::slice::from_ref(rays), std::slice::from_mut(&mut hits));
        hits
    }

    /// Traces each packet of a slice like [`Self::closest_packet`], faster than one call each.
    /// Stops at the end of the shorter slice.
    pub fn closest_packets(&self, rays: &[RayPacket], hits: &mut [HitPacket]) {
        dispatch!(self.level, simd => packet::closest(simd, self, rays, hits));
        if self.coplanar.is_empty() {
            return;
        }
        for (rays, hits) in rays.iter().zip(hits) {
            for k in 0..PACKET {
                let (Some(ray), Some(hit)) = (rays.ray(k), hits.hit(k)) else {
                    continue;
                };
                let hit = self.resolve_coplanar(ray.direction, hit);
                (hits.primitive[k], hits.u[k], hits.v[k]) = (hit.primitive, hit.u, hit.v);
            }
        }
    }

    /// Returns a mask of the occluded active rays of a packet: bit k is [`Self::occluded`] of ray
    /// k.
    pub fn occluded_packet(&self, rays: &RayPacket) -> u16 {
        let mut blocked = 0;
        self.occluded_packets(
            std::slice::from_ref(rays),
            std::slice::from_mut(&mut blocked),
        );
        blocked
    }

    /// Traces each packet of a slice like [`Self::occluded_packet`]. Stops at the end of the
    /// shorter slice.
    pub fn occluded_packets(&self, rays: &[RayPacket], blocked: &mut [u16]) {
        dispatch!(self.level, simd => packet::occluded(simd, self, rays, blocked));
    }
}

#[cfg(test)]
mod tests;
