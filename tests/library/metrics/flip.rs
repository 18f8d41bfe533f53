//! FLIP against its definition in f64 and against the authors' evaluator.

use std::f64::consts::PI;

use super::images::{constant, pairs, pattern};
use headbox_core::metrics::{
    DEFAULT_PIXELS_PER_DEGREE, FlipMap, MAX_PIXELS_PER_DEGREE, MetricError, flip_map,
};
use image::Rgb;

/// Largest error of a pixel against the f64 oracle. f32 rounds a lightness of 100 to about 1e-5, so
/// that a difference near 0 may be off by as much; the metric raises it to 0.7 and scales it by
/// 0.95 / (0.4 * 41): 2e-5. Twice that.
const PIXEL_TOLERANCE: f64 = 4e-5;
/// Largest error of a mean against the f64 oracle: few pixels have a difference near 0, the others
/// are off by the relative error of f32 powers, 3e-7.
const MEAN_TOLERANCE: f64 = 5e-7;
/// Largest error of a mean against the authors' evaluator, which works in f32 too but does not pair
/// its taps: features of flat regions are rounding noise of 1e-8 there and 0 here. Its square root,
/// 1e-4, enters the exponent of the color error c, which moves by -ln(c) c times as much; c is
/// 0.967 for black against white.
const EVALUATOR_MEAN_TOLERANCE: f64 = 1.5e-5;

#[test]
fn maps_equal_the_definition_in_f64() {
    for (width, height, ppd) in [
        (40, 29, DEFAULT_PIXELS_PER_DEGREE),
        (13, 70, 31.0),
        (7, 5, 90.0),
        (1, 1, 67.0),
    ] {
        for (name, reference, test) in pairs(width, height) {
            let map = flip_map(&reference, &test, ppd).unwrap();
            let truth = oracle::flip(&reference, &test, f64::from(ppd));
            let worst = worst_difference(&map.errors, &truth);
            let mean = truth.iter().sum::<f64>() / truth.len() as f64;
            println!(
                "{width}x{height} {name}: mean {mean:.6} (ours {:+.1e}), worst pixel {worst:.1e}",
                map.mean - mean
            );
            assert!(
                worst < PIXEL_TOLERANCE,
                "{name}, {width}x{height}: a pixel is off by {worst}"
            );
            assert!(
                (map.mean - mean).abs() < MEAN_TOLERANCE,
                "{name}: {} for {mean}",
                map.mean
            );
        }
    }
}

#[test]
fn maps_equal_the_authors_evaluator() {
    for (name, reference, test) in pairs(203, 131) {
        let map = flip_map(&reference, &test, DEFAULT_PIXELS_PER_DEGREE).unwrap();
        let [a, b] = [&reference, &test]
            .map(|image| nv_flip::FlipImageRgb8::with_data(image.width(), image.height(), image));
        let truth: Vec<f64> = nv_flip::flip(a, b, DEFAULT_PIXELS_PER_DEGREE)
            .to_vec()
            .into_iter()
            .map(f64::from)
            .collect();
        let worst = worst_difference(&map.errors, &truth);
        let mean = truth.iter().sum::<f64>() / truth.len() as f64;
        println!(
            "{name}: mean {mean:.6} (ours {:+.1e}), worst pixel {worst:.1e}",
            map.mean - mean
        );
        assert!(worst < PIXEL_TOLERANCE, "{name}: a pixel is off by {worst}");
        assert!(
            (map.mean - mean).abs() < EVALUATOR_MEAN_TOLERANCE,
            "{name}: {} for {mean}",
            map.mean
        );
    }
}

#[test]
fn default_viewing_condition_is_the_authors() {
    assert!((f64::from(DEFAULT_PIXELS_PER_DEGREE) - 3840.0 * PI / 180.0).abs() < 1e-5);
    assert!((DEFAULT_PIXELS_PER_DEGREE - nv_flip::DEFAULT_PIXELS_PER_DEGREE).abs() < 0.03);
}

