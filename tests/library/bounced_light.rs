//! Full light: truth and captures have all bounces, and the cache of bounced light that captures
//! use loses none.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use glam::{DVec3, Vec3};
use headbox_core::bounces::Bounces;
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle};
use headbox_trace::bvh::{Ray, Tracer};
use headbox_trace::light::{LightSample, Lighting, LitPoint};
use std::sync::Arc;

/// Albedo of the furnace.
const ALBEDO: f32 = 0.8;

/// Radiance in a closed room whose walls emit 1: the sum of all powers of the albedo. With one
/// bounce it would be 1.8.
const RADIANCE: f32 = 1.0 / (1.0 - ALBEDO);

/// Maximum relative error of a mean of [`SAMPLES`] samples with a standard deviation of at most 3
/// (four standard errors are 0.02), and of paths from a few thousand cells.
const TOLERANCE: f32 = 0.025;

const SAMPLES: u32 = 1 << 14;

/// Returns a closed room of 2 m about the origin, of one material.
fn closed_room(material: Material) -> Tracer {
    let mut scene = Scene {
        materials: vec![material],
        ..Scene::default()
    };
    for axis in 0..3 {
        let [u, v] = [DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]];
        for normal in [DVec3::AXES[axis], -DVec3::AXES[axis]] {
            let first = scene.positions.len() as u32;
            let corners = [-u - v, u - v, u + v, v - u].map(|corner| normal + corner);
            scene.positions.extend(corners);
            for vertices in [[0, 1, 2], [0, 2, 3]] {
                scene.triangles.push(Triangle {
                    vertices: vertices.map(|corner| first + corner),
                    material: 0,
                });
            }
        }
    }
    Tracer::new(Arc::new(scene), DVec3::ZERO)
}

fn furnace() -> (Tracer, Lighting) {
    let tracer = closed_room(Material {
        albedo: [ALBEDO; 3],
        emission: [1.0; 3],
        ..Material::default()
    });
    let mut lighting = Lighting::unmetered(&tracer, Bounces::Full);
    lighting.exposure = 1e3; // light far above white is not limited
    (tracer, lighting)
}

/// Returns a point of the floor.
fn floor_point(tracer: &Tracer) -> LitPoint {
    let ray = Ray::new(Vec3::ZERO, Vec3::new(0.3, -1.0, 0.1));
    LitPoint::from_hit(tracer, &ray, &tracer.closest(&ray).unwrap()).0
}

/// Returns the mean of light samples at the floor, as captures take them.
fn captured_light(tracer: &Tracer, lighting: &Lighting) -> f32 {
    let point = floor_point(tracer);
    mean(|sample| lighting.cached_radiosity(tracer, &point, sample).x)
}

fn mean(light: impl Fn(&LightSample) -> f32) -> f32 {
    let light = |index| f64::from(light(&LightSample { stream: 7, index }));
    ((0..SAMPLES).map(light).sum::<f64>() / f64::from(SAMPLES)) as f32
}

fn assert_is_radiance(light: f32) {
    assert!(
        (light / RADIANCE - 1.0).abs() < TOLERANCE,
        "{light} for {RADIANCE}"
    );
}

#[test]
fn truth_of_furnace_has_all_bounces() {
    let (tracer, lighting) = furnace();
    let point = floor_point(&tracer);
    let light = |sample: &LightSample| lighting.radiosity_per_albedo(&tracer, &point, sample)[0];
    assert_is_radiance(mean(light));
}

#[test]
fn capture_of_furnace_has_all_bounces() {
    let (tracer, lighting) = furnace();
    let cached = lighting.clone().with_cached_bounces(&tracer);
    assert_ne!(cached, lighting, "no cell is cached");
    assert_is_radiance(captured_light(&tracer, &cached));
}

#[test]
fn paths_continue_where_no_cell_is() {
    let (tracer, mut lighting) = furnace();
    let ceiling = |i: u32| {
        let [x, z] = [i % 64, i / 64].map(|c| (c as f32 + 0.5) / 32.0 - 1.0);
        LitPoint {
            position: Vec3::new(x, 1.0, z),
            normal: Vec3::NEG_Y,
            shading_normal: Vec3::NEG_Y,
            extent: 1.0,
        }
    };
    let points: Vec<LitPoint> = (0..64 * 64).map(ceiling).collect();
    let uncached = lighting.clone();
    lighting.cache_bounces(&tracer, &points, 1.0 / 16.0);
    assert_ne!(lighting, uncached, "no cell is cached");
    assert_is_radiance(captured_light(&tracer, &lighting));
}

#[test]
fn cache_is_independent_of_thread_count() {
    let (tracer, lighting) = furnace();
    let cached = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new();
        let pool = pool.num_threads(threads).build().unwrap();
        pool.install(|| lighting.clone().with_cached_bounces(&tracer))
    };
    assert_eq!(cached(1), cached(3));
}

#[test]
fn limited_bounces_are_not_cached() {
    let (tracer, _) = furnace();
    let lighting = Lighting::unmetered(&tracer, 1);
    assert_eq!(lighting.clone().with_cached_bounces(&tracer), lighting);
}
