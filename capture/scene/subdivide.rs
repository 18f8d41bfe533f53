//! Cutting long edges, so that light at vertices can follow shadows.

use crate::scene::{Scene, Triangle};
use glam::DVec3;
use std::collections::HashMap;

/// A triangle is cut at most this often in a row: edges of 2^16 times the wished length.
const DEEPEST: u32 = 32;

/// Cuts triangles until no edge is longer than `edge_m`, metres. Whether an edge is cut depends on
/// its length alone and it is cut in the middle, so triangles that share vertices keep sharing
/// them: no T-junctions arise.
///
/// Returns for each triangle the index of its first piece, and at the end the number of pieces;
/// nothing if there would be more than `most` triangles.
pub fn subdivide(scene: &mut Scene, edge_m: f64, most: usize) -> Option<Vec<u32>> {
    let mut cutter = Cutter {
        scene,
        edge_m,
        middles: HashMap::new(),
    };
    let sources = std::mem::take(&mut cutter.scene.triangles);
    let mut firsts = Vec::with_capacity(sources.len() + 1);
    let mut pieces = Vec::with_capacity(sources.len());
    for source in &sources {
        firsts.push(pieces.len() as u32);
        let mut open = vec![(source.vertices, 0)];
        while let Some((vertices, depth)) = open.pop() {
            match cutter.cut(vertices) {
                Some(children) if depth < DEEPEST => {
                    open.extend(children.into_iter().rev().map(|c| (c, depth + 1)));
                }
                _ => pieces.push(Triangle {
                    vertices,
                    material: source.material,
                }),
            }
            if pieces.len() + open.len() > most {
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
    /// The vertex in the middle of an edge, by its ends in ascending order.
    middles: HashMap<[u32; 2], u32>,
}

impl Cutter<'_> {
    fn position(&self, vertex: u32) -> DVec3 {
        self.scene.positions[vertex as usize]
    }

    /// The middle of an edge if it is too long. The length is the same from either end: the
    /// difference only changes its sign.
    fn middle_of_long(&mut self, a: u32, b: u32) -> Option<u32> {
        (self.position(a).distance(self.position(b)) > self.edge_m).then(|| self.middle(a, b))
    }

    fn middle(&mut self, a: u32, b: u32) -> u32 {
        let key = [a.min(b), a.max(b)];
        if let Some(&known) = self.middles.get(&key) {
            return known;
        }
        let middle = (self.position(key[0]) + self.position(key[1])) / 2.0;
        let new = self.scene.vertex_between(key, middle, 0.5);
        self.middles.insert(key, new);
        new
    }

    /// The pieces of a triangle with a long edge.
    fn cut(&mut self, [a, b, c]: [u32; 3]) -> Option<Vec<[u32; 3]>> {
        let middles = [
            self.middle_of_long(a, b),
            self.middle_of_long(b, c),
            self.middle_of_long(c, a),
        ];
        let corners = [a, b, c];
        match middles {
            [None, None, None] => None,
            [Some(ab), Some(bc), Some(ca)] => {
                Some(vec![[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])
            }
            _ => {
                // Turned so that the edge (p, q) is long and, if two are, (q, r) too.
                let long = middles.map(|middle| middle.is_some());
                let first = (0..3).find(|&i| long[i] && !long[(i + 2) % 3]).unwrap_or(0);
                let [p, q, r] = [0, 1, 2].map(|i| corners[(first + i) % 3]);
                let pq = middles[first]?;
                match middles[(first + 1) % 3] {
                    None => Some(vec![[p, pq, r], [pq, q, r]]),
                    Some(qr) => {
                        // The shorter diagonal of what is left beside the corner q.
                        let [across, along] = [(pq, r), (p, qr)]
                            .map(|(s, t)| self.position(s).distance_squared(self.position(t)));
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
