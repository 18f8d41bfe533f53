//! The papers' walk through the built-in house: time and error of every backdrop along one path, exposure errors, clipping
//! and the distribution of layers (inventory R-N2 to R-N7, P-N1 to P-N10).
//!
//! `cargo bench --bench portal -- [POSES] [TRIANGLES] [WIDTHxHEIGHT] [DIR]`: poses (26 without an argument; 520 in the
//! papers), triangles (1,744,000), frame (640x512), and a folder for frames side by side with truth.
//! All timings of a pose are taken one after the other (A B C A B C), the best of three.

use glam::Vec3;
use headbox::capture::Camera;
use headbox::frame::Frame;
use headbox::portal::backdrop::{Backdrop, Kind, Quality};
use headbox::portal::house::House;
use headbox::portal::path::WalkPath;
use headbox::portal::store::Store;
use headbox::portal::walk::{WalkSettings, WalkStats, Walker};
use headbox::raster::Seen;
use headbox::truth;
use image::{Rgb, RgbImage};
use std::path::PathBuf;
use std::time::Instant;

/// What is drawn along the path.
const VARIANTS: [(&str, Option<Kind>); 7] = [
    ("geometry", None),
    ("texture", Some(Kind::Texture)),
    ("image", Some(Kind::Image)),
    ("two-images", Some(Kind::TwoImages)),
    ("ldi", Some(Kind::Ldi)),
    ("window-ldi", Some(Kind::WindowLdi)),
    ("cell-ldi", Some(Kind::CellLdi)),
];

/// A pixel whose colour differs by more than this (sRGB levels) from all nine truth pixels about it shows a wrong surface.
const WRONG_LEVELS: u8 = 24;

struct Options {
    poses: usize,
    triangles: usize,
    size: [u32; 2],
    folder: Option<PathBuf>,
}

impl Options {
    fn parse() -> Self {
        let mut options = Self { poses: 26, triangles: 1_744_000, size: [640, 512], folder: None };
        let mut numbers = 0;
        for word in std::env::args().skip(1).filter(|word| !word.starts_with("--")) {
            if let Some((w, h)) = word.split_once('x')
                && let (Ok(w), Ok(h)) = (w.parse(), h.parse())
            {
                options.size = [w, h];
            } else if let Ok(number) = word.parse() {
                *(if numbers == 0 { &mut options.poses } else { &mut options.triangles }) = number;
                numbers += 1;
            } else {
                options.folder = Some(word.into());
            }
        }
        options
    }
}

/// Sums over the poses of one variant.
#[derive(Default)]
struct Row {
    frame_ms: Vec<f64>,
    geometry_ms: Vec<f64>,
    backdrop_ms: Vec<f64>,
    squared_error: Vec<f64>,
    backdrop_pixels: u64,
    holes: u64,
    wrong: u64,
    samples: u64,
    samples_in: u64,
}

