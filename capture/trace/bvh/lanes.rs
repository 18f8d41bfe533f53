//! Structure-of-arrays packets: rays, hits, the state of their searches, and prepared rays.

use super::Ray;
use super::prepared::{Prepared, Slab, each_axis, is_valid, largest, main_axis, shear_axes};
use super::triangle::Candidate;
use glam::Vec3;

/// Number of rays of a packet.
pub const PACKET: usize = 16;

/// 16 rays, best with nearby origins and directions. Any rays are traced correctly; those that do
/// not agree in the signs of their directions are traced one by one.
#[repr(C, align(64))]
#[derive(Clone, Debug, PartialEq)]
pub struct RayPacket {
    /// Starts, `[axis][ray]`, local metres.
    pub origin: [[f32; PACKET]; 3],
    /// Directions, `[axis][ray]`; need not be normalised.
    pub direction: [[f32; PACKET]; 3],
    /// [`Ray::t_min`] of each ray.
    pub t_min: [f32; PACKET],
    /// [`Ray::t_max`] of each ray.
    pub t_max: [f32; PACKET],
    /// Mask of the rays to trace: bit k for ray k.
    pub active: u16,
}

impl RayPacket {
    /// A packet without active rays.
    pub const EMPTY: Self = Self {
        origin: [[0.0; PACKET]; 3],
        direction: [[0.0; PACKET]; 3],
        t_min: [0.0; PACKET],
        t_max: [f32::INFINITY; PACKET],
        active: 0,
    };

    /// Creates a packet of the first [`PACKET`] rays of a slice, all active.
    pub fn from_rays(rays: &[Ray]) -> Self {
        let mut packet = Self::EMPTY;
        for (k, ray) in rays.iter().take(PACKET).enumerate() {
            packet.set(k, ray);
        }
        packet
    }

    /// Sets ray `k` and makes it active. Ignored unless `k` is less than [`PACKET`].
    #[inline]
    pub fn set(&mut self, k: usize, ray: &Ray) {
        if k < PACKET {
            for axis in 0..3 {
                self.origin[axis][k] = ray.origin[axis];
                self.direction[axis][k] = ray.direction[axis];
            }
            self.t_min[k] = ray.t_min;
            self.t_max[k] = ray.t_max;
            self.active |= 1 << k;
        }
    }

    /// Returns ray `k`, or `None` if it is not active.
    #[inline]
    pub fn ray(&self, k: usize) -> Option<Ray> {
        (k < PACKET && self.active >> k & 1 == 1).then(|| Ray {
            origin: Vec3::from_array(each_axis!(a => self.origin[a][k])),
            direction: Vec3::from_array(each_axis!(a => self.direction[a][k])),
            t_min: self.t_min[k],
            t_max: self.t_max[k],
        })
    }
}

/// The closest hits of a packet's rays.
#[repr(C, align(64))]
#[derive(Clone, Debug, PartialEq)]
pub struct HitPacket {
    /// [`super::Hit::t`]; infinite where the ray hits nothing or is not active.
    pub t: [f32; PACKET],
    /// [`super::Hit::primitive`]; `u32::MAX` where there is no hit.
    pub primitive: [u32; PACKET],
    /// [`super::Hit::u`]; 0 where there is no hit.
    pub u: [f32; PACKET],
    /// [`super::Hit::v`]; 0 where there is no hit.
    pub v: [f32; PACKET],
}

impl HitPacket {
    /// Packet without hits.
    pub const MISS: Self = Self {
        t: [f32::INFINITY; PACKET],
        primitive: [u32::MAX; PACKET],
        u: [0.0; PACKET],
        v: [0.0; PACKET],
    };

    /// Returns the hit of ray `k`, if there is one.
    #[inline]
    pub fn hit(&self, k: usize) -> Option<super::Hit> {
        let primitive = *self.primitive.get(k)?;
        (primitive != u32::MAX).then(|| super::Hit {
            t: self.t[k],
            primitive,
            u: self.u[k],
            v: self.v[k],
        })
    }
}

/// State of 16 searches.
#[repr(C, align(64))]
pub(super) struct Lanes {
    pub(super) t: [f32; PACKET],
    pub(super) primitive: [u32; PACKET],
    /// Barycentric weights of the second and third vertex, over `determinant`.
    pub(super) v: [f32; PACKET],
    pub(super) w: [f32; PACKET],
    pub(super) determinant: [f32; PACKET],
    /// For occlusion: rays that need no further search. Their `t` is minus infinity.
    pub(super) blocked: u16,
}

impl Lanes {
    #[inline(always)]
    pub(super) fn new(rays: &RayPacket) -> Self {
        Self {
            t: rays.t_max,
            primitive: [u32::MAX; PACKET],
            v: [0.0; PACKET],
            w: [0.0; PACKET],
            determinant: [1.0; PACKET],
            blocked: 0,
        }
    }

