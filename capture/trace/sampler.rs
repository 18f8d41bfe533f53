//! Sampling of capture rays: planar ray domains, their 4-D strata, and the square-to-disk map.
//!
//! A *ray domain* is a parallelogram window (a face of the headbox, or the opening of a portal)
//! with positions uniform on it and directions cosine-weighted about its outward normal: the
//! density under which every ray that crosses the window is equally likely (Shade et al. section
//! 4.2; S15). The four dimensions are cut into `N^4` strata with `M` rays each.
//!
//! Strata are visited direction by direction, all positions of one direction cell together (a
//! [`DirectionCell`]): those rays are nearly parallel, so that they walk the same part of the tree,
//! and land close together in the LDI.

use crate::bvh::{PACKET, RayPacket};
use glam::{DVec3, Vec3};
use headbox_core::cube_face::Face;

/// A planar window and the half space of its rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayDomain {
    /// Centre of the window in the tracer's local frame, metres.
    pub centre: Vec3,
    /// Vector from the centre to the middle of one edge, metres.
    pub half_u: Vec3,
    /// Vector from the centre to the middle of the other edge, metres; perpendicular to `half_u`.
    pub half_v: Vec3,
    /// Unit outward normal.
    pub normal: Vec3,
}

impl RayDomain {
    /// Creates the domain of a face of the cube of half-size `half_size_m` about the local origin.
    pub fn cube_face(face: Face, half_size_m: f64) -> Self {
        let scaled = |v: DVec3| (v * half_size_m).as_vec3();
        Self {
            centre: scaled(face.normal()),
            half_u: scaled(face.right()),
            half_v: scaled(face.up()),
            normal: face.normal().as_vec3(),
        }
    }
}

/// Sampling pattern of the 4-D domain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sampling {
    /// Jittered inside each stratum (S15, the default).
    #[default]
    Stratified,
    /// Independent over the whole domain; the baseline that the paper argues against.
    WhiteNoise,
}

/// The size of the 4-D grid and its seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strata {
    /// Cells along each of the four dimensions (N).
    pub per_dimension: u32,
    /// Rays in each stratum (M).
    pub rays: u32,
    /// Random seed.
    pub seed: u64,
    /// Placement of rays.
    pub sampling: Sampling,
}

impl Strata {
    /// Maximum number of cells along a dimension, so that the index of a stratum fits 32 bits.
    pub const MAX_PER_DIMENSION: u32 = 128;
    /// Maximum number of rays in a stratum, so that their index fits the low bits of a [`RayKey`].
    pub const MAX_RAYS: u32 = 1 << 20;

    /// Number of direction cells of one domain.
    pub fn direction_cells(&self) -> u32 {
        self.per_dimension.pow(2)
    }

    /// Number of position cells of one domain.
    pub fn position_cells(&self) -> u32 {
        self.per_dimension.pow(2)
    }
}

/// Identifier of a ray: domain (8 bits), stratum (32 bits), index in its stratum (24 bits). It
/// orders rays independently of threads, so that ties between samples never depend on arrival
/// order.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, bytemuck::Pod, bytemuck::Zeroable,
)]
#[repr(transparent)]
pub struct RayKey(pub u64);

impl RayKey {
    /// Creates the key of ray `ray` in stratum `stratum` of domain `domain`.
    pub fn new(domain: u8, stratum: u32, ray: u32) -> Self {
        Self(u64::from(domain) << 56 | u64::from(stratum) << 24 | u64::from(ray & 0xff_ffff))
    }

    /// Returns the index of the domain.
    pub fn domain(self) -> u8 {
        (self.0 >> 56) as u8
    }

    /// Returns the index of the stratum: direction cell times position cells, plus position cell.
    pub fn stratum(self) -> u32 {
        (self.0 >> 24) as u32
    }

    /// Returns the index of the ray in its stratum.
    pub fn ray(self) -> u32 {
        (self.0 & 0xff_ffff) as u32
    }
}

