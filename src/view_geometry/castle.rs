//! The paper's experiment (E12): a castle's wall with a gate, seen from a row of places; the middle view is taken away, shown from the
//! others, and compared with itself.

use super::tests::{frame, frame_at, opened, view_of};
use super::*;
use glam::DVec2;

const SIZE: [u32; 2] = [400, 320];
/// Pixels between samples, and between nodes: the paper's 200 by 160 of each.
const SPACING_PX: u32 = 2;

/// Where a ray of eye depth 1 meets the castle, and its colour there: a wall with an arched gate, the ground, and the keep behind.
fn meet(eye: DVec3, ray: DVec3) -> (f64, [f64; 3]) {
    let at = |depth: f64| eye + ray * depth;
    let wall = (-4.0 - eye.z) / ray.z;
    let p = at(wall);
    let is_gate = p.x.abs() < 0.8 && (p.y < 0.6 || DVec2::new(p.x, p.y - 0.6).length() < 0.8);
    let ground = if ray.y < 0.0 { (-1.5 - eye.y) / ray.y } else { f64::INFINITY };
    if !is_gate && wall < ground {
        return (wall, stones(p.x, p.y, [0.62, 0.55, 0.42]));
    }
    let keep = (-9.0 - eye.z) / ray.z;
    match ground < keep {
        true => (ground, stones(at(ground).x, at(ground).z, [0.3, 0.45, 0.2])),
        false => (keep, stones(at(keep).x * 0.7, at(keep).y * 0.7, [0.35, 0.4, 0.6])),
    }
}

/// Rows of stones with joints between, each of its own shade.
fn stones(x: f64, y: f64, color: [f64; 3]) -> [f64; 3] {
    let row = (y / 0.2).floor();
    let along = x / 0.4 + 0.5 * row;
    let (stone, joint) = (along.floor(), (along.fract().abs() < 0.06) || ((y / 0.2).fract().abs() < 0.12));
    let shade = 0.75 + 0.25 * ((stone * 12.9898 + row * 78.233).sin() * 43_758.545_3).fract().abs();
    let grain = 0.06 * ((x * 31.0).sin() + (y * 37.0).cos());
    color.map(|c| ((c * if joint { 0.4 } else { shade } + grain * c) * 255.0).clamp(0.0, 255.0))
}

fn picture(eye: DVec3) -> LoadedView {
    let focal = 0.8 * f64::from(SIZE[0]);
    let ray = move |x: f64, y: f64| {
        let [u, v] = [(x, SIZE[0]), (y, SIZE[1])].map(|(at, side)| (at - f64::from(side) / 2.0) / focal);
        DVec3::new(u, -v, -1.0)
    };
    let color = move |x: u32, y: u32| {
        let mut sum = [0.0; 3];
        for (dx, dy) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
            let (_, color) = meet(eye, ray(f64::from(x) + dx, f64::from(y) + dy));
            (0..3).for_each(|k| sum[k] += color[k] / 4.0);
        }
        sum.map(|c| c as u8)
    };
    view_of(eye, move |x, y| meet(eye, ray(f64::from(x) + 0.5, f64::from(y) + 0.5)).0 as f32, color, SIZE)
}

/// Mean absolute difference over the columns and rows of a part of the frame, where both show something, and the share that does.
fn mad(frame: &Frame, truth: &LoadedView, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> (f64, f64) {
    let (mut sum, mut count, mut all) = (0.0, 0.0, 0.0);
    for i in rows.flat_map(|y| columns.clone().map(move |x| y * SIZE[0] as usize + x)) {
        all += 1.0;
        if !frame.coverage[i].is_hole() {
            sum += (0..3).map(|k| f64::from(frame.color[i][k].abs_diff(truth.color[i][k]))).sum::<f64>() / 3.0;
            count += 1.0;
        }
    }
    (sum / count, count / all)
}

#[test]
fn a_view_that_was_taken_away_comes_back_nearer_than_in_the_paper() {
    let views = [-0.6, -0.3, 0.3, 0.6].map(|x| picture(DVec3::X * x));
    let truth = picture(DVec3::ZERO);
    let (_folder, geometry) = opened(&views, &SampleGrid { spacing_px: SPACING_PX, coarsest: 3 });
    let camera = frame_at(DVec3::ZERO, SIZE);
    let modes = [Texturing::Nearest, Texturing::Single, Texturing::Multi, Texturing::Blended, Texturing::Averaged];
    let measured = modes.map(|texturing| {
        let settings = GeometrySettings { texturing, grid_px: SPACING_PX as f32, ..GeometrySettings::default() };
        let (frame, _) = frame(&geometry, &camera, &settings);
        // The gate, and the whole (C28).
        let (gate, covered) = mad(&frame, &truth, 110..290, 60..290);
        let (whole, _) = mad(&frame, &truth, 0..SIZE[0] as usize, 0..SIZE[1] as usize);
        println!("{:20} gate {gate:6.3} whole {whole:6.3} covered {covered:.4}", texturing.name());
        (gate, whole, covered)
    });
    // E-N3: nearest 26.5, single 12.8, multi 12.4, blended 11.8.
    let nearest = measured[0];
    for (found, paper) in measured[1..].iter().zip([12.8, 12.4, 11.8, 11.8]) {
        assert!(found.0 / nearest.0 <= paper / 26.5 && found.1 / nearest.1 <= paper / 26.5, "{measured:?}");
    }
    let covered = measured.map(|(_, _, covered)| covered);
    assert!(
        covered[1] < 0.995 && covered[2..].iter().all(|covered| *covered > 0.995),
        "only several cameras see all: {covered:?}"
    );
}
