//! Pooling of parts whose light is known.

use super::*;
use crate::light::shade::LitPart;
use headbox_trace::sampler::{RayKey, random4, unit_float};

const SIZE: u32 = 64;

pub(super) fn part(class: u16, plane_distance: f32) -> LitPart {
    LitPart {
        key: RayKey(0),
        count: 1,
        area: 1.0,
        bin: 0,
        class,
        position: 0.0,
        albedo: [0; 3],
        primitive: 0,
        barycentric: [0; 2],
        emission: Vec3::ZERO,
        sun: Vec3::ZERO,
        soft: Vec3::ZERO,
        plane_normal: Vec3::Z,
        plane_distance,
    }
}

/// One sample.
fn sample(light: f32, nearness: f32) -> Gathered {
    Gathered {
        light: Vec3::splat(light),
        squares: light * light,
        nearness,
        samples: 1.0,
    }
}

/// What a face's samples are pooled to by themselves.
fn pooled(face: &FaceParts, gathered: &[Gathered]) -> Vec<Pooled> {
    let pooling = Pooling::new(face, Face::NegZ);
    let (mut blocks, members) = Blocks::new(face);
    blocks.fill(&members, gathered);
    let windows = Windows::new(Face::NegZ, face.size_px, &blocks, [None; 6]);
    pooling.pool(
        gathered,
        &windows,
        &Classes::of(&face.classes(), gathered).variances(),
    )
}

/// Pooled light of a wall 5 m away, of which each part has a sample of `light` within a share of `noise`: the mean of each column.
fn wall(noise: f32, light: impl Fn(u32) -> f32, nearness: impl Fn(u32) -> f32) -> Vec<f32> {
    let factor = |p: u32| 1.0 + noise * (2.0 * unit_float(random4([p, 1, 2, 3])[0]) - 1.0);
    let gathered: Vec<Gathered> = (0..SIZE * SIZE)
        .map(|p| sample(light(p % SIZE) * factor(p), nearness(p % SIZE)))
        .collect();
    let parts = vec![part(1, 5.0); gathered.len()];
    let face = FaceParts {
        size_px: SIZE,
        offsets: (0..=SIZE * SIZE).collect(),
        parts,
    };
    let pooled = pooled(&face, &gathered);
    let column = |x: u32| {
        (0..SIZE)
            .map(|y| pooled[face.range(x, y).start].light.x)
            .sum::<f32>()
            / SIZE as f32
    };
    (0..SIZE).map(column).collect()
}

#[test]
fn light_is_shared_on_a_surface_and_never_across() {
    // In each pixel two parts of a wall whose light alternates, a part of nothing else, and a step in front of the wall.
    let of_pixel = |p: u32| {
        let step = (part(1, 5.1 + 0.1 * p as f32), sample(9.0, 0.0));
        let wall = |light: u32| (part(1, 5.0), sample(light as f32, 0.0));
        [
            wall((p ^ (p / SIZE)) % 2),
            wall((p ^ (p / SIZE)) % 2),
            (part(2 + p as u16, 5.0), sample(7.0, 0.0)),
            step,
        ]
    };
    let (parts, gathered): (Vec<LitPart>, Vec<Gathered>) =
        (0..SIZE * SIZE).flat_map(of_pixel).unzip();
    let face = FaceParts {
        size_px: SIZE,
        offsets: (0..=SIZE * SIZE).map(|p| 4 * p).collect(),
        parts,
    };
    for pixel in pooled(&face, &gathered).chunks(4) {
        let [a, b, other, step] = [0, 1, 2, 3].map(|i| pixel[i].light.x);
        assert!(
            (a - 0.5).abs() < 0.05 && (b - 0.5).abs() < 0.05,
            "the alternation is averaged: {a} {b}"
        );
        // Rounding of sums and quotients of up to a hundred terms.
        assert!(
            (other - 7.0).abs() < 1e-4 && (step - 9.0).abs() < 1e-4,
            "{other} {step}"
        );
    }
}

