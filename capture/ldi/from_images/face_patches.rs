//! Surface patches projected onto a face of the cube, sixteen at a time.

use super::depth_rows::{SurfacePatches, Vectors};
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, mask32x16, u32x16};

/// Sixteen patches projected onto a face.
pub(super) struct FacePatches<S: Simd> {
    /// Index of the face.
    pub(super) face: u32,
    /// Bits of the patches in front of the face; the other lanes are undefined.
    pub(super) ahead: u64,
    /// Position, face pixels: right and down.
    pub(super) position: [f32x16<S>; 2],
    /// Change of the position over one pixel of the image, right and down.
    steps: [[f32x16<S>; 2]; 2],
    pub(super) inverse_depth: f32x16<S>,
    /// Change of the inverse depth over the two steps.
    slopes: [f32x16<S>; 2],
    /// Signed area of the parallelogram of the two steps.
    pub(super) determinant: f32x16<S>,
    reciprocal: f32x16<S>,
    /// Lanes whose steps are not parallel.
    pub(super) regular: mask32x16<S>,
}

/// An axis of a face: index of the world axis, and 1 along or -1 against it.
type Axis = (usize, f32);

/// Right, up and normal of each face.
const fn axes(face: u32) -> [Axis; 3] {
    // As in `Face::eye_space`; compared in a test.
    match face {
        0 => [(2, 1.0), (1, 1.0), (0, 1.0)],
        1 => [(2, -1.0), (1, 1.0), (0, -1.0)],
        2 => [(0, 1.0), (2, 1.0), (1, 1.0)],
        3 => [(0, 1.0), (2, -1.0), (1, -1.0)],
        4 => [(0, -1.0), (1, 1.0), (2, 1.0)],
        _ => [(0, 1.0), (1, 1.0), (2, -1.0)],
    }
}

impl<S: Simd> FacePatches<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, face: u32, patches: &SurfacePatches<S>, face_px: u32) -> Self {
        let axes = axes(face);
        let half = face_px as f32 / 2.0;
        let [right, up, depth] = along(&axes, &patches.point);
        let q = 1.0 / depth;
        let (u, v) = (right * q, up * q);
        let scale = q * half;
        let mut steps = [[f32x16::splat(simd, 0.0); 2]; 2];
        let mut slopes = [f32x16::splat(simd, 0.0); 2];
        for (i, change) in [&patches.across, &patches.down].into_iter().enumerate() {
            let [right, up, deeper] = along(&axes, change);
            steps[i] = [(right - u * deeper) * scale, (v * deeper - up) * scale];
            slopes[i] = -(deeper * q * q);
        }
        let [a, b] = steps;
        let determinant = a[0] * b[1] - a[1] * b[0];
        Self {
            face,
            // False for NaN.
            ahead: depth.simd_gt(1e-6).to_bitmask(),
            position: [u * half + half, half - v * half],
            steps,
            inverse_depth: q,
            slopes,
            determinant,
            reciprocal: 1.0 / determinant,
            regular: determinant.abs().simd_gt(1e-9),
        }
    }

    /// Distance that footprints, enlarged by `overlap`, reach from their middles, right and down,
    /// pixels.
    #[inline(always)]
    pub(super) fn reach(&self, overlap: f32) -> [f32x16<S>; 2] {
        let [a, b] = self.steps;
        [
            (a[0].abs() + b[0].abs()) * (0.5 * overlap),
            (a[1].abs() + b[1].abs()) * (0.5 * overlap),
        ]
    }

    /// Bits of the footprints that reach over the edge of the face.
    #[inline(always)]
    pub(super) fn reaching_over(&self, reach: [f32x16<S>; 2], face_px: u32) -> u64 {
        let [x, y] = self.position;
        let size = face_px as f32;
        let over = (x - reach[0]).simd_lt(0.0)
            | (y - reach[1]).simd_lt(0.0)
            | (x + reach[0]).simd_gt(size)
            | (y + reach[1]).simd_gt(size);
        over.to_bitmask()
    }

    /// Converts an offset on the face, pixels, to multiples of the two steps.
    #[inline(always)]
    pub(super) fn steps_to(&self, [x, y]: [f32x16<S>; 2]) -> [f32x16<S>; 2] {
        let [a, b] = self.steps;
        [
            (x * b[1] - y * b[0]) * self.reciprocal,
            (a[0] * y - a[1] * x) * self.reciprocal,
        ]
    }

    /// Change of the inverse depth over multiples of the two steps.
    #[inline(always)]
    pub(super) fn inverse_depth_change(&self, steps: [f32x16<S>; 2]) -> f32x16<S> {
        self.slopes[0] * steps[0] + self.slopes[1] * steps[1]
    }
}

/// Components of vectors along the axes of a face.
#[inline(always)]
fn along<S: Simd>(axes: &[Axis; 3], vectors: &Vectors<S>) -> Vectors<S> {
    let [right, up, normal] = axes;
    [
        vectors[right.0] * right.1,
        vectors[up.0] * up.1,
        vectors[normal.0] * normal.1,
    ]
}

/// Indices of the faces whose frusta contain points, as in [`Face::locate`].
#[inline(always)]
pub(super) fn home_faces<S: Simd>([x, y, z]: Vectors<S>) -> u32x16<S> {
    let (a, b, c) = (x.abs(), y.abs(), z.abs());
    let one = u32x16::splat(x.token(), 1);
    let zero = u32x16::splat(x.token(), 0);
    let x_face = x.simd_lt(0.0).select(one, zero);
    let y_face = y.simd_lt(0.0).select(one, zero) + 2;
    let z_face = z.simd_lt(0.0).select(one, zero) + 4;
    (a.simd_ge(b) & a.simd_ge(c)).select(x_face, c.simd_gt(b).select(z_face, y_face))
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::dispatch;
    use glam::{DVec3, Vec3};
    use headbox_core::cube_face::Face;
    use headbox_core::simd;

    #[test]
    fn face_axes_match_the_cube() {
        for face in Face::ALL {
            let encode = |axis: DVec3| {
                (0..3)
                    .find(|&i| axis[i] != 0.0)
                    .map(|i| (i, axis[i] as f32))
            };
            let expected = [face.right(), face.up(), face.normal()].map(encode);
            assert_eq!(axes(face.index() as u32).map(Some), expected, "{face:?}");
        }
        for point in (0..343u16)
            .map(|i| Vec3::from_array([i % 7, i / 7 % 7, i / 49].map(|c| f32::from(c) - 3.0)))
        {
            for level in simd::levels() {
                let home = dispatch!(level, simd => {
                    home_faces(point.to_array().map(|c| f32x16::splat(simd, c))).to_array()[3]
                });
                assert_eq!(home as usize, Face::locate(point).0.index(), "{point}");
            }
        }
    }
}
