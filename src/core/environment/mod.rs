//! Environment at infinity, sampled by direction; `lanes` samples sixteen adjacent pixels at once.

mod file;
mod lanes;

use crate::cube_face::{Face, MAX_FACE_SIZE_PX};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Error of an invalid environment.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EnvironmentError {
    /// The environment does not have six square faces of its size.
    #[error(
        "environment: {texels} texels and {size_px} texels a side; expected six faces of at most {MAX_FACE_SIZE_PX}"
    )]
    Size {
        /// Size of a face, texels.
        size_px: u32,
        /// Number of texels.
        texels: usize,
    },
    /// An environment texel with an alpha other than 0 and 255.
    #[error("environment texel {index}: alpha {alpha}; it must be 255 (a miss reached it) or 0")]
    Alpha {
        /// Index of the texel.
        index: usize,
        /// Its alpha.
        alpha: u8,
    },
}

/// Environment map: a small cube map of radiance by direction, independent of the eye's position.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Environment {
    /// Size of each face, texels; 0 if no ray ever left the scene (then `texels` is empty).
    pub size_px: u32,
    /// Six faces in the order of [`Face::ALL`], row-major, row 0 on top: sRGB, and alpha 255 where
    /// a real miss reached the texel, 0 where none did.
    pub texels: Vec<[u8; 4]>,
}

/// Expands four bytes to 16 bits each, so that one multiplication scales all.
#[inline]
fn expand([r, g, b, a]: [u8; 4]) -> u64 {
    u64::from(r) | u64::from(g) << 16 | u64::from(b) << 32 | u64::from(a) << 48
}

/// Blends the texels that a miss reached, like [`Environment::blend_quad`]; `None` if there are
/// none.
fn blend_known(texels: [[u8; 4]; 4], [u, v]: [u32; 2]) -> Option<[u8; 3]> {
    let weights = [(256 - u) * (256 - v), u * (256 - v), (256 - u) * v, u * v];
    let (mut sum, mut total) = ([0; 3], 0);
    for (texel, weight) in texels
        .iter()
        .zip(weights)
        .filter(|(texel, _)| texel[3] == 255)
    {
        total += weight;
        sum.iter_mut()
            .zip(texel)
            .for_each(|(sum, c)| *sum += weight * u32::from(*c));
    }
    (total > 0).then(|| sum.map(|s| ((s + total / 2) / total) as u8))
}

impl Environment {
    /// Checks that there are six complete faces and that every alpha is 0 or 255.
    ///
    /// # Errors
    /// [`EnvironmentError::Size`] or [`EnvironmentError::Alpha`].
    pub fn validate(&self) -> Result<(), EnvironmentError> {
        let expected = 6 * u64::from(self.size_px).pow(2);
        if self.size_px > MAX_FACE_SIZE_PX || self.texels.len() as u64 != expected {
            return Err(EnvironmentError::Size {
                size_px: self.size_px,
                texels: self.texels.len(),
            });
        }
        match self.texels.iter().position(|t| t[3] != 0 && t[3] != 255) {
            Some(index) => Err(EnvironmentError::Alpha {
                index,
                alpha: self.texels[index][3],
            }),
            None => Ok(()),
        }
    }

    /// Renders an environment with faces of `size_px` texels. `stored` returns the mean sRGB of
    /// unit directions; each texel averages `side` x `side` directions, and its alpha is 255 where
    /// `reached(texel index)` is true.
    pub fn from_radiance(
        size_px: u32,
        side: u32,
        stored: impl Fn(&mut dyn Iterator<Item = Vec3>) -> [u8; 3] + Sync,
        reached: impl Fn(usize) -> bool + Sync,
    ) -> Self {
        let per_face = size_px as usize * size_px as usize;
        let texel = |at: usize| {
            let x = (at % per_face) as u32 % size_px;
            let y = (at % per_face) as u32 / size_px;
            let within = |i: u32| (f64::from(i) + 0.5) / f64::from(side);
            let mut directions = (0..side * side).map(|i| {
                let x = f64::from(x) + within(i % side);
                let y = f64::from(y) + within(i / side);
                Face::ALL[at / per_face]
                    .direction(x, y, size_px)
                    .normalize()
                    .as_vec3()
            });
            let [r, g, b] = stored(&mut directions);
            [r, g, b, if reached(at) { 255 } else { 0 }]
        };
        Self {
            size_px,
            texels: (0..6 * per_face).into_par_iter().map(texel).collect(),
        }
    }

