//! 11-bit encoding of a sample's normal and distance (S20, S22, C10).
//!
//! Normals are coded in the *face frame*: the eye space of the face's camera, x right, y up, z back
//! toward the centre. A surface on the face's axis that faces the centre has the normal (0, 0, 1).
//!
//! * [`SplatIndexLayout::Paper`]: `nx << 8 | ny << 5 | depth`. nx and ny are 3-bit codes of -1..1,
//!   z follows from them and is never negative; depth is a 5-bit code, exponential between the
//!   segment's nearest and farthest eye depth. The 12 of 64 pairs whose centres lie outside the
//!   unit disk are projected to its border (z = 0).
//! * [`SplatIndexLayout::Normal`]: rings of equal polar angle about z, each divided into equal
//!   azimuths. A normal faces the ray that hit its surface, so nearly all lie within 100 degrees of
//!   z: 28 rings of 3.6 degrees cover these, and 5 coarse rings the others (hits of rays that start
//!   at one face and belong to another).

use super::packed_depth_pixel::SplatIndexLayout;
use glam::{DVec3, Vec3};
use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

/// Number of splat indices: eleven bits.
pub const SPLAT_INDEX_COUNT: usize = 2048;

/// Number of depth codes in [`SplatIndexLayout::Paper`].
pub const DEPTH_CODE_COUNT: usize = 32;

const FRONT_RINGS: usize = 28;
const FRONT_STEP_RAD: f64 = 3.6 * PI / 180.0;
const BACK_RINGS: usize = 5;
const RING_COUNT: usize = FRONT_RINGS + BACK_RINGS;
const FRONT_END_RAD: f64 = FRONT_RINGS as f64 * FRONT_STEP_RAD;
const BACK_STEP_RAD: f64 = (PI - FRONT_END_RAD) / BACK_RINGS as f64;

/// Computes the polar angle of a ring's middle and the width of the ring, radians.
fn ring(i: usize) -> (f64, f64) {
    if i < FRONT_RINGS {
        ((i as f64 + 0.5) * FRONT_STEP_RAD, FRONT_STEP_RAD)
    } else {
        (
            FRONT_END_RAD + ((i - FRONT_RINGS) as f64 + 0.5) * BACK_STEP_RAD,
            BACK_STEP_RAD,
        )
    }
}

/// First code of every ring, and the end.
static RING_STARTS: LazyLock<[usize; RING_COUNT + 1]> = LazyLock::new(|| {
    let mut starts = [0; RING_COUNT + 1];
    for i in 0..RING_COUNT {
        let (angle, step) = ring(i);
        starts[i + 1] = starts[i] + ((TAU * angle.sin() / step).round() as usize).max(1);
    }
    starts
});

/// Decoded normals of [`SplatIndexLayout::Normal`]; codes that no ring uses decode to +z.
static RING_NORMALS: LazyLock<Box<[Vec3; SPLAT_INDEX_COUNT]>> = LazyLock::new(|| {
    let mut normals = Box::new([Vec3::Z; SPLAT_INDEX_COUNT]);
    for i in 0..RING_COUNT {
        let (angle, _) = ring(i);
        let (start, end) = (RING_STARTS[i], RING_STARTS[i + 1].min(SPLAT_INDEX_COUNT));
        for code in start..end {
            let azimuth = TAU * ((code - start) as f64 + 0.5) / (RING_STARTS[i + 1] - start) as f64;
            let n = DVec3::new(
                angle.sin() * azimuth.cos(),
                angle.sin() * azimuth.sin(),
                angle.cos(),
            );
            normals[code] = n.as_vec3();
        }
    }
    normals
});

/// Range of eye depths that the 5-bit depth code of a segment covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthCodeRange {
    /// Eye depth of the nearest sample, metres.
    pub nearest_m: f64,
    /// Eye depth of the farthest sample, metres.
    pub farthest_m: f64,
}

