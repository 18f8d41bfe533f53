//! Emissive triangles and their direct light: by points sampled on them (next-event estimation) and
//! by rays of a path that hit one.
//!
//! Both are combined by the balance heuristic, as for the sky ([`super::sky`]): a sampled point
//! then never contributes more than the lamp's radiance (six times that with guided and aimed
//! rays), however close the lit point is, where points alone would be rare and thousands of times
//! too bright.

use super::light_tree::{Leaf, LightTree};
use crate::bvh::{Hit, Ray, Tracer};
use crate::light::guiding::guide::Directions;
use crate::light::path::IncidentLight;
use crate::light::{LightSample, Lighting, LitPoint};
use glam::Vec3;
use headbox_core::color::luminance;
use headbox_scene::scene::Surface;
use std::f32::consts::PI;

/// Builds the light tree of a scene's emissive triangles; the lights' ids are triangle indices.
pub(crate) fn emitter_tree(tracer: &Tracer) -> LightTree {
    let scene = tracer.scene();
    let leaf = |primitive: u32| {
        let material = &scene.materials[scene.triangles[primitive as usize].material as usize];
        if material.emission.iter().all(|&c| c <= 0.0) {
            return None;
        }
        let corners @ [a, b, c] = tracer.triangle(primitive);
        let power = area(corners) * luminance(scene.mean_emission(primitive));
        let bounds = [a.min(b).min(c), a.max(b).max(c)];
        (power > 0.0 && power.is_finite()).then_some(Leaf {
            bounds,
            power,
            id: primitive,
        })
    };
    LightTree::new((0..scene.triangles.len() as u32).filter_map(leaf).collect())
}

/// Maps two numbers in [0, 1) to barycentric coordinates that are uniform on a triangle: folds the
/// far half of the square back (no square root needed).
pub(crate) fn point_on_triangle([s, t]: [f32; 2]) -> [f32; 2] {
    if s + t > 1.0 {
        [1.0 - s, 1.0 - t]
    } else {
        [s, t]
    }
}

/// Returns the area of a triangle, square metres.
pub(crate) fn area([a, b, c]: [Vec3; 3]) -> f32 {
    0.5 * (b - a).cross(c - a).length()
}

impl Lighting {
    /// Samples radiosity per albedo from a point on one emissive triangle, with the balance
    /// heuristic if rays in the `shared` directions sample emitters too
    /// ([`Self::emitter_light_from_hit`]).
    pub(in crate::light) fn emitter_light(
        &self,
        tracer: &Tracer,
        point: &LitPoint,
        sample: &LightSample,
        dimension: u32,
        shared: Option<&Directions<'_>>,
    ) -> IncidentLight {
        let none = IncidentLight::default();
        if self.emitters.is_empty() {
            return none;
        }
        let sampled = self.emitters.sample(point, sample.single(dimension + 1));
        let Some((primitive, probability)) = sampled.filter(|(_, probability)| *probability > 0.0)
        else {
            return none;
        };
        let [u, v] = point_on_triangle(sample.pair(dimension + 1));
        let corners @ [a, b, c] = tracer.triangle(primitive);
        let target = a + (b - a) * u + (c - a) * v;
        let origin = point.ray_origin();
        let offset = target - origin;
        let distance2 = offset.length_squared();
        let direction = offset / distance2.sqrt();
        let cos_here = direction.dot(point.shading_normal);
        // `is_nan`: the sampled point coincides with the lit point.
        if cos_here <= 0.0 || cos_here.is_nan() || direction.dot(point.normal) <= 0.0 {
            return none;
        }
        let normal = tracer.geometric_normal(primitive);
        let cos_there = direction.dot(normal).abs();
        if cos_there <= 0.0 || !tracer.is_visible(direction, primitive, u, v) {
            return none;
        }
        // Ends the shadow ray above the light's surface, by an offset like that of the ray's
        // origin.
        let normal = if direction.dot(normal) > 0.0 {
            -normal
        } else {
            normal
        };
        let extent = tracer.extent(primitive).max(origin.abs().max_element());
        let end = LitPoint {
            position: target,
            normal,
            shading_normal: normal,
            extent,
        }
        .ray_origin();
        let ray = Ray {
            origin,
            direction: end - origin,
            t_min: 0.0,
            t_max: 1.0,
        };
        if tracer.occluded(&ray) {
            return none;
        }
        let density = probability * distance2 / (area(corners) * cos_there);
        let hit = Some((primitive, distance2.sqrt()));
        let ray_density = shared.map_or(0.0, |directions| {
            directions.density(tracer, direction, cos_here, hit)
        });
        let emission = tracer.scene().emission(primitive, u, v);
        IncidentLight {
            light: Vec3::from_array(emission) * (cos_here / PI / (density + ray_density)),
            direction,
        }
    }

