//! Emissive triangles, by their share of all power.

use super::{LightSample, Lighting, LitPoint, luminance};
use crate::scene::Scene;
use crate::trace::{Ray, Tracer};
use glam::Vec3;
use std::sync::Arc;

/// An emissive triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Emitter {
    pub(super) primitive: u32,
    /// Probability of this emitter or one before it.
    pub(super) cumulative: f32,
    /// Probability of this emitter, over its area: density of a light sample, 1/m^2.
    pub(super) density: f32,
}

/// All emissive triangles of a scene.
pub(super) fn collect(tracer: &Tracer) -> Vec<Emitter> {
    let scene: &Arc<Scene> = tracer.scene();
    let mut emitters = Vec::new();
    let mut total = 0.0f64;
    for primitive in 0..scene.triangles.len() as u32 {
        let material = &scene.materials[scene.triangles[primitive as usize].material as usize];
        if material.emission.iter().all(|&c| c <= 0.0) {
            continue;
        }
        let [a, b, c] = tracer.triangle(primitive);
        let area = 0.5 * (b - a).cross(c - a).length();
        let power = area * luminance(scene.surface(primitive, 1.0 / 3.0, 1.0 / 3.0).emission);
        if power > 0.0 && power.is_finite() {
            total += f64::from(power);
            emitters.push((primitive, power, area, total));
        }
    }
    let to_emitter = |(primitive, power, area, sum): (u32, f32, f32, f64)| Emitter {
        primitive,
        cumulative: (sum / total) as f32,
        density: (f64::from(power) / total / f64::from(area)) as f32,
    };
    emitters.into_iter().map(to_emitter).collect()
}

impl Lighting {
    /// Radiosity per albedo straight from one emissive triangle, drawn by its power.
    pub(super) fn emitter_light(
        &self,
        tracer: &Tracer,
        point: &LitPoint,
        sample: &LightSample,
        dimension: u32,
    ) -> Vec3 {
        if self.emitters.is_empty() {
            return Vec3::ZERO;
        }
        let pick = sample.single(dimension + 1);
        let at = self.emitters.partition_point(|e| e.cumulative <= pick).min(self.emitters.len() - 1);
        let emitter = &self.emitters[at];
        let [s, t] = sample.pair(dimension + 1);
        // Uniform on the triangle: fold the far half of the square back (no square root needed).
        let (u, v) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
        let [a, b, c] = tracer.triangle(emitter.primitive);
        let target = a + (b - a) * u + (c - a) * v;
        let origin = point.lifted();
        let offset = target - origin;
        let distance2 = offset.length_squared();
        let direction = offset / distance2.sqrt();
        let cos_here = direction.dot(point.shading_normal);
        // `is_nan`: the sample fell on the very point that it lights.
        if cos_here <= 0.0 || cos_here.is_nan() || direction.dot(point.normal) <= 0.0 {
            return Vec3::ZERO;
        }
        let surface = tracer.scene().surface(emitter.primitive, u, v);
        let cos_there = direction.dot(surface.normal).abs();
        // Stop short of the light itself.
        let ray = Ray { origin, direction: offset, t_min: 0.0, t_max: 0.999 };
        if cos_there <= 0.0 || tracer.occluded(&ray) {
            return Vec3::ZERO;
        }
        let geometry = cos_here * cos_there / (distance2 * std::f32::consts::PI * emitter.density);
        Vec3::from_array(surface.emission) * geometry
    }
}
