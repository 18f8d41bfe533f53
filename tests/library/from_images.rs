//! Cube LDIs from depth images (S12): they reproduce the traced samples for any camera position and
//! resolution.

use crate::common::bed::{Scene, room, srgb};
use crate::common::capture::centre_rays;
use glam::{DMat3, DVec3, Vec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::progress::Silent;
use headbox_cube::model::parameters::MergeRule;
use headbox_cube::model::samples::CubeSamples;
use headbox_images::traced_view;
use headbox_images::{DepthPicture, ImageSet, ImageSetOptions, Lens, MAX_DEPTH_M, SetWriter, View};
use headbox_ldi::from_images::ImageSetCapture;
use headbox_sprite::write_depth_exr;
use headbox_trace::bvh::{Ray, Tracer};
use headbox_trace::light::Lighting;
use image::{Rgb, RgbImage};
use std::path::Path;
use std::sync::Arc;

/// Names of the faces' images.
const NAMES: [(Face, &str); 6] = [
    (Face::NegZ, "front"),
    (Face::PosZ, "back"),
    (Face::NegX, "left"),
    (Face::PosX, "right"),
    (Face::NegY, "bottom"),
    (Face::PosY, "top"),
];

/// Writes the first layer of a cube as six images with depth, and opens them.
fn write_faces(cube: &CubeSamples, folder: &Path) -> ImageSet {
    for (face, name) in NAMES {
        let image = &cube.faces[face.index()];
        let side = image.size_px;
        let nearest = |x: u32, y: u32| image.pixel(x, y).last();
        let color = |x, y| {
            nearest(x, y).map_or(Rgb([0; 3]), |s| {
                Rgb([s.color_srgb[0], s.color_srgb[1], s.color_srgb[2]])
            })
        };
        RgbImage::from_fn(side, side, color)
            .save(folder.join(format!("cube_{name}.png")))
            .expect("written");
        let depth = |i: u32| {
            nearest(i % side, i / side).map_or(f32::NAN, |sample| 1.0 / sample.inverse_depth)
        };
        let picture = DepthPicture {
            width: side,
            height: side,
            values: (0..side * side).map(depth).collect(),
        };
        write_depth_exr(&picture, &folder.join(format!("cube_{name}_depth.exr"))).expect("written");
    }
    ImageSet::open(folder, &ImageSetOptions::default()).expect("opens")
}

fn job(cube: &CubeSamples, face_size_px: u32, centre: DVec3) -> ImageSetCapture {
    let half_size_m = cube.info.half_size_m;
    ImageSetCapture {
        centre,
        half_size_m,
        face_size_px,
        merge_rule: MergeRule::Average,
        depth_noise: 0.0,
    }
}

fn views(set: &ImageSet) -> Vec<&View> {
    set.views_with_depth().collect()
}

/// Tolerance: two roundings of f32 from inverse depth to depth and back, and those of the warp.
const RELATIVE_DEPTH: f32 = 4e-6;

#[test]
fn six_faces_of_the_tracer_give_its_own_ldi_back() {
    let cube = centre_rays(&room(20.0), 64);
    let folder = tempfile::tempdir().expect("a folder");
    let set = write_faces(&cube, folder.path());
    assert_eq!(set.views.len(), 6);
    let found = job(&cube, 64, DVec3::ZERO)
        .run(&set, &views(&set), &Silent)
        .expect("warps");
    for (face, expected) in found.faces.iter().zip(&cube.faces) {
        for (x, y) in (0..64).flat_map(|y| (0..64).map(move |x| (x, y))) {
            let (found, expected) = (face.pixel(x, y), expected.pixel(x, y).last());
            assert_eq!(
                found.len(),
                usize::from(expected.is_some()),
                "{:?} {x} {y}",
                face.face
            );
            let (Some(found), Some(expected)) = (found.first(), expected) else {
                continue;
            };
            let error = (found.inverse_depth / expected.inverse_depth - 1.0).abs();
            assert!(error < RELATIVE_DEPTH, "{:?} {x} {y}: {error}", face.face);
            assert_eq!(found.color_srgb[..3], expected.color_srgb[..3]);
        }
    }
}

/// Same test, for a scene of triangles, with the product's own tracer, through six pinholes of a
/// `transforms.json`.
#[test]
fn six_pinholes_give_centre_ray_ldi() {
    const SIDE: u32 = 96;
    let scene = Arc::new(headbox_scenes::build("castle", 0).expect("a built-in scene"));
    let centre = scene.headbox.expect("it suggests one").centre;
    let tracer = Tracer::new(scene, centre);
    let lighting = Lighting::measure(&tracer, 0);
    let folder = tempfile::tempdir().expect("a folder");
    let mut writer = SetWriter::new(folder.path());
    let taken = Face::ALL.map(|face| {
        let world_from_eye = DMat3::from_cols(face.right(), face.up(), -face.normal());
        let camera = Camera::from_parts(centre, world_from_eye, f64::from(SIDE) / 2.0, SIDE, SIDE)
            .expect("a camera");
        let view = traced_view::trace(&tracer, &lighting, false, &camera, 1, &Silent);
        writer.add(face.index(), &view, true).expect("written");
        view
    });
    writer.finish().expect("written");
    let set = ImageSet::open(folder.path(), &ImageSetOptions::default()).expect("opens");
    let job = ImageSetCapture {
        centre,
        face_size_px: SIDE,
        ..ImageSetCapture::suggest(&set)
    };
    let found = job.run(&set, &views(&set), &Silent).expect("warps");
    for ((face, found), taken) in Face::ALL.into_iter().zip(&found.faces).zip(&taken) {
        for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
            let direction = face.direction(f64::from(x) + 0.5, f64::from(y) + 0.5, SIDE);
            let ray = Ray {
                origin: Vec3::ZERO,
                direction: direction.as_vec3(),
                t_min: 0.0,
                t_max: f32::INFINITY,
            };
            let hit = tracer.closest(&ray);
            // The sky is a surface that is practically at infinity.
            let expected = 1.0
                / hit.map_or(MAX_DEPTH_M, |hit| {
                    hit.t * direction.dot(face.normal()) as f32
                });
            let [found] = found.pixel(x, y) else {
                panic!("{face:?} {x} {y}: one sample a pixel")
            };
            let error = (found.inverse_depth / expected - 1.0).abs();
            assert!(error < RELATIVE_DEPTH, "{face:?} {x} {y}: {error}");
            assert_eq!(
                found.color_srgb,
                taken.color[(y * SIDE + x) as usize],
                "{face:?} {x} {y}"
            );
        }
    }
}

