//! Overlapping triangles in one plane: a wall whose sides have different materials, a poster in the
//! plane of its wall.
//!
//! Rounding would decide which of them a ray meets first, so that the surface would be speckled
//! with both. Instead the ray meets one that faces it if there is one, and of several the last one
//! in the file, however each surface is triangulated.

use crate::scene::Scene;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::cmp::Reverse;

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

/// A triangle that a ray may meet instead of another one in its plane.
#[derive(Clone, Copy, Debug)]
struct Partner {
    primitive: u32,
    /// True if it faces the other way.
    is_opposite: bool,
    /// Bounding box, a little larger than the triangle: a fast test.
    low: DVec3,
    high: DVec3,
}

/// Triangles of a scene that overlap others in one plane. Triangles with the same material and
/// orientation count only where a third triangle differs.
#[derive(Debug, Default)]
pub struct CoplanarTriangles {
    /// Triangles that others may replace, sorted, each with the end of its run in `partners`.
    runs: Vec<(u32, u32)>,
    /// Those that face the same way and are later in the file, then all that face the other way;
    /// of each the last one in the file first.
    partners: Vec<Partner>,
    /// Bit set of the triangles in `runs`: a fast test at every hit, nearly always false.
    shared: Vec<u64>,
    conflicts: usize,
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
        let overlaps: Vec<Overlap> = groups
            .par_iter()
            .flat_map_iter(|group| planes.overlaps(group))
            .collect();
        let mut conflicts: Vec<u32> = overlaps
            .iter()
            .filter(|overlap| overlap.has_other_material)
            .map(|overlap| overlap.primitive)
            .collect();
        conflicts.par_sort_unstable();
        conflicts.dedup();
        let mut pairs: Vec<(u32, bool, Reverse<u32>)> = overlaps
            .iter()
            .filter_map(|overlap| {
                let (is_opposite, partner) = overlap.partner?;
                Some((overlap.primitive, is_opposite, Reverse(partner)))
            })
            .collect();
        pairs.par_sort_unstable();
        pairs.dedup();
        let mut found = Self {
            shared: if pairs.is_empty() {
                Vec::new()
            } else {
                vec![0; scene.triangles.len().div_ceil(64)]
            },
            conflicts: conflicts.len(),
            ..Self::default()
        };
        for run in pairs.chunk_by(|a, b| a.0 == b.0) {
            let primitive = run[0].0;
            for side in run.chunk_by(|a, b| a.1 == b.1) {
                let first = found.partners.len();
                for &(_, is_opposite, Reverse(partner)) in side {
                    let nearer = &found.partners[first..];
                    if nearer.len() < MAX_PARTNERS
                        && !nearer
                            .iter()
                            .any(|nearer| hides_copy(scene, nearer.primitive, partner))
                    {
                        found.partners.push(planes.partner(partner, is_opposite));
                    }
                }
            }
            found.runs.push((primitive, found.partners.len() as u32));
            found.shared[primitive as usize / 64] |= 1 << (primitive % 64);
        }
        found
    }

    /// Returns true if no triangle replaces another.
    pub fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// Returns the number of triangles that overlap one of another material.
    pub fn conflict_count(&self) -> usize {
        self.conflicts
    }

    /// Returns true if another triangle may be met in place of this one.
    #[inline]
    pub fn is_shared(&self, primitive: u32) -> bool {
        self.shared
            .get(primitive as usize / 64)
            .is_some_and(|bits| bits >> (primitive % 64) & 1 == 1)
    }

    fn partners(&self, primitive: u32) -> &[Partner] {
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
        let [a, b, c] = scene.corners(primitive);
        let point = a + (b - a) * f64::from(u) + (c - a) * f64::from(v);
        let partners = self.partners(primitive);
        let (same, opposite) = partners.split_at(partners.partition_point(|it| !it.is_opposite));
        let find = |partners: &[Partner], may_be_single_sided: bool| {
            partners.iter().find_map(|partner| {
                if point.cmplt(partner.low).any() || point.cmpgt(partner.high).any() {
                    return None;
                }
                let primitive = partner.primitive;
                if !may_be_single_sided && is_single_sided(scene, primitive) {
                    return None;
                }
                let [u, v] = weights(scene.corners(primitive), point)?;
                is_opaque(primitive, [u, v]).then_some((primitive, u, v))
            })
        };
        let is_facing = (b - a).cross(c - a).dot(direction) < 0.0;
        let met = if is_facing {
            find(same, true)
        } else {
            find(opposite, true).or_else(|| find(same, false))
        };
        met.unwrap_or((primitive, u, v))
    }
}

fn is_single_sided(scene: &Scene, primitive: u32) -> bool {
    let material = scene.triangles[primitive as usize].material;
    let material = scene.materials.get(material as usize);
    material.is_some_and(|material| material.single_sided)
}

/// Returns true if `copy` has the corners of `primitive`, which is met everywhere: `copy` is never
/// met if `primitive` is looked at first.
fn hides_copy(scene: &Scene, primitive: u32, copy: u32) -> bool {
    let corners = scene.corners(primitive);
    if !scene.corners(copy).iter().all(|it| corners.contains(it)) {
        return false;
    }
    let material = scene.triangles[primitive as usize].material;
    let material = scene.materials.get(material as usize);
    material.is_some_and(|material| material.cutout.is_none() && !material.single_sided)
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

/// What is found about a triangle.
struct Overlap {
    primitive: u32,
    has_other_material: bool,
    /// Whether it faces the other way, and the triangle.
    partner: Option<(bool, u32)>,
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

    fn partner(&self, primitive: u32, is_opposite: bool) -> Partner {
        let corners = self.scene.corners(primitive);
        let extents = corners.map(|corner| (corner - self.middle).abs().max_element());
        let margin = DVec3::splat(2.0 * DISTANCE_SHARE * extents.into_iter().fold(0.0, f64::max));
        let [a, b, c] = corners;
        Partner {
            primitive,
            is_opposite,
            low: a.min(b).min(c) - margin,
            high: a.max(b).max(c) + margin,
        }
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

    /// Returns the overlapping triangles of a group in one cell.
    fn overlaps(&self, group: &[(u64, u32)]) -> Vec<Overlap> {
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
        let mut found = Vec::new();
        let all: Vec<&PlanarTriangle> = members.iter().collect();
        self.divide(all, 0, &mut found);
        found
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
    fn divide(&self, members: Vec<&PlanarTriangle>, depth: usize, found: &mut Vec<Overlap>) {
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
                self.divide(lower, depth + 1, found);
                self.divide(upper, depth + 1, found);
                return;
            }
        }
        for a in &members {
            let (mut has_other_material, mut count) = (false, 0);
            // The last ones in the file first, as only so many are kept.
            for b in members.iter().rev().filter(|b| b.primitive != a.primitive) {
                let is_opposite = a.is_up != b.is_up;
                let is_partner = is_opposite || b.primitive > a.primitive;
                let is_news = !has_other_material && a.material != b.material;
                if !(is_partner || is_news) || !self.overlap(a, b) {
                    continue;
                }
                has_other_material |= a.material != b.material;
                found.push(Overlap {
                    primitive: a.primitive,
                    has_other_material,
                    partner: is_partner.then_some((is_opposite, b.primitive)),
                });
                count += 1;
                if count == MAX_PARTNERS {
                    break;
                }
            }
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
