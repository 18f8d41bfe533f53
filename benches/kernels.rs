//! Time against error of every kernel, 1024x768: captured scenes from six seeded eyes, against
//! ray-traced truth, which is kept from run to run; stages of a frame, gain of a second thread, a
//! headset's two frames of 1024x1024, and Embree's primary rays of the same eyes where
//! `HEADBOX_EMBREE` names the program of `benches/rivals/embree.cpp`.
//!
//! `HEADBOX_BENCH_LDI=a.ldi:b.ldi HEADBOX_BENCH_KERNELS=tent,opaque HEADBOX_BENCH_SAMPLES=64 cargo
//! bench --bench kernels`; the scenes of the files must still be where they were.
//! `HEADBOX_BENCH_SAMPLES=0` leaves errors out, `HEADBOX_BENCH_BAND_ROWS=128` chooses the height of
//! bands.

use headbox_core::camera::Camera;
use headbox_core::metrics;
use headbox_core::progress::Silent;
use headbox_core::statistics::median;
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_cube::render::{FrameStats, RenderSettings, Renderer};
use headbox_lab::embree::{Embree, PROGRAM};
use headbox_lab::plan::{Plan, Quality, axis_with_most_geometry};
use headbox_lab::stats::{mean, pooled_psnr_db};
use headbox_lab::truths::Truths;
use headbox_lab::turns::{least, run_in_turns};
use headbox_ldi::scene_source::SceneSource;
use headbox_photos::cache;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use image::RgbImage;
use std::path::Path;
use std::sync::Arc;

const QUALITY: Quality = Quality {
    uniform_eyes: 3,
    line_eyes: 3,
    path_eyes: 0,
    ..Quality::REAL
};
const ROUNDS: u32 = 7;

/// The frames of a headset: distance of its eyes, metres, pixels a side, and focal length of 90
/// degrees.
const EYES_APART_M: f64 = 0.064;
const HEADSET_PX: u32 = 1024;
const HEADSET_FOCAL_PX: f64 = 512.0;

fn variable(name: &str, default: &str) -> String {
    std::env::var(name).unwrap_or_else(|_| default.to_owned())
}

/// The kernels that are asked for; of all, those that are no stamps.
fn kernels() -> Vec<SplatKernel> {
    let names = variable("HEADBOX_BENCH_KERNELS", "tent,opaque,paper,ellipse");
    names
        .split(',')
        .filter_map(SplatKernel::from_name)
        .collect()
}

/// The middle quarter of a frame, in which errors are measured: truth is dear.
fn middle(camera: &Camera) -> Camera {
    let [width, height] = [camera.width() / 2, camera.height() / 2];
    Camera::from_parts(
        camera.eye(),
        camera.world_from_eye(),
        camera.focal_px(),
        width,
        height,
    )
    .expect("valid")
}

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("threads")
}

/// Milliseconds of the fastest of some pairs of frames for a headset whose wearer looks as a camera
/// does.
fn pair(
    pool: &rayon::ThreadPool,
    cube: &CubeLdi,
    camera: &Camera,
    settings: &RenderSettings,
) -> f64 {
    let eyes = [-0.5, 0.5].map(|side| {
        let aside = camera.world_from_eye() * glam::DVec3::X * (EYES_APART_M * side);
        let at = camera.eye() + aside;
        Camera::from_parts(
            at,
            camera.world_from_eye(),
            HEADSET_FOCAL_PX,
            HEADSET_PX,
            HEADSET_PX,
        )
        .expect("valid")
    });
    let mut renderer = Renderer::new();
    let mut both = || -> f64 {
        let mut frame = |eye: &Camera| renderer.render_with_stats(cube, eye, settings).1.frame_ms;
        pool.install(|| eyes.iter().map(&mut frame).sum())
    };
    (0..ROUNDS).map(|_| both()).fold(f64::INFINITY, f64::min)
}

/// The fastest of some frames.
fn fastest(
    pool: &rayon::ThreadPool,
    renderer: &mut Renderer,
    frame: impl Fn(&mut Renderer) -> FrameStats + Sync,
) -> FrameStats {
    let mut next = || pool.install(|| frame(&mut *renderer));
    (0..ROUNDS)
        .map(|_| next())
        .min_by(|a, b| a.frame_ms.total_cmp(&b.frame_ms))
        .expect("rounds")
}

