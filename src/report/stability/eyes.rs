//! Where the eye is (inventory part 8, items 1, 3, 7, 8; C3, C3b, C15).

use super::Case;
use super::bed::{Dice, ROOM, differing, draw, kernel, largest, ldi_of, pack, rms_levels, sample};
use crate::capture::rig::Face;
use crate::packed::{PackedCube, SplatIndexLayout, Split};
use crate::splat::SplatKernel;
use crate::warp::RenderSettings;
use crate::warp::oracle::render_oracle;
use glam::{DVec3, dvec3};

pub(super) fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "eye at the centre",
            what: "A captured room from the very centre against 1e-12 half-sizes beside it: root mean square difference.",
            unit: "levels",
            bound: 1.0,
            reason: "Nothing moves; but the order of splats inside one surface may change, and with it how their means are rounded.",
            measure: |seed| {
                let mut dice = Dice::new(seed, 1);
                let room = ROOM.as_ref()?;
                let (forward, aside) = (dice.direction(), dice.direction() * 1e-12);
                let [a, b] = [DVec3::ZERO, aside].map(|offset| room.camera(offset, forward, 60.0));
                Some(rms_levels(&draw(&room.cube, &a?, &default()), &draw(&room.cube, &b?, &default())))
            },
        },
        Case {
            name: "through the centre along X",
            what: "Nine eyes 1e-6 half-sizes apart, the fifth at the centre: the largest difference of neighbouring frames.",
            unit: "levels",
            bound: 3.0,
            reason: "The true change is below 1e-4 px; but the order of splats turns round at the centre, and where a surface meets another within the tolerance of its averaging (7 % of depth on faces of 128 px) the one that is drawn first takes more. A wrong order would show as 10 levels and more.",
            measure: |seed| through_centre(seed, DVec3::X),
        },
        Case {
            name: "through the centre along Y",
            what: "The same along Y.",
            unit: "levels",
            bound: 3.0,
            reason: "The same.",
            measure: |seed| through_centre(seed, DVec3::Y),
        },
        Case {
            name: "through the centre along Z",
            what: "The same along Z.",
            unit: "levels",
            bound: 3.0,
            reason: "The same.",
            measure: |seed| through_centre(seed, DVec3::Z),
        },
        Case {
            name: "face, edge and corner of the headbox",
            what: "Eyes on a face, an edge and a corner against 1e-9 half-sizes further in.",
            unit: "levels",
            bound: 1.0,
            reason: "Nothing but rounding may change on the border.",
            measure: |seed| {
                let mut dice = Dice::new(seed, 3);
                let room = ROOM.as_ref()?;
                let inside = dice.in_cube(1.0);
                let side = |dice: &mut Dice| if dice.below(2) == 0 { -1.0 } else { 1.0 };
                let face = inside.with_x(side(&mut dice));
                let edge = face.with_y(side(&mut dice));
                let corner = edge.with_z(side(&mut dice));
                largest([face, edge, corner].map(|offset| {
                    let forward = dice.direction();
                    let frames = [offset, offset * (1.0 - 1e-9)]
                        .map(|offset| Some(draw(&room.cube, &room.camera(offset, forward, 70.0)?, &default())));
                    let [on, within] = frames;
                    Some(rms_levels(&on?, &within?))
                }))
            },
        },
        Case {
            name: "holes from corners of the headbox",
            what: "Share of pixels of a closed room's frame that show nothing or the environment, eyes in random corners.",
            unit: "%",
            bound: 2.0,
            reason: "The capture's rays start on the headbox's faces, so that a corner sees what they saw; 12^4 x 8 rays on faces of 128 px leave some pixels without a sample.",
            measure: |seed| {
                let mut dice = Dice::new(seed, 4);
                let room = ROOM.as_ref()?;
                largest((0..4).map(|_| {
                    let corner = dice.in_cube(1.0).map(|c| if c < 0.0 { -1.0 } else { 1.0 });
                    let frame = draw(&room.cube, &room.camera(corner, dice.direction(), 60.0)?, &default());
                    let open = frame.coverage.iter().filter(|c| c.is_hole()).count();
                    Some(100.0 * open as f64 / frame.coverage.len() as f64)
                }))
            },
        },
        Case {
            name: "order without a depth buffer",
            what: "Random slabs at depths coded as colours, eyes anywhere in and far outside the cube, epipoles in pixels, on their edges, in the borders, at infinity, behind: share of pixels that show something farther than the f64 renderer with a depth buffer does, by more than the size of a sample.",
            unit: "%",
            bound: 1.5,
            reason: "At silhouettes footprints of both renderers differ by a fraction of a pixel; one wrong order would show in tens of percent.",
            measure: order_without_depth_buffer,
        },
        Case {
            name: "clipping never culls what shows",
            what: "Pixels that differ between clipped and unclipped frames: eyes inside and outside, any field of view, split and whole faces.",
            unit: "px",
            bound: 0.0,
            reason: "Clipping is exact, and conservative in the splats' radius (C15, C17).",
            measure: |seed| {
                let mut dice = Dice::new(seed, 6);
                let room = ROOM.as_ref()?;
                largest((0..4).map(|i| {
                    let offset = dice.in_cube([1.0, 4.0][i % 2]);
                    let fov = [1.0, 60.0, 120.0, 170.0][dice.below(4) as usize];
                    let camera = room.camera(offset, dice.direction(), fov)?;
                    let split = [Split::Auto, Split::None, Split::AtDepth(2.0)][dice.below(3) as usize];
                    let cube = PackedCube::pack(&room.ldi, SplatIndexLayout::Normal, split).ok()?;
                    let unclipped = RenderSettings { unclipped: true, ..default() };
                    Some(differing(&draw(&cube, &camera, &default()), &draw(&cube, &camera, &unclipped), 0) as f64)
                }))
            },
        },
        Case {
            name: "any number of bands and threads",
            what: "Pixels that differ between bands of 1, 7 and all rows on 1, 2 and 5 threads.",
            unit: "px",
            bound: 0.0,
            reason: "Every pixel sees the same splats in the same order.",
            measure: |seed| {
                let mut dice = Dice::new(seed, 7);
                let room = ROOM.as_ref()?;
                let camera = room.camera(dice.in_cube(1.0), dice.direction(), 75.0)?;
                let expected = draw(&room.cube, &camera, &default());
                largest([(1, 1), (7, 2), (48, 5), (3, 5)].map(|(band_rows, threads)| {
                    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().ok()?;
                    let settings = RenderSettings { band_rows, ..default() };
                    let found = pool.install(|| draw(&room.cube, &camera, &settings));
                    Some(differing(&expected, &found, 0) as f64)
                }))
            },
        },
    ]
}

