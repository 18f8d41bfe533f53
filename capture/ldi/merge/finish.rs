//! The last stages of a capture: unlit surface samples, light, and depth pixels, face by face.

use super::merged_face::MergedFace;
use crate::capture::{SceneCapture, stage};
use crate::light::pool::GatheredLight;
use crate::light::sample_light::{FaceLightSamples, ROUNDS, pool_light, sample_light};
use crate::light::shade::Shader;
use crate::merge::clusters::PixelMerger;
use crate::merge::shares::ShareMeasure;
use crate::rays::trace_and_accumulate::{TracedRays, blocked_share};
use crate::surfaces::surface_samples::FaceSurfaces;
use crate::surfaces::unlit::UnlitFaces;
use glam::Vec3;
use headbox_core::cube_face::Face;
use headbox_core::progress::check_cancelled;
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::model::parameters::Sampler;
use headbox_cube::model::samples::CubeSamples;
use headbox_trace::viewpoint::suggest_view;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, Write};
use std::path::Path;

/// Lights and merges traced rays into a cube LDI.
///
/// # Errors
/// If spilled accumulators cannot be read, or if the capture was cancelled.
pub(crate) fn light_and_merge(
    capture: &SceneCapture,
    tracing: &TracedRays,
) -> io::Result<CubeSamples> {
    let SceneCapture {
        spec,
        tracer,
        lighting,
        options,
    } = *capture;
    let info = complete_info(capture, tracing)?;
    if options.budget.is_some() {
        tracing.store.spill_all()?; // the LDI that now grows needs the memory
    }
    let face_rows = u64::from(spec.face_size_px);
    options
        .progress
        .begin(stage::LIGHT, "rows", 6 * (ROUNDS + 1) * face_rows);
    let shader = Shader {
        capture: *capture,
        geometry_only: false,
    };
    let unlit = UnlitFaces {
        tracing,
        shader: &shader,
    };
    let mut light = if shader.light_samples() == 0 {
        None
    } else {
        Some(CubeLight::sample(&unlit)?)
    };
    let rows_per_face = if light.is_some() { 1 } else { ROUNDS + 1 } * face_rows;
    let bins = spec.depth_bins();
    let rule = spec.parameters.merge_rule;
    let mut faces = Vec::with_capacity(6);
    for face in Face::ALL {
        let surfaces = match &mut light {
            None => unlit.build(face, None)?,
            Some(light) => light.pool_face(&unlit, face)?,
        };
        check_cancelled(options.progress)?;
        options.progress.advance(rows_per_face);
        let shares = ShareMeasure::new(capture, face);
        let merger = PixelMerger {
            rule,
            tone: lighting.tone,
            bins: &bins,
            shares: Some(&shares),
        };
        let mut merged = MergedFace::new(face, surfaces.size_px, |x, y, out| {
            merger.merge([x, y], surfaces.pixel(x, y), out);
        });
        drop(surfaces);
        merged.measure_alphas(tracer, &bins, spec.half_size_m);
        faces.push(merged.ldi);
    }
    Ok(CubeSamples {
        info,
        faces,
        environment: tracing.environment_mask.environment(lighting),
    })
}

/// The header of the LDI.
fn complete_info(capture: &SceneCapture, tracing: &TracedRays) -> io::Result<CaptureInfo> {
    let SceneCapture { spec, tracer, .. } = *capture;
    let mut info = CaptureInfo {
        rays_traced: tracing.rays,
        holes: tracing.holes,
        blocked_share: blocked_share(tracer, spec.half_size_m),
        ahead: Some(suggest_view(tracer, spec.centre)),
        ..capture.info()
    };
    if spec.parameters.sampler != Sampler::CentreRays {
        let estimates = tracing.plan.missing_estimate(&tracing.store)?;
        for (slot, estimate) in info.missing_estimate.iter_mut().zip(estimates) {
            *slot = Some(estimate);
        }
    }
    Ok(info)
}

/// Light samples of all faces. All of them are taken before any light is pooled, because walls
/// continue across the borders of faces.
struct CubeLight {
    samples: Vec<FaceLightSamples>,
    /// Surface samples of each face until its light is pooled.
    pending: Vec<PendingFace>,
}

/// Surface samples of a face while other faces are sampled.
enum PendingFace {
    /// All surface samples.
    Surfaces(FaceSurfaces),
    /// Their light on disk, if memory is limited; the rest is built again.
    Spilled(SpilledLight),
}

/// The light of the surface samples of a face, in a file that vanishes with the process.
struct SpilledLight(File);

/// The light of one surface sample, as it is spilled.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct LightRecord {
    sun: Vec3,
    gathered: GatheredLight,
}

impl SpilledLight {
    /// Moves the gathered light of a face, and a copy of its sunlight, to a file in `folder`.
    fn write(
        surfaces: &FaceSurfaces,
        light: &mut FaceLightSamples,
        folder: &Path,
    ) -> io::Result<Self> {
        let mut file = BufWriter::new(tempfile::tempfile_in(folder)?);
        for (sample, gathered) in surfaces
            .samples
            .iter()
            .zip(std::mem::take(&mut light.gathered))
        {
            let sun = sample.sun;
            file.write_all(bytemuck::bytes_of(&LightRecord { sun, gathered }))?;
        }
        file.rewind()?;
        Ok(Self(file.into_inner()?))
    }

    /// Moves the light back.
    fn read(&self, surfaces: &mut FaceSurfaces, light: &mut FaceLightSamples) -> io::Result<()> {
        let mut file = BufReader::new(&self.0);
        light.gathered.reserve_exact(surfaces.samples.len());
        for sample in &mut surfaces.samples {
            let mut record: LightRecord = bytemuck::Zeroable::zeroed();
            file.read_exact(bytemuck::bytes_of_mut(&mut record))?;
            sample.sun = record.sun;
            light.gathered.push(record.gathered);
        }
        Ok(())
    }
}

impl CubeLight {
    /// Samples the light of all faces.
    fn sample(unlit: &UnlitFaces) -> io::Result<Self> {
        let options = unlit.shader.capture.options;
        let mut light = Self {
            samples: Vec::with_capacity(6),
            pending: Vec::with_capacity(6),
        };
        for face in Face::ALL {
            let mut surfaces = unlit.build(face, None)?;
            let mut samples = sample_light(&mut surfaces, face, unlit.shader);
            check_cancelled(options.progress)?;
            light.pending.push(match options.spill_budget() {
                Some((_, folder)) => {
                    PendingFace::Spilled(SpilledLight::write(&surfaces, &mut samples, folder)?)
                }
                None => PendingFace::Surfaces(surfaces),
            });
            light.samples.push(samples);
        }
        Ok(light)
    }

    /// The lit surface samples of a face, which can be taken once.
    fn pool_face(&mut self, unlit: &UnlitFaces, face: Face) -> io::Result<FaceSurfaces> {
        let mut surfaces = match &mut self.pending[face.index()] {
            PendingFace::Surfaces(surfaces) => std::mem::take(surfaces),
            PendingFace::Spilled(light) => {
                let mut surfaces = unlit.build(face, None)?;
                light.read(&mut surfaces, &mut self.samples[face.index()])?;
                surfaces
            }
        };
        pool_light(&mut surfaces, face, unlit.shader, &mut self.samples);
        Ok(surfaces)
    }
}
