//! Kernel against an `f64` oracle, the whole pipeline on an analytic scene, and invalid input.

use super::consistency::remove_specks;
use super::matching::hypotheses::{Chequerboard, Hypothesis};
use super::matching::picture::MatchView;
use super::matching::relative::Relative;
use super::matching::zncc::{NEAR_PX, NOISE, OFFSETS, Patch, SAMPLES, SIMILAR_LEVELS, WORST};
use super::*;
use crate::readers::test_set::photographs;
use crate::{Distortion, ImageSetOptions, Lens, Pose};
use fearless_simd::dispatch;
use glam::{DMat3, DVec3, dvec3};
use headbox_core::random::Rng;
use headbox_core::simd;
use std::cell::Cell;

const SIZE: [u32; 2] = [96, 72];

fn lens() -> Pinhole {
    Pinhole {
        focal_px: [90.0, 92.0],
        principal_px: [47.3, 36.4],
        distortion: Distortion::default(),
    }
}

/// Returns a pose on an arc in front of the scene, looking at its centre.
fn pose(i: usize) -> Pose {
    let angle = 0.12 * (i as f64 - 2.0);
    let eye = dvec3(
        3.0 * angle.sin(),
        0.1 * (i % 2) as f64,
        3.0 * angle.cos() - 3.0,
    );
    Pose {
        eye,
        world_from_eye: DMat3::from_rotation_y(angle) * DMat3::from_rotation_z(0.05 * i as f64),
    }
}

/// Intersects a ray with a ball in front of a slanted wall.
fn distance(eye: DVec3, ray: DVec3) -> f64 {
    let centre = dvec3(0.1, 0.05, -2.6);
    let radius = 0.45;
    let a = ray.length_squared();
    let b = ray.dot(eye - centre);
    let c = (eye - centre).length_squared() - radius * radius;
    let discriminant = b * b - a * c;
    if discriminant > 0.0 {
        return (-b - discriminant.sqrt()) / a;
    }
    let normal = dvec3(0.3, 0.1, 1.0);
    (normal.z * -3.6 - normal.dot(eye)) / normal.dot(ray)
}

/// Returns the level of a solid texture without repetition.
fn level(p: DVec3) -> u8 {
    let waves = [
        (dvec3(17.0, 5.0, 3.0), 30.0),
        (dvec3(-6.0, 23.0, 11.0), 30.0),
        (dvec3(9.0, -14.0, 19.0), 25.0),
        (dvec3(41.0, 33.0, 2.0), 20.0),
    ];
    (128.0
        + waves
            .iter()
            .map(|(wave, amplitude)| amplitude * wave.dot(p).sin())
            .sum::<f64>()) as u8
}

/// Renders a view of the scene with its exact depth.
fn loaded(i: usize, color: impl Fn(DVec3) -> [u8; 4]) -> LoadedView {
    let pose = pose(i);
    let lens = Lens::Pinhole(lens());
    let mut view = LoadedView {
        size_px: SIZE,
        lens,
        pose,
        color: Vec::new(),
        depth: Vec::new(),
    };
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            let ray = lens.ray([f64::from(x) + 0.5, f64::from(y) + 0.5], SIZE);
            let depth = distance(pose.eye, pose.world_from_eye * ray);
            view.color.push(color(pose.to_world(ray * depth)));
            view.depth.push(depth as f32);
        }
    }
    view
}

fn textured(p: DVec3) -> [u8; 4] {
    [level(p), level(p), level(p), 255]
}

/// Writes a set of five photographs.
fn write_photographs(folder: &Path, color: impl Fn(DVec3) -> [u8; 4] + Copy) -> ImageSet {
    photographs(folder, (0..5).map(|i| loaded(i, color)))
}

fn settings() -> DenseDepth {
    DenseDepth {
        coarsest_px: 30,
        ..DenseDepth::default()
    }
}

fn find(set: &mut ImageSet) -> Result<Agreement, DenseDepthError> {
    let mut agreement = Agreement::default();
    let steps = Cell::new(set.find_depth_steps());
    let advance = |done: u64| steps.set(steps.get() - done);
    set.estimate_depth(&settings(), &advance, &mut |view, estimated| {
        let truth = (0..5)
            .map(|i| loaded(i, textured))
            .find(|truth| truth.pose.eye.distance(view.pose.eye) < 1e-6);
        agreement.add(
            &estimated.view.depth,
            &truth.expect("one of the five").depth,
        );
    })?;
    assert_eq!(steps.get(), 0, "all steps are reported");
    Ok(agreement)
}

