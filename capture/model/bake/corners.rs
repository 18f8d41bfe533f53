//! Vertices that have one light each.

use glam::Vec3;
use headbox_scene::scene::{Scene, Triangle};

/// Triangles around a vertex without a normal share its light where their normals differ by no more
/// than this: the cosine of 30 degrees.
const SMOOTH_COSINE: f32 = 0.866;

/// Vertices with one normal each, and the triangles around each.
pub(super) struct Corners {
    /// Unit normals toward the front.
    pub(super) normals: Vec<Vec3>,
    /// Index in `around` of each vertex's first triangle.
    first: Vec<u32>,
    /// Triangle and corner.
    around: Vec<(u32, u8)>,
}

impl Corners {
    /// The triangles around a vertex, and which of their corners it is.
    pub(super) fn around(&self, vertex: usize) -> &[(u32, u8)] {
        &self.around[self.first[vertex] as usize..self.first[vertex + 1] as usize]
    }
}

/// Gives every vertex one normal: its own, or, where the scene has none for it, that of the
/// triangles around it; triangles that meet there at an angle get vertices of their own.
pub(super) fn separate_creases(scene: &mut Scene) -> Corners {
    let originals = scene.positions.len();
    let has_normal =
        |scene: &Scene, vertex: usize| scene.normals.get(vertex).is_some_and(|n| *n != Vec3::ZERO);
    let mut normals: Vec<Vec3> = (0..originals)
        .map(|v| {
            if has_normal(scene, v) {
                scene.normals[v]
            } else {
                Vec3::ZERO
            }
        })
        .collect();
    // Further vertices at the place of one that stands at a crease: a list through `next`.
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
                        let copy = duplicate(scene, vertex as usize);
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

/// Adds a copy of a vertex.
fn duplicate(scene: &mut Scene, vertex: usize) -> u32 {
    scene.positions.push(scene.positions[vertex]);
    if let Some(&normal) = scene.normals.get(vertex) {
        scene.normals.push(normal);
    }
    if let Some(&texcoord) = scene.texcoords.get(vertex) {
        scene.texcoords.push(texcoord);
    }
    if let Some(&color) = scene.colors.get(vertex) {
        scene.colors.push(color);
    }
    scene.positions.len() as u32 - 1
}

/// For each vertex the triangles around it, by counting sort.
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
            let place = &mut next[vertex as usize];
            around[*place as usize] = (index, corner);
            *place += 1;
        }
    }
    (first, around)
}
