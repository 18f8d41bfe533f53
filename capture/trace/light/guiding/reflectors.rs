//! Reflectors: surfaces next to a lamp, such as the inside of its shade, at which rays of paths are
//! aimed.
//!
//! They light a room like lamps, but few cosine-weighted rays hit one, and those that do are so
//! bright that they are visible as specks. A fixed share of all rays is therefore aimed at points
//! on them, and counts only if it hits the triangle at which it was aimed. Aimed and other rays are
//! combined by the balance heuristic for one sample (Veach and Guibas 1995, "Optimally combining
//! sampling techniques for Monte Carlo rendering"), so that no mean changes.

use crate::bvh::Tracer;
use crate::light::direct::emitters::{area, point_on_triangle};
use crate::light::direct::light_tree::{Leaf, LightTree};
use crate::light::{LightSample, Lighting, LitPoint};
use glam::Vec3;
use headbox_core::color::luminance;
use rayon::prelude::*;

/// Fraction of the rays that are aimed at reflectors, if there are any.
pub(super) const AIMED_FRACTION: f32 = 0.25;

/// Minimum reflected light of a reflector, in units of white.
const MIN_LEVEL: f32 = 4.0;

/// Number of light samples on each side of a triangle near a lamp.
const SAMPLES: u32 = 8;

/// Reflectors as seen from a point.
#[derive(Clone, Copy)]
pub(crate) struct Reflectors<'a> {
    tree: &'a LightTree,
    point: LitPoint,
}

impl Reflectors<'_> {
    /// Returns the direction to a point on a reflector, sampled by three numbers in [0, 1), and the
    /// reflector's triangle.
    pub(crate) fn aim(&self, tracer: &Tracer, number: f32, pair: [f32; 2]) -> Option<(Vec3, u32)> {
        let (primitive, _) = self.tree.sample(&self.point, number)?;
        let [u, v] = point_on_triangle(pair);
        let [a, b, c] = tracer.triangle(primitive);
        let target = a + (b - a) * u + (c - a) * v;
        let direction = (target - self.point.ray_origin()).try_normalize()?;
        Some((direction, primitive))
    }

    /// Returns the probability density, per steradian, with which [`Self::aim`] samples the
    /// direction of a point on a triangle `distance` metres away; 0 if that is not a reflector.
    pub(crate) fn density(
        &self,
        tracer: &Tracer,
        direction: Vec3,
        (primitive, distance): (u32, f32),
    ) -> f32 {
        let probability = self.tree.probability(&self.point, primitive);
        if probability == 0.0 {
            return 0.0;
        }
        let cos_there = direction.dot(tracer.geometric_normal(primitive)).abs();
        let area = area(tracer.triangle(primitive));
        probability * distance * distance / (area * cos_there.max(f32::MIN_POSITIVE))
    }
}

