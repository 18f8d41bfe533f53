//! Cases of eye positions (hard cases 1, 3, 7, 8; C3, C3b, C15).

use super::Case;
use super::fixtures::{
    CapturedRoom, ROOM, build_ldi, case_rng, differing_pixels, draw, largest, look_along, pack,
    random_direction, rms_levels, sample, with_kernel,
};
use crate::baselines::fragments::FragmentRenderer;
use glam::{DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::random::Rng;
use headbox_cube::model::samples::CubeSamples;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_cube::render::{RenderSettings, Renderer};

pub(super) fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "eye at the centre",
            what: "A captured room from the very centre against 1e-12 half-sizes beside it: root mean square difference.",
            unit: "levels",
            bound: SAME_LEVELS,
            reason: "Nothing moves. Drawing order changes with the eye's octant, and what shows must not depend on it.",
            measure: |seed| {
                let mut rng = case_rng(seed, 1);
                let room = ROOM.as_ref()?;
                let forward = random_direction(&mut rng);
                let aside = random_direction(&mut rng) * 1e-12;
                change_between(room, [DVec3::ZERO, aside], forward, 60.0)
            },
        },
        Case {
            name: "through the centre along X",
            what: "Nine eyes 1e-6 half-sizes apart, the fifth at the centre: the largest difference of neighbouring frames.",
            unit: "levels",
            bound: SAME_LEVELS,
            reason: "The true change is below 1e-4 px, and what shows must not depend on which of two samples is drawn first: 8-bit rounding is left, and a silhouette here and there. Means that knew their splats one after the other changed by 1.8 levels; a wrong order would show as 10 and more.",
            measure: |seed| through_centre(seed, DVec3::X, SplatKernel::default()),
        },
        Case {
            name: "through the centre along Y",
            what: "The same along Y.",
            unit: "levels",
            bound: SAME_LEVELS,
            reason: "The same.",
            measure: |seed| through_centre(seed, DVec3::Y, SplatKernel::default()),
        },
        Case {
            name: "through the centre along Z",
            what: "The same along Z.",
            unit: "levels",
            bound: SAME_LEVELS,
            reason: "The same.",
            measure: |seed| through_centre(seed, DVec3::Z, SplatKernel::default()),
        },
        Case {
            name: "eyes anywhere, a millionth apart",
            what: "Eyes all over the headbox against others 1e-6 half-sizes beside them.",
            unit: "levels",
            bound: 1.0,
            reason: "Away from the planes through the centre no order changes, and 1e-4 px of movement are a fraction of a level; what is left is 8-bit rounding and silhouettes.",
            measure: |seed| {
                let mut rng = case_rng(seed, 8);
                let room = ROOM.as_ref()?;
                largest((0..4).map(|_| {
                    let offset = rng.in_cube(0.99);
                    let aside = random_direction(&mut rng) * 1e-6;
                    let forward = random_direction(&mut rng);
                    change_between(room, [offset, offset + aside], forward, 60.0)
                }))
            },
        },
        Case {
            name: "face, edge and corner of the headbox",
            what: "Eyes on a face, an edge and a corner against 1e-9 half-sizes further in.",
            unit: "levels",
            bound: 1.0,
            reason: "Nothing but rounding may change on the border.",
            measure: |seed| {
                let mut rng = case_rng(seed, 3);
                let room = ROOM.as_ref()?;
                let inside = rng.in_cube(1.0);
                let side = |rng: &mut Rng| if rng.below(2) == 0 { -1.0 } else { 1.0 };
                let face = inside.with_x(side(&mut rng));
                let edge = face.with_y(side(&mut rng));
                let corner = edge.with_z(side(&mut rng));
                largest([face, edge, corner].map(|offset| {
                    let forward = random_direction(&mut rng);
                    change_between(room, [offset, offset * (1.0 - 1e-9)], forward, 70.0)
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
                let mut rng = case_rng(seed, 4);
                let room = ROOM.as_ref()?;
                largest((0..4).map(|_| {
                    let corner = rng.in_cube(1.0).map(|c| if c < 0.0 { -1.0 } else { 1.0 });
                    let camera = room.camera(corner, random_direction(&mut rng), 60.0)?;
                    let frame = draw(&room.cube, &camera, &default());
                    let holes = frame.coverage.iter().filter(|c| c.is_hole()).count();
                    Some(100.0 * holes as f64 / frame.coverage.len() as f64)
                }))
            },
        },
        Case {
            name: "order without a depth buffer",
            what: "Random slabs at depths coded as colours; eyes in the cube, epipoles in pixels, on their edges, in the borders, at infinity, behind: of the pixels that hold the centre of a sample, the share that show a slab farther along their ray.",
            unit: "%",
            bound: 0.5,
            reason: "What is drawn later is nearer: nothing farther may cover a sample's own centre but the rim of a footprint of a slab that reaches past it. One wrong order would show in tens of percent.",
            measure: |seed| {
                order_without_depth_buffer(seed, |rng| {
                    let cell = 2.0 / f64::from(SLAB_FACE_PX);
                    vec![
                        dvec3(0.4, 0.0, 0.0),
                        dvec3(0.3, -0.2, 1e-18),
                        dvec3(2.5 * cell, -1.5 * cell, 1.0) * 0.4,
                        dvec3(3.0 * cell, 2.0 * cell, -1.0) * 0.4,
                        dvec3(1.0, 1.0, 1.0) * 0.5,
                        rng.in_cube(0.5),
                    ]
                })
            },
        },
        Case {
            name: "order from outside the cube",
            what: "The same from eyes 1.2 to 12 half-sizes from the centre, beyond split planes and slabs, looking anywhere and back.",
            unit: "%",
            bound: 0.5,
            reason: "The order holds for any eye (C3, C3b, C9).",
            measure: |seed| {
                order_without_depth_buffer(seed, |rng| {
                    (0..6)
                        .map(|i| random_direction(rng) * 0.6 * [1.0, 1.5, 2.5, 4.0, 7.0, 10.0][i])
                        .collect()
                })
            },
        },
        Case {
            name: "clipping never culls what shows",
            what: "Pixels that differ between clipped and unclipped frames: eyes inside and outside, any field of view, split and whole faces.",
            unit: "px",
            bound: 0.0,
            reason: "Clipping is exact, and conservative in the splats' radius (C15, C17).",
            measure: |seed| {
                let mut rng = case_rng(seed, 6);
                let room = ROOM.as_ref()?;
                largest((0..4).map(|i| {
                    let offset = rng.in_cube([1.0, 4.0][i % 2]);
                    let fov = [1.0, 60.0, 120.0, 170.0][rng.below(4) as usize];
                    let camera = room.camera(offset, random_direction(&mut rng), fov)?;
                    let split =
                        [Split::Auto, Split::None, Split::AtDepth(2.0)][rng.below(3) as usize];
                    let cube = CubeLdi::pack(&room.ldi, SplatIndexLayout::Normal, split).ok()?;
                    Some(changed_by_clipping(&cube, &camera))
                }))
            },
        },
        Case {
            name: "an opening at a slant, clipped",
            what: "A room behind an opening of 1 x 1 m, its LDI about the opening's middle, the eye 0.3 to 1 m before it and up to 80 degrees aside, the frame cropped to the opening: pixels that clipping changes.",
            unit: "px",
            bound: 0.0,
            reason: "Boxes of the column tree have corners before and behind the eye's plane there (C17); clipping stays conservative.",
            measure: |seed| Some(oblique_opening(seed)?[0]),
        },
        Case {
            name: "what clipping leaves at a slant",
            what: "The same: the largest share of the samples that clipping leaves.",
            unit: "%",
            bound: 90.0,
            reason: "Close and oblique the papers saw 75 % at the worst (P-N5; one half on average); here the eye is nearer, so that the opening fills the view.",
            measure: |seed| Some(oblique_opening(seed)?[1]),
        },
        Case {
            name: "any number of bands and threads",
            what: "Pixels that differ between bands of 1, 7 and all rows on 1, 2 and 5 threads.",
            unit: "px",
            bound: 0.0,
            reason: "Every pixel sees the same splats in the same order.",
            measure: |seed| {
                let mut rng = case_rng(seed, 7);
                let room = ROOM.as_ref()?;
                let camera = room.camera(rng.in_cube(1.0), random_direction(&mut rng), 75.0)?;
                let expected = draw(&room.cube, &camera, &default());
                largest(
                    [(1, 1), (7, 2), (48, 5), (3, 5)].map(|(band_rows, threads)| {
                        let pool = rayon::ThreadPoolBuilder::new()
                            .num_threads(threads)
                            .build()
                            .ok()?;
                        let settings = RenderSettings {
                            band_rows,
                            ..default()
                        };
                        let frame = pool.install(|| draw(&room.cube, &camera, &settings));
                        Some(differing_pixels(&expected, &frame) as f64)
                    }),
                )
            },
        },
        Case {
            name: "fragments along epipolar lines",
            what: "Pixels in which frames drawn in 1, 2, 3, 7 and 16 fragments differ from frames drawn in bands: eyes at the centre, on its planes, with the epipole on a corner of pixels and in one, in the cube and outside; faces of 128 px, and of 3 px, where fragments are more than columns.",
            unit: "px",
            bound: 0.0,
            reason: "What two fragments both touch is drawn again in drawing order: every pixel sees the same splats in the same order (P5, P6, C16).",
            measure: fragments_against_bands,
        },
    ]
}

/// Returns the root mean square difference of frames of a room from two eyes, levels.
fn change_between(
    room: &CapturedRoom,
    offsets: [DVec3; 2],
    forward: DVec3,
    fov_deg: f64,
) -> Option<f64> {
    let [a, b] = offsets.map(|offset| {
        let camera = room.camera(offset, forward, fov_deg)?;
        Some(draw(&room.cube, &camera, &default()))
    });
    Some(rms_levels(&a?, &b?))
}

/// Counts the pixels of a frame that clipping changes.
fn changed_by_clipping(cube: &CubeLdi, camera: &Camera) -> f64 {
    let unclipped = RenderSettings {
        unclipped: true,
        ..default()
    };
    differing_pixels(
        &draw(cube, camera, &default()),
        &draw(cube, camera, &unclipped),
    ) as f64
}

/// Returns the largest number of pixels in which frames in fragments and in bands differ.
fn fragments_against_bands(seed: u64) -> Option<f64> {
    let mut rng = case_rng(seed, 9);
    let room = ROOM.as_ref()?;
    let tiny = pack(&build_ldi(3, &Face::ALL, |face, x, y| {
        vec![sample(face, 0.5, [75 * x as u8, 75 * y as u8, 90])]
    }))?;
    let outward = random_direction(&mut rng);
    let corner_of_pixels = dvec3(8.0 / 64.0, -16.0 / 64.0, 1.0) * 0.5;
    let eyes = [
        DVec3::ZERO,
        dvec3(0.3, 0.0, 0.0),
        corner_of_pixels,
        rng.in_cube(0.9),
        rng.in_cube(0.9),
        outward * 3.0,
    ];
    largest(
        eyes.into_iter()
            .flat_map(|offset| [(&room.cube, offset), (&tiny, offset)])
            .map(|(cube, offset)| {
                let eye = cube.info.centre + offset * cube.info.half_size_m;
                let camera = look_along(eye, random_direction(&mut rng), 75.0, [64, 48]).ok()?;
                let expected = draw(cube, &camera, &default());
                largest([1, 2, 3, 7, 16].map(|count| {
                    let mut renderer = FragmentRenderer::default();
                    let (frame, _) = renderer.render(cube, &camera, &default(), count);
                    Some(differing_pixels(&expected, frame) as f64)
                }))
            }),
    )
}

/// Returns the largest number of pixels that clipping changes in oblique views of an opening, and
/// the largest share of samples that survive clipping, percent.
fn oblique_opening(seed: u64) -> Option<[f64; 2]> {
    const FACE_PX: u32 = 64;
    let mut rng = case_rng(seed, 10);
    // The opening is in the plane z = 0; behind it is a room 4 m wide and 3 m deep, on the far
    // halves of five faces.
    let ldi = build_ldi(FACE_PX, &Face::ALL, |face, x, y| {
        let ray = face.direction(x, y, FACE_PX);
        if ray.z >= 0.0 {
            return Vec::new();
        }
        let t = (3.0 / -ray.z).min(2.0 / ray.x.abs()).min(2.0 / ray.y.abs());
        vec![sample(
            face,
            1.0 / t,
            [(37 * x as u32) as u8, (53 * y as u32) as u8, 60],
        )]
    });
    let cube = pack(&ldi)?;
    let [mut changed, mut kept] = [0.0f64; 2];
    for _ in 0..6 {
        let polar = rng.between(0.0, 80.0).to_radians();
        let azimuth = rng.between(0.0, 360.0).to_radians();
        let outward = dvec3(
            polar.sin() * azimuth.cos(),
            polar.sin() * azimuth.sin(),
            polar.cos(),
        );
        let eye = outward * rng.between(0.3, 1.0);
        let camera = look_along(eye, -outward, 70.0, [96, 72]).ok()?;
        let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]
            .map(|[x, y]| camera.project(dvec3(x, y, 0.0)));
        let span = |axis: usize, size: u32| {
            // A corner behind the eye has no bound in the frame.
            let ends = corners.map(|corner| corner.map(|c| c[axis]));
            let least = ends
                .iter()
                .map(|end| end.unwrap_or(f64::NEG_INFINITY))
                .fold(f64::INFINITY, f64::min);
            let most = ends
                .iter()
                .map(|end| end.unwrap_or(f64::INFINITY))
                .fold(f64::NEG_INFINITY, f64::max);
            least.floor().clamp(0.0, f64::from(size)) as u32
                ..most.ceil().clamp(0.0, f64::from(size)) as u32
        };
        let Ok(part) = camera.cropped(span(0, 96), span(1, 72)) else {
            continue;
        };
        changed = changed.max(changed_by_clipping(&cube, &part));
        let counts = Renderer::new().clip_counts(&cube, &part, &default());
        kept = kept.max(100.0 * counts.kept as f64 / cube.depth_pixel_count() as f64);
    }
    Some([changed, kept])
}

