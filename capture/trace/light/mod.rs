//! Diffuse, view-independent light: sun, sky, emissive triangles and bounces, by path tracing; and
//! what an eye sees of it, mirrored by glossy surfaces (`gloss`).
//!
//! One estimator serves capture and truth alike. At a surface point it returns one sample of
//! *radiosity per albedo* (irradiance / pi): the radiance that leaves the surface is that times its
//! albedo, plus its emission. Next-event estimation for the sun, lamps, emissive triangles and
//! pictures of the sky; these two (and the next bounce) also by one ray, cosine-weighted or guided;
//! Russian roulette beyond three bounces.

mod arrival;
mod emitters;
mod environment;
mod gloss;
mod guide;
mod light_tree;
mod pilot;
mod sequence;
mod sharp;
mod sky;
mod square;
#[cfg(test)]
mod tests;

pub use arrival::Arrival;

use crate::bvh::{Hit, Ray, Tracer};
use crate::sampler::{random4, unit_float};
use emitters::Emitters;
use glam::Vec3;
use guide::{Directions, Guide};
use headbox_core::color::luminance;
use headbox_core::tone::ToneMap;
use headbox_scene::scene::{Sky, Sun};
use pilot::{Pilot, PilotPoint, percentile};
use sharp::LocalLamp;

/// Paths beyond this many bounces are ended at random (Russian roulette).
const ROULETTE_BOUNCES: u32 = 3;

/// Light that reaches every open place from nowhere in particular: what a cosine-weighted ray sees
/// that meets nothing within `reach_m`, fading in from nothing at zero distance. Stands in for the
/// lamps that a model of a closed room lacks; zero unless [`Lighting::measure`] finds a scene
/// mostly black without it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FillLight {
    /// Radiance, grey.
    pub radiance: f32,
    /// Distance from which the fill counts in full, metres.
    pub reach_m: f32,
}

/// Everything that lights a scene, and the exposure under which it is stored: a function of the
/// scene and of where the tracer has its origin (not of how large the headbox is, or of what it
/// shows), so that a capture and a truth frame agree.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    /// The sun.
    pub sun: Option<Sun>,
    /// The sky.
    pub sky: Option<Sky>,
    /// Lamps without a surface, in the tracer's local frame.
    lamps: Vec<LocalLamp>,
    emitters: Emitters,
    guide: Guide,
    /// Fill light.
    pub fill: FillLight,
    /// Diffuse bounces of a path beyond direct light.
    pub bounces: u32,
    /// Linear radiance times this is what `tone` is of.
    pub exposure: f32,
    /// What becomes of exposed radiance before it is stored.
    pub tone: ToneMap,
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
    /// Largest absolute coordinate of the triangle that the point lies on, metres: its rounding
    /// error scales with it.
    pub extent: f32,
}

impl LitPoint {
    /// The point where `ray` met the scene, on the side that the ray came from.
    pub fn from_hit(
        tracer: &Tracer,
        ray: &Ray,
        hit: &Hit,
    ) -> (Self, headbox_scene::scene::Surface) {
        let surface = tracer.surface(hit.primitive, hit.u, hit.v);
        let flip = if surface.normal.dot(ray.direction) > 0.0 {
            -1.0
        } else {
            1.0
        };
        let position = ray.origin + ray.direction * hit.t;
        let extent = tracer.extent(hit.primitive);
        let (normal, shading_normal) = (surface.normal * flip, surface.shading_normal * flip);
        (
            Self {
                position,
                normal,
                shading_normal,
                extent,
            },
            surface,
        )
    }

    /// How the surface is turned, in 9 bits.
    fn turned(&self) -> u64 {
        // Rounded halves: twice a component of a unit vector, without the call into libm that
        // `round` is on processors before SSE4.1.
        let halves = |c: f32| {
            let size = i32::from(c.abs() >= 0.25) + i32::from(c.abs() >= 0.75);
            if c < 0.0 { -size } else { size }
        };
        let [x, y, z] = self
            .normal
            .to_array()
            .map(|c| u64::from(halves(c) as u8 & 7));
        x | y << 3 | z << 6
    }

    /// Where rays from this point start: lifted off its surface by more than the rounding error of
    /// the position.
    fn lifted(&self) -> Vec3 {
        /// Rounding of a hit position is a few units in the last place (2^-24) of the triangle's
        /// largest coordinate and of the point's own; 2^-18 is a factor of 64 above that.
        const LIFT: f32 = 1.0 / 262_144.0;
        self.position + self.normal * (LIFT * self.position.abs().max_element().max(self.extent))
    }
}

