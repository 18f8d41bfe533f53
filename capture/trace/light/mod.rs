//! Diffuse, view-independent light by path tracing: sun, sky, emissive triangles and bounces; and
//! the view-dependent reflection of glossy surfaces (`gloss`).
//!
//! Capture and truth share one estimator. At a surface point it returns one sample of
//! *radiosity per albedo* (irradiance / pi): the radiance that leaves the surface is that times its
//! albedo, plus its emission. Next-event estimation samples the sun, lamps, emissive triangles and
//! sky images; the last two (and the next bounce) are also sampled by one ray, cosine-weighted or
//! guided, or aimed at a reflector (`reflectors`), with multiple importance sampling. Russian
//! roulette ends dim paths beyond three bounces; paths of captures also end at cells in which light
//! that has bounced is cached (`bounced`).

mod arrival;
mod bounced;
mod cells;
mod direct;
mod environment;
mod gloss;
mod guiding;
mod path;
mod pilot;
mod sequence;
#[cfg(test)]
pub(crate) mod tests;

pub use arrival::{Arrival, FirstSegment};

use crate::bvh::{Hit, Ray, Tracer};
use crate::sampler::{random4, unit_float};
use crate::viewpoint;
use bounced::BouncedLight;
use direct::light_tree::LightTree;
use direct::sharp::LocalLamp;
use glam::{DVec3, Vec3};
use guiding::guide::Guide;
use headbox_core::bounces::Bounces;
use headbox_core::color::luminance;
use headbox_core::color::tone::ToneMap;
use headbox_scene::scene::{Sky, Sun, Surface};
use path::Path;
use pilot::{Pilot, PilotPoint, percentile};
use rayon::prelude::*;

/// Ambient fill light, attenuated by obscurance: radiance along a cosine-weighted ray that hits
/// nothing within `reach_m`, falling to zero at zero distance. Replaces the lamps that a model of a
/// closed room lacks; zero unless [`Lighting::measure`] finds that a scene is mostly black without
/// it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FillLight {
    /// Radiance, grey.
    pub radiance: f32,
    /// Distance from which the fill light is at its full radiance, metres.
    pub reach_m: f32,
}

/// Light sources of a scene and the exposure under which it is stored. A function of the scene and
/// of the tracer's origin only (not of the headbox's size or content), so that a capture and a
/// truth frame agree.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    /// Sun.
    pub sun: Option<Sun>,
    /// Sky.
    pub sky: Option<Sky>,
    /// Punctual lamps (without a surface), in the tracer's local frame.
    lamps: Vec<LocalLamp>,
    /// Emissive triangles.
    emitters: LightTree,
    /// Triangles next to emissive ones, at which rays are aimed.
    reflectors: LightTree,
    guide: Guide,
    /// Cache of light that has bounced.
    bounced: BouncedLight,
    /// Fill light.
    pub fill: FillLight,
    /// Number of diffuse bounces of a path beyond direct light.
    pub bounces: Bounces,
    /// Factor from linear radiance to the input of `tone`.
    pub exposure: f32,
    /// Tone map from exposed radiance to stored levels.
    pub tone: ToneMap,
}

/// Surface point at which light is estimated, in the tracer's local frame.
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
    /// Creates the point at a hit of `ray`, on the side that faces the ray's origin; also returns
    /// the surface.
    pub fn from_hit(tracer: &Tracer, ray: &Ray, hit: &Hit) -> (Self, Surface) {
        let surface = tracer.surface(hit.primitive, hit.u, hit.v);
        let flip = if surface.normal.dot(ray.direction) > 0.0 {
            -1.0
        } else {
            1.0
        };
        let point = Self {
            position: ray.origin + ray.direction * hit.t,
            normal: surface.normal * flip,
            shading_normal: surface.shading_normal * flip,
            extent: tracer.extent(hit.primitive),
        };
        (point, surface)
    }

    /// Returns the normal quantised to 9 bits, for hash keys.
    fn quantised_normal(&self) -> u64 {
        // Rounds twice a component of a unit vector, without the libm call that `round` needs on
        // processors before SSE4.1.
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

    /// Returns the gradient, by the shading normal, of the luminance of `light`: a sample of
    /// radiosity per albedo that arrives along the unit `direction` (Ward and Heckbert 1992,
    /// "Irradiance gradients", the rotational one). Zero where the shading normal is the geometric
    /// one.
    pub fn normal_gradient(&self, light: Vec3, direction: Vec3) -> Vec3 {
        /// Minimum cosine by which light is divided: samples near the horizon are rare and would
        /// dominate.
        const MIN_COS: f32 = 0.25;
        if self.shading_normal == self.normal {
            return Vec3::ZERO;
        }
        let cos = direction.dot(self.shading_normal);
        (direction - self.shading_normal * cos) * (luminance(light.to_array()) / cos.max(MIN_COS))
    }

    /// Returns the origin of rays that leave this point: offset along the normal by more than the
    /// rounding error of the position.
    pub fn ray_origin(&self) -> Vec3 {
        /// Rounding of a hit position is a few units in the last place (2^-24) of the triangle's
        /// largest coordinate and of the point's own; 2^-18 is a factor of 64 above that.
        const OFFSET: f32 = 1.0 / 262_144.0;
        self.position + self.normal * (OFFSET * self.position.abs().max_element().max(self.extent))
    }
}

