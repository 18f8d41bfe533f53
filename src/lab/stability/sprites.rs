//! Cases of sprites with depth (hard case 6; C4 to C7).

use super::Case;
use super::fixtures::{case_rng, largest, look_along, random_direction};
use glam::{DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::random::Rng;
use headbox_sprite::{
    Displacement, DisplacementFormat, Outcome, PreparedSprite, RenderOptions, Sprite, SpriteLayer,
    SpritePlane, SpriteRenderer, SpriteSampling, SpriteTransfer, SpriteVariant, SpriteWithDepth,
};
use image::{Rgba, RgbaImage};

const SIZE: u32 = 48;

pub(super) fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "plane through the target's eye",
            what: "Target eyes in the sprite's plane and within 1e-12 m of it: pixels that are drawn, all variants.",
            unit: "px",
            bound: 0.0,
            reason: "A plane seen edge-on is a line: it is named and left out.",
            measure: |seed| {
                let mut rng = case_rng(seed, 61);
                let sprite = PreparedSprite::new(sprite(&mut rng, 0.1)?);
                largest([0.0, 1e-12, -1e-12, 1e-6].map(|off| {
                    let eye = dvec3(rng.between(-1.0, 1.0), rng.between(-1.0, 1.0), -2.0 + off);
                    let target = camera(eye, random_direction(&mut rng))?;
                    largest(SpriteVariant::ALL.map(|variant| {
                        let (outcome, frame) = render(&sprite, &target, variant);
                        let drawn = frame.pixels().iter().filter(|p| p[3] > 0).count();
                        Some(if outcome == Outcome::Drawn {
                            1.0
                        } else {
                            drawn as f64
                        })
                    }))
                }))
            },
        },
        Case {
            name: "homographies against projection",
            what: "Sprite pixels through H12, and back through H21, planes seen down to 0.1 degrees, against the point of the plane that they show, projected by either camera: points in both frames.",
            unit: "px",
            bound: 1e-6,
            reason: "The matrices are f64; at 0.1 degrees their condition is some 1e8, which leaves 8 digits.",
            measure: |seed| {
                let mut rng = case_rng(seed, 62);
                largest((0..40).map(|_| {
                    let sprite = sprite(&mut rng, 0.0)?;
                    let height = 10f64.powf(rng.between(-2.7, 0.0));
                    let target = camera(
                        dvec3(rng.between(-0.5, 0.5), 1.0, -2.0 + height),
                        dvec3(0.0, -1.0, 0.0),
                    )?;
                    let Ok(transfer) = SpriteTransfer::new(sprite.sprite(), &target) else {
                        return Some(0.0);
                    };
                    let [x, y] = [0, 1].map(|_| rng.between(0.0, f64::from(SIZE)));
                    // The plane is 2 m in front of the origin, the eye of the sprite's camera.
                    let source = sprite.sprite().camera();
                    let point = source.eye() + source.direction(x, y) * 2.0;
                    let Some([tx, ty, depth]) = target.project(point) else {
                        return Some(0.0);
                    };
                    let frame = 0.0..f64::from(SIZE);
                    if depth < 1e-3 || !frame.contains(&tx) || !frame.contains(&ty) {
                        return Some(0.0);
                    }
                    let forward = transfer.target_from_sprite * dvec3(x, y, 1.0);
                    let back = transfer.sprite_from_target * dvec3(tx, ty, 1.0);
                    let [forward, back] = [forward, back].map(|h| (h.x / h.z, h.y / h.z));
                    Some(
                        (forward.0 - tx)
                            .hypot(forward.1 - ty)
                            .max((back.0 - x).hypot(back.1 - y)),
                    )
                }))
            },
        },
        Case {
            name: "no displacement is the homography",
            what: "Bytes that differ between two-pass and homography, and one-pass and homography, with d = 0 everywhere.",
            unit: "px",
            bound: 0.0,
            reason: "Bit for bit: displacement 0 is a number of its own in every format.",
            measure: |seed| {
                let mut rng = case_rng(seed, 63);
                let sprite = PreparedSprite::new(sprite(&mut rng, 0.0)?);
                let target = camera(rng.in_cube(0.4), DVec3::NEG_Z)?;
                let (_, flat) = render(&sprite, &target, SpriteVariant::Homography);
                largest(
                    [SpriteVariant::OnePass, SpriteVariant::TwoPass].map(|variant| {
                        let (_, frame) = render(&sprite, &target, variant);
                        let pairs = frame.pixels().iter().zip(flat.pixels());
                        Some(pairs.filter(|(a, b)| a != b).count() as f64)
                    }),
                )
            },
        },
        Case {
            name: "folding",
            what: "A near strip before a far ground, moved over each other by parallax: pixels in the middle of the strip's place that show the ground.",
            unit: "px",
            bound: 0.0,
            reason: "Of two samples that land on one place the nearer one is kept (C7).",
            measure: folding,
        },
        Case {
            name: "steep and wild displacement",
            what: "Displacements at random between the eye and far behind, all variants, eyes anywhere: frames with pixels whose colour exceeds their alpha.",
            unit: "px",
            bound: 0.0,
            reason: "Pixels are premultiplied; whatever the geometry, colour stays within alpha.",
            measure: |seed| {
                let mut rng = case_rng(seed, 65);
                let sprite = PreparedSprite::new(sprite(&mut rng, 0.8)?);
                largest(SpriteVariant::ALL.map(|variant| {
                    let target = camera(
                        rng.in_cube(1.5),
                        (DVec3::NEG_Z + rng.in_cube(0.5)).normalize(),
                    )?;
                    let (_, frame) = render(&sprite, &target, variant);
                    let excess = |p: &&[u8; 4]| p[..3].iter().any(|c| *c > p[3]);
                    Some(frame.pixels().iter().filter(excess).count() as f64)
                }))
            },
        },
        Case {
            name: "exact inverse of the forward map (C5)",
            what: "Sprite pixels of random displacement forward by Eq. 4 and back by Eq. 7 and 8 as corrected, in f64.",
            unit: "px",
            bound: 1e-8,
            reason: "The corrected form is the exact inverse; as printed it errs by up to a pixel.",
            measure: |seed| {
                let mut rng = case_rng(seed, 66);
                let sprite = sprite(&mut rng, 0.0)?;
                let target = camera(
                    rng.in_cube(0.4),
                    (DVec3::NEG_Z + rng.in_cube(0.2)).normalize(),
                )?;
                let t = SpriteTransfer::new(sprite.sprite(), &target).ok()?;
                largest((0..200).map(|_| {
                    let [x, y] = [0, 1].map(|_| rng.between(0.0, f64::from(SIZE)));
                    let d = rng.between(-0.05, 0.05);
                    let Some([x2, y2]) = t.forward(x, y, d) else {
                        return Some(0.0);
                    };
                    // w3 and the de-homogenised first term: (x1, y1) = (x3, y3, 1) - (d / w3) e*.
                    let w3 = 1.0 + d * t.epipole_in_sprite.z;
                    let h = t.sprite_from_target * dvec3(x2, y2, 1.0);
                    let back = h / h.z - t.epipole_in_sprite * (d / w3);
                    Some((back.x / back.z - x).hypot(back.y / back.z - y))
                }))
            },
        },
    ]
}

