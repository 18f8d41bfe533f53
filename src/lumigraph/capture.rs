//! Images of a grid of cameras by ray tracing, and the layers of their pixels (L5).

use super::layers::{Placement, classify, place};
use super::{CameraGrid, DisparityLayer, Lumigraph, LumigraphError, MAX_LAYERS, Picture};
use crate::capture::light::{LightSample, Lighting, LitPoint, pixel_jitter};
use crate::capture::sampler::random4;
use crate::capture::trace::{Hit, PACKET, Ray, RayPacket, Tracer};
use crate::capture::{Camera, srgb8_from_linear};
use crate::environment::Environment;
use crate::progress::{Progress, check_cancelled};
use glam::Vec3;
use rayon::prelude::*;
use std::io;

/// How a scene becomes images.
#[derive(Clone, Copy, Debug)]
pub struct LumigraphCapture<'a> {
    /// The scene.
    pub tracer: &'a Tracer,
    /// Its light, as for truth frames.
    pub lighting: &'a Lighting,
    /// Whether light is computed; otherwise albedo and emission.
    pub lit: bool,
    /// Camera rays per pixel; at least 1.
    pub samples: u32,
}

/// Images with a disparity for each pixel: what layers are made of, as many as wanted.
#[derive(Clone, Debug)]
pub struct RawLumigraph {
    grid: CameraGrid,
    pictures: Vec<RawPicture>,
    environment: Environment,
}

/// What one camera sees.
#[derive(Clone, Debug, Default)]
struct RawPicture {
    color: Vec<[u8; 3]>,
    /// 1 / eye depth, 1/m; 0 where no surface is.
    disparity: Vec<f32>,
}

/// Rays of one pixel see the same surface if their depths differ by no more than this share. Others take no part in its colour,
/// which would come along when the surface is moved.
const SAME_SURFACE: f32 = 0.05;

impl LumigraphCapture<'_> {
    /// Traces all images. A pixel's disparity is that of the ray through its centre, its colour that of all rays that see the same
    /// surface.
    ///
    /// # Errors
    /// Of kind [`io::ErrorKind::Interrupted`] if `progress` gave it up.
    pub fn run(&self, grid: &CameraGrid, progress: &dyn Progress) -> io::Result<RawLumigraph> {
        let [width, height] = grid.size_px();
        progress.begin("images", "rows", grid.camera_count() as u64 * u64::from(height));
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
        Ok(RawLumigraph { grid: grid.clone(), pictures, environment: Environment::sky(self.lighting) })
    }

    /// Colour and disparity of a pixel.
    fn pixel(&self, camera: &Camera, pixel: [u32; 2]) -> ([u8; 3], f32) {
        let centre = self.ray(camera, pixel, [0.5; 2]);
        let depth = self.tracer.closest(&centre).map(|hit| hit.t);
        let (mut sum, mut count) = (Vec3::ZERO, 0u32);
        for start in (0..self.samples.max(1)).step_by(PACKET) {
            let numbers = start..self.samples.max(1).min(start + PACKET as u32);
            let jitter = |index| if self.samples <= 1 { [0.5; 2] } else { pixel_jitter(pixel[0], pixel[1], index) };
            let rays: Vec<Ray> = numbers.clone().map(|index| self.ray(camera, pixel, jitter(index))).collect();
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
            (sum, count) = (self.radiance(&centre, self.tracer.closest(&centre).as_ref(), pixel, 0), 1);
        }
        let color = (sum / count as f32 * self.lighting.exposure).to_array().map(srgb8_from_linear);
        let disparity = depth.map_or(0.0, |depth| 1.0 / depth);
        (color, if disparity.is_finite() { disparity } else { 0.0 })
    }

    /// Rays have an eye depth of 1 per unit of length.
    fn ray(&self, camera: &Camera, [x, y]: [u32; 2], [dx, dy]: [f32; 2]) -> Ray {
        let direction = camera.direction(f64::from(x) + f64::from(dx), f64::from(y) + f64::from(dy)).as_vec3();
        let origin = (camera.eye() - self.tracer.origin()).as_vec3();
        Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
    }

    fn radiance(&self, ray: &Ray, hit: Option<&Hit>, [x, y]: [u32; 2], index: u32) -> Vec3 {
        let Some(hit) = hit else {
            return Vec3::from_array(self.lighting.miss_radiance(ray.direction.normalize()));
        };
        let (point, surface) = LitPoint::from_hit(self.tracer, ray, hit);
        let radiosity = if self.lit {
            let [stream, ..] = random4([x, y, 0x10e1, 3]);
            Vec3::from_array(self.lighting.radiosity_per_albedo(self.tracer, &point, &LightSample { stream, index }))
        } else {
            Vec3::ONE
        };
        Vec3::from_array(surface.albedo) * radiosity + Vec3::from_array(surface.emission)
    }
}

impl RawLumigraph {
    /// The cameras.
    pub fn grid(&self) -> &CameraGrid {
        &self.grid
    }

    /// The least and the greatest disparity of all pixels, 1/m.
    pub fn range(&self) -> Option<[f64; 2]> {
        let seen = self.pictures.iter().flat_map(|picture| &picture.disparity).filter(|d| **d > 0.0);
        let range = seen.fold([f32::INFINITY, 0.0], |[min, max], &d| [min.min(d), max.max(d)]);
        (range[1] > 0.0).then(|| range.map(f64::from))
    }

    /// The same images of fewer cameras: some columns and rows of the grid, by their numbers in ascending order.
    ///
    /// # Errors
    /// [`LumigraphError::NoCameras`] if none is left.
    pub fn with_cameras(&self, columns: &[usize], rows: &[usize]) -> Result<Self, LumigraphError> {
        let of = |numbers: &[usize], places: &[f64]| numbers.iter().filter_map(|i| places.get(*i).copied()).collect();
        let grid = self.grid.with_places(of(columns, self.grid.columns()), of(rows, self.grid.rows()))?;
        let count = self.grid.columns().len();
        let numbers = rows.iter().flat_map(|row| columns.iter().map(move |column| row * count + column));
        let pictures: Vec<RawPicture> = numbers.filter_map(|number| self.pictures.get(number).cloned()).collect();
        if pictures.len() != grid.camera_count() {
            return Err(LumigraphError::NoCameras);
        }
        Ok(Self { grid, pictures, environment: self.environment.clone() })
    }

    /// Puts each pixel into one of at most `count` layers.
    ///
    /// # Errors
    /// [`LumigraphError::TooManyLayers`]; [`LumigraphError::NothingSeen`] if no pixel has a disparity.
    pub fn layered(&self, count: usize, placement: Placement) -> Result<Lumigraph, LumigraphError> {
        if count > MAX_LAYERS {
            return Err(LumigraphError::TooManyLayers(count));
        }
        let disparities: Vec<f32> =
            self.pictures.iter().flat_map(|picture| picture.disparity.iter().copied()).collect();
        let layers = place(&disparities, count, placement);
        if layers.is_empty() {
            return Err(LumigraphError::NothingSeen);
        }
        let pictures = self.pictures.par_iter().map(|picture| picture.layered(&layers)).collect();
        let mut lumigraph = Lumigraph::new(self.grid.clone(), layers, pictures)?;
        lumigraph.info.placement = placement;
        lumigraph.environment = self.environment.clone();
        Ok(lumigraph)
    }
}

impl RawPicture {
    fn layered(&self, layers: &[DisparityLayer]) -> Picture {
        let index = self.disparity.iter().map(|&disparity| classify(layers, disparity)).collect();
        Picture { color: self.color.clone(), index }
    }
}