fn main() {
    let options = Options::parse();
    let start = Instant::now();
    let model = headbox::scenes::house(0, options.triangles);
    let house = House::new(model).expect("the built-in house is a valid model");
    println!(
        "house: {} cells, {} portals, {} triangles; {:.1} s",
        house.plan().cells.len(),
        house.plan().portals.len(),
        house.scene().triangles.len(),
        start.elapsed().as_secs_f64()
    );
    let cameras = WalkPath { poses: options.poses, size: options.size, ..WalkPath::default() }.cameras(&house);
    let cameras = cameras.expect("valid cameras");
    let store = Store::new(8 << 30);
    let mut rows: Vec<Row> = VARIANTS.iter().map(|_| Row::default()).collect();
    let mut walker = Walker::new();
    let (mut rays_ms, mut capture_s) = (Vec::new(), vec![Vec::new(); VARIANTS.len()]);
    for (pose, camera) in cameras.iter().enumerate() {
        let truth = truth_frame(&house, camera);
        rays_ms.push(primary_rays_ms(&house, camera));
        let mut strip = vec![truth.clone()];
        for (variant, (_, kind)) in VARIANTS.iter().enumerate() {
            let settings = WalkSettings { backdrops: *kind, ..WalkSettings::default() };
            capture_missing(&house, &store, camera, &settings, &mut walker, &mut capture_s[variant]);
        }
        let mut best: Vec<Option<WalkStats>> = vec![None; VARIANTS.len()];
        for _ in 0..3 {
            for (variant, (_, kind)) in VARIANTS.iter().enumerate() {
                let settings = WalkSettings { backdrops: *kind, ..WalkSettings::default() };
                let stats = walker.frame(&house, &store, camera, &settings).1.clone();
                if best[variant].as_ref().is_none_or(|best| stats.frame_ms < best.frame_ms) {
                    best[variant] = Some(stats);
                }
            }
        }
        let geometry = walker.frame(&house, &store, camera, &WalkSettings::default()).0.clone();
        for (variant, (_, kind)) in VARIANTS.iter().enumerate() {
            let settings = WalkSettings { backdrops: *kind, ..WalkSettings::default() };
            let frame = walker.frame(&house, &store, camera, &settings).0.clone();
            let Some(stats) = &best[variant] else { continue };
            let row = &mut rows[variant];
            row.frame_ms.push(stats.frame_ms);
            row.geometry_ms.push(stats.geometry_ms);
            row.backdrop_ms.push(stats.backdrop_ms);
            row.squared_error.push(mean_squared_error(&frame, &truth));
            row.backdrop_pixels += stats.backdrop_pixels;
            row.holes += stats.hole_pixels;
            row.samples += stats.backdrop.samples;
            row.samples_in += stats.backdrop.depth_pixels_in;
            let behind = |pixel: usize| matches!(walker.last().seen(pixel), Seen::Marker(_));
            row.wrong += wrong_pixels(&frame, &geometry, behind);
            strip.push(image_of(&frame));
        }
        if let Some(folder) = &options.folder {
            std::fs::create_dir_all(folder).expect("a folder");
            save_sheet(&strip, &folder.join(format!("pose_{pose:03}.png")));
        }
    }
    report(&rows, &rays_ms, &capture_s, &options);
    layers(&store);
    drop((house, store));
    exposure_errors(&options, &cameras);
}

/// Share of the pixels behind portals that show nothing or a wrong surface, in a house without textures and light whose
/// materials have colours far apart: detail that is only blurred does not count.
fn exposure_errors(options: &Options, cameras: &[Camera]) {
    let mut model = headbox::scenes::house(0, options.triangles.min(200_000));
    for (i, material) in (0u32..).zip(&mut model.scene.materials) {
        let hash = headbox::capture::sampler::random4([i, 1, 2, 3]);
        material.albedo = [0, 1, 2].map(|c| headbox::capture::linear_from_srgb8(60 * (hash[c] >> 30) as u8 + 20));
        (material.albedo_texture, material.emission, material.emission_texture) = (None, [0.0; 3], None);
    }
    model.scene.colors.clear();
    let house = House::new(model).expect("still valid");
    let mut walker = Walker::new();
    println!("exposure errors (false colours, {} triangles):", house.scene().triangles.len());
    for (name, kind) in VARIANTS.iter().skip(1) {
        let store = Store::new(8 << 30);
        let settings = WalkSettings { backdrops: *kind, ..WalkSettings::default() };
        let (mut wrong, mut holes, mut pixels) = (0, 0, 0);
        for camera in cameras {
            capture_missing(&house, &store, camera, &settings, &mut walker, &mut Vec::new());
            let truth = walker.frame(&house, &store, camera, &WalkSettings::default()).0.clone();
            let (frame, stats) = walker.frame(&house, &store, camera, &settings);
            let (frame, stats) = (frame.clone(), stats.clone());
            let behind = |pixel: usize| matches!(walker.last().seen(pixel), Seen::Marker(_));
            wrong += wrong_pixels(&frame, &truth, behind);
            (holes, pixels) = (holes + stats.hole_pixels, pixels + stats.backdrop_pixels);
        }
        let samples: u64 = store.all().iter().map(|(_, backdrop)| backdrop.sample_count()).sum();
        let share = |part: u64| 100.0 * part as f64 / pixels.max(1) as f64;
        println!(
            "  {name:12} {:.2} % ({:.2} % nothing at all), {} samples a backdrop",
            share(wrong),
            share(holes),
            samples / store.all().len().max(1) as u64
        );
    }
}

