//! The end of a capture: light at kept hits, pooled over surfaces, merged into depth pixels, face by face.

use super::merged_face::MergedFace;
use crate::light::illuminate::{FaceSamples, ROUNDS, pool, sample};
use crate::light::shade::Shader;
use crate::merge::clusters::depth_pixels_of;
use crate::rays::trace::Tracing;
use crate::settings::CaptureSettings;
use crate::surfaces::surface_samples::FaceParts;
use crate::surfaces::unlit::Dark;
use glam::Vec3;
use headbox_core::cube_face::Face;
use headbox_core::progress::{Progress, check_cancelled};
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::model::parameters::Sampler;
use headbox_cube::model::samples::CubeLdi;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::collections::VecDeque;
use std::io;

/// Lights and merges what was traced into a cube LDI. `info` is completed with the rays and the missing estimate.
///
/// # Errors
/// If spilled accumulators cannot be read.
pub(crate) fn finish(
    run: &Tracing,
    mut info: CaptureInfo,
    tracer: &Tracer,
    lighting: &Lighting,
    settings: &CaptureSettings,
    progress: &dyn Progress,
) -> io::Result<CubeLdi> {
    if settings.parameters.sampler != Sampler::CentreRays {
        let missing = run.plan.missing_estimate(&run.store)?;
        info.missing_estimate
            .iter_mut()
            .zip(missing)
            .for_each(|(slot, estimate)| *slot = Some(estimate));
    }
    (info.rays_traced, info.holes) = (run.rays, run.holes);
    if settings.resources.budget.is_some() {
        run.store.spill_all()?; // the LDI that now grows needs the memory
    }
    progress.begin(
        "light and merge",
        "rows",
        6 * (ROUNDS + 1) * u64::from(settings.face_size_px),
    );
    let samples = settings.parameters.light_samples;
    let shader = Shader {
        tracer,
        lighting,
        samples,
        shape_only: false,
        face_size_px: settings.face_size_px,
    };
    merge(run, info, &shader, settings, progress)
}

fn merge(
    run: &Tracing,
    info: CaptureInfo,
    shader: &Shader,
    settings: &CaptureSettings,
    progress: &dyn Progress,
) -> io::Result<CubeLdi> {
    let Shader {
        tracer, lighting, ..
    } = *shader;
    let bins = DepthBins::new(settings.half_size_m, settings.face_size_px);
    let dark = Dark {
        run,
        shader,
        settings,
        bins: &bins,
        progress,
    };
    let mut light = if shader.samples == 0 {
        None
    } else {
        Some(dark.sampled()?)
    };
    let rows_done = if light.is_some() { 1 } else { ROUNDS + 1 } * u64::from(settings.face_size_px);
    let mut faces = Vec::with_capacity(6);
    for face in Face::ALL {
        let parts = match &mut light {
            None => dark.face(face, None)?,
            Some(light) => dark.lit(face, light)?,
        };
        check_cancelled(progress)?;
        progress.advance(rows_done);
        let rule = settings.parameters.merge_rule;
        let mut merged = MergedFace::of(face, parts.size_px, |x, y, out| {
            depth_pixels_of(parts.pixel(x, y), rule, lighting.tone, &bins, out);
        });
        drop(parts);
        merged.measure_alphas(tracer, &bins, settings.half_size_m, |_, _| true);
        faces.push(merged.ldi);
    }
    Ok(CubeLdi {
        info,
        faces,
        environment: run.misses.environment(lighting),
    })
}

/// Light samples of all faces, before any of them is pooled.
struct Sampled {
    samples: Vec<FaceSamples>,
    /// Of those that are not pooled yet.
    waiting: VecDeque<Waiting>,
}

/// What is kept of a face's parts while other faces are sampled.
enum Waiting {
    /// All of them.
    Parts(FaceParts),
    /// Where memory is short: the light straight from the sun; the rest is made again.
    Sun(Vec<Vec3>),
}

impl Dark<'_> {
    /// Samples the light of all faces: walls go on across their borders.
    fn sampled(&self) -> io::Result<Sampled> {
        let is_short = self.settings.resources.budget.is_some();
        let mut sampled = Sampled {
            samples: Vec::with_capacity(6),
            waiting: VecDeque::with_capacity(6),
        };
        for face in Face::ALL {
            let mut parts = self.face(face, None)?;
            sampled
                .samples
                .push(sample(&mut parts, face, self.shader, self.progress));
            check_cancelled(self.progress)?;
            sampled.waiting.push_back(match is_short {
                true => Waiting::Sun(parts.parts.iter().map(|part| part.sun).collect()),
                false => Waiting::Parts(parts),
            });
        }
        Ok(sampled)
    }

    /// The parts of a face in its light.
    fn lit(&self, face: Face, light: &mut Sampled) -> io::Result<FaceParts> {
        let mut parts = match light.waiting.pop_front() {
            Some(Waiting::Parts(parts)) => parts,
            waiting => {
                let mut parts = self.face(face, None)?;
                if let Some(Waiting::Sun(sun)) = waiting {
                    parts
                        .parts
                        .iter_mut()
                        .zip(sun)
                        .for_each(|(part, sun)| part.sun = sun);
                }
                parts
            }
        };
        pool(&mut parts, face, &mut light.samples);
        Ok(parts)
    }
}
