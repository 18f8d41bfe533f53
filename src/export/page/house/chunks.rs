//! Encoding of a cell's surfaces in chunks that a page draws at once, as bytes that deflate well
//! (`mesh.js`, its counterpart).
//!
//! A chunk has at most 65,536 vertices, so that corners take two bytes. Each array is stored as
//! byte planes (all lowest bytes, then the next, and so on), one array after the other:
//!
//! ```text
//! corners     u16 three a triangle: distance back from the first vertex that no corner has used yet
//! positions   i32 x, then y, then z: steps of POSITION_STEP_M, each the zigzag of its difference from the previous vertex
//! colours     u16 red, then green, then blue: binary16, likewise
//! texcoords   u32 u, then v: binary32, likewise; only where a material has a texture
//! ```

use crate::page::{byte_planes, zigzag};
use exr::prelude::f16;
use glam::{DVec3, Vec2, Vec3};
use headbox_house::house::House;
use headbox_scene::material::Material;
use headbox_scene::scene::Scene;
use rayon::prelude::*;
use std::collections::HashMap;

/// Resolution of positions, metres: finer than any frame shows. Positions up to 32 km away fit in
/// 32 bits.
pub(super) const POSITION_STEP_M: f64 = 1.0 / 65_536.0;

/// Maximum number of triangles of a chunk: few enough that a page can cull chunks, and that corner
/// indices fit in 16 bits.
const CHUNK_TRIANGLES: usize = 16_384;

/// Part of a cell's surfaces.
pub(super) struct Chunk {
    pub(super) cell: u32,
    /// Lowest and highest corner of its bounding box, metres from the house's origin.
    pub(super) bounds: [DVec3; 2],
    /// Materials with their numbers of successive triangles.
    pub(super) runs: Vec<(u32, usize)>,
    pub(super) vertices: usize,
    pub(super) triangles: usize,
    pub(super) textured: bool,
    pub(super) bytes: Vec<u8>,
}

impl Chunk {
    /// Returns the materials of its triangles.
    pub(super) fn materials(&self) -> impl Iterator<Item = u32> + '_ {
        self.runs.iter().map(|(material, _)| *material)
    }
}

/// Encodes all surfaces of a house, cell by cell.
pub(super) fn chunks(house: &House) -> Vec<Chunk> {
    split_house(house, CHUNK_TRIANGLES)
}

/// Same as [`chunks`] with at most `most` triangles per chunk.
fn split_house(house: &House, most: usize) -> Vec<Chunk> {
    let (scene, origin) = (house.scene(), house.mesh().origin());
    let mut pieces = Vec::new();
    for (cell, plan_cell) in (0..).zip(&house.plan().cells) {
        let end = plan_cell.triangles.end.min(scene.triangles.len() as u32);
        let drawn: Vec<u32> = (plan_cell.triangles.start..end)
            .filter(|triangle| is_in_range(scene, origin, *triangle))
            .collect();
        split(scene, drawn, most, &mut |piece| pieces.push((cell, piece)));
    }
    pieces
        .into_par_iter()
        .map(|(cell, piece)| encode(scene, origin, cell, piece))
        .collect()
}

/// Returns true if a triangle's positions fit in 32 bits.
fn is_in_range(scene: &Scene, origin: DVec3, triangle: u32) -> bool {
    let limit = f64::from(i32::MAX / 2) * POSITION_STEP_M;
    scene
        .corners(triangle)
        .iter()
        .all(|p| (*p - origin).abs().max_element() < limit)
}

/// Splits triangles in halves along the longest axis of their centroids' bounding box until they
/// are few enough. Both halves keep the order of triangles, so that of two coplanar ones the same
/// one shows as in other frames.
fn split(scene: &Scene, triangles: Vec<u32>, most: usize, put: &mut dyn FnMut(Vec<u32>)) {
    if triangles.len() <= most {
        if !triangles.is_empty() {
            put(triangles);
        }
        return;
    }
    let centroid = |triangle: u32| scene.corners(triangle).iter().sum::<DVec3>();
    let [low, high] = bounds(triangles.iter().map(|triangle| centroid(*triangle)));
    let extent = high - low;
    let axis = (0..3).fold(0, |longest, axis| {
        if extent[axis] > extent[longest] {
            axis
        } else {
            longest
        }
    });
    let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
    let along = |i: &u32| centroid(triangles[*i as usize])[axis];
    order.sort_by(|a, b| along(a).total_cmp(&along(b)));
    let (first, second) = order.split_at(order.len() / 2);
    for half in [first, second] {
        let mut half = half.to_vec();
        half.sort_unstable();
        split(
            scene,
            half.iter().map(|i| triangles[*i as usize]).collect(),
            most,
            put,
        );
    }
}

