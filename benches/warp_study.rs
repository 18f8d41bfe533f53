//! What a frame is made of, in figures, 1024x768: rates of every kernel with the LDI cold and warm in cache, how far they
//! are from what memory allows, what clipping saves, the height of bands, and 8-byte depth pixels against 24-byte ones.
//!
//! `HEADBOX_BENCH_LDI=a.ldi:b.ldi cargo bench --bench warp_study` adds captured scenes, seen straight ahead from their
//! centres.

#[path = "../tests/common/mod.rs"]
mod common;

use common::bed::room;
use common::capture::one_layer;
use glam::{DVec3, dvec3};
use headbox::capture::Camera;
use headbox::capture::random::Rng;
use headbox::capture::rig::Face;
use headbox::ldi::{DepthPixel, EncodedNormal};
use headbox::packed::{ExactCube, PackedCube, SplatIndexLayout, Split};
use headbox::render::splat::SplatKernel;
use headbox::render::{FrameStats, RenderSettings, Renderer};
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

const SIZE: [u32; 2] = [1024, 768];
const ROUNDS: usize = 15;

/// What memory allows, on one thread.
struct Memory {
    read_bytes_per_ms: f64,
    /// Of four bytes each, anywhere in a frame.
    writes_per_ms: f64,
    /// More than any cache holds, to make the LDI cold.
    block: Vec<u64>,
}

impl Memory {
    fn measure() -> Self {
        let block = vec![1u64; 32 << 20];
        let best_ms = |work: &mut dyn FnMut()| {
            let time = |work: &mut dyn FnMut()| {
                let started = Instant::now();
                work();
                started.elapsed().as_secs_f64() * 1e3
            };
            (0..7).map(|_| time(work)).fold(f64::INFINITY, f64::min)
        };
        let read_ms = best_ms(&mut || {
            black_box(block.iter().sum::<u64>());
        });
        let mut frame = vec![0u32; (SIZE[0] * SIZE[1]) as usize];
        let mut random = Rng::keyed(1);
        let places: Vec<u32> = (0..1 << 20).map(|_| random.between(0.0, frame.len() as f64) as u32).collect();
        let write_ms = best_ms(&mut || {
            for (place, value) in places.iter().zip(0..) {
                frame[*place as usize] = value;
            }
            black_box(&frame);
        });
        Self {
            read_bytes_per_ms: size_of_val(block.as_slice()) as f64 / read_ms,
            writes_per_ms: places.len() as f64 / write_ms,
            block,
        }
    }

    fn make_cold(&self) {
        black_box(self.block.iter().sum::<u64>());
    }

    /// The larger of the time to read the depth pixels and write the frame's five bytes a pixel, and of the time to write each
    /// splat once, ms.
    fn floor_ms(&self, stats: &FrameStats) -> f64 {
        let bytes = stats.depth_pixels_in * 8 + u64::from(SIZE[0] * SIZE[1]) * 5;
        (bytes as f64 / self.read_bytes_per_ms).max(stats.splatted as f64 / self.writes_per_ms)
    }
}

/// The fastest of some frames, each after `before`.
fn fastest(mut before: impl FnMut(), mut frame: impl FnMut() -> FrameStats) -> FrameStats {
    let mut next = || {
        before();
        frame()
    };
    (0..ROUNDS).map(|_| next()).min_by(|a, b| a.frame_ms.total_cmp(&b.frame_ms)).expect("rounds")
}

fn kernels(name: &str, cube: &PackedCube, camera: &Camera, memory: &Memory) {
    for (kernel_name, kernel) in SplatKernel::ALL {
        let settings = RenderSettings { kernel, ..RenderSettings::default() };
        let mut of_one_thread = 0.0;
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let mut renderer = Renderer::new();
            let mut frame = || pool.install(|| *renderer.render_with_stats(cube, camera, &settings).1);
            let warm = fastest(|| {}, &mut frame);
            let cold = fastest(|| memory.make_cold(), &mut frame);
            of_one_thread = if threads == 1 { warm.frame_ms } else { of_one_thread };
            let rate = |stats: &FrameStats, ms: f64| stats.depth_pixels_in as f64 / ms / 1e3;
            println!(
                "{name}, {kernel_name}, {threads} threads: {:.2} ms ({:.2} times one thread's speed), {:.0} M depth \
                 pixels/s, {:.0} M/s warping alone; cold {:.2} ms, {:.0} M/s; {:.1} times memory's floor; imbalance {:.2}",
                warm.frame_ms,
                of_one_thread / warm.frame_ms,
                rate(&warm, warm.frame_ms),
                rate(&warm, warm.warp_ms / threads as f64),
                cold.frame_ms,
                rate(&cold, cold.frame_ms),
                warm.frame_ms / memory.floor_ms(&warm),
                warm.imbalance,
            );
        }
    }
}

