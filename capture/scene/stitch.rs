//! Removes T-junctions, at which rasterised meshes crack.
//!
//! Scenes are full of corners that lie on an edge of another triangle: a wall's foot on a floor, a
//! panel around a door, a triangle cut at the border of a cell next to one that was not. A
//! rasteriser snaps corners to its grid, so that single pixels along such an edge show the
//! background. Such edges are split here (docs/decisions/0023).

use crate::scene::{Scene, Triangle, Vertex};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Maximum distance from an edge of a corner that lies on it, metres: more than the rounding in
/// files, less than modelled detail.
const ON_EDGE_M: f64 = 2e-4;
/// Minimum size of a grid cell, metres. Usually it is the mean length of edges.
const MIN_CELL_M: f64 = 5e-3;

impl Scene {
    /// Splits edges at the corners that lie on them. The appearance of surfaces stays, because the
    /// attributes of new vertices are interpolated along the edge.
    ///
    /// Returns the index of the first piece of each triangle, then the number of pieces.
    pub fn stitch(&mut self) -> Vec<u32> {
        let corners = CornerGrid::new(self);
        let points_on_edges = corners.points_on_edges(self);
        let mut stitcher = Stitcher {
            scene: self,
            corners,
            points_on_edges,
            new_vertices: HashMap::new(),
        };
        let sources = std::mem::take(&mut stitcher.scene.triangles);
        let mut pieces = Vec::with_capacity(sources.len());
        let mut firsts = Vec::with_capacity(sources.len() + 1);
        for source in &sources {
            firsts.push(pieces.len() as u32);
            stitcher.split(source, &mut pieces);
        }
        firsts.push(pieces.len() as u32);
        self.triangles = pieces;
        firsts
    }

    /// Adds a vertex at `position`, with attributes interpolated at `share` (0..1) of the way
    /// between two vertices. Returns its index.
    pub(crate) fn vertex_between(&mut self, ends: [u32; 2], position: DVec3, share: f32) -> u32 {
        let [a, b] = ends.map(|end| self.vertex(end));
        // A missing normal cannot be interpolated.
        let normal = if a.normal == Vec3::ZERO || b.normal == Vec3::ZERO {
            Vec3::ZERO
        } else {
            a.normal.lerp(b.normal, share).normalize_or_zero()
        };
        self.add_vertex(Vertex {
            position,
            normal,
            texcoord: a.texcoord.lerp(b.texcoord, share),
            emission_texcoord: a.emission_texcoord.lerp(b.emission_texcoord, share),
            color: a.color.lerp(b.color, share),
            opacity: a.opacity + (b.opacity - a.opacity) * share,
        })
    }
}

/// Distinct positions ("points") of a scene's vertices, in a uniform grid.
struct CornerGrid {
    /// Index of the point of each vertex.
    point_of_vertex: Vec<u32>,
    points: Vec<DVec3>,
    cell_m: f64,
    /// Points in each grid cell.
    cells: HashMap<[i64; 3], Vec<u32>>,
}

/// Indices of two points in ascending order.
type Edge = [u32; 2];

impl CornerGrid {
    fn new(scene: &Scene) -> Self {
        let corners = (0..scene.triangles.len() as u32).map(|triangle| scene.corners(triangle));
        let lengths = corners.flat_map(|[a, b, c]| [a.distance(b), b.distance(c), c.distance(a)]);
        let finite = lengths.filter(|length| length.is_finite());
        let (count, sum) = finite.fold((0_u32, 0.0), |(count, sum), length| {
            (count + 1, sum + length)
        });
        let cell_m = (sum / f64::from(count.max(1))).max(MIN_CELL_M);

        let mut known = HashMap::new();
        let mut points = Vec::new();
        let mut cells: HashMap<_, Vec<u32>> = HashMap::new();
        let mut point = |&p: &DVec3| {
            // Adding zero makes -0 and 0 the same bits.
            *known
                .entry((p + 0.0).to_array().map(f64::to_bits))
                .or_insert_with(|| {
                    let index = points.len() as u32;
                    points.push(p);
                    cells.entry(grid_cell(p, cell_m)).or_default().push(index);
                    index
                })
        };
        let point_of_vertex = scene.positions.iter().map(&mut point).collect();
        Self {
            point_of_vertex,
            points,
            cell_m,
            cells,
        }
    }

