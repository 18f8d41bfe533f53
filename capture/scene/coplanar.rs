//! Overlapping triangles in one plane: a wall whose sides have different materials, a poster in the
//! plane of its wall.
//!
//! Rounding would decide which of them a ray meets first, so that the surface would be speckled
//! with both. Instead the ray meets one that faces it if there is one, and of several the last one
//! in the file, however each surface is triangulated.

use crate::scene::Scene;
use glam::{DVec2, DVec3, Vec4, Vec4Swizzles};
use rayon::prelude::*;
use std::cmp::Reverse;

/// Largest distance of triangles in one plane, relative to the distance of their corners from the
/// middle of the scene: a few steps of `f32`. Rounding in the file may allow more ([`rounding`]).
const DISTANCE_SHARE: f64 = 1.0 / 2_097_152.0;
/// The same relative to the longest edge of a triangle, for coordinates that were rounded to some
/// decimals: corners of 0.1 mm on a wall of 20 m are off by 4e-6 of it.
const EDGE_SHARE: f64 = 1.0 / 131_072.0;
/// Largest distance that the length of an edge allows, m: a poster 1 mm before its wall is apart.
const EDGE_LIMIT_M: f64 = 1.0 / 4096.0;
/// Step of `f32` relative to a coordinate.
const FLOAT_STEP: f64 = 1.0 / 8_388_608.0;
/// Largest distance that rounding to `f32` allows, relative to the longest edge.
const FLOAT_LIMIT_SHARE: f64 = 1.0 / 1024.0;
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
    is_single_sided: bool,
    /// Its weights of the second and third corner, each as a dot product with 1 and those weights
    /// of the other triangle.
    weights: [DVec3; 2],
}

impl Partner {
    fn new(scene: &Scene, replaced: u32, primitive: u32, is_opposite: bool) -> Self {
        let [origin, second, third] = scene.corners(replaced);
        let [a, b, c] = scene.corners(primitive);
        let normal = (b - a).cross(c - a);
        let area = normal.length_squared();
        let gradients = [(c - a).cross(normal) / area, normal.cross(b - a) / area];
        Self {
            primitive,
            is_opposite,
            is_single_sided: is_single_sided(scene, primitive),
            weights: gradients.map(|gradient| {
                let steps = [origin - a, second - origin, third - origin];
                DVec3::from_array(steps.map(|step| step.dot(gradient)))
            }),
        }
    }

    /// Returns its weights where the other triangle has the weights `u` and `v`; `None` outside.
    #[inline]
    fn weights(&self, u: f32, v: f32) -> Option<[f32; 2]> {
        // Border points of neighbours belong to one of them in spite of rounding.
        const ROUNDING: f64 = 1e-9;
        let point = DVec3::new(1.0, f64::from(u), f64::from(v));
        let [u, v] = self.weights.map(|weights| weights.dot(point));
        let is_inside = u >= -ROUNDING && v >= -ROUNDING && u + v <= 1.0 + ROUNDING;
        is_inside.then(|| {
            let u = u.clamp(0.0, 1.0);
            [u as f32, v.clamp(0.0, 1.0 - u) as f32]
        })
    }
}

/// Triangles of a scene that overlap others in one plane. Triangles with the same material and
/// orientation count only where a third triangle differs.
#[derive(Debug, Default)]
pub struct CoplanarTriangles {
    /// Ends of the runs in `partners`, one run for each triangle that others may replace.
    run_ends: Vec<u32>,
    /// Those that face the same way and are later in the file, then all that face the other way;
    /// of each the last one in the file first.
    partners: Vec<Partner>,
    /// Bit set of the triangles that have a run: a fast test at every hit, nearly always false.
    shared: Vec<u64>,
    /// Number of bits that are set before each word of `shared`.
    shared_before: Vec<u32>,
}

