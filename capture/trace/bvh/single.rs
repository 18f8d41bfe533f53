//! Single-ray traversal: tests eight boxes or eight triangles at a time.

use super::prepared::{Prepared, each_axis};
use super::tree::{Block, Child, Entry, Node, SMALL_STACK, WIDTH, opposite, push_sorted};
use super::triangle::{Candidate, edges, exact};
use super::{Hit, Ray, Tracer};
use fearless_simd::{Simd, f32x8, prelude::*};

/// Query of a traversal: decides which hits to keep and when to stop.
pub(super) trait HitQuery {
    /// Returns the distance beyond which no hit is accepted.
    fn limit(&self) -> f32;
    /// Returns true if a hit at `t` is accepted; `t` is at least the ray's `t_min`.
    fn accepts(&self, t: f32, primitive: u32) -> bool;
    /// Records an accepted hit.
    fn record(&mut self, primitive: u32, candidate: Candidate);
    /// Returns true if the traversal can stop.
    fn is_done(&self) -> bool {
        false
    }
}

/// Query for the closest hit.
pub(super) struct ClosestQuery {
    pub(super) primitive: u32,
    pub(super) candidate: Candidate,
}

impl ClosestQuery {
    #[inline(always)]
    pub(super) fn new(t_max: f32) -> Self {
        Self {
            primitive: u32::MAX,
            candidate: Candidate {
                t: t_max,
                v: 0.0,
                w: 0.0,
                determinant: 1.0,
            },
        }
    }

    pub(super) fn hit(&self) -> Option<Hit> {
        (self.primitive != u32::MAX).then(|| hit(self.primitive, self.candidate))
    }
}

fn hit(primitive: u32, candidate: Candidate) -> Hit {
    let [u, v] = candidate.barycentric();
    Hit {
        t: candidate.t,
        primitive,
        u,
        v,
    }
}

impl HitQuery for ClosestQuery {
    #[inline]
    fn limit(&self) -> f32 {
        self.candidate.t
    }

    #[inline]
    fn accepts(&self, t: f32, primitive: u32) -> bool {
        t < self.candidate.t || (t == self.candidate.t && primitive < self.primitive)
    }

    #[inline]
    fn record(&mut self, primitive: u32, candidate: Candidate) {
        *self = Self {
            primitive,
            candidate,
        };
    }
}

/// Query for any hit.
pub(super) struct OcclusionQuery {
    t_max: f32,
    blocked: bool,
}

impl OcclusionQuery {
    #[inline(always)]
    pub(super) fn new(t_max: f32) -> Self {
        Self {
            t_max,
            blocked: false,
        }
    }

    #[inline]
    pub(super) fn blocked(&self) -> bool {
        self.blocked
    }
}

impl HitQuery for OcclusionQuery {
    #[inline]
    fn limit(&self) -> f32 {
        self.t_max
    }

    #[inline]
    fn accepts(&self, t: f32, _: u32) -> bool {
        t <= self.t_max
    }

    #[inline]
    fn record(&mut self, _: u32, _: Candidate) {
        self.blocked = true;
    }

    #[inline]
    fn is_done(&self) -> bool {
        self.blocked
    }
}

/// Query for all hits.
pub(super) struct AllHitsQuery {
    t_max: f32,
    hits: Vec<Hit>,
}

impl AllHitsQuery {
    pub(super) fn new(t_max: f32) -> Self {
        Self {
            t_max,
            hits: Vec::new(),
        }
    }

    pub(super) fn into_sorted(mut self) -> Vec<Hit> {
        self.hits
            .sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then(a.primitive.cmp(&b.primitive)));
        self.hits
    }
}

impl HitQuery for AllHitsQuery {
    #[inline]
    fn limit(&self) -> f32 {
        self.t_max
    }

    #[inline]
    fn accepts(&self, t: f32, _: u32) -> bool {
        t <= self.t_max
    }

    #[inline]
    fn record(&mut self, primitive: u32, candidate: Candidate) {
        self.hits.push(hit(primitive, candidate));
    }
}

