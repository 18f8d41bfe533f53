//! View-dependent radiance: diffuse light, emission and glossy reflection.
//!
//! Gloss is the normalised Phong lobe f = ks (n + 2) / (2 pi) cos^n about the mirror direction
//! (Lafortune and Willems 1994, Eq. 2). The sun and punctual lamps are sampled by shadow rays, all
//! other light by one ray sampled from the lobe.

use super::{LightSample, Lighting, LitPoint};
use crate::bvh::{Hit, Ray, Tracer};
use crate::sampler::random4;
use glam::{Quat, Vec3};
use headbox_scene::material::Gloss;
use std::f32::consts::TAU;

/// Sampling dimension of the lobe's direction, beyond those of paths.
const LOBE: u32 = 1 << 29;

impl Lighting {
    /// Returns the linear radiance along a camera ray: of its hit, or of the sky. `sample`
    /// identifies the light sample; without one the result is albedo plus emission.
    pub fn seen(
        &self,
        tracer: &Tracer,
        ray: &Ray,
        hit: Option<&Hit>,
        sample: Option<&LightSample>,
    ) -> Vec3 {
        let Some(hit) = hit else {
            return Vec3::from_array(self.miss_radiance(ray.direction.normalize()));
        };
        let Some(sample) = sample else {
            return self.unlit_radiance(tracer, hit);
        };
        let (point, surface) = LitPoint::from_hit(tracer, ray, hit);
        let radiosity = Vec3::from_array(self.radiosity_per_albedo(tracer, &point, sample));
        let diffuse =
            Vec3::from_array(surface.albedo) * radiosity + Vec3::from_array(surface.emission);
        match surface.gloss {
            Some(gloss) => diffuse + self.glossy_radiance(tracer, ray, &point, &gloss, sample),
            None => diffuse,
        }
    }

    /// Returns the linear radiance of a hit without light, or with light baked into vertex colours:
    /// albedo plus emission. The albedo is limited to what the tone curve distinguishes.
    pub fn unlit_radiance(&self, tracer: &Tracer, hit: &Hit) -> Vec3 {
        let [_, limit] = self.tone.range();
        let scene = tracer.scene();
        let albedo = scene.paint(hit.primitive).albedo_up_to(limit, hit.u, hit.v);
        Vec3::from(albedo) + Vec3::from(scene.emission(hit.primitive, hit.u, hit.v))
    }

    /// Returns one sample of the radiance that a glossy surface reflects toward the origin of
    /// `ray`.
    fn glossy_radiance(
        &self,
        tracer: &Tracer,
        ray: &Ray,
        point: &LitPoint,
        gloss: &Gloss,
        sample: &LightSample,
    ) -> Vec3 {
        let mirrored = ray.direction.normalize().reflect(point.shading_normal);
        let exponent = gloss.exponent.max(0.0);
        let lobe = |direction: Vec3| mirrored.dot(direction).max(0.0).powf(exponent);
        // The light of `sharp_rays` is irradiance / pi.
        let sharp = self
            .sharp_rays(point, sample)
            .filter(|(ray, _)| !tracer.occluded(ray));
        let highlights = sharp
            .map(|(ray, light)| light * (lobe(ray.direction.normalize()) * (exponent + 2.0) / 2.0));
        let mut radiance: Vec3 = highlights.sum();
        let [u, v] = sample.pair(LOBE);
        let direction = Quat::from_rotation_arc(Vec3::Z, mirrored) * lobe_direction(u, v, exponent);
        let cos = direction.dot(point.shading_normal);
        if cos > 0.0 && direction.dot(point.normal) > 0.0 {
            // Lobe over the density (n + 1) / (2 pi) cos^n.
            let weight = cos * (exponent + 2.0) / (exponent + 1.0);
            let ray = Ray::new(point.ray_origin(), direction);
            radiance += self.diffuse_along(tracer, &ray, sample) * weight;
        }
        Vec3::from_array(gloss.reflectance) * radiance
    }

    /// Returns one sample of the diffuse radiance along a reflected ray; reflections in reflections
    /// are omitted.
    fn diffuse_along(&self, tracer: &Tracer, ray: &Ray, sample: &LightSample) -> Vec3 {
        let Some(hit) = tracer.closest(ray) else {
            return Vec3::from_array(self.miss_radiance(ray.direction));
        };
        let (point, surface) = LitPoint::from_hit(tracer, ray, &hit);
        let [stream, ..] = random4([sample.stream, LOBE, 0x6105, 5]);
        let sample = LightSample {
            stream,
            index: sample.index,
        };
        let radiosity = Vec3::from_array(self.radiosity_per_albedo(tracer, &point, &sample));
        Vec3::from_array(surface.albedo) * radiosity + Vec3::from_array(surface.emission)
    }
}

