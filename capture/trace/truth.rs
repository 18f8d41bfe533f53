//! Ray-traced reference frames with the camera and light of a capture.

use crate::bvh::{Hit, PACKET, Ray, RayPacket, Tracer};
use crate::light::{LightSample, Lighting, pixel_jitter};
use crate::sampler::random4;
use glam::Vec3;
use headbox_core::camera::Camera;
use headbox_core::frame::{Coverage, Frame};
use headbox_core::progress::Progress;
use image::RgbImage;
use rayon::prelude::*;
use std::ops::Range;

/// Ray-traced frame and its standard error.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Colours and coverage: the fraction of a pixel's rays that hit a surface, full if all did,
    /// environment if none.
    pub frame: Frame,
    /// Linear radiance, row by row from the top; empty if the frame was loaded from a file.
    pub radiance: Vec<[f32; 3]>,
    /// Colours of the two independent halves of the samples, row by row from the top: their
    /// difference is noise.
    pub halves: [Vec<[u8; 3]>; 2],
    /// Standard error of the frame as a PSNR in dB, from the difference between the halves.
    /// Infinite if they are equal.
    pub standard_error_psnr_db: f64,
}

impl Truth {
    /// Returns the colours as an image.
    pub fn rgb(&self) -> RgbImage {
        // The pixel count of a traced frame always matches its size.
        self.frame.to_rgb().unwrap_or_default()
    }

    /// Returns the colours of each half of the samples as an image.
    pub fn halves(&self) -> [RgbImage; 2] {
        let Frame { width, height, .. } = self.frame;
        self.halves
            .each_ref()
            .map(|half| RgbImage::from_raw(width, height, half.concat()).unwrap_or_default())
    }
}

/// Traces a frame with `samples` camera rays per pixel (rounded up to a multiple of 2), jittered
/// over the pixel, with one light sample each. Without light (`lit` false) it shows albedo and
/// emission, as a capture without light does. A cancelled frame is black.
pub fn render(
    tracer: &Tracer,
    lighting: &Lighting,
    lit: bool,
    camera: &Camera,
    samples: u32,
    progress: &dyn Progress,
) -> Truth {
    let mut sum = TruthSum::new(camera);
    sum.add(tracer, lighting, lit, samples, progress);
    sum.truth(lighting)
}

/// Sum of the samples of a frame traced in rounds. The result depends on the number of samples, not
/// on the rounds.
#[derive(Clone, Debug)]
pub struct TruthSum {
    camera: Camera,
    /// Row by row from the top.
    pixels: Vec<PixelSum>,
    /// Camera rays per pixel in each half.
    half: u32,
}

/// Sums of linear radiance of the two independent halves of a pixel's samples, and their hits.
#[derive(Clone, Copy, Debug, Default)]
struct PixelSum {
    halves: [Vec3; 2],
    hits: u32,
}

impl TruthSum {
    /// Creates a sum without samples.
    pub fn new(camera: &Camera) -> Self {
        let pixels = camera.width() as usize * camera.height() as usize;
        Self {
            camera: *camera,
            pixels: vec![PixelSum::default(); pixels],
            half: 0,
        }
    }

    /// Returns the number of camera rays per pixel.
    pub fn samples(&self) -> u32 {
        2 * self.half
    }

    /// Traces `samples` more camera rays per pixel (rounded up to a multiple of 2). Returns false,
    /// without adding any, if the work is cancelled.
    pub fn add(
        &mut self,
        tracer: &Tracer,
        lighting: &Lighting,
        lit: bool,
        samples: u32,
        progress: &dyn Progress,
    ) -> bool {
        let (width, height) = (self.camera.width(), self.camera.height());
        let more = samples.div_ceil(2).max(1);
        progress.begin("truth", "rows", u64::from(height));
        let trace_row = |(y, row): (usize, &[PixelSum])| {
            let mut row = row.to_vec();
            if progress.is_cancelled() {
                return row;
            }
            for (x, sum) in (0..width).zip(&mut row) {
                let pixel = PixelTracer {
                    tracer,
                    lighting,
                    lit,
                    camera: &self.camera,
                    x,
                    y: y as u32,
                };
                for (half, radiance) in (0..).zip(&mut sum.halves) {
                    sum.hits += pixel.add(radiance, half, self.half..self.half + more);
                }
            }
            progress.advance(1);
            row
        };
        let rows = self.pixels.par_chunks(width.max(1) as usize).enumerate();
        let rows: Vec<Vec<PixelSum>> = rows.map(trace_row).collect();
        if progress.is_cancelled() {
            return false;
        }
        self.pixels = rows.concat();
        self.half += more;
        true
    }

    /// Returns the frame of the samples so far, black without any.
    pub fn truth(&self, lighting: &Lighting) -> Truth {
        let count = self.half.max(1) as f32;
        let means = |sum: &PixelSum| sum.halves.map(|half| half / count);
        let mean = |sum: &PixelSum| {
            let [first, second] = means(sum);
            (first + second) / 2.0
        };
        let color = |sum: &PixelSum| {
            let [r, g, b] = lighting.stored(mean(sum));
            [r, g, b, 255]
        };
        let frame = Frame {
            width: self.camera.width(),
            height: self.camera.height(),
            color: self.pixels.iter().map(color).collect(),
            coverage: self
                .pixels
                .iter()
                .map(|sum| hit_coverage(sum.hits, self.samples()))
                .collect(),
            depth_m: Vec::new(),
        };
        let half = |half: usize| {
            let level = |sum: &PixelSum| lighting.stored(means(sum)[half]);
            self.pixels.iter().map(level).collect()
        };
        let halves = [0, 1].map(half);
        Truth {
            frame,
            radiance: self.pixels.iter().map(|sum| mean(sum).to_array()).collect(),
            standard_error_psnr_db: standard_error_psnr_db(&halves),
            halves,
        }
    }
}