fn camera(eye: DVec3, forward: DVec3) -> Option<Camera> {
    look_along(eye, forward, 55.0, [SIZE, SIZE]).ok()
}

/// Creates a sprite on the plane z = -2, seen from the origin, with random displacements up to
/// `steepness` of the distance to the eye.
fn sprite(rng: &mut Rng, steepness: f64) -> Option<SpriteWithDepth> {
    let color = RgbaImage::from_fn(SIZE, SIZE, |x, y| {
        Rgba([(x * 5) as u8, (y * 5) as u8, 128, 255])
    });
    let plane = SpritePlane::through(dvec3(0.0, 0.0, -2.0), DVec3::Z);
    let sprite = Sprite::new(color, camera(DVec3::ZERO, DVec3::NEG_Z)?, plane).ok()?;
    let values: Vec<f32> = (0..SIZE * SIZE)
        .map(|_| rng.between(-steepness, steepness) as f32)
        .collect();
    let displacement = Displacement::new(SIZE, SIZE, &values, DisplacementFormat::I8).ok()?;
    SpriteWithDepth::new(sprite, displacement).ok()
}

fn render(
    sprite: &PreparedSprite,
    target: &Camera,
    variant: SpriteVariant,
) -> (Outcome, SpriteLayer) {
    let mut frame = SpriteLayer::default();
    let options = RenderOptions {
        variant,
        sampling: SpriteSampling::Nearest,
        ..RenderOptions::default()
    };
    let outcome = SpriteRenderer::new().render(sprite, target, &options, &mut frame);
    (outcome, frame)
}

/// Counts the pixels in the middle of a near strip that show the ground behind it.
fn folding(seed: u64) -> Option<f64> {
    let mut rng = case_rng(seed, 64);
    const STRIP: std::ops::Range<u32> = 20..28;
    let color = RgbaImage::from_fn(SIZE, SIZE, |x, _| {
        if STRIP.contains(&x) {
            Rgba([250, 0, 0, 255])
        } else {
            Rgba([0, 0, 250, 255])
        }
    });
    let plane = SpritePlane::through(dvec3(0.0, 0.0, -2.0), DVec3::Z);
    let sprite = Sprite::new(color, camera(DVec3::ZERO, DVec3::NEG_Z)?, plane).ok()?;
    // d = (Z_plane - Z) / Z of the strip.
    let near = rng.between(0.3, 0.8);
    let values: Vec<f32> = (0..SIZE * SIZE)
        .map(|i| {
            if STRIP.contains(&(i % SIZE)) {
                near as f32
            } else {
                0.0
            }
        })
        .collect();
    let displacement = Displacement::new(SIZE, SIZE, &values, DisplacementFormat::F32).ok()?;
    let sprite = SpriteWithDepth::new(sprite, displacement).ok()?;
    let target = camera(dvec3(rng.between(-0.4, 0.4), 0.0, 0.0), DVec3::NEG_Z)?;
    let transfer = SpriteTransfer::new(sprite.sprite(), &target).ok()?;
    let [left, _] = transfer.forward(f64::from(STRIP.start) + 2.0, 24.0, near)?;
    let [right, _] = transfer.forward(f64::from(STRIP.end) - 2.0, 24.0, near)?;
    let (_, frame) = render(
        &PreparedSprite::new(sprite),
        &target,
        SpriteVariant::TwoPass,
    );
    let inside = |x: u32| (left..right).contains(&(f64::from(x) + 0.5));
    let is_wrong = |i: &u32| inside(i % SIZE) && frame.pixels()[*i as usize][0] < 200;
    Some((0..SIZE * SIZE).filter(is_wrong).count() as f64)
}
