//! Promises of sprite files and sets: round trips, damage, order, capture from a scene.

use super::oracle::{Waves, look, picture, sprite};
use glam::{DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::depth_kind::DepthKind;
use headbox_core::progress::Silent;
use headbox_images::depth::DepthPicture;
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle};
use headbox_sprite::{
    DepthImport, Displacement, DisplacementFormat, RenderOptions, SlabCapture, Sprite, SpriteLayer,
    SpritePlane, SpriteRenderer, SpriteSet, SpriteWithDepth, capture_slabs, slabs_at_gaps,
};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use image::{Rgba, RgbaImage};
use std::sync::Arc;

fn two_sprites() -> SpriteSet {
    let waves = Waves {
        amplitude: 0.05,
        waves: 1.0,
    };
    let formats = [DisplacementFormat::I8, DisplacementFormat::F32];
    SpriteSet::new(
        formats
            .map(|f| sprite(24, picture(24), waves.displacement(24, f)))
            .into(),
    )
}

#[test]
fn files_round_trip() {
    let dir = tempfile::tempdir().expect("folder");
    let path = dir.path().join("a.sprite");
    let set = two_sprites();
    set.write(&path).expect("written");
    let read = SpriteSet::read(&path).expect("read");
    assert_eq!(read.sprites().len(), 2);
    for (a, b) in set.sprites().iter().zip(read.sprites()) {
        assert_eq!(a.sprite(), b.sprite());
    }
    let bytes = std::fs::read(&path).expect("there");
    read.write(&path).expect("written");
    assert_eq!(std::fs::read(&path).expect("there"), bytes);
}

#[test]
fn damaged_files_are_refused() {
    let dir = tempfile::tempdir().expect("folder");
    let path = dir.path().join("a.sprite");
    two_sprites().write(&path).expect("written");
    let good = std::fs::read(&path).expect("there");
    for i in (0..good.len()).step_by(11) {
        let mut bad = good.clone();
        bad[i] ^= 1 << (i % 8);
        std::fs::write(&path, &bad).expect("written");
        // Padding between sections is not checked; a change there has no effect.
        if let Ok(read) = SpriteSet::read(&path) {
            assert_eq!(
                read.sprites()[1].sprite(),
                two_sprites().sprites()[1].sprite(),
                "byte {i}"
            );
        }
        std::fs::write(&path, &good[..i]).expect("written");
        assert!(SpriteSet::read(&path).is_err(), "cut to {i} bytes");
    }
}

#[test]
fn exported_depth_imports_unchanged() {
    let dir = tempfile::tempdir().expect("folder");
    let [color, depth] = ["color.png", "depth.exr"].map(|name| dir.path().join(name));
    let original = sprite(
        24,
        picture(24),
        Waves {
            amplitude: 0.05,
            waves: 1.0,
        }
        .displacement(24, DisplacementFormat::I16),
    );
    original.export(&color, &depth).expect("written");
    let picture = DepthPicture::read(&depth, 1.0, 1.0).expect("read");
    let import = DepthImport {
        color: image::open(&color).expect("read").to_rgba8(),
        camera: *original.sprite().camera(),
        depth: &picture.values,
        depth_kind: DepthKind::EyeDepth,
        window_range_m: (0.0, 0.0),
        plane: None,
        format: DisplacementFormat::F32,
    };
    let again = import.build().expect("valid");
    assert_eq!(again.sprite().color(), original.sprite().color());
    for (a, b) in again.depth_picture().values.iter().zip(&picture.values) {
        assert!(
            (a - b).abs() < 1e-5,
            "the plane may differ, the surface does not: {a} for {b}"
        );
    }
    let grey = dir.path().join("depth.png");
    image::ImageBuffer::<image::Luma<u16>, _>::from_raw(2, 1, vec![0u16, 1500])
        .expect("two")
        .save(&grey)
        .expect("written");
    let grey = DepthPicture::read(&grey, 0.001, 1.0).expect("read");
    assert!(grey.values[0].is_nan() && (grey.values[1] - 1.5).abs() < 1e-6);
    assert!(
        DepthPicture::read(&color, 1.0, 1.0).is_err(),
        "colour is not depth"
    );
}

/// A flat sprite of one colour on a plane.
pub(super) fn card(color: [u8; 4], center: DVec3, normal: DVec3) -> SpriteWithDepth {
    let camera = look(center + normal.normalize() * 2.0, center, 16);
    let sprite = Sprite::new(
        RgbaImage::from_pixel(16, 16, Rgba(color)),
        camera,
        SpritePlane::through(center, normal),
    );
    SpriteWithDepth::new(sprite.expect("valid"), Displacement::zero(16, 16)).expect("valid")
}

#[test]
fn each_eye_gets_its_own_order() {
    let cards = [-1.0, 0.0, 1.0].map(|z| card([255; 4], dvec3(0.0, 0.0, z), DVec3::Z));
    let set = SpriteSet::new(cards.into());
    assert_eq!(set.back_to_front(dvec3(0.0, 0.0, 5.0)), [0, 1, 2]);
    assert_eq!(set.back_to_front(dvec3(0.0, 0.0, -5.0)), [2, 1, 0]);
    let between = set.back_to_front(dvec3(0.1, 0.0, 0.4));
    let place = |sprite| between.iter().position(|&s| s == sprite);
    assert!(
        place(0) < place(1),
        "of those on one side of the eye the farther comes first: {between:?}"
    );
    // A floor whose centre is nearer than the object on it is still drawn first.
    let floor = card([1, 1, 1, 255], dvec3(0.0, -1.0, 0.0), dvec3(0.0, 1.0, 1e-3));
    let standing = card([2, 2, 2, 255], dvec3(0.0, 0.1, -0.8), DVec3::Z);
    assert_eq!(
        SpriteSet::new(vec![standing, floor]).back_to_front(dvec3(0.0, 0.2, 1.5)),
        [1, 0]
    );
}

