//! Preview of a scene: a primary ray for each pixel, without light. It shows what no cube LDI shows
//! yet, and what lies outside of the headbox.

use glam::{DVec3, Vec3};
use headbox_core::camera::Camera;
use headbox_core::color::srgb8_from_linear;
use headbox_trace::bvh::{Ray, Tracer};
use rayon::prelude::*;
use std::sync::Arc;

/// Brightness of surfaces that face the viewer.
const BRIGHTEST: f32 = 0.9;
/// Brightness of surfaces seen edge-on.
const DIMMEST: f32 = 0.35;
/// Background of a scene without a sky, linear.
const NO_SKY: [f32; 3] = [0.1; 3];

/// Preview of a scene.
pub(super) struct Preview {
    tracer: Arc<Tracer>,
    /// Camera and pixels of the last picture: a resting view is polled, but not traced again.
    last: Option<(Camera, Vec<[u8; 4]>)>,
}

impl Preview {
    pub(super) fn new(tracer: Arc<Tracer>) -> Self {
        Self { tracer, last: None }
    }

    /// Draws the scene as seen by a camera.
    pub(super) fn paint(&mut self, camera: &Camera, pixels: &mut [[u8; 4]]) {
        if let Some((last, painted)) = &self.last
            && last == camera
            && painted.len() == pixels.len()
        {
            pixels.copy_from_slice(painted);
            return;
        }
        let rows = pixels.par_chunks_mut(camera.width() as usize).enumerate();
        rows.for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let direction = camera.direction(x as f64 + 0.5, y as f64 + 0.5);
                let [r, g, b] = self.color(camera.eye(), direction.normalize().as_vec3());
                *pixel = [r, g, b, u8::MAX];
            }
        });
        self.last = Some((*camera, pixels.to_vec()));
    }

    /// Colour seen along a ray, sRGB.
    fn color(&self, eye: DVec3, direction: Vec3) -> [u8; 3] {
        let scene = self.tracer.scene();
        let origin = (eye - self.tracer.origin()).as_vec3();
        let Some(hit) = self.tracer.closest(&Ray::new(origin, direction)) else {
            let sky = scene.sky.as_ref().map_or(NO_SKY, |sky| sky.seen(direction));
            return sky.map(srgb8_from_linear);
        };
        let facing = scene.geometric_normal(hit.primitive).dot(direction).abs();
        let surface = scene.surface(hit.primitive, hit.u, hit.v);
        let shade = DIMMEST + (BRIGHTEST - DIMMEST) * facing;
        let color = Vec3::from(surface.albedo) * shade + Vec3::from(surface.emission);
        color.to_array().map(srgb8_from_linear)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_ldi::scene_source::SceneSource;
    use headbox_scene::scene::Scene;

    fn painted(scene: Scene, eye: DVec3) -> Vec<[u8; 4]> {
        let camera = Camera::look_at(eye, eye + DVec3::NEG_Z, DVec3::Y, 60.0, [40, 30]).unwrap();
        let mut preview = Preview::new(Arc::new(Tracer::new(Arc::new(scene), eye)));
        let mut pixels = vec![[0; 4]; 40 * 30];
        preview.paint(&camera, &mut pixels);
        let first = pixels.clone();
        pixels.fill([0; 4]);
        preview.paint(&camera, &mut pixels);
        assert_eq!(pixels, first, "a resting view stays");
        pixels
    }

    #[test]
    fn preview_covers_closed_room() {
        let scene = SceneSource::new("builtin:interior").open().unwrap();
        let eye = scene.headbox.unwrap().centre;
        let pixels = painted(scene, eye);
        assert!(pixels.iter().all(|pixel| pixel[3] == u8::MAX));
        let colors: std::collections::HashSet<_> = pixels.iter().collect();
        assert!(colors.len() > 100, "{} colours", colors.len());
    }

    #[test]
    fn scene_without_surfaces_shows_sky() {
        let pixels = painted(Scene::default(), DVec3::ZERO);
        assert!(pixels.iter().all(|pixel| *pixel == pixels[0]));
    }
}
