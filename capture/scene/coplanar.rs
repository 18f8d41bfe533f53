//! Overlapping triangles in one plane: a wall whose sides have different materials, a poster in the
//! plane of its wall.
//!
//! Rounding would decide which of them a ray meets first, so that the surface would be speckled
//! with both. Instead the ray meets one that faces it if there is one, and of several the last one
//! in the file, however each surface is triangulated.

use crate::scene::Scene;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Largest distance of triangles in one plane, relative to the distance of their corners from the
/// middle of the scene: a few steps of `f32`.
const DISTANCE_SHARE: f64 = 1.0 / 2_097_152.0;
/// Side of the cells of slopes in the search for equal planes.
const SLOPE_CELL: f64 = 1.0 / 256.0;
/// Side of the cells of offsets, relative to the size of the scene.
const OFFSET_CELL_SHARE: f64 = 1.0 / 1024.0;
/// Share of a cell's side from its border within which a plane counts to the next cell, too.
const BORDER: f64 = 1.0 / 16.0;
/// Difference of the components of a unit normal within which both may be the largest.
const TIE: f64 = 1e-4;
/// Number of triangles that are compared pairwise without being divided further.
const SMALL_GROUP: usize = 24;
/// Maximum number of divisions of a group in halves.
const MAX_DEPTH: usize = 40;
/// Maximum number of triangles that are stored for each triangle: the last ones in the file.
const MAX_PARTNERS: usize = 64;

/// Triangles of a scene that overlap others in one plane. Triangles with the same material and
/// orientation count only where a third triangle differs.
#[derive(Debug, Default)]
pub struct CoplanarTriangles {
    /// Overlapping triangles, sorted, each with the end of its run in `partners`.
    runs: Vec<(u32, u32)>,
    partners: Vec<u32>,
    /// Bit set of the overlapping triangles: a fast test at every hit, nearly always false.
    shared: Vec<u64>,
}

