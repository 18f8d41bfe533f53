//! Images of a grid of cameras by ray tracing (L5).

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

/// Settings of capturing images of a scene.
#[derive(Clone, Copy, Debug)]
pub struct LumigraphCapture<'a> {
    /// The scene.
    pub tracer: &'a Tracer,
    /// Its light, as for truth frames.
    pub lighting: &'a Lighting,
    /// True to compute light; otherwise albedo and emission are stored.
    pub lit: bool,
    /// Camera rays per pixel; at least 1.
    pub samples: u32,
}

impl LumigraphCapture<'_> {
    /// Traces all images. A pixel's disparity is that of the ray through its centre, its colour
    /// that of all rays that see the same surface.
    ///
    /// # Errors
    /// Of kind [`io::ErrorKind::Interrupted`] if `progress` gave it up.
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
        Ok(RawLumigraph::new(
            grid.clone(),
            pictures,
            self.lighting.environment(),
        ))
    }

    /// Colour and disparity of a pixel.
    fn pixel(&self, camera: &Camera, pixel: [u32; 2]) -> ([u8; 3], f32) {
        let centre = self.ray(camera, pixel, [0.5; 2]);
        let depth = self.tracer.closest(&centre).map(|hit| hit.t);
        let (mut sum, mut count) = (Vec3::ZERO, 0u32);
        for start in (0..self.samples.max(1)).step_by(PACKET) {
            let numbers = start..self.samples.max(1).min(start + PACKET as u32);
            let jitter = |index| {
                if self.samples <= 1 {
                    [0.5; 2]
                } else {
                    pixel_jitter(pixel[0], pixel[1], index)
                }
            };
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
            (sum, count) = (
                self.radiance(&centre, self.tracer.closest(&centre).as_ref(), pixel, 0),
                1,
            );
        }
        let color = self.lighting.stored(sum / count as f32);
        let disparity = depth.map_or(0.0, |depth| 1.0 / depth);
        (
            color,
            if disparity.is_finite() {
                disparity
            } else {
                0.0
            },
        )
    }

    /// Rays have an eye depth of 1 per unit of length.
    fn ray(&self, camera: &Camera, [x, y]: [u32; 2], [dx, dy]: [f32; 2]) -> Ray {
        let direction = camera
            .direction(f64::from(x) + f64::from(dx), f64::from(y) + f64::from(dy))
            .as_vec3();
        let origin = (camera.eye() - self.tracer.origin()).as_vec3();
        Ray {
            origin,
            direction,
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

/// The middle of the disparities that a camera amid the others sees, without the outermost
/// twentieths, 1/m; 0 if it sees nothing.
pub fn middle_disparity(tracer: &Tracer, parts: &GridParts) -> f64 {
    const RAYS: u32 = 48;
    let half = parts
        .size_px
        .map(|side| f64::from(side) / 2.0 / parts.focal_px);
    let place = |i: u32| f64::from(2 * i + 1) / f64::from(RAYS) - 1.0;
    let ray = |i: u32| {
        let slopes = DVec3::new(place(i % RAYS) * half[0], place(i / RAYS) * half[1], -1.0);
        let direction = (parts.world_from_eye * slopes).as_vec3();
        let origin = (parts.origin - tracer.origin()).as_vec3();
        tracer
            .closest(&Ray {
                origin,
                direction,
                t_min: 0.0,
                t_max: f32::INFINITY,
            })
            .map(|hit| hit.t)
    };
    let mut disparities: Vec<f64> = (0..RAYS * RAYS)
        .map(|i| ray(i).map_or(0.0, |depth| 1.0 / f64::from(depth)))
        .filter(|d| d.is_finite())
        .collect();
    disparities.sort_by(f64::total_cmp);
    let at = |share: usize| {
        disparities
            .get(disparities.len() * share / 20)
            .copied()
            .unwrap_or(0.0)
    };
    0.5 * (at(1) + at(19))
}
