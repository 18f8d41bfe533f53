//! Cases of surfaces and layers (hard cases 2, 4, 5; C9, D1).

use super::Case;
use super::fixtures::{
    build_ldi, capture, case_rng, draw, largest, look_along, pack, random_direction, sample,
    sample_with_normal, with_kernel,
};
use glam::{DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::random::Rng;
use headbox_cube::model::parameters::{CaptureParameters, MergeRule};
use headbox_cube::model::samples::{CubeSamples, DepthPixel};
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::render::RenderSettings;
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle};
use std::sync::Arc;

/// Colour of the wall.
const WALL: [u8; 3] = [200, 100, 50];
/// Error bound of colour times coverage in the kernels that blend in 8 bits, levels: half a level
/// for each of the last few blends.
const BLENDED_LEVELS: f64 = 2.0;

pub(super) fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "samples behind, on and just before the eye's plane",
            what: "A wall of one colour, eyes from 1 m behind it to 1e-9 m before it: how far any pixel that is not a hole is from the wall's colour, times its coverage, all kernels.",
            unit: "levels",
            bound: BLENDED_LEVELS,
            reason: "w = Z2 / Z1 below 1/1024 is not drawn, and what is drawn is of one colour: what remains is half a level for each of the last few 8-bit blends of the paper's and the opaque kernel.",
            measure: |seed| {
                let mut rng = case_rng(seed, 51);
                let cube = pack(&wall(|_| Face::PosZ.normal(), seed))?;
                largest((0..12).map(|i| {
                    let gap = [
                        1e-9, 1e-6, 1e-3, 2e-3, 0.01, 0.1, 1.0, 0.0, -1e-9, -1e-3, -0.1, -1.0,
                    ][i];
                    let eye = dvec3(rng.between(-0.2, 0.2), rng.between(-0.2, 0.2), gap - 1.0);
                    wall_error_levels(&cube, &look_along(eye, DVec3::NEG_Z, 40.0, [50, 40]).ok()?)
                }))
            },
        },
        Case {
            name: "grazing, back-facing and random normals",
            what: "The same wall with normals along the ray, away from it, anywhere: the same.",
            unit: "levels",
            bound: BLENDED_LEVELS,
            reason: "A normal that says nothing makes a footprint too large or too small, never another colour.",
            measure: |seed| {
                let mut rng = case_rng(seed, 52);
                largest((0..3).map(|kind| {
                    let cube = pack(&wall(
                        |rng| match kind {
                            0 => DVec3::X,
                            1 => Face::NegZ.normal(),
                            _ => random_direction(rng),
                        },
                        seed,
                    ))?;
                    wall_error_levels(
                        &cube,
                        &look_along(rng.in_cube(0.4), DVec3::NEG_Z, 50.0, [50, 40]).ok()?,
                    )
                }))
            },
        },
        Case {
            name: "holes of a wall with random normals",
            what: "Share of a wall's pixels that stay empty when its normals are random.",
            unit: "%",
            bound: 1.0,
            reason: "The least radius and the largest slope bound the damage.",
            measure: |seed| {
                let mut rng = case_rng(seed, 53);
                let cube = pack(&wall(random_direction, seed))?;
                let eye = rng.in_cube(0.4);
                let camera = look_along(
                    eye,
                    dvec3(-eye.x * 0.5, -eye.y * 0.5, -1.0).normalize(),
                    40.0,
                    [50, 40],
                )
                .ok()?;
                let frame = draw(&cube, &camera, &RenderSettings::default());
                Some(100.0 * frame.hole_count() as f64 / frame.color.len() as f64)
            },
        },
        Case {
            name: "twenty layers in every pixel",
            what: "Twenty walls behind each other from 0.65 to 1,400 m, the nearest of another colour: pixels that do not show the nearest, eyes before them.",
            unit: "px",
            bound: 0.0,
            reason: "Layers have no limit, and opaque nearest ones hide the rest whatever their number.",
            measure: |seed| {
                let mut rng = case_rng(seed, 54);
                let ldi = build_ldi(40, &[Face::NegZ], |face, _, _| {
                    (0..20)
                        .map(|i| {
                            sample(
                                face,
                                7e-4 * 1.5f64.powi(i),
                                if i == 19 { WALL } else { [0, 0, 250] },
                            )
                        })
                        .collect()
                });
                let cube = pack(&ldi)?;
                let eye = rng.in_cube(0.2);
                let frame = draw(
                    &cube,
                    &look_along(eye, DVec3::NEG_Z, 40.0, [50, 40]).ok()?,
                    &RenderSettings::default(),
                );
                Some(frame.color.iter().filter(|c| c[..3] != WALL).count() as f64)
            },
        },
        Case {
            name: "empty pixels, rows and segments",
            what: "Sparse random LDIs, packed in both layouts, with all splits, and read back: samples that are missing or at another place.",
            unit: "samples",
            bound: 0.0,
            reason: "Offset tables say where every sample is, also across runs of empty pixels.",
            measure: sparse_round_trip,
        },
        Case {
            name: "an LDI without samples",
            what: "Pixels of a frame of an empty cube that are not holes.",
            unit: "px",
            bound: 0.0,
            reason: "Nothing is drawn, and nothing fails.",
            measure: |seed| {
                let cube = pack(&build_ldi(16, &[], |_, _, _| vec![]))?;
                let forward = random_direction(&mut case_rng(seed, 56));
                let camera = look_along(DVec3::ZERO, forward, 60.0, [20, 10]).ok()?;
                Some((200 - draw(&cube, &camera, &RenderSettings::default()).hole_count()) as f64)
            },
        },
        Case {
            name: "surfaces closer than a depth bin",
            what: "Two planes a hundredth of a bin apart and of different colours, captured on 1 and 3 threads under all three rules of D1: samples that differ between the runs.",
            unit: "samples",
            bound: 0.0,
            reason: "Which sample wins is decided by bins, areas and ray keys, not by arrival.",
            measure: |seed| {
                largest(RULES.map(|rule| {
                    let [once, again] = [1, 3].map(|threads| {
                        let pool = rayon::ThreadPoolBuilder::new()
                            .num_threads(threads)
                            .build()
                            .ok()?;
                        pool.install(|| {
                            planes(
                                seed,
                                &[(2.0, [0.8, 0.1, 0.1]), (2.000_2, [0.1, 0.1, 0.8])],
                                rule,
                            )
                        })
                    });
                    let (a, b) = (once?, again?);
                    let differ = |(x, y): &(&DepthPixel, &DepthPixel)| x != y;
                    let pairs = a
                        .faces
                        .iter()
                        .zip(&b.faces)
                        .flat_map(|(f, g)| f.samples.iter().zip(&g.samples));
                    let counts = a
                        .faces
                        .iter()
                        .zip(&b.faces)
                        .map(|(f, g)| f.samples.len().abs_diff(g.samples.len()));
                    Some((pairs.filter(differ).count() + counts.sum::<usize>()) as f64)
                }))
            },
        },
        Case {
            name: "two colours closer than a bin, by rule",
            what: "Stripes a sixth of a pixel wide, red and blue in turns and a two-thousandth of a depth bin apart, captured by the three rules of D1: share of pixels that do not hold what the rule says (one sample of both colours; one sample of one; a sample of each).",
            unit: "%",
            bound: 4.0,
            reason: "Each pixel gets some thirty hits, half of them red: a few pixels of a hundred have too few of one colour. A rule that is not kept shows in all of them.",
            measure: |seed| largest(RULES.map(|rule| rule_violations(seed, rule))),
        },
        Case {
            name: "one surface with noise in its depth",
            what: "The same stripes of one colour, each at a depth of its own, off by up to a tenth of a depth bin at random: mean number of samples per occupied pixel, less one.",
            unit: "",
            bound: 0.05,
            reason: "A cluster reaches across a bin's border once; noise far below a bin must not make layers.",
            measure: |seed| {
                let mut rng = case_rng(seed, 59);
                let noise = |_| (2.0 + rng.between(-0.038, 0.038), [0.5; 3]);
                let ldi = capture_with_rule(seed, stripes(noise), MergeRule::Average)?;
                let face = &ldi.faces[Face::NegZ.index()];
                let occupied = face
                    .offsets
                    .windows(2)
                    .filter(|ends| ends[1] > ends[0])
                    .count();
                Some(face.samples.len() as f64 / occupied.max(1) as f64 - 1.0)
            },
        },
    ]
}

