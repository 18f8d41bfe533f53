//! View-dependent geometry over very many images: what a frame's steps take, and a walk at sixty
//! frames a second that waits for no picture.
//!
//! `HEADBOX_IMAGES=DIR` names a folder of images with depth; without, a thousand small ones of
//! `builtin:castle` are traced first. `HEADBOX_SECONDS` is how long it walks (10), `HEADBOX_MEMORY`
//! the megabytes for pictures (200), `HEADBOX_CACHE` a folder in which samples stay from run to
//! run, so that memory is that of walking alone.

mod delays;

use delays::{Delays, resident_bytes};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::progress::Silent;
use headbox_images::traced_view;
use headbox_images::{ImageSet, ImageSetOptions, SetWriter, View};
use headbox_photos::view_geometry::{
    GeometryRenderer, GeometryResources, GeometrySettings, GeometryStats, TimeBudget, ViewGeometry,
    WaitPolicy,
};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Columns and rows of the wall of cameras that is traced.
const WALL: [u32; 2] = [40, 25];
const TRACED: [u32; 2] = [160, 120];

/// Time for a frame of the walk, ms, as in the window: cameras, grid and detail keep to it.
const BUDGET_MS: f64 = 33.0;

/// Frames of which it is told what kept them.
const LATEST: usize = 8;

/// Between frames of the walk.
const FRAME: Duration = Duration::from_micros(16_667);

fn number(name: &str, or: f64) -> f64 {
    std::env::var(name)
        .ok()
        .and_then(|text| text.parse().ok())
        .unwrap_or(or)
}

fn trace(folder: &Path) {
    let scene = Arc::new(headbox_scenes::build("castle", 0).expect("a built-in scene"));
    let headbox = scene.headbox.expect("it suggests one");
    let tracer = Tracer::new(scene, headbox.centre);
    let lighting = Lighting::measure(&tracer, 0);
    let mut set = SetWriter::new(folder);
    for i in 0..WALL[0] * WALL[1] {
        let off = |at: u32, of: u32| {
            (2.0 * f64::from(at) / f64::from(of - 1) - 1.0) * 0.9 * headbox.half_size_m
        };
        let eye =
            headbox.centre + DVec3::new(off(i % WALL[0], WALL[0]), off(i / WALL[0], WALL[1]), 0.0);
        let camera =
            Camera::look_at(eye, eye + DVec3::NEG_Z, DVec3::Y, 60.0, TRACED).expect("a camera");
        let view = traced_view::trace(&tracer, &lighting, false, &camera, 2, &Silent);
        set.add(i as usize, &view, true).expect("written");
    }
    set.finish().expect("written");
}

fn opened(set: &ImageSet, resources: &GeometryResources, title: &str) -> ViewGeometry {
    let views: Vec<&View> = set.views.iter().collect();
    let started = Instant::now();
    let geometry = ViewGeometry::open(set, &views, resources, &Silent).expect("opens");
    println!(
        "{title}: {:.0} ms, {:.1} MB in memory",
        started.elapsed().as_secs_f64() * 1e3,
        geometry.bytes() as f64 / 1e6
    );
    geometry
}

/// The camera of a place on a round past all others, from 0 to 1, that looks as they do.
fn on_the_way(geometry: &ViewGeometry, at: f64, [width, height]: [u32; 2]) -> Camera {
    let cameras = geometry.cameras();
    let place = at.rem_euclid(1.0) * (cameras.len() - 1) as f64;
    let [before, after] = [place.floor(), place.ceil()].map(|i| &cameras[i as usize]);
    let eye = before.pose.eye.lerp(after.pose.eye, place.fract());
    let focal_px =
        before.lens.focal_px[1] * f64::from(height) / (2.0 * before.lens.principal_px[1]);
    Camera::from_parts(eye, before.pose.world_from_eye, focal_px, width, height).expect("a camera")
}

/// The least time of each step over some frames.
fn best(
    renderer: &mut GeometryRenderer,
    geometry: &ViewGeometry,
    camera: &Camera,
) -> GeometryStats {
    let mut best: Option<GeometryStats> = None;
    for _ in 0..30 {
        let (_, now) = renderer.render(
            geometry,
            camera,
            &GeometrySettings::default(),
            WaitPolicy::Wait,
        );
        best = Some(best.map_or(now, |best| GeometryStats {
            rank_ms: best.rank_ms.min(now.rank_ms),
            fuse_ms: best.fuse_ms.min(now.fuse_ms),
            mesh_ms: best.mesh_ms.min(now.mesh_ms),
            texture_ms: best.texture_ms.min(now.texture_ms),
            frame_ms: best.frame_ms.min(now.frame_ms),
            ..now
        }));
    }
    best.unwrap_or_default()
}

