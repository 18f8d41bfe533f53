//! Pixels of depth images a second into a cube LDI: images in memory, as the window has them when
//! it builds a cube anew (S24).
//!
//! 16 images of 640x480 of `builtin:castle` from a wall of cameras, unlit; `HEADBOX_IMAGES=DIR`
//! names another folder of images with depth, of which the 16 nearest to the middle are taken. On
//! one thread and on two.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::progress::Silent;
use headbox_images::traced_view;
use headbox_images::{ImageSet, ImageSetOptions, SetWriter};
use headbox_ldi::from_images::{ImageSetCapture, NearestImages};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Columns and rows of the wall of cameras.
const WALL: [u32; 2] = [4, 4];
const SIZE: [u32; 2] = [640, 480];

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
            Camera::look_at(eye, eye + DVec3::NEG_Z, DVec3::Y, 60.0, SIZE).expect("a camera");
        let view = traced_view::trace(&tracer, &lighting, false, &camera, 1, &Silent);
        set.add(i as usize, &view, true).expect("written");
    }
    set.finish().expect("written");
}

fn cubes(criterion: &mut Criterion) {
    let traced = tempfile::tempdir().expect("a folder");
    let folder =
        std::env::var_os("HEADBOX_IMAGES").map_or_else(|| traced.path().to_owned(), PathBuf::from);
    if folder == traced.path() {
        trace(&folder);
    }
    let set = ImageSet::open(&folder, &ImageSetOptions::default()).expect("opens");
    let middle = set
        .central_view()
        .and_then(|view| view.camera())
        .expect("pinholes");
    let job = ImageSetCapture::suggest(&set);
    let mut near = NearestImages::new(set, job, usize::MAX).expect("loads");
    let chosen = near.nearest(&middle, (WALL[0] * WALL[1]) as usize);
    let size = near.views()[chosen[0]].size_px;
    let mut group = criterion.benchmark_group("from_images");
    group.throughput(Throughput::Elements(
        chosen.len() as u64 * u64::from(size[0]) * u64::from(size[1]),
    ));
    group.sample_size(10);
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        let mut cube = || pool.install(|| near.cube(&chosen).expect("is in memory"));
        group.bench_function(format!("{threads}"), |bencher| bencher.iter(&mut cube));
    }
    group.finish();
}

criterion_group!(benches, cubes);
criterion_main!(benches);