/// Builds a wall of one colour, 1 m in front of the centre.
fn wall(normal: impl Fn(&mut Rng) -> DVec3, seed: u64) -> CubeSamples {
    let mut rng = case_rng(seed, 50);
    build_ldi(40, &[Face::NegZ], |_, _, _| {
        vec![sample_with_normal(normal(&mut rng).as_vec3(), 1.0, WALL)]
    })
}

/// Returns the largest difference of a pixel from the wall's colour, times its coverage, over all
/// kernels, levels. Holes, which are not filled, must be black.
fn wall_error_levels(cube: &CubeLdi, camera: &Camera) -> Option<f64> {
    largest(SplatKernel::ALL.map(|splats| {
        let frame = draw(
            cube,
            camera,
            &RenderSettings {
                keep_holes: true,
                ..with_kernel(splats)
            },
        );
        largest(
            frame
                .color
                .iter()
                .zip(&frame.coverage)
                .map(|(color, coverage)| {
                    let (expected, share) = if coverage.is_hole() {
                        ([0; 3], 1.0)
                    } else {
                        (WALL, f64::from(coverage.splat_share()) / 255.0)
                    };
                    let errors = (0..3).map(|c| f64::from(color[c].abs_diff(expected[c])));
                    Some(errors.fold(0.0, f64::max) * share)
                }),
        )
    }))
}

