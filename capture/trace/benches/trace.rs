//! Ray rates of the tracer on one thread, by criterion: `cargo bench -p headbox-trace --bench
//! trace`.
//!
//! The scene is 500,000 triangles of bumpy ground in a closed room. The rays are an evenly spaced
//! subset of those of one cube face at N = 32, M = 16, stratum by stratum; bounce rays leave their
//! hits in scattered directions, and shadow rays go from the hits toward one light. Generating rays
//! is not timed, loading them into packets is. `examples/rays` compares with other tracers on
//! scenes from files.

#[path = "../examples/rays/cube.rs"]
mod cube;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use cube::{Rays, cube_rays, load_packet, load_ray};
use glam::{DVec3, Vec3, dvec3};
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle};
use headbox_trace::bvh::{HitPacket, PACKET, Ray, RayPacket, Tracer};
use std::hint::black_box;
use std::sync::Arc;

/// Number of quads along each side of the ground.
const SIDE: u32 = 500;

/// Step between the traced groups of strata; there are 1,024 groups that share two coordinates.
const PART: usize = 64;

/// Returns a bumpy ground of 20 m by 20 m and a room around it.
fn scene() -> Scene {
    let height = |x: f64, z: f64| {
        0.5 * (0.9 * x).sin() * (0.7 * z).cos() + 0.02 * (53.0 * x).sin() * (47.0 * z).sin()
    };
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    let mut add = |positions: Vec<DVec3>, triangles: Vec<[u32; 3]>| {
        let base = scene.positions.len() as u32;
        scene.positions.extend(positions);
        let shifted = triangles.into_iter().map(|t| Triangle {
            vertices: t.map(|i| i + base),
            material: 0,
        });
        scene.triangles.extend(shifted);
    };
    let line = SIDE + 1;
    let coordinate = |i: u32| -10.0 + 20.0 * f64::from(i) / f64::from(SIDE);
    let ground = (0..line * line)
        .map(|k| (coordinate(k % line), coordinate(k / line)))
        .map(|(x, z)| dvec3(x, height(x, z), z));
    let quad = |i: u32| [[i, i + 1, i + line + 1], [i, i + line + 1, i + line]];
    add(
        ground.collect(),
        (0..SIDE * SIDE)
            .flat_map(|k| quad(k / SIDE * line + k % SIDE))
            .collect(),
    );
    let corner = |k: u32, axis: u32| if k >> axis & 1 == 0 { -1.0 } else { 1.0 };
    let room = (0..8).map(|k| {
        dvec3(
            10.0 * corner(k, 0),
            4.0 * corner(k, 1) + 3.0,
            10.0 * corner(k, 2),
        )
    });
    let walls = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    add(
        room.collect(),
        walls
            .into_iter()
            .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]])
            .collect(),
    );
    scene
}

/// Returns an evenly spaced subset of one face's rays.
fn stratified() -> Rays {
    let group = 32 * 32 * 16;
    let rays = cube_rays(dvec3(0.0, 1.7, 0.0), 0.5, 32, 16, "0");
    rays.map(|row| row.chunks(group).step_by(PART).flatten().copied().collect())
}

/// Returns rays from points slightly above the hits of `rays`: toward a light, and in scattered
/// directions.
fn secondary(tracer: &Tracer, rays: &Rays) -> (Vec<Ray>, Vec<Ray>) {
    let light = Vec3::new(2.0, 6.5, -3.0);
    (0..rays[0].len())
        .filter_map(|i| {
            let ray = load_ray(rays, i);
            let origin = ray.origin + ray.direction * (tracer.closest(&ray)?.t * 0.999);
            // A golden-angle spiral over the sphere: neighbouring rays diverge.
            let angle = i as f32 * 2.399_963;
            let z = 1.0 - (i % 997) as f32 / 498.5;
            let scattered = Vec3::new(angle.cos(), angle.sin(), 0.0)
                * (1.0 - z * z).max(0.0).sqrt()
                + Vec3::Z * z;
            let shadow = Ray {
                origin,
                direction: light - origin,
                t_min: 0.0,
                t_max: 1.0,
            };
            let bounce = Ray::new(origin, scattered);
            Some((shadow, bounce))
        })
        .unzip()
}

fn rates(criterion: &mut Criterion) {
    let scene = Arc::new(scene());
    let tracer = Tracer::new(scene.clone(), DVec3::ZERO);
    let rays = stratified();
    let (shadow, bounce) = secondary(&tracer, &rays);
    let mut group = criterion.benchmark_group("trace");
    group
        .sample_size(20)
        .throughput(Throughput::Elements(rays[0].len() as u64));

    group.bench_function("stratified, packets", |bencher| {
        let mut packets = vec![RayPacket::EMPTY; 64];
        let mut hits = vec![HitPacket::MISS; packets.len()];
        bencher.iter(|| {
            for start in (0..rays[0].len()).step_by(PACKET * packets.len()) {
                for (k, packet) in packets.iter_mut().enumerate() {
                    *packet = load_packet(&rays, (start + k * PACKET).min(rays[0].len()));
                }
                tracer.closest_packets(&packets, &mut hits);
                black_box(&hits);
            }
        });
    });
    group.bench_function("stratified, single rays", |bencher| {
        bencher.iter(|| {
            (0..rays[0].len())
                .filter(|&i| tracer.closest(&load_ray(&rays, i)).is_some())
                .count()
        });
    });
    group.bench_function("bounce, single rays", |bencher| {
        bencher.iter(|| {
            bounce
                .iter()
                .filter(|ray| tracer.closest(ray).is_some())
                .count()
        });
    });
    group.bench_function("shadow, single rays", |bencher| {
        bencher.iter(|| shadow.iter().filter(|ray| tracer.occluded(ray)).count());
    });
    group.bench_function("shadow, packets", |bencher| {
        bencher.iter(|| {
            let packets = shadow.chunks(PACKET).map(RayPacket::from_rays);
            packets
                .map(|packet| tracer.occluded_packet(&packet).count_ones())
                .sum::<u32>()
        });
    });
    group.finish();

    let mut group = criterion.benchmark_group("build");
    group
        .sample_size(10)
        .throughput(Throughput::Elements(scene.triangles.len() as u64));
    group.bench_function("tree", |bencher| {
        bencher.iter(|| Tracer::new(scene.clone(), DVec3::ZERO));
    });
    group.finish();
}

criterion_group!(benches, rates);
criterion_main!(benches);
