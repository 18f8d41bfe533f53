//! Selection of plane textures: no sample moves by more than the bound, and files keep them.

use crate::common::bed::{Scene, Shape, leaves, room};
use crate::common::capture::quick;
use glam::{DVec3, Vec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::frame::Frame;
use headbox_core::random::Rng;
use headbox_cube::model::samples::{CubeSamples, DepthPixel, EncodedNormal, LayeredDepthImage};
use headbox_cube::pack::file::CUBE_LDI;
use headbox_cube::pack::{CubeLdi, Plane, PlaneSet, PlaneTile, SplatIndexLayout, Split};
use headbox_cube::planes::{Bound, DEFAULT_ERROR_PX, choose, pack};
use headbox_cube::render::{RenderSettings, Renderer};

pub(super) const FACE_PX: u32 = 192;

pub(super) fn pack_with_planes(ldi: &CubeSamples, error_px: f64) -> CubeLdi {
    let mut ldi = ldi.clone();
    let planes = choose(&mut ldi, error_px);
    let mut cube = CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).expect("packs");
    cube.planes = planes;
    assert_eq!(cube.validate(), Ok(()));
    cube
}

pub(super) fn draw(cube: &CubeLdi, camera: &Camera) -> Frame {
    Renderer::new()
        .render(cube, camera, &RenderSettings::default())
        .clone()
}

/// Samples that plane textures have replaced in a face, with their pixels.
fn replaced_samples(
    all: &CubeSamples,
    rest: &CubeSamples,
    face: Face,
) -> Vec<(u32, u32, DepthPixel)> {
    let [all, rest] = [all, rest].map(|ldi| &ldi.faces[face.index()]);
    let mut taken = Vec::new();
    for (x, y) in (0..FACE_PX).flat_map(|y| (0..FACE_PX).map(move |x| (x, y))) {
        let mut left = rest.pixel(x, y).iter().peekable();
        for sample in all.pixel(x, y) {
            if left.next_if(|other| *other == sample).is_none() {
                taken.push((x, y, *sample));
            }
        }
        assert!(left.next().is_none(), "what is left was there before");
    }
    taken
}

/// Position at which a texture shows a sample, and that of the sample's surface: two points of one
/// ray through the sample's pixel, at the place in the pixel where the texture is nearest to the
/// sample's depth, since a sample does not record where rays met it.
fn texture_and_surface_positions(
    set: &PlaneSet,
    tile: &PlaneTile,
    face: Face,
    (x, y, sample): &(u32, u32, DepthPixel),
) -> [DVec3; 2] {
    let [q, along_x, along_y] = set.planes[tile.plane as usize].inverse_depth(face, FACE_PX);
    let middle = [f64::from(*x) + 0.5, f64::from(*y) + 0.5];
    let said = f64::from(sample.inverse_depth);
    let off = said - (q + along_x * middle[0] + along_y * middle[1]);
    let part = (off / (along_x.abs() + along_y.abs()).max(1e-300) * 2.0).clamp(-1.0, 1.0) * 0.5;
    let at = [
        middle[0] + part * along_x.signum(),
        middle[1] + part * along_y.signum(),
    ];
    let d = face.direction(at[0], at[1], FACE_PX);
    // A plane at infinity shows it very far away.
    [
        d / (q + along_x * at[0] + along_y * at[1]).max(1e-12),
        d / said,
    ]
}

/// Leaves in front of mountains so far away that a texture at infinity shows them.
fn mountains() -> Scene {
    let mut scene = leaves(6.0);
    scene.shapes.push(Shape::Disk {
        centre: dvec3(0.0, 0.0, -9000.0),
        normal: DVec3::Z,
        radius: 7000.0,
    });
    scene
}

/// A slightly curved wall, so that the error bound limits the size of planes.
fn dome() -> Scene {
    Scene {
        shapes: vec![Shape::Sphere {
            centre: dvec3(0.0, 0.0, -2.0),
            radius: 30.0,
        }],
        detail: 6.0,
    }
}

