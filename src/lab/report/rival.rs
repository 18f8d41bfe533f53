//! Frames of the LDI beside Embree's primary rays, eye by eye, in turns.

use super::field::DefaultCapture;
use super::subject::{ReportError, Subject};
use crate::embree::{Embree, PROGRAM};
use crate::plan::{EyeSet, Plan};
use crate::turns::{in_turns, least};
use headbox_core::statistics::median;
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_cube::render::{RenderSettings, Renderer};
use rayon::ThreadPool;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// The rival and how every kernel stands against it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RivalRows {
    /// Embree's version.
    pub version: String,
    /// Threads of both.
    pub threads: usize,
    /// Milliseconds of its primary rays: median over eyes of the least of the rounds.
    pub ms_median: f64,
    /// The kernels, the default first.
    pub kernels: Vec<KernelAgainstRival>,
}

/// One kernel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct KernelAgainstRival {
    /// Its name on the command line, and what it draws if that is more than samples.
    pub kernel: String,
    /// Milliseconds, as the rival's.
    pub ms_median: f64,
    /// Median over eyes of its time over the rival's.
    pub over_rays: f64,
}

/// Turns of each eye.
const ROUNDS: u32 = 7;

/// Whoever takes turns.
enum Way<'a> {
    Ours(Box<Renderer>, RenderSettings, &'a CubeLdi),
    Rays(Embree),
}

/// Measures the default kernel on a capture with pictures on planes, and all kernels on its samples
/// alone, against the rival; `None` where [`PROGRAM`] is not set.
///
/// # Errors
/// [`ReportError::Rival`] if it is set, and the program does not do what it should.
pub(super) fn measure(
    subject: &Subject,
    plan: &Plan,
    capture: &DefaultCapture,
    pool: &ThreadPool,
) -> Result<Option<RivalRows>, ReportError> {
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
    let (names, ours): (Vec<String>, Vec<Way>) = planes
        .chain(samples)
        .map(|(name, kernel, cube)| {
            let settings = RenderSettings {
                kernel,
                ..RenderSettings::default()
            };
            (name, Way::Ours(Box::new(Renderer::new()), settings, cube))
        })
        .unzip();
    let mut ways: Vec<Way> = ours.into_iter().chain([Way::Rays(embree)]).collect();
    let mut by_way: Vec<Vec<f64>> = vec![Vec::new(); ways.len()];
    for eye in plan.eyes.iter().filter(|eye| eye.belongs_to(EyeSet::All)) {
        let mut failed = None;
        let times = in_turns(&mut ways, ROUNDS, |_, way| match way {
            Way::Ours(renderer, settings, cube) => Some(pool.install(|| {
                let started = Instant::now();
                renderer.render_with_stats(cube, &eye.camera, settings);
                started.elapsed().as_secs_f64() * 1e3
            })),
            Way::Rays(embree) => embree
                .trace(&eye.camera)
                .map(|frame| frame.ms)
                .map_err(|e| failed = Some(e))
                .ok(),
        });
        if let Some(error) = failed {
            return Err(ReportError::Rival(error));
        }
        by_way
            .iter_mut()
            .zip(&times)
            .for_each(|(all, times)| all.extend(least(times)));
    }
    let rays = by_way.pop().unwrap_or_default();
    let of_kernel = |(kernel, ms): (String, &Vec<f64>)| {
        let ratios: Vec<f64> = ms
            .iter()
            .zip(&rays)
            .map(|(ours, theirs)| ours / theirs)
            .collect();
        KernelAgainstRival {
            kernel,
            ms_median: median(ms.iter().copied()).unwrap_or(0.0),
            over_rays: median(ratios).unwrap_or(0.0),
        }
    };
    let kernels = names.into_iter().zip(&by_way).map(of_kernel).collect();
    Ok(Some(RivalRows {
        version,
        threads,
        ms_median: median(rays.iter().copied()).unwrap_or(0.0),
        kernels,
    }))
}
