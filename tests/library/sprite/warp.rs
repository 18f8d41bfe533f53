//! Promises of sprite rendering: accuracy against f64 oracles, equality of every way to run,
//! answers to degenerate views. The oracles are in `oracle.rs`.

use super::oracle::{Waves, bilinear, camera, look, picture, sprite};
use glam::{DMat3, DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::simd::levels;
use headbox_sprite::{
    Displacement, DisplacementFormat, Outcome, PreparedSprite, RenderOptions, Sprite, SpriteLayer,
    SpritePlane, SpriteRenderer, SpriteSampling, SpriteTransfer, SpriteVariant, SpriteWithDepth,
};
use image::{Rgba, RgbaImage};
use proptest::prelude::*;

pub(super) fn options(variant: SpriteVariant, sampling: SpriteSampling) -> RenderOptions {
    RenderOptions {
        variant,
        sampling,
        ..RenderOptions::default()
    }
}

pub(super) fn render(
    sprite: &PreparedSprite,
    target: &Camera,
    options: &RenderOptions,
) -> (Outcome, SpriteLayer) {
    let mut frame = SpriteLayer::default();
    let outcome = SpriteRenderer::new().render(sprite, target, options, &mut frame);
    (outcome, frame)
}

/// Tolerance: half a level of final rounding, 0.023 of the weights' rounding (see `sampling.rs`),
/// and positions that are off by a few 1e-6 px at a contrast of 255 levels per pixel. Equal to the
/// error of OpenCV 5 at 1024x1024.
const HOMOGRAPHY_TOLERANCE: f64 = 0.53;

/// The warp of the speed comparison: rotation, scale and perspective; the origin of positions is a
/// pixel corner.
fn benchmark_homography(n: f64) -> DMat3 {
    let (sin, cos) = 12.0f64.to_radians().sin_cos();
    let c = n / 2.0;
    let to = DMat3::from_cols(DVec3::X, DVec3::Y, dvec3(-c, -c, 1.0));
    let back = DMat3::from_cols(DVec3::X, DVec3::Y, dvec3(c, c, 1.0));
    let middle = DMat3::from_cols(
        dvec3(0.8 * cos, 0.75 * sin, 0.15 / n),
        dvec3(-0.8 * sin, 0.85 * cos, -0.1 / n),
        dvec3(3.3, -2.7, 1.0),
    );
    back * middle * to
}

#[test]
fn homography_error_is_within_bilinear_rounding() {
    for n in [64, 256, 1000] {
        let mut picture = picture(n);
        for (x, y, pixel) in picture.enumerate_pixels_mut() {
            pixel.0[3] = if (x * 7 + y * 3) % 11 == 0 { 90 } else { 255 };
        }
        let transfer = SpriteTransfer::from_parts(
            benchmark_homography(f64::from(n)).inverse(),
            DVec3::ZERO,
            1.0,
        );
        let transfer = transfer.expect("regular");
        let prepared = PreparedSprite::new(sprite(n, picture.clone(), Displacement::zero(n, n)));
        let mut frame = SpriteLayer::new(n, n);
        let options = options(SpriteVariant::Homography, SpriteSampling::Bilinear);
        SpriteRenderer::new().render_transfer(&prepared, &transfer, &options, &mut frame);
        let mut worst = 0.0f64;
        for (i, pixel) in frame.pixels().iter().enumerate() {
            let (x, y) = (f64::from(i as u32 % n) + 0.5, f64::from(i as u32 / n) + 0.5);
            let p = transfer.sprite_from_target * dvec3(x, y, 1.0);
            let want = bilinear(&picture, p.x / p.z, p.y / p.z);
            let off = (0..4).map(|c| (f64::from(pixel[c]) - want[c]).abs());
            worst = off.fold(worst, f64::max);
        }
        println!("homography {n}x{n}: largest error {worst:.4} levels");
        assert!(worst <= HOMOGRAPHY_TOLERANCE, "{worst} levels at {n}x{n}");
    }
}

/// Views that move, turn, magnify and minify.
fn views(size: u32) -> Vec<Camera> {
    vec![
        camera(size),
        look(dvec3(0.6, 0.3, 1.7), DVec3::ZERO, size),
        look(dvec3(-0.2, 0.1, 0.7), dvec3(0.1, 0.0, 0.0), size),
        look(dvec3(0.5, -0.4, 9.0), DVec3::ZERO, size),
        look(dvec3(0.3, 0.2, -2.5), DVec3::ZERO, size),
    ]
}

/// A disk with soft edges and a hole.
fn matted(size: u32) -> RgbaImage {
    let mut picture = picture(size);
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let radius = ((f64::from(x) - 60.0).hypot(f64::from(y) - 70.0) - 50.0).abs();
        pixel.0[3] = (255.0 * (20.0 - radius).clamp(0.0, 1.0)) as u8;
    }
    picture
}

