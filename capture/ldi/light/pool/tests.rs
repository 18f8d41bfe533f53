//! Pooling of surface samples with known light.

use super::*;
use crate::accumulate::accumulator::Accumulator;
use crate::light::shade::SurfaceSample;
use headbox_trace::sampler::{random4, unit_float};

const SIZE: u32 = 64;

pub(super) fn sample_on_plane(material: u32, plane_distance: f32) -> SurfaceSample {
    SurfaceSample {
        count: 1,
        area: 1.0,
        class: Accumulator::class(material, false, Vec3::Z),
        plane_normal: Vec3::Z,
        plane_distance,
        ..bytemuck::Zeroable::zeroed()
    }
}

/// A single light sample.
fn light_sample(light: f32, nearness: f32) -> GatheredLight {
    GatheredLight {
        light: Vec3::splat(light),
        squares: light * light,
        nearness,
        samples: 1.0,
    }
}

/// Pools a face's samples without other faces.
fn pool_face(face: &FaceSurfaces, gathered: &[GatheredLight]) -> Vec<PooledLight> {
    let pooling = Pooling::new(face, Face::NegZ);
    let (mut blocks, membership) = Blocks::new(face);
    blocks.fill(&membership, gathered);
    let windows = BlockWindows::new(Face::NegZ, face.size_px, &blocks, [None; 6]);
    pooling.pool(
        gathered.to_vec(),
        &windows,
        &ClassStatistics::new(&face.classes(), gathered).variances(),
    )
}

/// Mean of each column of the pooled light of a wall 5 m away. Each surface sample has a light
/// sample of `light` within a share of `noise`.
fn pool_wall(noise: f32, light: impl Fn(u32) -> f32, nearness: impl Fn(u32) -> f32) -> Vec<f32> {
    let factor = |p: u32| 1.0 + noise * (2.0 * unit_float(random4([p, 1, 2, 3])[0]) - 1.0);
    let gathered: Vec<GatheredLight> = (0..SIZE * SIZE)
        .map(|p| light_sample(light(p % SIZE) * factor(p), nearness(p % SIZE)))
        .collect();
    let face = FaceSurfaces {
        size_px: SIZE,
        offsets: (0..=SIZE * SIZE).collect(),
        samples: vec![sample_on_plane(1, 5.0); gathered.len()],
    };
    let pooled = pool_face(&face, &gathered);
    let column = |x: u32| {
        (0..SIZE)
            .map(|y| pooled[face.range(x, y).start].light.x)
            .sum::<f32>()
            / SIZE as f32
    };
    (0..SIZE).map(column).collect()
}

