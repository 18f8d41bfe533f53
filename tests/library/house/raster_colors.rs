//! Colours of the rasteriser: those of the traced surface, from corners and from textures.

use super::raster::{camera, draw, hit, soup, with_textures};
use glam::{DVec3, Vec2, Vec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::color::srgb8_from_linear;
use headbox_raster::PixelContent;
use headbox_scene::material::{Cutout, Material, Texture};
use headbox_scene::scene::Scene;
use headbox_scene::scene::Triangle;
use headbox_trace::bvh::Tracer;
use std::sync::Arc;

/// Tolerance, sRGB levels: a pixel's weights may be those of a point 0.003 px away, and colours of
/// these triangles change by at most 255 levels over some pixels.
const COLOR_LEVELS: i32 = 3;

#[test]
fn colours_equal_traced_surface() {
    // Magnified: a texel is larger than a pixel, so no mip level is used.
    let scene = Arc::new(with_textures(soup(300), 0.02));
    let camera = camera(dvec3(0.3, -0.2, 0.4), dvec3(1.0, 0.2, -3.0), 97, 61);
    let (frame, _) = draw(&scene, &camera);
    let tracer = Tracer::new(Arc::clone(&scene), camera.eye());
    let (mut compared, mut far_off) = (0, 0);
    for pixel in 0..frame.inverse_depth.len() {
        let (x, y) = (
            f64::from(pixel as u32 % 97) + 0.5,
            f64::from(pixel as u32 / 97) + 0.5,
        );
        let Some(hit) = hit(&tracer, &camera, x, y)
            .filter(|hit| frame.seen(pixel) == PixelContent::Triangle(hit.primitive))
        else {
            continue;
        };
        let surface = scene.surface(hit.primitive, hit.u, hit.v);
        let expected =
            [0, 1, 2].map(|c| srgb8_from_linear(surface.albedo[c] + surface.emission[c]));
        let apart = (0..3)
            .map(|c| (i32::from(expected[c]) - i32::from(frame.frame.color[pixel][c])).abs())
            .max();
        compared += 1;
        far_off += u32::from(apart > Some(COLOR_LEVELS));
    }
    // Slivers and triangles of the size of a pixel have all their colours within 0.003 px.
    assert!(
        compared > 3000 && far_off * 50 < compared,
        "{far_off} of {compared}"
    );
}

/// On a floor 0.1 mm below the eye, depths within a frame differ by 10^5. The colours of its
/// corners change linearly over its 100 m, so a pixel's colour gives the position of its weights on
/// the floor.
#[test]
fn floor_just_below_eye_has_correct_colours() {
    let corners = [[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]]
        .map(|[x, z]| dvec3(x, -1e-4, z));
    let even = |p: DVec3| Vec3::new(0.5 + p.x as f32 / 101.0, 0.5 + p.z as f32 / 101.0, 0.5);
    let scene = Scene {
        positions: corners.to_vec(),
        colors: corners.iter().map(|p| even(*p)).collect(),
        triangles: [[0, 1, 2], [0, 2, 3]]
            .map(|vertices| Triangle {
                vertices,
                material: 0,
            })
            .to_vec(),
        materials: vec![Material {
            albedo: [1.0; 3],
            ..Material::default()
        }],
        ..Scene::default()
    };
    // Upside down: the first row is directly below the eye, and the middle one 25 m away, 4e-6 rad
    // below the horizon.
    let camera = |up| {
        Camera::look_at(DVec3::ZERO, dvec3(0.3, -4e-6, -1.0), up, 100.0, [61, 97]).expect("valid")
    };
    let scene = Arc::new(scene);
    for camera in [camera(DVec3::Y), camera(-DVec3::Y)] {
        let frame = draw(&scene, &camera).0;
        let mut compared = 0;
        for pixel in (0..frame.inverse_depth.len())
            .filter(|pixel| frame.seen(*pixel) != PixelContent::Nothing)
        {
            let d = camera.direction(
                f64::from(pixel as u32 % 61) + 0.5,
                f64::from(pixel as u32 / 61) + 0.5,
            );
            let expected = even(d * (-1e-4 / d.y)).to_array().map(srgb8_from_linear);
            let found = frame.frame.color[pixel];
            assert!(
                (0..3).all(|c| expected[c].abs_diff(found[c]) <= 1),
                "{pixel}: {found:?} for {expected:?}"
            );
            compared += 1;
        }
        assert!(compared > 1000, "{compared}");
    }
}

#[test]
fn minified_textures_average_and_cutouts_have_holes() {
    let checks = Texture::from_fn(64, 64, |x, y| {
        if (x + y) % 2 == 0 {
            [255; 4]
        } else {
            [0, 0, 0, 0]
        }
    });
    let quad = [
        dvec3(-1.0, -1.0, -1.0),
        dvec3(1.0, -1.0, -1.0),
        dvec3(1.0, 1.0, -1.0),
        dvec3(-1.0, 1.0, -1.0),
    ];
    let mut scene = Scene {
        positions: quad.to_vec(),
        texcoords: quad
            .iter()
            .map(|p| Vec2::new(p.x as f32, p.y as f32) * 0.5 + 0.5)
            .collect(),
        triangles: [[0, 1, 2], [0, 2, 3]]
            .map(|vertices| Triangle {
                vertices,
                material: 0,
            })
            .to_vec(),
        materials: vec![Material {
            albedo: [1.0; 3],
            albedo_texture: Some(0),
            ..Material::default()
        }],
        textures: vec![checks],
        ..Scene::default()
    };
    let camera =
        Camera::look_at(DVec3::ZERO, dvec3(0.0, 0.0, -1.0), DVec3::Y, 90.0, [8, 8]).expect("valid");
    let (frame, _) = draw(&Arc::new(scene.clone()), &camera);
    let grey = srgb8_from_linear(0.5);
    assert!(
        frame.frame.color.iter().all(|c| c[0].abs_diff(grey) <= 2),
        "{:?}",
        frame.frame.color
    );

    scene.materials[0].cutout = Some(Cutout {
        texture: Some(0),
        threshold: 0.5,
    });
    scene.textures[0] =
        Texture::from_fn(2, 1, |x, _| [255, 255, 255, if x == 0 { 255 } else { 0 }]);
    let (frame, _) = draw(&Arc::new(scene), &camera);
    for pixel in 0..64 {
        let left = pixel % 8 < 4;
        assert_eq!(
            frame.seen(pixel) != PixelContent::Nothing,
            left,
            "pixel {pixel}"
        );
    }
}