impl CoplanarTriangles {
    /// Finds the overlapping triangles of a scene. The result does not depend on the number of
    /// threads. Triangles with absent or infinite corners overlap none.
    pub fn find(scene: &Scene) -> Self {
        let is_valid = |primitive: &u32| {
            let vertices = scene.triangles[*primitive as usize].vertices;
            let positions = vertices.map(|vertex| scene.positions.get(vertex as usize));
            positions.iter().all(|p| p.is_some_and(|p| p.is_finite()))
        };
        let count = scene.triangles.len().min(u32::MAX as usize) as u32;
        let [low, high] = (0..count)
            .into_par_iter()
            .filter(is_valid)
            .flat_map_iter(|primitive| scene.corners(primitive))
            .map(|corner| [corner, corner])
            .reduce(
                || [DVec3::INFINITY, DVec3::NEG_INFINITY],
                |a, b| [a[0].min(b[0]), a[1].max(b[1])],
            );
        let planes = Planes {
            scene,
            middle: (low + high) / 2.0,
            offset_cell: (high - low).max_element().max(f64::MIN_POSITIVE) * OFFSET_CELL_SHARE,
        };
        let mut keys: Vec<(u64, u32)> = (0..count)
            .into_par_iter()
            .filter(is_valid)
            .fold(Vec::new, |mut keys, primitive| {
                planes.push_keys(primitive, &mut keys);
                keys
            })
            .reduce(Vec::new, |mut a, mut b| {
                a.append(&mut b);
                a
            });
        keys.par_sort_unstable();
        let groups: Vec<&[(u64, u32)]> = keys
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|group| group.len() > 1)
            .collect();
        let mut pairs: Vec<[u32; 2]> = groups
            .par_iter()
            .flat_map_iter(|group| planes.overlaps(group))
            .collect();
        pairs.par_sort_unstable();
        pairs.dedup();
        let mut found = Self {
            shared: if pairs.is_empty() {
                Vec::new()
            } else {
                vec![0; scene.triangles.len().div_ceil(64)]
            },
            ..Self::default()
        };
        for run in pairs.chunk_by(|a, b| a[0] == b[0]) {
            let primitive = run[0][0];
            let last = run.len().saturating_sub(MAX_PARTNERS);
            found
                .partners
                .extend(run[last..].iter().map(|pair| pair[1]));
            found.runs.push((primitive, found.partners.len() as u32));
            found.shared[primitive as usize / 64] |= 1 << (primitive % 64);
        }
        found
    }

    /// Returns true if no triangles overlap.
    pub fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// Returns the number of triangles that overlap one of another material.
    pub fn conflict_count(&self, scene: &Scene) -> usize {
        let material = |primitive: u32| scene.triangles[primitive as usize].material;
        let differs = |&&(primitive, _): &&(u32, u32)| {
            let mut partners = self.partners(primitive).iter();
            partners.any(|&partner| material(partner) != material(primitive))
        };
        self.runs.iter().filter(differs).count()
    }

    /// Returns the triangles that overlap a triangle, in ascending order.
    #[inline]
    pub fn partners(&self, primitive: u32) -> &[u32] {
        let is_shared = self
            .shared
            .get(primitive as usize / 64)
            .is_some_and(|bits| bits >> (primitive % 64) & 1 == 1);
        if is_shared { self.run(primitive) } else { &[] }
    }

    #[cold]
    fn run(&self, primitive: u32) -> &[u32] {
        let Ok(i) = self.runs.binary_search_by_key(&primitive, |run| run.0) else {
            return &[];
        };
        let start = i.checked_sub(1).map_or(0, |before| self.runs[before].1);
        &self.partners[start as usize..self.runs[i].1 as usize]
    }

    /// Returns the triangle that a ray along `direction` meets where it hits triangle `primitive`
    /// at barycentric weights `u` and `v`, and its weights there: of the overlapping triangles that
    /// contain the point, one that faces the ray if there is one, and the last of several.
    /// `is_opaque` returns false in holes of a triangle.
    pub fn resolve(
        &self,
        scene: &Scene,
        direction: DVec3,
        (primitive, u, v): (u32, f32, f32),
        is_opaque: impl Fn(u32, [f32; 2]) -> bool,
    ) -> (u32, f32, f32) {
        let partners = self.partners(primitive);
        if partners.is_empty() {
            return (primitive, u, v);
        }
        let faces = |primitive: u32| {
            let [a, b, c] = scene.corners(primitive);
            (b - a).cross(c - a).dot(direction) < 0.0
        };
        let single_sided = |primitive: u32| {
            let material = scene.triangles[primitive as usize].material;
            scene
                .materials
                .get(material as usize)
                .is_some_and(|material| material.single_sided)
        };
        let [a, b, c] = scene.corners(primitive);
        let point = a + (b - a) * f64::from(u) + (c - a) * f64::from(v);
        let mut best = (faces(primitive), primitive, u, v);
        for &other in partners {
            let other_faces = faces(other);
            if (other_faces, other) <= (best.0, best.1) || !other_faces && single_sided(other) {
                continue;
            }
            if let Some([u, v]) = weights(scene.corners(other), point)
                && is_opaque(other, [u, v])
            {
                best = (other_faces, other, u, v);
            }
        }
        (best.1, best.2, best.3)
    }
}

/// Returns the barycentric weights of the second and third corner at a point in the plane of a
/// triangle; `None` outside.
fn weights([a, b, c]: [DVec3; 3], point: DVec3) -> Option<[f32; 2]> {
    // Border points of neighbours belong to one of them in spite of rounding.
    const ROUNDING: f64 = 1e-9;
    let normal = (b - a).cross(c - a);
    let area = normal.length_squared();
    let u = (point - a).cross(c - a).dot(normal) / area;
    let v = (b - a).cross(point - a).dot(normal) / area;
    let is_inside = u >= -ROUNDING && v >= -ROUNDING && u + v <= 1.0 + ROUNDING;
    is_inside.then(|| {
        let u = u.clamp(0.0, 1.0);
        [u as f32, v.clamp(0.0, 1.0 - u) as f32]
    })
}

