//! Estimate of the time and space of a capture, by a rehearsal before it starts.
//!
//! The time of a ray, of a light sample and of the search for holes depends on the scene and the
//! machine by factors of four, which no constants can predict. So the whole capture is made at a
//! small size, with as many rays for each pixel of its faces and as much light, in some tenths of a
//! second; the processor time of each stage is scaled by its own law, so that other programs that
//! run at the moment do not count. The rehearsal does not influence the capture.

use super::memory_limit::{MemoryLimit, unlimited_bytes};
use crate::packing::PackingArgs;
use crate::progress::PlannedStage;
use headbox_core::memory;
use headbox_core::stopwatch::Stopwatch;
use headbox_cube::model::parameters::Sampler;
use headbox_ldi::capture::{SceneCapture, stage};
use headbox_ldi::spec::{CaptureSpec, RunOptions};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::fmt;
use std::time::Instant;

/// Maximum size of the rehearsal's faces, pixels.
const FACE_PX: u32 = 96;

/// Minimum ratio of the capture's face size to the rehearsal's.
const REDUCTION: u32 = 4;

/// Time of a ray of the capture, as a multiple of one in the rehearsal (docs/decisions/0019).
const RAY_SHARE: f64 = 1.02;

/// Factor and power of the face size by which the time for light, merging and packing grows: on
/// larger faces light is pooled over more pixels.
const LIGHT_FACTOR: f64 = 0.82;
const LIGHT_POWER: f64 = 1.75;

/// Power of the face size by which a first round of the search for holes grows: one that looks at
/// all pixels.
const ROUND_POWER: f64 = 1.45;

/// Time of a further round, which looks only at the pixels that have changed, as a share of the
/// first.
const FURTHER_ROUND: f64 = 0.2;

/// Power of the face size by which the file grows: plane textures of larger faces have fewer
/// borders.
const FILE_POWER: f64 = 1.88;

/// Estimated time and space of a capture.
pub(crate) struct Estimate {
    /// Time of loading and of the rehearsal.
    before_s: f64,
    rays: f64,
    /// Share of the rays in the pilot round.
    pilot_share: f64,
    trace_s: f64,
    holes_s: f64,
    hole_rounds: u32,
    light_s: f64,
    /// Size of the file; `None` for a shard.
    file_bytes: Option<f64>,
    /// Number of depth pixels before packing.
    depth_pixels: f64,
    memory_bytes: f64,
}

impl Estimate {
    /// Rehearses a capture, or one of its `parts`, of which none is lit. `start` is when the
    /// command started.
    ///
    /// # Errors
    /// The errors of the capture.
    pub(crate) fn new(
        spec: &CaptureSpec,
        tracer: &Tracer,
        lighting: &Lighting,
        packing: &PackingArgs,
        parts: u32,
        start: Instant,
    ) -> anyhow::Result<Self> {
        let [peak_memory, used_memory] =
            memory::peak_and_resident().map_or([60e6; 2], |both| both.map(|bytes| bytes as f64));
        let is_whole = parts == 1;
        let small = rehearsal(spec, is_whole);
        let scale = f64::from(spec.face_size_px) / f64::from(small.face_size_px);
        let options = RunOptions::default();
        let capture = SceneCapture::new(&small, tracer, lighting, &options);

        let watch = Stopwatch::start();
        let mut tracing = capture.trace()?;
        let ray_scale = spec.max_rays() / small.max_rays() / f64::from(parts);
        let rays = tracing.rays as f64 * ray_scale;
        let trace_s = watch.seconds_per_thread() * ray_scale * RAY_SHARE;
        let has_pilot =
            small.parameters.novelty > 0.0 && small.parameters.sampler != Sampler::CentreRays;
        let pilot_share = if has_pilot {
            (0.25 * small.max_rays() / tracing.rays as f64).min(1.0)
        } else {
            0.0
        };

        let watch = Stopwatch::start();
        capture.fill_holes(&mut tracing)?;
        let hole_rounds = tracing.holes.map_or(0, |holes| holes.rounds);
        // In the rehearsal all rounds take as long.
        let round_s = watch.seconds_per_thread() / f64::from(hole_rounds.max(1));
        let rounds = 1.0 + FURTHER_ROUND * f64::from(hole_rounds.saturating_sub(1));
        let holes_s = round_s * scale.powf(ROUND_POWER) * rounds;

        let watch = Stopwatch::start();
        let ldi = capture.light_and_merge(&tracing)?;
        let samples: usize = ldi.faces.iter().map(|face| face.samples.len()).sum();
        let packed = packing.pack(ldi)?;
        let light_s = watch.seconds_per_thread() * LIGHT_FACTOR * scale.powf(LIGHT_POWER);
        let depth_pixels = samples as f64 * scale * scale;
        let file_bytes = if is_whole {
            Some(packed.file_bytes()? as f64 * scale.powf(FILE_POWER))
        } else {
            None
        };
        Ok(Self {
            before_s: start.elapsed().as_secs_f64(),
            rays,
            pilot_share,
            trace_s,
            holes_s,
            hole_rounds,
            light_s: if is_whole { light_s } else { 0.0 },
            file_bytes,
            depth_pixels,
            memory_bytes: unlimited_bytes(used_memory, depth_pixels).max(peak_memory),
        })
    }

