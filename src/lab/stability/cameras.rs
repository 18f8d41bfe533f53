//! Cases of cameras and sizes.

use super::Case;
use super::fixtures::{
    ROOM, build_ldi, case_rng, draw, largest, look_along, mean_levels, pack, random_direction,
    sample,
};
use glam::{DMat3, DVec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::random::Rng;
use headbox_cube::model::samples::CubeSamples;
use headbox_cube::render::RenderSettings;
use headbox_cube::render::setup::transfer::Transfer;

/// Bound of the mean error of a furnished room with faces of 128 px, levels.
const ROOM_LEVELS: f64 = 16.0;

pub(super) fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "field of view of 1 degree",
            what: "A smooth wall 1 m away on faces of 256 px (21 frame pixels to a sample), seen from within the headbox: mean difference from the wall's own colour.",
            unit: "levels",
            bound: 3.0,
            reason: "Colours are 8-bit samples, interpolated: half a level of rounding, and what a tent of several samples leaves of a slope of a level a sample.",
            measure: |seed| smooth_wall(seed, 1.0, 256),
        },
        Case {
            name: "field of view of 170 degrees",
            what: "The same on faces of 40 px, from closer to the centre.",
            unit: "levels",
            bound: 4.0,
            reason: "The slope is 6 levels a sample; a pixel at the rim of such a frame is far smaller than a sample, one in its middle far larger.",
            measure: |seed| smooth_wall(seed, 170.0, 40),
        },
        Case {
            name: "magnified beyond the largest footprint",
            what: "The wall on faces of 40 px at 1 degree, 137 frame pixels to a sample: share of pixels that are holes.",
            unit: "%",
            bound: f64::INFINITY,
            reason: "A footprint reaches 32 px at most, so that samples more than 32 px apart stand alone. It takes a frame 32 times as fine as the capture.",
            measure: |seed| {
                let mut rng = case_rng(seed, 38);
                let camera =
                    look_along(rng.in_cube(0.5), random_direction(&mut rng), 1.0, [64, 48]).ok()?;
                let frame = draw(&pack(&walls(40))?, &camera, &RenderSettings::default());
                Some(100.0 * frame.hole_count() as f64 / frame.color.len() as f64)
            },
        },
        Case {
            name: "magnified thirty times",
            what: "The wall on faces of 40 px at 4.58 degrees, 30 frame pixels to a sample, seen from near the centre: share of pixels that are holes.",
            unit: "%",
            bound: 0.0,
            reason: "Tents reach from sample to sample, 30 px here and 31.6 from where the eye may be; the largest footprint reaches 32 px.",
            measure: |seed| {
                let mut rng = case_rng(seed, 39);
                let camera = look_along(
                    rng.in_cube(0.03),
                    random_direction(&mut rng),
                    4.58,
                    [64, 48],
                )
                .ok()?;
                let frame = draw(&pack(&walls(40))?, &camera, &RenderSettings::default());
                Some(100.0 * frame.hole_count() as f64 / frame.color.len() as f64)
            },
        },
        Case {
            name: "frames of every size",
            what: "Frames of 1x1, 1x97, 97x1, primes, one more and one less than a band: pixels of a closed cube that are holes, and frames of another size than asked for.",
            unit: "px",
            bound: 0.0,
            reason: "A closed cube fills every pixel of every frame from its centre.",
            measure: |seed| {
                let mut rng = case_rng(seed, 31);
                let cube = pack(&walls(33))?;
                let (eye, forward) = (rng.in_cube(0.1), random_direction(&mut rng));
                largest(
                    [
                        [1, 1],
                        [1, 97],
                        [97, 1],
                        [31, 37],
                        [64, 47],
                        [63, 48],
                        [65, 49],
                        [511, 2],
                    ]
                    .map(|size| {
                        // The longer side spans 60 degrees.
                        let focal_px = f64::from(size[0].max(size[1])) * 0.866;
                        let axes = look_along(eye, forward, 60.0, size).ok()?.world_from_eye();
                        let camera =
                            Camera::from_parts(eye, axes, focal_px, size[0], size[1]).ok()?;
                        let frame = draw(&cube, &camera, &RenderSettings::default());
                        let expected = size[0] as usize * size[1] as usize;
                        Some(
                            (frame.hole_count() as usize + frame.color.len().abs_diff(expected))
                                as f64,
                        )
                    }),
                )
            },
        },
        Case {
            name: "faces of every size",
            what: "Closed cubes of faces of 1, 2, 3, 15, 16, 17, 63, 64, 65 px: pixels that are holes from the centre.",
            unit: "px",
            bound: 0.0,
            reason: "Blocks of 64 columns and 16 rows, and batches of 16 lanes, end anywhere.",
            measure: |seed| {
                let mut rng = case_rng(seed, 32);
                let forward = random_direction(&mut rng);
                largest([1, 2, 3, 15, 16, 17, 63, 64, 65].map(|face_px| {
                    let camera = look_along(DVec3::ZERO, forward, 70.0, [20, 16]).ok()?;
                    let frame = draw(&pack(&walls(face_px))?, &camera, &RenderSettings::default());
                    Some(frame.hole_count() as f64)
                }))
            },
        },
        Case {
            name: "camera at 1e7 m looking 1 mm ahead",
            what: "How far the axes of a camera are from a rotation, its up vector nearly along the view.",
            unit: "",
            bound: 1e-12,
            reason: "Axes are made of cross products of unit vectors, normalised; whatever the direction, they stay a rotation.",
            measure: |seed| {
                let mut rng = case_rng(seed, 33);
                largest((0..20).map(|_| {
                    let (eye, forward) =
                        (random_direction(&mut rng) * 1e7, random_direction(&mut rng));
                    let up =
                        forward + random_direction(&mut rng) * 10f64.powf(rng.between(-9.0, 0.0));
                    let camera =
                        Camera::look_at(eye, eye + forward * 1e-3, up, 60.0, [64, 48]).ok()?;
                    let axes = camera.world_from_eye();
                    let error = (axes.transpose() * axes - DMat3::IDENTITY).to_cols_array();
                    Some(error.into_iter().fold(0.0, |m: f64, v| m.max(v.abs())))
                }))
            },
        },
        Case {
            name: "edges and corners of the cube",
            what: "Directions on and within 1e-15 of the cube's edges and corners: how far outside its face a direction lands.",
            unit: "px",
            bound: 1e-9,
            reason: "f64 keeps 8,192 px to 1e-12; which of two faces takes a tie does not matter, that it holds the direction does.",
            measure: |seed| {
                let mut rng = case_rng(seed, 34);
                largest((0..200).map(|_| {
                    let tie = rng
                        .in_cube(1.0)
                        .map(|c| if c.abs() > 0.3 { c.signum() } else { c });
                    let direction = tie + rng.in_cube(1e-15);
                    if direction.length() < 0.1 {
                        return Some(0.0);
                    }
                    let [x, y, depth] = Face::containing(direction).project(direction, 8192);
                    let outside = |c: f64| (-c).max(c - 8192.0).max(0.0);
                    Some(if depth > 0.0 {
                        outside(x).max(outside(y))
                    } else {
                        f64::INFINITY
                    })
                }))
            },
        },
        Case {
            name: "transfer matrices against projection",
            what: "Face pixels at random depths by the matrix of a random camera (1 to 170 degrees, faces to 8,192 px), against the point of the world that they stand for, projected by the camera: points in view.",
            unit: "px",
            bound: 1e-5,
            reason: "Both are f64; a step's error of 2^-53, 8,192 times, is 5e-9 px at the longest focal length (5,500 px), times 1e3 for points a thousandth as far from the eye as from the centre. A wrong sign, axis or half pixel is 0.5 and more.",
            measure: |seed| {
                let mut rng = case_rng(seed, 35);
                largest((0..200).map(|_| {
                    let RandomTransfer {
                        camera,
                        eye,
                        face,
                        size,
                        transfer,
                    } = random_transfer(&mut rng)?;
                    let [x, y] = [0, 1].map(|_| rng.between(0.0, f64::from(size)));
                    let q = rng.between(0.01, 2.0);
                    let warped = transfer.map_infinite(x, y) + transfer.inverse_depth * q;
                    let principal = camera.principal_px();
                    let position = [
                        warped.x / warped.z + principal[0],
                        warped.y / warped.z + principal[1],
                    ];
                    // Points behind the eye, or too near to it to be drawn, have no pixel.
                    match camera.project(face.direction(x, y, size) / q) {
                        Some([px, py, depth]) if depth * q > 1e-3 && in_frame(&camera, px, py) => {
                            Some(
                                (position[0] - px)
                                    .hypot(position[1] - py)
                                    .max((warped.z - depth * q).abs()),
                            )
                        }
                        _ => Some(if eye.is_finite() { 0.0 } else { f64::INFINITY }),
                    }
                }))
            },
        },
        Case {
            name: "condition of transfer matrices",
            what: "Largest ratio of singular values of the same matrices, their columns scaled to one length.",
            unit: "digits",
            bound: 4.5,
            reason: "Scaled, what remains is the focal length in pixels of the frame against 1 (5,500 for 1 degree and 96 px) and the angle of the face's border (a factor of 4): f32 keeps 7.2 digits, so that 2.7 are left at the worst; set-up is therefore done in f64.",
            measure: |seed| {
                let mut rng = case_rng(seed, 36);
                largest((0..50).map(|_| {
                    let RandomTransfer { transfer, .. } = random_transfer(&mut rng)?;
                    let columns =
                        [transfer.x_step, transfer.y_step, transfer.one].map(DVec3::normalize);
                    Some(condition(DMat3::from_cols(columns[0], columns[1], columns[2])).log10())
                }))
            },
        },
        Case {
            name: "a room at every field of view",
            what: "Frames of a captured room, without light, at 20, 60, 120 and 170 degrees against traced ones from the same eyes anywhere in the headbox: mean difference.",
            unit: "levels",
            bound: ROOM_LEVELS,
            reason: "Faces of 128 px blur textures and edges. A frame that is mirrored, turned or drawn in a wrong order is off by thirty levels and more.",
            measure: |seed| {
                let mut rng = case_rng(seed, 37);
                let room = ROOM.as_ref()?;
                largest([20.0, 60.0, 120.0, 170.0].map(|fov| {
                    let camera = room.camera(rng.in_cube(1.0), random_direction(&mut rng), fov)?;
                    let frame = draw(&room.cube, &camera, &RenderSettings::default());
                    Some(mean_levels(&frame, &room.truth(&camera)))
                }))
            },
        },
    ]
}