/// Computes the matching cost in `f64`, sample by sample through the world.
fn exact_cost(own: &LoadedView, other: &LoadedView, [x, y]: [usize; 2], plane: &Hypothesis) -> f64 {
    let [width, height] = SIZE.map(|side| side as i32);
    let level = |view: &LoadedView, x: i32, y: i32| {
        let x = x.clamp(0, width - 1);
        let y = y.clamp(0, height - 1);
        f64::from(view.color[(y * width + x) as usize][0])
    };
    let mut weights = Vec::new();
    let mut pairs = Vec::new();
    for k in 0..SAMPLES {
        let dx = f64::from(OFFSETS[0][k]);
        let dy = f64::from(OFFSETS[1][k]);
        let a = level(own, x as i32 + dx as i32, y as i32 + dy as i32);
        let inverse_depth = f64::from(plane.inverse_depth)
            + f64::from(plane.slopes[0]) * dx
            + f64::from(plane.slopes[1]) * dy;
        let ray = own
            .lens
            .ray([x as f64 + 0.5 + dx, y as f64 + 0.5 + dy], SIZE);
        let point = own.pose.to_world(ray / inverse_depth);
        let Some([px, py, _]) = other.lens.project(other.pose.to_eye(point), SIZE) else {
            return f64::from(WORST);
        };
        let px = (px - 0.5).clamp(0.0, f64::from(width - 1));
        let py = (py - 0.5).clamp(0.0, f64::from(height - 1));
        let u = px - px.floor();
        let v = py - py.floor();
        let texel = |dx: i32, dy: i32| level(other, px as i32 + dx, py as i32 + dy);
        let upper = texel(0, 0) * (1.0 - u) + texel(1, 0) * u;
        let lower = texel(0, 1) * (1.0 - u) + texel(1, 1) * u;
        pairs.push([a, upper * (1.0 - v) + lower * v]);
        let similar =
            (a - level(own, x as i32, y as i32)).powi(2) / (2.0 * SIMILAR_LEVELS * SIMILAR_LEVELS);
        weights.push((-similar - (dx * dx + dy * dy) / (2.0 * NEAR_PX * NEAR_PX)).exp());
    }
    let total: f64 = weights.iter().sum();
    let mean = |f: &dyn Fn(&[f64; 2]) -> f64| {
        pairs
            .iter()
            .zip(&weights)
            .map(|(p, w)| f(p) * w)
            .sum::<f64>()
            / total
    };
    let means = [mean(&|p| p[0]), mean(&|p| p[1])];
    let product = |i: usize, j: usize| mean(&|p| (p[i] - means[i]) * (p[j] - means[j]));
    let noise = f64::from(NOISE);
    1.0 - product(0, 1) / ((product(0, 0) + noise) * (product(1, 1) + noise)).sqrt()
}

#[test]
fn cost_matches_oracle_at_every_simd_level() {
    /// Cancellation: sums of squares of levels in `f32`, up to 65,025, leave a variance of a few
    /// hundred.
    const TOLERANCE: f64 = 2e-3;
    let views = [0, 1, 4].map(|i| loaded(i, textured));
    let grey = |view: &LoadedView| {
        MatchView::new(view, vec![false; view.color.len()], 1600, 100).expect("a pinhole")
    };
    let pictures = views.each_ref().map(grey);
    let mut rng = Rng::new(7);
    let mut compared = 0;
    for _ in 0..2000 {
        let [x, y] = SIZE.map(|side| rng.below(u64::from(side)) as usize);
        let inverse_depth =
            1.0 / views[0].depth[y * SIZE[0] as usize + x] * rng.between(0.9, 1.1) as f32;
        let slopes = [0; 2].map(|_| rng.between(-0.005, 0.005) as f32);
        let plane = Hypothesis {
            inverse_depth,
            slopes,
            cost: 0.0,
        };
        for (view, picture) in views.iter().zip(&pictures).skip(1) {
            let relative = Relative::new(&pictures[0].camera(0), &picture.camera(0));
            let warped = relative.warp_plane(x as f32 + 0.5, y as f32 + 0.5, inverse_depth, slopes);
            let patch = Patch::new(pictures[0].level(0), x, y);
            let costs: Vec<f32> = simd::levels()
                .into_iter()
                .map(|level| dispatch!(level, simd => patch.cost(simd, &warped, picture.level(0))))
                .collect();
            assert!(
                costs
                    .iter()
                    .all(|cost| cost.to_bits() == costs[0].to_bits()),
                "{costs:?}"
            );
            // Planes that lead out of the image have the maximum cost; the oracle does not check
            // borders.
            if costs[0] < WORST {
                compared += 1;
                let exact = exact_cost(&views[0], view, [x, y], &plane);
                assert!(
                    (f64::from(costs[0]) - exact).abs() < TOLERANCE,
                    "{x} {y} {plane:?}: {} {exact}",
                    costs[0]
                );
            }
        }
    }
    assert!(compared > 2000, "{compared}");
}