/// Names one light sample: its numbers depend on nothing else.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Stream: samples of one stream are spread evenly together.
    pub stream: u32,
    /// Number of the sample in its stream: 2^k samples that follow each other from a multiple of
    /// 2^k on are spread evenly.
    pub index: u32,
}

/// What one bounce of one sample may add, in exposed units (1 is white). Where a path ends close to
/// a small lamp, the inverse square makes rare samples thousands of times too bright, which no
/// affordable number of samples averages out. Capture and truth are cut alike. What rays find of
/// the sky by chance is not cut (of a picture's bright spots it is a small share), nor is fill
/// light.
const BRIGHTEST_BOUNCE: f32 = 4.0;

/// So many looks at most until the exposure is one under which no light was cut.
const MOST_METERINGS: u32 = 8;

/// A light sample under way.
struct Path {
    /// The vertex at which it is.
    point: LitPoint,
    /// Albedos on the way.
    throughput: Vec3,
    /// How much its rays count that were drawn by a guide.
    weight: f32,
    /// What it found so far.
    sum: Vec3,
}

impl Path {
    fn new(point: &LitPoint) -> Self {
        Self {
            point: *point,
            throughput: Vec3::ONE,
            weight: 1.0,
            sum: Vec3::ZERO,
        }
    }

    /// Adds light, each colour by so much at most.
    fn add(&mut self, light: Vec3, brightest: f32) {
        self.sum += (self.throughput * light).min(Vec3::splat(brightest)) * self.weight;
    }
}

/// Decisions at each point of a path: sun, emitter, direction, survival.
const DECISIONS: u32 = 4;

/// The decision for the direction of a path's first ray; those of later points follow.
const FIRST_DIRECTION: u32 = 2;

/// Dimension of a single number beside the pair of the same decision, and of the position in the
/// pixel.
const SINGLE: u32 = 1 << 30;
const JITTER: u32 = 1 << 31;

/// 2^32 / g, / g^2, / g^3, / g^4 with g^5 = g + 1: steps of the R4 sequence; integer overflow is
/// the wrap to [0, 1).
const R4_STEPS: [u32; 4] = [0xdb4f_0b91, 0xbbe0_5633, 0xa0f2_ec77, 0x89e1_8285];

/// Position in the pixel, [0, 1) each way, of camera ray `index` through pixel (x, y): dimensions 1
/// and 2 of the sequence whose dimensions 3 and 4 sample light.
pub fn pixel_jitter(x: u32, y: u32, index: u32) -> [f32; 2] {
    let random = random4([x, y, 0x7247, 0]);
    [0, 1].map(|i| unit_float(random[i].wrapping_add(R4_STEPS[i].wrapping_mul(index))))
}

impl LightSample {
    /// Two numbers in [0, 1) for decision `dimension` of the path, evenly spread over the samples
    /// of the stream ([`sequence`]) and independent of all other decisions.
    fn pair(&self, dimension: u32) -> [f32; 2] {
        let [order, first, second, _] = self.seeds(dimension);
        sequence::point(self.index, [order, first, second]).map(unit_float)
    }

    /// One number in [0, 1), as [`Self::pair`] gives two, and independent of those.
    fn single(&self, dimension: u32) -> f32 {
        let [order, first, ..] = self.seeds(dimension + SINGLE);
        unit_float(sequence::first(self.index, [order, first]))
    }

    fn seeds(&self, dimension: u32) -> [u32; 4] {
        random4([self.stream, dimension, 0x9e37_79b9, 0x7f4a_7c15])
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
        let (emitters, lamps) = (Emitters::of(tracer), sharp::local_lamps(tracer));
        let (sun, sky, fill) = (scene.sun, scene.sky.clone(), FillLight::default());
        let (guide, exposure, tone) = (Guide::default(), 1.0, scene.tone);
        Self {
            sun,
            sky,
            lamps,
            emitters,
            guide,
            fill,
            bounces,
            exposure,
            tone,
        }
    }

