//! Cases of arithmetic: f32 against f64, quantisation, rays at edges.

use super::Case;
use super::fixtures::{ROOM, build_ldi, case_rng, largest, look_along, pack, sample};
use glam::{DVec3, Vec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::depth_kind::DepthKind;
use headbox_core::random::Rng;
use headbox_cube::pack::INVERSE_DEPTH_CODE_MAX;
use headbox_cube::render::setup::transfer::Transfer;
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle};
use headbox_sprite::{DepthImport, Displacement, DisplacementFormat, SpritePlane};
use headbox_trace::bvh::{Ray, Tracer};
use image::{Rgba, RgbaImage};
use std::sync::Arc;

pub(super) fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "f32 along whole rows",
            what: "Positions of depth pixels along rows of faces of 4,096 px, evaluated in f32 as the warp does, against f64; points in a frame of 4,096 px.",
            unit: "px",
            bound: 2e-3,
            reason: "Seven roundings of 2^-24 * 4,096 px; anchors every 64 columns keep them from adding up (the paper's running sum drifts by 0.085 px, C8).",
            measure: f32_along_rows,
        },
        Case {
            name: "inverse depth in 20 bits",
            what: "Shift in a frame (f = 1,000 px) of samples from 0.5 m on, eye 0.5 m from the centre, by packing and reading back.",
            unit: "px",
            bound: 1000.0 * 0.5 * 2.0 / 1_048_575.0 / 2.0 * 1.01,
            reason: "Half a step of the segment's range (at most 1 / near = 2 per metre) times f times the displacement (C30); 1 % for f32 ends of the range.",
            measure: |seed| {
                let mut rng = case_rng(seed, 42);
                const SIZE: u32 = 24;
                let ldi = build_ldi(SIZE, &Face::ALL, |face, _, _| {
                    vec![sample(face, rng.between(0.001, 2.0), [9; 3])]
                });
                let cube = pack(&ldi)?;
                largest(cube.segments.iter().flat_map(|segment| {
                    let (ldi, layout) = (&ldi, cube.layout);
                    (0..segment.height)
                        .flat_map(move |y| (0..segment.width).map(move |x| (x, y)))
                        .map(move |(x, y)| {
                            let Some(pixel) = segment.pixel(x, y).first() else {
                                return Some(0.0);
                            };
                            let packed = segment.decode(layout, *pixel).inverse_depth;
                            let exact = ldi.faces[segment.face.index()]
                                .pixel(segment.x0 + x, segment.y0 + y)
                                .first()?;
                            Some((packed - f64::from(exact.inverse_depth)).abs() * 1000.0 * 0.5)
                        })
                }))
            },
        },
        Case {
            name: "codes of inverse depth at the ends",
            what: "The nearest and the farthest sample of every segment of a room, relative error of their inverse depth after packing.",
            unit: "",
            bound: 1.2e-7,
            reason: "The ends of the range are codes 0 and 2^20 - 1 and come back exactly but for one f32 rounding.",
            measure: |_| {
                let cube = &ROOM.as_ref()?.cube;
                largest(cube.segments.iter().map(|segment| {
                    let codes = segment.depth_pixels.iter().map(|p| p.inverse_depth_code());
                    let (least, most) = (codes.clone().min()?, codes.max()?);
                    if (least, most) != (0, INVERSE_DEPTH_CODE_MAX)
                        && segment.inverse_depth_min != segment.inverse_depth_max
                    {
                        return Some(f64::INFINITY);
                    }
                    let near_error =
                        segment.inverse_depth(most) / f64::from(segment.inverse_depth_max) - 1.0;
                    let far_error =
                        segment.inverse_depth(least) / f64::from(segment.inverse_depth_min) - 1.0;
                    Some(near_error.abs().max(far_error.abs()))
                }))
            },
        },
        Case {
            name: "8-bit displacement",
            what: "Error of stored displacements over the largest of a sprite, times 254.",
            unit: "half steps",
            bound: 1.001,
            reason: "Half a step of the largest / 127 (C30): 0.04 px at 10 px of parallax, 0.79 at 200.",
            measure: |seed| {
                let mut rng = case_rng(seed, 43);
                let size = 10f64.powf(rng.between(-6.0, 3.0));
                let values: Vec<f32> = (0..400).map(|_| rng.between(-size, size) as f32).collect();
                let stored = Displacement::new(20, 20, &values, DisplacementFormat::I8).ok()?;
                let largest_value = values.iter().fold(0.0f32, |m, v| m.max(v.abs()));
                largest(values.iter().enumerate().map(|(i, v)| {
                    Some(
                        f64::from(
                            (stored.at(i as u32 % 20, i as u32 / 20) - v).abs() / largest_value,
                        ) * 254.0,
                    )
                }))
            },
        },
        Case {
            name: "disparity from depth buffers",
            what: "Eye depths from f32 window depths (near and far a hair apart, or 1e-3 and 1e5 m, or far at infinity), error over one step of a 24-bit buffer.",
            unit: "steps",
            bound: 2.0,
            reason: "C1: a step of a buffer is Z^2 / near * (far - near) / far / 2^24; f32 between 0.5 and 1 has that step, and the displacement, off a plane in the middle of the range, is rounded to f32 once more.",
            measure: |seed| window_depths(seed, DepthKind::WindowDepth, None),
        },
        Case {
            name: "depth buffers of 16 bits",
            what: "The same, window depths rounded to 16 bits first, error over one step of such a buffer.",
            unit: "steps",
            bound: 0.52,
            reason: "Half a step is lost when the buffer is written, and not more when it is read: 1 % for f32 on the way.",
            measure: |seed| window_depths(seed, DepthKind::WindowDepth, Some(16)),
        },
        Case {
            name: "reversed depth buffers",
            what: "Eye depths from f32 window depths that are 1 at the near and 0 at the far plane, the same ranges: error over one step of a 24-bit buffer.",
            unit: "steps",
            bound: 2.0,
            reason: "As for buffers that are not reversed; f32 is finer near 0, so that what is left is the displacement's own rounding.",
            measure: |seed| window_depths(seed, DepthKind::ReversedWindowDepth, None),
        },
        Case {
            name: "reversed depth buffers of 16 bits",
            what: "The same, rounded to 16 bits first, error over one step of such a buffer.",
            unit: "steps",
            bound: 0.52,
            reason: "Half a step, and 1 % for f32 on the way.",
            measure: |seed| window_depths(seed, DepthKind::ReversedWindowDepth, Some(16)),
        },
        Case {
            name: "depth ranges the wrong way round",
            what: "Depth buffers, reversed or not, with near and far exchanged, equal, 0, negative, infinite or NaN: imports that are not refused.",
            unit: "imports",
            bound: 0.0,
            reason: "Which way a buffer runs cannot be seen from its values and is said beside them: a range that is none is an error that names it.",
            measure: |seed| {
                let near = case_rng(seed, 48).between(1e-3, 10.0);
                let camera = look_along(DVec3::ZERO, DVec3::NEG_Z, 60.0, [8, 8]).ok()?;
                let far = near * 100.0;
                let ranges = [
                    (far, near),
                    (near, near),
                    (0.0, far),
                    (-near, far),
                    (near, -far),
                    (near, 0.0),
                    (f64::INFINITY, near),
                    (f64::NAN, far),
                    (near, f64::NAN),
                ];
                let plane = Some(SpritePlane::parallel_to_image(&camera, near * 2.0));
                let accepted = |kind| {
                    let is_accepted = |range: &&(f64, f64)| {
                        import_window_depth(camera, &[0.5; 64], kind, **range, plane).is_some()
                    };
                    ranges.iter().filter(is_accepted).count()
                };
                let kinds = [DepthKind::WindowDepth, DepthKind::ReversedWindowDepth];
                Some(kinds.map(accepted).iter().sum::<usize>() as f64)
            },
        },
        Case {
            name: "background in depth buffers",
            what: "Pixels of window depth 1 (0 in a reversed buffer), above 1, negative or NaN that become geometry.",
            unit: "px",
            bound: 0.0,
            reason: "The far plane is background, and the rest is no depth.",
            measure: |seed| {
                let mut rng = case_rng(seed, 45);
                let camera = look_along(DVec3::ZERO, DVec3::NEG_Z, 60.0, [8, 8]).ok()?;
                largest(
                    [
                        (DepthKind::WindowDepth, 1.0),
                        (DepthKind::ReversedWindowDepth, 0.0),
                    ]
                    .map(|(kind, far_plane)| {
                        let background = [far_plane, 1.5, -0.25, f32::NAN, f32::INFINITY];
                        let depth: Vec<f32> = (0..64)
                            .map(|i| {
                                if i % 2 == 0 {
                                    0.5
                                } else {
                                    background[rng.below(5) as usize]
                                }
                            })
                            .collect();
                        let sprite = import_at_middle(camera, &depth, kind, (0.5, 20.0))?;
                        // Unknown depths are filled from their neighbours: all depths are those of
                        // 0.5.
                        let known = sprite.eye_depth(0, 0)?;
                        let is_wrong = |i: &u32| {
                            sprite
                                .eye_depth(i % 8, i / 8)
                                .is_none_or(|z| (z / known - 1.0).abs() > 1e-3)
                        };
                        Some((0..64).filter(is_wrong).count() as f64)
                    }),
                )
            },
        },
        Case {
            name: "rays at the edges and corners of triangles",
            what: "Rays through shared edges and vertices of a closed, finely cut cube, from inside: how many leave it.",
            unit: "rays of 20,000",
            bound: 0.0,
            reason: "Two triangles that share an edge decide by the same arithmetic on which side a ray passes: no leak (watertight).",
            measure: leaking_rays,
        },
        Case {
            name: "rays parallel to the axes",
            what: "Rays with two components 0 or -0, from points exactly in the planes in which the boxes of the tree meet: how many leave the same cube.",
            unit: "rays of 2,000",
            bound: 0.0,
            reason: "0 / 0 and 0 * infinity in box tests are decided for the box, and triangles decide the rest.",
            measure: parallel_rays,
        },
        Case {
            name: "metrics of nearly equal images",
            what: "FLIP and 1 - SSIM of images that differ by one level in one pixel of 10,000, against 0.",
            unit: "",
            bound: 2e-4,
            reason: "One pixel of 10,000 may count for no more than its share, 1e-4, spread over the filters' support; cancellation would show as more.",
            measure: |seed| {
                let mut rng = case_rng(seed, 47);
                let image = image::RgbImage::from_fn(100, 100, |x, y| {
                    image::Rgb([(x * 2) as u8, (y * 2) as u8, ((x * y) % 251) as u8])
                });
                let mut other = image.clone();
                let [x, y] = [0, 1].map(|_| rng.below(100) as u32);
                other.get_pixel_mut(x, y).0[1] ^= 1;
                let comparison = headbox_core::metrics::compare(&image, &other).ok()?;
                Some(comparison.flip.max(1.0 - comparison.ssim))
            },
        },
    ]
}

