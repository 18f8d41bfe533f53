//! Consistency of light samples: split and whole, single and in packets.

use super::*;
use glam::{DVec3, dvec3};
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle};
use std::sync::Arc;

/// Returns random triangles, some of them lamps, under sun and sky.
pub(crate) fn random_triangles() -> Tracer {
    let material = |emission: f32| Material {
        emission: [emission; 3],
        ..Material::default()
    };
    let mut scene = Scene {
        materials: vec![material(0.0), material(5.0)],
        sun: Some(Sun::default()),
        sky: Some(Sky::default()),
        ..Scene::default()
    };
    for i in 0..300 {
        let random = |k: u32| random4([i, k, 7, 7]).map(|r| f64::from(unit_float(r)) - 0.5);
        let [x, y, z, _] = random(0);
        let [a, b, c, d] = random(1);
        let corner = dvec3(x, y, z) * 6.0;
        let first = scene.positions.len() as u32;
        scene
            .positions
            .extend([corner, corner + dvec3(a, b, c), corner + dvec3(d, a, b)]);
        let vertices = [first, first + 1, first + 2];
        scene.triangles.push(Triangle {
            vertices,
            material: u32::from(i % 20 == 0),
        });
    }
    Tracer::new(Arc::new(scene), DVec3::ZERO)
}

/// Returns a point with a flat normal.
pub(super) fn lit_point(position: Vec3, normal: Vec3, extent: f32) -> LitPoint {
    LitPoint {
        position,
        normal,
        shading_normal: normal,
        extent,
    }
}

/// Appends the two triangles of a quad.
pub(super) fn add_quad(scene: &mut Scene, corners: [DVec3; 4], material: u32) {
    let first = scene.positions.len() as u32;
    scene.positions.extend(corners);
    for vertices in [[0, 1, 2], [0, 2, 3]] {
        scene.triangles.push(Triangle {
            vertices: vertices.map(|v| first + v),
            material,
        });
    }
}

fn requests(tracer: &Tracer) -> Vec<(LitPoint, LightSample)> {
    let ray = |i: u32| {
        let direction =
            Vec3::from_array([0, 1, 2].map(|k| unit_float(random4([i, k, 1, 1])[0]) - 0.5));
        Ray::new(Vec3::ZERO, direction)
    };
    let hit = |ray: Ray| {
        tracer
            .closest(&ray)
            .map(|hit| LitPoint::from_hit(tracer, &ray, &hit).0)
    };
    let points = (0..1000).filter_map(|i| hit(ray(i)));
    points
        .zip(0..)
        .map(|(point, index)| (point, LightSample { stream: 7, index }))
        .collect()
}

#[test]
fn split_sample_sums_to_whole() {
    let tracer = random_triangles();
    for bounces in [0, 1, 5] {
        let lighting = Lighting::unmetered(&tracer, bounces).guided(&tracer);
        let mut arrived = 0;
        for (point, sample) in requests(&tracer) {
            let whole = lighting.soft_radiosity(&tracer, &point, &sample);
            let FirstSegment {
                light: before,
                arrival,
                ..
            } = lighting.first_segment(&tracer, &point, &sample);
            let beyond = arrival.map_or(Vec3::ZERO, |a| {
                a.contribution(lighting.beyond(&tracer, &a, &sample))
            });
            arrived += u32::from(arrival.is_some());
            assert!(
                (before + beyond - whole).length() <= 1e-5 * whole.length(),
                "{before} + {beyond}: {whole}"
            );
        }
        // Arrivals are required without bounces too: their distances limit the pooling of light.
        assert!(arrived > 100, "{arrived}");
    }
}

/// Adds a box of 2 m about `centre` whose ceiling is of a glowing material.
fn add_glowing_room(scene: &mut Scene, centre: DVec3, material: u32) {
    for (axis, sign) in [
        (0, -1.0),
        (0, 1.0),
        (1, -1.0),
        (1, 1.0),
        (2, -1.0),
        (2, 1.0),
    ] {
        let normal = DVec3::AXES[axis] * sign;
        let [u, v] = [DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]];
        let corner = |a: f64, b: f64| centre + normal + u * a + v * b;
        let corners = [
            corner(-1.0, -1.0),
            corner(1.0, -1.0),
            corner(1.0, 1.0),
            corner(-1.0, 1.0),
        ];
        let is_ceiling = axis == 1 && sign > 0.0;
        add_quad(scene, corners, if is_ceiling { material } else { 0 });
    }
}

#[test]
fn exposure_is_metered_where_the_headbox_stands() {
    let glow = |emission: f32| Material {
        emission: [emission; 3],
        ..Material::default()
    };
    let mut scene = Scene {
        materials: vec![Material::default(), glow(1.0), glow(16.0)],
        ..Scene::default()
    };
    let rooms = [DVec3::ZERO, dvec3(10.0, 0.0, 0.0)];
    add_glowing_room(&mut scene, rooms[0], 1);
    add_glowing_room(&mut scene, rooms[1], 2);
    let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
    let [dim, bright] = rooms.map(|room| Lighting::measure_at(&tracer, room, 1).exposure);
    // All light is 16 times as strong; few light samples leave some noise.
    assert!((dim / bright / 16.0 - 1.0).abs() < 0.1, "{dim}, {bright}");
    // A metered frame has middle grey as its logarithmic mean: the glowing ceiling is above, the
    // rest below it.
    assert!(dim > 0.21 && dim < 2.1, "{dim}");
}

