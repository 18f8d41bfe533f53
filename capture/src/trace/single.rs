//! Traversal by one ray, eight boxes or four triangles at a time.

use super::prepared::{Prepared, each_axis};
use super::tree::{Block, Entry, Node, SMALL_STACK, WIDTH, opposite};
use super::triangle::{Candidate, edges, exact};
use super::{Hit, Tracer};
use fearless_simd::{Simd, f32x4, f32x8, prelude::*};

/// What a traversal looks for.
pub(super) trait Found {
    /// Nothing beyond this distance is wanted.
    fn limit(&self) -> f32;
    /// Whether a hit at `t`, which is at least the ray's `t_min`, is wanted.
    fn wants(&self, t: f32, primitive: u32) -> bool;
    /// Takes a hit that is wanted.
    fn take(&mut self, primitive: u32, candidate: Candidate);
    /// Whether the traversal can stop.
    fn done(&self) -> bool {
        false
    }
}

/// The closest hit.
pub(super) struct Closest {
    pub(super) primitive: u32,
    pub(super) candidate: Candidate,
}

impl Closest {
    #[inline(always)]
    pub(super) fn new(t_max: f32) -> Self {
        Self { primitive: u32::MAX, candidate: Candidate { t: t_max, v: 0.0, w: 0.0, determinant: 1.0 } }
    }

    pub(super) fn hit(&self) -> Option<Hit> {
        (self.primitive != u32::MAX).then(|| hit(self.primitive, self.candidate))
    }
}

fn hit(primitive: u32, candidate: Candidate) -> Hit {
    let [u, v] = candidate.barycentric();
    Hit { t: candidate.t, primitive, u, v }
}

impl Found for Closest {
    #[inline(always)]
    fn limit(&self) -> f32 {
        self.candidate.t
    }

    #[inline(always)]
    fn wants(&self, t: f32, primitive: u32) -> bool {
        t < self.candidate.t || (t == self.candidate.t && primitive < self.primitive)
    }

    #[inline(always)]
    fn take(&mut self, primitive: u32, candidate: Candidate) {
        *self = Self { primitive, candidate };
    }
}

/// Any hit at all.
pub(super) struct Occluded {
    t_max: f32,
    blocked: bool,
}

impl Occluded {
    #[inline(always)]
    pub(super) fn new(t_max: f32) -> Self {
        Self { t_max, blocked: false }
    }

    #[inline(always)]
    pub(super) fn blocked(&self) -> bool {
        self.blocked
    }
}

impl Found for Occluded {
    #[inline(always)]
    fn limit(&self) -> f32 {
        self.t_max
    }

    #[inline(always)]
    fn wants(&self, t: f32, _: u32) -> bool {
        t <= self.t_max
    }

    #[inline(always)]
    fn take(&mut self, _: u32, _: Candidate) {
        self.blocked = true;
    }

    #[inline(always)]
    fn done(&self) -> bool {
        self.blocked
    }
}

/// Every hit.
pub(super) struct All {
    t_max: f32,
    hits: Vec<Hit>,
}

impl All {
    pub(super) fn new(t_max: f32) -> Self {
        Self { t_max, hits: Vec::new() }
    }

    pub(super) fn into_sorted(mut self) -> Vec<Hit> {
        self.hits.sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then(a.primitive.cmp(&b.primitive)));
        self.hits
    }
}

impl Found for All {
    #[inline(always)]
    fn limit(&self) -> f32 {
        self.t_max
    }

    #[inline(always)]
    fn wants(&self, t: f32, _: u32) -> bool {
        t <= self.t_max
    }

    #[inline(always)]
    fn take(&mut self, primitive: u32, candidate: Candidate) {
        self.hits.push(hit(primitive, candidate));
    }
}

/// Traverses the whole tree.
#[inline(always)]
pub(super) fn traverse_from_root<S: Simd, F: Found>(simd: S, tracer: &Tracer, ray: &Prepared, found: &mut F) {
    if !tracer.tree.nodes.is_empty() {
        let (mut small, mut large) = ([Entry::EMPTY; SMALL_STACK], Vec::new());
        traverse(simd, tracer, ray, found, 0, tracer.tree.stack(&mut small, &mut large));
    }
}

/// Traverses the subtree of node `root`, nearer children first.
#[inline(always)]
pub(super) fn traverse<S: Simd, F: Found>(
    simd: S,
    tracer: &Tracer,
    ray: &Prepared,
    found: &mut F,
    root: u32,
    stack: &mut [Entry],
) {
    let nodes = &tracer.tree.nodes;
    let boxes = BoxTest::new(simd, ray);
    let mut len = push_children(simd, &boxes, root, &nodes[root as usize], found.limit(), stack, 0);
    while len > 0 {
        len -= 1;
        let Entry { near, node, slot } = stack[len];
        if near > found.limit() {
            continue;
        }
        let (parent, slot) = (&nodes[node as usize], slot as usize);
        let child = parent.child[slot];
        match parent.blocks[slot] {
            0 => len = push_children(simd, &boxes, child, &nodes[child as usize], found.limit(), stack, len),
            blocks => {
                for block in child..child + u32::from(blocks) {
                    intersect(simd, tracer, ray, found, block, near);
                }
                if found.done() {
                    return;
                }
            }
        }
    }
}