/// Search for equal planes: a plane is a linear function over the two axes other than the largest
/// one of its normal, with two slopes and an offset.
struct Planes<'a> {
    scene: &'a Scene,
    middle: DVec3,
    offset_cell: f64,
}

/// A triangle projected along the largest axis of its normal.
struct PlanarTriangle {
    primitive: u32,
    material: u32,
    /// True if the normal points along the axis.
    is_up: bool,
    corners: [DVec2; 3],
    low: DVec2,
    high: DVec2,
}

impl Planes<'_> {
    /// Returns the corners of a triangle relative to the middle of the scene, and its normal, of any
    /// length.
    fn local(&self, primitive: u32) -> ([DVec3; 3], DVec3) {
        let [a, b, c] = self.scene.corners(primitive);
        let normal = (b - a).cross(c - a);
        ([a - self.middle, b - self.middle, c - self.middle], normal)
    }

    /// Adds the cells of a triangle's plane, usually one.
    fn push_keys(&self, primitive: u32, keys: &mut Vec<(u64, u32)>) {
        let ([a, ..], normal) = self.local(primitive);
        let size = normal.abs();
        let largest = size.max_element();
        if !(largest > 0.0 && largest.is_finite()) {
            return;
        }
        for axis in (0..3).filter(|&axis| size[axis] >= largest * (1.0 - TIE)) {
            let [x, y] = others(axis);
            let numbers = [
                normal[x] / normal[axis] / SLOPE_CELL,
                normal[y] / normal[axis] / SLOPE_CELL,
                a.dot(normal) / normal[axis] / self.offset_cell,
            ];
            let cells = numbers.map(|number| {
                let cell = number.round();
                let from_middle = number - cell;
                let is_near = from_middle.abs() > 0.5 - BORDER;
                [Some(cell), is_near.then_some(cell + from_middle.signum())]
            });
            for p in cells[0].into_iter().flatten() {
                for q in cells[1].into_iter().flatten() {
                    for r in cells[2].into_iter().flatten() {
                        keys.push((hash([axis as f64, p, q, r]), primitive));
                    }
                }
            }
        }
    }

    /// Returns the pairs of overlapping triangles of a group in one cell, each in both orders.
    fn overlaps(&self, group: &[(u64, u32)]) -> Vec<[u32; 2]> {
        let (_, normal) = self.local(group[0].1);
        let size = normal.abs();
        let axis = (0..3).fold(0, |a, b| if size[b] > size[a] { b } else { a });
        let mut members: Vec<PlanarTriangle> = group
            .iter()
            .map(|&(_, primitive)| self.project(primitive, axis))
            .collect();
        let class = |member: &PlanarTriangle| (member.material, member.is_up);
        if members.iter().all(|m| class(m) == class(&members[0])) {
            return Vec::new();
        }
        members.sort_unstable_by_key(|member| member.primitive);
        let mut pairs = Vec::new();
        let all: Vec<&PlanarTriangle> = members.iter().collect();
        self.divide(all, 0, &mut pairs);
        pairs
    }

    fn project(&self, primitive: u32, axis: usize) -> PlanarTriangle {
        let (corners, normal) = self.local(primitive);
        let [x, y] = others(axis);
        let corners = corners.map(|p| DVec2::new(p[x], p[y]));
        PlanarTriangle {
            primitive,
            material: self.scene.triangles[primitive as usize].material,
            is_up: normal[axis] > 0.0,
            corners,
            low: corners[0].min(corners[1]).min(corners[2]),
            high: corners[0].max(corners[1]).max(corners[2]),
        }
    }

    /// Finds the pairs among `members`, which are sorted, by halving their bounding box.
    fn divide(&self, members: Vec<&PlanarTriangle>, depth: usize, pairs: &mut Vec<[u32; 2]>) {
        if members.len() > SMALL_GROUP && depth < MAX_DEPTH {
            let (low, high) = members.iter().fold(
                (DVec2::INFINITY, DVec2::NEG_INFINITY),
                |(low, high), member| (low.min(member.low), high.max(member.high)),
            );
            let axis = usize::from(high.y - low.y > high.x - low.x);
            let middle = (low[axis] + high[axis]) / 2.0;
            let half = |is_in: &dyn Fn(&PlanarTriangle) -> bool| -> Vec<&PlanarTriangle> {
                let members = members.iter().copied();
                members.filter(|&member| is_in(member)).collect()
            };
            let lower = half(&|member| member.low[axis] <= middle);
            let upper = half(&|member| member.high[axis] >= middle);
            // Otherwise most of them cross the middle.
            if lower.len() + upper.len() < members.len() * 3 / 2 {
                drop(members);
                self.divide(lower, depth + 1, pairs);
                self.divide(upper, depth + 1, pairs);
                return;
            }
        }
        for a in &members {
            // The last ones in the file first, as only so many are kept.
            let others = members.iter().rev();
            let overlapping = others.filter(|b| a.primitive != b.primitive && self.overlap(a, b));
            let found = overlapping.take(MAX_PARTNERS);
            pairs.extend(found.map(|b| [a.primitive, b.primitive]));
        }
    }

    /// Returns true if two triangles lie in one plane and have a common area.
    fn overlap(&self, a: &PlanarTriangle, b: &PlanarTriangle) -> bool {
        if a.low.cmpge(b.high).any() || b.low.cmpge(a.high).any() {
            return false;
        }
        let ((p, first), (q, second)) = (self.local(a.primitive), self.local(b.primitive));
        let extent = |corners: &[DVec3; 3]| {
            let sizes = corners.map(|corner| corner.abs().max_element());
            sizes.into_iter().fold(0.0, f64::max)
        };
        let tolerance = extent(&p).max(extent(&q)) * DISTANCE_SHARE;
        // The plane of the larger one, because that is the more precise.
        let (plane, corners, normal) = if first.length_squared() >= second.length_squared() {
            (p[0], q, first)
        } else {
            (q[0], p, second)
        };
        let normal = normal.normalize_or_zero();
        if corners
            .iter()
            .any(|&corner| (corner - plane).dot(normal).abs() > tolerance)
        {
            return false;
        }
        // Separating axes: the perpendiculars of all edges.
        let edges = |t: &[DVec2; 3]| [t[1] - t[0], t[2] - t[1], t[0] - t[2]];
        let both = [edges(&a.corners), edges(&b.corners)];
        both.as_flattened().iter().all(|edge| {
            let axis = edge.perp().normalize_or_zero();
            let range = |t: &[DVec2; 3]| {
                let along = t.map(|corner| corner.dot(axis));
                [
                    along.into_iter().fold(f64::INFINITY, f64::min),
                    along.into_iter().fold(f64::NEG_INFINITY, f64::max),
                ]
            };
            let ([a0, a1], [b0, b1]) = (range(&a.corners), range(&b.corners));
            a1.min(b1) - a0.max(b0) > tolerance
        })
    }
}

/// Returns the two axes other than `axis`.
fn others(axis: usize) -> [usize; 2] {
    [(axis + 1) % 3, (axis + 2) % 3]
}

/// FxHash of whole numbers.
fn hash(numbers: [f64; 4]) -> u64 {
    numbers.into_iter().fold(0, |hash: u64, number| {
        let bits = (number as i64).cast_unsigned();
        (hash.rotate_left(5) ^ bits).wrapping_mul(0x517c_c1b7_2722_0a95)
    })
}