#[test]
fn depth_independent_of_threads_and_stored() {
    let run = |threads: usize| {
        let folder = tempfile::tempdir().expect("a folder");
        let mut set = write_photographs(folder.path(), textured);
        assert_eq!(set.views_with_depth().count(), 0);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        let agreement = pool.install(|| find(&mut set)).expect("found");
        (folder, set, agreement)
    };
    let (folder, set, agreement) = run(1);
    let [one, two, five] = agreement.shares_within();
    // Measured; missing are the ball's silhouette and points seen by fewer than three views.
    assert!(
        agreement.estimated_share() > 0.7 && one > 0.9 && two > 0.95 && five > 0.98,
        "{agreement:?}"
    );
    assert!(
        set.has_estimated_depth() && set.depth_noise() > 0.0 && set.depth_noise() < 0.01,
        "{}",
        set.depth_noise()
    );
    let again = ImageSet::open(folder.path(), &ImageSetOptions::default()).expect("a set");
    assert_eq!(again.views_with_depth().count(), 5);
    assert!(
        again.notes.iter().any(|note| note.contains("5 views")),
        "{:?}",
        again.notes
    );
    let view = again.views[2].load().expect("read");
    let known = view.depth.iter().filter(|depth| depth.is_finite()).count();
    assert!(known as f64 > 0.6 * view.color.len() as f64, "{known}");
    let (other, _, _) = run(3);
    for view in &set.views {
        let file = |folder: &Path| {
            let source = &view.depth.as_ref().expect("found").path;
            std::fs::read(
                folder
                    .join("headbox-depth/images")
                    .join(source.file_name().expect("a name")),
            )
            .expect("read")
        };
        assert!(file(folder.path()) == file(other.path()), "{}", view.name);
    }
}

/// Returns the error of a search that finds nothing, and checks that the folder is unchanged.
fn nothing_found(folder: &Path, set: &mut ImageSet) -> SearchCounts {
    let names = || {
        let mut names: Vec<_> = std::fs::read_dir(folder)
            .expect("a folder")
            .map(|entry| entry.expect("an entry").file_name())
            .collect();
        names.sort();
        names
    };
    let before = names();
    let Err(DenseDepthError::NothingFound(counts)) = find(set) else {
        panic!("depth found");
    };
    assert_eq!(names(), before);
    counts
}

#[test]
fn textureless_images_give_no_depth_and_leave_nothing() {
    for color in [
        |_: DVec3| [120, 120, 120, 255],
        |_: DVec3| [2, 2, 2, 255],
        |_: DVec3| [90, 90, 90, 0],
    ] {
        let folder = tempfile::tempdir().expect("a folder");
        let mut set = write_photographs(folder.path(), color);
        let counts = nothing_found(folder.path(), &mut set);
        assert_eq!((counts.views, counts.isolated), (5, 0));
        assert!(counts.pixels > 0 && counts.textureless == counts.pixels);
        let message = counts.to_string();
        assert!(
            message.contains("in 5 photographs") && message.contains("100.0 % have no texture"),
            "{message}"
        );
    }
}

