//! Ray-traced reference frames: the same camera, the same light as a capture, to convergence.

use crate::bvh::{Hit, HitPacket, PACKET, Ray, RayPacket, Tracer};
use crate::light::{LightSample, Lighting, pixel_jitter};
use crate::sampler::random4;
use glam::Vec3;
use headbox_core::camera::Camera;
use headbox_core::frame::{Coverage, Frame};
use headbox_core::progress::Progress;
use image::RgbImage;
use rayon::prelude::*;

/// A ray-traced frame, and what it is worth.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Coverage is the share of a pixel's rays that met a surface: full if all did, the environment
    /// alone if none.
    pub frame: Frame,
    /// Linear radiance, row by row from the top; empty of a frame that was kept in a file.
    pub radiance: Vec<[f32; 3]>,
    /// Colours of the two independent halves of the samples, row by row from the top: what differs
    /// between them is noise.
    pub halves: [Vec<[u8; 3]>; 2],
    /// How far the picture is from its own limit, as a PSNR in dB: from the difference between two
    /// independent halves of the samples. Infinite if they agree to the last bit.
    pub standard_error_psnr_db: f64,
}

impl Truth {
    /// The colours as a picture.
    pub fn rgb(&self) -> RgbImage {
        // A traced frame has as many pixels as its size says.
        self.frame.to_rgb().unwrap_or_default()
    }

    /// The colours of each half of the samples as a picture.
    pub fn halves(&self) -> [RgbImage; 2] {
        let Frame { width, height, .. } = self.frame;
        self.halves
            .each_ref()
            .map(|half| RgbImage::from_raw(width, height, half.concat()).unwrap_or_default())
    }
}

/// Traces a frame with `samples` camera rays per pixel (rounded up to a multiple of 2), jittered
/// over the pixel, one light sample each; 0 light samples (`lit` false) shows albedo and emission
/// as a capture without light does. Of a frame that `progress` gave up, the rest is black.
pub fn render(
    tracer: &Tracer,
    lighting: &Lighting,
    lit: bool,
    camera: &Camera,
    samples: u32,
    progress: &dyn Progress,
) -> Truth {
    let (width, height) = (camera.width(), camera.height());
    let half = samples.div_ceil(2).max(1);
    progress.begin("truth", "rows", u64::from(height));
    let row = |y: u32| {
        if progress.is_cancelled() {
            return vec![TracedPixel::DARK; width as usize];
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
            let coverage = surfaces_of(hits + more_hits, 2 * half);
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

/// How far the mean of two halves is from its own limit, as a PSNR in dB: it has half the standard
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
    /// What nobody waited for.
    const DARK: Self = Self {
        radiance: [0.0; 3],
        color: [0, 0, 0, 255],
        halves: [[0; 3]; 2],
        coverage: Coverage::ENVIRONMENT,
    };
}

/// Eye depth of what each pixel's middle shows, metres, row by row; infinite where there is
/// nothing.
pub fn eye_depth(tracer: &Tracer, camera: &Camera) -> Vec<f32> {
    let pixels: Vec<(u32, u32)> = (0..camera.height())
        .flat_map(|y| (0..camera.width()).map(move |x| (x, y)))
        .collect();
    let of_packet = |pixels: &[(u32, u32)]| {
        // Directions reach to eye depth 1.
        let ray = |&(x, y): &(u32, u32)| {
            let direction = camera
                .direction(f64::from(x) + 0.5, f64::from(y) + 0.5)
                .as_vec3();
            Ray {
                origin: (camera.eye() - tracer.origin()).as_vec3(),
                direction,
                t_min: 0.0,
                t_max: f32::INFINITY,
            }
        };
        let rays: Vec<Ray> = pixels.iter().map(ray).collect();
        let hits = tracer.closest_packet(&RayPacket::from_rays(&rays));
        (0..pixels.len())
            .map(|lane| hits.hit(lane).map_or(f32::INFINITY, |hit| hit.t))
            .collect::<Vec<f32>>()
    };
    pixels.par_chunks(PACKET).flat_map_iter(of_packet).collect()
}

/// Coverage of a pixel of which `hits` of `rays` rays met a surface: full for all of them only.
fn surfaces_of(hits: u32, rays: u32) -> Coverage {
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
    /// Mean radiance of samples `first..first + count`, linear, and how many of them met a surface.
    fn radiance(&self, first: u32, count: u32) -> (Vec3, u32) {
        let mut sum = Vec3::ZERO;
        let mut surfaces = 0;
        let end = first + count;
        for start in (first..end).step_by(PACKET) {
            let numbers = start..end.min(start + PACKET as u32);
            let rays: Vec<Ray> = numbers.clone().map(|index| self.ray(index)).collect();
            let hits: HitPacket = self.tracer.closest_packet(&RayPacket::from_rays(&rays));
            for (lane, index) in numbers.enumerate() {
                let hit = hits.hit(lane);
                surfaces += u32::from(hit.is_some());
                sum += self.seen(&rays[lane], hit.as_ref(), first, index);
            }
        }
        (sum / count as f32, surfaces)
    }

    /// Camera ray number `index`.
    fn ray(&self, index: u32) -> Ray {
        let [dx, dy] = pixel_jitter(self.x, self.y, index).map(f64::from);
        let direction = self
            .camera
            .direction(f64::from(self.x) + dx, f64::from(self.y) + dy)
            .as_vec3();
        let origin = (self.camera.eye() - self.tracer.origin()).as_vec3();
        Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max: f32::INFINITY,
        }
    }

    /// Radiance along a ray; samples from number `first` on are spread evenly, independently of
    /// those before.
    fn seen(&self, ray: &Ray, hit: Option<&Hit>, first: u32, index: u32) -> Vec3 {
        let [stream, ..] = random4([self.x, self.y, 0x11d1, first]);
        let sample = LightSample {
            stream,
            index: index - first,
        };
        self.lighting
            .seen(self.tracer, ray, hit, self.lit.then_some(&sample))
    }
}
