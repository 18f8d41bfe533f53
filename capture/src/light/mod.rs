//! Diffuse, view-independent light: sun, sky, emissive triangles and bounces, by path tracing.
//!
//! One estimator serves capture and truth alike. At a surface point it returns one sample of *radiosity per albedo*
//! (irradiance / pi): the radiance that leaves the surface is that times its albedo, plus its emission. Next-event
//! estimation for the sun and for emissive triangles; the sky (and the next bounce) by one cosine-weighted ray; Russian
//! roulette beyond three bounces.

mod arrival;
mod emitters;
mod pilot;
mod sequence;

pub use arrival::Arrival;

use crate::sampler::{cosine_direction, disk_from_square, random4, unit_float};
use crate::scene::{Sky, Sun};
use crate::trace::{Hit, PACKET, Ray, RayPacket, Tracer};
use emitters::Emitter;
use glam::{Quat, Vec3};
use pilot::{Pilot, PilotPoint, percentile};

/// Paths beyond this many bounces are ended at random (Russian roulette).
const ROULETTE_BOUNCES: u32 = 3;

/// Light that reaches every open place from nowhere in particular: what a cosine-weighted ray sees that meets nothing
/// within `reach_m`, fading in from nothing at zero distance. Stands in for the lamps that a model of a closed room
/// lacks; zero unless [`Lighting::measure`] finds a scene mostly black without it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FillLight {
    /// Radiance, grey.
    pub radiance: f32,
    /// Distance from which the fill counts in full, metres.
    pub reach_m: f32,
}

/// Everything that lights a scene, and the exposure under which it is stored. A pure function of the scene (not of the
/// headbox), so that a capture and a truth frame agree.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    /// The sun.
    pub sun: Option<Sun>,
    /// The sky.
    pub sky: Option<Sky>,
    /// Emissive triangles with the running sum of their power, in ascending order, the last being 1.
    emitters: Vec<Emitter>,
    /// Fill light.
    pub fill: FillLight,
    /// Diffuse bounces of a path beyond direct light.
    pub bounces: u32,
    /// Stored value = linear radiance times this.
    pub exposure: f32,
}

/// A point to be lit, in the tracer's local frame.
#[derive(Clone, Copy, Debug)]
pub struct LitPoint {
    /// Position, metres.
    pub position: Vec3,
    /// Unit geometric normal on the lit side.
    pub normal: Vec3,
    /// Unit shading normal, in the hemisphere of `normal`.
    pub shading_normal: Vec3,
    /// Largest absolute coordinate of the triangle that the point lies on, metres: its rounding error scales with it.
    pub extent: f32,
}

impl LitPoint {
    /// The point where `ray` met the scene, on the side that the ray came from.
    pub fn from_hit(tracer: &Tracer, ray: &Ray, hit: &Hit) -> (Self, crate::scene::Surface) {
        let surface = tracer.scene().surface(hit.primitive, hit.u, hit.v);
        let flip = if surface.normal.dot(ray.direction) > 0.0 { -1.0 } else { 1.0 };
        let position = ray.origin + ray.direction * hit.t;
        let extent = extent_of(tracer.triangle(hit.primitive));
        let (normal, shading_normal) = (surface.normal * flip, surface.shading_normal * flip);
        (Self { position, normal, shading_normal, extent }, surface)
    }

    /// Where rays from this point start: lifted off its surface by more than the rounding error of the position.
    fn lifted(&self) -> Vec3 {
        /// Rounding of a hit position is a few units in the last place (2^-24) of the triangle's largest coordinate and
        /// of the point's own; 2^-18 is a factor of 64 above that.
        const LIFT: f32 = 1.0 / 262_144.0;
        self.position + self.normal * (LIFT * self.position.abs().max_element().max(self.extent))
    }
}

/// Names one light sample: its numbers depend on nothing else.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Stream: samples of one stream are spread evenly together.
    pub stream: u32,
    /// Number of the sample in its stream: 2^k samples that follow each other from a multiple of 2^k on are spread evenly.
    pub index: u32,
}

