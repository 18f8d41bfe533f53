//! Light at kept hits: `K` light samples per depth pixel, taken after merging.
//!
//! The alternative is one light sample per ray. Both were built on the same estimator; what decides is that a depth
//! pixel is met by anything from one to hundreds of rays. Light per ray spends most samples where they are least needed
//! and leaves depth pixels that few rays reach (the disoccluded ones, and all of them once novelty stopping saves rays)
//! with a single noisy sample. Light per depth pixel gives each the same error. Albedo, which costs nothing to look up,
//! is averaged over all rays in either case.

use super::accumulate::Accumulator;
use crate::capture::light::{LightSample, Lighting, LitPoint, extent_of};
use crate::capture::rig::Face;
use crate::capture::sampler::{random4, unit_float};
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

/// A lit surface sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lit {
    /// Radiance toward any viewer, linear, exposed.
    pub color: Vec3,
    /// Unit shading normal on the seen side.
    pub normal: Vec3,
}

impl Shader<'_> {
    /// Light of one accumulator in pixel (x, y) of a face, averaged over `samples` light samples spread over the part
    /// of its triangle that the pixel shows (as seen from the centre), so that edges of shadows are smooth.
    pub fn shade(&self, acc: &Accumulator, face: Face, x: u32, y: u32, samples: u32) -> Lit {
        let [u, v] = acc.barycentric.map(|c| f32::from(c) / 65_535.0);
        let surface = self.tracer.scene().surface(acc.primitive, u, v);
        let side = if acc.is_back() { -1.0 } else { 1.0 };
        let (normal, shading_normal) = (surface.normal * side, surface.shading_normal * side);
        let albedo = acc.albedo_sum.map(|sum| sum as f32 / (acc.count as f32 * 65_535.0));
        let [a, b, c] = self.tracer.triangle(acc.primitive);
        let representative = a + (b - a) * u + (c - a) * v;
        let extent = extent_of([a, b, c]);
        let mut radiosity = Vec3::ZERO;
        let [stream, ..] = random4([face.index() as u32 | u32::from(acc.class) << 8, x, y, u32::from(acc.bin)]);
        for index in 0..samples {
            let [jx, jy, ..] = random4([stream, index, 0x5eed, 0]).map(unit_float);
            let through = face.direction(f64::from(x) + f64::from(jx), f64::from(y) + f64::from(jy), self.face_size_px);
            let position = on_triangle(through.as_vec3(), [a, b, c]).unwrap_or(representative);
            let point = LitPoint { position, normal, shading_normal, extent };
            let sample = LightSample { stream, index, count: samples };
            radiosity += Vec3::from_array(self.lighting.radiosity_per_albedo(self.tracer, &point, &sample));
        }
        let radiosity = if samples == 0 { Vec3::ONE } else { radiosity / samples as f32 };
        let color = Vec3::from_array(albedo) * radiosity + Vec3::from_array(surface.emission);
        Lit { color: color * self.lighting.exposure, normal: shading_normal }
    }
}

/// Where the ray from the local origin along `direction` meets a triangle, if it does so well inside it.
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
