//! Rays from the faces of a cube in the order of a capture's strata.

use glam::{DVec3, Vec3};
use headbox_core::random::Rng;
use headbox_trace::bvh::{PACKET, Ray, RayPacket};

/// Rays, `[component][ray]`: origin x, y, z, direction x, y, z.
pub(crate) type Rays = [Vec<f32>; 6];

/// Maps the unit square to the unit disk, preserving area (Shirley and Chiu 1997).
fn disk(u: f64, v: f64) -> (f64, f64) {
    let a = 2.0 * u - 1.0;
    let b = 2.0 * v - 1.0;
    let quarter = std::f64::consts::FRAC_PI_4;
    let (r, phi) = if a.abs() > b.abs() {
        (a, quarter * (b / a))
    } else {
        (b, quarter * (2.0 - a / b))
    };
    if r == 0.0 {
        (0.0, 0.0)
    } else {
        (r * phi.cos(), r * phi.sin())
    }
}

/// Generates `m` cosine-weighted rays in each of the `n`^4 strata of each face.
pub(crate) fn cube_rays(centre: DVec3, half: f64, n: u32, m: u32, faces: &str) -> Rays {
    let mut rays: Rays = Default::default();
    let mut random = Rng::keyed(1);
    for face in faces.bytes().map(|b| usize::from(b.wrapping_sub(b'0')) % 6) {
        let axis = face / 2;
        let sign = if face % 2 == 0 { 1.0 } else { -1.0 };
        let right = (axis + 1) % 3;
        let up = (axis + 2) % 3;
        for stratum in 0..n.pow(4) {
            let cell = [
                stratum / n.pow(3),
                stratum / n.pow(2) % n,
                stratum / n % n,
                stratum % n,
            ];
            for _ in 0..m {
                let q = cell.map(|c| (f64::from(c) + random.unit()) / f64::from(n));
                let (x, y) = disk(q[2], q[3]);
                let mut origin = centre;
                let mut direction = DVec3::ZERO;
                origin[axis] += sign * half;
                origin[right] += half * (2.0 * q[0] - 1.0);
                origin[up] += half * (2.0 * q[1] - 1.0);
                direction[axis] = sign * (1.0 - x * x - y * y).max(1e-6).sqrt();
                direction[right] = x;
                direction[up] = y;
                for i in 0..3 {
                    rays[i].push(origin[i] as f32);
                    rays[i + 3].push(direction[i] as f32);
                }
            }
        }
    }
    rays
}

/// Loads a packet of the 16 rays from `start` on, fewer at the end.
pub(crate) fn load_packet(rays: &Rays, start: usize) -> RayPacket {
    let mut packet = RayPacket::EMPTY;
    let len = PACKET.min(rays[0].len() - start);
    for i in 0..3 {
        packet.origin[i][..len].copy_from_slice(&rays[i][start..start + len]);
        packet.direction[i][..len].copy_from_slice(&rays[i + 3][start..start + len]);
    }
    packet.active = (u32::from(u16::MAX) >> (PACKET - len)) as u16;
    packet
}

/// Loads ray `i`, without distance limits.
pub(crate) fn load_ray(rays: &Rays, i: usize) -> Ray {
    let [ox, oy, oz, dx, dy, dz] = [0, 1, 2, 3, 4, 5].map(|component: usize| rays[component][i]);
    Ray::new(Vec3::new(ox, oy, oz), Vec3::new(dx, dy, dz))
}
