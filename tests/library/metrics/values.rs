//! PSNR, SSIM and the share of differing pixels: scikit-image's figures, closed forms and hand-made
//! cases.

use super::images::{constant, pairs, pattern, shifted};
use headbox_core::metrics::{
    Comparison, MetricError, compare, compare_with_map, differing_fraction, psnr_db, ssim,
};
use image::{Rgb, RgbImage};

/// Figures of scikit-image 0.26.0 with NumPy 2.4.6 for [`pairs`] of two sizes, of which the second
/// is the least that it accepts in one direction. Made by the formulas of `images` in NumPy
/// and `structural_similarity(a, b, channel_axis=-1, gaussian_weights=True, sigma=1.5,
/// use_sample_covariance=False, data_range=255)`, printed to 12 decimals.
#[rustfmt::skip]
const SCIKIT_IMAGE_SSIM: [((u32, u32), [f64; 9]); 2] = [
    ((203, 131), [
        1.000000000000, 0.987572155987, 0.586260700652, 0.745575117943, 0.925130812424, 0.999495018416,
        0.000099990001, 0.333399993334, 0.140481444373,
    ]),
    ((11, 16), [
        1.000000000000, 0.908240601731, 0.411798040514, 0.941700466783, 0.929280625685, 0.732991661914,
        0.000099990001, 0.333399993334, 0.124596888866,
    ]),
];
/// Figures of `peak_signal_noise_ratio(a, b, data_range=255)` for the same pairs, the equal one
/// left out, to 10 decimals.
#[rustfmt::skip]
const SCIKIT_IMAGE_PSNR_DB: [f64; 8] = [
    34.6500006657, 14.8590083216, 14.2276194699, 16.8596973695, 48.1847028930, 0.0, 1.7609125906, 10.4926272304,
];
/// Half a unit of the last decimal above, and as much again for the order of f64 sums.
const SSIM_TOLERANCE: f64 = 1e-12;
const PSNR_TOLERANCE_DB: f64 = 1e-10;

#[test]
fn ssim_is_that_of_scikit_image() {
    for ((width, height), figures) in SCIKIT_IMAGE_SSIM {
        for ((name, reference, test), figure) in pairs(width, height).iter().zip(figures) {
            let ours = ssim(reference, test).unwrap();
            assert!(
                (ours - figure).abs() < SSIM_TOLERANCE,
                "{name}, {width}x{height}: {ours} for {figure}"
            );
        }
    }
}

#[test]
fn psnr_is_that_of_scikit_image() {
    for ((name, reference, test), figure) in pairs(203, 131)[1..].iter().zip(SCIKIT_IMAGE_PSNR_DB) {
        let ours = psnr_db(reference, test).unwrap();
        assert!(
            (ours - figure).abs() < PSNR_TOLERANCE_DB,
            "{name}: {ours} for {figure}"
        );
    }
}

#[test]
fn ssim_matches_definition_with_reflection() {
    /// Tolerance: moments of 8-bit values are below 2^17, and their differences lose at most that
    /// many of 53 bits.
    const CANCELLATION: f64 = 1e-10;
    for (width, height) in [
        (1, 1),
        (1, 40),
        (2, 3),
        (10, 10),
        (7, 30),
        (30, 4),
        (12, 13),
    ] {
        for (name, reference, test) in pairs(width, height) {
            let (ours, truth) = (
                ssim(&reference, &test).unwrap(),
                ssim_by_definition(&reference, &test),
            );
            assert!(
                (ours - truth).abs() < CANCELLATION,
                "{name}, {width}x{height}: {ours} for {truth}"
            );
        }
    }
}