impl Lighting {
    /// Returns the reflectors as seen from a point, if there are any.
    pub(crate) fn reflectors(&self, point: &LitPoint) -> Option<Reflectors<'_>> {
        (!self.reflectors.is_empty()).then_some(Reflectors {
            tree: &self.reflectors,
            point: *point,
        })
    }

    /// Finds the triangles that reflect at least [`MIN_LEVEL`] of the light of emissive triangles.
    /// Missing some only costs noise.
    pub(super) fn find_reflectors(&self, tracer: &Tracer) -> LightTree {
        if self.emitters.is_empty() {
            return LightTree::default();
        }
        let count = tracer.scene().triangles.len() as u32;
        let leaf = |primitive: u32| self.reflector(tracer, primitive);
        LightTree::new((0..count).into_par_iter().filter_map(leaf).collect())
    }

    /// Returns a triangle as a reflector, if it is one.
    fn reflector(&self, tracer: &Tracer, primitive: u32) -> Option<Leaf> {
        let corners @ [a, b, c] = tracer.triangle(primitive);
        let bounds = [a.min(b).min(c), a.max(b).max(c)];
        let is_bright = |light: f32| light * self.exposure >= MIN_LEVEL;
        if !is_bright(self.emitters.light_bound(bounds)) {
            return None;
        }
        let [front, back] = [1.0, -1.0].map(|side| self.reflected(tracer, primitive, side));
        let power = area(corners) * (front + back);
        let is_reflector = is_bright(front.max(back)) && power > 0.0 && power.is_finite();
        is_reflector.then_some(Leaf {
            bounds,
            power,
            id: primitive,
        })
    }

    /// Returns the mean luminance of the light of emissive triangles that one side of a triangle
    /// reflects.
    fn reflected(&self, tracer: &Tracer, primitive: u32, side: f32) -> f32 {
        let [a, b, c] = tracer.triangle(primitive);
        let normal = tracer.geometric_normal(primitive) * side;
        let mut sum = 0.0;
        for index in 0..SAMPLES {
            let sample = LightSample {
                stream: primitive,
                index,
            };
            let [u, v] = point_on_triangle(sample.pair(0));
            let point = LitPoint {
                position: a + (b - a) * u + (c - a) * v,
                normal,
                shading_normal: normal,
                extent: tracer.extent(primitive),
            };
            let albedo = Vec3::from_array(tracer.surface(primitive, u, v).albedo);
            let light = self.emitter_light(tracer, &point, &sample, 1, None).light;
            sum += luminance((albedo * light).to_array());
        }
        sum / SAMPLES as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::tests::{add_quad, lit_point};
    use glam::{DVec3, dvec3};
    use headbox_scene::material::Material;
    use headbox_scene::scene::Scene;
    use std::sync::Arc;

    /// Returns a shade of 0.3 m, open below, with a bulb in its top; half of its sides glow
    /// themselves.
    fn shade() -> Scene {
        let material = |emission: f32| Material {
            emission: [emission; 3],
            albedo: [0.8; 3],
            ..Material::default()
        };
        let mut scene = Scene {
            materials: vec![material(0.0), material(1.0), material(1000.0)],
            ..Scene::default()
        };
        let mut square = |half: f64, y: f64, material: u32| {
            let at = |x: f64, z: f64| dvec3(x * half, y, z * half);
            let corners = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
            add_quad(&mut scene, corners, material);
        };
        square(0.15, 0.15, 0);
        square(0.02, 0.12, 2);
        for (side, material) in [(-0.15, 0), (0.15, 1)] {
            let across = |y: f64, z: f64| dvec3(side, y, z);
            let along = |y: f64, x: f64| dvec3(x, y, side);
            for wall in [&across as &dyn Fn(f64, f64) -> DVec3, &along] {
                let corners = [
                    wall(-0.15, -0.15),
                    wall(-0.15, 0.15),
                    wall(0.15, 0.15),
                    wall(0.15, -0.15),
                ];
                add_quad(&mut scene, corners, material);
            }
        }
        scene
    }

    const SAMPLES: u32 = 1 << 22;

    /// Returns mean and variance of samples with two bounces at a place that sees the inside of the
    /// shade, but not the bulb, and the fraction of samples with light.
    fn light(lighting: &Lighting, tracer: &Tracer) -> [f64; 3] {
        let point = lit_point(Vec3::new(-0.8, -1.0, -0.2), Vec3::Y, 2.0);
        let sample = |index| {
            let sample = LightSample { stream: 3, index };
            let light = f64::from(lighting.soft_radiosity(tracer, &point, &sample).x);
            [light, light * light, f64::from(u8::from(light > 0.0))]
        };
        let [mean, square, share] = (0..SAMPLES)
            .into_par_iter()
            .map(sample)
            .reduce(|| [0.0; 3], |a, b| std::array::from_fn(|i| a[i] + b[i]))
            .map(|sum| sum / f64::from(SAMPLES));
        [mean, square - mean * mean, share]
    }

    #[test]
    fn aimed_rays_keep_mean_and_find_light_more_often() {
        let tracer = Tracer::new(Arc::new(shade()), DVec3::ZERO);
        let mut lighting = Lighting::unmetered(&tracer, 2);
        let [expected, variance, share] = light(&lighting, &tracer);
        lighting.reflectors = lighting.find_reflectors(&tracer);
        assert!(!lighting.reflectors.is_empty());
        let [mean, _, aimed_share] = light(&lighting, &tracer);
        // Three standard errors of independent samples.
        let tolerance = 3.0 * (variance / f64::from(SAMPLES)).sqrt();
        assert!(
            (mean - expected).abs() < tolerance && tolerance < 0.05 * expected,
            "{mean}, not {expected} +- {tolerance}"
        );
        assert!(aimed_share > 1.5 * share, "{aimed_share}, without {share}");
    }

    #[test]
    fn dim_surfaces_are_no_reflectors() {
        let mut scene = shade();
        scene.materials[2].emission = [20.0; 3];
        let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
        let lighting = Lighting::unmetered(&tracer, 2);
        assert!(lighting.find_reflectors(&tracer).is_empty());
    }
}