/// Traverses the whole tree with one ray.
#[inline(always)]
pub(super) fn search<S: Simd, F: HitQuery>(simd: S, tracer: &Tracer, ray: &Ray, found: &mut F) {
    let Some(ray) = Prepared::new(ray) else {
        return;
    };
    if !tracer.tree.nodes.is_empty() {
        let mut small = [Entry::EMPTY; SMALL_STACK];
        let mut large = Vec::new();
        traverse(
            simd,
            tracer,
            &ray,
            found,
            0,
            tracer.tree.stack(&mut small, &mut large),
        );
    }
}

/// Traverses the subtree of node `root`, nearest children first.
#[inline(always)]
pub(super) fn traverse<S: Simd, F: HitQuery>(
    simd: S,
    tracer: &Tracer,
    ray: &Prepared,
    found: &mut F,
    root: u32,
    stack: &mut [Entry],
) {
    let nodes = &tracer.tree.nodes;
    let boxes = BoxTest::new(simd, ray);
    let mut node = &nodes[root as usize];
    let mut len = 0;
    loop {
        let (enter, entered) = boxes.enter(simd, node, found.limit());
        let next = push_all_but_nearest(stack, &mut len, node, entered, &enter);
        let Some(mut next) = next.or_else(|| pop(stack, &mut len, found.limit())) else {
            return;
        };
        loop {
            let child = Child::from_bits(next.payload());
            let Some(block) = child.first_block() else {
                node = &nodes[child.index() as usize];
                break;
            };
            intersect_leaf(simd, tracer, ray, found, block, next.enter());
            if found.is_done() {
                return;
            }
            match pop(stack, &mut len, found.limit()) {
                Some(entry) => next = entry,
                None => return,
            }
        }
    }
}

/// Pushes the children whose bits are set in `entered`, except the nearest, which it returns. The
/// usual case of one or two children needs no branch that depends on their order.
#[inline(always)]
fn push_all_but_nearest(
    stack: &mut [Entry],
    len: &mut usize,
    node: &Node,
    entered: u32,
    enter: &[f32; WIDTH],
) -> Option<Entry> {
    if entered == 0 {
        return None;
    }
    let entry = |slot: usize| Entry::new(enter[slot % WIDTH], node.child[slot % WIDTH].bits());
    let first = entry(entered.trailing_zeros() as usize);
    let rest = entered & (entered - 1);
    if rest == 0 {
        return Some(first);
    }
    let second = entry(rest.trailing_zeros() as usize);
    if rest & (rest - 1) == 0 {
        stack[*len] = first.max(second);
        *len += 1;
        return Some(first.min(second));
    }
    *len = push_sorted(stack, *len, entered, entry) - 1;
    Some(stack[*len])
}

/// Pops the nearest entry that is not beyond `limit`.
#[inline(always)]
fn pop(stack: &[Entry], len: &mut usize, limit: f32) -> Option<Entry> {
    while *len > 0 {
        *len -= 1;
        if stack[*len].enter() <= limit {
            return Some(stack[*len]);
        }
    }
    None
}

/// Constants of the box test, splatted to all lanes.
struct BoxTest<S: Simd> {
    near_rows: [usize; 3],
    near_origin: [f32x8<S>; 3],
    far_origin: [f32x8<S>; 3],
    inverse: [f32x8<S>; 3],
    t_min: f32x8<S>,
}

impl<S: Simd> BoxTest<S> {
    #[inline(always)]
    fn new(simd: S, ray: &Prepared) -> Self {
        Self {
            near_rows: each_axis!(a => if ray.slabs[a].inverse < 0.0 { a + 3 } else { a }),
            near_origin: each_axis!(a => f32x8::splat(simd, ray.slabs[a].near_origin)),
            far_origin: each_axis!(a => f32x8::splat(simd, ray.slabs[a].far_origin)),
            inverse: each_axis!(a => f32x8::splat(simd, ray.slabs[a].inverse)),
            t_min: f32x8::splat(simd, ray.t_min),
        }
    }

