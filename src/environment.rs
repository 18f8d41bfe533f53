//! The surroundings at infinity, looked up by direction.

use crate::capture::light::Lighting;
use crate::capture::rig::Face;
use crate::capture::srgb8_from_linear;
use fearless_simd::{Simd, SimdCvtTruncate, f32x16, mask32x16, prelude::*, u32x16};
use glam::{DVec3, Vec3};

/// The far surroundings, which do not move with the eye: radiance by direction, a small cube map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Environment {
    /// Texels a side of each face; 0 if no ray ever left the scene (then `texels` is empty).
    pub size_px: u32,
    /// Six faces in the order of [`Face::ALL`], row-major, row 0 on top: sRGB, and alpha 255 where a real miss reached
    /// the texel, 0 where none did.
    pub texels: Vec<[u8; 4]>,
}

/// Four bytes, 16 bits each, so that one multiplication serves all.
#[inline(always)]
fn spread([r, g, b, a]: [u8; 4]) -> u64 {
    u64::from(r) | u64::from(g) << 16 | u64::from(b) << 32 | u64::from(a) << 48
}

/// [`Environment::between_four`] of the texels that a miss reached, if there are any.
fn mean_of_known(texels: [[u8; 4]; 4], [u, v]: [u32; 2]) -> Option<[u8; 3]> {
    let weights = [(256 - u) * (256 - v), u * (256 - v), (256 - u) * v, u * v];
    let (mut sum, mut total) = ([0; 3], 0);
    for (texel, weight) in texels.iter().zip(weights).filter(|(texel, _)| texel[3] == 255) {
        total += weight;
        sum.iter_mut().zip(texel).for_each(|(sum, c)| *sum += weight * u32::from(*c));
    }
    (total > 0).then(|| sum.map(|s| ((s + total / 2) / total) as u8))
}

impl Environment {
    /// The sky's radiance under the exposure of `lighting`, in faces of `size_px` texels; `reached` says by a texel's
    /// index whether a miss reached it.
    pub fn of_sky(size_px: u32, lighting: &Lighting, reached: impl Fn(usize) -> bool) -> Self {
        let per_face = size_px as usize * size_px as usize;
        let texel = |at: usize| {
            let (x, y) = ((at % per_face) as u32 % size_px, (at % per_face) as u32 / size_px);
            let direction = Face::ALL[at / per_face].direction(f64::from(x) + 0.5, f64::from(y) + 0.5, size_px);
            let radiance = lighting.miss_radiance(direction.normalize().as_vec3());
            let [r, g, b] = radiance.map(|c| srgb8_from_linear(c * lighting.exposure));
            [r, g, b, if reached(at) { 255 } else { 0 }]
        };
        Self { size_px, texels: (0..6 * per_face).map(texel).collect() }
    }

    /// All of the sky; of size 0 where there is none.
    pub fn sky(lighting: &Lighting) -> Self {
        /// Smooth as it is, the sky needs no more.
        const SIZE_PX: u32 = 128;
        if lighting.sky.is_none() { Self::default() } else { Self::of_sky(SIZE_PX, lighting, |_| true) }
    }

    /// Bilinear sample of the cube map in a direction (world axes, any length), sRGB. Texels that no miss reached have
    /// no part in it; `None` if that leaves none (or the direction is not finite).
    pub fn sample(&self, direction: Vec3) -> Option<[u8; 3]> {
        if self.size_px == 0 || !direction.is_finite() || direction == Vec3::ZERO {
            return None;
        }
        let (face, [right, up, depth]) = Face::locate(direction);
        let half = self.size_px as f32 / 2.0;
        let per_depth = half / depth;
        let (x, y) = (half + right * per_depth - 0.5, half - up * per_depth - 0.5);
        let (left, top) = (x as u32, y as u32);
        let inside = x >= 0.0 && y >= 0.0 && left + 1 < self.size_px && top + 1 < self.size_px;
        let size = self.size_px as usize;
        let first = (face.index() * size + top as usize) * size + left as usize;
        let within = [((x - left as f32) * 256.0) as u32, ((y - top as f32) * 256.0) as u32];
        if inside { self.between_four(first, within) } else { self.sample_anywhere(direction.as_dvec3()) }
    }

