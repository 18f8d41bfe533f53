//! Guided light: means are kept, variance falls, and cells without a gain are not guided.

use super::*;
use crate::light::path::LAST_GUIDED_BOUNCE;
use crate::light::tests::{add_quad, lit_point};
use glam::{DVec3, dvec3};
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Sky, SkyGradient, SkyPicture, Triangle};
use std::sync::Arc;

fn white_sky() -> Sky {
    Sky::Gradient(SkyGradient::uniform([5.0; 3]))
}

/// Returns a room of 4 m around the origin, closed except for a window of 0.8 m in a corner of
/// its ceiling; its second material is a lamp's.
fn room(sky: Sky) -> Scene {
    let lamp = Material {
        emission: [2.0; 3],
        ..Material::default()
    };
    let materials = vec![
        Material {
            albedo: [0.6; 3],
            ..Material::default()
        },
        lamp,
    ];
    let mut scene = Scene {
        materials,
        sky: Some(sky),
        ..Scene::default()
    };
    let mut quad = |corners: [DVec3; 4]| add_quad(&mut scene, corners, 0);
    let at = |x: f64, y: f64, z: f64| dvec3(x, y, z) * 2.0;
    quad([
        at(-1.0, -1.0, -1.0),
        at(1.0, -1.0, -1.0),
        at(1.0, -1.0, 1.0),
        at(-1.0, -1.0, 1.0),
    ]);
    for [[x0, z0], [x1, z1]] in [
        [[-1, -1], [1, -1]],
        [[1, -1], [1, 1]],
        [[1, 1], [-1, 1]],
        [[-1, 1], [-1, -1]],
    ] {
        let [x0, z0, x1, z1] = [x0, z0, x1, z1].map(f64::from);
        quad([
            at(x0, -1.0, z0),
            at(x1, -1.0, z1),
            at(x1, 1.0, z1),
            at(x0, 1.0, z0),
        ]);
    }
    for [x0, z0, x1, z1] in [
        [-1.0, -1.0, 1.0, 0.5],
        [-1.0, 0.5, 0.5, 1.0],
        [0.5, 0.9, 1.0, 1.0],
        [0.9, 0.5, 1.0, 0.9],
    ] {
        quad([
            at(x0, 1.0, z0),
            at(x1, 1.0, z0),
            at(x1, 1.0, z1),
            at(x0, 1.0, z1),
        ]);
    }
    scene
}

fn tracer(scene: Scene) -> Tracer {
    Tracer::new(Arc::new(scene), DVec3::ZERO)
}

const SAMPLES: u32 = 1 << 18;

/// Returns mean and variance of samples at a point on the floor.
fn floor_light(lighting: &Lighting, tracer: &Tracer) -> (f64, f64) {
    let point = lit_point(Vec3::new(-0.5, -2.0, -0.7), Vec3::Y, 2.0);
    let mut moments = Moments::default();
    for index in 0..SAMPLES {
        let sample = LightSample { stream: 77, index };
        moments.add(lighting.soft_radiosity(tracer, &point, &sample).x);
    }
    (moments.mean(), moments.variance())
}

/// Returns the variances of samples at the floor without and with guiding; checks that the
/// means agree.
fn variances(tracer: &Tracer, bounces: u32) -> [f64; 2] {
    let lighting = Lighting::unmetered(tracer, bounces);
    let (mean, variance) = floor_light(&lighting, tracer);
    let (guided_mean, guided_variance) = floor_light(&lighting.guided(tracer), tracer);
    // Two standard errors of independent samples; stratified samples have a smaller error.
    let tolerance = 2.0 * (variance / f64::from(SAMPLES)).sqrt();
    assert!(
        (guided_mean - mean).abs() < tolerance,
        "{bounces}: {guided_mean}, not {mean} +- {tolerance}"
    );
    [variance, guided_variance]
}

#[test]
fn guiding_keeps_mean_and_reduces_variance() {
    // Bounced light comes from all over the room.
    for (bounces, most) in [(0, 0.4), (2, 0.6)] {
        let [variance, guided] = variances(&tracer(room(white_sky())), bounces);
        assert!(
            guided < most * variance,
            "{bounces}: {guided}, without {variance}"
        );
    }
}

