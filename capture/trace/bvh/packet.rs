//! Packet traversal: 16 coherent rays at a time.
//!
//! A node's eight boxes are first tested against the packet as a whole: intervals around its
//! origins and reciprocal directions give one conservative test for all rays, eight boxes at a
//! time. A box that passes is tested against the 16 rays when it is popped, so that hits found in
//! the meantime cull it. If few rays enter a box, each continues by single-ray traversal
//! ([`super::single`]), whose box and triangle tests are the same, and so are the resulting bits.

use super::Tracer;
use super::lanes::{HitPacket, Lanes, PACKET, PreparedPacket, RayPacket};
use super::prepared::{Prepared, each_axis, shear_axes};
use super::single::{self, ClosestQuery, OcclusionQuery, relative};
use super::tree::{BLOCK, Block, Entry, Node, SMALL_STACK, WIDTH, opposite, push_sorted};
use super::triangle::{Candidate, edges, exact};
use fearless_simd::{Simd, f32x8, f32x16, mask32x16, prelude::*, u32x16};

/// Maximum number of rays entering a box for which the packet splits into single rays. Measured by
/// `benches/trace.rs`.
const SINGLE_RAY_THRESHOLD: u32 = 4;

/// Finds the closest hits of each packet.
#[inline(always)]
pub(super) fn closest<S: Simd>(
    simd: S,
    tracer: &Tracer,
    rays: &[RayPacket],
    hits: &mut [HitPacket],
) {
    let mut small = [Entry::EMPTY; SMALL_STACK];
    let mut large = Vec::new();
    let stack = tracer.tree.stack(&mut small, &mut large);
    for (rays, hits) in rays.iter().zip(hits) {
        let mut found = Lanes::new(rays);
        trace::<S, false>(simd, tracer, rays, &mut found, stack);
        *hits = found.hits();
    }
}

/// Finds the occluded rays of each packet.
#[inline(always)]
pub(super) fn occluded<S: Simd>(simd: S, tracer: &Tracer, rays: &[RayPacket], blocked: &mut [u16]) {
    let mut small = [Entry::EMPTY; SMALL_STACK];
    let mut large = Vec::new();
    let stack = tracer.tree.stack(&mut small, &mut large);
    for (rays, blocked) in rays.iter().zip(blocked) {
        let mut found = Lanes::new(rays);
        trace::<S, true>(simd, tracer, rays, &mut found, stack);
        *blocked = found.blocked;
    }
}

/// Read-only inputs of a packet's traversal.
struct PacketTraversal<'a, S: Simd> {
    simd: S,
    tracer: &'a Tracer,
    rays: &'a RayPacket,
    prepared: &'a PreparedPacket,
    /// Rows of [`Node::planes`] through which the rays enter, by axis.
    near_rows: [usize; 3],
    /// Axes of the shear, if all rays share them.
    axes: Option<[usize; 3]>,
}

/// Traces a packet for closest hits, or for occlusion if `ANY`.
#[inline(always)]
fn trace<S: Simd, const ANY: bool>(
    simd: S,
    tracer: &Tracer,
    rays: &RayPacket,
    found: &mut Lanes,
    stack: &mut [Entry],
) {
    let prepared = PreparedPacket::new(rays);
    let mut active = u32::from(rays.active);
    for k in 0..PACKET {
        active &= !(u32::from(!prepared.valid[k]) << k);
    }
    if active == 0 || tracer.tree.nodes.is_empty() {
        return;
    }
    let zero = f32x16::splat(simd, 0.0);
    let negative = each_axis!(a => {
        f32x16::load_array_ref(simd, &prepared.inverse[a]).simd_lt(zero).to_bitmask() as u32 & active
    });
    let main = prepared.main_axis[active.trailing_zeros() as usize];
    let same_main =
        u32x16::load_array_ref(simd, &prepared.main_axis).simd_eq(u32x16::splat(simd, main));
    let walk = PacketTraversal {
        simd,
        tracer,
        rays,
        prepared: &prepared,
        near_rows: each_axis!(a => if negative[a] == 0 { a } else { a + 3 }),
        axes: if same_main.to_bitmask() as u32 & active == active {
            Some(shear_axes(main))
        } else {
            None
        },
    };
    let agree = |bits: u32| bits == 0 || bits == active;
    if agree(negative[0])
        && agree(negative[1])
        && agree(negative[2])
        && active.count_ones() > SINGLE_RAY_THRESHOLD
    {
        walk.together::<ANY>(active, found, stack);
    } else {
        walk.alone::<ANY>(active, found, 0, stack);
    }
}