/// What one bounce of one sample may add, in exposed units (1 is white). Where a path ends close to a small lamp, the
/// inverse square makes rare samples thousands of times too bright, which no affordable number of samples averages out.
/// Capture and truth are cut alike.
const BRIGHTEST_BOUNCE: f32 = 4.0;

/// A light sample under way.
struct Path {
    /// The vertex at which it is.
    point: LitPoint,
    throughput: Vec3,
    /// What it found so far.
    sum: Vec3,
}

/// Decisions at each point of a path: sun, emitter, direction, survival.
const DECISIONS: u32 = 4;

/// Dimension of a single number beside the pair of the same decision, and of the position in the pixel.
const SINGLE: u32 = 1 << 30;
const JITTER: u32 = 1 << 31;

/// 2^32 / g, / g^2, / g^3, / g^4 with g^5 = g + 1: steps of the R4 sequence; integer overflow is the wrap to [0, 1).
const R4_STEPS: [u32; 4] = [0xdb4f_0b91, 0xbbe0_5633, 0xa0f2_ec77, 0x89e1_8285];

/// Position in the pixel, [0, 1) each way, of camera ray `index` through pixel (x, y): dimensions 1 and 2 of the
/// sequence whose dimensions 3 and 4 sample light.
pub fn pixel_jitter(x: u32, y: u32, index: u32) -> [f32; 2] {
    let random = random4([x, y, 0x7247, 0]);
    [0, 1].map(|i| unit_float(random[i].wrapping_add(R4_STEPS[i].wrapping_mul(index))))
}

impl LightSample {
    /// Two numbers in [0, 1) for decision `dimension` of the path, evenly spread over the samples of the stream
    /// ([`sequence`]) and independent of all other decisions.
    fn pair(&self, dimension: u32) -> [f32; 2] {
        let [order, first, second, _] = random4([self.stream, dimension, 0x9e37_79b9, 0x7f4a_7c15]);
        sequence::point(self.index, [order, first, second]).map(unit_float)
    }

    /// One number in [0, 1), as [`Self::pair`] gives two, and independent of those.
    fn single(&self, dimension: u32) -> f32 {
        self.pair(dimension + SINGLE)[0]
    }

    /// A position in the sample's pixel, [0, 1) each way, independent of all decisions of the path.
    pub fn jitter(&self) -> [f32; 2] {
        self.pair(JITTER)
    }
}

impl Lighting {
    /// The lights of `scene` with `bounces` diffuse bounces, no fill and an exposure of 1.
    pub fn of_scene(tracer: &Tracer, bounces: u32) -> Self {
        let scene = tracer.scene();
        let emitters = emitters::collect(tracer);
        Self { sun: scene.sun, sky: scene.sky, emitters, fill: FillLight::default(), bounces, exposure: 1.0 }
    }

    /// The lights of `scene`, with exposure and fill chosen by a pilot: what is seen, sky included, from seeded points in
    /// the headbox that the scene suggests (or [`viewpoint::suggest_headbox`] finds). The logarithmic mean of luminance is
    /// exposed to a middle grey, as a photographer's meter does (Reinhard et al. 2002, "Photographic tone reproduction",
    /// without the compression). If more than a third of the surfaces seen get under 1 % of the brightest tenth, a fill
    /// light of a tenth of it (or 1 in total darkness) is added.
    pub fn measure(tracer: &Tracer, bounces: u32) -> Self {
        /// 125 of 255 in sRGB.
        const MIDDLE_GREY: f32 = 0.21;
        let mut lighting = Self::of_scene(tracer, bounces);
        let pilot = Pilot::new(tracer);
        let sky: Vec<f32> =
            pilot.misses.iter().map(|&direction| luminance(lighting.miss_radiance(direction))).collect();
        let mut seen = [lighting.pilot_luminance(tracer, &pilot.surfaces), sky.clone()].concat();
        let bright = percentile(&mut seen.clone(), 0.9);
        let dark = seen[..pilot.surfaces.len()].iter().filter(|&&level| level <= bright * 0.01).count();
        if dark * 3 > pilot.surfaces.len() {
            let mut distances: Vec<f32> = pilot.surfaces.iter().map(|p| p.distance_m).collect();
            let reach_m = 0.5 * percentile(&mut distances, 0.5);
            lighting.fill = FillLight { radiance: if bright > 0.0 { bright * 0.1 } else { 1.0 }, reach_m };
            seen = [lighting.pilot_luminance(tracer, &pilot.surfaces), sky].concat();
        }
        let mean = pilot.logarithmic_mean(&seen);
        lighting.exposure = if mean > 0.0 && mean.is_finite() { MIDDLE_GREY / mean } else { 1.0 };
        lighting
    }