#[test]
fn later_bounces_are_not_guided() {
    let tracer = tracer(room(white_sky()));
    let mut lighting = Lighting::unmetered(&tracer, Bounces::Full).guided(&tracer);
    let floor = lit_point(Vec3::new(-0.5, -2.0, -0.7), Vec3::Y, 2.0);
    let mut is_guided = false;
    for index in 0..4096 {
        let [short, long] = [LAST_GUIDED_BOUNCE + 1, 20].map(|bounces| {
            lighting.bounces = Bounces::Exactly(bounces);
            let mut path = Path::new(&floor);
            lighting.follow(&tracer, &mut path, 0, &LightSample { stream: 7, index });
            path.weight
        });
        is_guided |= short != 1.0;
        assert_eq!(short, long, "path {index}");
    }
    assert!(is_guided);
}

#[test]
fn guiding_keeps_mean_with_lamps_and_sky_image() {
    for bounces in [0, 1] {
        let texels = (0..32 * 16)
            .map(|i| [if i % 7 == 0 { 20.0 } else { 3.0 }; 3])
            .collect();
        let mut scene = room(Sky::Picture(Arc::new(
            SkyPicture::new([32, 16], texels, 0.0).expect("a sky"),
        )));
        let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| axis * 0.6);
        add_quad(&mut scene, [x + y, x + z, -x + z, -x + y], 1);
        let tracer = tracer(scene);
        let [variance, guided] = variances(&tracer, bounces);
        assert!(guided < variance, "{bounces}: {guided}, without {variance}");
        let lighting = Lighting::unmetered(&tracer, bounces).guided(&tracer);
        assert!(!lighting.guide.cells.is_empty());
    }
}

#[test]
fn guide_is_independent_of_thread_count() {
    let tracer = tracer(room(white_sky()));
    let guide = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| Lighting::unmetered(&tracer, 1).guided(&tracer).guide)
    };
    let one = guide(1);
    let three = guide(3);
    assert!(!one.cells.is_empty() && one == three);
}

#[test]
fn few_gaining_cells_are_not_worthwhile() {
    let visible = |visibility: f64| {
        move |points: usize, variance: f64, saved: f64| {
            let estimate = CellEstimate {
                variance,
                visibility,
                saved,
                density: None,
            };
            (points, estimate)
        }
    };
    let cells = visible(1.0);
    assert!(
        is_worthwhile([cells(6, 4.0, 2.0), cells(4, 4.0, 0.0)].into_iter()),
        "12 of 40"
    );
    assert!(
        !is_worthwhile([cells(4, 4.0, 2.0), cells(6, 4.0, 0.0)].into_iter()),
        "8 of 40"
    );
    // Most cells gain, but not those that are noisy.
    assert!(!is_worthwhile(
        [cells(8, 4.0, 2.0), cells(2, 40.0, 0.0)].into_iter()
    ));
    // Noise is invisible where light is bright.
    assert!(is_worthwhile(
        [cells(8, 4.0, 2.0), visible(0.01)(2, 40.0, 0.0)].into_iter()
    ));
    assert!(!is_worthwhile(std::iter::empty()));
}

#[test]
fn noise_is_less_visible_in_bright_areas() {
    let visible_variance = |light: f64| {
        let mut statistics = CellStatistics::default();
        for level in [0.5 * light, 1.5 * light] {
            statistics.by_rays.add(level as f32);
        }
        let estimate = statistics.estimate();
        estimate.variance * estimate.visibility
    };
    assert!(
        visible_variance(0.9) < 9.1 * visible_variance(0.3)
            && visible_variance(0.3) > visible_variance(0.1),
        "grows less than the square of the light"
    );
    assert!(
        visible_variance(2.0) < visible_variance(0.9) && visible_variance(0.0) == 0.0,
        "noise above white is hardly visible"
    );
}

#[test]
fn uniform_light_trains_no_guide() {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    scene.sky = Some(white_sky());
    scene.positions = vec![
        dvec3(-9.0, -1.0, -9.0),
        dvec3(9.0, -1.0, -9.0),
        dvec3(0.0, -1.0, 9.0),
    ];
    scene.triangles = vec![Triangle {
        vertices: [0, 1, 2],
        material: 0,
    }];
    for tracer in [tracer(scene), tracer(Scene::default())] {
        let lighting = Lighting::unmetered(&tracer, 1).guided(&tracer);
        assert!(lighting.guide.cells.is_empty());
    }
}