#[test]
fn the_front_covers_the_back() {
    let set = SpriteSet::new(vec![
        card([0, 0, 255, 255], dvec3(0.0, 0.0, 1.0), DVec3::Z),
        card([255, 0, 0, 255], dvec3(0.0, 0.0, -1.0), DVec3::Z),
    ]);
    let mut frame = SpriteLayer::default();
    let mut middle = |z: f64| {
        let target = look(dvec3(0.0, 0.0, z), DVec3::ZERO, 32);
        set.render(
            &mut SpriteRenderer::new(),
            &target,
            &RenderOptions::default(),
            &mut frame,
        );
        frame.pixels()[16 * 32 + 16]
    };
    assert_eq!(middle(4.0), [0, 0, 255, 255]);
    assert_eq!(middle(-4.0), [255, 0, 0, 255]);
}

/// Two emissive squares, the nearer one half as large.
fn squares() -> Scene {
    let mut scene = Scene::default();
    for (z, half, emission) in [(-4.0, 3.0, [0.8, 0.1, 0.1]), (-2.0, 0.5, [0.1, 0.1, 0.8])] {
        let first = scene.positions.len() as u32;
        scene.materials.push(Material {
            emission,
            albedo: [0.0; 3],
            ..Material::default()
        });
        scene.positions.extend(
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
                .map(|[x, y]| dvec3(x * half, y * half, z)),
        );
        let material = scene.materials.len() as u32 - 1;
        for corners in [[0, 1, 2], [0, 2, 3]] {
            scene.triangles.push(Triangle {
                vertices: corners.map(|c| first + c),
                material,
            });
        }
    }
    scene
}

#[test]
fn slabs_of_a_scene_become_matted_sprites() {
    let tracer = Tracer::new(Arc::new(squares()), DVec3::ZERO);
    let lighting = Lighting::unmetered(&tracer, 0);
    let camera =
        Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [41, 41]).expect("valid");
    let slabs = slabs_at_gaps(&tracer, &camera, 2);
    assert_eq!(slabs.len(), 2);
    let capture = SlabCapture {
        tracer: &tracer,
        lighting: &lighting,
        lit: false,
        samples: 16,
        format: DisplacementFormat::I8,
    };
    let sprites = capture_slabs(&capture, &camera, &slabs, &Silent).expect("captured");
    let [far, near] = sprites.as_slice() else {
        panic!("two sprites")
    };
    assert!(
        far.sprite().color().pixels().all(|p| p.0[3] == 255),
        "what is behind the near square is there too"
    );
    let alphas: Vec<u8> = near.sprite().color().pixels().map(|p| p.0[3]).collect();
    assert!(
        alphas.contains(&0) && alphas.contains(&255) && alphas.iter().any(|a| (1..255).contains(a)),
        "soft silhouette"
    );
    for (sprite, depth) in [(far, 4.0), (near, 2.0)] {
        assert!((sprite.sprite().plane().signed_distance(DVec3::ZERO) - depth).abs() < 1e-4);
        assert!(
            sprite
                .displacement()
                .to_f32()
                .iter()
                .all(|d| d.abs() < 1e-5),
            "flat"
        );
    }
}

#[test]
fn bad_parts_are_named() {
    use headbox_sprite::SpriteError;
    let camera = look(dvec3(0.0, 0.0, 2.0), DVec3::ZERO, 8);
    let color = RgbaImage::new(8, 8);
    let through_eye = SpritePlane::through(camera.eye(), DVec3::Y);
    assert_eq!(
        Sprite::new(color.clone(), camera, through_eye),
        Err(SpriteError::PlaneThroughEye)
    );
    let nowhere = SpritePlane::through(DVec3::ZERO, DVec3::ZERO);
    assert_eq!(
        Sprite::new(color.clone(), camera, nowhere),
        Err(SpriteError::PlaneThroughEye)
    );
    let plane = SpritePlane::through(DVec3::ZERO, DVec3::Z);
    assert!(matches!(
        Sprite::new(RgbaImage::new(8, 7), camera, plane),
        Err(SpriteError::SizeMismatch { .. })
    ));
    let sprite = Sprite::new(color, camera, plane).expect("valid");
    let finer = SpriteWithDepth::new(sprite.clone(), Displacement::zero(9, 8));
    assert!(matches!(finer, Err(SpriteError::DisplacementSize { .. })));
    // Nothing visible: an empty frame.
    let set = SpriteSet::new(vec![
        SpriteWithDepth::new(sprite, Displacement::zero(1, 1)).expect("valid"),
    ]);
    let mut frame = SpriteLayer::default();
    set.render(
        &mut SpriteRenderer::new(),
        &look(dvec3(0.3, 0.0, 2.0), DVec3::ZERO, 16),
        &RenderOptions::default(),
        &mut frame,
    );
    assert!(frame.pixels().iter().all(|p| *p == [0; 4]));
}