fn bounds(points: impl Iterator<Item = DVec3>) -> [DVec3; 2] {
    points.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| {
        [low.min(p), high.max(p)]
    })
}

fn encode(scene: &Scene, origin: DVec3, cell: u32, mut piece: Vec<u32>) -> Chunk {
    let triangle_material = |triangle: &u32| scene.triangles[*triangle as usize].material;
    let mut order: Vec<u32> = Vec::new();
    for material in piece.iter().map(triangle_material) {
        if !order.contains(&material) {
            order.push(material);
        }
    }
    piece.sort_by_key(|triangle| {
        order
            .iter()
            .position(|material| *material == triangle_material(triangle))
    });
    let runs: Vec<(u32, usize)> = piece
        .chunk_by(|a, b| triangle_material(a) == triangle_material(b))
        .map(|run| (triangle_material(&run[0]), run.len()))
        .collect();
    let textured = runs.iter().any(|(material, _)| {
        scene
            .materials
            .get(*material as usize)
            .is_some_and(is_textured)
    });

    let mut known: HashMap<u32, usize> = HashMap::new();
    let (mut vertices, mut corners) = (Vec::new(), Vec::with_capacity(piece.len() * 3));
    for vertex in piece
        .iter()
        .flat_map(|triangle| scene.triangles[*triangle as usize].vertices)
    {
        let next = vertices.len();
        let number = *known.entry(vertex).or_insert(next);
        if number == next {
            vertices.push(vertex as usize);
        }
        corners.push((next - number) as u32);
    }
    let mut bytes = byte_planes(&corners, 2);
    let steps = |vertex: &usize| ((scene.positions[*vertex] - origin) / POSITION_STEP_M).round();
    for axis in 0..3 {
        bytes.extend(byte_planes(
            &zigzag_differences(vertices.iter().map(|vertex| steps(vertex)[axis] as i32)),
            4,
        ));
    }
    let color = |vertex: &usize| scene.colors.get(*vertex).copied().unwrap_or(Vec3::ONE);
    for channel in 0..3 {
        let halves = vertices
            .iter()
            .map(|vertex| i32::from(f16::from_f32(color(vertex)[channel].max(0.0)).to_bits()));
        bytes.extend(byte_planes(&zigzag_differences(halves), 2));
    }
    let texcoord = |vertex: &usize| scene.texcoords.get(*vertex).copied().unwrap_or(Vec2::ZERO);
    for axis in (0..2).filter(|_| textured) {
        bytes.extend(byte_planes(
            &zigzag_differences(
                vertices
                    .iter()
                    .map(|vertex| texcoord(vertex)[axis].to_bits() as i32),
            ),
            4,
        ));
    }
    let bounds = bounds(
        vertices
            .iter()
            .map(|vertex| scene.positions[*vertex] - origin),
    );
    Chunk {
        cell,
        bounds,
        runs,
        vertices: vertices.len(),
        triangles: piece.len(),
        textured,
        bytes,
    }
}

fn is_textured(material: &Material) -> bool {
    material
        .albedo_texture
        .or(material.emission_texture)
        .is_some()
        || material.cutout.is_some()
}

