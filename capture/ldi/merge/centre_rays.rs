//! Rays from the centre through the pixels of a face.

use glam::Vec3;
use headbox_core::cube_face::Face;
use headbox_trace::bvh::{PACKET, Ray, RayPacket};
use headbox_trace::sampler::{random4, unit_float};

/// Generator of rays from the centre through the pixels of a face. Their directions have eye depth
/// 1, so that `t` is eye depth.
#[derive(Clone, Copy)]
pub(crate) struct CentreRays {
    pub(crate) face: Face,
    pub(crate) size_px: u32,
}

impl CentreRays {
    /// Packet number `packet` of evenly distributed rays through a pixel, which start and end at
    /// the eye depths `range`.
    pub(crate) fn packet(&self, pixel: [u32; 2], packet: usize, range: [f32; 2]) -> RayPacket {
        let offsets = self.offsets(pixel).skip(packet * PACKET);
        let mut rays = RayPacket::EMPTY;
        for (k, offset) in offsets.take(PACKET).enumerate() {
            rays.set(k, &self.ray(pixel, offset, range));
        }
        rays
    }

    /// Evenly distributed positions in a pixel, 0 to 1.
    pub(crate) fn offsets(&self, pixel: [u32; 2]) -> impl Iterator<Item = [f64; 2]> {
        // An additive-recurrence set (R2, Roberts 2018), shifted at random.
        const STEPS: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];
        let shift = self.shift(pixel, 0xc0);
        (0..).map(move |k: u32| [0, 1].map(|c| (shift[c] + f64::from(k) * STEPS[c]).fract()))
    }

    /// Random numbers from 0 to 1 for a pixel and a purpose.
    pub(crate) fn shift(&self, [x, y]: [u32; 2], purpose: u32) -> [f64; 2] {
        let [a, b, ..] = random4([self.face.index() as u32, x, y, purpose]).map(unit_float);
        [a, b].map(f64::from)
    }

    /// A ray through a point of a pixel.
    pub(crate) fn ray(&self, [x, y]: [u32; 2], offset: [f64; 2], [t_min, t_max]: [f32; 2]) -> Ray {
        let [column, row] = [f64::from(x) + offset[0], f64::from(y) + offset[1]];
        Ray {
            origin: Vec3::ZERO,
            direction: self.face.direction(column, row, self.size_px).as_vec3(),
            t_min,
            t_max,
        }
    }
}