impl DepthCodeRange {
    /// Creates the range of a segment whose inverse depths lie between `min` and `max`.
    pub fn from_inverse_depths(min: f32, max: f32) -> Self {
        Self {
            nearest_m: 1.0 / f64::from(max),
            farthest_m: 1.0 / f64::from(min),
        }
    }

    /// Computes the 5-bit code of an eye depth: equal ratios of depth get equal numbers of codes.
    fn encode(self, eye_depth: f64) -> usize {
        let octaves = (self.farthest_m / self.nearest_m).ln();
        let t = if octaves > 0.0 {
            (eye_depth / self.nearest_m).ln() / octaves
        } else {
            0.0
        };
        ((t * DEPTH_CODE_COUNT as f64) as usize).min(DEPTH_CODE_COUNT - 1)
    }

    /// Computes the eye depth in the (geometric) middle of a code's interval, metres.
    pub fn decode(self, code: usize) -> f64 {
        let t = (code as f64 + 0.5) / DEPTH_CODE_COUNT as f64;
        self.nearest_m * (self.farthest_m / self.nearest_m).powf(t)
    }
}

impl SplatIndexLayout {
    /// Encodes a unit normal in the face frame at an eye depth as a splat index.
    pub fn encode(self, normal_in_face: DVec3, eye_depth: f64, range: DepthCodeRange) -> u32 {
        let code = match self {
            Self::Paper => {
                let n = if normal_in_face.z < 0.0 {
                    normal_in_face.with_z(0.0).normalize_or(DVec3::X)
                } else {
                    normal_in_face
                };
                let axis = |c: f64| (((c + 1.0) * 4.0) as usize).min(7);
                (axis(n.x) << 3 | axis(n.y)) << 5 | range.encode(eye_depth)
            }
            Self::Normal => {
                let angle = normal_in_face.z.clamp(-1.0, 1.0).acos();
                let i = if angle < FRONT_END_RAD {
                    (angle / FRONT_STEP_RAD) as usize
                } else {
                    (FRONT_RINGS + ((angle - FRONT_END_RAD) / BACK_STEP_RAD) as usize)
                        .min(RING_COUNT - 1)
                };
                let count = RING_STARTS[i + 1] - RING_STARTS[i];
                let turn = normal_in_face.y.atan2(normal_in_face.x).rem_euclid(TAU) / TAU;
                RING_STARTS[i] + ((turn * count as f64) as usize).min(count - 1)
            }
        };
        code as u32
    }

    /// Corrects the splat index of a sample so that a surface that faces the centre still does
    /// after decoding; `toward` is the unit vector from the centre to the sample. Without this, a
    /// floor seen edge-on may become a ceiling, which is less than a code away, and its footprints
    /// shrink on the side on which they must grow. The correction is too small in the corners of a
    /// face for normals that point away from its front, where codes are coarse.
    fn keep_facing(
        self,
        index: u32,
        normal_in_face: DVec3,
        toward: DVec3,
        eye_depth: f64,
        range: DepthCodeRange,
    ) -> u32 {
        let is_flipped =
            normal_in_face.dot(toward) < 0.0 && self.normal(index).as_dvec3().dot(toward) >= 0.0;
        match self {
            Self::Normal if is_flipped => self.encode(
                (normal_in_face - toward * FRONT_STEP_RAD).normalize(),
                eye_depth,
                range,
            ),
            Self::Normal | Self::Paper => index,
        }
    }

    /// Decodes the unit normal of a splat index, in the face frame.
    pub fn normal(self, index: u32) -> Vec3 {
        let index = index as usize % SPLAT_INDEX_COUNT;
        match self {
            Self::Paper => {
                let axis = |code: usize| (code as f32 + 0.5) / 4.0 - 1.0;
                let (x, y) = (axis(index >> 8), axis(index >> 5 & 7));
                Vec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt()).normalize()
            }
            Self::Normal => RING_NORMALS[index],
        }
    }

    /// Returns the number of valid indices.
    pub fn index_count(self) -> usize {
        match self {
            Self::Paper => SPLAT_INDEX_COUNT,
            Self::Normal => RING_STARTS[RING_COUNT],
        }
    }
}