/// The constants of the box test, in every lane.
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

    /// Which of a node's children the ray enters before `limit`, and where.
    #[inline(always)]
    fn enter(&self, simd: S, node: &Node, limit: f32) -> (f32x8<S>, u32) {
        let near = each_axis!(a => (node.row(simd, self.near_rows[a]) - self.near_origin[a]) * self.inverse[a]);
        let far = each_axis!(a => (node.row(simd, opposite(self.near_rows[a])) - self.far_origin[a]) * self.inverse[a]);
        let near = near[0].max(near[1]).max(near[2]);
        let far = far[0].min(far[1]).min(far[2]);
        let entered = near.max(self.t_min).simd_le(far.min(f32x8::splat(simd, limit)));
        (near, entered.to_bitmask() as u32)
    }
}

/// Pushes the children that the ray enters, the nearest last, and returns the stack's new length.
#[inline(always)]
fn push_children<S: Simd>(
    simd: S,
    boxes: &BoxTest<S>,
    index: u32,
    node: &Node,
    limit: f32,
    stack: &mut [Entry],
    base: usize,
) -> usize {
    let (near, entered) = boxes.enter(simd, node, limit);
    push_sorted(stack, base, index, entered, near.to_array())
}

/// Pushes the slots of a node that are set in `entered`, from far to near, and returns the stack's new length.
#[inline(always)]
pub(super) fn push_sorted(stack: &mut [Entry], base: usize, node: u32, mut entered: u32, near: [f32; WIDTH]) -> usize {
    let mut len = base;
    while entered != 0 {
        let slot = entered.trailing_zeros();
        entered &= entered - 1;
        let entry = Entry { near: near[slot as usize], node, slot };
        let mut at = len;
        while at > base && stack[at - 1].near < entry.near {
            stack[at] = stack[at - 1];
            at -= 1;
        }
        stack[at] = entry;
        len += 1;
    }
    len
}

/// Tests the triangles of a block. `near` is where the ray enters the leaf's box.
#[inline(always)]
fn intersect<S: Simd, F: Found>(simd: S, tracer: &Tracer, ray: &Prepared, found: &mut F, block: u32, near: f32) {
    let block = &tracer.tree.blocks[block as usize];
    let origin = each_axis!(i => f32x4::splat(simd, ray.origin[i]));
    let vertices = each_axis!(vertex => each_axis!(i => {
        f32x4::load_array_ref(simd, &block.vertices[vertex][ray.axes[i]]) - origin[i]
    }));
    let edges = edges(vertices, [f32x4::splat(simd, ray.shear[0]), f32x4::splat(simd, ray.shear[1])]);
    let mut inside = edges.inside().to_bitmask() as u32;
    if inside == 0 {
        return;
    }
    let inverse_main = ray.inverse_main();
    let (determinant, t) = edges.determinant_and_t(f32x4::splat(simd, inverse_main));
    let [_, v, w] = edges.weights;
    let (determinant, t, v, w) = (determinant.to_array(), t.to_array(), v.to_array(), w.to_array());
    while inside != 0 {
        let slot = inside.trailing_zeros() as usize;
        inside &= inside - 1;
        let mut candidate = Candidate { t: t[slot], v: v[slot], w: w[slot], determinant: determinant[slot] };
        if candidate.determinant == 0.0 {
            let Some(exact) = exact(relative(block, slot, ray), ray.shear, inverse_main) else { continue };
            candidate = exact;
        }
        candidate.t = candidate.t_from(near);
        let primitive = block.primitives[slot];
        if candidate.t < ray.t_min || !found.wants(candidate.t, primitive) {
            continue;
        }
        let opaque = block.cutouts >> slot & 1 == 0
            || tracer.cutouts.is_opaque(&tracer.scene, primitive, candidate.barycentric());
        if opaque {
            found.take(primitive, candidate);
        }
    }
}

/// The vertices of a block's triangle relative to the ray's origin, on the axes of its shear.
#[inline(always)]
pub(super) fn relative(block: &Block, slot: usize, ray: &Prepared) -> [[f32; 3]; 3] {
    each_axis!(vertex => each_axis!(i => block.vertices[vertex][ray.axes[i]][slot] - ray.origin[i]))
}
