//! Environment lookup for sixteen adjacent pixels of a row at once.
//!
//! Along a row directions are linear in the column, and a face of the cube map is a plane: the row
//! crosses it along a straight line, projectively. So right, up and depth on the face are linear in
//! the column too, and each pixel only adds a reciprocal. Few groups of sixteen pixels span two
//! faces; these are processed face by face.

use crate::cube_face::Face;
use crate::environment::Environment;
use crate::image::texels::{self, LANE_INDICES, LANES};
use fearless_simd::{ExtractToken, Simd, SimdCvtTruncate, f32x16, mask32x16, prelude::*, u32x16};
use glam::Vec3;

/// Intersections of the lanes' directions with a face.
struct FacePositions<S: Simd> {
    /// Mask of lanes whose four texels lie on the face.
    inside: mask32x16<S>,
    /// Index of the upper left texel; 0 outside.
    first: u32x16<S>,
    /// Distances from it to the right and down, in 1/256.
    u: u32x16<S>,
    v: u32x16<S>,
}

impl Environment {
    /// Samples the directions `start + i * step` for i from 0 to 15 like [`Self::sample`], with
    /// alpha 255; alpha 0 for no sample. Results of lanes whose bit in `wanted` is not set are
    /// arbitrary.
    #[inline(always)]
    pub fn sample_sixteen<S: Simd>(
        &self,
        simd: S,
        wanted: u64,
        start: Vec3,
        step: Vec3,
    ) -> [[u8; 4]; LANES] {
        let mut found = [[0; 4]; LANES];
        let (mut missing, mut tried) = (wanted & 0xffff, 0u32);
        while missing != 0 && self.size_px > 0 {
            let i = missing.trailing_zeros() as usize;
            let direction = start + step * i as f32;
            let (face, _) = Face::locate(direction);
            if tried >> face.index() & 1 == 0 {
                tried |= 1 << face.index();
                let done = self.sample_on_face(simd, face, missing, start, step, &mut found);
                missing &= !done;
            } else {
                // At the border between faces.
                found[i] = self
                    .sample(direction)
                    .map_or([0; 4], |[r, g, b]| [r, g, b, 255]);
                missing &= missing - 1;
            }
        }
        found
    }

    /// Samples the lanes of `missing` whose four texels lie on a face; returns the mask of these
    /// lanes.
    #[inline(always)]
    fn sample_on_face<S: Simd>(
        &self,
        simd: S,
        face: Face,
        missing: u64,
        start: Vec3,
        step: Vec3,
        found: &mut [[u8; 4]; LANES],
    ) -> u64 {
        let on_face = self.locate_on_face(simd, face, start, step);
        let done = on_face.inside.to_bitmask() & missing;
        if done == 0 {
            return 0;
        }
        let (colors, uniform) = self.blend_sixteen(&on_face);
        if done == 0xffff {
            *found = bytemuck::cast(colors.to_array());
        } else {
            let before = u32x16::load_array(simd, bytemuck::cast(*found));
            let colors = mask32x16::from_bitmask(simd, done).select(colors, before);
            *found = bytemuck::cast(colors.to_array());
        }
        let mut mixed = done & !uniform.to_bitmask();
        if mixed != 0 {
            let first = on_face.first.to_array();
            let u = on_face.u.to_array();
            let v = on_face.v.to_array();
            while mixed != 0 {
                let i = mixed.trailing_zeros() as usize;
                mixed &= mixed - 1;
                let sample = self.blend_quad(first[i] as usize, [u[i], v[i]]);
                found[i] = sample.map_or([0; 4], |[r, g, b]| [r, g, b, 255]);
            }
        }
        done
    }

    /// Intersects the directions `start + i * step` with a face.
    #[inline(always)]
    fn locate_on_face<S: Simd>(
        &self,
        simd: S,
        face: Face,
        start: Vec3,
        step: Vec3,
    ) -> FacePositions<S> {
        let ([right, up, depth], [right_step, up_step, depth_step]) =
            (face.eye_space(start), face.eye_space(step));
        let k = f32x16::load_array_ref(simd, &LANE_INDICES);
        let depth = k * depth_step + depth;
        let (size, half) = (self.size_px as f32, self.size_px as f32 / 2.0);
        let per_depth = f32x16::splat(simd, half) / depth;
        let x_px = (k * right_step + right) * per_depth + (half - 0.5);
        let y_px = (k * up_step + up) * -per_depth + (half - 0.5);
        let (left, top) = (x_px.floor(), y_px.floor());
        // False for NaN.
        let inside = depth.simd_gt(0.0)
            & left.simd_ge(0.0)
            & top.simd_ge(0.0)
            & left.simd_lt(size - 1.0)
            & top.simd_lt(size - 1.0);
        let texels_before = face.index() as u32 * self.size_px * self.size_px;
        let first =
            floor_inside(inside, top) * self.size_px + floor_inside(inside, left) + texels_before;
        let first = inside.select(first, u32x16::splat(simd, 0));
        FacePositions {
            inside,
            first,
            u: floor_inside(inside, (x_px - left) * 256.0),
            v: floor_inside(inside, (y_px - top) * 256.0),
        }
    }