#[test]
fn unlit_exposure_is_specified_stops() {
    let exposure = |lit: bool, specified: &str| {
        let scene = Scene {
            exposure: specified.parse().expect("an exposure"),
            ..Scene::clone(random_triangles().scene())
        };
        let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
        Lighting::prepare(&tracer, DVec3::ZERO, 0, lit).exposure
    };
    assert_eq!(
        [
            exposure(false, "auto"),
            exposure(false, "auto+1"),
            exposure(false, "-2")
        ],
        [1.0, 2.0, 0.25]
    );
    // The metered exposure of this scene differs from 1.
    assert!(
        (exposure(true, "auto") - 1.0).abs() > 0.1,
        "{}",
        exposure(true, "auto")
    );
}

#[test]
fn only_lit_scenes_have_compressed_highlights() {
    let tone = |lit: bool, specified: ToneMap| {
        let scene = Scene {
            tone: specified,
            ..Scene::clone(random_triangles().scene())
        };
        let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
        Lighting::prepare(&tracer, DVec3::ZERO, 0, lit).tone
    };
    assert_eq!(tone(false, ToneMap::Neutral), ToneMap::SrgbClipped);
    assert_eq!(tone(true, ToneMap::Neutral), ToneMap::Neutral);
    assert_eq!(
        tone(false, ToneMap::SrgbCompressed),
        ToneMap::SrgbCompressed
    );
}

#[test]
fn packet_sunlight_matches_single_rays() {
    let tracer = random_triangles();
    let lighting = Lighting::unmetered(&tracer, 0);
    let requests = requests(&tracer);
    let light = lighting.sharp_radiosities(&tracer, &requests);
    let single = |(point, sample): &(LitPoint, LightSample)| {
        lighting.sharp_radiosity(&tracer, point, sample)
    };
    assert_eq!(light, requests.iter().map(single).collect::<Vec<_>>());
    assert!(light.contains(&Vec3::ZERO) && light.iter().any(|l| *l != Vec3::ZERO));
}

/// Mean of samples of soft light at the origin on a floor with a shading normal, and of their
/// gradients, in `direction`.
fn light_and_gradient(
    tracer: &Tracer,
    lighting: &Lighting,
    shading_normal: Vec3,
    direction: Vec3,
) -> [f64; 2] {
    const SAMPLES: u32 = 1 << 15;
    let point = LitPoint {
        shading_normal,
        ..lit_point(Vec3::ZERO, Vec3::Y, 4.0)
    };
    let mut sums = [0.0; 2];
    for index in 0..SAMPLES {
        let sample = LightSample { stream: 3, index };
        let first = lighting.first_segment(tracer, &point, &sample);
        let mut light = first.light;
        let mut gradient = first.gradient;
        if let Some(arrival) = first.arrival {
            let bounced = arrival.contribution(lighting.beyond(tracer, &arrival, &sample));
            light += bounced;
            gradient += point.normal_gradient(bounced, arrival.position().normalize());
        }
        sums[0] += f64::from(luminance(light.to_array()));
        sums[1] += f64::from(gradient.dot(direction));
    }
    sums.map(|sum| sum / f64::from(SAMPLES))
}

#[test]
fn normal_gradient_is_the_change_of_light_by_the_normal() {
    // A lamp to the right, a sunlit wall to the left, and a sky half behind a wall, each alone.
    let upright = |x: f64, low: f64| {
        let high = low + 2.0;
        [(-1.0, low), (1.0, low), (1.0, high), (-1.0, high)].map(|(z, y)| dvec3(x, y, z))
    };
    let material = |emission: f32| Material {
        emission: [emission; 3],
        ..Material::default()
    };
    // Light from less than 14 degrees above the horizon, that of the sky, counts too little.
    for (source, tolerance) in [("lamp", 0.03), ("wall", 0.03), ("sky", 0.2)] {
        let mut scene = Scene {
            materials: vec![material(0.0), material(4.0)],
            ..Scene::default()
        };
        match source {
            "lamp" => add_quad(&mut scene, upright(2.0, 1.0), 1),
            "wall" => {
                add_quad(&mut scene, upright(-2.0, 1.0), 0);
                scene.sun = Some(Sun {
                    direction: Vec3::new(0.8, 0.6, 0.0),
                    ..Sun::default()
                });
            }
            _ => {
                add_quad(&mut scene, upright(1.0, 0.0), 0);
                scene.sky = Some(Sky::default());
            }
        }
        let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
        let lighting = Lighting::unmetered(&tracer, 1);
        let normal = |angle: f32| Vec3::new(angle.sin(), angle.cos(), 0.0);
        const STEP: f32 = 0.1;
        let at = |angle| light_and_gradient(&tracer, &lighting, normal(angle), Vec3::X);
        // With the shading normal exactly that of the surface there is no gradient.
        let [light, gradient] = at(1e-4);
        let [less, more] = [-STEP, STEP].map(|angle| at(angle)[0]);
        let expected = (more - less) / f64::from(2.0 * STEP.sin());
        assert!(
            expected.abs() > 0.2 * light,
            "{source}: {expected} of {light}"
        );
        assert!(
            (gradient / expected - 1.0).abs() < tolerance,
            "{source}: {gradient}, not {expected}"
        );
        assert_eq!(at(0.0)[1], 0.0, "{source}: flat shading");
    }
}