    /// Returns radiosity per albedo along a ray that was sampled from `directions` and hit an
    /// emissive triangle; weighted by the balance heuristic.
    pub(crate) fn emitter_light_from_hit(
        &self,
        tracer: &Tracer,
        point: &LitPoint,
        ray: &Ray,
        hit: &Hit,
        surface: &Surface,
        directions: &Directions<'_>,
    ) -> Vec3 {
        if surface.emission == [0.0; 3] {
            return Vec3::ZERO;
        }
        let cos_here = ray.direction.dot(point.shading_normal);
        let ray_density = directions
            .density(
                tracer,
                ray.direction,
                cos_here,
                Some((hit.primitive, hit.t)),
            )
            .max(f32::MIN_POSITIVE);
        let cos_there = ray
            .direction
            .dot(surface.normal)
            .abs()
            .max(f32::MIN_POSITIVE);
        let probability = self.emitters.probability(point, hit.primitive);
        let density =
            probability * hit.t * hit.t / (area(tracer.triangle(hit.primitive)) * cos_there);
        Vec3::from_array(surface.emission) * (ray_density / (density + ray_density))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::path::Path;
    use crate::light::tests::{add_quad, lit_point};
    use glam::{DVec3, Vec2, dvec3};
    use headbox_scene::material::{Cutout, Material, Texture};
    use headbox_scene::scene::{Scene, Triangle};
    use std::sync::Arc;

    /// Returns a square lamp of 1 m^2 in the plane y = 0, split into `pieces` quads per side; its
    /// texture coordinates are x and z.
    fn lamp_scene(radiance: f32, pieces: u32) -> Scene {
        let materials = vec![Material {
            emission: [radiance; 3],
            albedo: [0.0; 3],
            ..Material::default()
        }];
        let mut scene = Scene {
            materials,
            ..Scene::default()
        };
        for i in 0..pieces * pieces {
            let corner = |dx: u32, dz: u32| {
                let [x, z] = [i % pieces + dx, i / pieces + dz]
                    .map(|c| f64::from(c) / f64::from(pieces) - 0.5);
                dvec3(x, 0.0, z)
            };
            add_quad(
                &mut scene,
                [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)],
                0,
            );
        }
        scene.texcoords = scene
            .positions
            .iter()
            .map(|p| Vec2::new(p.x as f32 + 0.5, p.z as f32 + 0.5))
            .collect();
        scene
    }

    const SAMPLES: u32 = 1 << 14;

    /// Returns the mean of light samples.
    fn mean(light: impl Fn(&LightSample) -> Vec3) -> f64 {
        let light = |index| f64::from(light(&LightSample { stream: 5, index }).x);
        (0..SAMPLES).map(light).sum::<f64>() / f64::from(SAMPLES)
    }

    /// Returns the mean light at height `y` above or below the lamp's centre, on a surface that
    /// faces it.
    fn light_at(scene: Scene, y: f64, bounces: u32) -> f64 {
        let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
        let lighting = Lighting::unmetered(&tracer, bounces);
        let point = lit_point(Vec3::Y * y as f32, Vec3::Y * -y.signum() as f32, 1.0);
        mean(|sample| lighting.soft_radiosity(&tracer, &point, sample))
    }

    /// Returns the form factor of a parallel square of 1 m^2 centred h metres above a point: four
    /// corners of 1/2 m.
    fn form_factor(h: f64) -> f64 {
        let corner = 0.5 / (0.25 + h * h).sqrt();
        4.0 / std::f64::consts::PI * corner * corner.atan()
    }

    #[test]
    fn near_lamp_matches_form_factor_within_bound() {
        for (h, pieces, bounces) in [
            (0.01, 1, 1),
            (0.01, 4, 0),
            (0.1, 3, 1),
            (1.0, 2, 1),
            (5.0, 3, 0),
        ] {
            let tracer = Tracer::new(Arc::new(lamp_scene(3.0, pieces)), DVec3::ZERO);
            let lighting = Lighting::unmetered(&tracer, bounces);
            let point = lit_point(Vec3::new(0.0, -h as f32, 0.0), Vec3::Y, 1.0);
            let mean = mean(|sample| {
                let light = lighting.soft_radiosity(&tracer, &point, sample);
                assert!(
                    light.x <= 3.0 * 1.001 * 2.0,
                    "{h}: {light}, by one point and one ray"
                );
                light
            });
            let expected = 3.0 * form_factor(h);
            // Samples vary by at most the lamp's radiance; stratified ones have a smaller error
            // than random ones.
            let tolerance = 3.0 * expected / f64::from(SAMPLES).sqrt();
            assert!(
                (mean - expected).abs() < tolerance,
                "{h} m, {pieces} pieces: {mean}, not {expected}"
            );
        }
    }