fn default() -> RenderSettings {
    RenderSettings::default()
}

/// Bound of the change of a frame when the eye hardly moves, levels.
const SAME_LEVELS: f64 = 0.25;

/// Returns the largest change between neighbouring eyes on an axis through the centre, levels.
fn through_centre(seed: u64, axis: DVec3, splats: SplatKernel) -> Option<f64> {
    let mut rng = case_rng(seed, 2);
    let room = ROOM.as_ref()?;
    let forward = random_direction(&mut rng);
    let steps = -4..=4;
    let frames: Option<Vec<_>> = steps
        .map(|i| {
            let camera = room.camera(axis * (f64::from(i) * 1e-6), forward, 60.0)?;
            Some(draw(&room.cube, &camera, &with_kernel(splats)))
        })
        .collect();
    largest(
        frames?
            .windows(2)
            .map(|pair| Some(rms_levels(&pair[0], &pair[1]))),
    )
}

/// Edge of the faces of the slabs, px.
const SLAB_FACE_PX: u32 = 20;

/// Encodes the face and inverse depth of a slab as a colour, inverse depth in 16 bits of red and
/// green.
fn slab_color(face: Face, inverse_depth: f64) -> [u8; 3] {
    let code = (inverse_depth.clamp(0.0, 4.0) / 4.0 * 65_535.0).round() as u16;
    let [low, high] = code.to_le_bytes();
    [high, low, 77 + face.index() as u8]
}