#[test]
fn flip_range_from_equal_to_opposite() {
    let map =
        |a: [u8; 3], b: [u8; 3]| flip_map(&constant(9, 21, a), &constant(9, 21, b), 67.0).unwrap();
    let image = pattern(33, 18);
    assert!(
        flip_map(&image, &image, 67.0)
            .unwrap()
            .errors
            .iter()
            .all(|&error| error == 0.0)
    );
    assert_eq!(map([7, 80, 9], [7, 80, 9]).mean, 0.0);
    // Constant images have no features: only the colour error counts, which is largest for green
    // and blue.
    let farthest = map([0, 255, 0], [0, 0, 255]);
    assert!(
        farthest
            .errors
            .iter()
            .all(|&error| (error - 1.0).abs() < 1e-5),
        "{:?}",
        farthest.errors
    );
    let grey = map([128, 128, 128], [129, 129, 129]);
    assert!(
        grey.mean > 0.0 && grey.mean < 0.05,
        "one step of grey is hardly seen: {}",
        grey.mean
    );
}

#[test]
fn one_pixel_is_seen_where_it_is() {
    let black = constant(61, 47, [0; 3]);
    let mut dot = black.clone();
    dot.put_pixel(20, 30, Rgb([255; 3]));
    let map = flip_map(&black, &dot, DEFAULT_PIXELS_PER_DEGREE).unwrap();
    let at = |x: usize, y: usize| map.errors[y * 61 + x];
    assert!(at(20, 30) > 0.3 && map.errors.iter().all(|&error| error <= at(20, 30)));
    // The filters are symmetric with a radius below ten pixels.
    assert_eq!([at(17, 30), at(20, 27)], [at(23, 30), at(20, 33)]);
    assert!((at(17, 30) - at(20, 27)).abs() < 1e-5);
    assert!(at(9, 30) == 0.0 && at(20, 41) == 0.0 && at(16, 30) > 0.0);
}

#[test]
fn no_thread_count_changes_a_bit() {
    let (_, reference, test) = pairs(150, 333).swap_remove(2);
    let run = |threads| -> FlipMap {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| flip_map(&reference, &test, DEFAULT_PIXELS_PER_DEGREE).unwrap())
    };
    let once = run(1);
    assert!(once.mean > 0.01 && [2, 3, 7].into_iter().all(|threads| run(threads) == once));
}

#[test]
fn wrong_viewing_conditions_are_refused() {
    let image = pattern(4, 4);
    for wrong in [f32::NAN, f32::INFINITY, -67.0, 0.0, 0.5, 1e9] {
        let refusal = flip_map(&image, &image, wrong).unwrap_err();
        assert!(
            matches!(refusal, MetricError::PixelsPerDegree(ppd) if ppd.to_bits() == wrong.to_bits())
        );
    }
    assert_eq!(
        flip_map(&image, &image, MAX_PIXELS_PER_DEGREE)
            .unwrap()
            .mean,
        0.0
    );
    assert!(
        flip_map(&pattern(4, 4), &constant(4, 4, [0; 3]), 1.0)
            .unwrap()
            .errors
            .iter()
            .all(|e| e.is_finite())
    );
}

#[test]
fn maps_are_shown_in_magma() {
    let map = FlipMap {
        width: 3,
        height: 1,
        errors: vec![0.0, 0.5, 1.0],
        mean: 0.5,
    };
    assert_eq!(
        map.to_magma().as_raw().as_slice(),
        [0, 0, 4, 183, 55, 121, 252, 253, 191]
    );
}

fn worst_difference(ours: &[f32], truth: &[f64]) -> f64 {
    assert_eq!(ours.len(), truth.len());
    ours.iter()
        .zip(truth)
        .map(|(&a, &b)| (f64::from(a) - b).abs())
        .fold(0.0, f64::max)
}

/// The paper's definition, term by term: two-dimensional filters, f64, no separation.
mod oracle {
    use std::f64::consts::PI;