/// Remaining samples are drawn at their positions. Planes: in the room, among leaves, and in the
/// dome, where the bound decides. A texture at infinity: the mountains.
#[test]
fn plane_textures_stay_within_bound() {
    const ERROR_PX: f64 = 0.5;
    const PAIRS: usize = 10_000;
    for (name, scene) in [
        ("room", room(6.0)),
        ("leaves", leaves(6.0)),
        ("mountains", mountains()),
        ("dome", dome()),
    ] {
        let all = quick(&scene, FACE_PX);
        let mut rest = all.clone();
        let set = choose(&mut rest, ERROR_PX);
        let samples: Vec<_> = Face::ALL
            .map(|face| replaced_samples(&all, &rest, face))
            .into();
        assert_eq!(
            samples
                .iter()
                .map(|of_face| of_face.len() as u64)
                .sum::<u64>(),
            set.samples
        );
        let (mut random, mut worst, mut pairs, mut at_infinity) = (Rng::new(5), 0.0f64, 0, 0);
        let focal_px = Bound::focal_px(FACE_PX);
        let (width, height) = (FACE_PX, FACE_PX * 3 / 4);
        while pairs < PAIRS {
            let face = Face::ALL[(random.unit() * 6.0) as usize % 6];
            let of_face = &samples[face.index()];
            let Some(sample) = of_face.get((random.unit() * of_face.len() as f64) as usize) else {
                continue;
            };
            let (x, y) = (sample.0 as i32, sample.1 as i32);
            let covers = |tile: &&PlaneTile| {
                let inside = |v: i32, start: i16, length: u16| {
                    (0..i32::from(length)).contains(&(v - i32::from(start)))
                };
                Face::ALL[usize::from(tile.face)] == face
                    && inside(x, tile.x0, tile.width)
                    && inside(y, tile.y0, tile.height)
            };
            let eye = random.in_cube(all.info.half_size_m);
            let d = face.direction(
                f64::from(sample.0) + 0.5,
                f64::from(sample.1) + 0.5,
                FACE_PX,
            );
            let near = d / f64::from(sample.2.inverse_depth);
            let aside = random.in_cube(0.6) * (near - eye).length();
            let Ok(camera) = Camera::look_at(eye, near + aside, DVec3::Y, 60.0, [width, height])
            else {
                continue;
            };
            assert!(
                (camera.focal_px() - focal_px).abs() < 1e-6 * focal_px,
                "the frame that the bound names"
            );
            let in_frame = |p: &[f64; 3]| {
                (0.0..f64::from(width)).contains(&p[0]) && (0.0..f64::from(height)).contains(&p[1])
            };
            // The bound holds for points that are both in the frame.
            let away = focal_px / 10.0;
            let inner = |p: [f64; 3]| {
                in_frame(&[p[0] - away, p[1] - away, 0.0])
                    && in_frame(&[p[0] + away, p[1] + away, 0.0])
            };
            if !camera.project(near).is_some_and(inner) {
                continue;
            }
            let errors = set.tiles.iter().filter(covers).filter_map(|tile| {
                let [shown, said] = texture_and_surface_positions(&set, tile, face, sample);
                let [a, b] = [camera.project(shown)?, camera.project(said)?];
                Some(((a[0] - b[0]).hypot(a[1] - b[1]), tile))
            });
            if let Some((error, tile)) = errors.min_by(|a, b| a.0.total_cmp(&b.0)) {
                worst = worst.max(error);
                pairs += 1;
                at_infinity += usize::from(set.planes[tile.plane as usize] == Plane::default());
            }
        }
        println!(
            "{name}: {} of {} samples on planes, worst {worst:.3} px",
            set.samples,
            set.samples
                + rest
                    .faces
                    .iter()
                    .map(|f| f.samples.len() as u64)
                    .sum::<u64>()
        );
        // Planes are stored in f32.
        assert!(worst <= ERROR_PX * 1.001, "{name}: {worst} px");
        assert!(
            name != "dome" || worst > 0.2 * ERROR_PX,
            "the bound is what ends planes: {worst} px"
        );
        assert!(
            (1..pairs).contains(&at_infinity) == (name == "mountains"),
            "{name}: {at_infinity} of {pairs}"
        );
    }
}

/// A wall on the face -Z, at a depth of 9.
fn wall() -> Scene {
    Scene {
        shapes: vec![Shape::Disk {
            centre: dvec3(0.0, 0.0, -9.0),
            normal: DVec3::Z,
            radius: 7.0,
        }],
        detail: 6.0,
    }
}

