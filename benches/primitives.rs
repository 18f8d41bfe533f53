//! What pictures on planes cost, save and show:
//! `cargo bench --bench primitives -- FILE.ldi... [--error-px E] [--repeat N] [--pictures DIR] [--truth SAMPLES]`.
//! With `--truth`, frames from six seeded eyes are held against ray-traced ones of so many samples, kept in DIR; the pictures
//! there are all-LDI, automatic, truth, and below the two's differences from truth, five times as large, and what planes show.

#![allow(missing_docs, reason = "a benchmark is run, not read as a library")]

use headbox::capture::Camera;
use headbox::capture::light::Lighting;
use headbox::capture::random::Rng;
use headbox::capture::rig::Face;
use headbox::capture::trace::Tracer;
use headbox::metrics::compare;
use headbox::packed::{PackedCube, Split};
use headbox::primitives;
use headbox::progress::Silent;
use headbox::render::{RenderSettings, Renderer};
use headbox::scene_source::SceneSource;
use headbox::truth;
use image::{Rgb, RgbImage};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

fn main() {
    let (mut files, mut error_px, mut pictures, mut repeat, mut samples) = (Vec::new(), 0.5, None, 9, 0);
    let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--error-px" => error_px = args.next().and_then(|v| v.parse().ok()).expect("a number"),
            "--repeat" => repeat = args.next().and_then(|v| v.parse().ok()).expect("a number"),
            "--truth" => samples = args.next().and_then(|v| v.parse().ok()).expect("a number"),
            "--pictures" => pictures = args.next().map(PathBuf::from),
            _ => files.push(PathBuf::from(arg)),
        }
    }
    files.iter().for_each(|file| {
        let [all, mixed] = study(file, error_px, repeat, pictures.as_deref());
        if let (1.., Some(folder)) = (samples, &pictures) {
            let stem = file.file_stem().and_then(|s| s.to_str()).unwrap_or("x");
            compare_with_truth(&all, &mixed, samples, &folder.join(stem));
        }
    });
}

fn study(file: &Path, error_px: f64, repeat: usize, pictures: Option<&Path>) -> [PackedCube; 2] {
    let all = PackedCube::read(file).expect("a cube LDI");
    let ldi = all.unpack();
    let started = Instant::now();
    let mixed = primitives::pack(ldi, all.layout, Split::None, error_px).expect("packs");
    let choosing = started.elapsed();
    let set = &mixed.planes;
    println!("{}: chosen and packed in {choosing:.1?}", file.display());
    println!(
        "  {} samples: {} on {} planes ({:.1} %), {} left; {} tiles, {} texels",
        all.depth_pixel_count(),
        set.samples,
        set.planes.len(),
        100.0 * set.samples as f64 / all.depth_pixel_count() as f64,
        mixed.depth_pixel_count(),
        set.tiles.len(),
        set.texels.len()
    );
    let written = |cube: &PackedCube| {
        let path = std::env::temp_dir().join(format!("headbox-primitives-{}.ldi", std::process::id()));
        cube.write(&path).expect("written");
        let bytes = std::fs::metadata(&path).expect("there").len();
        assert_eq!(PackedCube::read(&path).expect("reads").planes, cube.planes);
        std::fs::remove_file(&path).expect("removed");
        bytes
    };
    let files = [written(&all), written(&mixed)];
    println!("  file bytes: {} -> {} ({:.2})", files[0], files[1], files[1] as f64 / files[0] as f64);
    println!(
        "  bytes in memory: {} -> {} ({:.2}), planes {}",
        all.bytes(),
        mixed.bytes(),
        mixed.bytes() as f64 / all.bytes() as f64,
        set.bytes()
    );
    let mut renderers = [Renderer::new(), Renderer::new()];
    let (centre, half) = (all.info.centre, all.info.half_size_m);
    for (i, (face, at)) in
        [(Face::NegZ, 0.0), (Face::PosX, 0.6), (Face::NegX, -0.9), (Face::PosZ, 0.9)].into_iter().enumerate()
    {
        let eye = centre + glam::DVec3::new(at, at * 0.4, -at) * half;
        let to = eye + face.normal() + glam::DVec3::new(0.2, -0.15, 0.1);
        let camera = Camera::look_at(eye, to, glam::DVec3::Y, 60.0, [1024, 768]).expect("valid");
        let mut times = [Vec::new(), Vec::new()];
        let mut stats = [Default::default(); 2];
        for _ in 0..repeat {
            for (k, cube) in [&all, &mixed].into_iter().enumerate() {
                let started = Instant::now();
                stats[k] = *renderers[k].render_with_stats(cube, &camera, &RenderSettings::default()).1;
                times[k].push(started.elapsed().as_secs_f64() * 1e3);
            }
        }
        times.iter_mut().for_each(|t| t.sort_by(f64::total_cmp));
        let [a, b] = [times[0][repeat / 2], times[1][repeat / 2]];
        let [_, s] = stats;
        println!(
            "  view {i}: {a:.2} ms -> {b:.2} ms ({:.2}); clear+planes {:.2} warp {:.2} finish {:.2}; samples in {}, holes {}",
            b / a,
            s.clear_ms,
            s.warp_ms,
            s.finish_ms,
            s.depth_pixels_in,
            s.hole_pixels
        );
        if let Some(folder) = pictures {
            std::fs::create_dir_all(folder).expect("a folder");
            let stem = file.file_stem().and_then(|s| s.to_str()).unwrap_or("x");
            for (renderer, name) in renderers.iter().zip(["all", "mixed"]) {
                let png = renderer.frame().to_png().expect("encodes");
                std::fs::write(folder.join(format!("{stem}-{i}-{name}.png")), png).expect("writes");
            }
        }
    }
    [all, mixed]
}

