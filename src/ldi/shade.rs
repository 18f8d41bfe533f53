//! Light at kept hits: `K` light samples per depth pixel, taken after merging.
//!
//! The alternative is one light sample per ray. What decides is that a depth pixel is met by anything from one to
//! hundreds of rays. Light per ray spends most samples where they are least needed and leaves depth pixels that few rays
//! reach (the disoccluded ones, and all of them once novelty stopping saves rays) with a single noisy sample. Light per
//! depth pixel gives each the same error, and can be pooled over a surface ([`super::pool`]). Albedo, which costs
//! nothing to look up, is averaged over all rays.

use super::EncodedNormal;
use super::accumulate::Accumulator;
use crate::capture::light::{LightSample, Lighting, LitPoint, extent_of};
use crate::capture::rig::Face;
use crate::capture::sampler::{RayKey, random4, unit_float};
use crate::capture::trace::Tracer;
use glam::Vec3;

/// Lights accumulators of one capture.
pub struct Shader<'a> {
    /// The scene, its origin at the centre of the headbox.
    pub tracer: &'a Tracer,
    /// The lights.
    pub lighting: &'a Lighting,
    /// Light samples per depth pixel (K); 0 leaves surfaces unlit: their colour is albedo plus emission.
    pub samples: u32,
    /// Pixels a side of a face.
    pub face_size_px: u32,
}

/// A lit accumulator: one kind of surface in one depth bin of one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// As [`Accumulator::key`].
    pub key: RayKey,
    /// As [`Accumulator::count`].
    pub count: u32,
    /// As [`Accumulator::area`].
    pub area: f32,
    /// As [`Accumulator::bin`].
    pub bin: u16,
    /// As [`Accumulator::class`].
    pub class: u16,
    /// Mean position in bins.
    pub position: f32,
    /// Light samples behind `soft`.
    pub light_samples: u16,
    /// Mean albedo, linear, 16 bits a channel.
    pub albedo: [u16; 3],
    /// Radiance that is sharp in space: the sun's, and emission. Linear, exposed.
    pub sharp: Vec3,
    /// Radiosity per albedo from everything else, which varies slowly over a surface. Linear, exposed.
    pub soft: Vec3,
    /// Unit shading normal on the seen side.
    pub normal: EncodedNormal,
    /// Unit normal of the triangle's plane.
    pub plane_normal: Vec3,
    /// Distance of the triangle's plane from the centre, metres.
    pub plane_distance: f32,
}

impl Part {
    /// Radiance toward any viewer, linear, exposed.
    pub fn color(&self) -> Vec3 {
        self.sharp + Vec3::from_array(self.albedo.map(|c| f32::from(c) / 65_535.0)) * self.soft
    }
}

impl Shader<'_> {
    /// Lights one accumulator in pixel (x, y) of a face with `samples` light samples, spread over the part of its
    /// triangle that the pixel shows (as seen from the centre), so that edges of shadows are smooth.
    pub fn shade(&self, acc: &Accumulator, face: Face, x: u32, y: u32, samples: u32) -> Part {
        let [u, v] = acc.barycentric.map(|c| f32::from(c) / 65_535.0);
        let surface = self.tracer.scene().surface(acc.primitive, u, v);
        let side = if acc.is_back() { -1.0 } else { 1.0 };
        let (normal, shading_normal) = (surface.normal * side, surface.shading_normal * side);
        let triangle @ [a, b, c] = self.tracer.triangle(acc.primitive);
        let representative = a + (b - a) * u + (c - a) * v;
        let extent = extent_of(triangle);
        let [stream, ..] = random4([face.index() as u32 | u32::from(acc.class) << 8, x, y, u32::from(acc.bin)]);
        let (mut sun, mut soft) = (Vec3::ZERO, Vec3::ZERO);
        for index in 0..samples {
            let [jx, jy, ..] = random4([stream, index, 0x5eed, 0]).map(unit_float);
            let through = face.direction(f64::from(x) + f64::from(jx), f64::from(y) + f64::from(jy), self.face_size_px);
            let position = on_triangle(through.as_vec3(), triangle).unwrap_or(representative);
            let point = LitPoint { position, normal, shading_normal, extent };
            let sample = LightSample { stream, index, count: samples };
            sun += self.lighting.sun_radiosity(self.tracer, &point, &sample);
            soft += self.lighting.soft_radiosity(self.tracer, &point, &sample);
        }
        let (sun, soft) =
            if samples == 0 { (Vec3::ZERO, Vec3::ONE) } else { (sun / samples as f32, soft / samples as f32) };
        let albedo = acc.albedo_sum.map(|sum| (sum / u64::from(acc.count.max(1))) as u16);
        let exposure = self.lighting.exposure;
        let lit = Vec3::from_array(albedo.map(|c| f32::from(c) / 65_535.0)) * sun;
        Part {
            key: acc.key,
            count: acc.count,
            area: acc.area,
            bin: acc.bin,
            class: acc.class,
            position: (f64::from(acc.bin) + acc.offset_sum as f64 / 65_536.0 / f64::from(acc.count)) as f32,
            light_samples: samples as u16,
            albedo,
            sharp: (lit + Vec3::from_array(surface.emission)) * exposure,
            soft: soft * exposure,
            normal: EncodedNormal::new(shading_normal),
            plane_normal: normal,
            plane_distance: normal.dot(a),
        }
    }
}

/// Where the ray from the local origin along `direction` meets a triangle, if it does.
fn on_triangle(direction: Vec3, [a, b, c]: [Vec3; 3]) -> Option<Vec3> {
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(e2);
    let det = e1.dot(p);
    let s = -a;
    let u = s.dot(p) / det;
    let q = s.cross(e1);
    let v = direction.dot(q) / det;
    let t = e2.dot(q) / det;
    // A NaN from an edge-on triangle (det = 0) fails every comparison.
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then(|| a + e1 * u + e2 * v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_sampled_on_the_triangle_itself() {
        let triangle = [Vec3::new(-1.0, -1.0, -2.0), Vec3::new(1.0, -1.0, -2.0), Vec3::new(0.0, 2.0, -2.0)];
        let hit = on_triangle(Vec3::new(0.1, 0.0, -1.0), triangle).unwrap();
        assert!((hit - Vec3::new(0.2, 0.0, -2.0)).length() < 1e-6);
        assert_eq!(on_triangle(Vec3::new(2.0, 0.0, -1.0), triangle), None, "beside it");
        assert_eq!(on_triangle(Vec3::new(0.1, 0.0, 1.0), triangle), None, "behind the centre");
        assert_eq!(on_triangle(Vec3::X, triangle), None, "edge-on");
    }
}