#[test]
fn light_is_shared_on_a_surface_only() {
    // In each pixel two samples of a wall whose light alternates, one of a material of its own, and
    // a step in front of the wall.
    let pixel_samples = |p: u32| {
        let step = (
            sample_on_plane(1, 5.1 + 0.1 * p as f32),
            light_sample(9.0, 0.0),
        );
        let wall = |light: u32| (sample_on_plane(1, 5.0), light_sample(light as f32, 0.0));
        [
            wall((p ^ (p / SIZE)) % 2),
            wall((p ^ (p / SIZE)) % 2),
            (sample_on_plane(2 + p % 250, 5.0), light_sample(7.0, 0.0)),
            step,
        ]
    };
    let (samples, gathered): (Vec<SurfaceSample>, Vec<GatheredLight>) =
        (0..SIZE * SIZE).flat_map(pixel_samples).unzip();
    let face = FaceSurfaces {
        size_px: SIZE,
        offsets: (0..=SIZE * SIZE).map(|p| 4 * p).collect(),
        samples,
    };
    for pixel in pool_face(&face, &gathered).chunks(4) {
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
fn shadow_edge_stays_sharp() {
    let light = |x: u32| if x < 32 { 1.0 } else { 0.1 };
    let pooled = pool_wall(0.1, light, |_| 0.0);
    for x in (0..27).chain(37..SIZE) {
        // The widest window alone errs by 0.4 here.
        assert!(
            (pooled[x as usize] - light(x)).abs() < 0.05,
            "{} at {x}",
            pooled[x as usize]
        );
    }
}

#[test]
fn contact_shadow_survives_noise() {
    // Light beside something that stands on the wall: its distance is that to the wall's left edge.
    let distance_m = |x: u32| (x as f32 + 0.5) * 10.0 / SIZE as f32;
    let light = |x: u32| distance_m(x) / (distance_m(x) + 0.5);
    let bias = |pooled: Vec<f32>| {
        (2..SIZE)
            .map(|x| (pooled[x as usize] - light(x)).abs())
            .fold(0.0, f32::max)
    };
    let with = bias(pool_wall(1.0, light, |x| 1.0 / distance_m(x)));
    let without = bias(pool_wall(1.0, light, |_| 0.0));
    assert!(
        with < 0.1 && with < 0.8 * without,
        "{with}, and {without} without distances"
    );
}

/// Root mean squared relative error of pooled light within 1.5 m of a corner. Distances (metres)
/// are positive to one side of it and negative to the other; each surface sample has one light
/// sample, within 100 %.
fn corner_error(distance_m: impl Fn([u32; 2]) -> f32) -> f32 {
    let distance = |p: u32| distance_m([p % SIZE, p / SIZE]);
    let light = |p: u32| distance(p).abs() / (distance(p).abs() + 0.5);
    let noisy_sample = |p: u32| {
        light_sample(
            light(p) * 2.0 * unit_float(random4([p, 1, 2, 3])[0]),
            1.0 / distance(p).abs().max(0.1),
        )
    };
    let gathered: Vec<GatheredLight> = (0..SIZE * SIZE).map(noisy_sample).collect();
    let samples = (0..SIZE * SIZE)
        .map(|p| sample_on_plane(if distance(p) > 0.0 { 1 } else { 2 }, 5.0))
        .collect();
    let face = FaceSurfaces {
        size_px: SIZE,
        offsets: (0..=SIZE * SIZE).collect(),
        samples,
    };
    let pooled = pool_face(&face, &gathered);
    let is_near =
        |p: &u32| (0.5..1.5).contains(&distance(*p).abs()) && (16..SIZE - 16).contains(&(p / SIZE));
    let near: Vec<u32> = (0..SIZE * SIZE).filter(is_near).collect();
    let error = |&p: &u32| (pooled[p as usize].light.x / light(p) - 1.0).powi(2);
    (near.iter().map(error).sum::<f32>() / near.len() as f32).sqrt()
}

#[test]
fn corner_is_pooled_along_its_line() {
    // Error that a hundred percent of uniform noise leaves over the narrowest window.
    let narrow = (1.0 / 3.0f32).sqrt() / narrow_windows::support().sqrt();
    let pixel_m = 10.0 / SIZE as f32;
    let upright = corner_error(|[x, _]| (x as f32 + 0.5) * pixel_m);
    let slanting = corner_error(|[x, y]| (x as f32 - 0.6 * y as f32 - 12.75) * pixel_m / 1.17);
    assert!(
        upright < 0.5 * narrow && slanting < 0.7 * narrow,
        "{upright}, {slanting}, and {narrow} of narrow windows"
    );
}

#[test]
fn wall_is_pooled_widely() {
    let pooled = pool_wall(0.1, |_| 1.0, |_| 0.01);
    let error = (pooled
        .iter()
        .map(|light| (light - 1.0).powi(2))
        .sum::<f32>()
        / SIZE as f32)
        .sqrt();
    // The error of single samples is 0.058, of 700 of them 0.002.
    assert!(error < 0.004, "{error}");
}

/// Surface samples and noisy light samples of 1 on all faces, in the middle of a wall of a few
/// metres, 3 m away and at 45 degrees to two of the faces.
fn wall_across_a_border() -> Vec<(Face, FaceSurfaces, Vec<GatheredLight>)> {
    const SIZE: u32 = 512;
    let toward = Vec3::new(1.0, 0.0, -1.0).normalize();
    let wall_on_face = |face: Face| {
        let mut samples = Vec::new();
        let mut gathered = Vec::new();
        let mut offsets = vec![0];
        for pixel in 0..SIZE * SIZE {
            let [x, y] = [pixel % SIZE, pixel / SIZE].map(|c| f64::from(c) + 0.5);
            let direction = face.direction(x, y, SIZE).as_vec3();
            if direction.dot(toward) > 0.8 * direction.length() {
                let noise = unit_float(random4([pixel, face.index() as u32, 2, 3])[0]);
                samples.push(SurfaceSample {
                    plane_normal: -toward,
                    ..sample_on_plane(1, -3.0)
                });
                gathered.push(light_sample(2.0 * noise, 0.0));
            }
            offsets.push(samples.len() as u32);
        }
        let surfaces = FaceSurfaces {
            size_px: SIZE,
            offsets,
            samples,
        };
        (face, surfaces, gathered)
    };
    Face::ALL.map(wall_on_face).into()
}

/// Root mean squared step of the light of neighbours on either side of the border of faces, whose
/// windows reach across it or not.
fn step_at_border(reaches_across: bool) -> f32 {
    let faces = wall_across_a_border();
    let blocks = faces.iter().map(|(_, surfaces, gathered)| {
        let (mut blocks, membership) = Blocks::new(surfaces);
        blocks.fill(&membership, gathered);
        blocks
    });
    let blocks: Vec<Blocks> = blocks.collect();
    let light = |face: Face| -> Vec<f32> {
        let (face, surfaces, gathered) = &faces[face.index()];
        let others = Face::ALL.map(|face| blocks.get(face.index()).filter(|_| reaches_across));
        let windows = BlockWindows::new(*face, surfaces.size_px, &blocks[face.index()], others);
        let expected = ClassStatistics::new(&surfaces.classes(), gathered).variances();
        let pooled = Pooling::new(surfaces, *face).pool(gathered.clone(), &windows, &expected);
        // The last column of the one face meets the first of the other.
        let x = if *face == Face::NegZ {
            surfaces.size_px - 1
        } else {
            0
        };
        let column = (0..surfaces.size_px).filter_map(|y| {
            pooled
                .get(surfaces.range(x, y).start)
                .filter(|_| !surfaces.pixel(x, y).is_empty())
        });
        column.map(|pooled| pooled.light.x).collect()
    };
    let left = light(Face::NegZ);
    let right = light(Face::PosX);
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
fn wall_is_seamless_where_faces_meet() {
    let across = step_at_border(true);
    let within = step_at_border(false);
    assert!(
        across < 0.5 * within,
        "{across}, and {within} with windows within faces"
    );
}

#[test]
fn edge_on_surface_is_lit() {
    // A row of pixels along planes: one through the centre, and others beside it.
    for (size_px, distance) in [(7, 0.0), (7, 0.01), (65, 0.0), (65, 1e-30), (65, 3.0)] {
        let row = size_px / 2;
        let plane = SurfaceSample {
            plane_normal: Vec3::Y,
            ..sample_on_plane(1, distance)
        };
        let offsets = (0..=size_px * size_px)
            .map(|p: u32| p.saturating_sub(row * size_px).min(size_px))
            .collect();
        let face = FaceSurfaces {
            size_px,
            offsets,
            samples: vec![plane; size_px as usize],
        };
        let gathered: Vec<GatheredLight> = (0..size_px)
            .map(|p| light_sample(1.0 + (p % 2) as f32, 0.5))
            .collect();
        for pooled in pool_face(&face, &gathered) {
            assert!(
                (1.0..=2.0).contains(&pooled.light.x),
                "{size_px} px, {distance} m: {pooled:?}"
            );
        }
    }
}

#[test]
fn classes_of_all_faces_have_variances() {
    let gathered = |light: f32| GatheredLight {
        light: Vec3::splat(light),
        squares: 2.0 * light * light,
        nearness: 0.0,
        samples: 1.0,
    };
    let together = ClassStatistics::new(&[2, 700], &[gathered(1.0), gathered(3.0)]);
    let mut faces = ClassStatistics::new(&[2], &[gathered(1.0)]);
    faces.absorb(&ClassStatistics::new(&[700], &[gathered(3.0)]));
    let variances = faces.variances();
    assert_eq!(variances, together.variances());
    assert!(variances[700] > variances[2]);
    let last = usize::from(u16::MAX);
    assert_eq!(variances.len(), last + 1);
    assert_eq!(variances[last], variances[3], "classes without samples");
}

#[test]
fn smooth_shading_survives_pooling() {
    // A wall whose shading normals turn by 40 degrees from side to side, in light that falls from
    // the left, with a light sample in one of sixteen pixels.
    let shading_normal = |i: usize| {
        let share = ((i as u32 % SIZE) as f32 + 0.5) / SIZE as f32;
        let angle = (share - 0.5) * 40f32.to_radians();
        Vec3::new(angle.sin(), 0.0, angle.cos())
    };
    let toward = Vec3::new(-0.8, 0.0, 0.6);
    let light = |i: usize| toward.dot(shading_normal(i));
    let random = |i: usize| random4([i as u32, 1, 2, 3]).map(unit_float);
    let noise = |i: usize| 2.0 * random(i)[0];
    let is_sampled = |i: usize| random(i)[1] < 1.0 / 16.0;
    let pixels = 0..(SIZE * SIZE) as usize;
    let mut gathered: Vec<GatheredLight> = pixels
        .clone()
        .map(|i| {
            if is_sampled(i) {
                light_sample(light(i) * noise(i), 0.01)
            } else {
                GatheredLight::default()
            }
        })
        .collect();
    let gradient = |i: usize| {
        let tangential = toward - shading_normal(i) * light(i);
        tangential * if is_sampled(i) { noise(i) } else { 0.0 }
    };
    let gradients: Vec<Vec3> = pixels.clone().map(gradient).collect();
    let face = FaceSurfaces {
        size_px: SIZE,
        offsets: (0..=SIZE * SIZE).collect(),
        samples: vec![sample_on_plane(1, 5.0); gathered.len()],
    };
    let error = |factors: &[f32], gathered: &[GatheredLight]| {
        let pooled = pool_face(&face, gathered);
        let error = |i: usize| (pooled[i].light.x * factors[i] - light(i)).powi(2);
        (pixels.clone().map(error).sum::<f32>() / gathered.len() as f32).sqrt()
    };
    let flat = error(&vec![1.0; gathered.len()], &gathered);
    let (blocks, membership) = Blocks::new(&face);
    let gradients = NormalGradients::new(blocks, &membership, &gathered, &gradients);
    let pooling = Pooling::new(&face, Face::NegZ);
    let factors = gradients.factors_at(&pooling, Face::NegZ, shading_normal);
    for (gathered, factor) in gathered.iter_mut().zip(&factors) {
        gathered.scale(1.0 / factor);
    }
    let smooth = error(&factors, &gathered);
    // Light is 0.3 to 0.8; single samples err by a third of it.
    assert!(
        smooth < 0.03 && flat > 2.0 * smooth,
        "{smooth}, and {flat} without gradients"
    );
}