impl CoplanarTriangles {
    /// Finds the overlapping triangles of a scene. The result does not depend on the number of
    /// threads. Triangles with absent or infinite corners overlap none.
    pub fn find(scene: &Scene) -> Self {
        let groups = Groups::new(scene);
        let mut pairs = groups.search(find_partners);
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
                        found
                            .partners
                            .push(Partner::new(scene, primitive, partner, is_opposite));
                    }
                }
            }
            found.run_ends.push(found.partners.len() as u32);
            found.shared[primitive as usize / 64] |= 1 << (primitive % 64);
        }
        let mut count = 0;
        for word in &found.shared {
            found.shared_before.push(count);
            count += word.count_ones();
        }
        found
    }

    /// Returns true if no triangle replaces another.
    pub fn is_empty(&self) -> bool {
        self.run_ends.is_empty()
    }

    /// Returns true if another triangle may be met in place of this one.
    #[inline]
    pub fn is_shared(&self, primitive: u32) -> bool {
        self.shared
            .get(primitive as usize / 64)
            .is_some_and(|bits| bits >> (primitive % 64) & 1 == 1)
    }

    fn partners(&self, primitive: u32) -> &[Partner] {
        if !self.is_shared(primitive) {
            return &[];
        }
        let word = primitive as usize / 64;
        let before = self.shared[word] & ((1 << (primitive % 64)) - 1);
        let run = (self.shared_before[word] + before.count_ones()) as usize;
        let start = run.checked_sub(1).map_or(0, |before| self.run_ends[before]);
        &self.partners[start as usize..self.run_ends[run] as usize]
    }

    /// Returns the triangle that a ray meets where it hits triangle `primitive` at barycentric
    /// weights `u` and `v`, and its weights there: of the overlapping triangles that contain the
    /// point, one that faces the ray if there is one, and the last of several. `is_facing` is true
    /// if the triangle that is hit faces the ray; `is_opaque` returns false in holes of a triangle.
    pub fn resolve(
        &self,
        is_facing: bool,
        (primitive, u, v): (u32, f32, f32),
        is_opaque: impl Fn(u32, [f32; 2]) -> bool,
    ) -> (u32, f32, f32) {
        let partners = self.partners(primitive);
        let (same, opposite) = partners.split_at(partners.partition_point(|it| !it.is_opposite));
        let find = |partners: &[Partner], may_be_single_sided: bool| {
            let mut partners = partners.iter();
            partners.find_map(|partner| {
                let [u, v] = partner.weights(u, v)?;
                let is_met = (may_be_single_sided || !partner.is_single_sided)
                    && is_opaque(partner.primitive, [u, v]);
                is_met.then_some((partner.primitive, u, v))
            })
        };
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

/// Returns the number of triangles of a scene that overlap one of another material in one plane.
pub fn count_conflicts(scene: &Scene) -> usize {
    let mut conflicts = Groups::new(scene).search(find_conflicts);
    conflicts.par_sort_unstable();
    conflicts.dedup();
    conflicts.len()
}

/// Triangles of a scene in groups of about one plane each; a triangle may be in several groups.
struct Groups<'a> {
    planes: Planes<'a>,
    /// Key of a group, and triangle; sorted.
    keys: Vec<(u64, u32)>,
}

impl<'a> Groups<'a> {
    fn new(scene: &'a Scene) -> Self {
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
        Self { planes, keys }
    }

    /// Collects what `search` finds among the triangles of each group that are close together.
    fn search<T: Send>(&self, search: fn(&[&PlanarTriangle], &mut Vec<T>)) -> Vec<T> {
        let groups = self.keys.chunk_by(|a, b| a.0 == b.0);
        let groups: Vec<&[(u64, u32)]> = groups.filter(|group| group.len() > 1).collect();
        let found = groups.par_iter().flat_map_iter(|group| {
            let members = self.planes.project_all(group);
            let mut found = Vec::new();
            divide(members.iter().collect(), 0, &mut |close| {
                search(close, &mut found);
            });
            found
        });
        found.collect()
    }
}