/// Samples a direction about +Z with the density (n + 1) / (2 pi) cos^n.
fn lobe_direction(u: f32, v: f32, exponent: f32) -> Vec3 {
    let z = (1.0 - u)
        .max(f32::MIN_POSITIVE)
        .powf(1.0 / (exponent + 1.0));
    let across = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (TAU * v).sin_cos();
    Vec3::new(across * cos, across * sin, z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use headbox_scene::material::Material;
    use headbox_scene::scene::{Scene, Sky, SkyGradient, Sun, Triangle};
    use std::sync::Arc;

    /// Returns a glossy floor under a sky or a sun, a metre below the origin.
    fn floor(gloss: Gloss, sun: Option<Sun>, sky: Option<Sky>) -> (Tracer, Lighting) {
        let positions = [[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]]
            .map(|[x, z]| DVec3::new(x, 0.0, z));
        let triangle = |vertices| Triangle {
            vertices,
            material: 0,
        };
        let materials = vec![Material {
            albedo: [0.0; 3],
            gloss: Some(gloss),
            ..Material::default()
        }];
        let triangles = vec![triangle([0, 2, 1]), triangle([0, 3, 2])];
        let scene = Scene {
            positions: positions.to_vec(),
            triangles,
            materials,
            sun,
            sky,
            ..Scene::default()
        };
        let tracer = Tracer::new(Arc::new(scene), DVec3::Y);
        let lighting = Lighting::unmetered(&tracer, 0);
        (tracer, lighting)
    }

    fn mean((tracer, lighting): &(Tracer, Lighting), direction: Vec3, count: u32) -> Vec3 {
        let ray = Ray::new(-Vec3::Y - direction, direction);
        let hit = tracer.closest(&ray).expect("the floor");
        let one = |index| {
            lighting.seen(
                tracer,
                &ray,
                Some(&hit),
                Some(&LightSample { stream: 7, index }),
            )
        };
        (0..count).map(one).sum::<Vec3>() / count as f32
    }

    /// Integrates the lobe times `light` over the hemisphere, by the midpoint rule in `f64`.
    fn integral(mirrored: Vec3, exponent: f64, light: impl Fn(DVec3) -> f64) -> f64 {
        const STEPS: u32 = 400;
        let step = |i: u32| (f64::from(i) + 0.5) / f64::from(STEPS);
        let mut sum = 0.0;
        for (u, v) in (0..STEPS).flat_map(|i| (0..STEPS).map(move |j| (step(i), step(j)))) {
            let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
            // Uniform over the hemisphere: height is uniform.
            let across = (1.0 - u * u).sqrt();
            let direction = DVec3::new(across * cos, u, across * sin);
            let lobe = mirrored.as_dvec3().dot(direction).max(0.0).powf(exponent)
                * (exponent + 2.0)
                / std::f64::consts::TAU;
            sum += lobe * u * light(direction);
        }
        sum / f64::from(STEPS * STEPS) * std::f64::consts::TAU
    }

    #[test]
    fn lobe_under_uniform_sky_reflects_its_integral() {
        for (exponent, direction) in [
            (1.0, -Vec3::Y),
            (20.0, Vec3::new(0.6, -0.8, 0.0)),
            (200.0, Vec3::new(0.0, -0.5, 0.866)),
        ] {
            let direction = direction.normalize();
            let gloss = Gloss {
                reflectance: [0.5, 0.25, 0.0],
                exponent,
            };
            let sky = Sky::Gradient(SkyGradient::uniform([1.0; 3]));
            let found = mean(&floor(gloss, None, Some(sky)), direction, 4096);
            let mirrored = direction.reflect(Vec3::Y);
            let expected = integral(mirrored, f64::from(exponent), |_| 1.0) as f32;
            // 4096 stratified samples of a smooth integrand.
            assert!(
                (found.x - 0.5 * expected).abs() < 2e-3 && (found.y - 0.25 * expected).abs() < 1e-3,
                "{found} {expected}"
            );
            assert_eq!(found.z, 0.0);
            assert!(
                expected <= 1.001,
                "reflects more than the incident light: {expected}"
            );
        }
    }

    #[test]
    fn sun_highlight_follows_mirror_direction() {
        let toward = Vec3::new(0.3, 0.8, 0.2).normalize();
        let sun = Sun {
            direction: toward,
            irradiance: [2.0; 3],
            angular_radius_rad: 0.0,
        };
        let lit = floor(
            Gloss {
                reflectance: [0.5; 3],
                exponent: 50.0,
            },
            Some(sun),
            None,
        );
        for off in [0.0f32, 0.1, 0.5] {
            let direction = Quat::from_rotation_z(off) * toward.reflect(Vec3::Y);
            let cos = direction.reflect(Vec3::Y).dot(toward).max(0.0);
            let expected = 0.5 * 2.0 * toward.y * cos.powf(50.0) * 52.0 / TAU;
            let found = mean(&lit, direction, 4).x;
            assert!(
                (found - expected).abs() < 1e-3 * (1.0 + expected),
                "{found} {expected}"
            );
        }
    }

    #[test]
    fn lobe_directions_follow_density() {
        for exponent in [0.0, 3.0, 100.0] {
            let count = 256;
            let midpoint = |i: u32| (i as f32 + 0.5) / count as f32;
            let mean = (0..count)
                .map(|i| lobe_direction(midpoint(i), 0.3, exponent).z)
                .sum::<f32>()
                / count as f32;
            // Mean of the cosine under the lobe's density.
            let expected = (exponent + 1.0) / (exponent + 2.0);
            assert!((mean - expected).abs() < 1e-3, "{mean} {expected}");
        }
    }
}
