//! Ray against triangle: the watertight test of Woop, Benthin and Wald (JCGT 2013).
//!
//! The vertices are moved so that the ray starts at the origin, and sheared so that it runs along
//! z'. The ray hits if the origin of the x'y' plane lies in the sheared triangle: three edge
//! functions of one sign.
//!
//! No ray leaks. Both triangles at an edge have the same sheared vertices (they depend on the ray
//! and the vertex alone), and rounding is monotone: where the exact `a * b >= c * d`, the rounded
//! products compare the same way. So a ray that is in the exact sheared triangle, border included,
//! passes the rounded test, whichever of two neighbours it belongs to. (Rounded edge functions that
//! are only antisymmetric, as in Pluecker tests, still leak at vertices, where the signs of all the
//! spokes may be wrong in the same sense. They also need 69 operations where this needs 37.)
//!
//! `t` is a mean of the vertices' z' with weights of one sign, so it never leaves their range,
//! however thin the triangle.

use super::prepared::{each_axis, larger};
use fearless_simd::{Simd, prelude::*};

/// Edge functions of sheared triangles (or of one triangle in several shears): twice the areas
/// opposite each vertex.
pub(super) struct Edges<V> {
    pub(super) weights: [V; 3],
    depths: [V; 3],
}

/// Computes the edge functions. `vertices[vertex][axis]` are relative to the ray's origin, on the
/// axes x', y', z' of its shear.
#[inline(always)]
pub(super) fn edges<S: Simd, V: SimdFloat<S, Element = f32>>(
    vertices: [[V; 3]; 3],
    shear: [V; 2],
) -> Edges<V> {
    let [a, b, c] = each_axis!(i => {
        let [x, y, z] = vertices[i];
        [x - shear[0] * z, y - shear[1] * z]
    });
    let weights = [
        c[0] * b[1] - c[1] * b[0],
        a[0] * c[1] - a[1] * c[0],
        b[0] * a[1] - b[1] * a[0],
    ];
    Edges {
        weights,
        depths: [vertices[0][2], vertices[1][2], vertices[2][2]],
    }
}

impl<V> Edges<V> {
    /// Returns the mask of lanes whose ray passes through the triangle or its border. NaN is
    /// outside.
    #[inline(always)]
    pub(super) fn inside<S: Simd>(&self) -> V::Mask
    where
        V: SimdFloat<S, Element = f32>,
    {
        let [u, v, w] = self.weights;
        let zero = V::splat(u.token(), 0.0);
        u.min(v).min(w).simd_ge(zero) | u.max(v).max(w).simd_le(zero)
    }

    /// Returns the sum of the weights and the distance along the ray, which is NaN or infinite
    /// where the sum is zero.
    #[inline(always)]
    pub(super) fn determinant_and_t<S: Simd>(&self, inverse_main: V) -> (V, V)
    where
        V: SimdFloat<S, Element = f32>,
    {
        let ([u, v, w], [a, b, c]) = (self.weights, self.depths);
        let determinant = u + v + w;
        (
            determinant,
            (u * a + v * b + w * c) / determinant * inverse_main,
        )
    }
}

/// Intersection of a ray with a triangle, before the tests on `t` and the cut-out. Barycentric
/// weights are multiplied by `determinant`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub(super) t: f32,
    pub(super) v: f32,
    pub(super) w: f32,
    pub(super) determinant: f32,
}

impl Candidate {
    /// Returns `t`, but at least `enter`, where the ray enters the leaf's box (rule 3 of the parent
    /// module). Adding zero turns -0 to 0.
    #[inline]
    pub(super) fn t_from(&self, enter: f32) -> f32 {
        larger(self.t, enter) + 0.0
    }

    /// Returns true if the ray meets the back of the triangle: the sign of the determinant is that
    /// of the triangle's orientation about the main axis. `inverse_main` is that of the ray.
    #[inline]
    pub(super) fn is_back(&self, inverse_main: f32) -> bool {
        (self.determinant < 0.0) == (inverse_main > 0.0)
    }

    /// Returns the barycentric weights of the second and the third vertex.
    #[inline]
    pub(super) fn barycentric(&self) -> [f32; 2] {
        // Adding zero turns -0 to 0: the sign of a zero depends on the shear's orientation and
        // means nothing.
        [
            self.v / self.determinant + 0.0,
            self.w / self.determinant + 0.0,
        ]
    }
}

/// Repeats the test with exact edge functions, for a triangle whose three rounded ones are all
/// zero: products of `f32` are exact in `f64`, and so is the sign of their difference. `None` if
/// the triangle is exactly edge-on.
#[cold]
#[inline(never)]
pub(super) fn exact(
    vertices: [[f32; 3]; 3],
    shear: [f32; 2],
    inverse_main: f32,
) -> Option<Candidate> {
    let sheared = vertices.map(|[x, y, z]| [x - shear[0] * z, y - shear[1] * z].map(f64::from));
    let edge = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
    let [a, b, c] = sheared;
    let [u, v, w] = [edge(c, b), edge(a, c), edge(b, a)];
    let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    let determinant = u + v + w;
    if !inside || determinant == 0.0 {
        return None;
    }
    let [a, b, c] = vertices.map(|p| f64::from(p[2]));
    let t = (u * a + v * b + w * c) / determinant * f64::from(inverse_main);
    let (v, w) = ((v / determinant) as f32, (w / determinant) as f32);
    let sign = 1.0_f32.copysign(determinant as f32);
    Some(Candidate {
        t: t as f32,
        v: v * sign,
        w: w * sign,
        determinant: sign,
    })
}
