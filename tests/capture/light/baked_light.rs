//! Light in vertices: colours equal the light estimator's.

use super::bake::{baked, floor_and_post, options, uneven_grid};
use glam::{DVec2, DVec3, Vec3, dvec3};
use headbox_core::bounces::Bounces;
use headbox_core::headbox::Headbox;
use headbox_model::bake::{BakeOptions, Baked, bake, bake_model};
use headbox_model::{Cell, PortalModel, Prism};
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Sky, SkyGradient, Triangle};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::{LightSample, Lighting, LitPoint};
use std::ops::ControlFlow;
use std::sync::Arc;

/// A floor under a sky of one colour: all samples are equal, so the light is exact.
#[test]
fn uniform_sky_lights_floor_exactly() {
    let grey = [0.5, 0.25, 0.125];
    let mut source = uneven_grid();
    source.positions.iter_mut().for_each(|p| p.y = 0.0);
    source.sky = Some(Sky::Gradient(SkyGradient::uniform(grey)));
    source.colors = vec![Vec3::new(0.5, 1.0, 1.0); source.positions.len()];
    source.materials[0].emission = [0.1, 0.0, 0.0];
    let Baked {
        scene, exposure, ..
    } = baked(
        &source,
        &BakeOptions {
            samples: 5,
            smoothing: 1,
            ..options(0.5)
        },
    );
    let expected = Vec3::from(grey) * Vec3::new(0.5, 1.0, 1.0) * exposure;
    /// Sums of five equal numbers over five, twice: a few units in the last place.
    const ROUNDING: f32 = 1e-6;
    assert!(
        scene
            .colors
            .iter()
            .all(|c| (*c - expected).abs().max_element() <= ROUNDING * exposure),
        "{:?}",
        scene.colors[0]
    );
    assert_eq!(scene.materials[0].emission, [0.1 * exposure, 0.0, 0.0]);
    assert_eq!(
        scene.sky,
        Some(Sky::Gradient(SkyGradient::uniform(
            grey.map(|c| c * exposure)
        )))
    );
    assert!(scene.sun.is_none());
}

/// Baked colours against the estimator at the same points with many more samples: the mean over the
/// floor.
#[test]
fn baked_colours_equal_estimator() {
    for flipped in [false, true] {
        let source = Arc::new(floor_and_post(flipped));
        let options = BakeOptions {
            edge_m: 0.3,
            samples: 32,
            smoothing: 1,
            bounces: Bounces::Exactly(1),
            ..BakeOptions::default()
        };
        let Baked {
            scene,
            pieces,
            exposure,
            ..
        } = bake(&source, &options, &|_, _| ControlFlow::Continue(()));
        let tracer = Tracer::new(Arc::clone(&source), DVec3::ZERO);
        let lighting = Lighting::measure(&tracer, 1);
        let floor: Vec<u32> = scene.triangles[..pieces[2] as usize]
            .iter()
            .flat_map(|t| t.vertices)
            .collect();
        let (mut got, mut expected) = (Vec3::ZERO, Vec3::ZERO);
        for &vertex in &floor {
            let position = scene.positions[vertex as usize].as_vec3();
            let point = LitPoint {
                position,
                normal: Vec3::Y,
                shading_normal: Vec3::Y,
                extent: 2.0,
            };
            for index in 0..256 {
                let sample = LightSample {
                    stream: vertex,
                    index,
                };
                let light = lighting.radiosity_per_albedo(&tracer, &point, &sample);
                expected += Vec3::from(light) * lighting.exposure / 256.0;
            }
            got += scene.colors[vertex as usize];
        }
        // Light is averaged half way to the neighbours and the foot of the post shifts it slightly:
        // 3 %; the exposures differ only by the rounding of their pilots' origins.
        let error = ((got - expected) / expected).abs().max_element();
        assert!(error < 0.03, "flipped {flipped}: {got} {expected}");
        assert!((exposure / lighting.exposure - 1.0).abs() < 0.01);
        let level = |v: &u32| scene.colors[*v as usize].y;
        let [dark, bright] = [f32::min, f32::max]
            .map(|pick| floor.iter().map(level).reduce(pick).expect("vertices"));
        assert!(
            dark < 0.4 * bright,
            "the post casts a shadow: {dark} {bright}"
        );
    }
}