    /// The samples in the directions `start + i * step` for i from 0 to 15, as [`Self::sample`] finds them, with alpha 255; alpha 0
    /// for none. Those whose bit in `wanted` is not set may be anything.
    #[inline(always)]
    pub(crate) fn sample_sixteen<S: Simd>(&self, simd: S, wanted: u64, start: Vec3, step: Vec3) -> [[u8; 4]; 16] {
        if self.size_px == 0 {
            return [[0; 4]; 16];
        }
        let k = f32x16::load_array(simd, std::array::from_fn(|i| i as f32));
        let splat = |v: f32| f32x16::splat(simd, v);
        let (x, y, z) = (k * step.x + start.x, k * step.y + start.y, k * step.z + start.z);
        // As `Face::locate`: of a face, its number without the sign; right, up and depth.
        let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
        let on_x = ax.simd_ge(ay) & ax.simd_ge(az);
        let on_z = az.simd_gt(ay) & !on_x;
        let of_axis = |on_x_: f32x16<S>, on_y_, on_z_| on_x.select(on_x_, on_z.select(on_z_, on_y_));
        let signed_depth = of_axis(x, y, z);
        let negative = signed_depth.simd_lt(splat(0.0));
        let flip = |v: f32x16<S>| negative.select(-v, v);
        let right = of_axis(flip(z), x, flip(-x));
        let up = of_axis(y, flip(z), y);
        let number = of_axis(splat(0.0), splat(2.0), splat(4.0)) + negative.select(splat(1.0), splat(0.0));

        let (size, half) = (self.size_px as f32, self.size_px as f32 / 2.0);
        let per_depth = splat(half) / signed_depth.abs();
        let (x_px, y_px) = (right * per_depth + (half - 0.5), up * -per_depth + (half - 0.5));
        let (left, top) = (x_px.floor(), y_px.floor());
        // False for NaN.
        let inside = left.simd_ge(splat(0.0))
            & top.simd_ge(splat(0.0))
            & left.simd_lt(splat(size - 1.0))
            & top.simd_lt(splat(size - 1.0));
        let whole = |v: f32x16<S>| u32x16::truncate_from(inside.select(v, splat(0.0)));
        let first = (whole(number) * self.size_px + whole(top)) * self.size_px + whole(left);
        let (u, v) = (whole((x_px - left) * 256.0), whole((y_px - top) * 256.0));
        let (mut found, alike) = self.between_sixty_four(simd, first, [u, v]);
        let inside = inside.to_bitmask();
        let mut others = wanted & !(inside & alike.to_bitmask());
        let (first, u, v) = (first.to_array(), u.to_array(), v.to_array());
        while others != 0 {
            let i = others.trailing_zeros() as usize;
            others &= others - 1;
            let sample = match inside >> i & 1 {
                0 => self.sample(start + step * i as f32),
                _ => self.between_four(first[i] as usize, [u[i], v[i]]),
            };
            found[i] = sample.map_or([0; 4], |[r, g, b]| [r, g, b, 255]);
        }
        found
    }

