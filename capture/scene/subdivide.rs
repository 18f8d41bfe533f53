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
