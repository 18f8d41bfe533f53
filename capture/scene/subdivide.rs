//! Subdivision of triangles with long edges, so that light baked into vertices resolves shadows.

use crate::scene::{Scene, Triangle};
use std::collections::HashMap;

/// Maximum depth of subdivision: enough for edges of 2^16 times the maximum length.
const MAX_DEPTH: u32 = 32;

/// Cuts triangles until no edge is longer than `edge_m`, metres. An edge is cut by its length alone
/// and in its middle, so that triangles that share vertices keep sharing them: no T-junctions
/// arise.
///
/// Returns the index of the first piece of each triangle, then the number of pieces; `None` if
/// there would be more than `max_triangles`.
pub fn subdivide(scene: &mut Scene, edge_m: f64, max_triangles: usize) -> Option<Vec<u32>> {
    let mut cutter = Cutter {
        scene,
        edge_m,
        midpoints: HashMap::new(),
    };
    let sources = std::mem::take(&mut cutter.scene.triangles);
    let mut firsts = Vec::with_capacity(sources.len() + 1);
    let mut pieces = Vec::with_capacity(sources.len());
    for source in &sources {
        firsts.push(pieces.len() as u32);
        let mut open = vec![(source.vertices, 0)];
        while let Some((vertices, depth)) = open.pop() {
            match cutter.cut(vertices) {
                Some(children) if depth < MAX_DEPTH => {
                    open.extend(children.into_iter().rev().map(|c| (c, depth + 1)));
                }
                _ => pieces.push(Triangle {
                    vertices,
                    material: source.material,
                }),
            }
            if pieces.len() + open.len() > max_triangles {
                return None;
            }
        }
    }
    firsts.push(pieces.len() as u32);
    scene.triangles = pieces;
    Some(firsts)
}

/// Returns a number of pieces that [`subdivide`] reaches at least.
pub fn least_pieces(scene: &Scene, edge_m: f64) -> f64 {
    /// Less than 1 by far more than the rounding error of lengths and areas.
    const SLACK: f64 = 1.0 - 1e-6;
    let of_triangle = |triangle: u32| {
        let [a, b, c] = scene.corners(triangle);
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let area = (b - a).cross(c - a).length() / 2.0;
        // Each part of the longest edge is in a piece of its own; no piece is larger than an
        // equilateral triangle.
        let by_edge = longest / edge_m;
        let by_area = area / (3_f64.sqrt() / 4.0 * edge_m * edge_m);
        (by_edge.max(by_area) * SLACK).max(1.0)
    };
    (0..scene.triangles.len() as u32).map(of_triangle).sum()
}

struct Cutter<'a> {
    scene: &'a mut Scene,
    edge_m: f64,
    /// Vertex in the middle of each cut edge, by its ends in ascending order.
    midpoints: HashMap<[u32; 2], u32>,
}

impl Cutter<'_> {
    /// Returns the midpoint of an edge if it is too long.
    fn midpoint_if_long(&mut self, a: u32, b: u32) -> Option<u32> {
        let ends = [a.min(b), a.max(b)];
        let [start, end] = ends.map(|vertex| self.scene.positions[vertex as usize]);
        (start.distance(end) > self.edge_m).then(|| {
            let add = || self.scene.vertex_between(ends, (start + end) / 2.0, 0.5);
            *self.midpoints.entry(ends).or_insert_with(add)
        })
    }

    /// Returns the pieces of a triangle, or `None` if no edge is too long.
    fn cut(&mut self, [a, b, c]: [u32; 3]) -> Option<Vec<[u32; 3]>> {
        let midpoints = [
            self.midpoint_if_long(a, b),
            self.midpoint_if_long(b, c),
            self.midpoint_if_long(c, a),
        ];
        let corners = [a, b, c];
        match midpoints {
            [None, None, None] => None,
            [Some(ab), Some(bc), Some(ca)] => {
                Some(vec![[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])
            }
            _ => {
                // Rotated so that the edge (p, q) is long and, if two are, (q, r) too.
                let long = midpoints.map(|midpoint| midpoint.is_some());
                let first = (0..3).find(|&i| long[i] && !long[(i + 2) % 3]).unwrap_or(0);
                let [p, q, r] = [0, 1, 2].map(|i| corners[(first + i) % 3]);
                let pq = midpoints[first]?;
                match midpoints[(first + 1) % 3] {
                    None => Some(vec![[p, pq, r], [pq, q, r]]),
                    Some(qr) => {
                        // The shorter diagonal of the quadrilateral without the corner q.
                        let [across, along] = [[pq, r], [p, qr]].map(|diagonal| {
                            let [s, t] = diagonal.map(|v| self.scene.positions[v as usize]);
                            s.distance_squared(t)
                        });
                        Some(if across <= along {
                            vec![[pq, q, qr], [pq, qr, r], [p, pq, r]]
                        } else {
                            vec![[pq, q, qr], [p, pq, qr], [p, qr, r]]
                        })
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn least_pieces_is_below_number_of_pieces() {
        let triangle = |far: f64| Scene {
            positions: vec![DVec3::ZERO, DVec3::new(2.0, 0.3, 0.0), DVec3::Y * far],
            triangles: vec![Triangle {
                vertices: [0, 1, 2],
                material: 0,
            }],
            ..Scene::default()
        };
        for (far, edge_m) in [(1.0, 0.1), (50.0, 0.2), (1.0, 9.0), (3.0, f64::INFINITY)] {
            let mut scene = triangle(far);
            let least = least_pieces(&scene, edge_m);
            subdivide(&mut scene, edge_m, 1_000_000).expect("few");
            let pieces = scene.triangles.len() as f64;
            assert!(
                (pieces / 40.0..=pieces).contains(&least),
                "{least} {pieces}"
            );
        }
        // No attempt is needed to see that a far vertex exceeds any limit.
        assert!(least_pieces(&triangle(2e8), 0.1) > 1e9);
    }
}