    use image::RgbImage;

    type Plane = Vec<Vec<f64>>;

    const XYZ_FROM_RGB: [[f64; 3]; 3] = [
        [
            10135552.0 / 24577794.0,
            8788810.0 / 24577794.0,
            4435075.0 / 24577794.0,
        ],
        [
            2613072.0 / 12288897.0,
            8788810.0 / 12288897.0,
            887015.0 / 12288897.0,
        ],
        [
            1425312.0 / 73733382.0,
            8788810.0 / 73733382.0,
            70074185.0 / 73733382.0,
        ],
    ];
    /// Inverse of [`XYZ_FROM_RGB`], with the digits of the authors' evaluator.
    const RGB_FROM_XYZ: [[f64; 3]; 3] = [
        [3.241003275, -1.537398934, -0.498615861],
        [-0.969224334, 1.875930071, 0.041554224],
        [0.055639423, -0.204011202, 1.057148933],
    ];
    const WHITE: [f64; 3] = [0.950428545, 1.0, 1.088900371];

    pub(crate) fn flip(reference: &RgbImage, test: &RgbImage, ppd: f64) -> Vec<f64> {
        let (width, height) = (reference.width() as usize, reference.height() as usize);
        let planes = [reference, test].map(|image| [0, 1, 2].map(|c| plane(image, c)));
        let seen = planes.clone().map(|[y, cx, cz]| {
            [
                convolve(&y, &contrast_sensitivity(ppd, &[(1.0, 0.0047)])),
                convolve(&cx, &contrast_sensitivity(ppd, &[(1.0, 0.0053)])),
                convolve(
                    &cz,
                    &contrast_sensitivity(ppd, &[(34.1, 0.04), (13.5, 0.025)]),
                ),
            ]
        });
        let features = [false, true].map(|point| {
            let kernel = feature_detector(ppd, point);
            let transposed: Plane = (0..kernel.len())
                .map(|i| kernel.iter().map(|row| row[i]).collect())
                .collect();
            planes.clone().map(|[y, ..]| {
                let y: Plane = y
                    .iter()
                    .map(|row| row.iter().map(|v| (v + 16.0) / 116.0).collect())
                    .collect();
                let (across, down) = (convolve(&y, &kernel), convolve(&y, &transposed));
                move |i: usize, j: usize| across[j][i].hypot(down[j][i])
            })
        });
        let cmax = hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])).powf(0.7);
        let error = |i: usize, j: usize| {
            let [a, b] = seen.each_ref().map(|planes| {
                let [y, cx, cz] = planes.each_ref().map(|plane| plane[j][i]);
                let y = (y + 16.0) / 116.0;
                let relative = [y + cx / 500.0, y, y - cz / 200.0];
                let xyz = [0, 1, 2].map(|c| relative[c] * WHITE[c]);
                hunt_lab(transform(RGB_FROM_XYZ, xyz).map(|v| v.clamp(0.0, 1.0)))
            });
            let difference = hyab(a, b).powf(0.7);
            let color = if difference < 0.4 * cmax {
                0.95 / (0.4 * cmax) * difference
            } else {
                0.95 + (difference - 0.4 * cmax) / (cmax - 0.4 * cmax) * 0.05
            };
            let [edge, point] = features.each_ref().map(|[a, b]| (a(i, j) - b(i, j)).abs());
            color.powf(1.0 - (edge.max(point) / 2.0_f64.sqrt()).sqrt())
        };
        (0..height)
            .flat_map(|j| (0..width).map(move |i| (i, j)))
            .map(|(i, j)| error(i, j))
            .collect()
    }

    /// One channel of YCxCz.
    fn plane(image: &RgbImage, channel: usize) -> Plane {
        let ycxcz = |x, y| {
            let linear = image[(x, y)].0.map(|v| {
                let v = f64::from(v) / 255.0;
                if v <= 0.04045 {
                    v / 12.92
                } else {
                    ((v + 0.055) / 1.055).powf(2.4)
                }
            });
            let xyz = transform(XYZ_FROM_RGB, linear);
            let [x, y, z] = [0, 1, 2].map(|c| xyz[c] / WHITE[c]);
            [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)][channel]
        };
        (0..image.height())
            .map(|y| (0..image.width()).map(|x| ycxcz(x, y)).collect())
            .collect()
    }

    fn contrast_sensitivity(ppd: f64, gaussians: &[(f64, f64)]) -> Plane {
        let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * ppd).ceil() as i32;
        let mut kernel = square(radius, |x, y| {
            let squared = (x * x + y * y) / (ppd * ppd);
            gaussians
                .iter()
                .map(|(a, b)| a * (PI / b).sqrt() * (-PI * PI * squared / b).exp())
                .sum()
        });
        let sum: f64 = kernel.iter().flatten().sum();
        kernel.iter_mut().flatten().for_each(|tap| *tap /= sum);
        kernel
    }

    /// The horizontal edge or point detector; positive taps sum to 1, negative ones to -1.
    fn feature_detector(ppd: f64, point: bool) -> Plane {
        let sigma = 0.5 * 0.082 * ppd;
        let mut kernel = square((3.0 * sigma).ceil() as i32, |x, y| {
            let g = (-(x * x + y * y) / (2.0 * sigma * sigma)).exp();
            if point {
                (x * x / (sigma * sigma) - 1.0) * g
            } else {
                -x * g
            }
        });
        let sum = |keep: fn(f64) -> bool| {
            kernel
                .iter()
                .flatten()
                .filter(|&&tap| keep(tap))
                .sum::<f64>()
                .abs()
        };
        let (positive, negative) = (sum(|tap| tap > 0.0), sum(|tap| tap < 0.0));
        kernel
            .iter_mut()
            .flatten()
            .for_each(|tap| *tap /= if *tap > 0.0 { positive } else { negative });
        kernel
    }

    fn square(radius: i32, tap: impl Fn(f64, f64) -> f64) -> Plane {
        let taps = |y: i32| {
            (-radius..=radius)
                .map(|x| tap(f64::from(x), f64::from(y)))
                .collect()
        };
        (-radius..=radius).map(taps).collect()
    }

    fn convolve(plane: &Plane, kernel: &Plane) -> Plane {
        let radius = kernel.len() as isize / 2;
        let clamped = |i: usize, k: usize, len: usize| {
            (i as isize + k as isize - radius).clamp(0, len as isize - 1) as usize
        };
        let at = |i: usize, j: usize| -> f64 {
            let row = |l: usize| &plane[clamped(j, l, plane.len())];
            let sum = |(l, taps): (usize, &Vec<f64>)| -> f64 {
                taps.iter()
                    .enumerate()
                    .map(|(k, tap)| tap * row(l)[clamped(i, k, plane[0].len())])
                    .sum()
            };
            kernel.iter().enumerate().map(sum).sum()
        };
        (0..plane.len())
            .map(|j| (0..plane[0].len()).map(|i| at(i, j)).collect())
            .collect()
    }

    fn hunt_lab(rgb: [f64; 3]) -> [f64; 3] {
        let xyz = transform(XYZ_FROM_RGB, rgb);
        let delta: f64 = 6.0 / 29.0;
        let [x, y, z] = [0, 1, 2].map(|c| xyz[c] / WHITE[c]).map(|v: f64| {
            if v > delta.powi(3) {
                v.cbrt()
            } else {
                v / (3.0 * delta * delta) + 4.0 / 29.0
            }
        });
        let lightness = 116.0 * y - 16.0;
        [
            lightness,
            0.01 * lightness * 500.0 * (x - y),
            0.01 * lightness * 200.0 * (y - z),
        ]
    }

    fn hyab(a: [f64; 3], b: [f64; 3]) -> f64 {
        (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
    }

    fn transform(matrix: [[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
        matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
    }
}
