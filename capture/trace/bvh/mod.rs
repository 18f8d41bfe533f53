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
//! The closest hit is the least (t, primitive index), told of the right one of triangles in the
//! same place (`twins`). No operation is contracted or approximated.

mod build;
mod cutout;
mod facts;
mod lanes;
mod packet;
mod prepared;
mod single;
mod tree;
mod triangle;
mod twins;

pub use facts::extent_of;
pub use lanes::{HitPacket, PACKET, RayPacket};

use cutout::Cutouts;
use facts::Facts;
use fearless_simd::{Level, dispatch};
use glam::{DVec3, Vec3};
use headbox_scene::scene::Scene;
use headbox_scene::scene::Surface;
use std::sync::Arc;
use tree::Tree;
use twins::Twins;

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
    /// Hits nearer than this (in units of the direction's length) are not seen.
    pub t_min: f32,
    /// Hits farther than this are not seen.
    pub t_max: f32,
}

/// Where a ray met a triangle.
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

/// A scene ready to be hit by rays.
///
/// Triangles with a vertex that is not finite or exceeds [`MAX_COORDINATE`], and triangles without
/// area, are left out and never hit.
#[derive(Debug)]
pub struct Tracer {
    scene: Arc<Scene>,
    origin: DVec3,
    tree: Tree,
    cutouts: Cutouts,
    twins: Twins,
    facts: Vec<Facts>,
    level: Level,
}

impl Tracer {
    /// Builds the tree over `scene`, whose positions are taken relative to `origin` (world metres)
    /// in `f64` before they become `f32`. Rays and hits are in that local frame. Uses the best SIMD
    /// level of the CPU.
    pub fn new(scene: Arc<Scene>, origin: DVec3) -> Self {
        Self::with_level(scene, origin, headbox_core::simd::level())
    }

    /// As [`Self::new`], at a given SIMD level: every level gives the same bits.
    pub fn with_level(scene: Arc<Scene>, origin: DVec3, level: Level) -> Self {
        let cutouts = Cutouts::new(&scene);
        let tree = build::build(&scene, origin, &cutouts);
        let twins = Twins::find(&scene, origin);
        let facts = facts::of_all(&scene, origin);
        Self {
            scene,
            origin,
            tree,
            cutouts,
            twins,
            facts,
            level,
        }
    }

    /// The scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// World position of the local frame's origin, metres.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Local positions of a triangle's vertices, metres; NaN if there is no such triangle.
    pub fn triangle(&self, primitive: u32) -> [Vec3; 3] {
        build::local_triangle(&self.scene, self.origin, primitive).unwrap_or([Vec3::NAN; 3])
    }

    /// As [`Scene::geometric_normal`]; straight up if there is no such triangle.
    #[inline]
    pub fn geometric_normal(&self, primitive: u32) -> Vec3 {
        self.facts
            .get(primitive as usize)
            .map_or(Vec3::Y, |facts| facts.normal)
    }

    /// Largest absolute coordinate of a triangle in the local frame, metres; 0 if there is no such
    /// triangle.
    #[inline]
    pub fn extent(&self, primitive: u32) -> f32 {
        self.facts
            .get(primitive as usize)
            .map_or(0.0, |facts| facts.extent)
    }

    /// Whether a ray along `direction` that meets a triangle at barycentric weights `u` and `v`
    /// sees it there: not in a hole of it, and not where another one in the same place turns its
    /// front to the ray.
    pub fn is_seen(&self, direction: Vec3, primitive: u32, u: f32, v: f32) -> bool {
        let hit = Hit {
            t: 0.0,
            primitive,
            u,
            v,
        };
        self.cutouts.is_there(&self.scene, primitive, [u, v])
            && self
                .twins
                .facing(direction, hit, |primitive| self.triangle(primitive))
                .primitive
                == primitive
    }

    /// As [`Scene::surface`].
    pub fn surface(&self, primitive: u32, u: f32, v: f32) -> Surface {
        self.scene
            .surface_facing(primitive, self.geometric_normal(primitive), u, v)
    }

    /// The closest hit of a ray, the least (t, primitive) of all its hits; of triangles in exactly
    /// the same place, the first that turns its front to the ray, or else the first.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        let mut found = single::Closest::new(ray.t_max);
        dispatch!(self.level, simd => single::search(simd, self, ray, &mut found));
        found.hit().map(|hit| {
            self.twins
                .facing(ray.direction, hit, |primitive| self.triangle(primitive))
        })
    }

    /// Whether anything lies on the ray between `t_min` and `t_max`.
    pub fn occluded(&self, ray: &Ray) -> bool {
        let mut found = single::Occluded::new(ray.t_max);
        dispatch!(self.level, simd => single::search(simd, self, ray, &mut found));
        found.blocked()
    }

    /// Calls `visit` with every hit on the ray exactly once, in the order of (t, primitive).
    pub fn all_hits(&self, ray: &Ray, visit: &mut dyn FnMut(Hit)) {
        let mut found = single::All::new(ray.t_max);
        dispatch!(self.level, simd => single::search(simd, self, ray, &mut found));
        found.into_sorted().into_iter().for_each(visit);
    }

    /// The closest hits of the active rays of a packet: the same bits as [`Self::closest`] gives
    /// for each.
    pub fn closest_packet(&self, rays: &RayPacket) -> HitPacket {
        let mut hits = HitPacket::MISS;
        self.closest_packets(std::slice::from_ref(rays), std::slice::from_mut(&mut hits));
        hits
    }

    /// As [`Self::closest_packet`] for each packet of a slice, faster than one call each. Stops at
    /// the end of the shorter slice.
    pub fn closest_packets(&self, rays: &[RayPacket], hits: &mut [HitPacket]) {
        dispatch!(self.level, simd => packet::closest(simd, self, rays, hits));
        if self.twins.is_empty() {
            return;
        }
        for (rays, hits) in rays.iter().zip(hits) {
            for k in 0..PACKET {
                let (Some(ray), Some(hit)) = (rays.ray(k), hits.hit(k)) else {
                    continue;
                };
                let hit = self
                    .twins
                    .facing(ray.direction, hit, |primitive| self.triangle(primitive));
                (hits.primitive[k], hits.u[k], hits.v[k]) = (hit.primitive, hit.u, hit.v);
            }
        }
    }

    /// Which active rays of a packet are blocked: bit k belongs to ray k, as [`Self::occluded`]
    /// says of it.
    pub fn occluded_packet(&self, rays: &RayPacket) -> u16 {
        let mut blocked = 0;
        self.occluded_packets(
            std::slice::from_ref(rays),
            std::slice::from_mut(&mut blocked),
        );
        blocked
    }

    /// As [`Self::occluded_packet`] for each packet of a slice. Stops at the end of the shorter
    /// slice.
    pub fn occluded_packets(&self, rays: &[RayPacket], blocked: &mut [u16]) {
        dispatch!(self.level, simd => packet::occluded(simd, self, rays, blocked));
    }
}
