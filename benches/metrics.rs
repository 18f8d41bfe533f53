//! Milliseconds per metric on a pair of 1024x768 frames, all threads; FLIP also by the authors'
//! evaluator (one thread).
//!
//! `cargo bench --bench metrics`. Compare figures of one run only.

use criterion::{Criterion, criterion_group, criterion_main};
use headbox_core::metrics::{
    DEFAULT_PIXELS_PER_DEGREE, compare, differing_fraction, flip_map, psnr_db, ssim,
};
use image::{Rgb, RgbImage};

/// Smooth gradients with a texture; the second of a pair is a little darker where a hash says so.
fn frame(darker: bool) -> RgbImage {
    RgbImage::from_fn(1024, 768, |x, y| {
        let texture = ((x / 7) ^ (y / 5)) % 32;
        let loss = if darker {
            (x.wrapping_mul(2_654_435_761) ^ y.wrapping_mul(40_503)) >> 28
        } else {
            0
        };
        Rgb([x / 5 + texture, y / 4 + texture, 64 + 2 * texture]
            .map(|v| v.saturating_sub(loss).min(255) as u8))
    })
}

fn metrics(criterion: &mut Criterion) {
    let (a, b) = (frame(false), frame(true));
    let mut group = criterion.benchmark_group("metrics of 1024x768");
    group.sample_size(20);
    group.bench_function("flip", |bench| {
        bench.iter(|| flip_map(&a, &b, DEFAULT_PIXELS_PER_DEGREE));
    });
    group.bench_function("flip, the authors' evaluator", |bench| {
        bench.iter(|| {
            let [a, b] = [&a, &b].map(|image| {
                nv_flip::FlipImageRgb8::with_data(image.width(), image.height(), image)
            });
            nv_flip::flip(a, b, DEFAULT_PIXELS_PER_DEGREE)
        });
    });
    group.bench_function("ssim", |bench| bench.iter(|| ssim(&a, &b)));
    group.bench_function("psnr", |bench| bench.iter(|| psnr_db(&a, &b)));
    group.bench_function("differing fraction", |bench| {
        bench.iter(|| differing_fraction(&a, &b));
    });
    group.bench_function("all", |bench| bench.iter(|| compare(&a, &b)));
    group.finish();
}

criterion_group!(benches, metrics);
criterion_main!(benches);