    /// Number of depth pixels before packing.
    pub(super) fn depth_pixels(&self) -> f64 {
        self.depth_pixels
    }

    /// Peak memory, bytes.
    pub(super) fn memory_bytes(&self) -> f64 {
        self.memory_bytes
    }

    /// Estimates the memory within a limit, on a number of threads.
    pub(super) fn limit_memory(mut self, limit: Option<MemoryLimit>, threads: usize) -> Self {
        if let Some(limit) = limit {
            self.memory_bytes = limit.peak_bytes(self.depth_pixels, threads);
        }
        self
    }

    /// Total time from the start of the command, seconds.
    pub(crate) fn seconds(&self) -> f64 {
        self.before_s + self.trace_s + self.holes_s + self.light_s
    }

    /// The stages to come.
    pub(crate) fn plan(&self) -> Vec<PlannedStage> {
        let planned = |stages, times, weight| PlannedStage {
            stages,
            times,
            weight,
        };
        let trace_share = 1.0 - self.pilot_share;
        vec![
            planned(&[stage::PILOT], 1, self.trace_s * self.pilot_share),
            planned(&[stage::TRACE], 1, self.trace_s * trace_share),
            planned(&[stage::HOLES], self.hole_rounds.max(1), self.holes_s),
            planned(&[stage::LIGHT], 1, self.light_s),
        ]
    }
}

/// A small version of a capture with about as many rays for each pixel of its faces. Of a shard,
/// only the rays are rehearsed.
fn rehearsal(spec: &CaptureSpec, is_whole: bool) -> CaptureSpec {
    let mut small = spec.clone();
    small.face_size_px = (spec.face_size_px / REDUCTION).clamp(1, FACE_PX);
    let share = f64::from(small.face_size_px) / f64::from(spec.face_size_px);
    let strata = (f64::from(spec.parameters.strata) * share.sqrt()).round();
    small.parameters.strata = (strata as u32).max(1);
    if !is_whole {
        small.parameters.light_samples = 0;
        small.parameters.holes = 1.0;
    }
    small
}

/// Formats a number with two significant digits and a unit prefix: `9.4 M`, `94 M`, `940 M`.
fn rounded(number: f64) -> String {
    let (scale, prefix) = match number {
        _ if number >= 995e6 => (1e9, "G"),
        _ if number >= 995e3 => (1e6, "M"),
        _ => (1e3, "k"),
    };
    match number / scale {
        scaled if scaled < 9.95 => format!("{scaled:.1} {prefix}"),
        scaled if scaled < 99.5 => format!("{scaled:.0} {prefix}"),
        scaled => format!("{:.0} {prefix}", (scaled / 10.0).round() * 10.0),
    }
}

impl fmt::Display for Estimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rays = rounded(self.rays);
        write!(
            f,
            "about {} in all: {rays} rays, ",
            crate::progress::duration(self.seconds())
        )?;
        if let Some(bytes) = self.file_bytes {
            write!(f, "a file of {}B, ", rounded(bytes))?;
        }
        let mib = self.memory_bytes / f64::from(1 << 20);
        write!(f, "{mib:.0} MiB of memory")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use headbox_ldi::scene_source::SceneSource;

    #[test]
    fn numbers_have_two_significant_digits() {
        let cases = [
            (40.0, "0.0 k"),
            (2_345.0, "2.3 k"),
            (994e3, "990 k"),
            (996e3, "1.0 M"),
            (47.6e6, "48 M"),
            (1.96e9, "2.0 G"),
        ];
        for (number, expected) in cases {
            assert_eq!(rounded(number), expected);
        }
    }

    #[test]
    fn rehearsal_keeps_rays_per_pixel() {
        for (face_size_px, strata) in [(1024, 32), (512, 24), (256, 16), (512, 16)] {
            let mut spec = CaptureSpec::new(SceneSource::new("a"), DVec3::ZERO, 1.0);
            spec.face_size_px = face_size_px;
            spec.parameters.strata = strata;
            let ratio = rehearsal(&spec, true).rays_per_pixel() / spec.rays_per_pixel();
            assert!(
                (0.7..1.4).contains(&ratio),
                "{face_size_px} {strata}: {ratio}, strata are whole numbers"
            );
        }
    }
}