/// Packs sparse random LDIs; returns the number of face pixels whose samples differ.
fn sparse_round_trip(seed: u64) -> Option<f64> {
    let mut rng = case_rng(seed, 55);
    let density = [2, 20, 400][rng.below(3) as usize];
    let ldi = build_ldi(23, &[Face::PosX, Face::NegY, Face::NegZ], |face, _, _| {
        let layers = if rng.below(density) == 0 {
            rng.below(4)
        } else {
            0
        };
        let mut depths: Vec<f64> = (0..layers).map(|_| rng.between(0.05, 1.9)).collect();
        depths.sort_by(f64::total_cmp);
        depths
            .into_iter()
            .map(|q| sample(face, q, [rng.bits() as u8, 1, 2]))
            .collect()
    });
    let mut wrong = 0;
    for layout in [SplatIndexLayout::Normal, SplatIndexLayout::Paper] {
        for split in [Split::Auto, Split::None, Split::AtDepth(1.5)] {
            let cube = CubeLdi::pack(&ldi, layout, split).ok()?;
            cube.validate().ok()?;
            for face in &ldi.faces {
                for (x, y) in (0..23u32).flat_map(|y| (0..23u32).map(move |x| (x, y))) {
                    let segments = cube.segments.iter().filter(|s| s.face == face.face);
                    let packed: Vec<_> = segments
                        .flat_map(|s| match (x.checked_sub(s.x0), y.checked_sub(s.y0)) {
                            (Some(x), Some(y)) => s.pixel(x, y),
                            _ => &[],
                        })
                        .map(|pixel| pixel.color_srgb)
                        .collect();
                    let expected: Vec<_> = face.pixel(x, y).iter().map(|s| s.color_srgb).collect();
                    wrong += usize::from(packed != expected);
                }
            }
        }
    }
    Some(wrong as f64)
}

/// The rules of D1.
const RULES: [MergeRule; 3] = [
    MergeRule::Average,
    MergeRule::SmallerArea,
    MergeRule::ColorsApart,
];

/// Edge of a captured face, px.
const FACE_PX: u32 = 24;

