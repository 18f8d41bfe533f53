//! What a capture will cost, said before it begins: by a rehearsal.
//!
//! What a ray, a light sample and a look for holes take depends on the scene and the machine by factors of four, which no constants
//! know. So the whole capture is made once in small, with as many rays for each pixel of its faces and as much light, in some tenths of a
//! second; each stage is timed and grows by its own law. What is captured afterwards knows nothing of it.

use crate::output::memory_bytes;
use crate::packing::PackingArgs;
use crate::progress::PlannedStage;
use headbox_core::progress::Silent;
use headbox_cube::model::parameters::Sampler;
use headbox_ldi::job::CaptureJob;
use headbox_ldi::rays::trace as build;
use headbox_ldi::refine;
use headbox_ldi::settings::Resources;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::fmt;
use std::time::Instant;

/// Pixels a side of the rehearsal's faces, unless the capture's have fewer than so many times of it.
const FACE_PX: u32 = 96;
const SMALLER: u32 = 4;

/// A ray of the capture takes this share of the time of one in the rehearsal, whose threads have hardly begun when they end.
const RAY_SHARE: f64 = 0.75;
/// A depth pixel likewise takes this share of the time to be lit, merged and packed: on larger faces light is pooled over more of them.
const LIGHT_SHARE: f64 = 0.65;
/// So many rounds of looking for holes for each of the rehearsal's; at least two are needed to know that there are none.
const ROUNDS_SHARE: f64 = 1.5;
const FEWEST_ROUNDS: f64 = 2.0;
/// A file takes this share of the bytes in memory, which grow by this power of the faces' size: pictures on planes need fewer borders.
const FILE_SHARE: f64 = 0.78;
const FILE_POWER: f64 = 1.87;
/// Bytes of memory for each depth pixel at the widest point, where the parts of all faces wait to be lit: 242 to 366 in six scenes.
const MEMORY_BYTES: f64 = 290.0;

/// Time and space of a capture, roughly.
pub(super) struct Estimate {
    /// What loading and the rehearsal took.
    before_s: f64,
    rays: f64,
    /// Share of the rays that the pilot traces.
    pilot: f64,
    trace_s: f64,
    look_s: f64,
    rounds: u32,
    light_s: f64,
    /// Of a whole capture.
    file_bytes: Option<f64>,
    memory_bytes: f64,
}

impl Estimate {
    /// Of a job on which work has `begun` by loading its scene, made in so many `parts`; of one of these nothing is lit.
    ///
    /// # Errors
    /// Those of the capture.
    pub(super) fn of(
        job: &CaptureJob,
        tracer: &Tracer,
        lighting: &Lighting,
        packing: &PackingArgs,
        parts: u32,
        begun: Instant,
    ) -> anyhow::Result<Self> {
        let used_before = memory_bytes().map_or([60e6; 2], |(most, now)| {
            [most, now].map(|bytes| bytes as f64)
        });
        let small = in_small(job, parts == 1);
        let wider = f64::from(job.face_size_px) / f64::from(small.face_size_px);
        let resources = Resources::default();

        let start = Instant::now();
        let mut tracing = build::trace(tracer, &small.settings(&resources, (0, 1)), &Silent)?;
        let rays_wider = rays_of(job) / rays_of(&small) / f64::from(parts);
        let rays = tracing.rays as f64 * rays_wider;
        let trace_s = start.elapsed().as_secs_f64() * rays_wider * RAY_SHARE;
        let is_planned =
            small.parameters.novelty > 0.0 && small.parameters.sampler != Sampler::CentreRays;
        let pilot = if is_planned {
            (0.25 * rays_of(&small) / tracing.rays as f64).min(1.0)
        } else {
            0.0
        };

        let start = Instant::now();
        refine::close(&small, &mut tracing, tracer, lighting, &Silent)?;
        let looked = f64::from(tracing.holes.map_or(0, |holes| holes.rounds));
        let rounds = if looked > 0.0 {
            (looked * ROUNDS_SHARE).max(FEWEST_ROUNDS).round()
        } else {
            0.0
        };
        // Of a round, frames cost as much as they have pixels, which is little in small ones, and samples as there are: together about
        // as the width of the faces.
        let look_s = start.elapsed().as_secs_f64() / looked.max(1.0) * rounds * wider;

        let start = Instant::now();
        let ldi = small.finish(&tracing, tracer, lighting, &resources, &Silent)?;
        let samples: usize = ldi.faces.iter().map(|face| face.samples.len()).sum();
        let packed = packing.pack(ldi)?;
        let light_s = start.elapsed().as_secs_f64() * wider * wider * LIGHT_SHARE;
        let needed = samples as f64 * wider * wider * MEMORY_BYTES;
        let is_whole = parts == 1;
        Ok(Self {
            before_s: begun.elapsed().as_secs_f64(),
            rays,
            pilot,
            trace_s,
            look_s,
            rounds: rounds as u32,
            light_s: if is_whole { light_s } else { 0.0 },
            file_bytes: is_whole
                .then(|| packed.bytes() as f64 * FILE_SHARE * wider.powf(FILE_POWER)),
            memory_bytes: (used_before[1] + needed).max(used_before[0]),
        })
    }