    /// Same as [`Self::blend_quad`] for sixteen indices at a time, with the alpha of the texels,
    /// 255 or 0. The mask is set where all four texels are known or none is; other lanes are wrong.
    #[inline(always)]
    fn blend_sixteen<S: Simd>(&self, on_face: &FacePositions<S>) -> (u32x16<S>, mask32x16<S>) {
        let &FacePositions { first, u, v, .. } = on_face;
        let simd = first.token();
        let Some(found) = texels::gather_quads(simd, &self.texels, first, self.size_px as usize)
        else {
            return (u32x16::splat(simd, 0), mask32x16::splat(simd, true));
        };
        let [a, b, c, d] = found;
        let alpha = u32x16::splat(simd, u32::from_ne_bytes([0, 0, 0, 255]));
        let uniform = ((a & b & c & d) & alpha).simd_eq((a | b | c | d) & alpha);
        (texels::blend_quads(found, [u, v]), uniform)
    }
}

/// Rounds the lanes `inside` down; the others become 0.
#[inline(always)]
fn floor_inside<S: Simd>(inside: mask32x16<S>, values: f32x16<S>) -> u32x16<S> {
    u32x16::truncate_from(inside.select(values, f32x16::splat(values.token(), 0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::tests::by_direction;
    use crate::simd;
    use fearless_simd::dispatch;

    /// One step of the 8-bit weights on either axis, on a ramp of 16 levels a texel, and rounding.
    const WEIGHT_LEVELS: u8 = 2;

    #[test]
    fn lanes_equal_scalar_samples_at_every_level() {
        let patchy = by_direction(16, |d| {
            let c = |v: f64| (127.5 + 127.0 * v).round() as u8;
            [
                c(d.x),
                c(d.y),
                c(d.z),
                if (d.x * 7.0 + d.y * 5.0).sin() > -0.6 {
                    255
                } else {
                    0
                },
            ]
        });
        let (mut found_any, mut lacked_any, mut faces) = (false, false, 0u32);
        for i in 0..2000 {
            let a = i as f32 * 0.31;
            // Runs of up to 150 and of some 5 degrees.
            let step = Vec3::new(0.03, -0.05, 0.11) * if i % 2 == 0 { 1.0 } else { 0.05 };
            let start = Vec3::new(a.sin(), (a * 1.7).cos(), (a * 0.6).cos());
            let wanted = [0xffff, 0xa53c][i / 2 % 2];
            let mut of_lowest = None;
            for level in simd::levels() {
                let sixteen =
                    dispatch!(level, simd => patchy.sample_sixteen(simd, wanted, start, step));
                let wanted_ones = |k: usize| {
                    if wanted >> k & 1 == 1 {
                        sixteen[k]
                    } else {
                        [0; 4]
                    }
                };
                let bits: [[u8; 4]; LANES] = std::array::from_fn(wanted_ones);
                assert_eq!(bits, *of_lowest.get_or_insert(bits), "{i}: {level:?}");
            }
            for (k, [r, g, b, a]) in of_lowest.expect("there are levels").into_iter().enumerate() {
                if wanted >> k & 1 == 0 {
                    continue;
                }
                let direction = start + step * k as f32;
                let (found, expected) = ((a > 0).then_some([r, g, b]), patchy.sample(direction));
                assert_eq!(found.is_some(), expected.is_some(), "{i} {k}");
                let levels = found.zip(expected).map_or(0, |(f, e)| {
                    (0..3).map(|c| f[c].abs_diff(e[c])).fold(0, u8::max)
                });
                assert!(levels <= WEIGHT_LEVELS, "{i} {k}: {found:?} {expected:?}");
                (found_any, lacked_any) =
                    (found_any || found.is_some(), lacked_any || found.is_none());
                faces |= 1 << Face::locate(direction).0.index();
            }
        }
        assert!(found_any && lacked_any && faces == 0b11_1111, "{faces:b}");
    }

    #[test]
    fn no_direction_and_no_environment_give_nothing() {
        let grey = by_direction(8, |_| [90, 90, 90, 255]);
        let empty = Environment {
            size_px: 0,
            texels: vec![],
        };
        for level in simd::levels() {
            dispatch!(level, simd => {
                assert_eq!(grey.sample_sixteen(simd, 0xffff, Vec3::NAN, Vec3::ZERO), [[0; 4]; LANES]);
                assert_eq!(grey.sample_sixteen(simd, 0xffff, Vec3::ZERO, Vec3::ZERO), [[0; 4]; LANES]);
                assert_eq!(grey.sample_sixteen(simd, 0xffff, Vec3::X, Vec3::Y), [[90, 90, 90, 255]; LANES]);
                assert_eq!(empty.sample_sixteen(simd, 0xffff, Vec3::X, Vec3::Y), [[0; 4]; LANES]);
            });
        }
    }
}