#[test]
fn the_edge_of_a_shadow_stays_where_it_is() {
    let light = |x: u32| if x < 32 { 1.0 } else { 0.1 };
    let found = wall(0.1, light, |_| 0.0);
    for x in (0..27).chain(37..SIZE) {
        // The widest window alone errs by 0.4 here.
        assert!(
            (found[x as usize] - light(x)).abs() < 0.05,
            "{} at {x}",
            found[x as usize]
        );
    }
}

#[test]
fn a_contact_shadow_stays_in_noise_that_hides_it() {
    // Light beside something that stands on the wall: its distance is that to the wall's left edge.
    let distance_m = |x: u32| (x as f32 + 0.5) * 10.0 / SIZE as f32;
    let light = |x: u32| distance_m(x) / (distance_m(x) + 0.5);
    let bias = |found: Vec<f32>| {
        (2..SIZE)
            .map(|x| (found[x as usize] - light(x)).abs())
            .fold(0.0, f32::max)
    };
    let (with, without) = (
        bias(wall(1.0, light, |x| 1.0 / distance_m(x))),
        bias(wall(1.0, light, |_| 0.0)),
    );
    assert!(
        with < 0.1 && with < 0.8 * without,
        "{with}, and {without} without distances"
    );
}

/// Root of the mean squared relative error of pooled light within 1.5 m of a corner, to one side of which distances (metres) are positive
/// and to the other negative; each part has one sample of its light, within 100 %.
fn grain_in_a_corner(distance_m: impl Fn([u32; 2]) -> f32) -> f32 {
    let at = |p: u32| distance_m([p % SIZE, p / SIZE]);
    let light = |p: u32| at(p).abs() / (at(p).abs() + 0.5);
    let found = |p: u32| {
        sample(
            light(p) * 2.0 * unit_float(random4([p, 1, 2, 3])[0]),
            1.0 / at(p).abs().max(0.1),
        )
    };
    let gathered: Vec<Gathered> = (0..SIZE * SIZE).map(found).collect();
    let parts = (0..SIZE * SIZE)
        .map(|p| part(if at(p) > 0.0 { 1 } else { 2 }, 5.0))
        .collect();
    let face = FaceParts {
        size_px: SIZE,
        offsets: (0..=SIZE * SIZE).collect(),
        parts,
    };
    let pooled = pooled(&face, &gathered);
    let is_near =
        |p: &u32| (0.5..1.5).contains(&at(*p).abs()) && (16..SIZE - 16).contains(&(p / SIZE));
    let near: Vec<u32> = (0..SIZE * SIZE).filter(is_near).collect();
    let error = |&p: &u32| (pooled[p as usize].light.x / light(p) - 1.0).powi(2);
    (near.iter().map(error).sum::<f32>() / near.len() as f32).sqrt()
}

#[test]
fn corners_are_pooled_along() {
    // What a hundred percent of uniform noise leaves over the narrowest window.
    let narrow = (1.0 / 3.0f32).sqrt() / narrow::parts().sqrt();
    let pixel_m = 10.0 / SIZE as f32;
    let upright = grain_in_a_corner(|[x, _]| (x as f32 + 0.5) * pixel_m);
    let slanting = grain_in_a_corner(|[x, y]| (x as f32 - 0.6 * y as f32 - 12.75) * pixel_m / 1.17);
    assert!(
        upright < 0.5 * narrow && slanting < 0.7 * narrow,
        "{upright}, {slanting}, and {narrow} of narrow windows"
    );
}

#[test]
fn walls_are_pooled_far() {
    let found = wall(0.1, |_| 1.0, |_| 0.01);
    let error = (found.iter().map(|light| (light - 1.0).powi(2)).sum::<f32>() / SIZE as f32).sqrt();
    // Of single samples 0.058, and of 700 of them 0.002.
    assert!(error < 0.004, "{error}");
}