    /// Samples the cube map bilinearly in a direction (world axes, any length), sRGB. Texels that
    /// no miss reached are ignored; `None` if that leaves none (or the direction is not finite).
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
        let within = [
            ((x - left as f32) * 256.0) as u32,
            ((y - top as f32) * 256.0) as u32,
        ];
        if inside {
            self.blend_quad(first, within)
        } else {
            self.sample_across_faces(direction.as_dvec3())
        }
    }

    /// Blends the texel of index `first`, the one right of it, and the two below, by the distances
    /// from the first in 1/256. All four lie on one face.
    #[inline(always)]
    fn blend_quad(&self, first: usize, [u, v]: [u32; 2]) -> Option<[u8; 3]> {
        let size = self.size_px as usize;
        let upper = self.texels.get(first..first + 2)?;
        let lower = self.texels.get(first + size..first + size + 2)?;
        let [a, b, c, d] = [upper[0], upper[1], lower[0], lower[1]];
        if a[3] & b[3] & c[3] & d[3] != 255 {
            return blend_known([a, b, c, d], [u, v]);
        }
        // Each of the two roundings is at most half a level.
        let mix = |a: u64, b: u64, share: u32| {
            let share = u64::from(share);
            ((a * (256 - share) + b * share + 0x0080_0080_0080_0080) >> 8) & 0x00ff_00ff_00ff_00ff
        };
        let [r, _, g, _, b, ..] = mix(
            mix(expand(a), expand(b), u),
            mix(expand(c), expand(d), u),
            v,
        )
        .to_le_bytes();
        Some([r, g, b])
    }

    fn sample_across_faces(&self, direction: DVec3) -> Option<[u8; 3]> {
        let face = Face::containing(direction);
        let [x, y, _] = face.project(direction, self.size_px);
        let (x, y) = (x - 0.5, y - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (u, v) = (x - left, y - top);
        let mut sum = [0.0; 3];
        let mut total = 0.0;
        for (dx, dy, weight) in [
            (0, 0, (1.0 - u) * (1.0 - v)),
            (1, 0, u * (1.0 - v)),
            (0, 1, (1.0 - u) * v),
            (1, 1, u * v),
        ] {
            let texel = self.texel(face, left as i64 + dx, top as i64 + dy);
            if let Some(color) = texel.filter(|t| t[3] == 255) {
                total += weight;
                for c in 0..3 {
                    sum[c] += weight * f64::from(color[c]);
                }
            }
        }
        // A total this small is rounding: the only texel with a real weight has alpha 0.
        (total > 1e-6).then(|| sum.map(|s| (s / total + 0.5) as u8))
    }

    /// Returns texel (x, y) of a face; one step beyond its border, the adjacent texel of the
    /// neighbouring face.
    fn texel(&self, face: Face, x: i64, y: i64) -> Option<[u8; 4]> {
        let size = i64::from(self.size_px);
        let at = |face: Face, x: i64, y: i64| {
            let index = face.index() as i64 * size * size
                + y.clamp(0, size - 1) * size
                + x.clamp(0, size - 1);
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
pub(super) mod tests {
    use super::*;

    pub(super) fn by_direction(size_px: u32, color: impl Fn(DVec3) -> [u8; 4]) -> Environment {
        let mut texels = Vec::new();
        for face in Face::ALL {
            for y in 0..size_px {
                for x in 0..size_px {
                    texels.push(color(
                        face.direction(f64::from(x) + 0.5, f64::from(y) + 0.5, size_px)
                            .normalize(),
                    ));
                }
            }
        }
        Environment { size_px, texels }
    }

    #[test]
    fn smooth_environment_is_smooth_across_edges() {
        let ramp = |d: DVec3| {
            let c = |v: f64| (127.5 + 127.0 * v).round() as u8;
            [c(d.x), c(d.y), c(d.z), 255]
        };
        let environment = by_direction(32, ramp);
        // One texel of 32 spans up to 1/16 of a unit: linear interpolation of a sine errs by less
        // than 2 levels; at the border of a face the neighbour's texels are not on the same grid,
        // which costs up to half a texel, 4.
        const LEVELS: i32 = 5;
        for i in 0..5000 {
            let a = f64::from(i) * 2.399_963;
            let z = 1.0 - (f64::from(i) + 0.5) / 2500.0;
            let d = DVec3::new(
                (1.0 - z * z).sqrt() * a.cos(),
                (1.0 - z * z).sqrt() * a.sin(),
                z,
            );
            let found = environment.sample(d.as_vec3() * 7.0).expect("filled");
            let expected = ramp(d);
            for c in 0..3 {
                assert!(
                    (i32::from(found[c]) - i32::from(expected[c])).abs() <= LEVELS,
                    "{d}: {found:?} {expected:?}"
                );
            }
        }
    }

    #[test]
    fn texels_that_no_miss_reached_do_not_count() {
        let upper = by_direction(8, |d| {
            if d.y > 0.0 {
                [200, 100, 50, 255]
            } else {
                [0, 0, 0, 0]
            }
        });
        assert_eq!(
            upper.sample(Vec3::new(1.0, 0.05, 0.0)),
            Some([200, 100, 50])
        );
        assert_eq!(upper.sample(Vec3::NEG_Y), None);
        assert_eq!(upper.sample(Vec3::NAN), None);
        assert_eq!(
            Environment {
                size_px: 0,
                texels: vec![]
            }
            .sample(Vec3::X),
            None
        );
    }
}
