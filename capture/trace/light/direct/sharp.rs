//! Light with sharp shadows: the sun and punctual lamps.

use crate::bvh::{PACKET, Ray, RayPacket, Tracer};
use crate::light::{LightSample, Lighting, LitPoint};
use crate::sampler::disk_from_square;
use glam::{Quat, Vec3};
use headbox_core::color::luminance;
use headbox_scene::scene::{Lamp, Reach, Sun};
use std::f32::consts::PI;

/// Punctual lamp in the tracer's local frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LocalLamp {
    intensity: Vec3,
    /// Unit vector toward a lamp at infinity; position of any other lamp, metres.
    position: Vec3,
    reach: Reach,
}

/// Converts a scene's lamps to the tracer's local frame.
pub(crate) fn local_lamps(tracer: &Tracer) -> Vec<LocalLamp> {
    let local = |lamp: &Lamp| {
        let position = match lamp.reach {
            Reach::Distant { direction } => direction,
            Reach::Point { position, .. } | Reach::Spot { position, .. } => {
                (position - tracer.origin()).as_vec3()
            }
        };
        LocalLamp {
            intensity: lamp.intensity.into(),
            position,
            reach: lamp.reach,
        }
    };
    tracer.scene().lamps.iter().map(local).collect()
}

impl LocalLamp {
    /// Returns the shadow ray from a point to the lamp and the lamp's unoccluded contribution;
    /// `None` if that is zero.
    fn ray(&self, point: &LitPoint) -> Option<(Ray, Vec3)> {
        let origin = point.ray_origin();
        let (to_lamp, range_m) = match self.reach {
            Reach::Distant { .. } => (self.position, f32::INFINITY),
            Reach::Point { range_m, .. } | Reach::Spot { range_m, .. } => {
                (self.position - origin, range_m)
            }
        };
        let distance = to_lamp.length();
        let direction = to_lamp / distance;
        let cos = direction.dot(point.shading_normal);
        // `is_nan`: the lamp coincides with the point.
        if cos <= 0.0 || cos.is_nan() || direction.dot(point.normal) <= 0.0 {
            return None;
        }
        let (t_max, falloff) = match self.reach {
            Reach::Distant { .. } => (f32::INFINITY, 1.0),
            Reach::Point { .. } => (1.0, attenuation(distance, range_m)),
            Reach::Spot {
                axis,
                cosines: [inner, outer],
                ..
            } => {
                // KHR_lights_punctual: a squared ramp of the cosine.
                let ramp = (-direction.dot(axis) - outer) / (inner - outer).max(1e-3);
                (
                    1.0,
                    ramp.clamp(0.0, 1.0).powi(2) * attenuation(distance, range_m),
                )
            }
        };
        let light = self.intensity * (cos * falloff / PI);
        (light != Vec3::ZERO).then_some((
            Ray {
                origin,
                direction: to_lamp,
                t_min: 0.0,
                t_max,
            },
            light,
        ))
    }
}

/// Returns the distance attenuation of KHR_lights_punctual: the inverse square, windowed to 0 at
/// the range.
fn attenuation(distance: f32, range_m: f32) -> f32 {
    (1.0 - (distance / range_m).powi(4)).clamp(0.0, 1.0) / (distance * distance)
}

/// Returns a shadow ray from a point toward a sample of the sun's disk and its unoccluded
/// contribution; `None` if the sun is below the horizon.
fn sun_ray(sun: &Sun, point: &LitPoint, [u, v]: [f32; 2]) -> Option<(Ray, Vec3)> {
    let [x, y] = disk_from_square(u, v);
    let spread = sun.angular_radius_rad;
    let to_sun =
        Quat::from_rotation_arc(Vec3::Z, sun.direction) * Vec3::new(x * spread, y * spread, 1.0);
    let cos = to_sun.dot(point.shading_normal);
    if cos <= 0.0 || to_sun.dot(point.normal) <= 0.0 {
        return None;
    }
    let ray = Ray::new(point.ray_origin(), to_sun);
    Some((ray, Vec3::from_array(sun.irradiance) * (cos / PI)))
}

impl Lighting {
    /// Returns true if there is any light with sharp shadows.
    pub fn has_sharp_light(&self) -> bool {
        self.sun.is_some() || !self.lamps.is_empty()
    }