    /// Tests the boxes of a node's children: returns the entry distances (at least `t_min`) and the
    /// mask of the children that the ray enters before `limit`.
    #[inline(always)]
    fn enter(&self, simd: S, node: &Node, limit: f32) -> ([f32; WIDTH], u32) {
        let near = each_axis!(a => (node.row(simd, self.near_rows[a]) - self.near_origin[a]) * self.inverse[a]);
        let far = each_axis!(a => (node.row(simd, opposite(self.near_rows[a])) - self.far_origin[a]) * self.inverse[a]);
        let enter = near[0].max(near[1]).max(near[2].max(self.t_min));
        let leave = far[0]
            .min(far[1])
            .min(far[2].min(f32x8::splat(simd, limit)));
        (enter.to_array(), enter.simd_le(leave).to_bitmask() as u32)
    }
}

/// Tests the triangles of a leaf. `enter` is the distance at which the ray enters the leaf's box.
#[inline(always)]
fn intersect_leaf<S: Simd, F: HitQuery>(
    simd: S,
    tracer: &Tracer,
    ray: &Prepared,
    found: &mut F,
    first_block: usize,
    enter: f32,
) {
    for block in &tracer.tree.blocks[first_block..] {
        intersect(simd, tracer, ray, found, block, enter);
        if !block.more {
            break;
        }
    }
}

/// Tests the triangles of a block. `enter` is the distance at which the ray enters the leaf's box.
#[inline(always)]
fn intersect<S: Simd, F: HitQuery>(
    simd: S,
    tracer: &Tracer,
    ray: &Prepared,
    found: &mut F,
    block: &Block,
    enter: f32,
) {
    let origin = each_axis!(i => f32x8::splat(simd, ray.origin[i]));
    let vertices = each_axis!(vertex => each_axis!(i => {
        f32x8::load_array_ref(simd, &block.vertices[vertex][ray.axes[i]]) - origin[i]
    }));
    let edges = edges(
        vertices,
        [
            f32x8::splat(simd, ray.shear[0]),
            f32x8::splat(simd, ray.shear[1]),
        ],
    );
    let mut inside = edges.inside().to_bitmask() as u32;
    if inside == 0 {
        return;
    }
    let inverse_main = ray.inverse_main();
    let (determinant, t) = edges.determinant_and_t(f32x8::splat(simd, inverse_main));
    let [_, v, w] = edges.weights;
    let determinant = determinant.to_array();
    let t = t.to_array();
    let v = v.to_array();
    let w = w.to_array();
    while inside != 0 {
        let slot = inside.trailing_zeros() as usize;
        inside &= inside - 1;
        let mut candidate = Candidate {
            t: t[slot],
            v: v[slot],
            w: w[slot],
            determinant: determinant[slot],
        };
        if candidate.determinant == 0.0 {
            let Some(exact) = exact(relative(block, slot, ray), ray.shear, inverse_main) else {
                continue;
            };
            candidate = exact;
        }
        if block.single_sided >> slot & 1 == 1 && candidate.is_back(inverse_main) {
            continue;
        }
        let primitive = block.primitives[slot];
        let in_range = candidate.t >= ray.t_min; // false for NaN
        if !in_range {
            continue;
        }
        candidate.t = candidate.t_from(enter);
        if !found.accepts(candidate.t, primitive) {
            continue;
        }
        let opaque = block.cutouts >> slot & 1 == 0
            || tracer
                .cutouts
                .is_opaque(&tracer.scene, primitive, candidate.barycentric());
        if opaque {
            found.record(primitive, candidate);
        }
    }
}

/// Returns the vertices of a block's triangle relative to the ray's origin, in the order of its
/// shear axes.
#[inline(always)]
pub(super) fn relative(block: &Block, slot: usize, ray: &Prepared) -> [[f32; 3]; 3] {
    each_axis!(vertex => each_axis!(i => block.vertices[vertex][ray.axes[i]][slot] - ray.origin[i]))
}