/// A closed white room with a lamp under its ceiling: much of its light is reflected once.
fn room_with_a_lamp() -> Scene {
    let lamp = Material {
        emission: [4.0; 3],
        ..Material::default()
    };
    let mut scene = Scene {
        materials: vec![Material::default(), lamp],
        ..Scene::default()
    };
    let mut quad = |middle: DVec3, across: DVec3, along: DVec3, material: u32| {
        let first = scene.positions.len() as u32;
        scene.positions.extend(
            [
                -across - along,
                across - along,
                across + along,
                along - across,
            ]
            .map(|at| middle + at),
        );
        let triangles = [[first, first + 1, first + 2], [first, first + 2, first + 3]];
        scene
            .triangles
            .extend(triangles.map(|vertices| Triangle { vertices, material }));
    };
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        let (across, along) = (
            axis.any_orthonormal_vector(),
            axis.cross(axis.any_orthonormal_vector()),
        );
        // Front sides face inward.
        quad(-2.0 * axis, 2.0 * across, 2.0 * along, 0);
        quad(2.0 * axis, 2.0 * along, 2.0 * across, 0);
    }
    quad(dvec3(0.0, 1.2, 0.0), 0.5 * DVec3::Z, 0.5 * DVec3::X, 1);
    let headbox = Headbox {
        centre: DVec3::ZERO,
        half_size_m: 0.2,
    };
    Scene {
        headbox: Some(headbox),
        ..scene
    }
}

/// Reflected light of all bounces equals the estimator's, although paths share it. Without it, or
/// with that of another surface, the floor or the ceiling would be off by a fifth.
#[test]
fn reflected_light_equals_estimator() {
    /// Relative tolerance: the light of a cell represents all of it, with 64 samples per vertex on
    /// a surface of 16 m2.
    const TOLERANCE: f32 = 0.03;
    let source = Arc::new(room_with_a_lamp());
    // Not averaged with neighbours, which would carry light from above the lamp to the ceiling's
    // rim.
    let options = BakeOptions {
        edge_m: 0.4,
        smoothing: 0,
        ..BakeOptions::default()
    };
    let Baked {
        scene, exposure, ..
    } = baked(&source, &options);
    let tracer = Tracer::new(Arc::clone(&source), DVec3::ZERO);
    let lighting = Lighting::measure(&tracer, options.bounces);
    for (y, normal) in [(-2.0, Vec3::Y), (2.0, Vec3::NEG_Y)] {
        // In the middle, away from the corners.
        let of_surface = |(_, p): &(usize, &DVec3)| p.y == y && p.x.abs().max(p.z.abs()) < 1.5;
        let (mut got, mut expected) = (0.0, 0.0);
        for (vertex, place) in scene.positions.iter().enumerate().filter(of_surface) {
            let point = LitPoint {
                position: place.as_vec3(),
                normal,
                shading_normal: normal,
                extent: 2.0,
            };
            for index in 0..512 {
                let sample = LightSample {
                    stream: vertex as u32,
                    index,
                };
                expected += lighting.radiosity_per_albedo(&tracer, &point, &sample)[1] / 512.0;
            }
            got += scene.colors[vertex].y / exposure;
        }
        assert!(
            (got / expected - 1.0).abs() < TOLERANCE,
            "{normal}: {got} for {expected}"
        );
    }
}

/// At the edge of a shadow all samples test the visibility of the sun, elsewhere twelve: light is
/// full or none there.
#[test]
fn edges_of_shadows_take_all_samples() {
    let mut source = floor_and_post(false);
    source.sky = None;
    let options = BakeOptions {
        samples: 64,
        ..options(0.3)
    };
    let Baked { scene, pieces, .. } = baked(&source, &options);
    let floor: Vec<u32> = scene.triangles[..pieces[2] as usize]
        .iter()
        .flat_map(|t| t.vertices)
        .collect();
    let level = |v: &u32| scene.colors[*v as usize].y;
    let full = floor.iter().map(level).fold(0.0, f32::max);
    let shares: Vec<f32> = floor
        .iter()
        .map(|v| level(v) / full)
        .filter(|share| (0.02..0.98).contains(share))
        .collect();
    assert!(shares.len() > 8, "{shares:?}");
    let of_twelve = |share: &&f32| ((*share * 12.0).round() / 12.0 - *share).abs() < 1e-3;
    let coarse = shares.iter().filter(of_twelve).count();
    assert!(
        coarse * 2 < shares.len(),
        "{coarse} of {} are whole twelfths: {shares:?}",
        shares.len()
    );
}