    /// The lights of `scene`, with exposure and fill chosen by a pilot: what is seen, sky included,
    /// from seeded points in the headbox that the scene suggests (or
    /// [`crate::viewpoint::suggest_headbox`] finds). The logarithmic mean of luminance is exposed
    /// to a middle grey, as a photographer's meter does (Reinhard et al. 2002, "Photographic tone
    /// reproduction", without the compression), unless the scene says otherwise
    /// ([`headbox_core::exposure::Exposure`]). If more than a third of the surfaces seen get under
    /// 1 % of the brightest tenth, a fill light of a tenth of it (or 1 in total darkness) is added.
    pub fn measure(tracer: &Tracer, bounces: u32) -> Self {
        let mut lighting = Self::of_scene(tracer, bounces);
        let pilot = Pilot::new(tracer);
        let mut exposed = lighting.meter(tracer, &pilot);
        // Light brighter than white many times over is cut ([`BRIGHTEST_BOUNCE`]) by an exposure
        // that is not known yet: a scene lit by sunlight in lux is looked at again, exposed as was
        // found.
        for _ in 0..MOST_METERINGS {
            if exposed >= 0.5 * lighting.exposure {
                break;
            }
            (lighting.exposure, lighting.fill) = (exposed, FillLight::default());
            exposed = lighting.meter(tracer, &pilot);
        }
        lighting.exposure = tracer.scene().exposure.factor(exposed);
        lighting
    }

    /// As [`Self::measure`], and [guided](Self::guided), if anything will be `lit`; else surfaces
    /// are as bright as their textures (an exposure of 1, and the stops that the scene asks for).
    pub fn prepare(tracer: &Tracer, bounces: u32, lit: bool) -> Self {
        if lit {
            return Self::measure(tracer, bounces).guided(tracer);
        }
        Self {
            exposure: tracer.scene().exposure.factor(1.0),
            ..Self::of_scene(tracer, bounces)
        }
    }

    /// The exposure that what a pilot sees asks for; adds fill light if it has to.
    fn meter(&mut self, tracer: &Tracer, pilot: &Pilot) -> f32 {
        /// 125 of 255 in sRGB.
        const MIDDLE_GREY: f32 = 0.21;
        let sky: Vec<f32> = pilot
            .misses
            .iter()
            .map(|&direction| luminance(self.miss_radiance(direction)))
            .collect();
        let mut seen = [self.pilot_luminance(tracer, &pilot.surfaces), sky.clone()].concat();
        let bright = percentile(&mut seen.clone(), 0.9);
        let dark = seen[..pilot.surfaces.len()]
            .iter()
            .filter(|&&level| level <= bright * 0.01)
            .count();
        if dark * 3 > pilot.surfaces.len() {
            let mut distances: Vec<f32> = pilot.surfaces.iter().map(|p| p.distance_m).collect();
            let reach_m = 0.5 * percentile(&mut distances, 0.5);
            self.fill = FillLight {
                radiance: if bright > 0.0 { bright * 0.1 } else { 1.0 },
                reach_m,
            };
            seen = [self.pilot_luminance(tracer, &pilot.surfaces), sky].concat();
        }
        let mean = pilot.logarithmic_mean(&seen);
        if mean > 0.0 && mean.is_finite() {
            MIDDLE_GREY / mean
        } else {
            1.0
        }
    }

    fn pilot_luminance(&self, tracer: &Tracer, pilot: &[PilotPoint]) -> Vec<f32> {
        use rayon::prelude::*;
        const SAMPLES: u32 = 8;
        let light = |(i, p): (usize, &PilotPoint)| {
            let mut sum = 0.0;
            for index in 0..SAMPLES {
                let sample = LightSample {
                    stream: i as u32,
                    index,
                };
                let radiosity = self.radiosity_per_albedo(tracer, &p.point, &sample);
                sum += luminance([0, 1, 2].map(|c| radiosity[c] * p.albedo[c] + p.emission[c]));
            }
            sum / SAMPLES as f32
        };
        pilot.par_iter().enumerate().map(light).collect()
    }

    /// What is stored of linear radiance.
    pub fn stored(&self, radiance: Vec3) -> [u8; 3] {
        self.tone.levels(radiance * self.exposure)
    }

    /// What a ray sees that leaves the scene in the unit direction `direction`: linear radiance.
    /// The sun's disk is not drawn: it would be a single saturated texel.
    pub fn miss_radiance(&self, direction: Vec3) -> [f32; 3] {
        self.sky
            .as_ref()
            .map_or([0.0; 3], |sky| sky.seen(direction))
    }

    /// One sample of irradiance / pi at `point`.
    pub fn radiosity_per_albedo(
        &self,
        tracer: &Tracer,
        point: &LitPoint,
        sample: &LightSample,
    ) -> [f32; 3] {
        (self.sharp_radiosity(tracer, point, sample) + self.soft_radiosity(tracer, point, sample))
            .to_array()
    }