    #[inline(always)]
    pub(super) fn candidate(&self, k: usize) -> Candidate {
        Candidate {
            t: self.t[k],
            v: self.v[k],
            w: self.w[k],
            determinant: self.determinant[k],
        }
    }

    #[inline(always)]
    pub(super) fn set(&mut self, k: usize, primitive: u32, candidate: Candidate) {
        self.primitive[k] = primitive;
        (self.t[k], self.v[k], self.w[k]) = (candidate.t, candidate.v, candidate.w);
        self.determinant[k] = candidate.determinant;
    }

    #[inline(always)]
    pub(super) fn block(&mut self, k: usize) {
        self.t[k] = f32::NEG_INFINITY;
        self.blocked |= 1 << k;
    }

    #[inline(always)]
    pub(super) fn hits(&self) -> HitPacket {
        let mut hits = HitPacket::MISS;
        for k in 0..PACKET {
            let [u, v] = self.candidate(k).barycentric();
            let missed = self.primitive[k] == u32::MAX;
            hits.t[k] = if missed { f32::INFINITY } else { self.t[k] };
            hits.primitive[k] = self.primitive[k];
            hits.u[k] = if missed { 0.0 } else { u };
            hits.v[k] = if missed { 0.0 } else { v };
        }
        hits
    }
}

/// Per-ray constants of a packet's traversal: [`Prepared`] as structure of arrays.
#[repr(C, align(64))]
pub(super) struct PreparedPacket {
    pub(super) near_origin: [[f32; PACKET]; 3],
    pub(super) far_origin: [[f32; PACKET]; 3],
    pub(super) inverse: [[f32; PACKET]; 3],
    pub(super) shear: [[f32; PACKET]; 2],
    pub(super) inverse_main: [f32; PACKET],
    pub(super) main_axis: [u32; PACKET],
    pub(super) valid: [bool; PACKET],
}

impl PreparedPacket {
    /// Prepares the rays of a packet. Free of branches, so that it is vectorised.
    #[inline(always)]
    pub(super) fn new(rays: &RayPacket) -> Self {
        let mut p = Self {
            near_origin: [[0.0; PACKET]; 3],
            far_origin: [[0.0; PACKET]; 3],
            inverse: [[0.0; PACKET]; 3],
            shear: [[0.0; PACKET]; 2],
            inverse_main: [0.0; PACKET],
            main_axis: [0; PACKET],
            valid: [false; PACKET],
        };
        for k in 0..PACKET {
            let (origin, direction) = (
                each_axis!(a => rays.origin[a][k]),
                each_axis!(a => rays.direction[a][k]),
            );
            let (largest_origin, largest_direction) = (largest(origin), largest(direction));
            let sum =
                origin[0] + origin[1] + origin[2] + direction[0] + direction[1] + direction[2];
            p.valid[k] = is_valid(
                largest_origin,
                largest_direction,
                sum,
                rays.t_min[k],
                rays.t_max[k],
            );
            for axis in 0..3 {
                let slab = Slab::new(
                    origin[axis],
                    direction[axis],
                    largest_origin,
                    largest_direction,
                );
                p.near_origin[axis][k] = slab.near_origin;
                p.far_origin[axis][k] = slab.far_origin;
                p.inverse[axis][k] = slab.inverse;
            }
            let main = main_axis(direction);
            let pick = |v: [f32; 3], shift: u32| {
                let axis = main + shift; // 0 to 4, cyclic
                if axis == 1 || axis == 4 {
                    v[1]
                } else if axis == 2 {
                    v[2]
                } else {
                    v[0]
                }
            };
            let inverse = [p.inverse[0][k], p.inverse[1][k], p.inverse[2][k]];
            p.main_axis[k] = main;
            p.inverse_main[k] = pick(inverse, 0);
            p.shear[0][k] = pick(direction, 1) * p.inverse_main[k];
            p.shear[1][k] = pick(direction, 2) * p.inverse_main[k];
        }
        p
    }

    /// Extracts ray `k`.
    #[inline(always)]
    pub(super) fn ray(&self, rays: &RayPacket, k: usize) -> Prepared {
        let axes = shear_axes(self.main_axis[k]);
        Prepared {
            slabs: each_axis!(a => Slab {
                near_origin: self.near_origin[a][k],
                far_origin: self.far_origin[a][k],
                inverse: self.inverse[a][k],
            }),
            axes,
            origin: each_axis!(i => rays.origin[axes[i]][k]),
            shear: [self.shear[0][k], self.shear[1][k]],
            t_min: rays.t_min[k],
        }
    }
}
