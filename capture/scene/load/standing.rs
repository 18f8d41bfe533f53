//! What stands: things have their feet on one floor and reach to different heights, whatever they are called and however they are
//! exported.

use crate::scene::Scene;
use glam::DVec3;
use rayon::prelude::*;

/// Slices of a scene along an axis; what begins or ends in two neighbouring ones does so at one level.
const LEVELS: usize = 400;
/// Fewer things tell nothing.
const FEWEST_THINGS: f64 = 3.0;
/// What is thinner than this share of the scene along an axis lies across it and does not stand along it.
const THINNEST: f64 = 0.01;
/// To cut a scene of more vertices into things takes longer than a guess is worth.
const MOST_VERTICES: usize = 1 << 21;

/// For each axis, the share of things that begin at the commonest level of it, less the share that end at the commonest one.
pub(super) fn standing(scene: &Scene, low: DVec3, extent: DVec3) -> DVec3 {
    if scene.positions.len() > MOST_VERTICES {
        return DVec3::ZERO;
    }
    let things = things(scene);
    let of_axis = |axis: usize| {
        let mut levels = vec![[0.0_f64; 2]; LEVELS + 2];
        let mut count = 0.0;
        for [first, last] in things
            .iter()
            .map(|ends| ends.map(|end| (end[axis] - low[axis]) / extent[axis]))
        {
            if last - first >= THINNEST {
                let level = |share: f64| (share * LEVELS as f64).clamp(0.0, LEVELS as f64) as usize;
                levels[level(first)][0] += 1.0;
                levels[level(last)][1] += 1.0;
                count += 1.0;
            }
        }
        let most = |end: usize| {
            levels
                .windows(2)
                .map(|pair| pair[0][end] + pair[1][end])
                .fold(0.0, f64::max)
        };
        if count < FEWEST_THINGS {
            0.0
        } else {
            (most(0) - most(1)) / count
        }
    };
    DVec3::from_array([0, 1, 2].map(of_axis))
}

/// The ends of what hangs together by corners that lie in one place: exporters often give each face corners of its own.
fn things(scene: &Scene) -> Vec<[DVec3; 2]> {
    let mut places: Vec<([u64; 3], u32)> = (0_u32..)
        .zip(&scene.positions)
        .map(|(i, place)| (place.to_array().map(f64::to_bits), i))
        .collect();
    places.par_sort_unstable();
    // The vertex that stands for each one's thing; at the end of a chain, itself.
    let mut stands_for: Vec<u32> = (0..scene.positions.len() as u32).collect();
    for of_one in places.chunk_by(|a, b| a.0 == b.0) {
        of_one
            .iter()
            .for_each(|&(_, vertex)| stands_for[vertex as usize] = of_one[0].1);
    }
    fn end(stands_for: &mut [u32], mut vertex: u32) -> u32 {
        while stands_for[vertex as usize] != vertex {
            // Halves the chain, so that the next walk along it is short.
            stands_for[vertex as usize] = stands_for[stands_for[vertex as usize] as usize];
            vertex = stands_for[vertex as usize];
        }
        vertex
    }
    for triangle in &scene.triangles {
        let [a, b, c] = triangle.vertices.map(|vertex| end(&mut stands_for, vertex));
        stands_for[b as usize] = a;
        let c = end(&mut stands_for, c);
        stands_for[c as usize] = a;
    }
    let mut ends = vec![[DVec3::INFINITY, DVec3::NEG_INFINITY]; scene.positions.len()];
    for vertex in scene
        .triangles
        .iter()
        .flat_map(|triangle| triangle.vertices)
    {
        let place = scene.positions[vertex as usize];
        let [low, high] = &mut ends[end(&mut stands_for, vertex) as usize];
        (*low, *high) = (low.min(place), high.max(place));
    }
    ends.retain(|[low, _]| low.is_finite());
    ends
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Triangle;

    /// Boxes given by their ends, each face with corners of its own.
    fn boxes(ends: &[[DVec3; 2]]) -> Scene {
        let mut scene = Scene::default();
        for [low, high] in ends {
            let corner = |i: usize| {
                DVec3::from_array([0, 1, 2].map(|k| if i >> k & 1 == 1 { high[k] } else { low[k] }))
            };
            for face in [
                [0, 1, 3, 2],
                [4, 5, 7, 6],
                [0, 1, 5, 4],
                [2, 3, 7, 6],
                [0, 2, 6, 4],
                [1, 3, 7, 5],
            ] {
                let first = scene.positions.len() as u32;
                scene.positions.extend(face.map(corner));
                let triangle = |b, c| Triangle {
                    vertices: [first, first + b, first + c],
                    material: 0,
                };
                scene.triangles.extend([triangle(1, 2), triangle(2, 3)]);
            }
        }
        scene
    }

    #[test]
    fn what_has_its_feet_on_one_floor_stands_along_that_axis() {
        let ends: Vec<[DVec3; 2]> = (0..6)
            .map(|i| {
                let i = f64::from(i);
                let foot = DVec3::new(3.0 * i, 2.5 * (i * 2.4 % 6.0), 0.0);
                [foot, foot + DVec3::new(1.0 + 0.3 * i, 1.0, 1.0 + i)]
            })
            .collect();
        let mut scene = boxes(&ends);
        assert_eq!(things(&scene).len(), 6);
        let [low, high] = scene.bounds();
        let upright = standing(&scene, low, high - low);
        assert!(upright.z > 0.8 && upright.y.abs() < 0.2, "{upright}");
        // Hung from a ceiling they say the contrary.
        scene
            .positions
            .iter_mut()
            .for_each(|place| place.z = -place.z);
        let [low, high] = scene.bounds();
        assert!(standing(&scene, low, high - low).z < -0.8);
        let two = boxes(&ends[..2]);
        assert_eq!(
            standing(&two, DVec3::ZERO, DVec3::splat(9.0)),
            DVec3::ZERO,
            "too few"
        );
    }
}
