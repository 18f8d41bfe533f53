//! Bakes of light: triangles are subdivided without cracks; threads, limits and cancellation.

use glam::{DVec3, Vec2, Vec3, dvec3};
use headbox_core::bounces::Bounces;
use headbox_core::headbox::Headbox;
use headbox_model::bake::{BakeOptions, Baked, bake, bake_model};
use headbox_model::{Cell, PortalModel};
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Sky, Sun, Triangle};
use std::collections::HashSet;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A grid of vertices of triangles of very different sizes, so that long and short edges meet.
pub(super) fn uneven_grid() -> Scene {
    let lines = [0.0, 0.03, 0.1, 0.5, 2.0];
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    for (z, x) in lines
        .iter()
        .flat_map(|z| lines.iter().map(move |x| (*z, *x)))
    {
        scene
            .positions
            .push(dvec3(x, 0.2 * (x * 3.0_f64).sin() * z, z));
        scene.texcoords.push(Vec2::new(x as f32, z as f32));
    }
    for (row, column) in (0..4_u32).flat_map(|row| (0..4_u32).map(move |column| (row, column))) {
        let a = row * 5 + column;
        scene.triangles.extend(
            [[a, a + 5, a + 6], [a, a + 6, a + 1]].map(|vertices| Triangle {
                vertices,
                material: 0,
            }),
        );
    }
    scene
}

/// A floor and a post that shades it.
pub(super) fn floor_and_post(flipped: bool) -> Scene {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    let mut quad = |corners: [DVec3; 4]| {
        let first = scene.positions.len() as u32;
        scene.positions.extend(corners);
        for corners in [[0, 1, 2], [0, 2, 3]] {
            let [a, b, c] = corners.map(|c: u32| first + c);
            scene.triangles.push(Triangle {
                vertices: if flipped { [a, c, b] } else { [a, b, c] },
                material: 0,
            });
        }
    };
    quad([
        dvec3(-2.0, 0.0, 2.0),
        dvec3(2.0, 0.0, 2.0),
        dvec3(2.0, 0.0, -2.0),
        dvec3(-2.0, 0.0, -2.0),
    ]);
    quad([
        dvec3(-0.5, 0.0, 0.0),
        dvec3(0.5, 0.0, 0.0),
        dvec3(0.5, 1.5, 0.0),
        dvec3(-0.5, 1.5, 0.0),
    ]);
    let sun = Sun {
        direction: Vec3::new(0.3, 0.8, 0.5).normalize(),
        ..Sun::default()
    };
    let headbox = Headbox {
        centre: dvec3(0.0, 1.0, 1.5),
        half_size_m: 0.2,
    };
    Scene {
        sun: Some(sun),
        sky: Some(Sky::default()),
        headbox: Some(headbox),
        ..scene
    }
}

pub(super) fn options(edge_m: f64) -> BakeOptions {
    BakeOptions {
        edge_m,
        samples: 1,
        smoothing: 0,
        bounces: Bounces::Exactly(0),
        ..BakeOptions::default()
    }
}

pub(super) fn baked(scene: &Scene, options: &BakeOptions) -> Baked {
    bake(&Arc::new(scene.clone()), options, &|_, _| {
        ControlFlow::Continue(())
    })
}

fn area(scene: &Scene, triangles: std::ops::Range<u32>) -> f64 {
    triangles
        .map(|t| scene.corners(t))
        .map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0)
        .sum()
}

#[test]
fn no_edge_stays_long_and_no_crack_opens() {
    let source = uneven_grid();
    let scene = baked(&source, &options(0.15)).scene;
    assert_eq!(scene.validate(), Ok(()));
    let bits = |v: u32| scene.positions[v as usize].to_array().map(f64::to_bits);
    let edges = |t: &Triangle| [0, 1, 2].map(|i| [t.vertices[i], t.vertices[(i + 1) % 3]]);
    // Compared by position, since a crease has a vertex for each side.
    let all: HashSet<[[u64; 3]; 2]> = scene
        .triangles
        .iter()
        .flat_map(edges)
        .map(|e| e.map(bits))
        .collect();
    let mut border = 0;
    for edge in scene.triangles.iter().flat_map(edges) {
        let [a, b] = edge.map(|v| scene.positions[v as usize]);
        assert!(a.distance(b) <= 0.15, "{a} {b}");
        let [p, q] = edge.map(bits);
        if !all.contains(&[q, p]) {
            border += 1;
            let at_rim =
                |f: fn(DVec3) -> f64| [0.0, 2.0].iter().any(|rim| f(a) == *rim && f(b) == *rim);
            assert!(
                at_rim(|p| p.x) || at_rim(|p| p.z),
                "a crack between {a} and {b}"
            );
        }
    }
    assert!(border > 4 * 13, "{border} edges around a square of 2 m");
}

