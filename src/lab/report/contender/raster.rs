//! Rasterised geometry with baked light: the baseline without a ray tracer. The rasteriser of
//! houses ([`headbox_raster`]) finds the visible triangle of each pixel, baked light shades it.

use super::baked::BakedLight;
use super::{ContenderFrame, Draw, PixelOrigin};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::color::tone::ToneMap;
use headbox_core::environment::Environment;
use headbox_raster::{GroupWindow, PixelContent, RasterMesh, RasterView, Rasterizer};
use headbox_trace::bvh::{Hit, Ray, Tracer};
use image::RgbImage;
use rayon::prelude::*;
use std::sync::Arc;

/// Finds the visible triangle of each pixel.
struct Visibility {
    mesh: RasterMesh,
    rasterizer: Rasterizer,
}

impl Visibility {
    fn new(tracer: &Tracer) -> Self {
        let all = 0..tracer.scene().triangles.len() as u32;
        let mesh = RasterMesh::new(
            Arc::clone(tracer.scene()),
            std::slice::from_ref(&all),
            tracer.origin(),
        );
        Self {
            mesh,
            rasterizer: Rasterizer::new(),
        }
    }

    /// Returns the hits of all pixels of a frame, row-major; `t` is the eye depth.
    fn hits(&mut self, tracer: &Tracer, camera: &Camera) -> Vec<Option<Hit>> {
        let groups = [GroupWindow {
            group: 0,
            window: None,
        }];
        let view = RasterView {
            groups: &groups,
            markers: &[],
            exposure: 1.0,
            tone: ToneMap::SrgbClipped,
            hole_color_srgb: [0; 3],
        };
        let (frame, _) = self
            .rasterizer
            .draw(&self.mesh, camera, &view, &Environment::default());
        let eye = camera.eye() - tracer.origin();
        let hit = |pixel: u32| {
            let PixelContent::Triangle(primitive) = frame.seen(pixel as usize) else {
                return None;
            };
            let [x, y] =
                [pixel % camera.width(), pixel / camera.width()].map(|c| f64::from(c) + 0.5);
            let direction = camera.direction(x, y);
            let [a, b, c] = tracer
                .triangle(primitive)
                .map(|corner| corner.as_dvec3() - eye);
            // Homogeneous barycentric weights of the pixel's ray.
            let weights = DVec3::new(
                b.cross(c).dot(direction),
                c.cross(a).dot(direction),
                a.cross(b).dot(direction),
            );
            let sum = weights.element_sum();
            Some(Hit {
                t: (a.dot(b.cross(c)) / sum) as f32,
                primitive,
                u: (weights.y / sum) as f32,
                v: (weights.z / sum) as f32,
            })
        };
        (0..camera.width() * camera.height())
            .into_par_iter()
            .map(hit)
            .collect()
    }
}

/// Renderer that rasterises the scene's triangles.
pub struct RasterDraw {
    baked: Arc<BakedLight>,
    visibility: Visibility,
    color: RgbImage,
}

impl RasterDraw {
    /// Creates a renderer with this light.
    pub fn new(baked: Arc<BakedLight>) -> Self {
        let visibility = Visibility::new(baked.tracer());
        Self {
            baked,
            visibility,
            color: RgbImage::new(0, 0),
        }
    }

    /// Bakes the light of all pixels of `cameras`: by rounding, a rasterised pixel may lie in
    /// another cell than its ray's hit.
    pub fn bake_views(baked: &mut BakedLight, cameras: &[Camera]) {
        let mut visibility = Visibility::new(baked.tracer());
        for camera in cameras {
            let hits: Vec<(Ray, Hit)> = visibility
                .hits(baked.tracer(), camera)
                .into_iter()
                .zip(0..)
                .filter_map(|(hit, i)| {
                    let ray = baked.pixel_ray(camera, i % camera.width(), i / camera.width());
                    Some((ray, hit?))
                })
                .collect();
            baked.bake(hits);
        }
    }
}

impl Draw for RasterDraw {
    fn draw(&mut self, camera: &Camera) {
        let width = camera.width();
        let hits = self.visibility.hits(self.baked.tracer(), camera);
        let color = hits.par_iter().enumerate().flat_map_iter(|(i, hit)| {
            let ray = self
                .baked
                .pixel_ray(camera, i as u32 % width, i as u32 / width);
            self.baked.shade(&ray, *hit)
        });
        self.color =
            RgbImage::from_raw(width, camera.height(), color.collect()).unwrap_or_default();
    }

    fn picture(&mut self, camera: &Camera) -> ContenderFrame {
        self.draw(camera);
        let hits = self.visibility.hits(self.baked.tracer(), camera);
        ContenderFrame {
            color: self.color.clone(),
            origins: hits.iter().map(PixelOrigin::from_hit).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tolerance: the rasteriser snaps corners to a fraction of a pixel, so that edges move, and a
    /// pixel of a distant tree contains many edges of leaves. Measured: 13 of 3,072 pixels.
    const DIFFERING_PIXELS: usize = 18;

    #[test]
    fn rasteriser_and_rays_hit_same_triangles() {
        for (name, forward) in [
            ("bump", DVec3::NEG_Z),
            ("interior", DVec3::new(1.0, -0.4, 0.3)),
            ("tree", DVec3::NEG_Z),
        ] {
            let scene = Arc::new(headbox_scenes::build(name, 0).expect("built in"));
            let centre = scene.headbox.expect("it has one").centre;
            let tracer = Tracer::new(scene, centre);
            // 100 degrees: triangles of the room reach behind the eye.
            let camera = Camera::look_at(centre, centre + forward, DVec3::Y, 100.0, [64, 48])
                .expect("valid");
            let mut differing = 0;
            for (i, rasterised) in Visibility::new(&tracer)
                .hits(&tracer, &camera)
                .into_iter()
                .enumerate()
            {
                let (x, y) = (i as f64 % 64.0, (i / 64) as f64);
                let direction = camera.direction(x.floor() + 0.5, y + 0.5).as_vec3();
                let ray = Ray {
                    origin: glam::Vec3::ZERO,
                    direction,
                    t_min: 0.0,
                    t_max: f32::INFINITY,
                };
                let hit = tracer.closest(&ray);
                let agree = match (rasterised, hit) {
                    (Some(a), Some(b)) => (a.t - b.t).abs() <= 1e-4 * b.t,
                    (a, b) => a.is_none() && b.is_none(),
                };
                differing += usize::from(!agree);
            }
            assert!(differing <= DIFFERING_PIXELS, "{name}: {differing} of 3072");
        }
    }
}
