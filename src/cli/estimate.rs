//! What a capture will cost, said before it begins.

use crate::capture::trace::{Ray, Tracer};
use crate::ldi::job::CaptureJob;
use glam::Vec3;
use rayon::prelude::*;
use std::fmt;
use std::time::Instant;

/// Rays by which the speed of this machine in this scene is measured: some milliseconds.
const PROBES: u32 = 1 << 15;
/// Rays in packets, as a capture traces and merges them, take about so many times as long as a probe. This and what follows are
/// rough figures, not calibrated.
const PROBES_PER_RAY: f64 = 1.3;
/// Light samples of a depth pixel and bounce, likewise: a shadow ray to the sun, one to the sky, and their shading.
const PROBES_PER_LIGHT_SAMPLE: f64 = 3.0;
/// Share of its rays that a capture traces: the rest would find nothing new.
const TRACED: f64 = 0.6;
/// Depth pixels for each pixel of the faces.
const LAYERS: f64 = 1.8;
/// Bytes of a depth pixel in the file, with its share of the tables.
const FILE_BYTES: f64 = 9.0;
/// Bytes of memory for each depth pixel at the widest point: accumulators, samples, and the packed form.
const MEMORY_BYTES: f64 = 110.0;

/// Time and space of a capture, roughly.
pub(super) struct Estimate {
    rays: f64,
    seconds: f64,
    file_bytes: f64,
    memory_bytes: f64,
}

impl Estimate {
    /// Of a job, `parts` of which are made elsewhere.
    pub(super) fn of(job: &CaptureJob, tracer: &Tracer, parts: u32) -> Self {
        let pixels = 6.0 * f64::from(job.face_size_px).powi(2);
        let rays = rays_of(job);
        let depth_pixels = (LAYERS * pixels).min(rays);
        let traced = rays * if job.parameters.novelty > 0.0 { TRACED } else { 1.0 } / f64::from(parts);
        let probe_s = probe_seconds(tracer);
        let light = depth_pixels * f64::from(job.parameters.light_samples) * f64::from(job.parameters.bounces + 1);
        let light = if parts == 1 { light } else { 0.0 };
        Self {
            rays: rays / f64::from(parts),
            seconds: (traced * PROBES_PER_RAY + light * PROBES_PER_LIGHT_SAMPLE) * probe_s,
            file_bytes: depth_pixels * FILE_BYTES,
            memory_bytes: depth_pixels * MEMORY_BYTES + 60e6,
        }
    }
}

/// Rays of a whole job before any are saved.
pub(super) fn rays_of(job: &CaptureJob) -> f64 {
    6.0 * f64::from(job.parameters.strata).powi(4) * f64::from(job.parameters.rays_per_stratum)
}

/// Seconds for a ray in every direction, all cores at work.
fn probe_seconds(tracer: &Tracer) -> f64 {
    let start = Instant::now();
    let hits = (0..PROBES).into_par_iter().filter(|&i| {
        let y = 1.0 - 2.0 * (i as f32 + 0.5) / PROBES as f32;
        let (sin, cos) = (i as f32 * 2.399_963_2).sin_cos(); // the golden angle
        let rim = (1.0 - y * y).sqrt();
        let direction = Vec3::new(rim * cos, y, rim * sin);
        tracer.closest(&Ray { origin: Vec3::ZERO, direction, t_min: 0.0, t_max: f32::INFINITY }).is_some()
    });
    std::hint::black_box(hits.count());
    start.elapsed().as_secs_f64() / f64::from(PROBES)
}

impl fmt::Display for Estimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rays = self.rays / 1e6;
        let time = super::progress::duration(self.seconds);
        let (file, memory) = (self.file_bytes / 1e6, self.memory_bytes / 1e6);
        write!(f, "{rays:.1} M rays, about {time}, a file of about {file:.0} MB, about {memory:.0} MB of memory")
    }
}
