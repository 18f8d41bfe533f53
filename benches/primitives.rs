//! What pictures on planes cost and save: `cargo bench --bench primitives -- FILE.ldi... [--error-px E] [--pictures DIR]`.

#![allow(missing_docs, reason = "a benchmark is run, not read as a library")]

use headbox::capture::Camera;
use headbox::capture::rig::Face;
use headbox::packed::{PackedCube, Split};
use headbox::primitives;
use headbox::render::{RenderSettings, Renderer};
use std::path::{Path, PathBuf};
use std::time::Instant;

fn main() {
    let (mut files, mut error_px, mut pictures, mut repeat) = (Vec::new(), 0.5, None, 9);
    let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--error-px" => error_px = args.next().and_then(|v| v.parse().ok()).expect("a number"),
            "--repeat" => repeat = args.next().and_then(|v| v.parse().ok()).expect("a number"),
            "--pictures" => pictures = args.next().map(PathBuf::from),
            _ => files.push(PathBuf::from(arg)),
        }
    }
    files.iter().for_each(|file| study(file, error_px, repeat, pictures.as_deref()));
}

fn study(file: &Path, error_px: f64, repeat: usize, pictures: Option<&Path>) {
    let all = PackedCube::read(file).expect("a cube LDI");
    let mut ldi = all.unpack();
    let started = Instant::now();
    let set = primitives::choose(&mut ldi, error_px);
    let choosing = started.elapsed();
    let mut mixed = PackedCube::pack(&ldi, all.layout, Split::None).expect("packs");
    drop(ldi);
    mixed.planes = set;
    let set = &mixed.planes;
    println!("{}: chosen in {choosing:.1?}", file.display());
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
}