/// Decodes the slab of a colour: normal and distance from the centre, half-sizes; `None` for other
/// colours.
fn decode_slab(color: [u8; 4]) -> Option<(DVec3, f64)> {
    let face = Face::ALL
        .into_iter()
        .find(|face| 77 + face.index() as u8 == color[2])?;
    let code = u16::from_le_bytes([color[1], color[0]]);
    Some((face.normal(), 65_535.0 / 4.0 / f64::from(code.max(1))))
}

/// Returns the share of pixels, among those that contain a sample's centre, that show a slab
/// farther away than the sample, percent.
fn order_without_depth_buffer(seed: u64, eyes: impl Fn(&mut Rng) -> Vec<DVec3>) -> Option<f64> {
    /// Ratio of depths above which a slab is farther. A sample is a tenth of its depth wide and may
    /// be oblique, so that a smaller ratio may be that of its neighbour.
    const FARTHER: f64 = 1.25;
    /// Cosine below which a ray's distance to a slab's plane is no measure of a footprint's depth.
    const GRAZING: f64 = 0.5;
    let mut rng = case_rng(seed, 5);
    let slab = [0.25, 0.5, 1.0, 1.6].map(|q| q * rng.between(0.9, 1.1));
    let pattern = rng.bits();
    let ldi = build_ldi(SLAB_FACE_PX, &Face::ALL, |face, x, y| {
        // A slab covers blocks of 4x4 pixels, so that neighbours belong to one surface.
        let block = (x as u64 / 4) + 8 * (y as u64 / 4) + 64 * face.index() as u64;
        let is_covered = |layer: u64| {
            (pattern ^ (block * 4 + layer).wrapping_mul(0x9e37_79b9_7f4a_7c15))
                .count_ones()
                .is_multiple_of(3)
        };
        let layers = slab
            .iter()
            .enumerate()
            .filter(|(layer, _)| *layer == 0 || is_covered(*layer as u64));
        layers
            .map(|(_, &q)| sample(face, q, slab_color(face, q)))
            .collect()
    });
    let cube = pack(&ldi)?;
    let (mut wrong, mut all) = (0usize, 0usize);
    for (number, eye) in eyes(&mut rng).into_iter().enumerate() {
        let forward = if number % 2 == 0 {
            random_direction(&mut rng)
        } else {
            (rng.in_cube(0.3) - eye).normalize()
        };
        let camera = look_along(eye, forward, 80.0, [48, 40]).ok()?;
        let frame = draw(&cube, &camera, &with_kernel(SplatKernel::Opaque));
        for (pixel, (nearest, shown)) in nearest_centres(&ldi, &camera)
            .into_iter()
            .zip(&frame.color)
            .enumerate()
        {
            let (Some(nearest_depth), Some((normal, distance))) = (nearest, decode_slab(*shown))
            else {
                continue;
            };
            all += 1;
            let (x, y) = (pixel as u32 % camera.width(), pixel as u32 / camera.width());
            let ray = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let shown_depth = (distance - normal.dot(eye)) / normal.dot(ray);
            let grazing = (normal.dot(ray) / ray.length()).abs() < GRAZING;
            wrong += usize::from(!grazing && shown_depth > nearest_depth * FARTHER);
        }
    }
    Some(100.0 * wrong as f64 / all.max(1) as f64)
}

/// Returns for each pixel the eye depth of the nearest sample whose centre is in the middle of the
/// pixel.
fn nearest_centres(ldi: &CubeSamples, camera: &Camera) -> Vec<Option<f64>> {
    let (width, height) = (camera.width(), camera.height());
    let mut nearest: Vec<Option<f64>> = vec![None; width as usize * height as usize];
    for face in &ldi.faces {
        for (x, y) in (0..face.size_px).flat_map(|y| (0..face.size_px).map(move |x| (x, y))) {
            let ray = face
                .face
                .direction(f64::from(x) + 0.5, f64::from(y) + 0.5, face.size_px);
            for sample in face.pixel(x, y) {
                let Some([px, py, depth]) = camera.project(ray / f64::from(sample.inverse_depth))
                else {
                    continue;
                };
                let is_central = |c: f64| (c - c.floor() - 0.5).abs() < 0.3;
                let inside =
                    px >= 0.0 && py >= 0.0 && px < f64::from(width) && py < f64::from(height);
                if inside && is_central(px) && is_central(py) {
                    let cell = &mut nearest[py as usize * width as usize + px as usize];
                    *cell = Some(cell.map_or(depth, |nearer| nearer.min(depth)));
                }
            }
        }
    }
    nearest
}