/// Returns the largest position error of the incremental f32 warp, px.
fn f32_along_rows(seed: u64) -> Option<f64> {
    const SIZE: u32 = 4096;
    const BLOCK: u32 = headbox_cube::pack::blocks::BLOCK_COLUMNS;
    let mut rng = case_rng(seed, 41);
    let eye = rng.in_cube(0.5);
    let face = Face::ALL[rng.below(6) as usize];
    let forward = (face.normal() + rng.in_cube(0.3)).normalize();
    let camera = look_along(eye, forward, 90.0, [SIZE, SIZE]).ok()?;
    let transfer = Transfer::new(&camera, eye, face, SIZE);
    let (min, step) = (0.01, 1.2 / f64::from(INVERSE_DEPTH_CODE_MAX));
    let mut worst = 0.0f64;
    for row in [0, 1023, 2048, rng.below(SIZE.into()) as u32, SIZE - 1] {
        for column in (0..SIZE).step_by(3) {
            let block = column - column % BLOCK;
            let row_transfer = transfer.anchor(block, row, min, step);
            for code in [0, 77_777, INVERSE_DEPTH_CODE_MAX] {
                let k = (column - block) as f32;
                let warped = (row_transfer.anchor + row_transfer.step * k)
                    + row_transfer.per_code * code as f32;
                let exact = transfer.map_infinite(f64::from(column) + 0.5, f64::from(row) + 0.5)
                    + transfer.inverse_depth * (min + f64::from(code) * step);
                let (x, y) = (exact.x / exact.z, exact.y / exact.z);
                let half = f64::from(SIZE) / 2.0;
                // w = Z2 / Z1: below a quarter, the eye is more than four times nearer to a sample
                // than the centre.
                if exact.z > 0.25 && x.abs() < half && y.abs() < half {
                    worst = worst
                        .max((f64::from(warped.x / warped.z) - x).abs())
                        .max((f64::from(warped.y / warped.z) - y).abs());
                }
            }
        }
    }
    Some(worst)
}