/// Captures what a frame lacks, until it lacks nothing.
fn capture_missing(
    house: &House,
    store: &Store,
    camera: &Camera,
    settings: &WalkSettings,
    walker: &mut Walker,
    seconds: &mut Vec<f64>,
) {
    let start = Instant::now();
    let captured = walker.prepare(house, store, camera, settings, &Quality::default()).expect("captures");
    let each = start.elapsed().as_secs_f64() / f64::from(captured.max(1));
    seconds.extend(std::iter::repeat_n(each, captured as usize));
}

fn truth_frame(house: &House, camera: &Camera) -> RgbImage {
    truth::render(house.tracer(), house.lighting(), false, camera, 8, &headbox::ldi::build::Silent).color
}

/// A frame by one ray a pixel, shaded as the rasteriser shades, on all threads.
fn primary_rays_ms(house: &House, camera: &Camera) -> f64 {
    use headbox::capture::trace::{HitPacket, PACKET, Ray, RayPacket};
    use rayon::prelude::*;
    let frame = || {
        let start = Instant::now();
        let origin = (camera.eye() - house.tracer().origin()).as_vec3();
        let (width, height) = (camera.width(), camera.height());
        // Packets of 4 by 4 pixels.
        let sum: u64 = (0..height.div_ceil(4))
            .into_par_iter()
            .map(|block_row| {
                let columns = width.div_ceil(4);
                let mut packets = vec![RayPacket::EMPTY; columns as usize];
                for (block, packet) in packets.iter_mut().enumerate() {
                    let rays: Vec<Ray> = (0..PACKET as u32)
                        .map(|i| {
                            let (x, y) = (4 * block as u32 + i % 4, 4 * block_row + i / 4);
                            let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5).as_vec3();
                            Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
                        })
                        .collect();
                    *packet = RayPacket::from_rays(&rays);
                }
                let mut hits = vec![HitPacket::MISS; packets.len()];
                house.tracer().closest_packets(&packets, &mut hits);
                let shade = |hit: headbox::capture::trace::Hit| {
                    let surface = house.scene().surface(hit.primitive, hit.u, hit.v);
                    let color = Vec3::from(surface.albedo) + Vec3::from(surface.emission);
                    color.to_array().map(headbox::capture::srgb8_from_linear).map(u64::from).iter().sum::<u64>()
                };
                hits.iter()
                    .flat_map(|packet| (0..PACKET).filter_map(move |lane| packet.hit(lane)))
                    .map(shade)
                    .sum::<u64>()
            })
            .sum();
        std::hint::black_box(sum);
        start.elapsed().as_secs_f64() * 1e3
    };
    (0..3).map(|_| frame()).fold(f64::INFINITY, f64::min)
}

fn image_of(frame: &Frame) -> RgbImage {
    RgbImage::from_fn(frame.width, frame.height, |x, y| {
        let [r, g, b, _] = frame.color[(y * frame.width + x) as usize];
        Rgb([r, g, b])
    })
}

fn mean_squared_error(frame: &Frame, truth: &RgbImage) -> f64 {
    let squares = frame
        .color
        .iter()
        .zip(truth.pixels())
        .map(|(a, b)| (0..3).map(|c| (f64::from(a[c]) - f64::from(b.0[c])).powi(2)).sum::<f64>());
    squares.sum::<f64>() / (3.0 * frame.color.len() as f64)
}

/// Pixels behind portals that show nothing, or a colour that the geometry has nowhere near.
fn wrong_pixels(frame: &Frame, geometry: &Frame, behind: impl Fn(usize) -> bool) -> u64 {
    let (width, height) = (frame.width as i64, frame.height as i64);
    let mut wrong = 0;
    for pixel in (0..frame.color.len()).filter(|&pixel| behind(pixel)) {
        let (x, y) = (pixel as i64 % width, pixel as i64 / width);
        let found = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy))).any(|(x, y)| {
            let inside = (0..width).contains(&x) && (0..height).contains(&y);
            inside && {
                let other = geometry.color[(y * width + x) as usize];
                (0..3).all(|c| other[c].abs_diff(frame.color[pixel][c]) <= WRONG_LEVELS)
            }
        });
        wrong += u64::from(!found || frame.coverage[pixel].is_hole());
    }
    wrong
}

