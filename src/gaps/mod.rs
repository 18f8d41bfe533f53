//! The capture looks at itself: frames from all over the headbox are held against rays, and where they show less than the
//! rays find, the rays are kept.
//!
//! Random rays find the last few samples of a wall late, and what few of them can reach later still; each sample that is missing
//! is a speck in every frame that looks there. Which are missing frames know best: a round draws [`VIEWS`] of them with the
//! renderer that users have, and a ray through the middle of each pixel says what should be there. Where it is not, the ray's
//! hit becomes a sample like any other. The rounds end when what is lacking, with its standard error, is less than was asked for.
//!
//! A round is a pure function of the accumulators and the seed, and adds to them sums of integers. So whatever threads, budgets
//! and shards the random rays came from, the same rays are aimed.

mod look;

use crate::capture::light::Lighting;
use crate::capture::trace::Tracer;
use crate::ldi::accumulate::DepthBins;
use crate::ldi::build::{self, Router, Tracing};
use crate::ldi::job::CaptureJob;
use crate::ldi::parameters::{Resources, Sampler};
use crate::ldi::store::InsertScratch;
use crate::ldi::{CubeLdi, Holes};
use crate::packed::{PackedCube, SplatIndexLayout, Split};
use crate::progress::{Progress, check_cancelled};
use crate::render::Renderer;
use look::{Findings, Look, View};
use rayon::prelude::*;
use std::io;
use std::time::{Duration, Instant};

/// Frames of a round.
const VIEWS: u32 = 96;

/// More rounds than this are not made.
const MAX_ROUNDS: u32 = 12;

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
    let mut tracing = build::trace(tracer, &job.settings(resources, (0, 1)), progress)?;
    let trace_time = start.elapsed();
    close(job, &mut tracing, tracer, lighting, progress)?;
    Ok((job.finish(&tracing, tracer, lighting, resources, progress)?, trace_time))
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
    let mut share_before = None;
    for round in 0..MAX_ROUNDS {
        let t0 = Instant::now();
        let shape = job.shape(tracing, tracer, lighting, &Patient(progress))?;
        let t1 = Instant::now();
        let cube = PackedCube::pack(&shape, SplatIndexLayout::Normal, Split::Auto);
        let Ok(cube) = cube else { return Ok(()) }; // what cannot be packed fails later, with its reason
        look::DBG.lock().unwrap().clear();
        *look::SHAPE.lock().unwrap() = Some(std::sync::Arc::new(shape));
        let t2 = Instant::now();
        progress.begin("look for holes", "frames", VIEWS.into());
        let found = look_round(job, tracing, tracer, &cube, round, progress)?;
        let share_before = *share_before.get_or_insert(found.share());
        let aimed_rays = tracing.holes.map_or(0, |holes| holes.aimed_rays);
        let (share, standard_error) = (found.share(), found.standard_error());
        tracing.holes = Some(Holes { share, standard_error, share_before, aimed_rays, rounds: round + 1 });
        { let d = look::DBG.lock().unwrap(); let c = |f: &dyn Fn(&(bool,u8,f32,f32,f32))->bool| d.iter().filter(|x| f(x)).count();
          eprintln!("lacking {} present {} of these uncovered {} | absent uncovered {} behind {} | present cos<0.1 {} | near(<2h) {}", d.len(), c(&|x| x.0), c(&|x| x.0 && x.1<128), c(&|x| !x.0 && x.1<128), c(&|x| !x.0 && x.1>=128), c(&|x| x.0 && x.3<0.1), c(&|x| x.0 && x.4 < 2.0));
          if round>3 { for x in d.iter().step_by(d.len()/25+1) { eprintln!("  {x:?}"); } } }
        eprintln!("round {round}: {:.5} % +- {:.5} aimed {} dp {} | shape {:?} pack {:?} look {:?}", share*100.0, standard_error*100.0, found.aimed.len(), cube.depth_pixel_count(), t1-t0, t2-t1, t2.elapsed());
        if share + standard_error < limit || found.aimed.is_empty() {
            break;
        }
        let aimed = found.aimed.len() as u64;
        tracing.store.insert(&found.aimed, &mut InsertScratch::default())?;
        tracing.rays += aimed;
        tracing.holes = tracing.holes.map(|holes| Holes { aimed_rays: aimed_rays + aimed, ..holes });
    }
    Ok(())
}

/// Draws the frames of a round, and holds them against rays.
fn look_round(
    job: &CaptureJob,
    tracing: &Tracing,
    tracer: &Tracer,
    cube: &PackedCube,
    round: u32,
    progress: &dyn Progress,
) -> io::Result<Findings> {
    let bins = DepthBins::new(job.half_size_m, job.face_size_px);
    let router = Router { tracer, bins, size_px: job.face_size_px, misses: &tracing.misses };
    let look = Look { cube, router: &router, half_size_m: job.half_size_m };
    let views: Vec<View> = (0..VIEWS).filter_map(|i| View::of_round(job, round * VIEWS + i)).collect();
    let found: Result<Vec<Findings>, io::Error> = views
        .par_iter()
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