    #[test]
    fn last_vertex_near_lamp_is_within_bound() {
        let tracer = Tracer::new(Arc::new(lamp_scene(3.0, 1)), DVec3::ZERO);
        let lighting = Lighting::unmetered(&tracer, 1);
        let point = lit_point(Vec3::new(0.0, -1e-3, 0.0), Vec3::Y, 1.0);
        let mean = mean(|sample| {
            let mut path = Path::new(&point);
            lighting.light_vertex(&tracer, &mut path, lighting.vertex(1), sample);
            // By one point and one ray.
            assert!(path.sum.x <= 3.0 * 1.001 * 2.0, "{}", path.sum);
            path.sum
        });
        let expected = 3.0 * form_factor(1e-3);
        assert!(
            (mean - expected).abs() < 0.03 * expected,
            "{mean}, not {expected}"
        );
    }

    #[test]
    fn cutouts_of_lamp_emit_nothing() {
        let mut scene = lamp_scene(3.0, 1);
        // Opaque up to its centre, halfway between the two texel centres.
        scene.textures = vec![Texture::from_fn(2, 1, |x, _| {
            [255, 255, 255, if x == 0 { 255 } else { 0 }]
        })];
        scene.materials[0].cutout = Some(Cutout {
            texture: Some(0),
            threshold: 0.5,
        });
        for bounces in [0, 1] {
            let found = light_at(scene.clone(), -1.0, bounces);
            let expected = 1.5 * form_factor(1.0);
            assert!(
                (found - expected).abs() < 0.03 * expected,
                "{found}, not {expected}"
            );
        }
    }

    #[test]
    fn coincident_lamps_count_once() {
        let turned = |material: u32| {
            let mut scene = lamp_scene(3.0, 2);
            scene.materials.push(Material {
                albedo: [0.0; 3],
                ..Material::default()
            });
            let twin = |it: &Triangle| Triangle {
                vertices: [it.vertices[0], it.vertices[2], it.vertices[1]],
                material,
            };
            let twins: Vec<Triangle> = scene.triangles.iter().map(twin).collect();
            scene.triangles.extend(twins);
            scene
        };
        let expected = 3.0 * form_factor(1.0);
        for y in [-1.0, 1.0] {
            let found = light_at(turned(0), y, 1);
            assert!(
                (found - expected).abs() < 0.03 * expected,
                "{y}: {found}, not {expected}"
            );
        }
        // A lamp with an unlit back side.
        let [below, above] = [-1.0, 1.0].map(|y| light_at(turned(1), y, 1));
        assert_eq!(below.min(above), 0.0);
        assert!(
            (below.max(above) - expected).abs() < 0.03 * expected,
            "{below}, {above}, not {expected}"
        );
    }

    #[test]
    fn sheet_in_front_of_lamp_occludes_it() {
        let with_sheet = |y: f64| {
            let mut scene = lamp_scene(3.0, 1);
            scene.materials.push(Material {
                albedo: [0.0; 3],
                ..Material::default()
            });
            scene.texcoords.clear();
            let corner = |x: f64, z: f64| dvec3(x, y, z);
            add_quad(
                &mut scene,
                [
                    corner(-1.0, -1.0),
                    corner(1.0, -1.0),
                    corner(1.0, 1.0),
                    corner(-1.0, 1.0),
                ],
                1,
            );
            light_at(scene, -5.0, 1)
        };
        assert_eq!(with_sheet(-1e-3), 0.0);
        let expected = 3.0 * form_factor(5.0);
        let found = with_sheet(1e-3);
        assert!(
            (found - expected).abs() < 0.03 * expected,
            "behind it: {found}, not {expected}"
        );
    }

    #[test]
    fn textured_lamp_emits_from_bright_rim() {
        let mut scene = lamp_scene(3.0, 1);
        scene.textures = vec![Texture::from_fn(6, 1, |x, _| {
            [if (1..5).contains(&x) { 0 } else { 255 }; 4]
        })];
        scene.materials[0].emission_texture = Some(0);
        const STEPS: u32 = 200;
        let step = |i: u32| (f64::from(i) + 0.5) / f64::from(STEPS) - 0.5;
        // Light from each small square to a point a metre below: both cosines over the squared
        // distance.
        let contribution = |(i, j): (u32, u32)| {
            let x = step(i);
            let z = step(j);
            let texel = scene.textures[0].sample(x as f32 + 0.5, 0.5)[0];
            3.0 * f64::from(texel) / (std::f64::consts::PI * (1.0 + x * x + z * z).powi(2))
        };
        let all = (0..STEPS)
            .flat_map(|i| (0..STEPS).map(move |j| (i, j)))
            .map(contribution)
            .sum::<f64>();
        let expected = all / f64::from(STEPS * STEPS);
        // By points alone, like at the last vertex of a path.
        let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
        let lighting = Lighting::unmetered(&tracer, 1);
        let point = lit_point(-Vec3::Y, Vec3::Y, 1.0);
        let found = mean(|sample| {
            lighting
                .emitter_light(&tracer, &point, sample, 0, None)
                .light
        });
        assert!(
            (found - expected).abs() < 0.05 * expected,
            "{found}, not {expected}"
        );
    }
}