/// Search for equal planes: a plane is a linear function over the two axes other than the largest
/// one of its normal, with two slopes and an offset.
struct Planes<'a> {
    scene: &'a Scene,
    middle: DVec3,
    offset_cell: f64,
}

/// A triangle, also projected along the largest axis of its normal.
struct PlanarTriangle {
    primitive: u32,
    /// Material, and true if the normal points along the axis.
    class: (u32, bool),
    corners: [DVec3; 3],
    /// Distance within which other triangles lie in its plane.
    tolerance: f64,
    /// The unit normal, and twice the area.
    normal: (DVec3, f64),
    projected: [DVec2; 3],
    /// Unit perpendiculars of the edges, and the projected triangle's range along each.
    sides: [(DVec2, [f64; 2]); 3],
    low: DVec2,
    high: DVec2,
}

impl PlanarTriangle {
    /// Returns true if two triangles lie in one plane and have a common area.
    fn overlaps(&self, other: &Self) -> bool {
        if self.low.cmpge(other.high).any() || other.low.cmpge(self.high).any() {
            return false;
        }
        let tolerance = self.tolerance.max(other.tolerance);
        // Separating axes: the perpendiculars of all edges.
        let is_separated = |a: &Self, b: &Self| {
            a.sides.iter().any(|&(axis, [a0, a1])| {
                let [b0, b1] = range_along(axis, b.projected);
                a1.min(b1) - a0.max(b0) <= tolerance
            })
        };
        if is_separated(self, other) || is_separated(other, self) {
            return false;
        }
        // The plane of the larger one, because that is the more precise.
        let (larger, smaller) = if self.normal.1 >= other.normal.1 {
            (self, other)
        } else {
            (other, self)
        };
        let distance = |corner: DVec3| (corner - larger.corners[0]).dot(larger.normal.0).abs();
        smaller.corners.iter().all(|&it| distance(it) <= tolerance)
    }
}

/// Returns the distance by which rounding of the coordinates in the file may move the corners of a
/// triangle off its plane. Corners that `f32` represents were rounded to it; those of other files
/// to some decimals, whose number is unknown.
fn rounding([a, b, c]: [DVec3; 3], unit_normal: DVec3) -> f64 {
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let by_decimals = (longest * EDGE_SHARE).min(EDGE_LIMIT_M);
    if [a, b, c].iter().any(|p| p.as_vec3().as_dvec3() != *p) {
        return by_decimals;
    }
    let extent = a.abs().max(b.abs()).max(c.abs());
    let by_floats = extent.dot(unit_normal.abs()) * FLOAT_STEP;
    by_decimals.max(by_floats.min(longest * FLOAT_LIMIT_SHARE))
}

fn range_along(axis: DVec2, corners: [DVec2; 3]) -> [f64; 2] {
    let [a, b, c] = corners.map(|corner| corner.dot(axis));
    [a.min(b).min(c), a.max(b).max(c)]
}

impl Planes<'_> {
    /// Returns the corners of a triangle relative to the middle of the scene, and its normal, of
    /// any length.
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

    /// Projects the triangles of a group along one axis.
    fn project_all(&self, group: &[(u64, u32)]) -> Vec<PlanarTriangle> {
        let (_, normal) = self.local(group[0].1);
        let size = normal.abs();
        let axis = (0..3).fold(0, |a, b| if size[b] > size[a] { b } else { a });
        let primitives = group.iter().map(|&(_, primitive)| primitive);
        primitives.map(|it| self.project(it, axis)).collect()
    }

    fn project(&self, primitive: u32, axis: usize) -> PlanarTriangle {
        let (corners, normal) = self.local(primitive);
        let [x, y] = others(axis);
        let projected = corners.map(|p| DVec2::new(p[x], p[y]));
        let material = self.scene.triangles[primitive as usize].material;
        let [p, q, r] = projected;
        let sides = [q - p, r - q, p - r].map(|edge| {
            let axis = edge.perp().normalize_or_zero();
            (axis, range_along(axis, projected))
        });
        let [a, b, c] = corners.map(|corner| corner.abs().max_element());
        let unit_normal = normal.normalize_or_zero();
        PlanarTriangle {
            primitive,
            class: (material, normal[axis] > 0.0),
            corners,
            tolerance: rounding(self.scene.corners(primitive), unit_normal)
                .max(a.max(b).max(c) * DISTANCE_SHARE),
            normal: (unit_normal, normal.length()),
            projected,
            sides,
            low: p.min(q).min(r),
            high: p.max(q).max(r),
        }
    }
}