/// Parts and samples of all faces in the middle of a wall of a few metres, 3 m away and at 45 degrees to two of the faces; light of
/// 1, and noise.
fn across_a_border() -> Vec<(Face, FaceParts, Vec<Gathered>)> {
    const SIZE: u32 = 512;
    let toward = Vec3::new(1.0, 0.0, -1.0).normalize();
    let of_face = |face: Face| {
        let (mut parts, mut gathered, mut offsets) = (Vec::new(), Vec::new(), vec![0]);
        for pixel in 0..SIZE * SIZE {
            let [x, y] = [pixel % SIZE, pixel / SIZE].map(|c| f64::from(c) + 0.5);
            let direction = face.direction(x, y, SIZE).as_vec3();
            if direction.dot(toward) > 0.8 * direction.length() {
                let noise = unit_float(random4([pixel, face.index() as u32, 2, 3])[0]);
                parts.push(LitPart {
                    plane_normal: -toward,
                    ..part(1, -3.0)
                });
                gathered.push(sample(2.0 * noise, 0.0));
            }
            offsets.push(parts.len() as u32);
        }
        (
            face,
            FaceParts {
                size_px: SIZE,
                offsets,
                parts,
            },
            gathered,
        )
    };
    Face::ALL.map(of_face).into()
}

/// Root of the mean squared step of the light of neighbours on either side of the border of faces, where faces know of each other or
/// not.
fn step_at_border(know_each_other: bool) -> f32 {
    let faces = across_a_border();
    let blocks = faces.iter().map(|(_, parts, gathered)| {
        let (mut blocks, members) = Blocks::new(parts);
        blocks.fill(&members, gathered);
        blocks
    });
    let blocks: Vec<Blocks> = blocks.collect();
    let light = |face: Face| -> Vec<f32> {
        let (face, parts, gathered) = &faces[face.index()];
        let known = Face::ALL.map(|face| blocks.get(face.index()).filter(|_| know_each_other));
        let windows = Windows::new(*face, parts.size_px, &blocks[face.index()], known);
        let expected = Classes::of(&parts.classes(), gathered).variances();
        let pooled = Pooling::new(parts, *face).pool(gathered, &windows, &expected);
        // The last column of the one face meets the first of the other.
        let x = if *face == Face::NegZ {
            parts.size_px - 1
        } else {
            0
        };
        let column = (0..parts.size_px).filter_map(|y| {
            pooled
                .get(parts.range(x, y).start)
                .filter(|_| !parts.pixel(x, y).is_empty())
        });
        column.map(|pooled| pooled.light.x).collect()
    };
    let (left, right) = (light(Face::NegZ), light(Face::PosX));
    assert!(
        left.len() == right.len() && left.len() > 100,
        "{} and {} rows",
        left.len(),
        right.len()
    );
    (left
        .iter()
        .zip(&right)
        .map(|(a, b)| (a - b).powi(2))
        .sum::<f32>()
        / left.len() as f32)
        .sqrt()
}

#[test]
fn a_wall_shows_no_line_where_faces_meet() {
    let (together, apart) = (step_at_border(true), step_at_border(false));
    assert!(
        together < 0.5 * apart,
        "{together}, and {apart} by themselves"
    );
}

#[test]
fn what_is_seen_exactly_edge_on_is_lit() {
    // A row of pixels looks along planes through it: one through the centre, and others beside it.
    for (size_px, distance) in [(7, 0.0), (7, 0.01), (65, 0.0), (65, 1e-30), (65, 3.0)] {
        let row = size_px / 2;
        let plane = LitPart {
            plane_normal: Vec3::Y,
            ..part(1, distance)
        };
        let offsets = (0..=size_px * size_px)
            .map(|p: u32| p.saturating_sub(row * size_px).min(size_px))
            .collect();
        let face = FaceParts {
            size_px,
            offsets,
            parts: vec![plane; size_px as usize],
        };
        let gathered: Vec<Gathered> = (0..size_px)
            .map(|p| sample(1.0 + (p % 2) as f32, 0.5))
            .collect();
        for pooled in pooled(&face, &gathered) {
            assert!(
                (1.0..=2.0).contains(&pooled.light.x),
                "{size_px} px, {distance} m: {pooled:?}"
            );
        }
    }
}
