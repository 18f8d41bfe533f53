//! Stage 4: adaptive hole filling. Traces extra rays where test views show holes.
//!
//! Random rays find the last few samples of a wall late, and later still those that few of them can
//! reach; each missing sample is a speck in every frame that sees it. A round renders views from
//! all over the headbox with the renderer of all frames and traces a ray through the middle of each
//! pixel. A pixel that does not show the surface that its ray hits is *lacking*: the hit becomes a
//! sample like any other, at once, so that a round does not keep its hits (docs/decisions/0072).
//! The rounds end when the share of lacking pixels in views from new places, plus its standard
//! error, is at most
//! [`CaptureParameters::holes`](headbox_cube::model::parameters::CaptureParameters::holes).
//!
//! A round is a pure function of the accumulators before it and the seed: its views are compared
//! with the cube of those accumulators, and their hits add sums of integers to them. So the same
//! rays are aimed on any number of threads, within any memory budget, and after any merge of
//! shards.

mod test_view;

use crate::accumulate::tile_store::{InsertScratch, lock};
use crate::capture::{SceneCapture, stage};
use crate::rays::trace_and_accumulate::{HitRouter, TracedRays};
use crate::refine::test_view::{TestView, TestedViews, ViewTest};
use crate::surfaces::geometry_pass::GeometryCube;
use crate::surfaces::pixel_set::PixelSet;
use headbox_core::cube_face::Face;
use headbox_core::progress::check_cancelled;
use headbox_cube::model::info::Holes;
use headbox_cube::model::parameters::Sampler;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::render::Renderer;
use rayon::prelude::*;
use std::io;
use std::sync::{Mutex, PoisonError};

/// Number of views of a round from new places, which measure the share of lacking pixels.
const FRESH_VIEWS: u32 = 64;

/// Number of views of a round from places near those of the last round's worst views.
const NEAR_VIEWS: u32 = 64;

/// Maximum number of rounds.
const MAX_ROUNDS: u32 = 12;

/// Number of successive rounds that do not lower the least share so far by a tenth, after which the
/// search ends: rays cannot fill the rest.
const IDLE_ROUNDS: u32 = 2;

/// Aims rays at the lacking pixels of test views, and records the share of holes in `tracing`.
///
/// # Errors
/// If spilled accumulators cannot be read, or if the capture was cancelled.
pub(crate) fn fill_holes(capture: &SceneCapture, tracing: &mut TracedRays) -> io::Result<()> {
    let SceneCapture { spec, options, .. } = *capture;
    let limit = spec.parameters.holes;
    if limit >= 1.0 || spec.parameters.sampler == Sampler::CentreRays {
        return Ok(());
    }
    let mut geometry = None::<GeometryCube>;
    let mut share_before = None;
    let mut worst = Vec::new();
    let mut hit_pixels = Vec::new();
    let mut least = f64::INFINITY;
    let mut idle_rounds = 0;
    for round in 0..MAX_ROUNDS {
        options.progress.begin(
            stage::HOLES,
            "frames",
            u64::from(FRESH_VIEWS) + worst.len() as u64,
        );
        let geometry = match &mut geometry {
            None => geometry.insert(GeometryCube::build(capture, tracing)?),
            Some(geometry) => {
                geometry.update(capture, tracing, &hit_pixels)?;
                geometry
            }
        };
        // A cube that cannot be packed fails at the end of the capture, with its reason.
        let Ok(cube) = CubeLdi::pack(&geometry.cube, SplatIndexLayout::Normal, Split::Auto) else {
            return Ok(());
        };
        let search = HoleSearch::new(capture, tracing, &cube);
        let fresh = (0..FRESH_VIEWS)
            .filter_map(|i| TestView::fresh(spec, round * FRESH_VIEWS + i))
            .collect();
        let found = search.test_views(fresh)?;
        let share = found.share();
        let standard_error = found.standard_error();
        let share_before = *share_before.get_or_insert(share);
        idle_rounds = if share < 0.9 * least {
            0
        } else {
            idle_rounds + 1
        };
        least = least.min(share);
        let is_last = share + standard_error <= limit || idle_rounds == IDLE_ROUNDS;
        let mut aimed_rays = found.aimed_rays;
        if is_last {
            options.progress.advance(worst.len() as u64); // views that are not needed
        } else {
            aimed_rays += search.test_views(std::mem::take(&mut worst))?.aimed_rays;
        }
        worst = found
            .worst(NEAR_VIEWS as usize)
            .iter()
            .enumerate()
            .filter_map(|(i, view)| view.near(spec, i))
            .collect();
        hit_pixels = search.into_hit_pixels();
        tracing.rays += aimed_rays;
        tracing.holes = Some(Holes {
            share,
            standard_error,
            share_before,
            aimed_rays: aimed_rays + tracing.holes.map_or(0, |holes| holes.aimed_rays),
            rounds: round + 1,
        });
        if is_last {
            break;
        }
    }
    Ok(())
}

/// The search for holes in the views of one round.
struct HoleSearch<'a> {
    capture: &'a SceneCapture<'a>,
    tracing: &'a TracedRays,
    /// The cube before the round.
    cube: &'a CubeLdi,
    /// The pixels of each face that aimed rays have hit.
    hit_pixels: Mutex<Vec<PixelSet>>,
}

impl<'a> HoleSearch<'a> {
    fn new(capture: &'a SceneCapture, tracing: &'a TracedRays, cube: &'a CubeLdi) -> Self {
        let none = || PixelSet::new(capture.spec.face_size_px);
        Self {
            capture,
            tracing,
            cube,
            hit_pixels: Mutex::new(Face::ALL.map(|_| none()).into()),
        }
    }

    /// Renders views, compares them with rays, and adds the hits of rays through lacking pixels to
    /// the accumulators.
    fn test_views(&self, views: Vec<TestView>) -> io::Result<TestedViews> {
        let router = HitRouter::new(self.capture, &self.tracing.environment_mask);
        let test = ViewTest {
            cube: self.cube,
            router: &router,
            half_size_m: self.capture.spec.half_size_m,
        };
        let progress = self.capture.options.progress;
        let test_view = |(renderer, scratch): &mut (Renderer, InsertScratch), view: TestView| {
            check_cancelled(progress)?;
            let (share, aimed) = test.run(&view, renderer);
            self.tracing.store.insert(&aimed, scratch)?;
            let mut hit_pixels = lock(&self.hit_pixels);
            for sample in &aimed {
                hit_pixels[sample.face.index()].insert(sample.x.into(), sample.y.into());
            }
            progress.advance(1);
            Ok((share, view, aimed.len() as u64))
        };
        let tested: io::Result<Vec<_>> = views
            .into_par_iter()
            .map_init(Default::default, test_view)
            .collect();
        let mut all = TestedViews::default();
        for (share, view, aimed_rays) in tested? {
            all.views.push((share, view));
            all.aimed_rays += aimed_rays;
        }
        Ok(all)
    }

    fn into_hit_pixels(self) -> Vec<PixelSet> {
        self.hit_pixels
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner)
    }
}