fn default() -> RenderSettings {
    RenderSettings::default()
}

fn through_centre(seed: u64, axis: DVec3) -> Option<f64> {
    let mut dice = Dice::new(seed, 2);
    let room = ROOM.as_ref()?;
    let forward = dice.direction();
    let steps = -4..=4;
    let frames: Option<Vec<_>> = steps
        .map(|i| {
            let camera = room.camera(axis * (f64::from(i) * 1e-6), forward, 60.0)?;
            Some(draw(&room.cube, &camera, &default()))
        })
        .collect();
    largest(frames?.windows(2).map(|pair| Some(rms_levels(&pair[0], &pair[1]))))
}

/// Inverse depth as a colour that survives being read back: 16 bits in red and green.
fn depth_color(inverse_depth: f64) -> [u8; 3] {
    let code = (inverse_depth.clamp(0.0, 4.0) / 4.0 * 65_535.0) as u16;
    let [low, high] = code.to_le_bytes();
    [high, low, 77]
}

fn order_without_depth_buffer(seed: u64) -> Option<f64> {
    const SIZE: u32 = 20;
    let mut dice = Dice::new(seed, 5);
    let slab = [0.25, 0.5, 1.0, 1.6].map(|q| q * dice.between(0.9, 1.1));
    let pattern = dice.bits();
    let ldi = ldi_of(SIZE, &Face::ALL, |face, x, y| {
        // Blocks of 4x4 pixels have a slab or not, so that neighbours are of one surface.
        let block = (x as u64 / 4) + 8 * (y as u64 / 4) + 64 * face.index() as u64;
        let here = |layer: u64| {
            (pattern ^ (block * 4 + layer).wrapping_mul(0x9e37_79b9_7f4a_7c15)).count_ones().is_multiple_of(3)
        };
        let layers = slab.iter().enumerate().filter(|(layer, _)| *layer == 0 || here(*layer as u64));
        layers.map(|(_, &q)| sample(face, q, depth_color(q))).collect()
    });
    let cube = pack(&ldi)?;
    let cell = 2.0 / f64::from(SIZE);
    let eyes = [
        dvec3(0.4, 0.0, 0.0),
        dvec3(0.3, -0.2, 1e-18),
        dvec3(2.5 * cell, -1.5 * cell, 1.0) * 0.4,
        dvec3(3.0 * cell, 2.0 * cell, -1.0) * 0.4,
        dvec3(1.0, 1.0, 1.0) * 0.5,
        dice.in_cube(0.5),
        dice.in_cube(1.5),
    ];
    let (mut wrong, mut all) = (0usize, 0usize);
    for eye in eyes {
        let camera = super::bed::look(eye, dice.direction(), 80.0, [48, 40]).ok()?;
        let found = draw(&cube, &camera, &kernel(SplatKernel::Opaque));
        let truth = render_oracle(&ldi, &camera).frame;
        for (a, b) in found.color.iter().zip(&truth.color) {
            // Both show some sample's colour or a hole; which one is nearer to the eye is known only for the samples
            // themselves: a farther slab of the same face is farther for every eye nearer to the cube than the slabs.
            let both = a[2] == 77 && b[2] == 77;
            let code = |c: &[u8; 4]| u16::from_le_bytes([c[1], c[0]]);
            all += usize::from(both);
            wrong += usize::from(both && eye.abs().max_element() <= 0.5 && code(a) < code(b));
        }
    }
    Some(100.0 * wrong as f64 / all.max(1) as f64)
}
