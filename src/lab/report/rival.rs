//! Frame times of the LDI against Embree's primary rays, measured in turns at each eye.

use super::contender::contender_list::DefaultCapture;
use super::subject::{ReportError, Subject};
use crate::embree::{Embree, PROGRAM};
use crate::plan::{EyeSet, Plan};
use crate::turns::{least, run_in_turns, time_ms};
use headbox_core::statistics::median;
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_cube::render::{RenderSettings, Renderer};
use rayon::ThreadPool;
use serde::{Deserialize, Serialize};

/// Times of Embree's primary rays and of every splat kernel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EmbreeComparison {
    /// Embree's version.
    pub version: String,
    /// Number of threads of both.
    pub threads: usize,
    /// Time of Embree's primary rays, ms: median over eyes of the least of the rounds.
    pub ms_median: f64,
    /// Kernels, the default first.
    pub kernels: Vec<KernelTime>,
}

/// Time of one splat kernel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct KernelTime {
    /// Name on the command line, with "and planes" for a capture with plane textures.
    pub kernel: String,
    /// Time of a frame, ms: median over eyes of the least of the rounds.
    pub ms_median: f64,
    /// Median over eyes of the ratio of the frame's time to that of Embree's rays.
    pub over_rays: f64,
}

/// Rounds per eye.
const ROUNDS: u32 = 7;

/// A renderer that is timed in turns.
enum TimedRenderer<'a> {
    Ldi(Box<Renderer>, RenderSettings, &'a CubeLdi),
    Rays(Embree),
}

/// Times the default kernel with plane textures, and all kernels without, against Embree; `None` if
/// [`PROGRAM`] is not set.
///
/// # Errors
/// [`ReportError::Rival`] if the program fails.
pub(super) fn measure(
    subject: &Subject,
    plan: &Plan,
    capture: &DefaultCapture,
    pool: &ThreadPool,
) -> Result<Option<EmbreeComparison>, ReportError> {
    let Some(program) = std::env::var_os(PROGRAM) else {
        eprintln!("Embree's primary rays: left out, as {PROGRAM} is not set");
        return Ok(None);
    };
    let threads = pool.current_num_threads();
    let embree = Embree::start(&program, &subject.tracer, threads).map_err(ReportError::Rival)?;
    let version = embree.version.clone();
    let default = RenderSettings::default().kernel;
    let others = SplatKernel::ALL
        .into_iter()
        .filter(|kernel| *kernel != default);
    let samples = std::iter::once(default)
        .chain(others)
        .map(|kernel| (kernel.name().to_owned(), kernel, &capture.cube));
    let planes = capture
        .with_planes
        .iter()
        .map(|cube| (format!("{} and planes", default.name()), default, cube));
    let (names, mut renderers): (Vec<String>, Vec<TimedRenderer>) = planes
        .chain(samples)
        .map(|(name, kernel, cube)| {
            let settings = RenderSettings {
                kernel,
                ..RenderSettings::default()
            };
            (
                name,
                TimedRenderer::Ldi(Box::new(Renderer::new()), settings, cube),
            )
        })
        .unzip();
    renderers.push(TimedRenderer::Rays(embree));
    let mut times_ms: Vec<Vec<f64>> = vec![Vec::new(); renderers.len()];
    for eye in plan.eyes.iter().filter(|eye| eye.belongs_to(EyeSet::All)) {
        let mut failed = None;
        let times = run_in_turns(&mut renderers, ROUNDS, |_, renderer| match renderer {
            TimedRenderer::Ldi(renderer, settings, cube) => Some(pool.install(|| {
                time_ms(|| {
                    renderer.render_with_stats(cube, &eye.camera, settings);
                })
            })),
            TimedRenderer::Rays(embree) => embree
                .trace(&eye.camera)
                .map(|frame| frame.ms)
                .map_err(|e| failed = Some(e))
                .ok(),
        });
        if let Some(error) = failed {
            return Err(ReportError::Rival(error));
        }
        for (all, times) in times_ms.iter_mut().zip(&times) {
            all.extend(least(times));
        }
    }
    let rays = times_ms.pop().unwrap_or_default();
    let kernel_time = |(kernel, ms): (String, Vec<f64>)| KernelTime {
        kernel,
        over_rays: median(ms.iter().zip(&rays).map(|(ours, theirs)| ours / theirs)).unwrap_or(0.0),
        ms_median: median(ms).unwrap_or(0.0),
    };
    let kernels = names.into_iter().zip(times_ms).map(kernel_time).collect();
    Ok(Some(EmbreeComparison {
        version,
        threads,
        ms_median: median(rays.iter().copied()).unwrap_or(0.0),
        kernels,
    }))
}
