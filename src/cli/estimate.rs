//! What a capture will cost, said before it begins.

use super::progress::Planned;
use crate::capture::trace::{Ray, Tracer};
use crate::gaps;
use crate::ldi::job::CaptureJob;
use crate::ldi::parameters::CaptureParameters;
use glam::Vec3;
use rayon::prelude::*;
use std::fmt;
use std::time::Instant;

/// Rays by which the speed of this machine in this scene is measured: some hundredths of a second, so that other work on the
/// machine has its part in it.
const PROBES: u32 = 1 << 17;
/// A ray in a packet, traced and kept, takes so many times as long as a probe. This and what follows are between what four scenes
/// of default size took (docs/decisions.md: what a capture will take).
const PROBES_PER_RAY: f64 = 1.6;
/// A light sample of a depth pixel and bounce, likewise: rays to the sun and the sky, and their shading.
const PROBES_PER_LIGHT_SAMPLE: f64 = 6.0;
/// What else is done to a depth pixel at the end: colour, merging, and the rays that say what it hides.
const PROBES_PER_DEPTH_PIXEL: f64 = 8.0;
/// The same without colour, before frames are looked at.
const PROBES_PER_SHAPE: f64 = 1.4;
/// A pixel of a frame that is looked at: its ray and its share of the frame.
const PROBES_PER_LOOK: f64 = 0.35;
/// Rounds of looking.
const ROUNDS: f64 = 6.0;
/// Rays for each pixel of the faces of which the plan traces half; of fewer it traces more, as each still finds something new.
const HALVED_RAYS_PER_PIXEL: f64 = 16.0;
/// Depth pixels for each pixel of the faces in which there is something.
const LAYERS: f64 = 1.1;
/// Bytes of a depth pixel in the file, with its share of the tables.
const FILE_BYTES: f64 = 14.0;
/// Bytes of memory for each depth pixel at the widest point, where the parts of all faces wait to be lit: 275 and 366 in a room and in
/// a house of small things.
const MEMORY_BYTES: f64 = 320.0;

/// Time and space of a capture, roughly.
pub(super) struct Estimate {
    rays: f64,
    /// Share of the rays that the pilot traces.
    pilot: f64,
    trace_s: f64,
    look_s: f64,
    light_s: f64,
    file_bytes: f64,
    memory_bytes: f64,
}

impl Estimate {
    /// Of a job, `parts` of which are made elsewhere.
    pub(super) fn of(job: &CaptureJob, tracer: &Tracer, parts: u32) -> Self {
        let CaptureParameters { novelty, light_samples, bounces, holes, .. } = job.parameters;
        let pixels = 6.0 * f64::from(job.face_size_px).powi(2);
        let rays = rays_of(job);
        let (probe_s, hit_share) = probe(tracer);
        let depth_pixels = (LAYERS * hit_share * pixels).min(rays);
        let traced_share = if novelty > 0.0 { 1.0 / (1.0 + rays / pixels / HALVED_RAYS_PER_PIXEL) } else { 1.0 };
        let traced = rays * traced_share / f64::from(parts);
        let light = f64::from(light_samples) * f64::from(bounces + 1) * PROBES_PER_LIGHT_SAMPLE;
        let round = depth_pixels * PROBES_PER_SHAPE + gaps::pixels_of_a_round(job) * PROBES_PER_LOOK;
        let is_whole = if parts == 1 { 1.0 } else { 0.0 };
        let looks = if holes < 1.0 { is_whole * ROUNDS } else { 0.0 };
        Self {
            rays: rays / f64::from(parts),
            pilot: if novelty > 0.0 { (0.25 / traced_share).min(1.0) } else { 0.0 },
            trace_s: traced * PROBES_PER_RAY * probe_s,
            look_s: looks * round * probe_s,
            light_s: is_whole * depth_pixels * (PROBES_PER_DEPTH_PIXEL + light) * probe_s,
            file_bytes: depth_pixels * FILE_BYTES,
            memory_bytes: depth_pixels * MEMORY_BYTES + 60e6,
        }
    }

    /// Seconds for all of it.
    pub(super) fn seconds(&self) -> f64 {
        self.trace_s + self.look_s + self.light_s
    }

    /// The stages to come.
    pub(super) fn plan(&self) -> Vec<Planned> {
        let planned = |stages, times, weight| Planned { stages, times, weight };
        vec![
            planned(&["pilot"], 1, self.trace_s * self.pilot),
            planned(&["trace"], 1, self.trace_s * (1.0 - self.pilot)),
            planned(&["look for holes"], ROUNDS as u32, self.look_s),
            planned(&["light and merge"], 1, self.light_s),
        ]
    }
}

/// Rays of a whole job before any are saved.
pub(super) fn rays_of(job: &CaptureJob) -> f64 {
    6.0 * f64::from(job.parameters.strata).powi(4) * f64::from(job.parameters.rays_per_stratum)
}

/// Seconds for a ray, in directions all around and all cores at work, and the share of these rays that meet something.
fn probe(tracer: &Tracer) -> (f64, f64) {
    let start = Instant::now();
    let hits = (0..PROBES).into_par_iter().filter(|&i| {
        let y = 1.0 - 2.0 * (i as f32 + 0.5) / PROBES as f32;
        let (sin, cos) = (i as f32 * 2.399_963_2).sin_cos(); // the golden angle
        let rim = (1.0 - y * y).sqrt();
        let direction = Vec3::new(rim * cos, y, rim * sin);
        tracer.closest(&Ray { origin: Vec3::ZERO, direction, t_min: 0.0, t_max: f32::INFINITY }).is_some()
    });
    let hits = hits.count();
    (start.elapsed().as_secs_f64() / f64::from(PROBES), hits as f64 / f64::from(PROBES))
}

impl fmt::Display for Estimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rays = self.rays / 1e6;
        let time = super::progress::duration(self.seconds());
        let (file, memory) = (self.file_bytes / 1e6, self.memory_bytes / 1e6);
        write!(f, "{rays:.1} M rays, about {time}, a file of at most {file:.0} MB, about {memory:.0} MB of memory")
    }
}