/// Pixels of the face -Z, with the inverse depths of the textures' planes there, and their texels.
fn texels(set: &PlaneSet) -> Vec<([u32; 2], f64, [u8; 4])> {
    let face = Face::NegZ;
    let on_face = |tile: &&PlaneTile| tile.face == face.index() as u16;
    let mut found = Vec::new();
    for tile in set.tiles.iter().filter(on_face) {
        let [q, along_x, along_y] = set.planes[tile.plane as usize].inverse_depth(face, FACE_PX);
        let width = i32::from(tile.width);
        for (i, texel) in (0..).zip(&set.texels[tile.texel_range()]) {
            let x = i32::from(tile.x0) + i % width;
            let y = i32::from(tile.y0) + i / width;
            let [across, down] = [x, y].map(|c| f64::from(c) + 0.5);
            let inverse_depth = q + along_x * across + along_y * down;
            found.push(([x as u32, y as u32], inverse_depth, *texel));
        }
    }
    found
}

/// Behind something far in front of it, a wall continues by a texel. So it does behind something
/// opaque close to it, with which frames average it, and over what continues it smoothly, in the
/// colour of that; but not in front of something else.
#[test]
fn wall_continues_behind_occluders() {
    let middle = FACE_PX / 2;
    let occluder = middle - 6..middle + 6;
    let green = [10, 200, 30];
    let [parallel, across] = [Vec3::Z, Vec3::X].map(EncodedNormal::new);
    // The wall is at 0.111 1/m, and a bin has a width of 0.012 1/m.
    let cases = [
        ("far in front", 0.3, parallel, 255, 255, false),
        ("close in front", 0.122, parallel, 255, 255, true),
        ("translucent", 0.122, parallel, 100, 0, false),
        ("the next facet", 0.104, parallel, 255, 255, true),
        ("around an edge", 0.104, across, 255, 0, false),
        ("behind", 0.09, parallel, 255, 0, false),
    ];
    for (place, inverse_depth, normal, alpha, expected_alpha, is_green) in cases {
        let mut ldi = quick(&wall(), FACE_PX);
        let face = &mut ldi.faces[Face::NegZ.index()];
        for (y, x) in occluder
            .clone()
            .flat_map(|y| occluder.clone().map(move |x| (y, x)))
        {
            let pixel = (y * FACE_PX + x) as usize;
            let [start, end] = [pixel, pixel + 1].map(|i| face.offsets[i] as usize);
            for sample in &mut face.samples[start..end] {
                // In no plane of its own.
                sample.inverse_depth = inverse_depth * if (x + y) % 2 == 0 { 1.0 } else { 1.01 };
                sample.normal = normal;
                let [r, g, b] = green;
                sample.color_srgb = [r, g, b, alpha];
            }
        }
        let set = choose(&mut ldi, DEFAULT_ERROR_PX);
        let mut count = 0;
        for ([x, y], plane, [r, g, b, alpha]) in texels(&set) {
            let is_wall = (plane * 9.0 - 1.0).abs() < 1e-3;
            if is_wall && occluder.contains(&x) && occluder.contains(&y) {
                let rim = [occluder.start, occluder.end - 1];
                let is_rim = rim.contains(&x) || rim.contains(&y);
                let expected = if is_rim { expected_alpha } else { 0 };
                assert_eq!(alpha, expected, "pixel {x}, {y}, {place}");
                if is_rim && alpha == 255 {
                    assert_eq!([r, g, b] == green, is_green, "pixel {x}, {y}, {place}");
                }
                count += 1;
            }
        }
        assert!(count >= 144, "{count} texels, {place}");
    }
}