/// SSIM by its definition: window by window, two-dimensional weights, variances about the mean.
fn ssim_by_definition(reference: &RgbImage, test: &RgbImage) -> f64 {
    let (width, height) = (reference.width() as i32, reference.height() as i32);
    let centers = |len: i32| if len < 11 { 0..len } else { 5..len - 5 };
    let reflect = |i: i32, len: i32| {
        let mut i = i;
        while !(0..len).contains(&i) {
            i = if i < 0 { -1 - i } else { 2 * len - 1 - i };
        }
        i as u32
    };
    let weight = |k: i32| (-f64::from(k * k) / 4.5).exp();
    let mut values = Vec::new();
    for (x, y, c) in
        centers(width).flat_map(|x| centers(height).flat_map(move |y| [0, 1, 2].map(|c| (x, y, c))))
    {
        let window: Vec<(f64, f64, f64)> = (-5..=5)
            .flat_map(|j| (-5..=5).map(move |i| (i, j)))
            .map(|(i, j)| {
                let [a, b] = [reference, test].map(|image| {
                    f64::from(image[(reflect(x + i, width), reflect(y + j, height))][c])
                });
                (weight(i) * weight(j), a, b)
            })
            .collect();
        let total: f64 = window.iter().map(|(w, ..)| w).sum();
        let mean = |f: &dyn Fn(f64, f64) -> f64| {
            window.iter().map(|&(w, a, b)| w * f(a, b)).sum::<f64>() / total
        };
        let (ma, mb) = (mean(&|a, _| a), mean(&|_, b| b));
        let (va, vb) = (
            mean(&|a, _| (a - ma).powi(2)),
            mean(&|_, b| (b - mb).powi(2)),
        );
        let covariance = mean(&|a, b| (a - ma) * (b - mb));
        let (c1, c2) = (2.55_f64.powi(2), 7.65_f64.powi(2));
        values.push(
            (2.0 * ma * mb + c1) * (2.0 * covariance + c2)
                / ((ma * ma + mb * mb + c1) * (va + vb + c2)),
        );
    }
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn constant_images_have_closed_forms() {
    for (a, b) in [(10_u8, 11_u8), (0, 255), (200, 100)] {
        let (reference, test) = (constant(40, 17, [a; 3]), constant(40, 17, [b; 3]));
        let (a, b) = (f64::from(a), f64::from(b));
        let comparison = compare(&reference, &test).unwrap();
        assert!(
            (comparison.psnr_db - 20.0 * (255.0 / (a - b).abs()).log10()).abs() < PSNR_TOLERANCE_DB
        );
        let c1 = 2.55_f64.powi(2);
        assert!(
            (comparison.ssim - (2.0 * a * b + c1) / (a * a + b * b + c1)).abs() < SSIM_TOLERANCE
        );
        assert_eq!(comparison.differing_fraction, 1.0);
    }
}

#[test]
fn equal_images_of_any_size_are_equal_exactly() {
    for (width, height) in [(1, 1), (1, 97), (31, 1), (10, 11), (64, 65), (257, 129)] {
        let image = pattern(width, height);
        let comparison = compare(&image, &image).unwrap();
        let equal = Comparison {
            flip: 0.0,
            psnr_db: f64::INFINITY,
            ssim: 1.0,
            differing_fraction: 0.0,
        };
        assert_eq!(comparison, equal, "{width}x{height}");
    }
}

#[test]
fn differing_pixels_are_counted_once() {
    let image = constant(200, 100, [5, 6, 7]);
    let mut test = image.clone();
    test.put_pixel(0, 0, Rgb([6, 6, 7]));
    test.put_pixel(199, 99, Rgb([5, 0, 0]));
    assert_eq!(differing_fraction(&image, &test).unwrap(), 2.0 / 20_000.0);
    let squared_error = 1.0 + 36.0 + 49.0;
    let psnr = 10.0 * (255.0 * 255.0 * 60_000.0_f64 / squared_error).log10();
    assert!((psnr_db(&image, &test).unwrap() - psnr).abs() < PSNR_TOLERANCE_DB);
    // Stripes of one pixel, shifted by one, differ everywhere except in the repeated column.
    let stripes = RgbImage::from_fn(50, 20, |x, _| Rgb([if x % 2 == 0 { 0 } else { 255 }; 3]));
    assert_eq!(
        differing_fraction(&stripes, &shifted(&stripes)).unwrap(),
        49.0 / 50.0
    );
}

#[test]
fn metrics_grow_with_the_error() {
    let image = pattern(120, 90);
    let worse: Vec<Comparison> = [4, 16, 64]
        .map(|strength| compare(&image, &super::images::noisy(&image, strength)).unwrap())
        .to_vec();
    assert!(worse.is_sorted_by(|a, b| a.flip < b.flip && a.psnr_db > b.psnr_db && a.ssim > b.ssim));
}

#[test]
fn no_thread_count_changes_a_bit() {
    let (_, reference, test) = pairs(150, 333).swap_remove(2);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| compare_with_map(&reference, &test).unwrap())
    };
    let once = run(1);
    assert!([2, 3, 7].into_iter().all(|threads| run(threads) == once));
}

#[test]
fn images_that_cannot_be_compared_are_refused() {
    let (a, b, none) = (pattern(3, 4), pattern(4, 3), RgbImage::new(0, 9));
    let refusal = compare(&a, &b).unwrap_err();
    assert_eq!(
        refusal,
        MetricError::SizeMismatch {
            reference: (3, 4),
            test: (4, 3)
        }
    );
    assert_eq!(
        refusal.to_string(),
        "the images differ in size: 3x4 and 4x3 pixels"
    );
    assert_eq!(compare(&none, &none).unwrap_err(), MetricError::Empty);
    assert_eq!(
        ssim(&a, &none).unwrap_err(),
        MetricError::SizeMismatch {
            reference: (3, 4),
            test: (0, 9)
        }
    );
}

#[test]
fn json_has_four_keys_and_null_for_infinity() {
    let mut comparison = Comparison {
        flip: 0.25,
        psnr_db: 30.5,
        ssim: 0.75,
        differing_fraction: 0.5,
    };
    let json = serde_json::to_string(&comparison).unwrap();
    assert_eq!(
        json,
        r#"{"flip":0.25,"psnr_db":30.5,"ssim":0.75,"differing_fraction":0.5}"#
    );
    assert_eq!(
        serde_json::from_str::<Comparison>(&json).unwrap(),
        comparison
    );
    comparison.psnr_db = f64::INFINITY;
    let json = serde_json::to_string(&comparison).unwrap();
    assert!(json.contains(r#""psnr_db":null"#), "{json}");
    assert_eq!(
        serde_json::from_str::<Comparison>(&json).unwrap(),
        comparison
    );
}