    /// The rest of [`Self::radiosity_per_albedo`]: sky, emissive triangles, bounces.
    pub fn soft_radiosity(&self, tracer: &Tracer, point: &LitPoint, sample: &LightSample) -> Vec3 {
        let mut path = Path::new(point);
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

    /// Radiosity per albedo by points and directions drawn among the lights at vertex number
    /// `bounce`: of the sky and of emissive triangles the share that rays in `directions` leave, if
    /// there are any and they look for these.
    fn direct(
        &self,
        tracer: &Tracer,
        point: &LitPoint,
        sample: &LightSample,
        bounce: u32,
        directions: Option<&Directions<'_>>,
    ) -> Vec3 {
        let dimension = bounce * DECISIONS;
        let shared = directions.filter(|_| !self.meets_nothing(bounce));
        let mut direct = self.emitter_light(tracer, point, sample, dimension, shared);
        if let Some(directions) = directions {
            direct += self.sky_light(tracer, point, sample, dimension, directions);
        }
        if bounce > 0 {
            direct += self.sun_light(tracer, point, sample, dimension);
            direct += self.one_lamp(tracer, point, sample, dimension);
        }
        direct
    }

    /// What a point shows of a bounce at most, each colour.
    fn brightest(&self, bounce: u32) -> f32 {
        if bounce > 0 {
            BRIGHTEST_BOUNCE / self.exposure
        } else {
            f32::INFINITY
        }
    }

    /// Whether the ray from vertex number `bounce` looks for the sky alone. The last of a path that
    /// has bounced does: points drawn on lamps are all that it sees of these.
    fn meets_nothing(&self, bounce: u32) -> bool {
        bounce > 0 && bounce == self.bounces && self.fill.radiance == 0.0
    }

    /// Adds what a path finds at its vertex number `bounce`, and moves it on to where its ray meets
    /// a surface. How long the way there was; `None` if the path ends.
    fn vertex(
        &self,
        tracer: &Tracer,
        path: &mut Path,
        bounce: u32,
        sample: &LightSample,
    ) -> Option<f32> {
        // A last ray that looks for the sky alone is not drawn where there is none.
        let goes_on = self.sky.is_some() || !self.meets_nothing(bounce);
        let directions = goes_on.then(|| self.directions(&path.point));
        let direct = self.direct(tracer, &path.point, sample, bounce, directions.as_ref());
        path.add(direct, self.brightest(bounce));
        self.onward(tracer, path, bounce, sample, &directions?)
    }

    /// The part of [`Self::vertex`] that comes along the ray by which the path goes on.
    fn onward(
        &self,
        tracer: &Tracer,
        path: &mut Path,
        bounce: u32,
        sample: &LightSample,
        directions: &Directions<'_>,
    ) -> Option<f32> {
        let dimension = bounce * DECISIONS;
        let (point, brightest) = (path.point, self.brightest(bounce));
        let (direction, weight) = directions.draw(sample.pair(dimension + FIRST_DIRECTION));
        path.weight *= weight;
        if direction.dot(point.normal) <= 0.0 {
            return None; // below the true surface: a shading normal that leans too far
        }
        let ray = Ray {
            origin: point.lifted(),
            direction,
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        let hit = if self.meets_nothing(bounce) {
            // Of what the last ray meets, nothing matters but whether it is there.
            if tracer.occluded(&ray) {
                return None;
            }
            None
        } else {
            tracer.closest(&ray)
        };
        let Some(hit) = hit else {
            path.add(
                self.sky_by_chance(&point, direction, directions) + self.fill.radiance,
                f32::INFINITY,
            );
            return None;
        };
        if self.fill.radiance > 0.0 {
            let open = (hit.t / self.fill.reach_m).min(1.0);
            path.add(Vec3::splat(self.fill.radiance * open * open), f32::INFINITY);
        }
        let (next, surface) = LitPoint::from_hit(tracer, &ray, &hit);
        let by_chance = self.emitter_by_chance(tracer, &point, &ray, &hit, &surface, directions);
        path.add(by_chance, brightest);
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
}

/// By how many sRGB levels, as a share of all, a picture changes with its linear light where it is
/// so bright, about: the slope of the sRGB curve. What is brighter than white is shown as white,
/// and its noise hardly.
pub fn shown_slope(level: f32) -> f32 {
    0.44 * level.max(0.005).powf(-0.58) * if level > 1.0 { 0.25 } else { 1.0 }
}