impl<S: Simd> PacketTraversal<'_, S> {
    /// Traverses the subtree of `node` with each of the rays `lanes` separately.
    #[inline(always)]
    fn alone<const ANY: bool>(
        &self,
        mut lanes: u32,
        found: &mut Lanes,
        node: u32,
        stack: &mut [Entry],
    ) {
        while lanes != 0 {
            let k = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let ray = self.prepared.ray(self.rays, k);
            if ANY {
                let mut search = OcclusionQuery::new(found.t[k]);
                traverse_alone(self.simd, self.tracer, &ray, &mut search, node, stack);
                if search.blocked() {
                    found.block(k);
                }
            } else {
                let mut search = ClosestQuery {
                    primitive: found.primitive[k],
                    candidate: found.candidate(k),
                };
                traverse_alone(self.simd, self.tracer, &ray, &mut search, node, stack);
                found.set(k, search.primitive, search.candidate);
            }
        }
    }

    /// Traverses the tree with the rays `active` together.
    #[inline(always)]
    fn together<const ANY: bool>(&self, active: u32, found: &mut Lanes, stack: &mut [Entry]) {
        let nodes = &self.tracer.tree.nodes;
        let beam = Beam::new(self, active);
        let mut limit = self.limit(active, found);
        let mut len = beam.push_children(0, &nodes[0], limit, stack, 0);
        while len > 0 {
            len -= 1;
            let entry = stack[len];
            if entry.enter() > limit {
                continue;
            }
            let parent = entry.payload() as usize / WIDTH;
            let slot = entry.payload() as usize % WIDTH;
            let (enter, entered) = self.enter(&nodes[parent], slot, found);
            let entered = entered & active;
            if entered == 0 {
                continue;
            }
            let child = nodes[parent].child[slot];
            if let Some(block) = child.first_block() {
                if self.intersect_leaf::<ANY>(block, entered, enter, found) {
                    limit = self.limit(active, found);
                }
            } else if entered.count_ones() <= SINGLE_RAY_THRESHOLD {
                self.alone::<ANY>(entered, found, child.index(), &mut stack[len..]);
                limit = self.limit(active, found);
            } else {
                let node = child.index();
                len = beam.push_children(node, &nodes[node as usize], limit, stack, len);
            }
        }
    }

    /// Tests the rays `lanes` against the triangles of a leaf, whose box they enter at `enter`.
    /// Returns true if a ray hit one.
    #[inline(always)]
    fn intersect_leaf<const ANY: bool>(
        &self,
        first_block: usize,
        lanes: u32,
        enter: f32x16<S>,
        found: &mut Lanes,
    ) -> bool {
        let mut hit = false;
        for block in &self.tracer.tree.blocks[first_block..] {
            for slot in 0..usize::from(block.len).min(BLOCK) {
                hit |= self.intersect::<ANY>(block, slot, lanes, enter, found);
            }
            if !block.more {
                break;
            }
        }
        hit
    }

    /// Returns the greatest distance at which any ray still accepts hits; minus infinity if all are
    /// occluded.
    #[inline(always)]
    fn limit(&self, active: u32, found: &Lanes) -> f32 {
        self.masked_max(active, &found.t)
    }

    #[inline(always)]
    fn load(&self, row: &[f32; PACKET]) -> f32x16<S> {
        f32x16::load_array_ref(self.simd, row)
    }

    #[inline(always)]
    fn mask(&self, lanes: u32) -> mask32x16<S> {
        mask32x16::from_bitmask(self.simd, u64::from(lanes))
    }

    /// Returns the maximum of a row over the rays `active`.
    #[inline(always)]
    fn masked_max(&self, active: u32, row: &[f32; PACKET]) -> f32 {
        self.mask(active)
            .select(self.load(row), f32x16::splat(self.simd, f32::NEG_INFINITY))
            .reduce_max()
    }

    /// Returns the minimum of a row over the rays `active`.
    #[inline(always)]
    fn masked_min(&self, active: u32, row: &[f32; PACKET]) -> f32 {
        self.mask(active)
            .select(self.load(row), f32x16::splat(self.simd, f32::INFINITY))
            .reduce_min()
    }

    /// Tests the box of a child: returns the entry distances (at least `t_min`) and the mask of the
    /// rays that enter it before their limits.
    #[inline(always)]
    fn enter(&self, node: &Node, slot: usize, found: &Lanes) -> (f32x16<S>, u32) {
        let p = self.prepared;
        let near = each_axis!(a => {
            let plane = f32x16::splat(self.simd, node.planes[self.near_rows[a]][slot]);
            (plane - self.load(&p.near_origin[a])) * self.load(&p.inverse[a])
        });
        let far = each_axis!(a => {
            let plane = f32x16::splat(self.simd, node.planes[opposite(self.near_rows[a])][slot]);
            (plane - self.load(&p.far_origin[a])) * self.load(&p.inverse[a])
        });
        let enter = near[0]
            .max(near[1])
            .max(near[2].max(self.load(&self.rays.t_min)));
        let leave = far[0].min(far[1]).min(far[2].min(self.load(&found.t)));
        (enter, enter.simd_le(leave).to_bitmask() as u32)
    }

    /// Tests the rays `lanes` against a triangle. `enter` is the distance at which they enter its
    /// leaf's box. Returns true if a ray hit it.
    #[inline(always)]
    fn intersect<const ANY: bool>(
        &self,
        block: &Block,
        slot: usize,
        lanes: u32,
        enter: f32x16<S>,
        found: &mut Lanes,
    ) -> bool {
        let shear = [
            self.load(&self.prepared.shear[0]),
            self.load(&self.prepared.shear[1]),
        ];
        let edges = edges(self.relative(block, slot), shear);
        let inside = edges.inside() & self.mask(lanes);
        if inside.all_false() {
            return false;
        }
        let zero = f32x16::splat(self.simd, 0.0);
        let (determinant, t) = edges.determinant_and_t(self.load(&self.prepared.inverse_main));
        let degenerate = (inside & determinant.simd_eq(zero)).to_bitmask() as u32;
        let primitive = block.primitives[slot];
        let inside = if block.single_sided >> slot & 1 == 1 {
            // Like `Candidate::is_back`.
            let along = self.load(&self.prepared.inverse_main).simd_gt(zero);
            let front = along.select(determinant, zero - determinant);
            inside & front.simd_gt(zero)
        } else {
            inside
        };
        let inside = inside & t.simd_ge(self.load(&self.rays.t_min));
        // Like `Candidate::t_from`.
        let t = t.simd_gt(enter).select(t, enter) + zero;
        let best = self.load(&found.t);
        let best_primitive = u32x16::load_array_ref(self.simd, &found.primitive);
        let first = t.simd_eq(best) & u32x16::splat(self.simd, primitive).simd_lt(best_primitive);
        let accepted = (inside & (t.simd_lt(best) | first)).to_bitmask() as u32 & !degenerate;
        let [_, v, w] = edges.weights;
        if block.cutouts >> slot & 1 == 1 || degenerate != 0 {
            let candidates = [
                t.to_array(),
                v.to_array(),
                w.to_array(),
                determinant.to_array(),
            ];
            return self.intersect_scalar::<ANY>(
                block,
                slot,
                accepted,
                degenerate,
                &candidates,
                &enter.to_array(),
                found,
            );
        }
        let mask = self.mask(accepted);
        if accepted == 0 {
            return false;
        } else if ANY {
            found.blocked |= accepted as u16;
            mask.select(f32x16::splat(self.simd, f32::NEG_INFINITY), best)
                .store_array(&mut found.t);
        } else {
            mask.select(t, best).store_array(&mut found.t);
            mask.select(v, self.load(&found.v))
                .store_array(&mut found.v);
            mask.select(w, self.load(&found.w))
                .store_array(&mut found.w);
            mask.select(determinant, self.load(&found.determinant))
                .store_array(&mut found.determinant);
            mask.select(u32x16::splat(self.simd, primitive), best_primitive)
                .store_array(&mut found.primitive);
        }
        true
    }

    /// Scalar tail of [`Self::intersect`] for rare cases: cut-outs, and triangles whose edge
    /// functions all round to zero.
    #[inline(never)]
    fn intersect_scalar<const ANY: bool>(
        &self,
        block: &Block,
        slot: usize,
        accepted: u32,
        degenerate: u32,
        [t, v, w, determinant]: &[[f32; PACKET]; 4],
        enter: &[f32; PACKET],
        found: &mut Lanes,
    ) -> bool {
        let primitive = block.primitives[slot];
        let mut hit = false;
        let mut lanes = accepted | degenerate;
        while lanes != 0 {
            let k = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let mut candidate = Candidate {
                t: t[k],
                v: v[k],
                w: w[k],
                determinant: determinant[k],
            };
            if degenerate >> k & 1 == 1 {
                let ray = self.prepared.ray(self.rays, k);
                let exact = exact(relative(block, slot, &ray), ray.shear, ray.inverse_main());
                let is_there = |exact: &Candidate| {
                    let single_sided = block.single_sided >> slot & 1 == 1;
                    exact.t >= ray.t_min && !(single_sided && exact.is_back(ray.inverse_main()))
                };
                let Some(exact) = exact.filter(is_there) else {
                    continue;
                };
                candidate = Candidate {
                    t: exact.t_from(enter[k]),
                    ..exact
                };
                let first = candidate.t == found.t[k] && primitive < found.primitive[k];
                if !(candidate.t < found.t[k] || first) {
                    continue;
                }
            }
            let opaque = block.cutouts >> slot & 1 == 0
                || self.tracer.cutouts.is_opaque(
                    &self.tracer.scene,
                    primitive,
                    candidate.barycentric(),
                );
            hit |= opaque;
            if opaque && ANY {
                found.block(k);
            } else if opaque {
                found.set(k, primitive, candidate);
            }
        }
        hit
    }

    /// Returns a coordinate of a vertex relative to each ray's origin.
    #[inline(always)]
    fn relative_coordinate(
        &self,
        block: &Block,
        slot: usize,
        vertex: usize,
        axis: usize,
    ) -> f32x16<S> {
        f32x16::splat(self.simd, block.vertices[vertex][axis][slot])
            - self.load(&self.rays.origin[axis])
    }

    /// Returns a triangle's vertices relative to each ray's origin, in the order of each ray's
    /// shear axes.
    #[inline(always)]
    fn relative(&self, block: &Block, slot: usize) -> [[f32x16<S>; 3]; 3] {
        if let Some(axes) = self.axes {
            return each_axis!(vertex => each_axis!(i => self.relative_coordinate(block, slot, vertex, axes[i])));
        }
        let main = u32x16::load_array_ref(self.simd, &self.prepared.main_axis);
        let is_x = main.simd_eq(u32x16::splat(self.simd, 0));
        let is_y = main.simd_eq(u32x16::splat(self.simd, 1));
        each_axis!(vertex => {
            let [x, y, z] = each_axis!(a => self.relative_coordinate(block, slot, vertex, a));
            // The rows are shear_axes(0), shear_axes(1), shear_axes(2).
            let choices = [[y, z, x], [z, x, y], [x, y, z]];
            each_axis!(i => is_x.select(choices[0][i], is_y.select(choices[1][i], choices[2][i])))
        })
    }
}

