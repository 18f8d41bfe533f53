//! Samples of a capture: the same bytes however it is run, bounded memory, and an honest estimate
//! of what is still missing.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use super::room::{
    Boxes, capture, capture_within, file_bytes, merged_from_shards, room, spec, spec_with,
};
use glam::{DVec3, dvec3};
use headbox_core::cube_face::Face;
use headbox_cube::model::parameters::{MergeRule, Sampler};
use headbox_ldi::accumulate::tile_store::TileStore;
use headbox_ldi::capture::SceneCapture;
use headbox_ldi::rays::trace_and_accumulate::blocked_share;
use headbox_ldi::spec::{CaptureSpec, RunOptions};
use headbox_scene::scene::{Lamp, Reach};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::sync::Arc;

#[test]
fn bytes_independent_of_threads_budget_shards() {
    let mut scene = Arc::unwrap_or_clone(room());
    scene.lamps.push(Lamp {
        intensity: [0.4; 3],
        reach: Reach::Point {
            position: dvec3(0.5, 0.6, 0.4),
            range_m: f32::INFINITY,
        },
    });
    let scene = Arc::new(scene);
    let spec = spec();
    let on_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| file_bytes(&capture(&spec, &scene)))
    };
    let expected = on_threads(1);
    assert!(expected == on_threads(2), "two threads");
    assert!(expected == on_threads(5), "five threads");
    let dir = tempfile::tempdir().unwrap();
    let budget = Some((1 << 20, dir.path().to_path_buf()));
    let spilled = capture_within(&spec, &scene, budget.clone());
    assert!(expected == file_bytes(&spilled), "spilled to disk");
    let merged = merged_from_shards(&spec, &scene, budget);
    assert!(expected == file_bytes(&merged), "four shards");
}

#[test]
fn every_sampler_and_rule_gives_valid_ldi() {
    let scene = room();
    for sampler in [
        Sampler::Stratified,
        Sampler::WhiteNoise,
        Sampler::CentreRays,
    ] {
        for merge_rule in [
            MergeRule::Average,
            MergeRule::SmallerArea,
            MergeRule::ColorsApart,
        ] {
            let ldi = capture(
                &spec_with(|p| (p.sampler, p.merge_rule) = (sampler, merge_rule)),
                &scene,
            );
            assert_eq!(ldi.validate(), Ok(()), "{sampler:?} {merge_rule:?}");
            let samples: usize = ldi.faces.iter().map(|face| face.samples.len()).sum();
            assert!(
                samples > 6 * 48 * 48 / 2,
                "{sampler:?} {merge_rule:?}: {samples}"
            );
            assert_eq!(ldi.environment.size_px, 0, "no ray leaves a closed room");
        }
    }
}

#[test]
fn centre_rays_keep_every_outer_hit() {
    let mut boxes = Boxes::default();
    let wall = boxes.material([0.7, 0.6, 0.5], [0.0; 3]);
    let shells = [0.2, 1.0, 2.0, 4.0];
    let boxes = shells.into_iter().fold(boxes, |boxes, half| {
        boxes.add(DVec3::ZERO, DVec3::splat(half), wall)
    });
    let ldi = capture(
        &spec_with(|p| p.sampler = Sampler::CentreRays),
        &Arc::new(boxes.0),
    );
    // Half a bin of parallax 1 px over sqrt(3) * 24 px and half-size 0.3 m.
    let tolerance = 1.0 / (3f32.sqrt() * 24.0 * 0.3);
    for (face, x, y) in
        (0..6 * 48 * 48).map(|i| (&ldi.faces[i / 48 / 48], i as u32 % 48, i as u32 / 48 % 48))
    {
        let found: Vec<f32> = face
            .pixel(x, y)
            .iter()
            .map(|sample| sample.inverse_depth)
            .collect();
        let off = |(q, depth): (&f32, f32)| (q - 1.0 / depth).abs();
        let right = found.len() == 3
            && found
                .iter()
                .zip([4.0, 2.0, 1.0])
                .all(|pair| off(pair) < tolerance);
        assert!(
            right,
            "S13: {:?} ({x}, {y}): {found:?}; the box inside the headbox is not seen",
            face.face
        );
    }
}

#[test]
fn depths_equal_walls() {
    let ldi = capture(&spec(), &room());
    // The ceiling, 1.5 m above, away from the lamp: every depth pixel of the +Y face's rim rows.
    let face = &ldi.faces[Face::PosY.index()];
    // Half a merged cluster: two bins of parallax 1 px over sqrt(3) * 24 px and half-size 0.3 m.
    let tolerance = 2.0 / (3f32.sqrt() * 24.0 * 0.3);
    let row: Vec<_> = (0..48).filter_map(|x| face.pixel(x, 2).last()).collect();
    assert!(row.len() > 40);
    for nearest in row {
        let wall_or_ceiling = [1.0 / 1.5, 1.0 / 2.0];
        let error = wall_or_ceiling
            .iter()
            .map(|q| (nearest.inverse_depth - q).abs())
            .fold(f32::INFINITY, f32::min);
        assert!(error < tolerance, "{}", nearest.inverse_depth);
    }
}

#[test]
fn missing_estimate_matches_fresh_rays() {
    let scene = room();
    for novelty in [0.0, 0.3] {
        let spec = spec_with(|p| p.novelty = novelty);
        let fresh_spec = spec_with(|p| (p.seed, p.rays_per_stratum, p.novelty) = (99, 4, 0.0));
        let tracer = Tracer::new(Arc::clone(&scene), spec.centre);
        let lighting = Lighting::unmetered(&tracer, 0);
        let options = RunOptions::default();
        let [known, fresh] = [&spec, &fresh_spec].map(|spec| {
            let capture = SceneCapture::new(spec, &tracer, &lighting, &options);
            capture.trace().unwrap()
        });
        let estimates = known.plan.missing_estimate(&known.store).unwrap();
        let estimate = estimates.iter().sum::<f64>() / 6.0;
        let new = unknown_rays(&fresh.store, &known.store) as f64 / fresh.rays as f64;
        assert!(
            estimate < 2.0 * new && new < 2.0 * estimate,
            "estimated {estimate}, found {new} (novelty {novelty})"
        );
    }
}

/// Number of rays in `fresh` that fell into depth bins that `known` does not have.
fn unknown_rays(fresh: &TileStore, known: &TileStore) -> u64 {
    let mut count = 0;
    for tile in 0..fresh.tile_count() {
        let have: std::collections::HashSet<_> = known
            .tile_run(tile)
            .unwrap()
            .iter()
            .map(|a| (a.link, a.bin))
            .collect();
        let run = fresh.tile_run(tile).unwrap();
        count += run
            .iter()
            .filter(|a| !have.contains(&(a.link, a.bin)))
            .map(|a| u64::from(a.count))
            .sum::<u64>();
    }
    count
}

#[test]
fn geometry_inside_headbox_is_reported() {
    let tracer = Tracer::new(room(), DVec3::ZERO);
    assert_eq!(blocked_share(&tracer, 0.3), 0.0);
    let inside = blocked_share(&tracer, 1.9);
    assert!(inside > 0.02 && inside < 0.6, "{inside}");
    let ldi = capture(
        &CaptureSpec {
            half_size_m: 1.9,
            ..spec()
        },
        &room(),
    );
    assert_eq!(ldi.validate(), Ok(()));
    assert!(ldi.info.blocked_share > 0.02);
}