/// A frame of the walk.
struct Walked {
    ms: f64,
    at_s: f64,
    stats: GeometryStats,
    delays: Delays,
}

fn walk(geometry: &ViewGeometry) {
    let (mut renderer, full) = (GeometryRenderer::new(), GeometrySettings::default());
    let mut budget = TimeBudget::new(BUDGET_MS);
    let (mut frames, mut most, mut resident, mut used) = (Vec::new(), 0, 0, 0);
    let (started, seconds) = (Instant::now(), number("HEADBOX_SECONDS", 10.0));
    while started.elapsed().as_secs_f64() < seconds {
        let (before, at_s) = (Delays::now(), started.elapsed().as_secs_f64());
        let frame = Instant::now();
        // Past all cameras in a minute, back and forth.
        let camera = on_the_way(geometry, at_s / 60.0, [1024, 768]);
        let (_, stats) = renderer.render(
            geometry,
            &camera,
            &budget.settings(&full),
            WaitPolicy::Never,
        );
        budget.took(stats.frame_ms);
        let ms = frame.elapsed().as_secs_f64() * 1e3;
        frames.push(Walked {
            ms,
            at_s,
            stats,
            delays: Delays::now().since(&before),
        });
        (most, resident) = (most.max(geometry.bytes()), resident.max(resident_bytes()));
        used += u64::from(stats.cameras_used > 0);
        std::thread::sleep(FRAME.saturating_sub(frame.elapsed()));
    }
    frames.sort_by(|a, b| a.ms.total_cmp(&b.ms));
    let of = |share: f64| {
        frames
            .get(((frames.len() - 1) as f64 * share) as usize)
            .map_or(f64::NAN, |frame| frame.ms)
    };
    println!(
        "walk: {} frames in {seconds:.0} s, {used} with a camera; ms: median {:.1}, 99 % {:.1}, latest {:.1}, {} over 100; {:.0} MB of pictures \
         and samples at most, {:.0} of the program",
        frames.len(),
        of(0.5),
        of(0.99),
        of(1.0),
        frames.iter().filter(|frame| frame.ms > 100.0).count(),
        most as f64 / 1e6,
        resident as f64 / 1e6
    );
    for Walked {
        ms,
        at_s,
        stats,
        delays,
    } in frames.iter().rev().take(LATEST)
    {
        println!(
            "{ms:.1} ms after {at_s:.1} s: rank {:.1}, fetch {:.1}, fuse {:.1}, mesh {:.1}, texture {:.1}; {} pictures to come; {delays}",
            stats.rank_ms,
            stats.fetch_ms,
            stats.fuse_ms,
            stats.mesh_ms,
            stats.texture_ms,
            stats.pictures_missing
        );
    }
}

fn main() {
    if !std::env::args().any(|argument| argument == "--bench") {
        return; // as a test it would trace for minutes
    }
    let made = tempfile::tempdir().expect("a folder");
    let folder = std::env::var_os("HEADBOX_IMAGES").map(PathBuf::from);
    if folder.is_none() {
        trace(made.path());
    }
    let folder = folder.unwrap_or_else(|| made.path().into());
    let set = ImageSet::open(&folder, &ImageSetOptions::default()).expect("a set");
    let kept = tempfile::tempdir().expect("a folder");
    let cache = std::env::var_os("HEADBOX_CACHE").map_or(kept.path().into(), PathBuf::from);
    let budget = (number("HEADBOX_MEMORY", 200.0) * 1e6) as usize;
    let resources = GeometryResources {
        budget,
        cache: Some(cache),
        ..GeometryResources::default()
    };
    opened(
        &set,
        &resources,
        &format!("{} images opened", set.views.len()),
    );
    let geometry = opened(&set, &resources, "opened again");
    let mut renderer = GeometryRenderer::new();
    for size in [[800, 600], [1024, 768]] {
        let stats = best(&mut renderer, &geometry, &on_the_way(&geometry, 0.37, size));
        println!(
            "{}x{}: ms: rank {:.3} ({} valid), fuse {:.2}, mesh {:.2} ({} nodes hold samples), texture {:.2}, frame {:.2}",
            size[0],
            size[1],
            stats.rank_ms,
            stats.cameras_valid,
            stats.fuse_ms,
            stats.mesh_ms,
            stats.nodes,
            stats.texture_ms,
            stats.frame_ms
        );
    }
    walk(&geometry);
}