/// Returns the wrapping differences between successive numbers, with the sign in the lowest bit.
fn zigzag_differences(numbers: impl Iterator<Item = i32>) -> Vec<u32> {
    let mut previous = 0i32;
    numbers
        .map(|number| zigzag(number.wrapping_sub(std::mem::replace(&mut previous, number))))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads arrays as `mesh.js` does.
    struct Reader<'a> {
        bytes: &'a [u8],
        at: usize,
    }

    impl Reader<'_> {
        fn numbers(&mut self, count: usize, width: usize) -> Vec<u32> {
            let from = &self.bytes[self.at..self.at + count * width];
            self.at += count * width;
            (0..count)
                .map(|i| {
                    (0..width)
                        .map(|k| u32::from(from[k * count + i]) << (8 * k))
                        .sum()
                })
                .collect()
        }

        fn sums(&mut self, count: usize, width: usize) -> Vec<i32> {
            let mut sum = 0i32;
            let add = |zigzag: u32| {
                sum = sum.wrapping_add((zigzag >> 1) as i32 ^ -((zigzag & 1) as i32));
                sum
            };
            self.numbers(count, width).into_iter().map(add).collect()
        }
    }

    /// Triangle of a page: its material; corners in steps, colours and texture coordinates, all as
    /// bits.
    type PageTriangle = (u32, [([i32; 3], [u32; 3], [u32; 2]); 3]);

    fn read(chunk: &Chunk) -> Vec<PageTriangle> {
        let mut reader = Reader {
            bytes: &chunk.bytes,
            at: 0,
        };
        let mut next = 0;
        let name = |back: u32| {
            let number = next - back as usize;
            next += usize::from(back == 0);
            number
        };
        let corners: Vec<usize> = reader
            .numbers(chunk.triangles * 3, 2)
            .into_iter()
            .map(name)
            .collect();
        let positions = [0; 3].map(|_: i32| reader.sums(chunk.vertices, 4));
        let colors = [0; 3].map(|_: i32| reader.sums(chunk.vertices, 2));
        let texcoords = if chunk.textured {
            [0; 2].map(|_: i32| reader.sums(chunk.vertices, 4))
        } else {
            [0; 2].map(|_: i32| vec![0; chunk.vertices])
        };
        assert_eq!(reader.at, chunk.bytes.len());
        let vertex = |v: usize| {
            (
                [0, 1, 2].map(|i| positions[i][v]),
                [0, 1, 2].map(|i| colors[i][v] as u32),
                [0, 1].map(|i| texcoords[i][v] as u32),
            )
        };
        let mut materials = chunk
            .runs
            .iter()
            .flat_map(|(material, count)| std::iter::repeat_n(*material, *count));
        corners
            .chunks(3)
            .map(|c| {
                (
                    materials.next().expect("a run"),
                    [vertex(c[0]), vertex(c[1]), vertex(c[2])],
                )
            })
            .collect()
    }

    #[test]
    fn triangles_round_trip_through_page() {
        let mut model = headbox_scenes::house(0, 6_000);
        model.repair();
        let house = House::new(model).expect("a house");
        let (scene, origin) = (house.scene(), house.mesh().origin());
        let all = split_house(&house, 100);
        assert!(
            all.len() > 2 * house.plan().cells.len(),
            "{} pieces",
            all.len()
        );
        assert!(
            all.iter()
                .all(|chunk| chunk.triangles <= 100 && chunk.vertices <= 300)
        );
        let textured: HashMap<u32, bool> = (0..)
            .zip(&scene.materials)
            .map(|(number, material)| (number, is_textured(material)))
            .collect();
        let plain = |(material, corners): PageTriangle| {
            let keep = textured[&material];
            (
                material,
                corners.map(|(p, c, t)| (p, c, if keep { t } else { [0; 2] })),
            )
        };
        let mut found: Vec<PageTriangle> = all.iter().flat_map(read).map(plain).collect();
        let vertex = |v: u32| {
            let position = ((scene.positions[v as usize] - origin) / POSITION_STEP_M).round();
            let color = scene.colors.get(v as usize).copied().unwrap_or(Vec3::ONE);
            let texcoord = scene.texcoords.get(v as usize).copied().unwrap_or_default();
            (
                position.to_array().map(|c| c as i32),
                color
                    .to_array()
                    .map(|c| u32::from(f16::from_f32(c).to_bits())),
                texcoord.to_array().map(f32::to_bits),
            )
        };
        let mut expected: Vec<PageTriangle> = scene
            .triangles
            .iter()
            .map(|t| plain((t.material, t.vertices.map(vertex))))
            .collect();
        found.sort_unstable();
        expected.sort_unstable();
        assert!(
            found == expected,
            "{} triangles of {}",
            found.len(),
            expected.len()
        );
    }
}