/// Imports a depth buffer as a sprite on a plane in the middle of the range of inverse depths,
/// where displacements are smallest.
fn import_at_middle(
    camera: Camera,
    depth: &[f32],
    kind: DepthKind,
    window_range_m: (f64, f64),
) -> Option<headbox_sprite::SpriteWithDepth> {
    let plane = Some(SpritePlane::parallel_to_image(
        &camera,
        2.0 / (1.0 / window_range_m.0 + 1.0 / window_range_m.1),
    ));
    import_window_depth(camera, depth, kind, window_range_m, plane)
}

/// Imports a depth buffer as a sprite; `None` if the import is refused.
fn import_window_depth(
    camera: Camera,
    depth: &[f32],
    depth_kind: DepthKind,
    window_range_m: (f64, f64),
    plane: Option<SpritePlane>,
) -> Option<headbox_sprite::SpriteWithDepth> {
    let color = RgbaImage::from_pixel(camera.width(), camera.height(), Rgba([200, 100, 50, 255]));
    DepthImport {
        color,
        camera,
        depth,
        depth_kind,
        window_range_m,
        plane,
        format: DisplacementFormat::F32,
    }
    .build()
    .ok()
}

/// Returns the largest error of imported inverse depths over one step of a depth buffer of `bits`
/// bits, whose values are rounded to them. With `None` the step is that of 24 bits, and values are
/// rounded to f32 only.
fn window_depths(seed: u64, kind: DepthKind, bits: Option<u32>) -> Option<f64> {
    let steps = f64::from((1u32 << bits.unwrap_or(24)) - 1);
    let mut rng = case_rng(seed, 44);
    let camera = look_along(DVec3::ZERO, DVec3::NEG_Z, 60.0, [8, 8]).ok()?;
    largest(
        [
            (0.5, 0.500_1),
            (0.001, 1e5),
            (0.1, f64::INFINITY),
            (1.0, 20.0),
        ]
        .map(|(near, far)| {
            let reversed = kind == DepthKind::ReversedWindowDepth;
            let share = |z: f64| {
                if reversed {
                    (near / z - near / far) / (1.0 - near / far)
                } else {
                    (1.0 - near / z) / (1.0 - near / far)
                }
            };
            let depths: Vec<f64> = (0..64)
                .map(|_| near / rng.between(near / far.min(1e6), 1.0).max(1e-6))
                .collect();
            // The code of the far plane is background.
            let least = if reversed { 1.0 } else { 0.0 };
            let stored = |z: f64| {
                if bits.is_some() {
                    (share(z) * steps).round().clamp(least, steps - 1.0 + least) / steps
                } else {
                    share(z)
                }
            };
            let [low, high] = if reversed {
                [f32::MIN_POSITIVE, 1.0]
            } else {
                [0.0, 0.999_999_94]
            };
            let window: Vec<f32> = depths
                .iter()
                .map(|&z| (stored(z) as f32).clamp(low, high))
                .collect();
            let sprite = import_at_middle(camera, &window, kind, (near, far))?;
            largest(depths.iter().enumerate().map(|(i, &z)| {
                // A step is constant in inverse depth: (1 - near / far) / near / 2^bits.
                let step = (1.0 - near / far) / near / steps;
                let imported = sprite.eye_depth(i as u32 % 8, i as u32 / 8)?;
                Some((1.0 / imported - 1.0 / z).abs() / step)
            }))
        }),
    )
}