fn main() {
    let samples: u32 = variable("HEADBOX_BENCH_SAMPLES", "64")
        .parse()
        .expect("a number");
    for path in variable("HEADBOX_BENCH_LDI", "")
        .split(':')
        .filter(|path| !path.is_empty())
    {
        let cube = CubeLdi::read(Path::new(path)).expect("an .ldi file");
        let scene = SceneSource::in_frame(&cube.info.scene, cube.info.frame)
            .open()
            .expect("its scene");
        let tracer = Arc::new(Tracer::new(Arc::new(scene), cube.info.centre));
        let lighting = Lighting::measure(&tracer, cube.info.parameters.bounces);
        let ahead = axis_with_most_geometry(&tracer, cube.info.centre);
        let plan =
            Plan::new(QUALITY, cube.info.centre, cube.info.half_size_m, ahead, 0).expect("a plan");
        let folder = cache::folder("truth")
            .inspect(|folder| std::fs::create_dir_all(folder).expect("a folder"));
        let truths = Truths::new(
            &tracer,
            &lighting,
            cube.info.parameters.light_samples > 0,
            folder,
        );
        let truth: Vec<RgbImage> = match samples {
            0 => Vec::new(),
            _ => plan
                .eyes
                .iter()
                .map(|eye| truths.frame(&middle(&eye.camera), samples, &Silent).rgb())
                .collect(),
        };
        let rays = rays(&tracer, &plan);
        println!(
            "{path}: {} depth pixels; Embree's rays {}",
            cube.depth_pixel_count(),
            rays.map_or("-".into(), |ms| format!("{ms:.2} ms"))
        );
        println!(
            "kernel | ms | one thread | gain | clear | warp | finish | in k | splatted k | holes | in k, two threads | imbalance | PSNR, each | PSNR | FLIP | over rays | both eyes of a headset"
        );
        let pools = [pool(1), pool(2)];
        for kernel in kernels() {
            row(&cube, kernel, &plan, &truth, rays, &pools);
        }
    }
}

/// Embree's milliseconds: median over eyes.
fn rays(tracer: &Tracer, plan: &Plan) -> Option<f64> {
    let program = std::env::var_os(PROGRAM)?;
    let mut ways = [Embree::start(&program, tracer, 2).expect("the rival")];
    let of_eye = |eye: &headbox_lab::plan::Eye| {
        let times = run_in_turns(&mut ways, ROUNDS, |_, embree| {
            embree.trace(&eye.camera).ok().map(|frame| frame.ms)
        });
        least(&times[0])
    };
    median(plan.eyes.iter().filter_map(of_eye).collect::<Vec<_>>())
}

fn row(
    cube: &CubeLdi,
    kernel: SplatKernel,
    plan: &Plan,
    truth: &[RgbImage],
    rays: Option<f64>,
    [one, two]: &[rayon::ThreadPool; 2],
) {
    let band_rows = variable("HEADBOX_BENCH_BAND_ROWS", "0")
        .parse()
        .expect("a number");
    let settings = RenderSettings {
        kernel,
        band_rows,
        ..RenderSettings::default()
    };
    let mut renderer = Renderer::new();
    let (mut of_one, mut of_two, mut errors) = (Vec::new(), Vec::new(), Vec::new());
    for (i, eye) in plan.eyes.iter().enumerate() {
        let frame =
            |renderer: &mut Renderer| *renderer.render_with_stats(cube, &eye.camera, &settings).1;
        of_one.push(fastest(one, &mut renderer, frame));
        of_two.push(fastest(two, &mut renderer, frame));
        if let Some(truth) = truth.get(i) {
            let shown = renderer
                .render(cube, &middle(&eye.camera), &settings)
                .to_rgb()
                .expect("a picture");
            if let Some(folder) = std::env::var_os("HEADBOX_BENCH_PICTURES") {
                let folder = Path::new(&folder);
                shown
                    .save(folder.join(format!("{}-{i}.png", kernel.name())))
                    .expect("written");
                truth
                    .save(folder.join(format!("truth-{i}.png")))
                    .expect("written");
            }
            errors.push(metrics::compare(truth, &shown).expect("of one size"));
        }
    }
    let of = |all: &[FrameStats], value: fn(&FrameStats) -> f64| {
        median(all.iter().map(value).collect::<Vec<_>>()).unwrap_or(0.0)
    };
    let (ms, ms_of_one) = (of(&of_two, |s| s.frame_ms), of(&of_one, |s| s.frame_ms));
    let gain = median(
        of_one
            .iter()
            .zip(&of_two)
            .map(|(one, two)| one.frame_ms / two.frame_ms)
            .collect::<Vec<_>>(),
    )
    .unwrap_or(0.0);
    let pairs = plan
        .eyes
        .iter()
        .map(|eye| pair(two, cube, &eye.camera, &settings));
    let pair_ms = median(pairs.collect::<Vec<_>>()).unwrap_or(0.0);
    let each: Vec<String> = errors.iter().map(|e| format!("{:.2}", e.psnr_db)).collect();
    println!(
        "{} | {ms:.2} | {ms_of_one:.2} | {gain:.2} | {:.2} | {:.2} | {:.2} | {:.0} | {:.0} | {:.0} | {:.0} | {:.2} | {} | {:.2} | {:.4} | {:.2} | {pair_ms:.2}",
        kernel.name(),
        of(&of_one, |s| s.clear_ms),
        of(&of_one, |s| s.warp_ms),
        of(&of_one, |s| s.finish_ms),
        of(&of_one, |s| s.depth_pixels_in as f64 / 1e3),
        of(&of_one, |s| s.splatted as f64 / 1e3),
        of(&of_one, |s| s.hole_pixels as f64),
        of(&of_two, |s| s.depth_pixels_in as f64 / 1e3),
        of(&of_two, |s| s.imbalance),
        each.join(" "),
        pooled_psnr_db(errors.iter().map(|e| e.psnr_db)),
        mean(errors.iter().map(|e| e.flip)),
        ms / rays.unwrap_or(f64::NAN),
    );
}
