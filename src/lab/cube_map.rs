//! The baseline without depth: a ray-traced cube map at the LDI's resolution with bilinear lookup.

use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::color::{linear_from_srgb8, srgb8_from_linear};
use headbox_core::cube_face::Face;
use headbox_core::image::texels;
use headbox_core::progress::Progress;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth;
use image::RgbImage;
use rayon::prelude::*;

/// Cube map about one point; faces that no camera needs are absent.
pub struct CubeMap {
    size_px: u32,
    faces: [Option<RgbImage>; 6],
}

impl CubeMap {
    /// Traces the faces about `centre` (world) that the `cameras` see, with `samples` rays per
    /// texel.
    pub fn trace_for(
        tracer: &Tracer,
        lighting: &Lighting,
        centre: DVec3,
        cameras: &[Camera],
        size_px: u32,
        samples: u32,
        progress: &dyn Progress,
    ) -> Self {
        let mut needed = [false; 6];
        for camera in cameras {
            for (x, y) in
                (0..=camera.height()).flat_map(|y| (0..=camera.width()).map(move |x| (x, y)))
            {
                needed[Face::containing(camera.direction(f64::from(x), f64::from(y))).index()] =
                    true;
            }
        }
        let face = |face: Face| {
            let focal_px = f64::from(size_px) / 2.0;
            let camera =
                Camera::from_parts(centre, face.world_from_eye(), focal_px, size_px, size_px)
                    .ok()?;
            needed[face.index()]
                .then(|| truth::render(tracer, lighting, true, &camera, samples, progress).rgb())
        };
        Self {
            size_px,
            faces: Face::ALL.map(face),
        }
    }

    /// Returns the size of six faces, bytes.
    pub fn bytes(&self) -> u64 {
        6 * 3 * u64::from(self.size_px).pow(2)
    }

    /// Renders the frame of a camera as if its eye were at the centre: one bilinear lookup per
    /// pixel, in linear light, clamped at the borders of faces.
    pub fn resample(&self, camera: &Camera) -> RgbImage {
        let (width, height) = (camera.width(), camera.height());
        let mut pixels = vec![0u8; 3 * width as usize * height as usize];
        pixels
            .par_chunks_mut(3 * width as usize)
            .enumerate()
            .for_each(|(y, row)| {
                for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
                    let direction = camera.direction(x as f64 + 0.5, y as f64 + 0.5);
                    let face = Face::containing(direction);
                    let [u, v, _] = face.project(direction, self.size_px);
                    let texels = self.faces[face.index()].as_ref();
                    pixel.copy_from_slice(
                        &texels.map_or([0; 3], |texels| bilinear(texels, u - 0.5, v - 0.5)),
                    );
                }
            });
        RgbImage::from_raw(width, height, pixels).unwrap_or_default()
    }
}

fn bilinear(image: &RgbImage, x: f64, y: f64) -> [u8; 3] {
    let clamp = |c: f64, size: u32| (c.max(0.0) as u32).min(size - 1);
    let (width, height) = image.dimensions();
    let (x0, y0) = (x.floor(), y.floor());
    let [fx, fy] = [x - x0, y - y0].map(|f| f as f32);
    let at = |dx: f64, dy: f64| {
        image
            .get_pixel(clamp(x0 + dx, width), clamp(y0 + dy, height))
            .0
            .map(linear_from_srgb8)
    };
    let (a, b, c, d) = (at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0));
    [0, 1, 2].map(|i| srgb8_from_linear(texels::bilinear([a[i], b[i], c[i], d[i]], [fx, fy])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    #[test]
    fn bilinear_is_exact_on_texel_centres_and_clamps() {
        let texels = RgbImage::from_fn(3, 2, |x, y| Rgb([(40 * x) as u8, (90 * y) as u8, 7]));
        assert_eq!(bilinear(&texels, 2.0, 1.0), [80, 90, 7]);
        assert_eq!(bilinear(&texels, -5.0, 9.0), [0, 90, 7]);
    }
}