/// Returns the smooth colour of the walls at a point, levels.
fn color_at(p: DVec3) -> [f64; 3] {
    [0, 1, 2].map(|c| 128.0 + 90.0 * (1.4 * p[c] + 0.7 * p[(c + 1) % 3]).sin())
}

/// Builds an LDI of walls 1 m away on all sides.
fn walls(face_px: u32) -> CubeSamples {
    build_ldi(face_px, &Face::ALL, |face, x, y| {
        vec![sample(
            face,
            1.0,
            color_at(face.direction(x, y, face_px)).map(|c| c.round() as u8),
        )]
    })
}

/// Returns the mean difference of a frame's colours from those of the walls, levels.
fn smooth_wall(seed: u64, fov_deg: f64, face_px: u32) -> Option<f64> {
    let mut rng = case_rng(seed, 30);
    let cube = pack(&walls(face_px))?;
    let eye = rng.in_cube(if fov_deg > 90.0 { 0.1 } else { 0.5 });
    let camera = look_along(eye, random_direction(&mut rng), fov_deg, [64, 48]).ok()?;
    let frame = draw(&cube, &camera, &RenderSettings::default());
    let mut sum = 0.0;
    for (i, color) in frame.color.iter().enumerate() {
        let (x, y) = (i as u32 % camera.width(), i as u32 / camera.width());
        let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
        // Exit of the ray from the cube of half-size 1.
        let t = (0..3)
            .map(|a| (direction[a].signum() - eye[a]) / direction[a])
            .fold(f64::INFINITY, f64::min);
        let truth = color_at(eye + direction * t);
        sum += (0..3)
            .map(|c| (f64::from(color[c]) - truth[c]).abs())
            .sum::<f64>()
            / 3.0;
    }
    Some(sum / frame.color.len() as f64)
}