fn band_heights(name: &str, cube: &PackedCube, camera: &Camera) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("threads");
    let mut renderer = Renderer::new();
    for kernel in [SplatKernel::Paper, SplatKernel::Opaque, SplatKernel::Tent] {
        let ms = [16, 32, 48, 64, 96, 192, 768].map(|band_rows| {
            let settings = RenderSettings { kernel, band_rows, ..RenderSettings::default() };
            let stats = fastest(|| {}, || pool.install(|| *renderer.render_with_stats(cube, camera, &settings).1));
            format!("{band_rows}: {:.2} ms, {} k in", stats.frame_ms, stats.depth_pixels_in / 1000)
        });
        println!("{name}, {kernel:?}, rows of a band: {}", ms.join("; "));
    }
}

/// What clipping saves over 200 seeded views inside the headbox.
fn clipping(name: &str, cube: &PackedCube) {
    let (mut renderer, mut random, settings) = (Renderer::new(), Rng::keyed(1), RenderSettings::default());
    let [mut kept, mut of_segments, mut of_all] = [0; 3];
    for _ in 0..200 {
        let eye = cube.info.centre + random.in_cube(cube.info.half_size_m);
        let to = eye + random.in_cube(1.0) * dvec3(1.0, 0.3, 1.0);
        let camera = Camera::look_at(eye, to, DVec3::Y, 60.0, [SIZE[0], SIZE[1]]).expect("valid");
        let counts = renderer.clip_counts(cube, &camera, &settings);
        kept += counts.kept;
        of_segments += counts.clipped + counts.kept;
        of_all += counts.culled + counts.clipped + counts.kept;
    }
    // Of sums: a view of nothing but sky would make a mean of ratios infinite.
    let [of_segments, of_all] = [of_segments, of_all].map(|sum| sum as f64 / kept as f64);
    println!("{name}: clipping leaves 1 of {of_segments:.2} depth pixels of segments in view, 1 of {of_all:.2} of all");
}

/// Frames of the same depth pixels packed and not, turn by turn.
fn packing(name: &str, cube: PackedCube, camera: &Camera, memory: &Memory) {
    let exact = ExactCube::unpack(cube);
    let packed_bytes = exact.cube.depth_pixel_count() * 8;
    println!("{name}: {packed_bytes} bytes packed, {} unpacked", exact.depth_pixel_bytes());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("threads");
    for kernel in [SplatKernel::Point, SplatKernel::Paper, SplatKernel::Opaque, SplatKernel::Tent] {
        let settings = RenderSettings { kernel, ..RenderSettings::default() };
        let [mut packed, mut unpacked] = [Renderer::new(), Renderer::new()];
        for (state, cold) in [("warm", false), ("cold", true)] {
            let mut best = [f64::INFINITY; 2];
            for _ in 0..ROUNDS {
                let before = || {
                    if cold {
                        memory.make_cold();
                    }
                };
                before();
                let ms = pool.install(|| packed.render_with_stats(&exact.cube, camera, &settings).1.frame_ms);
                best[0] = ms.min(best[0]);
                before();
                let ms = pool.install(|| unpacked.render_exact(&exact, camera, &settings).1.frame_ms);
                best[1] = ms.min(best[1]);
            }
            let [packed_ms, unpacked_ms] = best;
            println!(
                "{name}, {kernel:?}, {state}: packed {packed_ms:.2} ms, unpacked {unpacked_ms:.2} ms, {:.2} times",
                unpacked_ms / packed_ms
            );
        }
    }
}

/// 1.1 M depth pixels on one face, nearly all in view, as in the paper's tree.
fn face() -> PackedCube {
    let (scene, face_px) = (room(24.0), 1049);
    let ldi = one_layer(DVec3::ZERO, face_px, &[Face::NegZ], |face, x, y| {
        let hit = scene.hit(DVec3::ZERO, face.direction(x, y, face_px))?;
        let [r, g, b] = hit.color.map(|c| (c * 255.0) as u8);
        let normal = EncodedNormal::new(hit.normal.as_vec3());
        Some(DepthPixel { inverse_depth: (1.0 / hit.t) as f32, normal, color_srgb: [r, g, b, 255] })
    });
    PackedCube::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).expect("packs")
}

fn main() {
    let memory = Memory::measure();
    println!(
        "memory: {:.1} GB/s read, {:.0} M scattered writes/s",
        memory.read_bytes_per_ms / 1e6,
        memory.writes_per_ms / 1e3
    );
    let looking =
        |eye: DVec3, to: DVec3, fov| Camera::look_at(eye, to, DVec3::Y, fov, [SIZE[0], SIZE[1]]).expect("valid");
    let mut scenes = vec![("face".to_owned(), face(), looking(dvec3(0.21, -0.13, 0.17), dvec3(0.1, 0.0, -3.0), 80.0))];
    for path in std::env::var("HEADBOX_BENCH_LDI").unwrap_or_default().split(':').filter(|path| !path.is_empty()) {
        let cube = PackedCube::read(Path::new(path)).expect("an .ldi file");
        let centre = cube.info.centre;
        scenes.push((path.to_owned(), cube, looking(centre, centre - DVec3::Z, 60.0)));
    }
    for (name, cube, camera) in scenes {
        clipping(&name, &cube);
        kernels(&name, &cube, &camera, &memory);
        band_heights(&name, &cube, &camera);
        packing(&name, cube, &camera, &memory);
    }
}