/// Eyes that frames are compared from.
const EYES: usize = 6;

/// Prints how far frames are from truth, of all samples and with planes.
fn compare_with_truth(all: &PackedCube, mixed: &PackedCube, samples: u32, stem: &Path) {
    let source = SceneSource::in_frame(all.info.scene.clone(), all.info.frame);
    let tracer = Tracer::new(Arc::new(source.open().expect("the scene it was captured from")), all.info.centre);
    let is_lit = all.info.parameters.light_samples > 0;
    let lighting = Lighting::prepare(&tracer, all.info.parameters.bounces, is_lit);
    let mut planes = mixed.clone();
    planes.segments.clear();
    let (width, height) = (all.face_size_px, all.face_size_px * 3 / 4);
    let mut random = Rng::new(11);
    let mut sums = [[0.0; 2]; 2];
    for i in 0..EYES {
        let eye = all.info.centre + random.in_cube(all.info.half_size_m * 0.9);
        let yaw = i as f64 * 0.618_033_988_75 * std::f64::consts::TAU;
        let forward = glam::dvec3(yaw.cos(), random.between(-0.3, 0.3), yaw.sin());
        let camera = Camera::look_at(eye, eye + forward, glam::DVec3::Y, 60.0, [width, height]).expect("valid");
        let kept = stem.with_extension(format!("{i}.truth-{width}-{samples}.png"));
        let truth = match image::open(&kept) {
            Ok(picture) => picture.to_rgb8(),
            Err(_) => {
                let found = truth::render(&tracer, &lighting, is_lit, &camera, samples, &Silent).rgb();
                found.save(&kept).expect("writes");
                found
            }
        };
        let draw = |cube| Renderer::new().render(cube, &camera, &RenderSettings::default()).clone();
        let frames = [all, mixed].map(|cube| draw(cube).to_rgb().expect("a picture"));
        let of_planes = draw(&planes);
        let shown = |k: usize| {
            of_planes.coverage[k].splat_share() == 255
                && of_planes.color[k][..3] == frames[1].as_raw()[3 * k..3 * k + 3]
        };
        let count = (width * height) as usize;
        let share = (0..count).filter(|k| shown(*k)).count() as f64 / count as f64;
        let mut text = String::new();
        for (k, frame) in frames.iter().enumerate() {
            let figures = compare(&truth, frame).expect("equal sizes");
            sums[k][0] += figures.psnr_db / EYES as f64;
            sums[k][1] += figures.flip / EYES as f64;
            let error = |of: bool| -> f64 {
                let pixels = (0..count).filter(|k| shown(*k) == of);
                pixels
                    .map(|k| {
                        (0..3)
                            .map(|c| f64::from(frame.as_raw()[3 * k + c].abs_diff(truth.as_raw()[3 * k + c])).powi(2))
                            .sum::<f64>()
                    })
                    .sum::<f64>()
                    / count as f64
                    / 3.0
            };
            text += &format!(
                "  {:.2} dB, FLIP {:.4}, squared error {:.2} on planes, {:.2} off them;",
                figures.psnr_db,
                figures.flip,
                error(true),
                error(false)
            );
        }
        println!("  eye {i}: {:.1} % on planes;{text}", 100.0 * share);
        let picture = RgbImage::from_fn(3 * width, 2 * height, |x, y| {
            let (tile, x, y) = ((x / width, y / height), x % width, y % height);
            let off = |k: usize| {
                Rgb(std::array::from_fn(|c| {
                    (128 + 5 * (i32::from(frames[k].get_pixel(x, y)[c]) - i32::from(truth.get_pixel(x, y)[c])))
                        .clamp(0, 255) as u8
                }))
            };
            match tile {
                (0, 0) => *frames[0].get_pixel(x, y),
                (1, 0) => *frames[1].get_pixel(x, y),
                (_, 0) => *truth.get_pixel(x, y),
                (0, _) => off(0),
                (1, _) => off(1),
                _ => {
                    let k = (y * width + x) as usize;
                    if shown(k) { Rgb([64, 64, 160]) } else { Rgb([of_planes.coverage[k].splat_share(), 128, 0]) }
                }
            }
        });
        picture.save(stem.with_extension(format!("{i}.png"))).expect("writes");
    }
    let [[a, fa], [b, fb]] = sums;
    println!(
        "  mean: {a:.2} dB -> {b:.2} dB ({:+.2}), FLIP {fa:.4} -> {fb:.4} ({:+.1} %)",
        b - a,
        100.0 * (fb / fa - 1.0)
    );
}
