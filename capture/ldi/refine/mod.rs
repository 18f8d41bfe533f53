//! Stage 4: adaptive hole filling. Traces extra rays where test views show holes.
//!
//! Random rays find the last few samples of a wall late, and later still those that few of them can
//! reach; each missing sample is a speck in every frame that sees it. A round renders views from
//! all over the headbox with the renderer of all frames and traces a ray through the middle of each
//! pixel. A pixel that does not show the surface that its ray hits is *lacking*: the hit becomes a
//! sample like any other. The rounds end when the share of lacking pixels in views from new places,
//! plus its standard error, is at most
//! [`CaptureParameters::holes`](headbox_cube::model::parameters::CaptureParameters::holes).
//!
//! A round is a pure function of the accumulators and the seed, and adds sums of integers to them.
//! So the same rays are aimed on any number of threads, within any memory budget, and after any
//! merge of shards.

mod test_view;

use crate::accumulate::tile_store::InsertScratch;
use crate::capture::{SceneCapture, stage};
use crate::rays::trace_and_accumulate::{HitRouter, TracedRays};
use crate::refine::test_view::{TestView, ViewFindings, ViewTest};
use crate::surfaces::geometry_pass::GeometryCube;
use headbox_core::progress::check_cancelled;
use headbox_cube::model::info::Holes;
use headbox_cube::model::parameters::Sampler;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::render::Renderer;
use rayon::prelude::*;
use std::io;

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
    let mut aimed = Vec::new();
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
                geometry.update(capture, tracing, &aimed)?;
                geometry
            }
        };
        // A cube that cannot be packed fails at the end of the capture, with its reason.
        let Ok(cube) = CubeLdi::pack(&geometry.cube, SplatIndexLayout::Normal, Split::Auto) else {
            return Ok(());
        };
        let fresh = (0..FRESH_VIEWS)
            .filter_map(|i| TestView::fresh(spec, round * FRESH_VIEWS + i))
            .collect();
        let findings = test_views(capture, tracing, &cube, fresh)?;
        let share = findings.share();
        let standard_error = findings.standard_error();
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
            options.progress.advance(worst.len() as u64); // views that are not needed
            break;
        }
        let near_findings = test_views(capture, tracing, &cube, std::mem::take(&mut worst))?;
        worst = findings
            .worst(NEAR_VIEWS as usize)
            .iter()
            .enumerate()
            .filter_map(|(i, view)| view.near(spec, i))
            .collect();
        aimed = findings.aimed;
        aimed.extend(near_findings.aimed);
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

/// Renders views and compares them with rays.
fn test_views(
    capture: &SceneCapture,
    tracing: &TracedRays,
    cube: &CubeLdi,
    views: Vec<TestView>,
) -> io::Result<ViewFindings> {
    let router = HitRouter::new(capture, &tracing.environment_mask);
    let test = ViewTest {
        cube,
        router: &router,
        half_size_m: capture.spec.half_size_m,
    };
    let progress = capture.options.progress;
    let findings: io::Result<Vec<ViewFindings>> = views
        .into_par_iter()
        .map_init(Renderer::new, |renderer, view| {
            check_cancelled(progress)?;
            let findings = test.run(view, renderer);
            progress.advance(1);
            Ok(findings)
        })
        .collect();
    Ok(findings?
        .into_iter()
        .fold(ViewFindings::default(), ViewFindings::join))
}