/// Hashes four counters to four independent 32-bit random numbers (Jarzynski and Olano 2020, "Hash
/// functions for GPU rendering", `pcg4d`).
#[inline(always)]
pub fn random4(mut v: [u32; 4]) -> [u32; 4] {
    for x in &mut v {
        *x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    }
    let mix = |v: &mut [u32; 4]| {
        v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[3]));
        v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
        v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
        v[3] = v[3].wrapping_add(v[1].wrapping_mul(v[2]));
    };
    mix(&mut v);
    for x in &mut v {
        *x ^= *x >> 16;
    }
    mix(&mut v);
    v
}

/// Converts a random 32-bit number to a float in [0, 1).
#[inline]
pub fn unit_float(random: u32) -> f32 {
    (random >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Maps the unit square to the unit disk, keeping areas (Shirley and Chiu 1997, the concentric
/// map). Polynomials in place of `sin` and `cos` keep the result the same on every machine; their
/// error is below 4e-7.
#[inline(always)]
pub(crate) fn disk_from_square(u: f32, v: f32) -> [f32; 2] {
    use std::f32::consts::FRAC_PI_4;
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    let a_is_radius = a.abs() > b.abs();
    let (radius, other) = if a_is_radius { (a, b) } else { (b, a) };
    let ratio = other / if radius == 0.0 { 1.0 } else { radius };
    let phi = FRAC_PI_4 * ratio;
    let p2 = phi * phi;
    let sin = phi * (1.0 - p2 * (1.0 / 6.0 - p2 * (1.0 / 120.0 - p2 * (1.0 / 5040.0))));
    let cos = 1.0 - p2 * (0.5 - p2 * (1.0 / 24.0 - p2 * (1.0 / 720.0 - p2 * (1.0 / 40320.0))));
    let (along, across) = (radius * cos, radius * sin);
    if a_is_radius {
        [along, across]
    } else {
        [across, along]
    }
}

/// Inverts [`disk_from_square`].
pub(crate) fn square_from_disk([x, y]: [f32; 2]) -> [f32; 2] {
    use std::f32::consts::FRAC_PI_4;
    let x_is_radius = x.abs() > y.abs();
    let (along, across) = if x_is_radius { (x, y) } else { (y, x) };
    let radius = x.hypot(y).copysign(along);
    let other = if along == 0.0 {
        0.0
    } else {
        radius * (across / along).atan() / FRAC_PI_4
    };
    let [a, b] = if x_is_radius {
        [radius, other]
    } else {
        [other, radius]
    };
    [0.5 * a + 0.5, 0.5 * b + 0.5]
}

/// Samples a direction about +Z, cosine-weighted, from two numbers in [0, 1).
#[inline(always)]
pub(crate) fn cosine_direction(u: f32, v: f32) -> [f32; 3] {
    let [x, y] = disk_from_square(u, v);
    // A direction exactly in the window's plane would not leave it.
    let z = (1.0 - x * x - y * y).max(1e-6).sqrt();
    [x, y, z]
}

/// The rays of one domain in one direction cell: the unit of work of a capture.
#[derive(Clone, Copy, Debug)]
pub struct DirectionCell {
    /// The window.
    pub domain: RayDomain,
    /// Index of the window, part of each ray's key.
    pub domain_number: u8,
    /// The grid.
    pub strata: Strata,
    /// Direction cell, row-major over the square that maps to the disk of directions.
    pub cell: u32,
}

impl DirectionCell {
    /// Returns the key of a ray.
    pub fn key(&self, position_cell: u32, ray: u32) -> RayKey {
        RayKey::new(
            self.domain_number,
            self.cell * self.strata.position_cells() + position_cell,
            ray,
        )
    }

    /// Fills `packet` with up to 16 rays, each given by its position cell and its index in the
    /// stratum; the other lanes are inactive.
    pub fn fill_packet(&self, ids: &[(u32, u32)], packet: &mut RayPacket) {
        let mut square = [[0.0f32; PACKET]; 4];
        self.square_positions(ids, &mut square);
        let RayDomain {
            centre,
            half_u,
            half_v,
            normal,
        } = self.domain;
        let (unit_u, unit_v) = (half_u.normalize_or_zero(), half_v.normalize_or_zero());
        for lane in 0..PACKET {
            let (s, t) = (2.0 * square[0][lane] - 1.0, 2.0 * square[1][lane] - 1.0);
            let [x, y, z] = cosine_direction(square[2][lane], square[3][lane]);
            for axis in 0..3 {
                packet.origin[axis][lane] = centre[axis] + s * half_u[axis] + t * half_v[axis];
                packet.direction[axis][lane] =
                    x * unit_u[axis] + y * unit_v[axis] + z * normal[axis];
            }
        }
        packet.t_min = [0.0; PACKET];
        packet.t_max = [f32::INFINITY; PACKET];
        packet.active = ((1u32 << ids.len()) - 1) as u16;
    }

    /// Computes the rays' positions in the unit 4-cube: two coordinates of position, two of
    /// direction.
    fn square_positions(&self, ids: &[(u32, u32)], square: &mut [[f32; PACKET]; 4]) {
        let n = self.strata.per_dimension;
        let scale = 1.0 / n as f32;
        let mut counters = [[0u32; PACKET]; 3];
        for (lane, &(position_cell, ray)) in ids.iter().enumerate() {
            counters[0][lane] = position_cell;
            counters[1][lane] = ray;
        }
        counters[2] = [self.cell; PACKET];
        let seed = self.strata.seed;
        let key = (seed as u32)
            .wrapping_add(((seed >> 32) as u32).wrapping_mul(0x9e37_79b9))
            .wrapping_add(u32::from(self.domain_number).wrapping_mul(0x85eb_ca6b));
        let (dir_x, dir_y) = ((self.cell % n) as f32, (self.cell / n) as f32);
        let stratified = self.strata.sampling == Sampling::Stratified;
        for lane in 0..PACKET {
            let random = random4([counters[0][lane], counters[1][lane], counters[2][lane], key])
                .map(unit_float);
            let position_cell = counters[0][lane];
            let corner = [
                (position_cell % n) as f32,
                (position_cell / n) as f32,
                dir_x,
                dir_y,
            ];
            for dimension in 0..4 {
                // `min`: rounding may carry (n - 1 + 0.99999994) / n up to 1.
                square[dimension][lane] = if stratified {
                    ((corner[dimension] + random[dimension]) * scale).min(0.999_999_94)
                } else {
                    random[dimension]
                };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn square_from_disk_inverts_map() {
        let steps = [
            0.0, 1e-6, 0.1, 0.25, 0.499_999, 0.5, 0.500_001, 0.7, 0.999, 1.0,
        ];
        for (u, v) in steps.iter().flat_map(|&u| steps.map(|v| (u, v))) {
            let [x, y] = square_from_disk(disk_from_square(u, v));
            // The polynomials' error (4e-7) and a few roundings.
            assert!(
                (x - u).abs() < 2e-6 && (y - v).abs() < 2e-6,
                "{u}, {v}: {x}, {y}"
            );
        }
    }

    #[test]
    fn disk_map_matches_trigonometry_and_keeps_areas() {
        /// Truncated series at pi/4 (2.5e-7) plus a few roundings.
        const POLYNOMIAL_ERROR: f32 = 1e-6;
        let mut inside_half_radius = 0i32;
        let n = 200;
        for i in 0..n {
            for j in 0..n {
                let (u, v) = ((i as f32 + 0.5) / n as f32, (j as f32 + 0.5) / n as f32);
                let [x, y] = disk_from_square(u, v);
                let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
                let quarter = std::f32::consts::FRAC_PI_4;
                let (r, phi) = if a.abs() > b.abs() {
                    (a, quarter * b / a)
                } else {
                    (b, 2.0 * quarter - quarter * a / b)
                };
                assert!(
                    (x - r * phi.cos()).abs() < POLYNOMIAL_ERROR
                        && (y - r * phi.sin()).abs() < POLYNOMIAL_ERROR
                );
                inside_half_radius += i32::from(x * x + y * y < 0.25);
            }
        }
        let share = f64::from(inside_half_radius) / f64::from(n * n);
        assert!(
            (share - 0.25).abs() < 0.01,
            "a disk of half the radius holds a quarter of the area: {share}"
        );
        assert_eq!(disk_from_square(0.5, 0.5), [0.0, 0.0]);
    }

    fn face_cell(cell: u32, sampling: Sampling) -> DirectionCell {
        let strata = Strata {
            per_dimension: 8,
            rays: 4,
            seed: 3,
            sampling,
        };
        let domain = RayDomain::cube_face(Face::NegY, 0.5);
        DirectionCell {
            domain,
            domain_number: 3,
            strata,
            cell,
        }
    }

    /// Returns the four rays of a stratum.
    fn stratum_packet(cell: &DirectionCell, position_cell: u32) -> RayPacket {
        let mut packet = RayPacket::EMPTY;
        cell.fill_packet(&[0, 1, 2, 3].map(|ray| (position_cell, ray)), &mut packet);
        packet
    }

    #[test]
    fn rays_start_in_stratum_and_leave_cube() {
        for cell in [0, 13, 36, 63] {
            let cell = face_cell(cell, Sampling::Stratified);
            for position_cell in 0..64 {
                let packet = stratum_packet(&cell, position_cell);
                assert_eq!(packet.active, 0b1111);
                for lane in 0..4 {
                    let origin = Vec3::from_array(packet.origin.map(|c| c[lane]));
                    let direction = Vec3::from_array(packet.direction.map(|c| c[lane]));
                    assert!(
                        direction.dot(Vec3::NEG_Y) > 0.0 && (direction.length() - 1.0).abs() < 1e-3
                    );
                    assert_eq!(origin.y, -0.5);
                    let [x, y, _] = Face::NegY.project(origin.as_dvec3(), 8);
                    let v_from_bottom = 8.0 - y;
                    assert!((x - 0.5 - f64::from(position_cell % 8)).abs() <= 0.5 + 1e-5);
                    assert!(
                        (v_from_bottom - 0.5 - f64::from(position_cell / 8)).abs() <= 0.5 + 1e-5
                    );
                }
            }
        }
    }

    #[test]
    fn directions_cosine_weighted() {
        // The mean of the cosine under a cosine density is 2/3; 16,384 rays give a standard error
        // of 0.0018.
        for sampling in [Sampling::Stratified, Sampling::WhiteNoise] {
            let (mut sum, mut count) = (0.0, 0);
            for cell in 0..64 {
                let cell = face_cell(cell, sampling);
                for position_cell in 0..64 {
                    let packet = stratum_packet(&cell, position_cell);
                    sum += packet.direction[1][..4]
                        .iter()
                        .map(|y| f64::from(-y))
                        .sum::<f64>();
                    count += 4;
                }
            }
            let mean = sum / f64::from(count);
            assert!(
                (mean - 2.0 / 3.0).abs() < 4.0 * 0.0018,
                "{sampling:?}: {mean}"
            );
        }
    }

    #[test]
    fn key_fields_round_trip() {
        let key = RayKey::new(5, 0xdead_beef, 0x12_3456);
        assert_eq!(
            (key.domain(), key.stratum(), key.ray()),
            (5, 0xdead_beef, 0x12_3456)
        );
        assert!(RayKey::new(0, 7, 9) < RayKey::new(0, 8, 0));
    }
}