/// A pixel without a sample is a gap in a wall, but among leaves or the wires of a fence, where all
/// rays have passed.
#[test]
fn only_gaps_of_opaque_surfaces_are_filled() {
    let is_empty = |x: u32, y: u32| x % 4 == 1 && y % 4 == 1;
    for (alpha, expected) in [(255, 255), (64, 0)] {
        let mut ldi = quick(&wall(), FACE_PX);
        let face = &mut ldi.faces[Face::NegZ.index()];
        let mut kept = LayeredDepthImage {
            samples: Vec::new(),
            offsets: vec![0],
            ..face.clone()
        };
        for (y, x) in (0..FACE_PX).flat_map(|y| (0..FACE_PX).map(move |x| (y, x))) {
            for sample in face.pixel(x, y).iter().filter(|_| !is_empty(x, y)) {
                let mut sample = *sample;
                sample.color_srgb[3] = alpha;
                kept.samples.push(sample);
            }
            kept.offsets.push(kept.samples.len() as u32);
        }
        *face = kept;
        let set = choose(&mut ldi, DEFAULT_ERROR_PX);
        let middle = FACE_PX / 2 - 24..FACE_PX / 2 + 24;
        let mut count = 0;
        for ([x, y], _, texel) in texels(&set) {
            if middle.contains(&x) && middle.contains(&y) && is_empty(x, y) {
                assert_eq!(texel[3], expected, "pixel {x}, {y} among alphas of {alpha}");
                count += 1;
            }
        }
        assert!(count >= 144, "{count} empty pixels in textures");
    }
}

/// A wall is drawn by few textures, a surface full of holes by smaller ones, which are no more
/// expensive than its samples.
#[test]
fn texture_size_follows_cost() {
    for (scene, has_large) in [(room(6.0), true), (leaves(6.0), false)] {
        let mut ldi = quick(&scene, FACE_PX);
        let before: usize = ldi.faces.iter().map(|face| face.samples.len()).sum();
        let set = choose(&mut ldi, DEFAULT_ERROR_PX);
        let left: usize = ldi.faces.iter().map(|face| face.samples.len()).sum();
        assert_eq!(set.samples, (before - left) as u64);
        let sides = || set.tiles.iter().flat_map(|tile| [tile.width, tile.height]);
        // One more line of texels on each side where nothing else draws it.
        assert!(sides().all(|side| side <= 128 + 2), "{:?}", sides().max());
        assert!(
            sides().any(|side| side > 64 + 2) || !has_large,
            "{:?}",
            sides().max()
        );
    }
}

#[test]
fn any_number_of_threads_chooses_the_same() {
    for (name, scene) in [("room", room(6.0)), ("leaves", leaves(6.0))] {
        let ldi = quick(&scene, 96);
        let chosen = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("threads");
            pool.install(|| {
                pack(
                    ldi.clone(),
                    SplatIndexLayout::Normal,
                    Split::Auto,
                    DEFAULT_ERROR_PX,
                )
                .expect("packs")
            })
        };
        let one = chosen(1);
        assert!(!one.planes.tiles.is_empty(), "{name}");
        for threads in [2, 3, 7] {
            assert_eq!(chosen(threads), one, "{name}: {threads} threads");
        }
    }
}

#[test]
fn texture_files_round_trip() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.ldi");
    let ldi = quick(&room(6.0), 96);
    let cube = pack_with_planes(&ldi, 0.5);
    assert!(!cube.planes.tiles.is_empty());
    cube.write(&path).expect("written");
    let bytes = std::fs::read(&path).expect("read");
    assert_eq!(bytes[12..16], CUBE_LDI.version.to_le_bytes());
    assert_eq!(CubeLdi::read(&path).expect("read"), cube);
    let all = CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).expect("packs");
    all.write(&path).expect("written");
    let larger = std::fs::read(&path).expect("read");
    assert_eq!(larger[12..16], CUBE_LDI.version.to_le_bytes());
    assert_eq!(CubeLdi::read(&path).expect("read"), all);
    assert!(
        bytes.len() < larger.len(),
        "{} against {}",
        bytes.len(),
        larger.len()
    );
}

#[test]
fn zero_and_wide_bounds() {
    let ldi = quick(&room(6.0), 96);
    for error_px in [0.0, -1.0, f64::NAN] {
        let mut rest = ldi.clone();
        assert_eq!(choose(&mut rest, error_px), PlaneSet::default());
        assert_eq!(rest, ldi);
    }
    let camera =
        Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [64, 48]).expect("valid");
    for error_px in [1e-6, 1e6] {
        assert_eq!(
            draw(&pack_with_planes(&ldi, error_px), &camera).color.len(),
            64 * 48
        );
    }
    let nothing = CubeSamples {
        faces: ldi
            .faces
            .iter()
            .map(|f| LayeredDepthImage::empty(f.face, 96))
            .collect(),
        ..ldi
    };
    assert_eq!(
        pack_with_planes(&nothing, 0.5).planes,
        PlaneSet::default(),
        "an empty headbox"
    );
}