    fn pilot_luminance(&self, tracer: &Tracer, pilot: &[PilotPoint]) -> Vec<f32> {
        use rayon::prelude::*;
        const SAMPLES: u32 = 8;
        let light = |(i, p): (usize, &PilotPoint)| {
            let mut sum = 0.0;
            for index in 0..SAMPLES {
                let sample = LightSample { stream: i as u32, index };
                let radiosity = self.radiosity_per_albedo(tracer, &p.point, &sample);
                sum += luminance([0, 1, 2].map(|c| radiosity[c] * p.albedo[c] + p.emission[c]));
            }
            sum / SAMPLES as f32
        };
        pilot.par_iter().enumerate().map(light).collect()
    }

    /// What a ray sees that leaves the scene in the unit direction `direction`: linear radiance. The sun's disk is
    /// not drawn: it would be a single saturated texel.
    pub fn miss_radiance(&self, direction: Vec3) -> [f32; 3] {
        self.sky.map_or([0.0; 3], |sky| sky.radiance(direction))
    }

    /// One sample of irradiance / pi at `point`.
    pub fn radiosity_per_albedo(&self, tracer: &Tracer, point: &LitPoint, sample: &LightSample) -> [f32; 3] {
        (self.sun_radiosity(tracer, point, sample) + self.soft_radiosity(tracer, point, sample)).to_array()
    }

    /// The part of [`Self::radiosity_per_albedo`] that comes straight from the sun: its shadows have edges.
    pub fn sun_radiosity(&self, tracer: &Tracer, point: &LitPoint, sample: &LightSample) -> Vec3 {
        self.sun.map_or(Vec3::ZERO, |sun| sun_light(&sun, tracer, point, sample.pair(0)))
    }

    /// As [`Self::sun_radiosity`] of each request, to the bit: rays of neighbours are nearly parallel and travel in packets.
    pub fn sun_radiosities(&self, tracer: &Tracer, requests: &[(LitPoint, LightSample)]) -> Vec<Vec3> {
        let mut light = vec![Vec3::ZERO; requests.len()];
        let Some(sun) = &self.sun else { return light };
        let ray = |(i, (point, sample)): (usize, &(LitPoint, LightSample))| {
            sun_ray(sun, point, sample.pair(0)).map(|(ray, brings)| (i, ray, brings))
        };
        let rays: Vec<(usize, Ray, Vec3)> = requests.iter().enumerate().filter_map(ray).collect();
        for rays in rays.chunks(PACKET) {
            let mut packet = RayPacket::EMPTY;
            rays.iter().enumerate().for_each(|(lane, (_, ray, _))| packet.set(lane, ray));
            let blocked = tracer.occluded_packet(&packet);
            for (lane, &(i, _, brings)) in rays.iter().enumerate() {
                light[i] = if blocked >> lane & 1 == 0 { brings } else { Vec3::ZERO };
            }
        }
        light
    }

