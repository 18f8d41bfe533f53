//! The baseline without depth: a ray-traced cube map of the LDI's own resolution, looked up bilinearly.

use crate::capture::light::Lighting;
use crate::capture::rig::Face;
use crate::capture::trace::Tracer;
use crate::capture::{Camera, linear_from_srgb8, srgb8_from_linear};
use crate::ldi::build::Progress;
use crate::truth;
use image::{Rgb, RgbImage};

/// Six images around one point; faces that no camera needed are absent.
pub struct CubeMap {
    size_px: u32,
    faces: [Option<RgbImage>; 6],
}

impl CubeMap {
    /// Traces the faces that `camera` sees, about its eye, with `samples` rays per texel.
    pub fn trace_for(
        tracer: &Tracer,
        lighting: &Lighting,
        camera: &Camera,
        size_px: u32,
        samples: u32,
        progress: &dyn Progress,
    ) -> Self {
        let mut needed = [false; 6];
        for y in 0..=camera.height() {
            for x in 0..=camera.width() {
                needed[Face::containing(camera.direction(f64::from(x), f64::from(y))).index()] = true;
            }
        }
        let face = |face: Face| {
            let focal_px = f64::from(size_px) / 2.0;
            let camera = Camera::from_parts(camera.eye(), face.world_from_eye(), focal_px, size_px, size_px).ok()?;
            needed[face.index()].then(|| truth::render(tracer, lighting, true, &camera, samples, progress).color)
        };
        Self { size_px, faces: Face::ALL.map(face) }
    }

    /// The frame of a camera at the same eye: one bilinear look-up per pixel, in linear light, clamped at the borders
    /// of faces.
    pub fn resample(&self, camera: &Camera) -> RgbImage {
        RgbImage::from_fn(camera.width(), camera.height(), |x, y| {
            let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let face = Face::containing(direction);
            let [u, v, _] = face.project(direction, self.size_px);
            self.faces[face.index()].as_ref().map_or(Rgb([0; 3]), |texels| bilinear(texels, u - 0.5, v - 0.5))
        })
    }
}

fn bilinear(texels: &RgbImage, x: f64, y: f64) -> Rgb<u8> {
    let clamp = |c: f64, size: u32| (c.max(0.0) as u32).min(size - 1);
    let (width, height) = texels.dimensions();
    let (x0, y0) = (x.floor(), y.floor());
    let [fx, fy] = [x - x0, y - y0].map(|f| f as f32);
    let at =
        |dx: f64, dy: f64| texels.get_pixel(clamp(x0 + dx, width), clamp(y0 + dy, height)).0.map(linear_from_srgb8);
    let (a, b, c, d) = (at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0));
    let mix = |p: f32, q: f32, t: f32| p + (q - p) * t;
    Rgb([0, 1, 2].map(|i| srgb8_from_linear(mix(mix(a[i], b[i], fx), mix(c[i], d[i], fx), fy))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bilinear_is_exact_on_texel_centres_and_clamps() {
        let texels = RgbImage::from_fn(3, 2, |x, y| Rgb([(40 * x) as u8, (90 * y) as u8, 7]));
        assert_eq!(bilinear(&texels, 2.0, 1.0), Rgb([80, 90, 7]));
        assert_eq!(bilinear(&texels, -5.0, 9.0), Rgb([0, 90, 7]));
    }
}
