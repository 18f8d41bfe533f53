//! Subdivision of triangles with long edges, so that light baked into vertices resolves shadows.

use crate::scene::{Scene, Triangle};
use glam::DVec3;
use std::collections::HashMap;

/// Maximum depth of subdivision: enough for edges of 2^16 times the maximum length.
const MAX_DEPTH: u32 = 32;

/// Cuts triangles until no edge is longer than `edge_m`, metres. An edge is cut by its length alone
/// and in its middle, so that triangles that share vertices keep sharing them: no T-junctions
/// arise.
///
/// Returns the index of the first piece of each triangle, then the number of pieces.
pub fn subdivide(scene: &mut Scene, edge_m: f64) -> Vec<u32> {
    // Vertex in the middle of each cut edge, by its ends in ascending order.
    let mut midpoints = HashMap::new();
    let sources = std::mem::take(&mut scene.triangles);
    let mut firsts = Vec::with_capacity(sources.len() + 1);
    let mut pieces = Vec::with_capacity(sources.len());
    for source in &sources {
        firsts.push(pieces.len() as u32);
        let mut open = vec![(source.vertices, 0)];
        while let Some((vertices, depth)) = open.pop() {
            let corners = vertices.map(|vertex| scene.positions[vertex as usize]);
            let children = cut(corners, edge_m, depth);
            if children[0].is_none() {
                pieces.push(Triangle {
                    vertices,
                    material: source.material,
                });
                continue;
            }
            let [a, b, c] = vertices;
            let mut points = [a, b, c, 0, 0, 0];
            for (i, (a, b)) in EDGES.into_iter().enumerate() {
                if corners[a].distance(corners[b]) > edge_m {
                    let ends = [vertices[a].min(vertices[b]), vertices[a].max(vertices[b])];
                    let add = || scene.vertex_between(ends, middle(corners[a], corners[b]), 0.5);
                    points[3 + i] = *midpoints.entry(ends).or_insert_with(add);
                }
            }
            let children = children.into_iter().flatten().rev();
            open.extend(children.map(|child| (child.map(|point| points[point]), depth + 1)));
        }
    }
    firsts.push(pieces.len() as u32);
    scene.triangles = pieces;
    firsts
}

/// Returns true if [`subdivide`] makes at most `max_triangles` pieces. Adds no vertices, which take
/// most of its time.
pub fn has_few_pieces(scene: &Scene, edge_m: f64, max_triangles: usize) -> bool {
    let mut pieces = 0;
    let mut open = Vec::new();
    for triangle in 0..scene.triangles.len() as u32 {
        let corners = scene.corners(triangle);
        let longest = EDGES.map(|(a, b)| corners[a].distance(corners[b]));
        let longest = longest.into_iter().fold(0.0, f64::max);
        // Each part of this edge is in a piece of its own.
        if longest > edge_m * max_triangles as f64 {
            return false;
        }
        open.push((corners, 0));
        while let Some((corners, depth)) = open.pop() {
            let children = cut(corners, edge_m, depth);
            if children[0].is_none() {
                pieces += 1;
            }
            let middles = EDGES.map(|(a, b)| middle(corners[a], corners[b]));
            let point = |point: usize| {
                if point < 3 {
                    corners[point]
                } else {
                    middles[point - 3]
                }
            };
            let children = children.into_iter().flatten();
            open.extend(children.map(|child| (child.map(point), depth + 1)));
            if pieces + open.len() > max_triangles {
                return false;
            }
        }
    }
    true
}

/// Corners at the ends of a triangle's edges.
const EDGES: [(usize, usize); 3] = [(0, 1), (1, 2), (2, 0)];

fn middle(a: DVec3, b: DVec3) -> DVec3 {
    (a + b) / 2.0
}

/// A part of a triangle, by its points: 0 to 2 are the triangle's corners, 3 to 5 the middles of
/// its edges.
type Piece = [usize; 3];

/// Cuts the edges of a triangle that are too long; returns no piece if none is.
fn cut(corners: [DVec3; 3], edge_m: f64, depth: u32) -> [Option<Piece>; 4] {
    let long = EDGES.map(|(a, b)| corners[a].distance(corners[b]) > edge_m);
    if long == [false; 3] || depth >= MAX_DEPTH {
        return [None; 4];
    }
    if long == [true; 3] {
        return [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]].map(Some);
    }
    // Rotated so that the edge (p, q) is long and, if two are, (q, r) too.
    let first = (0..3).find(|&i| long[i] && !long[(i + 2) % 3]).unwrap_or(0);
    let [p, q, r] = [0, 1, 2].map(|i| (first + i) % 3);
    let [pq, qr] = [p, q].map(|edge| 3 + edge);
    if !long[q] {
        return [Some([p, pq, r]), Some([pq, q, r]), None, None];
    }
    // The shorter diagonal of the quadrilateral without the corner q.
    let across = middle(corners[p], corners[q]).distance_squared(corners[r]);
    let along = corners[p].distance_squared(middle(corners[q], corners[r]));
    let halves = if across <= along {
        [[pq, qr, r], [p, pq, r]]
    } else {
        [[p, pq, qr], [p, qr, r]]
    };
    [Some([pq, q, qr]), Some(halves[0]), Some(halves[1]), None]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_few_up_to_their_number() {
        let triangle = |far: f64| Scene {
            positions: vec![DVec3::ZERO, DVec3::new(2.0, 0.3, 0.0), DVec3::Y * far],
            triangles: vec![Triangle {
                vertices: [0, 1, 2],
                material: 0,
            }],
            ..Scene::default()
        };
        for (far, edge_m) in [(1.0, 0.1), (50.0, 0.2), (1.0, 9.0), (3.0, f64::INFINITY)] {
            let source = triangle(far);
            let mut scene = source.clone();
            let firsts = subdivide(&mut scene, edge_m);
            let pieces = scene.triangles.len();
            assert_eq!(firsts, [0, pieces as u32]);
            assert!(has_few_pieces(&source, edge_m, pieces));
            assert!(!has_few_pieces(&source, edge_m, pieces - 1));
        }
        assert!(!has_few_pieces(&triangle(2e8), 0.1, 1_000_000));
    }
}
