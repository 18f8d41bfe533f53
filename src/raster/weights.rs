//! Perspective-correct interpolation weights of a triangle's corners, for shading.

use super::LANES;
use super::mesh::Vertex;
use super::view::LocalCamera;
use fearless_simd::f32x16;
use fearless_simd::prelude::*;
use glam::{DVec3, Vec2, Vec3};

/// Unnormalised weights as linear functions of the position in the frame: the edge functions of the
/// corners in homogeneous coordinates. In `f64`, as on a floor a tenth of a millimetre under the
/// eye they differ by 10^5 within the frame.
///
/// Corners are snapped for coverage, so a covered pixel centre may lie slightly outside the exact
/// triangle: its weights are clamped to the nearest point of the triangle. All weights are 0 for a
/// triangle that is seen edge-on.
#[derive(Clone, Copy)]
pub(super) struct CornerWeights {
    /// At the frame's upper left corner.
    at_origin: DVec3,
    /// Changes over one pixel to the right, and down.
    gradient: [DVec3; 2],
}

impl CornerWeights {
    #[inline(always)]
    pub(super) fn new(view: &LocalCamera, corners: [&Vertex; 3]) -> Self {
        let [a, b, c] = corners;
        let (a, b, c) = (
            view.project_f64(a.position),
            view.project_f64(b.position),
            view.project_f64(c.position),
        );
        let (p, q, r) = (b.cross(c), c.cross(a), a.cross(b));
        let axis = |axis: usize| DVec3::new(p[axis], q[axis], r[axis]);
        Self {
            at_origin: axis(2),
            gradient: [axis(0), axis(1)],
        }
    }

    /// Evaluates the weights at the centre of a pixel.
    pub(super) fn evaluate(&self, x: u32, y: u32) -> Vec3 {
        let w = self.at_origin
            + self.gradient[0] * (f64::from(x) + 0.5)
            + self.gradient[1] * (f64::from(y) + 0.5);
        // Seen from its back, all three are negative.
        let w = (w * (w.x + w.y + w.z).signum()).as_vec3().max(Vec3::ZERO);
        let sum = w.x + w.y + w.z;
        w * if sum >= f32::MIN_POSITIVE {
            1.0 / sum
        } else {
            0.0
        }
    }

    /// Same as [`Self::evaluate`] for [`LANES`] pixels: the weights of each corner, and the signed
    /// reciprocals of their sums, for [`Slopes::footprint`].
    #[inline(always)]
    pub(super) fn evaluate_lanes<S: Simd>(
        &self,
        simd: S,
        x: &[u32; LANES],
        y: &[u32; LANES],
    ) -> ([f32x16<S>; 3], f32x16<S>) {
        let mut weights = [[0.0; LANES]; 3];
        for (corner, weights) in weights.iter_mut().enumerate() {
            let origin = self.at_origin[corner];
            let [right, down] = self.gradient.map(|step| step[corner]);
            for i in 0..LANES {
                weights[i] = (origin
                    + right * (f64::from(x[i] as i32) + 0.5)
                    + down * (f64::from(y[i] as i32) + 0.5)) as f32;
            }
        }
        let zero = f32x16::splat(simd, 0.0);
        let [a, b, c] = &weights;
        let (a, b) = (
            f32x16::load_array_ref(simd, a),
            f32x16::load_array_ref(simd, b),
        );
        let c = f32x16::load_array_ref(simd, c);
        let sign = ((a + b) + c)
            .simd_lt(zero)
            .select(f32x16::splat(simd, -1.0), f32x16::splat(simd, 1.0));
        let (a, b, c) = (
            (a * sign).max(zero),
            (b * sign).max(zero),
            (c * sign).max(zero),
        );
        let sum = (a + b) + c;
        let per = sum.simd_ge(f32::MIN_POSITIVE).select(1.0 / sum, zero);
        ([a * per, b * per, c * per], per * sign)
    }

    /// Computes the derivatives over the frame of the texture coordinates given at the corners;
    /// `size` is that of the texture, texels.
    #[inline(always)]
    pub(super) fn slopes(&self, texcoords: [Vec2; 3], size: Vec2) -> Slopes {
        let along = |axis: usize| {
            let w = self.gradient[axis].as_vec3();
            let texcoord = (texcoords[0] * w.x + texcoords[1] * w.y) + texcoords[2] * w.z;
            (texcoord * size, (w.x + w.y) + w.z)
        };
        Slopes {
            size,
            along: [along(0), along(1)],
        }
    }
}

/// Derivatives of a triangle's texture coordinates over the frame, to the right and down.
pub(super) struct Slopes {
    size: Vec2,
    /// Derivatives of the coordinates (texels) times the sum of weights, and of that sum.
    along: [(Vec2, f32); 2],
}

impl Slopes {
    /// Computes the fourth power of the side of a pixel's footprint in the texture, texels. The
    /// side is the geometric mean of those along x and y, as the longer one alone blurs surfaces at
    /// a grazing angle. `per`: the reciprocals of the sums of weights.
    #[inline(always)]
    pub(super) fn footprint<S: Simd>(
        &self,
        u: f32x16<S>,
        v: f32x16<S>,
        per: f32x16<S>,
    ) -> f32x16<S> {
        let (u, v) = (u * self.size.x, v * self.size.y);
        let [right, down] = self.along;
        squared_slope(right, [u, v], per) * squared_slope(down, [u, v], per)
    }
}

/// Computes the squared change of texture coordinates (texels) along an axis of the frame, by the
/// quotient rule.
#[inline(always)]
fn squared_slope<S: Simd>(
    (texels, sum): (Vec2, f32),
    [u, v]: [f32x16<S>; 2],
    per: f32x16<S>,
) -> f32x16<S> {
    let (du, dv) = ((texels.x - u * sum) * per, (texels.y - v * sum) * per);
    du * du + dv * dv
}

/// Interpolates values given at the corners, in each lane.
#[inline(always)]
pub(super) fn interpolate<S: Simd>(
    [a, b, c]: [f32x16<S>; 3],
    [at_a, at_b, at_c]: [f32; 3],
) -> f32x16<S> {
    (a * at_a + b * at_b) + c * at_c
}
