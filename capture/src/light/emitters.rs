//! Emissive triangles, by their share of all power.

use super::luminance;
use crate::scene::Scene;
use crate::trace::Tracer;
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