/// Calls `visit` with the triangles of about one plane, sorted by primitive, that lie close
/// together, by halving their bounding box; not with those of a single class.
fn divide(members: Vec<&PlanarTriangle>, depth: usize, visit: &mut impl FnMut(&[&PlanarTriangle])) {
    if members.iter().all(|it| it.class == members[0].class) {
        return;
    }
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
        // Otherwise so many cross the middle that halving saves few comparisons.
        if lower.len() + upper.len() < members.len() * 7 / 6 {
            drop(members);
            divide(lower, depth + 1, visit);
            divide(upper, depth + 1, visit);
            return;
        }
    }
    visit(&members);
}

/// Returns the bounding boxes of triangles as their low and negated high coordinates, rounded.
fn boxes(members: &[&PlanarTriangle]) -> Vec<Vec4> {
    let members = members.iter();
    let corners = members.map(|it| (it.low.as_vec2(), -it.high.as_vec2()));
    corners.map(Vec4::from).collect()
}

/// Returns the indices of the boxes that overlap one of them: a fast first test, which rounding
/// lets pass too many.
fn overlapping(boxes: &[Vec4], one: Vec4) -> impl DoubleEndedIterator<Item = usize> {
    let limits = -one.zwxy();
    let near = boxes.iter().enumerate();
    near.filter_map(move |(i, it)| it.cmple(limits).all().then_some(i))
}

/// Finds triangles that may be met in place of others: the triangle, whether its partner faces the
/// other way, and the partner.
fn find_partners(members: &[&PlanarTriangle], pairs: &mut Vec<(u32, bool, Reverse<u32>)>) {
    let boxes = boxes(members);
    let mut counts = vec![0; members.len()];
    // The last ones in the file first, as only so many are kept.
    for (j, b) in members.iter().enumerate().rev() {
        for i in overlapping(&boxes[..j], boxes[j]).rev() {
            let a = members[i];
            if a.class == b.class || counts[i].min(counts[j]) >= MAX_PARTNERS || !a.overlaps(b) {
                continue;
            }
            let is_opposite = a.class.1 != b.class.1;
            pairs.push((a.primitive, is_opposite, Reverse(b.primitive)));
            if is_opposite {
                pairs.push((b.primitive, true, Reverse(a.primitive)));
            }
            counts[i] += 1;
            counts[j] += 1;
        }
    }
    // Of its own class, the later ones count where one of another class does.
    for (i, a) in members.iter().enumerate().filter(|(i, _)| counts[*i] > 0) {
        let later = members[i + 1..].iter().rev();
        let twins = later.filter(|b| b.class == a.class && a.overlaps(b));
        let twins = twins.take(MAX_PARTNERS);
        pairs.extend(twins.map(|b| (a.primitive, false, Reverse(b.primitive))));
    }
}

/// Finds triangles that overlap one of another material.
fn find_conflicts(members: &[&PlanarTriangle], conflicts: &mut Vec<u32>) {
    let boxes = boxes(members);
    for (a, &around) in members.iter().zip(&boxes) {
        let mut near = overlapping(&boxes, around).map(|i| members[i]);
        if near.any(|b| a.class.0 != b.class.0 && a.overlaps(b)) {
            conflicts.push(a.primitive);
        }
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
