//! Baked light: original geometry and textures with a light map of small cells on the triangles.
//! It is the baseline without an image-based representation, for static scenes, with one ray per
//! pixel ([`BakedRays`]) or with a rasteriser ([`super::RasterDraw`]).

use super::{ContenderFrame, Draw, PixelOrigin};
use glam::Vec3;
use headbox_core::camera::Camera;
use headbox_trace::bvh::{Hit, HitPacket, PACKET, Ray, RayPacket, Tracer};
use headbox_trace::light::{LightSample, Lighting, LitPoint};
use headbox_trace::sampler::random4;
use image::RgbImage;
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::Arc;

/// LightCell of the light map: triangle; place on a grid over the triangle, with the side of the
/// triangle in the lowest bit; base-2 logarithm of the grid's size.
type LightCell = (u32, u32, u32);

/// Light map of a scene, filled on demand.
pub struct BakedLight {
    tracer: Arc<Tracer>,
    lighting: Lighting,
    /// Irradiance / pi by cell.
    light: HashMap<LightCell, Vec3>,
    light_samples: u32,
    /// Edge of a cell over its distance from the centre of the headbox.
    cell_angle: f32,
}

impl BakedLight {
    /// Creates an empty light map. Cells are about as large as a face pixel of a cube LDI of
    /// `face_size_px` and get `light_samples` each.
    pub fn new(
        tracer: Arc<Tracer>,
        lighting: Lighting,
        face_size_px: u32,
        light_samples: u32,
    ) -> Self {
        let cell_angle = 2.0 / face_size_px as f32;
        Self {
            tracer,
            lighting,
            light: HashMap::new(),
            light_samples: light_samples.max(1),
            cell_angle,
        }
    }

    /// Bakes the cells that a camera sees.
    pub fn bake_view(&mut self, camera: &Camera) {
        let mut hits = Vec::new();
        for y in 0..camera.height() {
            self.row_hits(camera, y, |_, ray, hit| {
                hits.extend(hit.map(|hit| (ray, hit)));
            });
        }
        self.bake(hits);
    }

    /// Bakes the cells of `hits` that have no light yet.
    pub fn bake(&mut self, hits: impl IntoIterator<Item = (Ray, Hit)>) {
        let with_cell = |(ray, hit): (Ray, Hit)| (self.cell(&ray, &hit), ray, hit);
        let mut unlit: Vec<(LightCell, Ray, Hit)> = hits.into_iter().map(with_cell).collect();
        // The light of a cell is measured at its first hit in pixel order.
        unlit.sort_by_key(|(cell, ..)| *cell);
        unlit.dedup_by_key(|(cell, ..)| *cell);
        unlit.retain(|(cell, ..)| !self.light.contains_key(cell));
        let lit: Vec<(LightCell, Vec3)> = unlit
            .par_iter()
            .map(|(cell, ray, hit)| (*cell, self.radiosity(*cell, ray, hit)))
            .collect();
        self.light.extend(lit);
    }

    /// Returns the size of the light map without the scene, bytes.
    pub fn bytes(&self) -> u64 {
        (self.light.len() * size_of::<(LightCell, Vec3)>()) as u64
    }

    /// Returns the tracer of the lit scene.
    pub(super) fn tracer(&self) -> &Tracer {
        &self.tracer
    }