/// Returns the standard error of the mean of two halves as a PSNR in dB: half the standard
/// deviation of their difference.
fn standard_error_psnr_db([first, second]: &[Vec<[u8; 3]>; 2]) -> f64 {
    let levels = first.as_flattened().iter().zip(second.as_flattened());
    let squared_error: f64 = levels
        .map(|(a, b)| (f64::from(a.abs_diff(*b)) / 2.0).powi(2))
        .sum();
    let mean_square = squared_error / (3 * first.len()) as f64;
    10.0 * (255.0f64.powi(2) / mean_square).log10()
}

/// Returns the camera ray through a point of the image, pixels.
fn camera_ray(tracer: &Tracer, camera: &Camera, x: f64, y: f64) -> Ray {
    Ray::new(
        (camera.eye() - tracer.origin()).as_vec3(),
        camera.direction(x, y).as_vec3(),
    )
}

/// Traces the eye depth at each pixel's centre, metres, row by row; infinite without a hit.
pub fn eye_depth(tracer: &Tracer, camera: &Camera) -> Vec<f32> {
    let pixels: Vec<(u32, u32)> = (0..camera.height())
        .flat_map(|y| (0..camera.width()).map(move |x| (x, y)))
        .collect();
    let trace_packet = |pixels: &[(u32, u32)]| {
        // Directions have eye depth 1, so `t` is eye depth.
        let ray = |&(x, y): &(u32, u32)| {
            camera_ray(tracer, camera, f64::from(x) + 0.5, f64::from(y) + 0.5)
        };
        let rays: Vec<Ray> = pixels.iter().map(ray).collect();
        let hits = tracer.closest_packet(&RayPacket::from_rays(&rays));
        (0..pixels.len())
            .map(|lane| hits.hit(lane).map_or(f32::INFINITY, |hit| hit.t))
            .collect::<Vec<f32>>()
    };
    pixels
        .par_chunks(PACKET)
        .flat_map_iter(trace_packet)
        .collect()
}

/// Returns the coverage of a pixel in which `hits` of `rays` rays hit a surface: full only if all
/// did.
fn hit_coverage(hits: u32, rays: u32) -> Coverage {
    match u64::from(hits) * 255 / u64::from(rays.max(1)) {
        0 if hits == 0 => Coverage::ENVIRONMENT,
        share => Coverage::from_splat_share(share as u8),
    }
}

/// Samples one pixel.
struct PixelTracer<'a> {
    tracer: &'a Tracer,
    lighting: &'a Lighting,
    lit: bool,
    camera: &'a Camera,
    x: u32,
    y: u32,
}

impl PixelTracer<'_> {
    /// Index of the first camera ray of each half.
    const FIRST: [u32; 2] = [0, 1 << 24];

    /// Adds the linear radiance of some samples of half 0 or 1 to `sum` and returns the number of
    /// hits. Each half has camera rays of its own that cover the whole pixel. Even and odd rays of
    /// one sequence would not: each would cover half of the pixel, and the difference of the halves
    /// would no longer measure the noise.
    fn add(&self, sum: &mut Vec3, half: u32, samples: Range<u32>) -> u32 {
        let mut surfaces = 0;
        for start in samples.clone().step_by(PACKET) {
            let numbers = start..samples.end.min(start + PACKET as u32);
            let rays: Vec<Ray> = numbers
                .clone()
                .map(|i| self.ray(Self::FIRST[half as usize] + i))
                .collect();
            let hits = self.tracer.closest_packet(&RayPacket::from_rays(&rays));
            for (lane, number) in numbers.enumerate() {
                let hit = hits.hit(lane);
                surfaces += u32::from(hit.is_some());
                *sum += self.ray_radiance(&rays[lane], hit.as_ref(), half, number);
            }
        }
        surfaces
    }

    /// Returns camera ray `index` of the pixel.
    fn ray(&self, index: u32) -> Ray {
        let [dx, dy] = pixel_jitter(self.x, self.y, index).map(f64::from);
        camera_ray(
            self.tracer,
            self.camera,
            f64::from(self.x) + dx,
            f64::from(self.y) + dy,
        )
    }

    /// Returns the radiance along a ray, for light sample `index` of a half: each half has a
    /// stratified sequence of its own, independent of the other's.
    fn ray_radiance(&self, ray: &Ray, hit: Option<&Hit>, half: u32, index: u32) -> Vec3 {
        let first = Self::FIRST[half as usize];
        let [stream, ..] = random4([self.x, self.y, 0x11d1, first]);
        let sample = LightSample { stream, index };
        self.lighting
            .seen(self.tracer, ray, hit, self.lit.then_some(&sample))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::tests::random_triangles;
    use glam::DVec3;
    use headbox_core::progress::Silent;

    #[test]
    fn rounds_do_not_change_the_frame() {
        let tracer = random_triangles();
        let lighting = Lighting::measure_at(&tracer, DVec3::ZERO, 2);
        let camera = Camera::look_at(DVec3::ZERO, DVec3::X, DVec3::Y, 60.0, [9, 7]).expect("valid");
        let whole = render(&tracer, &lighting, true, &camera, 24, &Silent);
        let mut rounds = TruthSum::new(&camera);
        for samples in [2, 2, 4, 16] {
            assert!(rounds.add(&tracer, &lighting, true, samples, &Silent));
        }
        assert_eq!(rounds.samples(), 24);
        assert_eq!(rounds.truth(&lighting), whole);
        assert_eq!(
            TruthSum::new(&camera).truth(&lighting).frame.color[5],
            [0, 0, 0, 255]
        );
    }
}
