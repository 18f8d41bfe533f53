//! Capture of the images of a camera grid by ray tracing (L5).

use super::raw::{RawLumigraph, RawPicture, SAME_SURFACE};
use crate::{CameraGrid, GridParts};
use glam::{DVec3, Vec3};
use headbox_core::camera::Camera;
use headbox_core::progress::{Progress, check_cancelled};
use headbox_trace::bvh::{Hit, PACKET, Ray, RayPacket, Tracer};
use headbox_trace::light::{LightSample, Lighting, pixel_jitter};
use headbox_trace::sampler::random4;
use rayon::prelude::*;
use std::io;

/// Scene and settings of a capture.
#[derive(Clone, Copy, Debug)]
pub struct LumigraphCapture<'a> {
    /// The scene.
    pub tracer: &'a Tracer,
    /// Lighting of the scene, as for truth frames.
    pub lighting: &'a Lighting,
    /// True to compute light; otherwise albedo and emission are stored.
    pub lit: bool,
    /// Camera rays per pixel; at least 1.
    pub samples: u32,
}

impl LumigraphCapture<'_> {
    /// Traces all images. A pixel's disparity is that of the ray through its centre; its colour is
    /// the mean over the rays that hit the same surface.
    ///
    /// # Errors
    /// [`io::ErrorKind::Interrupted`] if `progress` was cancelled.
    pub fn run(&self, grid: &CameraGrid, progress: &dyn Progress) -> io::Result<RawLumigraph> {
        let [width, height] = grid.size_px();
        progress.begin(
            "images",
            "rows",
            grid.camera_count() as u64 * u64::from(height),
        );
        let columns = grid.columns().len();
        let picture = |number: usize| {
            let camera = grid.camera(number % columns, number / columns);
            let row = |y: u32| {
                if progress.is_cancelled() {
                    return Vec::new();
                }
                let pixels: Vec<_> = (0..width).map(|x| self.pixel(&camera, [x, y])).collect();
                progress.advance(1);
                pixels
            };
            let rows: Vec<_> = (0..height).into_par_iter().flat_map_iter(row).collect();
            let (color, disparity) = rows.into_iter().unzip();
            RawPicture { color, disparity }
        };
        let pictures = (0..grid.camera_count()).map(picture).collect();
        check_cancelled(progress)?;
        Ok(RawLumigraph {
            grid: grid.clone(),
            pictures,
            environment: self.lighting.environment(),
        })
    }

    /// Traces colour and disparity of a pixel.
    fn pixel(&self, camera: &Camera, pixel: [u32; 2]) -> ([u8; 3], f32) {
        let centre = self.ray(camera, pixel, [0.5; 2]);
        let depth = self.tracer.closest(&centre).map(|hit| hit.t);
        let samples = self.samples.max(1);
        let jitter = |index| {
            if samples == 1 {
                [0.5; 2]
            } else {
                pixel_jitter(pixel[0], pixel[1], index)
            }
        };
        let (mut sum, mut count) = (Vec3::ZERO, 0u32);
        for start in (0..samples).step_by(PACKET) {
            let numbers = start..samples.min(start + PACKET as u32);
            let rays: Vec<Ray> = numbers
                .clone()
                .map(|index| self.ray(camera, pixel, jitter(index)))
                .collect();
            let hits = self.tracer.closest_packet(&RayPacket::from_rays(&rays));
            for (lane, index) in numbers.enumerate() {
                let hit = hits.hit(lane);
                let is_same = match (depth, &hit) {
                    (Some(depth), Some(hit)) => (hit.t - depth).abs() <= SAME_SURFACE * depth,
                    (None, None) => true,
                    _ => false,
                };
                if is_same {
                    sum += self.radiance(&rays[lane], hit.as_ref(), pixel, index);
                    count += 1;
                }
            }
        }
        if count == 0 {
            sum = self.radiance(&centre, self.tracer.closest(&centre).as_ref(), pixel, 0);
            count = 1;
        }
        let color = self.lighting.stored(sum / count as f32);
        let disparity = depth.map(|depth| 1.0 / depth).filter(|d| d.is_finite());
        (color, disparity.unwrap_or(0.0))
    }

    /// Creates a camera ray; its direction has eye depth 1, so that hit distances are eye depths.
    fn ray(&self, camera: &Camera, [x, y]: [u32; 2], [dx, dy]: [f32; 2]) -> Ray {
        let (x, y) = (f64::from(x) + f64::from(dx), f64::from(y) + f64::from(dy));
        Ray {
            origin: (camera.eye() - self.tracer.origin()).as_vec3(),
            direction: camera.direction(x, y).as_vec3(),
            t_min: 0.0,
            t_max: f32::INFINITY,
        }
    }

    fn radiance(&self, ray: &Ray, hit: Option<&Hit>, [x, y]: [u32; 2], index: u32) -> Vec3 {
        let [stream, ..] = random4([x, y, 0x10e1, 3]);
        let sample = LightSample { stream, index };
        self.lighting
            .seen(self.tracer, ray, hit, self.lit.then_some(&sample))
    }
}

/// Returns the middle of the disparities seen from the origin of the grid, without the smallest and
/// largest 5 %, 1/m; 0 if no ray hits a surface.
pub fn middle_disparity(tracer: &Tracer, parts: &GridParts) -> f64 {
    const RAYS: u32 = 48;
    let half = parts
        .size_px
        .map(|side| f64::from(side) / 2.0 / parts.focal_px);
    let offset = |i: u32| f64::from(2 * i + 1) / f64::from(RAYS) - 1.0;
    let disparity = |i: u32| {
        let slopes = DVec3::new(offset(i % RAYS) * half[0], offset(i / RAYS) * half[1], -1.0);
        let ray = Ray {
            origin: (parts.origin - tracer.origin()).as_vec3(),
            direction: (parts.world_from_eye * slopes).as_vec3(),
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        tracer
            .closest(&ray)
            .map_or(0.0, |hit| 1.0 / f64::from(hit.t))
    };
    let mut disparities: Vec<f64> = (0..RAYS * RAYS)
        .map(disparity)
        .filter(|d| d.is_finite())
        .collect();
    disparities.sort_by(f64::total_cmp);
    let quantile = |twentieths: usize| {
        let index = disparities.len() * twentieths / 20;
        disparities.get(index).copied().unwrap_or(0.0)
    };
    0.5 * (quantile(1) + quantile(19))
}