    /// Returns one sample of the part of [`Self::radiosity_per_albedo`] that comes directly from
    /// the sun and from punctual lamps, whose shadows are sharp.
    pub fn sharp_radiosity(&self, tracer: &Tracer, point: &LitPoint, sample: &LightSample) -> Vec3 {
        let contribution = |(ray, light): (Ray, Vec3)| {
            if tracer.occluded(&ray) {
                Vec3::ZERO
            } else {
                light
            }
        };
        self.sharp_rays(point, sample).map(contribution).sum()
    }

    /// Returns the shadow rays toward the sun and punctual lamps, with the unoccluded contribution
    /// of each.
    pub(crate) fn sharp_rays<'a>(
        &'a self,
        point: &'a LitPoint,
        sample: &LightSample,
    ) -> impl Iterator<Item = (Ray, Vec3)> + use<'a> {
        let sun = self
            .sun
            .as_ref()
            .and_then(|sun| sun_ray(sun, point, sample.pair(0)));
        sun.into_iter()
            .chain(self.lamps.iter().filter_map(|lamp| lamp.ray(point)))
    }

    /// Returns [`Self::sharp_radiosity`] of each request, bit-identical, but traced in packets:
    /// neighbouring rays toward one light are nearly parallel.
    pub fn sharp_radiosities(
        &self,
        tracer: &Tracer,
        requests: &[(LitPoint, LightSample)],
    ) -> Vec<Vec3> {
        let mut light = vec![Vec3::ZERO; requests.len()];
        if let Some(sun) = &self.sun {
            let ray =
                |(point, sample): &(LitPoint, LightSample)| sun_ray(sun, point, sample.pair(0));
            add_in_packets(tracer, requests.iter().map(ray), &mut light);
        }
        for lamp in &self.lamps {
            add_in_packets(
                tracer,
                requests.iter().map(|(point, _)| lamp.ray(point)),
                &mut light,
            );
        }
        light
    }

    /// Samples radiosity per albedo directly from the sun.
    pub(crate) fn sun_light(
        &self,
        tracer: &Tracer,
        point: &LitPoint,
        sample: &LightSample,
        dimension: u32,
    ) -> Vec3 {
        let ray = self
            .sun
            .as_ref()
            .and_then(|sun| sun_ray(sun, point, sample.pair(dimension)));
        ray.filter(|(ray, _)| !tracer.occluded(ray))
            .map_or(Vec3::ZERO, |(_, light)| light)
    }

    /// Samples radiosity per albedo directly from one punctual lamp, chosen in proportion to its
    /// unoccluded contribution.
    pub(crate) fn lamp_light(
        &self,
        tracer: &Tracer,
        point: &LitPoint,
        sample: &LightSample,
        dimension: u32,
    ) -> Vec3 {
        if self.lamps.is_empty() {
            return Vec3::ZERO;
        }
        let rays = || self.lamps.iter().filter_map(|lamp| lamp.ray(point));
        let level = |(_, light): &(Ray, Vec3)| luminance(light.to_array());
        let all: f32 = rays().map(|ray| level(&ray)).sum();
        let mut left = sample.single(dimension) * all;
        let chosen = rays().find(|ray| {
            left -= level(ray);
            left < 0.0
        });
        chosen
            .filter(|(ray, _)| !tracer.occluded(ray))
            .map_or(Vec3::ZERO, |(_, light)| {
                light * (all / luminance(light.to_array()))
            })
    }
}

/// Adds the contributions of the shadow rays that are not occluded.
fn add_in_packets(
    tracer: &Tracer,
    rays: impl Iterator<Item = Option<(Ray, Vec3)>>,
    light: &mut [Vec3],
) {
    let rays: Vec<(usize, Ray, Vec3)> = rays
        .enumerate()
        .filter_map(|(i, ray)| ray.map(|(ray, unoccluded)| (i, ray, unoccluded)))
        .collect();
    for rays in rays.chunks(PACKET) {
        let mut packet = RayPacket::EMPTY;
        rays.iter()
            .enumerate()
            .for_each(|(lane, (_, ray, _))| packet.set(lane, ray));
        let blocked = tracer.occluded_packet(&packet);
        for (lane, &(i, _, unoccluded)) in rays.iter().enumerate() {
            if blocked >> lane & 1 == 0 {
                light[i] += unoccluded;
            }
        }
    }
}
