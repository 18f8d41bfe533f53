//! Triangles and pixels per second of the rasteriser on one thread and on two: `builtin:tree` seen
//! whole (every triangle a pixel or two), and the furnished room of `builtin:interior`.
//!
//! For comparison: OpenCV 5 states 18 M triangles/s for `triangleRasterize` on one thread.

use criterion::{Criterion, criterion_group, criterion_main};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::color::tone::ToneMap;
use headbox_core::environment::Environment;
use headbox_raster::{GroupWindow, RasterMesh, RasterStats, RasterView, Rasterizer};
use std::sync::Arc;

fn frames(criterion: &mut Criterion) {
    for name in ["tree", "interior"] {
        let scene = Arc::new(headbox_scenes::build(name, 0).expect("a built-in scene"));
        let [low, high] = scene.bounds();
        let (eye, at) = match scene.headbox {
            Some(box_) if name != "tree" => {
                (box_.centre, box_.centre + DVec3::new(1.0, -0.1, -0.6))
            }
            Some(box_) => (box_.centre, DVec3::new(0.0, 4.0, 0.0)),
            None => (high, (low + high) / 2.0),
        };
        let mesh = RasterMesh::new(
            Arc::clone(&scene),
            std::slice::from_ref(&(0..scene.triangles.len() as u32)),
            eye,
        );
        let groups = [GroupWindow {
            group: 0,
            window: None,
        }];
        let view = RasterView {
            groups: &groups,
            markers: &[],
            exposure: 1.0,
            tone: ToneMap::SrgbClipped,
            hole_color_srgb: [0; 3],
        };
        for (width, height) in [(640, 512), (1280, 720)] {
            let camera = Camera::look_at(eye, at, DVec3::Y, 60.0, [width, height]).expect("valid");
            for threads in [1, 2] {
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .expect("threads");
                let mut rasterizer = Rasterizer::new();
                let mut frame = || {
                    *pool.install(|| {
                        rasterizer
                            .draw(&mesh, &camera, &view, &Environment::default())
                            .1
                    })
                };
                let best = (1..20).fold(frame(), |best: RasterStats, _| {
                    let next = frame();
                    if next.frame_ms < best.frame_ms {
                        next
                    } else {
                        best
                    }
                });
                let title = format!("raster/{name}/{width}x{height}/{threads}");
                println!(
                    "{title}: {:.2} ms, {:.1} M triangles/s in kept clusters ({} of {}; {} set up), {:.0} Mpixel/s",
                    best.frame_ms,
                    best.triangles_kept as f64 / best.frame_ms / 1e3,
                    best.triangles_kept,
                    best.triangles_in,
                    best.triangles_set_up,
                    f64::from(width * height) / best.frame_ms / 1e3,
                );
                criterion.bench_function(&title, |b| b.iter(&mut frame));
            }
        }
    }
}

criterion_group! {
    name = raster;
    config = Criterion::default().sample_size(10).measurement_time(std::time::Duration::from_secs(1));
    targets = frames
}
criterion_main!(raster);