/// Writes an equirectangular panorama of a scene from the origin, and opens it.
fn write_panorama(scene: &Scene, width: u32, folder: &Path) -> ImageSet {
    let height = width / 2;
    let ray = |i: u32| {
        Lens::Equirectangular.ray(
            [f64::from(i % width) + 0.5, f64::from(i / width) + 0.5],
            [width, height],
        )
    };
    let hit = |i: u32| scene.hit(DVec3::ZERO, ray(i)).expect("a closed room");
    let color = |x, y| {
        let [r, g, b, _] = srgb(hit(y * width + x).color);
        Rgb([r, g, b])
    };
    RgbImage::from_fn(width, height, color)
        .save(folder.join("all.png"))
        .expect("written");
    let values = (0..width * height).map(|i| hit(i).t as f32).collect();
    write_depth_exr(
        &DepthPicture {
            width,
            height,
            values,
        },
        &folder.join("all_depth.exr"),
    )
    .expect("written");
    ImageSet::open(folder, &ImageSetOptions::default()).expect("opens")
}

#[test]
fn panorama_gives_centre_ray_ldi() {
    /// Tolerances: a sample is moved to the centre of its pixel along a plane through its
    /// neighbours. Spheres deviate from that plane, and at edges a pixel of the panorama may show
    /// the other surface.
    const RELATIVE_DEPTH: f32 = 2e-3;
    const AT_EDGES: f64 = 0.04;
    let scene = room(20.0);
    let folder = tempfile::tempdir().expect("a folder");
    let set = write_panorama(&scene, 768, folder.path());
    let cube = centre_rays(&scene, 64);
    let found = job(&cube, 64, DVec3::ZERO)
        .run(&set, &views(&set), &Silent)
        .expect("warps");
    let mut apart = 0;
    for (face, expected) in found.faces.iter().zip(&cube.faces) {
        for (x, y) in (0..64).flat_map(|y| (0..64).map(move |x| (x, y))) {
            let expected = expected.pixel(x, y).last().expect("a closed room");
            let nearest = face.pixel(x, y).last().expect("no gap");
            let error = (nearest.inverse_depth / expected.inverse_depth - 1.0).abs();
            apart += usize::from(error > RELATIVE_DEPTH);
        }
    }
    let share = apart as f64 / (6.0 * 64.0 * 64.0);
    assert!(share < AT_EDGES, "{share} of the pixels have another depth");
}

#[test]
fn magnified_no_gaps_minified_averaged() {
    let cube = centre_rays(&room(20.0), 48);
    let folder = tempfile::tempdir().expect("a folder");
    let set = write_faces(&cube, folder.path());
    for face_px in [17, 24, 96, 151] {
        let found = job(&cube, face_px, DVec3::ZERO)
            .run(&set, &views(&set), &Silent)
            .expect("warps");
        let empty: usize = found
            .faces
            .iter()
            .map(|face| {
                face.offsets
                    .windows(2)
                    .filter(|pair| pair[0] == pair[1])
                    .count()
            })
            .sum();
        assert_eq!(empty, 0, "faces of {face_px}: a closed room has no gap");
    }
}

#[test]
fn thread_and_batch_order_do_not_matter() {
    let cube = centre_rays(&room(20.0), 40);
    let folder = tempfile::tempdir().expect("a folder");
    let set = write_faces(&cube, folder.path());
    let job = job(&cube, 56, DVec3::new(0.05, -0.03, 0.04));
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| job.run(&set, &views(&set), &Silent).expect("warps"))
    };
    assert_eq!(run(1).faces, run(3).faces);
}
