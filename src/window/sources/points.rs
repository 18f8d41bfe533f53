//! Point cloud of a scene, shown until the first round of its capture is finished. Points are
//! distributed over the surfaces by their solid angle as seen from the headbox, and each point is
//! drawn with the size of its share of the surface.

use glam::{DVec3, Vec3};
use headbox_core::camera::Camera;
use headbox_core::color::srgb8_from_linear;
use headbox_scene::scene::Scene;
use headbox_trace::sampler::{random4, unit_float};
use std::ops::Range;

/// Number of points that represent a scene.
const POINTS: u32 = 150_000;

/// Maximum radius of a point, pixels.
const MAX_RADIUS_PX: f64 = 12.0;

/// Brightness of surfaces that face the viewer.
const BRIGHTEST: f32 = 0.9;
/// Brightness of surfaces seen edge-on.
const DIMMEST: f32 = 0.35;

#[derive(Clone, Copy)]
struct Point {
    position: DVec3,
    /// Half the distance to neighbouring points, metres.
    radius_m: f64,
    color_srgb: [u8; 3],
}

/// Point cloud of a scene.
pub(super) struct Points {
    points: Vec<Point>,
    sky_srgb: [u8; 3],
    depths: Vec<f32>,
}

impl Points {
    /// Samples the surfaces of a scene; deterministic for a given scene and centre.
    pub(super) fn new(scene: &Scene, centre: DVec3) -> Self {
        // The number of points on a triangle is proportional to its area over its squared distance,
        // so that near and far surfaces look equally dense.
        let mut running = Vec::with_capacity(scene.triangles.len());
        let mut sum = 0.0;
        for triangle in 0..scene.triangles.len() as u32 {
            let [a, b, c] = scene.corners(triangle);
            let area = (b - a).cross(c - a).length() / 2.0;
            let share = area / (((a + b + c) / 3.0).distance_squared(centre) + area);
            sum += if share.is_finite() { share } else { 0.0 };
            running.push(sum);
        }
        let point = |index: u32| {
            let random = random4([index, 0x9017, 0, 0]).map(unit_float);
            let wanted = (f64::from(index) + f64::from(random[0])) / f64::from(POINTS) * sum;
            let triangle = running
                .partition_point(|&end| end <= wanted)
                .min(running.len().saturating_sub(1));
            let count = weight(&running, triangle) / sum * f64::from(POINTS);
            let square = [random[1], random[2]];
            Point::sample(scene, centre, triangle as u32, square, count)
        };
        let range: Range<u32> = if sum > 0.0 { 0..POINTS } else { 0..0 };
        let sky = scene
            .sky
            .as_ref()
            .map_or([0.1; 3], |sky| sky.seen(Vec3::NEG_Z));
        Self {
            points: range.map(point).collect(),
            sky_srgb: sky.map(srgb8_from_linear),
            depths: Vec::new(),
        }
    }

    /// Draws the points as seen by a camera.
    pub(super) fn paint(&mut self, camera: &Camera, pixels: &mut [[u8; 4]]) {
        let (width, height) = (i64::from(camera.width()), i64::from(camera.height()));
        let [r, g, b] = self.sky_srgb;
        pixels.fill([r, g, b, u8::MAX]);
        self.depths.clear();
        self.depths.resize(pixels.len(), f32::INFINITY);
        for point in &self.points {
            let depth = (point.position - camera.eye()).dot(camera.forward());
            let Some([x, y, _]) = camera.project(point.position).filter(|_| depth > 0.0) else {
                continue;
            };
            let radius = (point.radius_m * camera.focal_px() / depth).clamp(0.5, MAX_RADIUS_PX);
            let span = |at: f64, end: i64| {
                let [low, high] =
                    [at - radius, at + radius].map(|edge| (edge.round() as i64).clamp(0, end));
                low..high
            };
            let [r, g, b] = point.color_srgb;
            for row in span(y, height) {
                for column in span(x, width) {
                    let at = (row * width + column) as usize;
                    if (depth as f32) < self.depths[at] {
                        self.depths[at] = depth as f32;
                        pixels[at] = [r, g, b, u8::MAX];
                    }
                }
            }
        }
    }
}

/// Weight of one triangle, from the running sums.
fn weight(running: &[f64], triangle: usize) -> f64 {
    let before = triangle
        .checked_sub(1)
        .map_or(0.0, |before| running[before]);
    running.get(triangle).map_or(0.0, |end| end - before)
}

impl Point {
    /// Samples one of `count` points of a triangle from a random position in the unit square.
    fn sample(scene: &Scene, centre: DVec3, triangle: u32, [s, t]: [f32; 2], count: f64) -> Self {
        // Area-preserving map of the square to the triangle.
        let root = s.sqrt();
        let (u, v) = (root * (1.0 - t), root * t);
        let [a, b, c] = scene.corners(triangle);
        let position = a + (b - a) * f64::from(u) + (c - a) * f64::from(v);
        let normal = (b - a).cross(c - a);
        let radius_m = (normal.length() / 2.0 / count.max(1.0)).sqrt();
        let facing = (position - centre)
            .normalize_or_zero()
            .dot(normal.normalize_or_zero())
            .abs() as f32;
        let albedo = Vec3::from(scene.paint(triangle).albedo(u, v))
            * (DIMMEST + (BRIGHTEST - DIMMEST) * facing);
        let color = albedo + Vec3::from(scene.emission(triangle, u, v));
        Self {
            position,
            radius_m,
            color_srgb: color.to_array().map(srgb8_from_linear),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_ldi::scene_source::SceneSource;

    #[test]
    fn points_cover_closed_room() {
        let scene = SceneSource::new("builtin:interior").open().unwrap();
        let centre = scene.headbox.unwrap().centre;
        let mut points = Points::new(&scene, centre);
        let camera =
            Camera::look_at(centre, centre + DVec3::NEG_Z, DVec3::Y, 60.0, [160, 120]).unwrap();
        let mut pixels = vec![[0; 4]; 160 * 120];
        points.paint(&camera, &mut pixels);
        let open = points
            .depths
            .iter()
            .filter(|depth| depth.is_infinite())
            .count();
        assert!(open * 50 < pixels.len(), "{open} pixels see no point");
        let first = pixels.clone();
        points.paint(&camera, &mut pixels);
        assert_eq!(pixels, first);
    }

    #[test]
    fn scene_without_surfaces_shows_sky() {
        let mut points = Points::new(&Scene::default(), DVec3::ZERO);
        let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [8, 8]).unwrap();
        let mut pixels = vec![[0; 4]; 64];
        points.paint(&camera, &mut pixels);
        assert!(
            pixels
                .iter()
                .all(|pixel| *pixel == pixels[0] && pixel[3] == u8::MAX)
        );
    }
}