    fn edge(&self, a: u32, b: u32) -> Edge {
        let [a, b] = [a, b].map(|vertex| self.point_of_vertex[vertex as usize]);
        [a.min(b), a.max(b)]
    }

    /// Returns the edges with points on them, with these points in order from the first end.
    fn points_on_edges(&self, scene: &Scene) -> HashMap<Edge, Vec<u32>> {
        let sides = |triangle: &Triangle| {
            let [a, b, c] = triangle.vertices;
            [self.edge(a, b), self.edge(b, c), self.edge(c, a)]
        };
        let mut edges: Vec<Edge> = scene.triangles.par_iter().flat_map_iter(sides).collect();
        edges.par_sort_unstable();
        edges.dedup();
        edges
            .par_iter()
            .map(|&edge| (edge, self.points_on_edge(edge)))
            .filter(|(_, on)| !on.is_empty())
            .collect()
    }

    fn points_on_edge(&self, edge: Edge) -> Vec<u32> {
        let [a, b] = edge.map(|point| self.points[point as usize]);
        let length = a.distance(b);
        if length.is_nan() || length <= 2.0 * ON_EDGE_M {
            return Vec::new();
        }
        let along = (b - a) / length;
        let project = |point: u32| {
            let to = self.points[point as usize] - a;
            let t = to.dot(along);
            let inside = t > ON_EDGE_M && t < length - ON_EDGE_M;
            (inside && (to - along * t).length() <= ON_EDGE_M).then_some((t, point))
        };
        let mut on: Vec<(f64, u32)> = self.candidates(a, b, length).filter_map(project).collect();
        on.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
        // One of several points that nearly coincide is enough; neighbouring steps share cells.
        on.dedup_by(|next, kept| next.0 - kept.0 <= ON_EDGE_M);
        on.into_iter().map(|(_, point)| point).collect()
    }

    /// Returns the points in the grid cells along an edge, some more than once.
    fn candidates(&self, a: DVec3, b: DVec3, length: f64) -> Box<dyn Iterator<Item = u32> + '_> {
        let steps = (length / self.cell_m).ceil().max(1.0);
        if steps > self.points.len() as f64 {
            return Box::new(0..self.points.len() as u32); // cheaper than so many cells
        }
        Box::new((0..steps as u32).flat_map(move |step| {
            let at = |step: u32| a.lerp(b, f64::from(step) / steps);
            let [p, q] = [at(step), at(step + 1)];
            let [low, high] = [p.min(q) - ON_EDGE_M, p.max(q) + ON_EDGE_M]
                .map(|corner| grid_cell(corner, self.cell_m));
            let cells = (low[0]..=high[0]).flat_map(move |x| {
                (low[1]..=high[1]).flat_map(move |y| (low[2]..=high[2]).map(move |z| [x, y, z]))
            });
            cells
                .filter_map(|cell| self.cells.get(&cell))
                .flatten()
                .copied()
        }))
    }
}

fn grid_cell(p: DVec3, cell_m: f64) -> [i64; 3] {
    (p / cell_m).floor().to_array().map(|x| x as i64)
}

struct Stitcher<'a> {
    scene: &'a mut Scene,
    corners: CornerGrid,
    points_on_edges: HashMap<Edge, Vec<u32>>,
    /// New vertices by the ends of their edge (vertices in ascending order) and their point; the
    /// triangles on both sides share them.
    new_vertices: HashMap<([u32; 2], u32), u32>,
}