#[test]
fn jamb_in_wall_is_lit_outside_it() {
    // A room of 2 m; its wall at z = 0 extends to z = 0.1 behind it; the side of a jamb, at x = 1,
    // protrudes 1 cm from the wall.
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    let mut quad = |corners: [[f64; 3]; 4]| {
        let first = scene.positions.len() as u32;
        scene
            .positions
            .extend(corners.map(|[x, y, z]| dvec3(x, y, z)));
        let triangle = |vertices| Triangle {
            vertices,
            material: 0,
        };
        scene
            .triangles
            .extend([[0, 1, 2], [0, 2, 3]].map(|v: [u32; 3]| triangle(v.map(|i| first + i))));
    };
    let jamb = [[1.0, -0.01], [1.0, 0.1], [1.05, 0.1], [1.05, -0.01]];
    for (i, [x, z]) in jamb.into_iter().enumerate() {
        let [next_x, next_z] = jamb[(i + 1) % 4];
        quad([
            [x, 0.0, z],
            [next_x, 0.0, next_z],
            [next_x, 2.0, next_z],
            [x, 2.0, z],
        ]);
    }
    // The wall, on the jamb's left; its end lies in the jamb's plane. Then its back.
    quad([
        [-1.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 2.0, 0.0],
        [-1.0, 2.0, 0.0],
    ]);
    quad([
        [-1.0, 0.0, 0.1],
        [1.0, 0.0, 0.1],
        [1.0, 2.0, 0.1],
        [-1.0, 2.0, 0.1],
    ]);
    scene.sky = Some(Sky::Gradient(SkyGradient {
        zenith: [1.0; 3],
        horizon: [1.0; 3],
        ground: [1.0; 3],
    }));
    scene.headbox = Some(Headbox {
        centre: dvec3(0.0, 1.0, -1.0),
        half_size_m: 0.4,
    });
    // The room extends into the doorway with the jamb.
    let prism = |[x0, x1]: [f64; 2], [z0, z1]: [f64; 2]| {
        let outline = [[x0, z0], [x1, z0], [x1, z1], [x0, z1]]
            .map(|[x, z]| DVec2::new(x, z))
            .to_vec();
        Prism {
            outline,
            floor_y: 0.0,
            ceiling_y: 2.0,
        }
    };
    let space = vec![
        prism([-1.0, 3.0], [-2.0, 0.0]),
        prism([1.0, 2.0], [0.0, 0.1]),
    ];
    let cell = Cell {
        name: String::new(),
        space,
        triangles: 0..12,
    };
    let model = PortalModel {
        scene,
        cells: vec![cell],
        portals: Vec::new(),
        outside: None,
    };
    let options = BakeOptions {
        samples: 64,
        ..options(10.0)
    };
    let (baked, _) = bake_model(model, &options, &|_, _| ControlFlow::Continue(()));
    let brightest = |x: f64, z: f64| {
        let at =
            |(place, color): (&DVec3, &Vec3)| (place.x == x && place.z == z).then_some(color.x);
        baked
            .scene
            .positions
            .iter()
            .zip(&baked.scene.colors)
            .filter_map(at)
            .fold(0.0, f32::max)
    };
    let dimmest = |x: f64, z: f64| {
        let at =
            |(place, color): (&DVec3, &Vec3)| (place.x == x && place.z == z).then_some(color.x);
        baked
            .scene
            .positions
            .iter()
            .zip(&baked.scene.colors)
            .filter_map(at)
            .fold(f32::INFINITY, f32::min)
    };
    // The wall sees half of the sky, and the jamb, beside it, half of that: its dimmer vertices
    // there are those of its side.
    let (wall, out) = (brightest(-1.0, 0.0), dimmest(1.0, -0.01));
    assert!(out > 0.35 * wall, "{out} before the wall, which has {wall}");
}