/// Identifier of a light sample: its random numbers depend on nothing else.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Stream: the samples of one stream are stratified together.
    pub stream: u32,
    /// Index of the sample in its stream: 2^k consecutive samples starting at a multiple of 2^k are
    /// stratified.
    pub index: u32,
}

/// Offset from the dimension of a decision's pair of numbers to that of its single number.
const SINGLE: u32 = 1 << 30;

/// Dimension of the position in the pixel.
const JITTER: u32 = 1 << 31;

/// Steps of the R4 sequence: 2^32 divided by g, g^2, g^3, g^4 with g^5 = g + 1. Integer overflow
/// wraps to [0, 1).
const R4_STEPS: [u32; 4] = [0xdb4f_0b91, 0xbbe0_5633, 0xa0f2_ec77, 0x89e1_8285];

/// Returns the position in the pixel, [0, 1) along each axis, of camera ray `index` through pixel
/// (x, y): dimensions 1 and 2 of the sequence whose dimensions 3 and 4 sample light.
pub fn pixel_jitter(x: u32, y: u32, index: u32) -> [f32; 2] {
    let random = random4([x, y, 0x7247, 0]);
    [0, 1].map(|i| unit_float(random[i].wrapping_add(R4_STEPS[i].wrapping_mul(index))))
}

impl LightSample {
    /// Returns two numbers in [0, 1) for decision `dimension` of the path, stratified over the
    /// samples of the stream ([`sequence`]) and independent of all other decisions.
    fn pair(&self, dimension: u32) -> [f32; 2] {
        let [order, first, second, _] = self.seeds(dimension);
        sequence::point(self.index, [order, first, second]).map(unit_float)
    }

    /// Returns one number in [0, 1), stratified like [`Self::pair`] and independent of it.
    fn single(&self, dimension: u32) -> f32 {
        let [order, first, ..] = self.seeds(dimension + SINGLE);
        unit_float(sequence::first(self.index, [order, first]))
    }

    fn seeds(&self, dimension: u32) -> [u32; 4] {
        random4([self.stream, dimension, 0x9e37_79b9, 0x7f4a_7c15])
    }

    /// Returns a position in the sample's pixel, [0, 1) along each axis, independent of all
    /// decisions of the path.
    pub fn jitter(&self) -> [f32; 2] {
        self.pair(JITTER)
    }
}

impl Lighting {
    /// Creates the lighting of the tracer's scene with `bounces` diffuse bounces, no fill light and
    /// an exposure of 1.
    pub fn unmetered(tracer: &Tracer, bounces: impl Into<Bounces>) -> Self {
        let scene = tracer.scene();
        Self {
            sun: scene.sun,
            sky: scene.sky.clone(),
            lamps: direct::sharp::local_lamps(tracer),
            emitters: direct::emitters::emitter_tree(tracer),
            reflectors: LightTree::default(),
            guide: Guide::default(),
            bounced: BouncedLight::default(),
            fill: FillLight::default(),
            bounces: bounces.into(),
            exposure: 1.0,
            tone: scene.tone,
        }
    }

    /// Creates the lighting of the tracer's scene with exposure and fill light measured by pilot
    /// rays (sky included) from `place` (world metres). The logarithmic mean of luminance is
    /// exposed to middle grey, like a photographer's meter (Reinhard et al. 2002, "Photographic
    /// tone reproduction", without the compression), unless the scene specifies an exposure
    /// ([`headbox_core::color::exposure::Exposure`]). If more than a third of the visible surfaces
    /// receive less than 1 % of the 90th percentile, a fill light of a tenth of it (or 1 in total
    /// darkness) is added.
    pub fn measure_at(tracer: &Tracer, place: DVec3, bounces: impl Into<Bounces>) -> Self {
        let mut lighting = Self::unmetered(tracer, bounces);
        let pilot = Pilot::new(tracer, place);
        let exposed = lighting.meter(tracer, &pilot);
        lighting.exposure = tracer.scene().exposure.factor(exposed);
        lighting
    }

    /// Same as [`Self::measure_at`], from the centre of the scene's headbox, or else of
    /// [`viewpoint::suggest_headbox`].
    pub fn measure(tracer: &Tracer, bounces: impl Into<Bounces>) -> Self {
        let headbox = tracer.scene().headbox;
        let headbox = headbox.unwrap_or_else(|| viewpoint::suggest_headbox(tracer));
        Self::measure_at(tracer, headbox.centre, bounces)
    }