    /// Returns the ray through a pixel's centre in the tracer's frame; its direction has eye depth
    /// 1.
    pub(super) fn pixel_ray(&self, camera: &Camera, x: u32, y: u32) -> Ray {
        let origin = (camera.eye() - self.tracer.origin()).as_vec3();
        let direction = camera
            .direction(f64::from(x) + 0.5, f64::from(y) + 0.5)
            .as_vec3();
        Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max: f32::INFINITY,
        }
    }

    fn cell(&self, ray: &Ray, hit: &Hit) -> LightCell {
        let [a, b, c] = self.tracer.triangle(hit.primitive);
        let edge = (b - a).length().max((c - a).length());
        let distance = (ray.origin + ray.direction * hit.t).length();
        // A power of two, so that neighbouring hits use the same grid.
        let cells =
            (edge / (self.cell_angle * distance).max(f32::MIN_POSITIVE)).clamp(1.0, 16_384.0);
        let side = (cells.log2().round() as u32).min(14);
        let place = |weight: f32| (weight.clamp(0.0, 1.0) * (1u32 << side) as f32) as u32;
        let normal = (b - a).cross(c - a);
        let back = u32::from(normal.dot(ray.direction) > 0.0);
        (
            hit.primitive,
            place(hit.u) << 17 | place(hit.v) << 2 | back,
            side,
        )
    }

    fn radiosity(&self, cell: LightCell, ray: &Ray, hit: &Hit) -> Vec3 {
        let (point, _) = LitPoint::from_hit(&self.tracer, ray, hit);
        let [stream, ..] = random4([cell.0, cell.1, cell.2, 0x0bae]);
        let count = self.light_samples;
        let sample = |index| {
            let sample = LightSample { stream, index };
            self.lighting
                .cached_radiosity(&self.tracer, &point, &sample)
        };
        (0..count).map(sample).sum::<Vec3>() / count as f32
    }

    /// Traces a row of pixels and calls `visit` with each pixel's column, ray and hit.
    fn row_hits(&self, camera: &Camera, y: u32, mut visit: impl FnMut(u32, Ray, Option<Hit>)) {
        for start in (0..camera.width()).step_by(PACKET) {
            let columns = start..camera.width().min(start + PACKET as u32);
            let rays: Vec<Ray> = columns
                .clone()
                .map(|x| self.pixel_ray(camera, x, y))
                .collect();
            let hits: HitPacket = self.tracer.closest_packet(&RayPacket::from_rays(&rays));
            for (lane, x) in columns.enumerate() {
                visit(x, rays[lane], hits.hit(lane));
            }
        }
    }

    /// Returns the colour of the lit surface at a hit, or of the environment, sRGB.
    pub(super) fn shade(&self, ray: &Ray, hit: Option<Hit>) -> [u8; 3] {
        let linear = match hit {
            Some(hit) => {
                let surface = self.tracer.scene().surface(hit.primitive, hit.u, hit.v);
                let light = self
                    .light
                    .get(&self.cell(ray, &hit))
                    .copied()
                    .unwrap_or_default();
                Vec3::from_array(surface.albedo) * light + Vec3::from_array(surface.emission)
            }
            None => Vec3::from_array(self.lighting.miss_radiance(ray.direction.normalize())),
        };
        self.lighting.stored(linear)
    }
}

/// Renderer that traces one ray per pixel, through its centre.
pub struct BakedRays {
    baked: Arc<BakedLight>,
    color: RgbImage,
}

impl BakedRays {
    /// Creates a renderer with this light.
    pub fn new(baked: Arc<BakedLight>) -> Self {
        Self {
            baked,
            color: RgbImage::new(0, 0),
        }
    }
}

impl Draw for BakedRays {
    fn draw(&mut self, camera: &Camera) {
        let width = camera.width();
        let mut pixels = vec![0u8; 3 * width as usize * camera.height() as usize];
        pixels
            .par_chunks_mut(3 * width as usize)
            .enumerate()
            .for_each(|(y, row)| {
                self.baked.row_hits(camera, y as u32, |x, ray, hit| {
                    row[3 * x as usize..3 * x as usize + 3]
                        .copy_from_slice(&self.baked.shade(&ray, hit));
                });
            });
        self.color = RgbImage::from_raw(width, camera.height(), pixels).unwrap_or_default();
    }

    fn picture(&mut self, camera: &Camera) -> ContenderFrame {
        self.draw(camera);
        let mut origins = Vec::with_capacity(self.color.len() / 3);
        for y in 0..camera.height() {
            self.baked.row_hits(camera, y, |_, _, hit| {
                origins.push(PixelOrigin::from_hit(&hit));
            });
        }
        ContenderFrame {
            color: self.color.clone(),
            origins,
        }
    }
}