    /// The same where a limit of memory, MiB, is kept within.
    pub(super) fn within(mut self, memory_mb: Option<u64>) -> Self {
        let limit = memory_mb.map_or(f64::INFINITY, |mb| mb as f64 * f64::from(1 << 20));
        self.memory_bytes = self.memory_bytes.min(limit);
        self
    }

    /// Seconds for all of it, from where it has begun.
    pub(super) fn seconds(&self) -> f64 {
        self.before_s + self.trace_s + self.look_s + self.light_s
    }

    /// The stages to come.
    pub(super) fn plan(&self) -> Vec<PlannedStage> {
        let planned = |stages, times, weight| PlannedStage {
            stages,
            times,
            weight,
        };
        vec![
            planned(&["pilot"], 1, self.trace_s * self.pilot),
            planned(&["trace"], 1, self.trace_s * (1.0 - self.pilot)),
            planned(&["look for holes"], self.rounds.max(1), self.look_s),
            planned(&["light and merge"], 1, self.light_s),
        ]
    }
}

/// A job in small, with about as many rays for each pixel of its faces. Of a part of a job, rays alone are rehearsed.
fn in_small(job: &CaptureJob, is_whole: bool) -> CaptureJob {
    let mut small = job.clone();
    small.face_size_px = (job.face_size_px / SMALLER).clamp(1, FACE_PX);
    let share = f64::from(small.face_size_px) / f64::from(job.face_size_px);
    small.parameters.strata =
        ((f64::from(job.parameters.strata) * share.sqrt()).round() as u32).max(1);
    if !is_whole {
        (small.parameters.light_samples, small.parameters.holes) = (0, 1.0);
    }
    small
}

/// Rays of a whole job before any are saved.
pub(super) fn rays_of(job: &CaptureJob) -> f64 {
    match job.parameters.sampler {
        Sampler::CentreRays => 6.0 * f64::from(job.face_size_px).powi(2),
        Sampler::Stratified | Sampler::WhiteNoise => {
            6.0 * f64::from(job.parameters.strata).powi(4)
                * f64::from(job.parameters.rays_per_stratum)
        }
    }
}

/// A number of some unit as `9.4 M`, `94 M`, `940 M`: two digits of it count.
fn rounded(number: f64) -> String {
    let (scale, prefix) = match number {
        _ if number >= 995e6 => (1e9, "G"),
        _ if number >= 995e3 => (1e6, "M"),
        _ => (1e3, "k"),
    };
    match number / scale {
        few if few < 9.95 => format!("{few:.1} {prefix}"),
        some if some < 99.5 => format!("{some:.0} {prefix}"),
        many => format!("{:.0} {prefix}", (many / 10.0).round() * 10.0),
    }
}

impl fmt::Display for Estimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [rays, memory] = [self.rays, self.memory_bytes].map(rounded);
        write!(
            f,
            "about {} in all: {rays} rays, ",
            crate::progress::duration(self.seconds())
        )?;
        if let Some(bytes) = self.file_bytes {
            write!(f, "a file of {}B, ", rounded(bytes))?;
        }
        write!(f, "{memory}B of memory")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_two_digits_that_count() {
        let cases = [
            (40.0, "0.0 k"),
            (2_345.0, "2.3 k"),
            (994e3, "990 k"),
            (996e3, "1.0 M"),
            (47.6e6, "48 M"),
            (1.96e9, "2.0 G"),
        ];
        for (number, words) in cases {
            assert_eq!(rounded(number), words);
        }
    }

    #[test]
    fn a_rehearsal_has_as_many_rays_for_a_pixel() {
        let per_pixel = |job: &CaptureJob| rays_of(job) / f64::from(job.face_size_px).powi(2);
        for (face_size_px, strata) in [(1024, 32), (512, 24), (256, 16), (512, 16)] {
            let mut job = CaptureJob::new(
                headbox_ldi::scene_source::SceneSource::new("a"),
                glam::DVec3::ZERO,
                1.0,
            );
            (job.face_size_px, job.parameters.strata) = (face_size_px, strata);
            let ratio = per_pixel(&in_small(&job, true)) / per_pixel(&job);
            assert!(
                (0.7..1.4).contains(&ratio),
                "{face_size_px} {strata}: {ratio}, strata are whole numbers"
            );
        }
    }
}