    /// [`Self::between_four`] for sixteen indices at a time, with the alpha of the texels, 255 or 0; wrong where some are known
    /// and others are not. The mask says where they are alike.
    #[inline(always)]
    fn between_sixty_four<S: Simd>(
        &self,
        simd: S,
        first: u32x16<S>,
        [u, v]: [u32x16<S>; 2],
    ) -> ([[u8; 4]; 16], mask32x16<S>) {
        let size = self.size_px as usize;
        let mut rows = [[[[0; 4]; 2]; 16]; 2];
        for (i, first) in first.to_array().into_iter().enumerate() {
            for (row, at) in rows.iter_mut().zip([first as usize, first as usize + size]) {
                row[i] = self.texels.get(at..at + 2).map_or([[0; 4]; 2], |texels| [texels[0], texels[1]]);
            }
        }
        let left_and_right = |pairs: [[[u8; 4]; 2]; 16]| {
            let words: [u32; 32] = bytemuck::cast(pairs);
            let (low, high) = words.split_at(16);
            simd.deinterleave_u32x16(u32x16::from_slice(simd, low), u32x16::from_slice(simd, high))
        };
        let ((a, b), (c, d)) = (left_and_right(rows[0]), left_and_right(rows[1]));
        let alpha = u32x16::splat(simd, u32::from_ne_bytes([0, 0, 0, 255]));
        let alike = ((a & b & c & d) & alpha).simd_eq((a | b | c | d) & alpha);
        // Two of the four bytes at a time, 16 bits each. Rounding of either step is at most half a level.
        let two = 0x00ff_00ff;
        let mix = |a: u32x16<S>, b: u32x16<S>, share: u32x16<S>| {
            let rest = u32x16::splat(simd, 256) - share;
            ((a * rest + b * share + 0x0080_0080) >> 8) & two
        };
        let even = mix(mix(a & two, b & two, u), mix(c & two, d & two, u), v);
        let odd = |t: u32x16<S>| (t >> 8) & two;
        let odd = mix(mix(odd(a), odd(b), u), mix(odd(c), odd(d), u), v);
        (bytemuck::cast((even | (odd << 8)).to_array()), alike)
    }

    /// Between the texels of index `first` and right of it, and the two below, at distances in 1/256 from the first. All four
    /// lie on one face.
    #[inline(always)]
    fn between_four(&self, first: usize, [u, v]: [u32; 2]) -> Option<[u8; 3]> {
        let size = self.size_px as usize;
        let (upper, lower) = (self.texels.get(first..first + 2)?, self.texels.get(first + size..first + size + 2)?);
        let [a, b, c, d] = [upper[0], upper[1], lower[0], lower[1]];
        if a[3] & b[3] & c[3] & d[3] != 255 {
            return mean_of_known([a, b, c, d], [u, v]);
        }
        // Rounding of either step is at most half a level.
        let mix = |a: u64, b: u64, share: u32| {
            let share = u64::from(share);
            ((a * (256 - share) + b * share + 0x0080_0080_0080_0080) >> 8) & 0x00ff_00ff_00ff_00ff
        };
        let [r, _, g, _, b, ..] = mix(mix(spread(a), spread(b), u), mix(spread(c), spread(d), u), v).to_le_bytes();
        Some([r, g, b])
    }