#[test]
fn no_baseline_gives_no_depth_and_leaves_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut set = write_photographs(folder.path(), textured);
    for view in &mut set.views {
        view.pose = pose(0);
    }
    let counts = nothing_found(folder.path(), &mut set);
    assert_eq!((counts.views, counts.isolated), (5, 5));
    assert!(counts.to_string().contains("different position"));
    set.views.truncate(1);
    let error = find(&mut set).expect_err("too few").to_string();
    assert!(
        error.contains("1 perspective views") && error.contains("at least two"),
        "{error}"
    );
    assert!(!folder.path().join("headbox-depth").exists());
}

#[test]
fn outdated_or_damaged_index_reported() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut set = write_photographs(folder.path(), textured);
    find(&mut set).expect("found");
    let index = folder.path().join("headbox-depth/index.json");
    let text = std::fs::read_to_string(&index).expect("read");
    let open = |text: &str| {
        std::fs::write(&index, text).expect("written");
        ImageSet::open(folder.path(), &ImageSetOptions::default())
    };
    let before = "\"camera\": \"";
    let moved = open(&text.replacen(before, "\"camera\": \"x", 1)).expect("a set");
    assert_eq!(moved.views_with_depth().count(), 4);
    assert!(
        moved
            .notes
            .iter()
            .any(|note| note.contains("1 views") && note.contains("--depth")),
        "{:?}",
        moved.notes
    );
    for (damaged, message) in [
        (
            text.replacen("\"file\": \"images/", "\"file\": \"../../", 1),
            "leads out",
        ),
        (text.replace("\"version\": 1", "\"version\": 2"), "version"),
        (
            text.replace("\"deviation\": ", "\"deviation\": -"),
            "deviation",
        ),
        ("{".into(), "not JSON"),
    ] {
        let error = open(&damaged).expect_err(message).to_string();
        assert!(
            error.contains("index.json") && error.contains(message),
            "{error}"
        );
    }
}

#[test]
fn chequerboard_doubled_keeps_planes() {
    let plane = Hypothesis {
        inverse_depth: 0.5,
        slopes: [0.01, -0.02],
        cost: 0.1,
    };
    let width = 5;
    let height = 3;
    let shifted = |x: usize, y: usize| plane.shifted(x as f32, y as f32);
    let rows: Vec<Hypothesis> = (0..width * height)
        .map(|i| shifted(i % width, i / width))
        .collect();
    let coarse = Chequerboard::from_rows(width, height, &rows);
    assert_eq!(coarse.rows(), rows);
    let fine = coarse.doubled(11, 6);
    for (i, doubled) in fine.rows().iter().enumerate() {
        // Centres of fine pixels, in coarse pixels from the first pixel's centre.
        let [x, y] = [i % 11, i / 11].map(|k| (k as f32 + 0.5) / 2.0 - 0.5);
        assert!(
            (doubled.inverse_depth - plane.shifted(x, y).inverse_depth).abs() < 1e-6,
            "{i}"
        );
        assert!(
            (doubled.slopes[0] - 0.005).abs() < 1e-7 && (doubled.slopes[1] + 0.01).abs() < 1e-7
        );
    }
}

#[test]
fn specks_removed_surfaces_kept() {
    let mut depths = vec![0.0; 12 * 10];
    for i in 0..120 {
        let x = i % 12;
        let y = i / 12;
        depths[i] = if x < 6 { 1.0 + 0.01 * y as f32 } else { 0.0 };
    }
    depths[5 * 12 + 9] = 1.0;
    depths[3] = 2.0; // a pixel of another surface
    let before = depths.clone();
    remove_specks(&mut depths, 12, 10);
    for i in 0..120 {
        assert_eq!(
            depths[i],
            if i == 5 * 12 + 9 || i == 3 {
                0.0
            } else {
                before[i]
            },
            "{i}"
        );
    }
}

#[test]
fn candidates_exclude_same_position() {
    let eyes: Vec<DVec3> = (0..60)
        .map(|i| dvec3(f64::from(i) * 0.1, 0.0, 0.0))
        .chain([dvec3(1e-9, 0.0, 0.0)])
        .collect();
    let near = neighbors::candidates(&eyes, 0);
    assert!(!near.contains(&0) && !near.contains(&60), "{near:?}");
    assert!(
        near[..8] == [1, 2, 3, 4, 5, 6, 7, 8] && near.len() <= 48,
        "{near:?}"
    );
    assert!(
        neighbors::candidates(&[DVec3::ZERO; 3], 0).is_empty(),
        "all at one position"
    );
}