/// A random camera, a face about the origin, and the transfer between them.
struct RandomTransfer {
    camera: Camera,
    eye: DVec3,
    face: Face,
    size: u32,
    transfer: Transfer,
}

fn random_transfer(rng: &mut Rng) -> Option<RandomTransfer> {
    let face = Face::ALL[rng.below(6) as usize];
    let size = [1, 37, 1024, 8192][rng.below(4) as usize];
    let fov = [1.0, 30.0, 60.0, 120.0, 170.0][rng.below(5) as usize];
    let eye = rng.in_cube(0.5);
    // The face is in view: its centre is within 45 degrees of the camera's axis.
    let forward = (face.normal() + rng.in_cube(0.5)).normalize();
    let camera = look_along(eye, forward, fov, [128, 96]).ok()?;
    Some(RandomTransfer {
        camera,
        eye,
        face,
        size,
        transfer: Transfer::new(&camera, eye, face, size),
    })
}

fn in_frame(camera: &Camera, x: f64, y: f64) -> bool {
    (0.0..f64::from(camera.width())).contains(&x) && (0.0..f64::from(camera.height())).contains(&y)
}

/// Returns the ratio of the largest to the smallest singular value, from the eigenvalues of M^T M
/// (Smith 1961).
fn condition(matrix: DMat3) -> f64 {
    let a = matrix.transpose() * matrix;
    let mean = (a.x_axis.x + a.y_axis.y + a.z_axis.z) / 3.0;
    let b = a - DMat3::from_diagonal(DVec3::splat(mean));
    let squares: f64 = b.to_cols_array().iter().map(|v| v * v).sum();
    let p = (squares / 6.0).sqrt();
    if p == 0.0 {
        return 1.0;
    }
    let angle = ((b * (1.0 / p)).determinant() / 2.0)
        .clamp(-1.0, 1.0)
        .acos()
        / 3.0;
    let largest = mean + 2.0 * p * angle.cos();
    // The smallest from the determinant, the product of all three: this avoids cancellation.
    let middle =
        3.0 * mean - largest - (mean + 2.0 * p * (angle + 2.0 * std::f64::consts::FRAC_PI_3).cos());
    let smallest = matrix.determinant().powi(2) / (largest * middle);
    (largest / smallest).sqrt()
}