/// Calls [`single::traverse`] out of line, compiled for the SIMD level.
#[inline(always)]
fn traverse_alone<S: Simd, F: single::HitQuery>(
    simd: S,
    tracer: &Tracer,
    ray: &Prepared,
    search: &mut F,
    node: u32,
    stack: &mut [Entry],
) {
    simd.vectorize(
        #[inline(always)]
        || single::traverse(simd, tracer, ray, search, node, stack),
    );
}

/// Intervals around the rays of a packet, splatted to all lanes.
struct Beam<S: Simd> {
    simd: S,
    near_rows: [usize; 3],
    /// Extreme `near_origin` and `far_origin`: the earliest entry and the latest exit.
    near_origin: [f32x8<S>; 3],
    far_origin: [f32x8<S>; 3],
    /// Minimum and maximum of the reciprocal direction.
    inverse: [[f32x8<S>; 2]; 3],
    t_min: f32x8<S>,
}

impl<S: Simd> Beam<S> {
    #[inline(always)]
    fn new(walk: &PacketTraversal<'_, S>, active: u32) -> Self {
        let simd = walk.simd;
        let p = walk.prepared;
        let positive = each_axis!(a => walk.near_rows[a] == a);
        Self {
            simd,
            near_rows: walk.near_rows,
            near_origin: each_axis!(a => {
                let row = &p.near_origin[a];
                f32x8::splat(simd, if positive[a] { walk.masked_max(active, row) } else { walk.masked_min(active, row) })
            }),
            far_origin: each_axis!(a => {
                let row = &p.far_origin[a];
                f32x8::splat(simd, if positive[a] { walk.masked_min(active, row) } else { walk.masked_max(active, row) })
            }),
            inverse: each_axis!(a => {
                let row = &p.inverse[a];
                [f32x8::splat(simd, walk.masked_min(active, row)), f32x8::splat(simd, walk.masked_max(active, row))]
            }),
            t_min: f32x8::splat(simd, walk.masked_min(active, &walk.rays.t_min)),
        }
    }