    /// The rest of [`Self::radiosity_per_albedo`]: sky, emissive triangles, bounces.
    pub fn soft_radiosity(&self, tracer: &Tracer, point: &LitPoint, sample: &LightSample) -> Vec3 {
        let mut path = Path { point: *point, throughput: Vec3::ONE, sum: Vec3::ZERO };
        self.follow(tracer, &mut path, 0, sample);
        path.sum
    }

    /// Follows a path from its vertex number `bounce` on.
    fn follow(&self, tracer: &Tracer, path: &mut Path, bounce: u32, sample: &LightSample) {
        for bounce in bounce..=self.bounces {
            if self.vertex(tracer, path, bounce, sample).is_none() {
                return;
            }
        }
    }

    /// Adds what a path finds at its vertex number `bounce`, and moves it on to the next. How long the way there was; `None`
    /// if the path ends.
    fn vertex(&self, tracer: &Tracer, path: &mut Path, bounce: u32, sample: &LightSample) -> Option<f32> {
        let dimension = bounce * DECISIONS;
        let point = &path.point;
        let mut direct = Vec3::ZERO;
        if bounce > 0
            && let Some(sun) = &self.sun
        {
            direct += sun_light(sun, tracer, point, sample.pair(dimension));
        }
        if !self.emitters.is_empty() {
            direct += self.emitter_light(tracer, point, sample, dimension);
        }
        let brightest = if bounce > 0 { BRIGHTEST_BOUNCE / self.exposure } else { f32::INFINITY };
        path.sum += (path.throughput * direct).min(Vec3::splat(brightest));
        let [u, v] = sample.pair(dimension + 2);
        let local = Vec3::from_array(cosine_direction(u, v));
        let direction = Quat::from_rotation_arc(Vec3::Z, point.shading_normal) * local;
        if direction.dot(point.normal) <= 0.0 {
            return None; // below the true surface: a shading normal that leans too far
        }
        let ray = Ray { origin: point.lifted(), direction, t_min: 0.0, t_max: f32::INFINITY };
        let last = bounce == self.bounces;
        let hit = if last && self.fill.radiance == 0.0 {
            // Of what the last ray meets, nothing matters but whether it is there.
            if self.sky.is_none() || tracer.occluded(&ray) {
                return None;
            }
            None
        } else {
            tracer.closest(&ray)
        };
        let Some(hit) = hit else {
            path.sum += path.throughput * (Vec3::from_array(self.miss_radiance(direction)) + self.fill.radiance);
            return None;
        };
        if self.fill.radiance > 0.0 {
            let open = (hit.t / self.fill.reach_m).min(1.0);
            path.sum += path.throughput * (self.fill.radiance * open * open);
        }
        if last {
            return None;
        }
        let (next, surface) = LitPoint::from_hit(tracer, &ray, &hit);
        path.point = next;
        path.throughput *= Vec3::from_array(surface.albedo);
        if bounce >= ROULETTE_BOUNCES {
            let survive = path.throughput.max_element().min(0.95);
            if sample.single(dimension + 3) >= survive {
                return None;
            }
            path.throughput /= survive;
        }
        Some(hit.t)
    }

