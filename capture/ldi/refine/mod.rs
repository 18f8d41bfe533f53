//! The capture looks at itself: frames from all over the headbox are held against rays, and where they show less than the
//! rays find, the rays are kept.
//!
//! Random rays find the last few samples of a wall late, and what few of them can reach later still; each sample that is missing
//! is a speck in every frame that looks there. Which are missing frames know best: a round draws some with the
//! renderer that users have, and a ray through the middle of each pixel says what should be there. Where it is not, the ray's
//! hit becomes a sample like any other. The rounds end when what is lacking in frames from new
//! places, with its standard error, is less than was asked for.
//!
//! A round is a pure function of the accumulators and the seed, and adds to them sums of integers. So whatever threads, budgets
//! and shards the random rays came from, the same rays are aimed.

mod test_view;

use crate::accumulate::tiles::InsertScratch;
use crate::job::CaptureJob;
use crate::rays::trace;
use crate::rays::trace::{Router, Tracing};
use crate::refine::test_view::{Findings, Look, VIEW_PX, View};
use crate::settings::Resources;
use crate::surfaces::geometry_pass::{Shape, ShapeSource};
use headbox_core::progress::{Progress, check_cancelled};
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::info::Holes;
use headbox_cube::model::parameters::Sampler;
use headbox_cube::model::samples::CubeLdi;
use headbox_cube::pack::{PackedCube, SplatIndexLayout, Split};
use headbox_cube::render::Renderer;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use rayon::prelude::*;
use std::io;
use std::time::{Duration, Instant};

/// Frames of a round from new places: what they lack is the round's figure.
const FRESH_VIEWS: u32 = 64;

/// Frames of a round from near the places of the last round's frames that lacked most.
const NEAR_VIEWS: u32 = 64;

/// More rounds than this are not made.
const MAX_ROUNDS: u32 = 12;

/// Rounds that may follow on each other without a share a tenth below the least so far: what is left then is not for rays to close.
const IDLE_ROUNDS: u32 = 2;

/// Pixels of the frames of a round.
pub fn pixels_of_a_round(job: &CaptureJob) -> f64 {
    f64::from(FRESH_VIEWS + NEAR_VIEWS) * f64::from(VIEW_PX.min(job.face_size_px)).powi(2)
}

/// Traces a job, looks for holes, lights and merges: all of a capture. Also the time that tracing took.
///
/// # Errors
/// If spilling fails, or the capture was given up.
pub fn capture(
    job: &CaptureJob,
    tracer: &Tracer,
    lighting: &Lighting,
    resources: &Resources,
    progress: &dyn Progress,
) -> io::Result<(CubeLdi, Duration)> {
    let start = Instant::now();
    let mut tracing = trace::trace(tracer, &job.settings(resources, (0, 1)), progress)?;
    let trace_time = start.elapsed();
    close(job, &mut tracing, tracer, lighting, progress)?;
    Ok((
        job.finish(&tracing, tracer, lighting, resources, progress)?,
        trace_time,
    ))
}

/// Aims rays at what frames of all the rays so far lack, and keeps the figure in `tracing`.
///
/// # Errors
/// If accumulators cannot be read, or the capture was given up.
pub fn close(
    job: &CaptureJob,
    tracing: &mut Tracing,
    tracer: &Tracer,
    lighting: &Lighting,
    progress: &dyn Progress,
) -> io::Result<()> {
    let limit = job.parameters.holes;
    if limit >= 1.0 || job.parameters.sampler == Sampler::CentreRays {
        return Ok(());
    }
    let (settings, patient) = (
        job.settings(&Resources::default(), (0, 1)),
        Patient(progress),
    );
    let source = ShapeSource {
        tracer,
        lighting,
        settings: &settings,
        progress: &patient,
    };
    let (mut shape, mut share_before) = (None::<Shape>, None);
    let (mut worst, mut aimed) = (Vec::new(), Vec::new());
    let (mut least, mut idle_rounds) = (f64::INFINITY, 0);
    for round in 0..MAX_ROUNDS {
        progress.begin(
            "look for holes",
            "frames",
            u64::from(FRESH_VIEWS) + worst.len() as u64,
        );
        let shape = match &mut shape {
            None => shape.insert(source.shape(tracing, job.shape_info(tracer, lighting))?),
            Some(shape) => {
                source.renew(shape, tracing, &aimed)?;
                shape
            }
        };
        // What cannot be packed fails at the end, with its reason.
        let Ok(cube) = PackedCube::pack(shape.cube(), SplatIndexLayout::Normal, Split::Auto) else {
            return Ok(());
        };
        let fresh = (0..FRESH_VIEWS)
            .filter_map(|i| View::fresh(job, round * FRESH_VIEWS + i))
            .collect();
        let found = look_at(job, tracing, tracer, &cube, fresh, progress)?;
        let (share, standard_error) = (found.share(), found.standard_error());
        let share_before = *share_before.get_or_insert(share);
        idle_rounds = if share < 0.9 * least {
            0
        } else {
            idle_rounds + 1
        };
        least = least.min(share);
        let is_enough = share + standard_error <= limit || idle_rounds == IDLE_ROUNDS;
        let aimed_rays = tracing.holes.map_or(0, |holes| holes.aimed_rays);
        let holes = Holes {
            share,
            standard_error,
            share_before,
            aimed_rays,
            rounds: round + 1,
        };
        tracing.holes = Some(holes);
        if is_enough {
            progress.advance(worst.len() as u64); // nobody needs them
            break;
        }
        let near = look_at(
            job,
            tracing,
            tracer,
            &cube,
            std::mem::take(&mut worst),
            progress,
        )?;
        worst = found
            .worst(NEAR_VIEWS as usize)
            .iter()
            .enumerate()
            .filter_map(|(i, view)| view.near(job, i))
            .collect();
        aimed = found.aimed;
        aimed.extend(near.aimed);
        tracing.holes = Some(Holes {
            aimed_rays: aimed_rays + aimed.len() as u64,
            ..holes
        });
        tracing
            .store
            .insert(&aimed, &mut InsertScratch::default())?;
        tracing.rays += aimed.len() as u64;
    }
    Ok(())
}

/// Draws frames, and holds them against rays.
fn look_at(
    job: &CaptureJob,
    tracing: &Tracing,
    tracer: &Tracer,
    cube: &PackedCube,
    views: Vec<View>,
    progress: &dyn Progress,
) -> io::Result<Findings> {
    let bins = DepthBins::new(job.half_size_m, job.face_size_px);
    let router = Router {
        tracer,
        bins,
        size_px: job.face_size_px,
        misses: &tracing.misses,
    };
    let look = Look {
        cube,
        router: &router,
        half_size_m: job.half_size_m,
    };
    let found: Result<Vec<Findings>, io::Error> = views
        .into_par_iter()
        .map_init(Renderer::new, |renderer, view| {
            check_cancelled(progress)?;
            let found = look.at(view, renderer);
            progress.advance(1);
            Ok(found)
        })
        .collect();
    Ok(found?.into_iter().fold(Findings::default(), Findings::and))
}

/// Passes on whether work was given up, and nothing else.
struct Patient<'a>(&'a dyn Progress);

impl Progress for Patient<'_> {
    fn begin(&self, _: &str, _: &str, _: u64) {}

    fn advance(&self, _: u64) {}

    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}