    /// Tests the boxes of a node's children conservatively: returns lower bounds of the entry
    /// distances and the mask of the children that any ray may enter before `limit`. Each operation
    /// is monotone in its arguments, so the bounds hold for the rounded results of every ray.
    #[inline(always)]
    fn enter(&self, node: &Node, limit: f32) -> ([f32; WIDTH], u32) {
        let near = each_axis!(a => {
            let offset = node.row(self.simd, self.near_rows[a]) - self.near_origin[a];
            (offset * self.inverse[a][0]).min(offset * self.inverse[a][1])
        });
        let far = each_axis!(a => {
            let offset = node.row(self.simd, opposite(self.near_rows[a])) - self.far_origin[a];
            (offset * self.inverse[a][0]).max(offset * self.inverse[a][1])
        });
        let enter = near[0].max(near[1]).max(near[2].max(self.t_min));
        let leave = far[0]
            .min(far[1])
            .min(far[2].min(f32x8::splat(self.simd, limit)));
        (enter.to_array(), enter.simd_le(leave).to_bitmask() as u32)
    }

    /// Pushes the children that any ray may enter, nearest last, and returns the new stack length.
    #[inline(always)]
    fn push_children(
        &self,
        index: u32,
        node: &Node,
        limit: f32,
        stack: &mut [Entry],
        base: usize,
    ) -> usize {
        let (enter, entered) = self.enter(node, limit);
        // The child's box is tested when popped, so the payload is the parent's slot, not the
        // child.
        push_sorted(stack, base, entered, |slot| {
            Entry::new(enter[slot % WIDTH], index * WIDTH as u32 + slot as u32)
        })
    }
}