/// Captures squares across -Z at the given depths and colours, tilted at random by a tenth of a
/// depth bin.
fn planes(seed: u64, planes: &[(f64, [f32; 3])], merge_rule: MergeRule) -> Option<CubeSamples> {
    let mut rng = case_rng(seed, 57);
    let mut scene = Scene::default();
    for &(depth, albedo) in planes {
        // A bin is 1 / (half * sqrt(3) * 12) of inverse depth wide: at 2 m, 0.38 m.
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        let corners =
            corners.map(|(x, y)| dvec3(x * depth, y * depth, -depth + rng.between(-0.02, 0.02)));
        push_square(&mut scene, corners, albedo);
    }
    capture_with_rule(seed, scene, merge_rule)
}

/// Builds vertical stripes that fill the -Z face at 2 m, six per pixel. `appearance` returns the
/// depth and colour of a stripe.
fn stripes(mut appearance: impl FnMut(u32) -> (f64, [f32; 3])) -> Scene {
    const STRIPES: u32 = 6 * FACE_PX;
    let mut scene = Scene::default();
    for i in 0..STRIPES {
        let (depth, albedo) = appearance(i);
        let [left, right] = [i, i + 1].map(|i| (f64::from(2 * i) / f64::from(STRIPES) - 1.0) * 2.0);
        let corners = [(left, -2.0), (right, -2.0), (right, 2.0), (left, 2.0)]
            .map(|(x, y)| dvec3(x, y, -depth));
        push_square(&mut scene, corners, albedo);
    }
    scene
}

fn push_square(scene: &mut Scene, corners: [DVec3; 4], albedo: [f32; 3]) {
    let (first, material) = (scene.positions.len() as u32, scene.materials.len() as u32);
    scene.materials.push(Material {
        albedo,
        ..Material::default()
    });
    scene.positions.extend(corners);
    for vertices in [[0, 1, 2], [0, 2, 3]] {
        scene.triangles.push(Triangle {
            vertices: vertices.map(|v: u32| first + v),
            material,
        });
    }
}

/// Captures two colours in one depth bin; returns the share of pixels of the -Z face whose samples
/// violate the merge rule, percent.
fn rule_violations(seed: u64, rule: MergeRule) -> Option<f64> {
    let red_and_blue = |i: u32| {
        if i.is_multiple_of(2) {
            (2.0, [0.8, 0.1, 0.1])
        } else {
            (2.000_2, [0.1, 0.1, 0.8])
        }
    };
    let ldi = capture_with_rule(seed, stripes(red_and_blue), rule)?;
    let face = &ldi.faces[Face::NegZ.index()];
    // 0.8 and 0.1 are 230 and 89 in sRGB; their mean 181.
    let kind = |s: &DepthPixel| match (s.color_srgb[0], s.color_srgb[2]) {
        (220.., ..=110) => "red",
        (..=110, 220..) => "blue",
        (130..=215, 130..=215) => "both",
        _ => "neither",
    };
    let inner = || (1..FACE_PX - 1).flat_map(|y| (1..FACE_PX - 1).map(move |x| (x, y)));
    let wrong = inner().filter(|&(x, y)| {
        let mut kinds: Vec<&str> = face.pixel(x, y).iter().map(kind).collect();
        kinds.sort_unstable();
        match rule {
            MergeRule::Average => kinds != ["both"],
            MergeRule::SmallerArea => kinds != ["red"] && kinds != ["blue"],
            MergeRule::ColorsApart => kinds != ["blue", "red"],
        }
    });
    Some(100.0 * wrong.count() as f64 / inner().count() as f64)
}

/// Captures a scene about the origin.
fn capture_with_rule(seed: u64, scene: Scene, merge_rule: MergeRule) -> Option<CubeSamples> {
    let parameters = CaptureParameters {
        seed,
        merge_rule,
        ..CaptureParameters::unlit(6, 8)
    };
    capture(Arc::new(scene), DVec3::ZERO, 0.5, FACE_PX, parameters)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_colour_is_detected() {
        let cube = pack(&build_ldi(8, &[Face::NegZ], |face, x, _| {
            vec![sample(face, 1.0, if x < 4.0 { WALL } else { [1, 2, 3] })]
        }))
        .expect("packs");
        let camera = look_along(DVec3::ZERO, DVec3::NEG_Z, 40.0, [20, 20]).expect("valid");
        assert!(wall_error_levels(&cube, &camera).expect("drawn") > 100.0);
    }
}