    /// Creates the lighting of a capture about `place`: that of [`Self::prepare_paths`], with
    /// [cached bounces](Self::with_cached_bounces).
    pub fn prepare(tracer: &Tracer, place: DVec3, bounces: impl Into<Bounces>, lit: bool) -> Self {
        let lighting = Self::prepare_paths(tracer, place, bounces, lit);
        if lit {
            lighting.with_cached_bounces(tracer)
        } else {
            lighting
        }
    }

    /// Creates lighting whose light is traced along complete paths: [measured](Self::measure_at) at
    /// `place` and [guided](Self::guided) if `lit`; otherwise surfaces have the colours of their
    /// textures (an exposure of 1, shifted by the stops that the scene specifies, and
    /// [`ToneMap::SrgbClipped`] in place of [`ToneMap::Neutral`]).
    pub fn prepare_paths(
        tracer: &Tracer,
        place: DVec3,
        bounces: impl Into<Bounces>,
        lit: bool,
    ) -> Self {
        if lit {
            return Self::measure_at(tracer, place, bounces).guided(tracer);
        }
        let scene = tracer.scene();
        Self {
            exposure: scene.exposure.factor(1.0),
            tone: scene.tone.without_highlights(),
            ..Self::unmetered(tracer, bounces)
        }
    }

    /// Measures the exposure from pilot points; adds fill light if they are mostly dark.
    fn meter(&mut self, tracer: &Tracer, pilot: &Pilot) -> f32 {
        /// 125 of 255 in sRGB.
        const MIDDLE_GREY: f32 = 0.21;
        let sky: Vec<f32> = pilot
            .misses
            .iter()
            .map(|&direction| luminance(self.miss_radiance(direction)))
            .collect();
        let mut levels = [self.pilot_luminance(tracer, &pilot.surfaces), sky.clone()].concat();
        let bright = percentile(&mut levels.clone(), 0.9);
        let dark = levels[..pilot.surfaces.len()]
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
            levels = [self.pilot_luminance(tracer, &pilot.surfaces), sky].concat();
        }
        let mean = pilot.logarithmic_mean(&levels);
        if mean > 0.0 && mean.is_finite() {
            MIDDLE_GREY / mean
        } else {
            1.0
        }
    }

    fn pilot_luminance(&self, tracer: &Tracer, pilot: &[PilotPoint]) -> Vec<f32> {
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

    /// Converts linear radiance to stored levels.
    pub fn stored(&self, radiance: Vec3) -> [u8; 3] {
        self.tone.levels(radiance * self.exposure)
    }

    /// Returns the linear radiance along a ray that leaves the scene in the unit direction
    /// `direction`. Excludes the sun's disk, which would be a single saturated texel.
    pub fn miss_radiance(&self, direction: Vec3) -> [f32; 3] {
        self.sky
            .as_ref()
            .map_or([0.0; 3], |sky| sky.seen(direction))
    }

    /// Returns one sample of irradiance / pi at `point`.
    pub fn radiosity_per_albedo(
        &self,
        tracer: &Tracer,
        point: &LitPoint,
        sample: &LightSample,
    ) -> [f32; 3] {
        (self.sharp_radiosity(tracer, point, sample) + self.soft_radiosity(tracer, point, sample))
            .to_array()
    }

    /// Same as [`Self::radiosity_per_albedo`], but with [cached
    /// bounces](Self::with_cached_bounces), if there are any.
    pub fn cached_radiosity(
        &self,
        tracer: &Tracer,
        point: &LitPoint,
        sample: &LightSample,
    ) -> Vec3 {
        let sharp = self.sharp_radiosity(tracer, point, sample);
        let first = self.first_segment(tracer, point, sample);
        let beyond = first.arrival.map_or(Vec3::ZERO, |arrival| {
            arrival.contribution(self.beyond(tracer, &arrival, sample))
        });
        sharp + first.light + beyond
    }

    /// Returns one sample of the part of [`Self::radiosity_per_albedo`] that comes from the sky,
    /// from emissive triangles and from bounces.
    fn soft_radiosity(&self, tracer: &Tracer, point: &LitPoint, sample: &LightSample) -> Vec3 {
        let mut path = Path::new(point);
        self.follow(tracer, &mut path, 0, sample);
        path.sum
    }
}

/// Returns the approximate slope of the sRGB curve at a linear level: change of the encoded value
/// (0..1) per change of linear light. Reduced above white, where the image saturates and noise is
/// hardly visible.
pub fn srgb_slope(level: f32) -> f32 {
    0.44 * level.max(0.005).powf(-0.58) * if level > 1.0 { 0.25 } else { 1.0 }
}