    fn emitter_light(&self, tracer: &Tracer, point: &LitPoint, sample: &LightSample, dimension: u32) -> Vec3 {
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

fn sun_light(sun: &Sun, tracer: &Tracer, point: &LitPoint, square: [f32; 2]) -> Vec3 {
    sun_ray(sun, point, square).filter(|(ray, _)| !tracer.occluded(ray)).map_or(Vec3::ZERO, |(_, light)| light)
}

/// The ray from a point toward the sun, and what it brings if nothing is in its way.
fn sun_ray(sun: &Sun, point: &LitPoint, [u, v]: [f32; 2]) -> Option<(Ray, Vec3)> {
    let [x, y] = disk_from_square(u, v);
    let spread = sun.angular_radius_rad;
    let to_sun = Quat::from_rotation_arc(Vec3::Z, sun.direction) * Vec3::new(x * spread, y * spread, 1.0);
    let cos = to_sun.dot(point.shading_normal);
    if cos <= 0.0 || to_sun.dot(point.normal) <= 0.0 {
        return None;
    }
    let ray = Ray { origin: point.lifted(), direction: to_sun, t_min: 0.0, t_max: f32::INFINITY };
    Some((ray, Vec3::from_array(sun.irradiance) * (cos / std::f32::consts::PI)))
}

/// Rec. 709 luminance of linear RGB.
#[inline]
pub fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Largest absolute coordinate of a triangle.
pub fn extent_of(triangle: [Vec3; 3]) -> f32 {
    triangle.iter().map(|corner| corner.abs().max_element()).fold(0.0, f32::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Material;
    use crate::scene::Scene;
    use crate::scene::Triangle;
    use glam::{DVec3, dvec3};
    use std::sync::Arc;

    /// Random triangles, some of them lamps, under sun and sky.
    fn tracer() -> Tracer {
        let material = |emission: f32| Material { emission: [emission; 3], ..Material::default() };
        let mut scene = Scene {
            materials: vec![material(0.0), material(5.0)],
            sun: Some(Sun::default()),
            sky: Some(Sky::default()),
            ..Scene::default()
        };
        for i in 0..300 {
            let random = |k: u32| random4([i, k, 7, 7]).map(|r| f64::from(unit_float(r)) - 0.5);
            let ([x, y, z, _], [a, b, c, d]) = (random(0), random(1));
            let (corner, first) = (dvec3(x, y, z) * 6.0, scene.positions.len() as u32);
            scene.positions.extend([corner, corner + dvec3(a, b, c), corner + dvec3(d, a, b)]);
            let vertices = [first, first + 1, first + 2];
            scene.triangles.push(Triangle { vertices, material: u32::from(i % 20 == 0) });
        }
        Tracer::new(Arc::new(scene), DVec3::ZERO)
    }

    fn requests(tracer: &Tracer) -> Vec<(LitPoint, LightSample)> {
        let ray = |i: u32| {
            let direction = Vec3::from_array([0, 1, 2].map(|k| unit_float(random4([i, k, 1, 1])[0]) - 0.5));
            Ray { origin: Vec3::ZERO, direction, t_min: 0.0, t_max: f32::INFINITY }
        };
        let hit = |ray: Ray| tracer.closest(&ray).map(|hit| LitPoint::from_hit(tracer, &ray, &hit).0);
        let points = (0..1000).filter_map(|i| hit(ray(i)));
        points.zip(0..).map(|(point, index)| (point, LightSample { stream: 7, index })).collect()
    }

    #[test]
    fn a_sample_is_the_sum_of_its_parts() {
        let tracer = tracer();
        for bounces in [0, 1, 5] {
            let lighting = Lighting::of_scene(&tracer, bounces);
            let mut arrived = 0;
            for (point, sample) in requests(&tracer) {
                let whole = lighting.soft_radiosity(&tracer, &point, &sample);
                let (before, arrival) = lighting.before(&tracer, &point, &sample);
                let beyond = arrival.map_or(Vec3::ZERO, |a| a.albedo * lighting.beyond(&tracer, &a, &sample));
                arrived += u32::from(arrival.is_some());
                assert!((before + beyond - whole).length() <= 1e-5 * whole.length(), "{before} + {beyond}: {whole}");
            }
            assert_eq!(arrived > 0, bounces > 0);
        }
    }

    #[test]
    fn packets_see_the_sun_that_single_rays_see() {
        let tracer = tracer();
        let (lighting, requests) = (Lighting::of_scene(&tracer, 0), requests(&tracer));
        let light = lighting.sun_radiosities(&tracer, &requests);
        let single = |(point, sample): &(LitPoint, LightSample)| lighting.sun_radiosity(&tracer, point, sample);
        assert_eq!(light, requests.iter().map(single).collect::<Vec<_>>());
        assert!(light.contains(&Vec3::ZERO) && light.iter().any(|l| *l != Vec3::ZERO));
    }
}