/// Truth and all variants, three to a row.
fn save_sheet(frames: &[RgbImage], path: &std::path::Path) {
    let (w, h) = frames[0].dimensions();
    let mut sheet = RgbImage::new(3 * w, h * (frames.len() as u32).div_ceil(3));
    for (i, frame) in (0u32..).zip(frames) {
        image::imageops::replace(&mut sheet, frame, i64::from(i % 3 * w), i64::from(i / 3 * h));
    }
    sheet.save(path).expect("a picture");
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

fn worst(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

fn report(rows: &[Row], rays_ms: &[f64], capture_s: &[Vec<f64>], options: &Options) {
    let [w, h] = options.size;
    println!("{} poses, {w}x{h}, {} threads; ms: median (worst)", options.poses, rayon::current_num_threads());
    println!("primary rays   {:7.2} ({:.2})", median(rays_ms), worst(rays_ms));
    let share = |part: u64, whole: u64| 100.0 * part as f64 / whole.max(1) as f64;
    for ((row, (name, _)), capture) in rows.iter().zip(VARIANTS).zip(capture_s) {
        let lost = row.frame_ms.iter().zip(rays_ms).filter(|(frame, rays)| frame > rays).count();
        let psnr = |mse: f64| 10.0 * (255.0 * 255.0 / mse).log10();
        println!(
            "{name:12} frame {:7.2} ({:.2}), geometry {:.2} ({:.2}), backdrops {:.2} ({:.2}), slower than rays {lost}; \
             PSNR {:.2} (least {:.2}) dB; holes {:.3} %, exposure errors {:.2} % of {} px; samples {} of {} ({:.0} %); \
             capture {:.2} s (most {:.2}) x {}",
            median(&row.frame_ms),
            worst(&row.frame_ms),
            median(&row.geometry_ms),
            worst(&row.geometry_ms),
            median(&row.backdrop_ms),
            worst(&row.backdrop_ms),
            psnr(median(&row.squared_error)),
            psnr(worst(&row.squared_error)),
            share(row.holes, row.backdrop_pixels),
            share(row.wrong, row.backdrop_pixels),
            row.backdrop_pixels,
            row.samples_in,
            row.samples,
            share(row.samples_in, row.samples),
            median(capture),
            worst(capture),
            capture.len(),
        );
    }
}

/// Samples in layers 1, 2, 3 and beyond, of all LDIs of a kind (R-N2: 72/19/6/3 %, P-N1: 79/20/1 %).
fn layers(store: &Store) {
    for (name, kind) in [("ldi", Kind::Ldi), ("window-ldi", Kind::WindowLdi), ("cell-ldi", Kind::CellLdi)] {
        let (mut layers, mut cubes, mut bytes) = ([0u64; 4], 0u64, 0);
        for (_, backdrop) in store.all().iter().filter(|((_, of), _)| *of == kind) {
            let Backdrop::Cubes(of_backdrop) = &**backdrop else { continue };
            cubes += 1;
            bytes += backdrop.bytes();
            for segment in of_backdrop.iter().flat_map(|cube| &cube.segments) {
                for row in segment.row_counts.chunks(segment.width as usize + 1) {
                    for count in row.windows(2).map(|ends| ends[1] - ends[0]) {
                        (0..count.min(3) as usize).for_each(|layer| layers[layer] += 1);
                        layers[3] += u64::from(count.saturating_sub(3));
                    }
                }
            }
        }
        let total: u64 = layers.iter().sum();
        let percent = layers.map(|n| 100.0 * n as f64 / total.max(1) as f64);
        println!(
            "{name}: {cubes} LDIs of {} samples, {} bytes each; layers {:.1}/{:.1}/{:.1}/{:.1} %",
            total / cubes.max(1),
            bytes / cubes.max(1),
            percent[0],
            percent[1],
            percent[2],
            percent[3]
        );
    }
}
