//! Direct light from a sky image: multiple importance sampling of the sky's directions and of a
//! path's rays.
//!
//! Both estimators have the same expectation; samples are weighted by the balance heuristic (Veach
//! and Guibas 1995, "Optimally combining sampling techniques for Monte Carlo rendering"), so that
//! neither a small bright spot nor a wide dim area causes noise. A gradient sky is sampled by the
//! path's rays alone.

use crate::bvh::{Ray, Tracer};
use crate::light::guiding::guide::Directions;
use crate::light::path::IncidentLight;
use crate::light::{LightSample, Lighting, LitPoint};
use glam::Vec3;
use headbox_scene::scene::{Sky, SkyPicture};
use std::f32::consts::PI;

impl Lighting {
    fn picture(&self) -> Option<&SkyPicture> {
        match &self.sky {
            Some(Sky::Picture(picture)) => Some(picture),
            Some(Sky::Gradient(_)) | None => None,
        }
    }

    /// Estimates radiosity per albedo by a direction sampled from the sky image.
    pub(in crate::light) fn sky_light(
        &self,
        tracer: &Tracer,
        point: &LitPoint,
        sample: &LightSample,
        dimension: u32,
        directions: &Directions<'_>,
    ) -> IncidentLight {
        let none = IncidentLight::default();
        let Some(picture) = self.picture() else {
            return none;
        };
        let Some((direction, radiance)) = picture.sample(sample.pair(dimension + 3)) else {
            return none;
        };
        let cos = direction.dot(point.shading_normal);
        if cos <= 0.0 || direction.dot(point.normal) <= 0.0 {
            return none;
        }
        let ray = Ray::new(point.ray_origin(), direction);
        if tracer.occluded(&ray) {
            return none;
        }
        let density = directions.density(tracer, direction, cos, None);
        IncidentLight {
            light: Vec3::from_array(radiance) * (cos / PI / (picture.density(radiance) + density)),
            direction,
        }
    }

    /// Estimates radiosity per albedo by a path's ray that missed all surfaces.
    pub(crate) fn sky_light_from_miss(
        &self,
        tracer: &Tracer,
        point: &LitPoint,
        direction: Vec3,
        directions: &Directions<'_>,
    ) -> Vec3 {
        let Some(sky) = &self.sky else {
            return Vec3::ZERO;
        };
        let radiance = sky.radiance(direction);
        let share = self.picture().map_or(1.0, |picture| {
            let cos = direction.dot(point.shading_normal);
            let density = directions
                .density(tracer, direction, cos, None)
                .max(f32::MIN_POSITIVE);
            density / (picture.density(radiance) + density)
        });
        Vec3::from_array(radiance) * share
    }
}
