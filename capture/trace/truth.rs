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
/// emission, as a capture without light does. The rest of a cancelled frame is black.
pub fn render(
    tracer: &Tracer,
    lighting: &Lighting,
    lit: bool,
    camera: &Camera,
    samples: u32,
    progress: &dyn Progress,
) -> Truth {
    let width = camera.width();
    let height = camera.height();
    let half = samples.div_ceil(2).max(1);
    progress.begin("truth", "rows", u64::from(height));
    let row = |y: u32| {
        if progress.is_cancelled() {
            return vec![TracedPixel::BLACK; width as usize];
        }
        let mut pixels = Vec::with_capacity(width as usize);
        for x in 0..width {
            let pixel = PixelTracer {
                tracer,
                lighting,
                lit,
                camera,
                x,
                y,
            };
            let [(first, hits), (second, more_hits)] =
                [0, half].map(|first| pixel.radiance(first, half));
            let halves = [first, second].map(|half| lighting.stored(half));
            let mean = (first + second) / 2.0;
            let [r, g, b] = lighting.stored(mean);
            let coverage = hit_coverage(hits + more_hits, 2 * half);
            pixels.push(TracedPixel {
                radiance: mean.to_array(),
                color: [r, g, b, 255],
                halves,
                coverage,
            });
        }
        progress.advance(1);
        pixels
    };
    let rows: Vec<Vec<TracedPixel>> = (0..height).into_par_iter().map(row).collect();
    let pixels = || rows.iter().flatten();
    let (color, coverage) = pixels().map(|pixel| (pixel.color, pixel.coverage)).unzip();
    let frame = Frame {
        width,
        height,
        color,
        coverage,
        depth_m: Vec::new(),
    };
    let radiance = pixels().map(|pixel| pixel.radiance).collect();
    let halves = [0, 1].map(|half| pixels().map(|pixel| pixel.halves[half]).collect());
    let standard_error_psnr_db = standard_error_psnr_db(&halves);
    Truth {
        frame,
        radiance,
        halves,
        standard_error_psnr_db,
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

#[derive(Clone, Copy)]
struct TracedPixel {
    radiance: [f32; 3],
    color: [u8; 4],
    halves: [[u8; 3]; 2],
    coverage: Coverage,
}

impl TracedPixel {
    /// Pixel of a cancelled row.
    const BLACK: Self = Self {
        radiance: [0.0; 3],
        color: [0, 0, 0, 255],
        halves: [[0; 3]; 2],
        coverage: Coverage::ENVIRONMENT,
    };
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
    /// Returns the mean linear radiance of samples `first..first + count` and the number of hits.
    fn radiance(&self, first: u32, count: u32) -> (Vec3, u32) {
        let mut sum = Vec3::ZERO;
        let mut surfaces = 0;
        let end = first + count;
        for start in (first..end).step_by(PACKET) {
            let numbers = start..end.min(start + PACKET as u32);
            let rays: Vec<Ray> = numbers.clone().map(|index| self.ray(index)).collect();
            let hits = self.tracer.closest_packet(&RayPacket::from_rays(&rays));
            for (lane, index) in numbers.enumerate() {
                let hit = hits.hit(lane);
                surfaces += u32::from(hit.is_some());
                sum += self.ray_radiance(&rays[lane], hit.as_ref(), first, index);
            }
        }
        (sum / count as f32, surfaces)
    }

    /// Returns the camera ray of sample `index`.
    fn ray(&self, index: u32) -> Ray {
        let [dx, dy] = pixel_jitter(self.x, self.y, index).map(f64::from);
        camera_ray(
            self.tracer,
            self.camera,
            f64::from(self.x) + dx,
            f64::from(self.y) + dy,
        )
    }

    /// Returns the radiance along a ray. The samples from index `first` on form a stratified
    /// sequence of their own, independent of those before.
    fn ray_radiance(&self, ray: &Ray, hit: Option<&Hit>, first: u32, index: u32) -> Vec3 {
        let [stream, ..] = random4([self.x, self.y, 0x11d1, first]);
        let sample = LightSample {
            stream,
            index: index - first,
        };
        self.lighting
            .seen(self.tracer, ray, hit, self.lit.then_some(&sample))
    }
}
