//! Emissive triangles, and light straight from them.

use super::light_tree::{Leaf, LightTree};
use super::{LightSample, Lighting, LitPoint, luminance};
use crate::trace::{Ray, Tracer};
use glam::Vec3;

/// All emissive triangles of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Emitters {
    /// By which they are drawn; lights have the numbers of their triangles.
    tree: LightTree,
}

impl Emitters {
    pub(super) fn of(tracer: &Tracer) -> Self {
        let scene = tracer.scene();
        let leaf = |primitive: u32| {
            let material = &scene.materials[scene.triangles[primitive as usize].material as usize];
            if material.emission.iter().all(|&c| c <= 0.0) {
                return None;
            }
            let corners @ [a, b, c] = tracer.triangle(primitive);
            let power = area(corners) * luminance(scene.surface(primitive, 1.0 / 3.0, 1.0 / 3.0).emission);
            let bounds = [a.min(b).min(c), a.max(b).max(c)];
            (power > 0.0 && power.is_finite()).then_some(Leaf { bounds, power, name: primitive })
        };
        Self { tree: LightTree::new((0..scene.triangles.len() as u32).filter_map(leaf).collect()) }
    }
}

/// Of a triangle, square metres.
fn area([a, b, c]: [Vec3; 3]) -> f32 {
    0.5 * (b - a).cross(c - a).length()
}

impl Lighting {
    /// Radiosity per albedo straight from one emissive triangle.
    pub(super) fn emitter_light(
        &self,
        tracer: &Tracer,
        point: &LitPoint,
        sample: &LightSample,
        dimension: u32,
    ) -> Vec3 {
        if self.emitters.tree.is_empty() {
            return Vec3::ZERO;
        }
        let drawn = self.emitters.tree.draw(point, sample.single(dimension + 1));
        let Some((primitive, probability)) = drawn.filter(|(_, probability)| *probability > 0.0) else {
            return Vec3::ZERO;
        };
        let [s, t] = sample.pair(dimension + 1);
        // Uniform on the triangle: fold the far half of the square back (no square root needed).
        let (u, v) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
        let corners @ [a, b, c] = tracer.triangle(primitive);
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
        let surface = tracer.scene().surface(primitive, u, v);
        let cos_there = direction.dot(surface.normal).abs();
        // Stop short of the light itself.
        let ray = Ray { origin, direction: offset, t_min: 0.0, t_max: 0.999 };
        if cos_there <= 0.0 || tracer.occluded(&ray) {
            return Vec3::ZERO;
        }
        let density = probability / area(corners);
        let geometry = cos_here * cos_there / (distance2 * std::f32::consts::PI * density);
        Vec3::from_array(surface.emission) * geometry
    }
}
