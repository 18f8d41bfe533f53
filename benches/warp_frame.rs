//! One frame of 1024x768: milliseconds and depth pixels per second for each splat kernel, on one thread and on two, and
//! what clipping saves; and what the papers' parallel warp (fragments between epipolar lines) takes against bands. First of
//! all, what a pixel of sky takes on one thread, at every SIMD level.
//!
//! * `cube`: about 1.1 M depth pixels on six faces; a fifth of them is in view.
//! * `face`: about 1.1 M depth pixels on one face, nearly all in view, as in the paper's tree.

#[path = "../tests/common/mod.rs"]
mod common;

use common::bed::{Scene, room};
use common::capture::one_layer;
use criterion::{Criterion, criterion_group, criterion_main};
use glam::{DVec3, dvec3};
use headbox::capture::rig::Face;
use headbox::capture::{Camera, simd};
use headbox::environment::Environment;
use headbox::ldi::{CubeLdi, DepthPixel, EncodedNormal};
use headbox::packed::{PackedCube, SplatIndexLayout, Split};
use headbox::render::splat::SplatKernel;
use headbox::render::{FrameStats, Parallel, RenderSettings, Renderer};

/// The first surface that each pixel's ray meets.
fn pierced(scene: &Scene, face_px: u32, faces: &[Face]) -> CubeLdi {
    one_layer(DVec3::ZERO, face_px, faces, |face, x, y| {
        let hit = scene.hit(DVec3::ZERO, face.direction(x, y, face_px))?;
        let [r, g, b] = hit.color.map(|c| (c * 255.0) as u8);
        let normal = EncodedNormal::new(hit.normal.as_vec3());
        Some(DepthPixel { inverse_depth: (1.0 / hit.t) as f32, normal, color_srgb: [r, g, b, 255] })
    })
}

fn frames(criterion: &mut Criterion) {
    let scene = room(24.0);
    for (name, ldi) in [("cube", pierced(&scene, 428, &Face::ALL)), ("face", pierced(&scene, 1049, &[Face::NegZ]))] {
        let eye = dvec3(0.21, -0.13, 0.17);
        let fov = if name == "cube" { 60.0 } else { 80.0 };
        let camera = Camera::look_at(eye, dvec3(0.1, 0.0, -3.0), DVec3::Y, fov, [1024, 768]).expect("valid");
        for layout in [SplatIndexLayout::Paper, SplatIndexLayout::Normal] {
            let cube = PackedCube::pack(&ldi, layout, Split::Auto).expect("packs");
            for kernel in [SplatKernel::Paper, SplatKernel::Opaque, SplatKernel::Tent] {
                let settings = RenderSettings { kernel, ..RenderSettings::default() };
                let mut of_one_thread = None;
                for threads in [1, 2] {
                    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                    let mut renderer = Renderer::new();
                    let title = format!("warp_frame/{name}/{layout:?}/{kernel:?}/{threads}");
                    let clipped = best(&pool, &mut renderer, &cube, &camera, &settings);
                    let all = RenderSettings { unclipped: true, ..settings };
                    let unclipped = best(&pool, &mut renderer, &cube, &camera, &all);
                    println!(
                        "{title}: {:.2} ms, {:.0} M depth pixels/s of {} in; unclipped {:.2} ms, {} in; imbalance {:.2}",
                        clipped.frame_ms,
                        clipped.depth_pixels_in as f64 / clipped.frame_ms / 1e3,
                        clipped.depth_pixels_in,
                        unclipped.frame_ms,
                        unclipped.depth_pixels_in,
                        clipped.imbalance,
                    );
                    let parallel = Parallel::Fragments(0);
                    let fragments =
                        best(&pool, &mut renderer, &cube, &camera, &RenderSettings { parallel, ..settings });
                    let [bands_of_one, fragments_of_one] =
                        *of_one_thread.get_or_insert([clipped.frame_ms, fragments.frame_ms]);
                    println!(
                        "{title}: fragments {:.2} ms, {:.2} times bands; faster than on one thread: fragments {:.2}, bands \
                         {:.2}; {:.2} % of pixels and {:.2} % of depth pixels in the second pass; imbalance {:.2}",
                        fragments.frame_ms,
                        fragments.frame_ms / clipped.frame_ms,
                        fragments_of_one / fragments.frame_ms,
                        bands_of_one / clipped.frame_ms,
                        fragments.redone_pixels as f64 / (1024.0 * 768.0) * 100.0,
                        fragments.redone_depth_pixels as f64 / fragments.depth_pixels_in as f64 * 100.0,
                        fragments.imbalance,
                    );
                    criterion.bench_function(&title, |b| {
                        b.iter(|| pool.install(|| renderer.render_with_stats(&cube, &camera, &settings).1.hole_pixels));
                    });
                }
            }
        }
    }
}

/// Nothing but environment: nanoseconds a pixel from canvas to frame, and of the whole frame, in the fastest of thirty frames
/// that look at one face, across an edge, and at a corner.
fn sky(_: &mut Criterion) {
    const SIZE_PX: u32 = 256;
    let mut cube =
        PackedCube::pack(&pierced(&room(24.0), SIZE_PX, &[]), SplatIndexLayout::Normal, Split::Auto).expect("packs");
    let texel = |i: u32| [(i * 7) as u8, (i / SIZE_PX) as u8, (i / 3) as u8, 255];
    cube.environment = Environment { size_px: SIZE_PX, texels: (0..6 * SIZE_PX * SIZE_PX).map(texel).collect() };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("threads");
    for (name, at) in
        [("face", dvec3(0.1, 0.05, -1.0)), ("edge", dvec3(1.0, 0.1, -1.0)), ("corner", dvec3(1.0, 1.0, -0.9))]
    {
        let camera = Camera::look_at(DVec3::ZERO, at, DVec3::Y, 60.0, [1024, 768]).expect("valid");
        for level in simd::levels() {
            let mut renderer = Renderer::with_level(level);
            let settings = RenderSettings { kernel: SplatKernel::Opaque, ..RenderSettings::default() };
            let stats = best(&pool, &mut renderer, &cube, &camera, &settings);
            let per_pixel = |ms: f64| ms * 1e6 / (1024.0 * 768.0);
            let (finish, frame) = (per_pixel(stats.finish_ms), per_pixel(stats.frame_ms));
            println!("sky/{name}/{}: {finish:.2} ns a pixel, {frame:.2} of the whole frame", simd::name(level));
        }
    }
}

/// The fastest of thirty frames.
fn best(
    pool: &rayon::ThreadPool,
    renderer: &mut Renderer,
    cube: &PackedCube,
    camera: &Camera,
    settings: &RenderSettings,
) -> FrameStats {
    let mut frame = || *pool.install(|| renderer.render_with_stats(cube, camera, settings)).1;
    (1..30).fold(frame(), |best, _| {
        let next = frame();
        if next.frame_ms < best.frame_ms { next } else { best }
    })
}

criterion_group! {
    name = warp_frame;
    config = Criterion::default().sample_size(10).measurement_time(std::time::Duration::from_secs(1));
    targets = sky, frames
}
criterion_main!(warp_frame);