impl Stitcher<'_> {
    /// Appends the pieces of a triangle that is split at the points on its edges.
    fn split(&mut self, source: &Triangle, pieces: &mut Vec<Triangle>) {
        let [a, b, c] = source.vertices;
        let on = |[p, q]: [u32; 2]| {
            let mut on = self
                .points_on_edges
                .get(&self.corners.edge(p, q))
                .cloned()
                .unwrap_or_default();
            if self.corners.point_of_vertex[p as usize] > self.corners.point_of_vertex[q as usize] {
                on.reverse();
            }
            on
        };
        let mut open = vec![(source.vertices, [on([a, b]), on([b, c]), on([c, a])])];
        while let Some((vertices, on)) = open.pop() {
            let Some(side) = (0..3).find(|&side| !on[side].is_empty()) else {
                pieces.push(Triangle {
                    vertices,
                    material: source.material,
                });
                continue;
            };
            let [p, q, r] = [0, 1, 2].map(|i| vertices[(side + i) % 3]);
            let [mut before, beside, last] = [0, 1, 2].map(|i| on[(side + i) % 3].clone());
            let mut after = before.split_off(before.len() / 2);
            let point = after.remove(0);
            if self.preserves_orientation([p, q, r], point) {
                let middle = self.vertex_on_edge(p, q, point);
                open.push(([middle, q, r], [after, beside, Vec::new()]));
                open.push(([p, middle, r], [before, Vec::new(), last]));
            } else {
                before.extend(after);
                open.push(([p, q, r], [before, beside, last]));
            }
        }
    }

    /// Returns true if both pieces of a triangle that is split on its first side keep its
    /// orientation. One of the pieces may flip if the triangle is thinner than [`ON_EDGE_M`].
    fn preserves_orientation(&self, corners: [u32; 3], point: u32) -> bool {
        let [p, q, r] = corners.map(|vertex| self.scene.positions[vertex as usize]);
        let v = self.corners.points[point as usize];
        let normal = (q - p).cross(r - p);
        [(v - p).cross(r - p), (q - v).cross(r - v)]
            .iter()
            .all(|piece| piece.dot(normal) > 0.0)
    }

    /// Returns the vertex at a point on the edge between two vertices.
    fn vertex_on_edge(&mut self, a: u32, b: u32, point: u32) -> u32 {
        let ends = [a.min(b), a.max(b)];
        let corners = &mut self.corners;
        *self.new_vertices.entry((ends, point)).or_insert_with(|| {
            let position = corners.points[point as usize];
            let [start, end] = ends.map(|end| self.scene.positions[end as usize]);
            let share = (position - start).length()
                / ((position - start).length() + (end - position).length());
            corners.point_of_vertex.push(point);
            self.scene.vertex_between(ends, position, share as f32)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subdivide::subdivide;

    /// Returns the number of corners inside an edge, by testing all pairs.
    fn t_junctions(scene: &Scene) -> usize {
        let corner = |vertex: u32| scene.positions[vertex as usize];
        let mut used: Vec<DVec3> = scene
            .triangles
            .iter()
            .flat_map(|t| t.vertices)
            .map(corner)
            .collect();
        used.sort_by(|p, q| p.to_array().partial_cmp(&q.to_array()).unwrap());
        used.dedup();
        let edges = scene
            .triangles
            .iter()
            .flat_map(|t| [[0, 1], [1, 2], [2, 0]].map(|edge| edge.map(|i| t.vertices[i])));
        let on_an_edge = |[a, b]: [u32; 2]| {
            let [a, b] = [corner(a), corner(b)];
            let lies_on = |&&p: &&DVec3| {
                let t = (p - a).dot(b - a) / (b - a).length_squared();
                let far = 2.0 * ON_EDGE_M;
                p.distance(a) > far
                    && p.distance(b) > far
                    && p.distance(a + (b - a) * t) < 1e-9
                    && t > 0.0
                    && t < 1.0
            };
            used.iter().filter(lies_on).count()
        };
        edges.map(on_an_edge).sum()
    }

    /// A square of 1 m from two triangles, and three triangles next to it with a corner on its
    /// edge.
    fn one_beside_two() -> Scene {
        let positions = [
            [0.0, 0.0],
            [1.0, 0.0],
            [1.0, 1.0],
            [0.0, 1.0],
            [1.0, 0.4],
            [2.0, 0.0],
            [2.0, 1.0],
        ];
        let triangles = [[0, 1, 2], [0, 2, 3], [1, 5, 4], [4, 5, 6], [4, 6, 2]];
        Scene {
            positions: positions.map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec(),
            texcoords: positions
                .map(|[x, y]| glam::Vec2::new(x as f32, y as f32))
                .to_vec(),
            triangles: triangles
                .map(|vertices| Triangle {
                    vertices,
                    material: 0,
                })
                .to_vec(),
            materials: vec![crate::material::Material::default()],
            ..Scene::default()
        }
    }

    fn area(scene: &Scene) -> f64 {
        let doubled = |t: u32| {
            let [a, b, c] = scene.corners(t);
            (b - a).cross(c - a).z
        };
        (0..scene.triangles.len() as u32).map(doubled).sum::<f64>() / 2.0
    }

    #[test]
    fn stitch_splits_edge_at_corner() {
        let mut scene = one_beside_two();
        assert_eq!(t_junctions(&scene), 1);
        let pieces = scene.stitch();
        assert_eq!(t_junctions(&scene), 0);
        assert_eq!(pieces, [0, 2, 3, 4, 5, 6]);
        assert_eq!(scene.triangles.len(), 6);
        assert!((area(&scene) - 2.0).abs() < 1e-12, "{}", area(&scene));
        // The new vertex has the interpolated texture coordinate of the square.
        let new = scene.positions.len() - 1;
        assert_eq!(scene.positions[new], DVec3::new(1.0, 0.4, 0.0));
        assert!((scene.texcoords[new] - glam::Vec2::new(1.0, 0.4)).length() < 1e-6);
        scene.validate().unwrap();
    }

    #[test]
    fn stitch_joins_uneven_subdivisions() {
        let mut scene = one_beside_two();
        subdivide(&mut scene, 0.15);
        assert!(t_junctions(&scene) > 5);
        let (before, vertices) = (scene.triangles.len(), scene.positions.len());
        let stitched = scene.stitch();
        assert_eq!(t_junctions(&scene), 0);
        assert!(
            scene.triangles.len() < before + 40,
            "{before} -> {}",
            scene.triangles.len()
        );
        assert!((area(&scene) - 2.0).abs() < 1e-9);
        assert_eq!(stitched.len(), before + 1);
        assert_eq!(*stitched.last().unwrap() as usize, scene.triangles.len());
        assert!(scene.positions.len() > vertices);
        // A second pass finds no T-junction.
        let triangles = scene.triangles.clone();
        scene.stitch();
        assert_eq!(scene.triangles, triangles);
    }

    #[test]
    fn stitch_of_extreme_triangles_terminates() {
        let mut scene = one_beside_two();
        // A sliver thinner than the tolerance with a corner of another triangle on it, an edge of
        // 1000 km, and NaN.
        let far = [
            [0.0, 0.0, 0.0],
            [1e6, 0.0, 0.0],
            [0.0, 1e6, 0.0],
            [0.5, 1e-4, 0.0],
            [f64::NAN, 0.0, 0.0],
        ];
        let first = scene.positions.len() as u32;
        scene.positions.extend(far.map(DVec3::from));
        scene
            .texcoords
            .resize(scene.positions.len(), glam::Vec2::ZERO);
        for vertices in [[0, 1, 2], [0, 3, 1], [0, 1, 4]] {
            scene.triangles.push(Triangle {
                vertices: vertices.map(|v| v + first),
                material: 0,
            });
        }
        let stitched = scene.stitch();
        assert_eq!(*stitched.last().unwrap() as usize, scene.triangles.len());
        assert_eq!(Scene::default().stitch(), [0]);
    }
}