#[test]
fn pieces_cover_their_triangles() {
    let source = uneven_grid();
    let Baked {
        scene,
        pieces,
        edge_m,
        ..
    } = baked(&source, &options(0.3));
    assert_eq!(edge_m, 0.3);
    assert_eq!(pieces.len(), source.triangles.len() + 1);
    assert_eq!(
        *pieces.last().expect("not empty") as usize,
        scene.triangles.len()
    );
    for (triangle, run) in (0_u32..).zip(pieces.windows(2)) {
        let (whole, parts) = (
            area(&source, triangle..triangle + 1),
            area(&scene, run[0]..run[1]),
        );
        assert!(
            (whole - parts).abs() <= 1e-12 * whole.max(1.0),
            "{whole} {parts}"
        );
    }
}

#[test]
fn triangle_limit_lengthens_edges() {
    let source = uneven_grid();
    let limit = BakeOptions {
        max_triangles: 200,
        ..options(0.05)
    };
    let Baked { scene, edge_m, .. } = baked(&source, &limit);
    assert!(
        scene.triangles.len() <= 200 && scene.triangles.len() > 32 && edge_m > 0.05,
        "{} {edge_m}",
        scene.triangles.len()
    );
    for nonsense in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(
            baked(&source, &options(nonsense)).scene.triangles.len(),
            source.triangles.len(),
            "{nonsense}"
        );
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let source = floor_and_post(false);
    let options = BakeOptions {
        edge_m: 0.4,
        samples: 4,
        ..BakeOptions::default()
    };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| baked(&source, &options).scene)
    };
    let (one, three) = (on(1), on(3));
    assert!(
        one.colors == three.colors
            && one.positions == three.positions
            && one.triangles == three.triangles
    );
}

#[test]
fn cells_keep_their_surfaces() {
    let scene = floor_and_post(false);
    let cell = |triangles| Cell {
        name: String::new(),
        space: Vec::new(),
        triangles,
    };
    let areas = [area(&scene, 0..2), area(&scene, 2..4)];
    let model = PortalModel {
        scene,
        cells: vec![cell(0..2), cell(2..4)],
        portals: Vec::new(),
        outside: None,
    };
    let (model, light) = bake_model(model, &options(0.5), &|_, _| ControlFlow::Continue(()));
    assert_eq!(light.samples, 1);
    assert_eq!(model.cells[0].triangles.end, model.cells[1].triangles.start);
    assert_eq!(
        model.cells[1].triangles.end as usize,
        model.scene.triangles.len()
    );
    for (cell, expected) in model.cells.iter().zip(areas) {
        assert!((area(&model.scene, cell.triangles.clone()) - expected).abs() < 1e-9);
    }
}

#[test]
fn cancelled_bake_keeps_first_round() {
    let source = Arc::new(uneven_grid());
    let options = BakeOptions {
        samples: 32,
        ..options(0.01)
    };
    let whole = baked(&source, &options);
    assert_eq!(whole.samples, 32);
    // The first round, a quarter of the samples, counts for 0.41 of the work.
    for (when, expected) in [(0.0, 0), (0.42, 8)] {
        let ended = AtomicBool::new(false);
        let baked = bake(&source, &options, &|done, all| {
            ended.fetch_or(done == all, Ordering::Relaxed);
            if done as f64 >= when * all as f64 {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        });
        assert!(
            !ended.into_inner(),
            "{} vertices are enough for reports on the way",
            baked.scene.positions.len()
        );
        assert_eq!(baked.samples, expected);
        let dark = baked
            .scene
            .colors
            .iter()
            .filter(|color| **color == Vec3::ZERO)
            .count();
        assert_eq!(dark > 0, expected == 0);
        assert!(baked.scene.colors != whole.scene.colors);
    }
}

#[test]
fn bake_reports_progress() {
    let source = Arc::new(uneven_grid());
    let shares = std::sync::Mutex::new(Vec::new());
    let whole = bake(
        &source,
        &BakeOptions {
            samples: 32,
            ..options(0.01)
        },
        &|done, all| {
            shares.lock().unwrap().push(done as f64 / all as f64);
            ControlFlow::Continue(())
        },
    );
    let mut shares = shares.into_inner().unwrap();
    assert_eq!(shares.last(), Some(&1.0));
    shares.sort_by(f64::total_cmp);
    let widest = shares
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .fold(shares[0], f64::max);
    assert!(
        widest < 0.06,
        "{widest} at once, {} vertices",
        whole.scene.positions.len()
    );
}
