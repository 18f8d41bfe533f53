//! Per-ray constants of traversal: those of the box test and of the shear.
//!
//! # Box test
//!
//! Per axis the ray is between the planes of a box from `(near_plane - near_origin) * inverse` to
//! `(far_plane - far_origin) * inverse`. Rounding must not lose a hit. Errors are at most a few
//! units of 2^-24 relative to |vertex - origin|, which is at most |vertex| + |origin|: those of the
//! shear in `triangle` (about 4), and of the two operations of the box test itself and the rounded
//! reciprocal (about 3; Ize, "Robust BVH Ray Traversal", JCGT 2013). So each leaf's box grows by
//! [`GROWTH`] times its own largest absolute coordinate when it is built, and the rest is taken off
//! here, by moving the origin away from each plane by [`GROWTH`] times its own largest absolute
//! coordinate. Growing in space rather than in `t` also keeps rays that run inside a box's plane.
//!
//! No NaN arises: a component of the direction that is zero or tiny counts as 2^-40 of the largest,
//! which moves the ray by less than the growth.

use super::{DIRECTION_RANGE, MAX_COORDINATE, Ray};

/// Growth of boxes relative to the largest absolute coordinate: 2^-20, or 16 units of 2^-24 where
/// about 7 are needed (see the module). At 10 m this is 10 micrometres: it costs no speed.
pub(super) const GROWTH: f32 = 9.536_743e-7;

/// Minimum ratio of a direction component to the largest; smaller ones are raised to it: 2^-40.
const SMALLEST_SHARE: f32 = 9.094_947e-13;

/// Constants of a ray on one axis.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Slab {
    /// Subtracted from the plane through which the ray enters.
    pub(super) near_origin: f32,
    /// Subtracted from the plane through which the ray leaves.
    pub(super) far_origin: f32,
    /// Reciprocal of the direction's component; never zero, never infinite. Its sign determines the
    /// near plane.
    pub(super) inverse: f32,
}

impl Slab {
    #[inline(always)]
    pub(super) fn new(
        origin: f32,
        direction: f32,
        largest_origin: f32,
        largest_direction: f32,
    ) -> Self {
        let growth = (largest_origin * GROWTH).copysign(direction);
        let inverse = 1.0 / larger(direction.abs(), largest_direction * SMALLEST_SHARE);
        Self {
            near_origin: origin + growth,
            far_origin: origin - growth,
            inverse: inverse.copysign(direction),
        }
    }
}

/// Expands to an array of three: the body with `a` = 0, 1 and 2. Not a closure: one that is not
/// `#[inline(always)]` would be compiled without the SIMD level's instructions, and `array::map` is
/// not inlined with large elements.
macro_rules! each_axis {
    ($a:ident => $body:expr) => {
        [
            {
                let $a = 0_usize;
                $body
            },
            {
                let $a = 1_usize;
                $body
            },
            {
                let $a = 2_usize;
                $body
            },
        ]
    };
}
pub(super) use each_axis;

/// Returns the larger of two numbers, neither of them NaN, as one instruction (`f32::max` also
/// handles NaN).
#[inline]
pub(super) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Returns the axis of the direction's largest component: 0, 1 or 2. The lower axis wins a tie.
#[inline(always)]
pub(super) fn main_axis(direction: [f32; 3]) -> u32 {
    let [x, y, z] = [direction[0].abs(), direction[1].abs(), direction[2].abs()];
    let first = if x >= y { 0 } else { 1 };
    if larger(x, y) >= z { first } else { 2 }
}

/// Returns true for a ray that may hit something; see [`Ray`]. `largest_*` are the largest absolute
/// components.
#[inline(always)]
pub(super) fn is_valid(
    largest_origin: f32,
    largest_direction: f32,
    sum: f32,
    t_min: f32,
    t_max: f32,
) -> bool {
    // `sum` is over all six components: it is not finite if one of them is not, which the maxima
    // might not show.
    let (low, high) = (*DIRECTION_RANGE.start(), *DIRECTION_RANGE.end());
    (largest_origin <= MAX_COORDINATE)
        & (largest_direction >= low)
        & (largest_direction <= high)
        & sum.is_finite()
        & (t_min >= 0.0)
        & (t_min <= t_max)
}

/// Returns the largest absolute value of three numbers.
#[inline(always)]
pub(super) fn largest(v: [f32; 3]) -> f32 {
    let [x, y, z] = [v[0].abs(), v[1].abs(), v[2].abs()];
    larger(larger(x, y), z)
}

/// Per-ray constants of traversal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prepared {
    pub(super) slabs: [Slab; 3],
    /// The axes (x', y', z') of the shear: z' is the direction's main axis, x' and y' follow it
    /// cyclically.
    pub(super) axes: [usize; 3],
    /// The origin on the axes x', y', z'.
    pub(super) origin: [f32; 3],
    /// Direction on x' and y' over direction on z'.
    pub(super) shear: [f32; 2],
    pub(super) t_min: f32,
}

impl Prepared {
    /// Prepares a ray; `None` for a ray that hits nothing by definition; see [`Ray`].
    #[inline(always)]
    pub(super) fn new(ray: &Ray) -> Option<Self> {
        let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
        let (largest_origin, largest_direction) = (largest(origin), largest(direction));
        let sum = origin.iter().chain(&direction).sum();
        if !is_valid(largest_origin, largest_direction, sum, ray.t_min, ray.t_max) {
            return None;
        }
        let slabs =
            each_axis!(a => Slab::new(origin[a], direction[a], largest_origin, largest_direction));
        let axes = shear_axes(main_axis(direction));
        let inverse = slabs[axes[2]].inverse;
        Some(Self {
            slabs,
            axes,
            origin: each_axis!(i => origin[axes[i]]),
            shear: [direction[axes[0]] * inverse, direction[axes[1]] * inverse],
            t_min: ray.t_min,
        })
    }

    /// Returns the reciprocal of the direction on z'.
    #[inline]
    pub(super) fn inverse_main(&self) -> f32 {
        self.slabs[self.axes[2]].inverse
    }
}

/// Returns the axes x', y', z' for a main axis.
#[inline]
pub(super) fn shear_axes(main_axis: u32) -> [usize; 3] {
    match main_axis {
        0 => [1, 2, 0],
        1 => [2, 0, 1],
        _ => [0, 1, 2],
    }
}
