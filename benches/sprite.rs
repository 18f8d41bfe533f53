//! Megapixels per second of the sprite renderer: every variant, both samplings, 256x256 and
//! 1024x1024, one thread and two; full-resolution 8-bit displacement with about 10 px of parallax.
//!
//! `cargo bench --bench sprite`. The homography is the one of the comparison with OpenCV's
//! `warpPerspective` (turn by 12 degrees, scale 0.8, some perspective). Compare figures of one run
//! only. At the end the ratios of the paper's comparison are printed beside the paper's own.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::{DMat3, DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::statistics::median;
use headbox_lab::turns::{run_in_turns, time_ms};
use headbox_sprite::{
    Displacement, DisplacementFormat, PreparedSprite, RenderOptions, Sprite, SpriteLayer,
    SpritePlane, SpriteRenderer, SpriteSampling, SpriteTransfer, SpriteVariant, SpriteWithDepth,
};
use image::{Rgba, RgbaImage};

/// Smooth colours, and a hemisphere in the middle that rises from the plane by 1.
fn sprite(n: u32) -> PreparedSprite {
    let wave = |v: u32, k: f32| 127.5 + 120.0 * (k * v as f32 * 256.0 / n as f32).sin();
    let color = RgbaImage::from_fn(n, n, |x, y| {
        Rgba([
            wave(x, 0.05) as u8,
            wave(y, 0.04) as u8,
            wave(x + y, 0.03) as u8,
            255,
        ])
    });
    let camera =
        Camera::look_at(dvec3(0.0, 0.0, 2.0), DVec3::ZERO, DVec3::Y, 50.0, [n, n]).expect("valid");
    let sprite =
        Sprite::new(color, camera, SpritePlane::through(DVec3::ZERO, DVec3::Z)).expect("valid");
    let height = |i: u32| {
        let (x, y) = (
            (i % n) as f32 / n as f32 * 2.0 - 1.0,
            (i / n) as f32 / n as f32 * 2.0 - 1.0,
        );
        (0.5 - x * x - y * y).max(0.0).sqrt()
    };
    let values: Vec<f32> = (0..n * n).map(height).collect();
    let displacement = Displacement::new(n, n, &values, DisplacementFormat::I8).expect("finite");
    PreparedSprite::new(SpriteWithDepth::new(sprite, displacement).expect("sizes agree"))
}

/// Frame to picture as in the comparison, and an epipole that moves the top of the hemisphere by 10
/// px at 256x256.
fn transfer(n: f64) -> SpriteTransfer {
    let (sin, cos) = 12.0f64.to_radians().sin_cos();
    let c = n / 2.0;
    let about = |c: f64| DMat3::from_cols(DVec3::X, DVec3::Y, dvec3(c, c, 1.0));
    let turn = DMat3::from_cols(
        dvec3(0.8 * cos, 0.75 * sin, 0.15 / n),
        dvec3(-0.8 * sin, 0.85 * cos, -0.1 / n),
        dvec3(3.3, -2.7, 1.0),
    );
    let target_from_sprite = (about(c) * turn * about(-c)).inverse();
    let epipole_in_sprite = dvec3(n * 10.0 / 256.0, n * 4.0 / 256.0, 0.01);
    SpriteTransfer::from_parts(
        target_from_sprite,
        target_from_sprite * epipole_in_sprite,
        1.0,
    )
    .expect("regular")
}

fn variants(criterion: &mut Criterion) {
    for n in [256, 1024] {
        let (sprite, transfer) = (sprite(n), transfer(f64::from(n)));
        let mut frame = SpriteLayer::new(n, n);
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("threads");
            let mut group =
                criterion.benchmark_group(format!("sprite of {n}x{n}, {threads} threads"));
            group
                .throughput(Throughput::Elements(u64::from(n) * u64::from(n)))
                .sample_size(20);
            for (variant, sampling) in SpriteVariant::ALL
                .into_iter()
                .flat_map(|v| [(v, SpriteSampling::Bilinear), (v, SpriteSampling::Nearest)])
            {
                let options = RenderOptions {
                    variant,
                    sampling,
                    ..RenderOptions::default()
                };
                let mut renderer = SpriteRenderer::new();
                let id = BenchmarkId::new(variant.name(), format!("{sampling:?}"));
                let mut draw =
                    || renderer.render_transfer(&sprite, &transfer, &options, &mut frame);
                group.bench_function(id, |bench| bench.iter(|| pool.install(&mut draw)));
            }
            group.finish();
        }
    }
}

/// Returns the median time of a frame by each option, ms, in turns.
fn medians<const N: usize>(n: u32, mut options: [RenderOptions; N]) -> [f64; N] {
    const ROUNDS: u32 = 101;
    let (sprite, transfer) = (sprite(n), transfer(f64::from(n)));
    let (mut renderer, mut frame) = (SpriteRenderer::new(), SpriteLayer::new(n, n));
    let times = run_in_turns(&mut options, ROUNDS, |_, options| {
        Some(time_ms(|| {
            renderer.render_transfer(&sprite, &transfer, options, &mut frame);
        }))
    });
    std::array::from_fn(|i| median(times[i].iter().copied()).expect("rounds"))
}

/// Time over the homography's beside that of the paper (frames a second on 256x256: bilinear 30,
/// 21, 16; nearest 47, 24, 20 for none, crude and two-pass), on one thread.
fn ratios(_: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("threads");
    let paper = [
        (SpriteSampling::Bilinear, [30.0, 21.0, 16.0]),
        (SpriteSampling::Nearest, [47.0, 24.0, 20.0]),
    ];
    for (n, (sampling, hz)) in [256, 1024]
        .into_iter()
        .flat_map(|n| paper.map(|paper| (n, paper)))
    {
        let variants = [
            SpriteVariant::Homography,
            SpriteVariant::OnePass,
            SpriteVariant::TwoPass,
        ];
        let options = variants.map(|variant| RenderOptions {
            variant,
            sampling,
            ..RenderOptions::default()
        });
        let ms = pool.install(|| medians(n, options));
        for (i, variant) in variants.iter().enumerate() {
            let mpx_per_s = f64::from(n * n) / ms[i] / 1e3;
            let (own, theirs) = (ms[i] / ms[0], hz[0] / hz[i]);
            println!(
                "{n}x{n} {sampling:?} {:<11} {mpx_per_s:>7.0} Mpx/s, {own:.2} times the homography's time (paper: {theirs:.2})",
                variant.name()
            );
        }
    }
}

criterion_group!(benches, variants, ratios);
criterion_main!(benches);