/// Cells along an edge of [`tessellated_cube`].
const CELLS: u32 = 12;

/// Builds a closed cube of `2 * 6 * CELLS^2` triangles.
fn tessellated_cube(half: f64) -> Scene {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    for face in Face::ALL {
        let first = scene.positions.len() as u32;
        for i in 0..(CELLS + 1) * (CELLS + 1) {
            let at = |k: u32| f64::from(k) / f64::from(CELLS) * 2.0;
            scene
                .positions
                .push(face.direction(at(i % (CELLS + 1)), at(i / (CELLS + 1)), 2) * half);
        }
        for (x, y) in (0..CELLS).flat_map(|y| (0..CELLS).map(move |x| (x, y))) {
            let corner = |dx: u32, dy: u32| first + (y + dy) * (CELLS + 1) + x + dx;
            let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
            for vertices in [[a, b, c], [a, c, d]] {
                scene.triangles.push(Triangle {
                    vertices,
                    material: 0,
                });
            }
        }
    }
    scene
}

/// Counts the missed rays from inside a cube exactly through its vertices and edges.
fn leaking_rays(seed: u64) -> Option<f64> {
    let mut rng = case_rng(seed, 46);
    let half = rng.between(0.5, 50.0);
    let tracer = Tracer::new(Arc::new(tessellated_cube(half)), DVec3::ZERO);
    let (positions, triangles) = (&tracer.scene().positions, &tracer.scene().triangles);
    let mut leaks = 0;
    for _ in 0..20_000 {
        let triangle = &triangles[rng.below(triangles.len() as u64) as usize];
        let [a, b] = [0, 1].map(|i| positions[triangle.vertices[i] as usize]);
        let t = [0.0, 0.5, rng.between(0.0, 1.0)][rng.below(3) as usize];
        let target = a + (b - a) * t;
        let origin = rng.in_cube(half * 0.9);
        let ray = Ray {
            origin: origin.as_vec3(),
            direction: (target - origin).as_vec3(),
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        leaks += u32::from(tracer.closest(&ray).is_none());
    }
    Some(f64::from(leaks))
}

/// Counts the missed rays along the axes from inside a cube, in the planes of its vertices.
fn parallel_rays(seed: u64) -> Option<f64> {
    let mut rng = case_rng(seed, 48);
    let half = rng.between(0.5, 50.0);
    let tracer = Tracer::new(Arc::new(tessellated_cube(half)), DVec3::ZERO);
    let mut leaks = 0;
    for _ in 0..2_000 {
        // Computed like the vertices, without those on the cube's faces.
        let plane = |rng: &mut Rng| {
            let cell = 1 + rng.below((CELLS - 1).into());
            ((cell as f64 / f64::from(CELLS) * 2.0 - 1.0) * half) as f32
        };
        let origin = Vec3::new(plane(&mut rng), plane(&mut rng), plane(&mut rng));
        let zero = |rng: &mut Rng| if rng.below(2) == 0 { 0.0 } else { -0.0f32 };
        let mut direction = Vec3::new(zero(&mut rng), zero(&mut rng), zero(&mut rng));
        direction[rng.below(3) as usize] = if rng.below(2) == 0 { 1.0 } else { -1.0 };
        let ray = Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        leaks += u32::from(tracer.closest(&ray).is_none());
    }
    Some(f64::from(leaks))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn window_depth_converts_to_eye_depth() {
        let camera = look_along(DVec3::ZERO, DVec3::NEG_Z, 60.0, [1, 1]).expect("valid");
        // near 1, far 3: Z = 1.5 has z = (1 - 2/3) / (2/3) = 0.5.
        let sprite =
            import_at_middle(camera, &[0.5], DepthKind::WindowDepth, (1.0, 3.0)).expect("valid");
        assert!((sprite.eye_depth(0, 0).expect("in front") - 1.5).abs() < 1e-6);
        // Reversed, 0.25 is as far as 0.75 is: Z = 2 has z = (1 - 1/2) / (2/3).
        let sprite = import_at_middle(camera, &[0.25], DepthKind::ReversedWindowDepth, (1.0, 3.0))
            .expect("valid");
        assert!((sprite.eye_depth(0, 0).expect("in front") - 2.0).abs() < 1e-6);
    }
}