/// Encoder of consecutive samples: it caches the code of the last normal, as neighbours mostly have
/// equal normals.
pub(crate) struct SplatCoder {
    layout: SplatIndexLayout,
    range: DepthCodeRange,
    /// The bits of the last normal and its code; `None` for the layout in which the code also
    /// depends on depth.
    last: Option<([u64; 3], u32)>,
}

impl SplatCoder {
    pub(crate) fn new(layout: SplatIndexLayout, range: DepthCodeRange) -> Self {
        Self {
            layout,
            range,
            last: None,
        }
    }

    /// Encodes a sample with this normal in the face frame; `toward` is the unit vector from the
    /// centre to the sample, in the face frame.
    pub(crate) fn encode(&mut self, normal_in_face: DVec3, toward: DVec3, eye_depth: f64) -> u32 {
        let bits = normal_in_face.to_array().map(f64::to_bits); // The angles of -0 and 0 differ.
        let index = match self.last {
            Some((last, index)) if last == bits => index,
            _ => self.layout.encode(normal_in_face, eye_depth, self.range),
        };
        self.last = (self.layout == SplatIndexLayout::Normal).then_some((bits, index));
        self.layout
            .keep_facing(index, normal_in_face, toward, eye_depth, self.range)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half the diagonal of the largest cell, degrees: a front ring is 3.6 degrees wide and cut
    /// into about as long pieces, the first ones (few, and rounded to a whole number) up to 4.4; a
    /// back ring 16 by up to 21 on its wider side; the paper's cells are 1/4 of a unit of x and y,
    /// which at the rim is as steep as acos(1 - 1/4) = 41 degrees.
    const WORST_FRONT_DEG: f32 = 2.9;
    const WORST_BACK_DEG: f32 = 13.5;
    const WORST_PAPER_DEG: f32 = 30.0;

    #[test]
    fn rings_fit_into_eleven_bits() {
        let count = SplatIndexLayout::Normal.index_count();
        assert!((1900..=SPLAT_INDEX_COUNT).contains(&count), "{count}");
    }

    #[test]
    fn normals_survive_both_codes() {
        let range = DepthCodeRange {
            nearest_m: 1.0,
            farthest_m: 100.0,
        };
        let mut worst = [0.0f32; 3];
        for i in 0..40_000 {
            let (a, z) = (
                f64::from(i) * 2.399_963,
                1.0 - (f64::from(i) + 0.5) / 20_000.0,
            );
            let r = (1.0 - z * z).sqrt();
            let n = DVec3::new(r * a.cos(), r * a.sin(), z);
            let error = |layout: SplatIndexLayout| {
                let index = layout.encode(n, 7.0, range);
                assert!((index as usize) < layout.index_count());
                layout.normal(index).angle_between(n.as_vec3()).to_degrees()
            };
            let zone = usize::from(z < FRONT_END_RAD.cos());
            worst[zone] = worst[zone].max(error(SplatIndexLayout::Normal));
            if z >= 0.0 {
                worst[2] = worst[2].max(error(SplatIndexLayout::Paper));
            }
        }
        assert!(
            worst[0] < WORST_FRONT_DEG && worst[1] < WORST_BACK_DEG && worst[2] < WORST_PAPER_DEG,
            "{worst:?}"
        );
    }

    #[test]
    fn coding_is_independent_of_predecessors() {
        let range = DepthCodeRange {
            nearest_m: 1.0,
            farthest_m: 100.0,
        };
        for layout in [SplatIndexLayout::Normal, SplatIndexLayout::Paper] {
            let mut after_others = SplatCoder::new(layout, range);
            for i in 0..6_000 {
                // Three samples in turn have one normal; of these some differ in the sign of a
                // zero, and all in depth.
                let turn = f64::from(i / 3 % 40) * 0.4;
                let flat = if i % 2 == 0 { 0.0 } else { -0.0 };
                let normal = DVec3::new(-turn.sin().abs(), flat, turn.cos());
                let toward = DVec3::new((f64::from(i) * 0.7).sin(), 0.3, -1.0).normalize();
                let eye_depth = 1.0 + f64::from(i % 97);
                let alone = SplatCoder::new(layout, range).encode(normal, toward, eye_depth);
                assert_eq!(
                    after_others.encode(normal, toward, eye_depth),
                    alone,
                    "{normal} {toward} {eye_depth}"
                );
            }
        }
    }

    #[test]
    fn edge_on_normal_stays_edge_on() {
        let range = DepthCodeRange {
            nearest_m: 1.0,
            farthest_m: 100.0,
        };
        let layout = SplatIndexLayout::Normal;
        let mut turned_over = 0;
        for i in 0..20_000 {
            let turn = f64::from(i) * 2.399_963;
            let toward = DVec3::new(turn.sin() * 0.9, (turn * 1.7).cos() * 0.9, -1.0).normalize();
            // Seen at up to 3 degrees, from either side.
            let along = toward.any_orthonormal_vector();
            let across = along * turn.cos() + toward.cross(along) * turn.sin();
            let normal = (across + toward * (f64::from(i % 101) - 50.0) * 1e-3).normalize();
            let faces = |index: u32| layout.normal(index).as_dvec3().dot(toward) < 0.0;
            let coded = layout.encode(normal, 7.0, range);
            let seen = SplatCoder::new(layout, range).encode(normal, toward, 7.0);
            if normal.dot(toward) >= 0.0 || faces(coded) {
                assert_eq!(coded, seen, "nothing to be mended");
                continue;
            }
            // Beyond the front rings codes lie too far apart.
            if normal.z < (FRONT_END_RAD - 2.0 * FRONT_STEP_RAD).cos() {
                continue;
            }
            turned_over += 1;
            let error_deg = layout
                .normal(seen)
                .angle_between(normal.as_vec3())
                .to_degrees();
            assert!(
                faces(seen) && error_deg < WORST_FRONT_DEG + 3.6,
                "{toward} {normal}: {error_deg}"
            );
        }
        assert!(turned_over > 300, "{turned_over}");
    }

    #[test]
    fn full_turn_stays_in_ring() {
        let range = DepthCodeRange {
            nearest_m: 1.0,
            farthest_m: 100.0,
        };
        for degrees in [10.0f64, 45.0, 80.0] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            // A hair below the x axis: the rest of a whole turn is the whole turn itself, in f64.
            let normal = DVec3::new(sin, -1e-20, cos);
            let found = SplatIndexLayout::Normal
                .normal(SplatIndexLayout::Normal.encode(normal, 7.0, range));
            assert!(
                found.angle_between(normal.as_vec3()).to_degrees() < WORST_FRONT_DEG,
                "{degrees}: {found}"
            );
        }
    }

    #[test]
    fn depth_codes_err_by_half_a_ratio_step() {
        for ratio in [10.0f64, 100.0, 1000.0] {
            let range = DepthCodeRange {
                nearest_m: 0.5,
                farthest_m: 0.5 * ratio,
            };
            let half_step = ratio.powf(0.5 / DEPTH_CODE_COUNT as f64);
            for i in 0..=1000 {
                let depth = 0.5 * ratio.powf(f64::from(i) / 1000.0);
                let error = range.decode(range.encode(depth)) / depth;
                assert!(
                    error <= half_step * 1.000_001 && error >= 1.0 / half_step / 1.000_001,
                    "{ratio}: {error}"
                );
            }
        }
        let flat = DepthCodeRange {
            nearest_m: 2.0,
            farthest_m: 2.0,
        };
        assert_eq!(flat.decode(flat.encode(2.0)), 2.0);
    }
}
