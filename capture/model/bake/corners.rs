//! Vertices with one normal each, so that each can store one irradiance.

use glam::Vec3;
use headbox_scene::scene::{Scene, Triangle};

/// Cosine of the maximum angle, 30 degrees, between the normals of triangles that share a vertex
/// without a normal of its own.
const SMOOTH_COSINE: f32 = 0.866;

/// Vertices with one normal each, and the triangles around each.
pub(super) struct Corners {
    /// Unit normals toward the front.
    pub(super) normals: Vec<Vec3>,
    /// Index in `around` of each vertex's first triangle.
    first: Vec<u32>,
    /// Triangles around each vertex, and the index of the vertex among the triangle's corners.
    around: Vec<(u32, u8)>,
}

impl Corners {
    /// Returns the triangles around a vertex, and its index among the corners of each.
    pub(super) fn around(&self, vertex: usize) -> &[(u32, u8)] {
        &self.around[self.first[vertex] as usize..self.first[vertex + 1] as usize]
    }
}

/// Gives each vertex one normal: its own, or, if it has none, that of the triangles around it.
/// Triangles that meet at a crease get separate vertices.
pub(super) fn separate_creases(scene: &mut Scene) -> Corners {
    let originals = scene.positions.len();
    let has_normal =
        |scene: &Scene, vertex: usize| scene.normals.get(vertex).is_some_and(|n| *n != Vec3::ZERO);
    let mut normals = scene.normals.clone();
    normals.resize(originals, Vec3::ZERO);
    // Linked lists of the vertices at the position of one on a crease.
    let mut next: Vec<Option<u32>> = vec![None; originals];
    for triangle in 0..scene.triangles.len() {
        let face = scene.geometric_normal(triangle as u32);
        for corner in 0..3 {
            let mut vertex = scene.triangles[triangle].vertices[corner];
            if has_normal(scene, vertex as usize) {
                continue;
            }
            loop {
                let normal = &mut normals[vertex as usize];
                if *normal == Vec3::ZERO {
                    *normal = face;
                }
                if normal.dot(face) >= SMOOTH_COSINE {
                    break;
                }
                vertex = match next[vertex as usize] {
                    Some(other) => other,
                    None => {
                        let copy = scene.add_vertex(scene.vertex(vertex));
                        next[vertex as usize] = Some(copy);
                        next.push(None);
                        normals.push(Vec3::ZERO);
                        copy
                    }
                };
            }
            scene.triangles[triangle].vertices[corner] = vertex;
        }
    }
    let (first, around) = around_vertices(&scene.triangles, scene.positions.len());
    Corners {
        normals,
        first,
        around,
    }
}

/// Sorts triangles by vertex (counting sort): returns the start of each vertex's entries and the
/// entries, a triangle and the index of its corner.
fn around_vertices(triangles: &[Triangle], vertices: usize) -> (Vec<u32>, Vec<(u32, u8)>) {
    let mut first = vec![0_u32; vertices + 1];
    for vertex in triangles.iter().flat_map(|t| t.vertices) {
        first[vertex as usize + 1] += 1;
    }
    for i in 0..vertices {
        first[i + 1] += first[i];
    }
    let mut next = first.clone();
    let mut around = vec![(0, 0); triangles.len() * 3];
    for (index, triangle) in (0_u32..).zip(triangles) {
        for (corner, vertex) in (0_u8..).zip(triangle.vertices) {
            let entry = &mut next[vertex as usize];
            around[*entry as usize] = (index, corner);
            *entry += 1;
        }
    }
    (first, around)
}