#[test]
fn zero_displacement_equals_homography() {
    for (grid, picture) in [(130, picture(130)), (130, matted(130)), (33, matted(130))] {
        let prepared = PreparedSprite::new(sprite(130, picture, Displacement::zero(grid, grid)));
        for target in views(150) {
            for sampling in [SpriteSampling::Nearest, SpriteSampling::Bilinear] {
                let (_, want) = render(
                    &prepared,
                    &target,
                    &options(SpriteVariant::Homography, sampling),
                );
                assert!(
                    want.pixels().iter().any(|p| p[3] > 0),
                    "the sprite is in view"
                );
                for variant in [
                    SpriteVariant::OnePass,
                    SpriteVariant::TwoPass,
                    SpriteVariant::ShiftField,
                    SpriteVariant::AffineParallax,
                    SpriteVariant::AsPrinted,
                ] {
                    for fill_steps in [0, 3] {
                        let (_, got) = render(
                            &prepared,
                            &target,
                            &RenderOptions {
                                variant,
                                sampling,
                                fill_steps,
                            },
                        );
                        let differing = got
                            .pixels()
                            .iter()
                            .zip(want.pixels())
                            .filter(|(a, b)| a != b)
                            .count();
                        assert_eq!(
                            differing,
                            0,
                            "{} {sampling:?}, {grid} cells",
                            variant.name()
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn levels_and_threads_do_not_change_a_bit() {
    let waves = Waves {
        amplitude: 0.06,
        waves: 1.5,
    };
    let prepared = PreparedSprite::new(sprite(
        130,
        matted(130),
        waves.displacement(130, DisplacementFormat::I8),
    ));
    for target in views(150) {
        for variant in SpriteVariant::ALL {
            for sampling in [SpriteSampling::Nearest, SpriteSampling::Bilinear] {
                let options = options(variant, sampling);
                let (_, want) = render(&prepared, &target, &options);
                for level in levels() {
                    for threads in [1, 3] {
                        let pool = rayon::ThreadPoolBuilder::new()
                            .num_threads(threads)
                            .build()
                            .expect("threads");
                        let mut got = SpriteLayer::default();
                        let mut renderer = SpriteRenderer::with_level(level);
                        pool.install(|| renderer.render(&prepared, &target, &options, &mut got));
                        assert_eq!(
                            got,
                            want,
                            "{} {level:?} on {threads} threads",
                            variant.name()
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn degenerate_views_are_transparent_and_named() {
    let waves = Waves {
        amplitude: 0.1,
        waves: 1.0,
    };
    let prepared = PreparedSprite::new(sprite(
        64,
        picture(64),
        waves.displacement(64, DisplacementFormat::I8),
    ));
    let plane = *prepared.sprite().sprite().plane();
    let in_plane = plane.normal.any_orthonormal_vector();
    let cases = [
        (look(in_plane * 2.0, DVec3::ZERO, 64), Outcome::EdgeOn),
        (look(DVec3::ZERO, plane.normal, 64), Outcome::EdgeOn),
        (
            look(dvec3(0.0, 0.0, 3.0), dvec3(0.0, 0.0, 9.0), 64),
            Outcome::Behind,
        ),
    ];
    for (target, outcome) in cases {
        for variant in SpriteVariant::ALL {
            let (found, frame) = render(
                &prepared,
                &target,
                &options(variant, SpriteSampling::Bilinear),
            );
            assert_eq!(found, outcome, "{}", variant.name());
            assert!(frame.pixels().iter().all(|p| *p == [0; 4]));
        }
    }
    // The epipole inside the sprite: forward and backward motion through its middle.
    for z in [1.2, 3.0] {
        let toward = look(camera(64).eye() * z / 2.0, DVec3::ZERO, 64);
        let (outcome, frame) = render(&prepared, &toward, &RenderOptions::default());
        assert_eq!(outcome, Outcome::Drawn);
        let middle = frame.pixels()[32 * 64 + 32];
        assert_eq!(middle[3], 255, "no gap at the epipole");
    }
}

#[test]
fn nearer_surface_wins_at_folds() {
    // A tall step: its right half, much nearer, moves over the left half.
    let size = 96;
    let mut color = RgbaImage::from_pixel(size, size, Rgba([255, 0, 0, 255]));
    let step = |x: u32| x >= size / 2;
    for (x, _, pixel) in color.enumerate_pixels_mut() {
        *pixel = if step(x) {
            Rgba([0, 255, 0, 255])
        } else {
            *pixel
        };
    }
    let values: Vec<f32> = (0..size * size)
        .map(|i| if step(i % size) { 0.5 } else { 0.0 })
        .collect();
    let displacement =
        Displacement::new(size, size, &values, DisplacementFormat::F32).expect("finite");
    let prepared = PreparedSprite::new(sprite(size, color, displacement));
    let target = look(camera(size).eye() + DVec3::X * 0.3, DVec3::X * 0.25, size);
    let transfer = SpriteTransfer::new(prepared.sprite().sprite(), &target).expect("in front");
    for variant in [
        SpriteVariant::TwoPass,
        SpriteVariant::ShiftField,
        SpriteVariant::ForwardColor,
    ] {
        let (_, frame) = render(
            &prepared,
            &target,
            &options(variant, SpriteSampling::Nearest),
        );
        let (x, y) = (f64::from(size) * 0.6, f64::from(size) / 2.0);
        let [tx, ty] = transfer.forward(x, y, 0.5).expect("in front");
        let pixel = frame.pixels()[ty as usize * size as usize + tx as usize];
        assert_eq!(pixel, [0, 255, 0, 255], "{}", variant.name());
    }
}

/// A near surface that rises by `height(column)` from column 20 to 60, in front of a far plane,
/// moved by pure parallax of 90 px per unit to the right, without filling. Returns the first column
/// of the frame's middle row behind which the surface has a gap.
fn first_crack(height: impl Fn(f32) -> f32, format: DisplacementFormat) -> Option<usize> {
    const SIDE: u32 = 96;
    let rises = |x: u32| (20..60).contains(&x);
    let color = RgbaImage::from_fn(SIDE, SIDE, |x, _| {
        if rises(x) {
            Rgba([0, 255, 0, 255])
        } else {
            Rgba([255, 0, 0, 255])
        }
    });
    let at = |x: u32| {
        if rises(x) {
            height((x as f32 - 19.5) / 40.0)
        } else {
            0.0
        }
    };
    let values: Vec<f32> = (0..SIDE * SIDE).map(|i| at(i % SIDE)).collect();
    let displacement = Displacement::new(SIDE, SIDE, &values, format).expect("finite");
    let prepared = PreparedSprite::new(sprite(SIDE, color, displacement));
    let transfer =
        SpriteTransfer::from_parts(DMat3::IDENTITY, dvec3(90.0, 0.0, 0.0), 1.0).expect("regular");
    let mut frame = SpriteLayer::new(192, SIDE);
    let options = RenderOptions {
        fill_steps: 0,
        ..options(SpriteVariant::TwoPass, SpriteSampling::Nearest)
    };
    SpriteRenderer::new().render_transfer(&prepared, &transfer, &options, &mut frame);
    let row = &frame.pixels()[192 * 48..192 * 49];
    // One pixel at either end depends on rounding.
    let end = 58 + (90.0 * height(39.0 / 40.0)) as usize;
    (22..end).find(|&x| row[x] != [0, 255, 0, 255])
}

#[test]
fn stretched_near_surface_has_no_cracks() {
    // Stretched by 2.8 to 4.6; both rise steeply, one linearly, one so curved that its cells move
    // separately.
    for format in [DisplacementFormat::I8, DisplacementFormat::F32] {
        assert_eq!(
            first_crack(|t| 0.8 * t, format),
            None,
            "straight, {format:?}"
        );
        assert_eq!(
            first_crack(|t| 0.4 * t + 0.4 * t * t, format),
            None,
            "bent, {format:?}"
        );
    }
}

#[test]
fn a_narrow_frame_is_as_sharp_as_a_wide_one() {
    // Stripes of two pixels on a plane that recedes to the right: the footprint grows from column
    // to column.
    let stripes = RgbaImage::from_fn(256, 256, |x, _| {
        if x / 2 % 2 == 0 {
            Rgba([255; 4])
        } else {
            Rgba([0, 0, 0, 255])
        }
    });
    let prepared = PreparedSprite::new(sprite(256, stripes, Displacement::zero(256, 256)));
    let wide = look(dvec3(-1.1, 0.0, 0.45), dvec3(-0.2, 0.0, 0.0), 256);
    let (_, whole) = render(&prepared, &wide, &RenderOptions::default());
    let contrast = |frame: &SpriteLayer, first: usize, width: usize| {
        let rows = frame.pixels().chunks_exact(width).skip(110).take(36);
        let steps = rows.flat_map(|row| {
            row[first..first + 15]
                .windows(2)
                .map(|p| p[0][0].abs_diff(p[1][0]))
        });
        steps.map(f64::from).sum::<f64>() / (36.0 * 14.0)
    };
    for first in [40u32, 90, 140] {
        let narrow = wide.cropped(first..first + 15, 0..256).expect("inside");
        let (_, part) = render(&prepared, &narrow, &RenderOptions::default());
        let (part, whole) = (
            contrast(&part, 0, 15),
            contrast(&whole, first as usize, 256),
        );
        println!("columns from {first}: contrast {part:.1} narrow, {whole:.1} wide");
        assert!(part > 0.9 * whole && part > 5.0, "{part} {whole}");
    }
}

#[test]
fn a_flat_picture_shrinks_to_its_mean() {
    let fine = RgbaImage::from_fn(256, 256, |x, y| {
        if (x + y) % 2 == 0 {
            Rgba([255; 4])
        } else {
            Rgba([0, 0, 0, 255])
        }
    });
    let prepared = PreparedSprite::new(sprite(256, fine, Displacement::zero(256, 256)));
    let far = look(dvec3(0.1, 0.1, 16.0), DVec3::ZERO, 256);
    let (_, frame) = render(&prepared, &far, &RenderOptions::default());
    let opaque: Vec<_> = frame.pixels().iter().filter(|p| p[3] == 255).collect();
    assert!(
        opaque.len() > 200 && opaque.iter().all(|p| p[0].abs_diff(128) <= 2),
        "no aliasing of a 1-px checker"
    );
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    /// For any eye and displacement, frames are valid premultiplied images.
    #[test]
    fn any_view_gives_a_valid_frame(
        eye in prop::array::uniform3(-3.0..3.0f64),
        at in prop::array::uniform3(-1.0..1.0f64),
        amplitude in 0.0..2.0f32,
        sides in (1u32..40, 1u32..40),
        divisor in 1u32..5,
        seed in any::<u32>(),
        variant in 0..SpriteVariant::ALL.len(),
        nearest in any::<bool>(),
    ) {
        prop_assume!(DVec3::from(eye) != DVec3::from(at));
        let (width, height) = sides;
        let noise = |i: u32| (i ^ seed).wrapping_mul(2_654_435_761).rotate_left(15).wrapping_mul(40_503);
        let color = RgbaImage::from_fn(width, height, |x, y| Rgba(noise(x * 64 + y).to_le_bytes()));
        let (columns, rows) = (width.div_ceil(divisor), height.div_ceil(divisor));
        let values: Vec<f32> = (0..columns * rows).map(|i| amplitude * (noise(i) as f32 / 2f32.powi(31) - 1.0)).collect();
        let displacement = Displacement::new(columns, rows, &values, DisplacementFormat::I16).expect("finite");
        let camera = Camera::look_at(dvec3(0.0, 0.0, 2.0), DVec3::ZERO, DVec3::Y, 60.0, [width, height]).expect("valid");
        let plane = SpritePlane::through(DVec3::ZERO, dvec3(0.1, 0.2, 1.0));
        let sprite = Sprite::new(color, camera, plane).expect("valid");
        let prepared = PreparedSprite::new(SpriteWithDepth::new(sprite, displacement).expect("valid"));
        let target = Camera::look_at(eye.into(), at.into(), DVec3::Y, 80.0, [37, 21]).expect("valid");
        let sampling = if nearest { SpriteSampling::Nearest } else { SpriteSampling::Bilinear };
        let (_, frame) = render(&prepared, &target, &options(SpriteVariant::ALL[variant], sampling));
        prop_assert_eq!(frame.pixels().len(), 37 * 21);
        prop_assert!(frame.pixels().iter().all(|p| p[..3].iter().all(|&c| c <= p[3])));
    }
}