    fn sample_anywhere(&self, direction: DVec3) -> Option<[u8; 3]> {
        let face = Face::containing(direction);
        let [x, y, _] = face.project(direction, self.size_px);
        let (x, y) = (x - 0.5, y - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (u, v) = (x - left, y - top);
        let mut sum = [0.0; 3];
        let mut total = 0.0;
        for (dx, dy, weight) in
            [(0, 0, (1.0 - u) * (1.0 - v)), (1, 0, u * (1.0 - v)), (0, 1, (1.0 - u) * v), (1, 1, u * v)]
        {
            let texel = self.texel(face, left as i64 + dx, top as i64 + dy);
            if let Some(color) = texel.filter(|t| t[3] == 255) {
                total += weight;
                for c in 0..3 {
                    sum[c] += weight * f64::from(color[c]);
                }
            }
        }
        // A weight this small is rounding: the one texel that counts has the alpha 0.
        (total > 1e-6).then(|| sum.map(|s| (s / total + 0.5) as u8))
    }

    /// Texel (x, y) of a face; one step beyond its border, the texel of the neighbouring face that lies there.
    fn texel(&self, face: Face, x: i64, y: i64) -> Option<[u8; 4]> {
        let size = i64::from(self.size_px);
        let at = |face: Face, x: i64, y: i64| {
            let index = face.index() as i64 * size * size + y.clamp(0, size - 1) * size + x.clamp(0, size - 1);
            self.texels.get(index as usize).copied()
        };
        if (0..size).contains(&x) && (0..size).contains(&y) {
            return at(face, x, y);
        }
        let direction: DVec3 = face.direction(x as f64 + 0.5, y as f64 + 0.5, self.size_px);
        let face = Face::containing(direction);
        let [x, y, _] = face.project(direction, self.size_px);
        at(face, x as i64, y as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn by_direction(size_px: u32, color: impl Fn(DVec3) -> [u8; 4]) -> Environment {
        let mut texels = Vec::new();
        for face in Face::ALL {
            for y in 0..size_px {
                for x in 0..size_px {
                    texels.push(color(face.direction(f64::from(x) + 0.5, f64::from(y) + 0.5, size_px).normalize()));
                }
            }
        }
        Environment { size_px, texels }
    }

    #[test]
    fn a_smooth_environment_is_smooth_across_edges() {
        let ramp = |d: DVec3| {
            let c = |v: f64| (127.5 + 127.0 * v).round() as u8;
            [c(d.x), c(d.y), c(d.z), 255]
        };
        let environment = by_direction(32, ramp);
        // One texel of 32 spans up to 1/16 of a unit: linear interpolation of a sine errs by less than 2 levels; at
        // the border of a face the neighbour's texels are not on the same grid, which costs up to half a texel, 4.
        const LEVELS: i32 = 5;
        for i in 0..5000 {
            let (a, z) = (f64::from(i) * 2.399_963, 1.0 - (f64::from(i) + 0.5) / 2500.0);
            let d = DVec3::new((1.0 - z * z).sqrt() * a.cos(), (1.0 - z * z).sqrt() * a.sin(), z);
            let (found, expected) = (environment.sample(d.as_vec3() * 7.0).expect("filled"), ramp(d));
            for c in 0..3 {
                assert!((i32::from(found[c]) - i32::from(expected[c])).abs() <= LEVELS, "{d}: {found:?} {expected:?}");
            }
        }
    }

    /// One step of the 8-bit weights on either axis, on a ramp of 16 levels a texel, and rounding.
    const WEIGHT_LEVELS: u8 = 2;

    #[test]
    fn sixteen_samples_are_those_of_one_by_one() {
        let patchy = by_direction(16, |d| {
            let c = |v: f64| (127.5 + 127.0 * v).round() as u8;
            [c(d.x), c(d.y), c(d.z), if (d.x * 7.0 + d.y * 5.0).sin() > -0.6 { 255 } else { 0 }]
        });
        let (mut found_any, mut lacked_any) = (false, false);
        for i in 0..400 {
            let a = i as f32 * 0.31;
            let (start, step) = (Vec3::new(a.sin(), (a * 1.7).cos(), (a * 0.6).cos()), Vec3::new(0.03, -0.05, 0.11));
            let sixteen = fearless_simd::dispatch!(fearless_simd::Level::new(), simd => {
                patchy.sample_sixteen(simd, 0xffff, start, step)
            });
            for (k, [r, g, b, a]) in sixteen.into_iter().enumerate() {
                let found = (a > 0).then_some([r, g, b]);
                let expected = patchy.sample(start + step * k as f32);
                assert_eq!(found.is_some(), expected.is_some(), "{i} {k}");
                let levels =
                    found.zip(expected).map_or(0, |(f, e)| (0..3).map(|c| f[c].abs_diff(e[c])).fold(0, u8::max));
                assert!(levels <= WEIGHT_LEVELS, "{i} {k}: {found:?} {expected:?}");
                (found_any, lacked_any) = (found_any || found.is_some(), lacked_any || found.is_none());
            }
        }
        assert!(found_any && lacked_any);
    }

    #[test]
    fn texels_that_no_miss_reached_do_not_count() {
        let upper = by_direction(8, |d| if d.y > 0.0 { [200, 100, 50, 255] } else { [0, 0, 0, 0] });
        assert_eq!(upper.sample(Vec3::new(1.0, 0.05, 0.0)), Some([200, 100, 50]));
        assert_eq!(upper.sample(Vec3::NEG_Y), None);
        assert_eq!(upper.sample(Vec3::NAN), None);
        assert_eq!(Environment { size_px: 0, texels: vec![] }.sample(Vec3::X), None);
    }
}
