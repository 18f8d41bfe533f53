//! Traversal by 16 coherent rays at a time.
//!
//! A node's eight boxes are first tested against the packet as a whole: intervals around its origins and reciprocal
//! directions give one conservative test for all rays, eight boxes at a time. A box that passes is tested against the
//! 16 rays when its turn comes, so that hits found meanwhile count. Where few rays agree, each goes on alone
//! ([`super::single`]): the same box and triangle tests, so the same bits.

use super::prepared::{Prepared, Slab, axes_of, each_axis, is_valid, largest, main_axis};
use super::single::{self, Closest, Occluded, relative};
use super::tree::{BLOCK, Block, Entry, Node, SMALL_STACK, WIDTH, opposite, push_sorted};
use super::triangle::{Candidate, edges, exact};
use super::{Ray, Tracer};
use fearless_simd::{Simd, f32x8, f32x16, mask32x16, prelude::*, u32x16};
use glam::Vec3;

/// Rays of a packet.
pub const PACKET: usize = 16;

/// Where at most this many rays enter a box, each goes on alone. Measured: see `benches/trace.rs`.
const ALONE: u32 = 4;

/// 16 rays, best with nearby origins and directions. Any rays are traced correctly; those that do not agree in the
/// signs of their directions are traced one by one.
#[repr(C, align(64))]
#[derive(Clone, Debug, PartialEq)]
pub struct RayPacket {
    /// Starts, `[axis][ray]`, local metres.
    pub origin: [[f32; PACKET]; 3],
    /// Directions, `[axis][ray]`; need not be normalised.
    pub direction: [[f32; PACKET]; 3],
    /// As [`Ray::t_min`].
    pub t_min: [f32; PACKET],
    /// As [`Ray::t_max`].
    pub t_max: [f32; PACKET],
    /// Bit k: ray k is to be traced.
    pub active: u16,
}

impl RayPacket {
    /// A packet without active rays.
    pub const EMPTY: Self = Self {
        origin: [[0.0; PACKET]; 3],
        direction: [[0.0; PACKET]; 3],
        t_min: [0.0; PACKET],
        t_max: [f32::INFINITY; PACKET],
        active: 0,
    };

    /// The rays of a slice, the first [`PACKET`] of them, all active.
    pub fn from_rays(rays: &[Ray]) -> Self {
        let mut packet = Self::EMPTY;
        for (k, ray) in rays.iter().take(PACKET).enumerate() {
            packet.set(k, ray);
        }
        packet
    }

    /// Sets ray `k` and makes it active. Ignored unless `k` is less than [`PACKET`].
    #[inline]
    pub fn set(&mut self, k: usize, ray: &Ray) {
        if k < PACKET {
            for axis in 0..3 {
                self.origin[axis][k] = ray.origin[axis];
                self.direction[axis][k] = ray.direction[axis];
            }
            self.t_min[k] = ray.t_min;
            self.t_max[k] = ray.t_max;
            self.active |= 1 << k;
        }
    }

    /// Ray `k`, or `None` if it is not active.
    #[inline]
    pub fn ray(&self, k: usize) -> Option<Ray> {
        (k < PACKET && self.active >> k & 1 == 1).then(|| Ray {
            origin: Vec3::from_array(each_axis!(a => self.origin[a][k])),
            direction: Vec3::from_array(each_axis!(a => self.direction[a][k])),
            t_min: self.t_min[k],
            t_max: self.t_max[k],
        })
    }
}

/// The closest hits of a packet's rays.
#[repr(C, align(64))]
#[derive(Clone, Debug, PartialEq)]
pub struct HitPacket {
    /// As [`super::Hit::t`]; infinite where the ray hits nothing or is not active.
    pub t: [f32; PACKET],
    /// As [`super::Hit::primitive`]; `u32::MAX` where there is no hit.
    pub primitive: [u32; PACKET],
    /// As [`super::Hit::u`]; 0 where there is no hit.
    pub u: [f32; PACKET],
    /// As [`super::Hit::v`]; 0 where there is no hit.
    pub v: [f32; PACKET],
}

impl HitPacket {
    /// No hits.
    pub const MISS: Self =
        Self { t: [f32::INFINITY; PACKET], primitive: [u32::MAX; PACKET], u: [0.0; PACKET], v: [0.0; PACKET] };

    /// The hit of ray `k`, if there is one.
    #[inline]
    pub fn hit(&self, k: usize) -> Option<super::Hit> {
        let primitive = *self.primitive.get(k)?;
        (primitive != u32::MAX).then(|| super::Hit { t: self.t[k], primitive, u: self.u[k], v: self.v[k] })
    }
}

/// Closest hits of each packet.
#[inline(always)]
pub(super) fn closest<S: Simd>(simd: S, tracer: &Tracer, rays: &[RayPacket], hits: &mut [HitPacket]) {
    let (mut small, mut large) = ([Entry::EMPTY; SMALL_STACK], Vec::new());
    let stack = tracer.tree.stack(&mut small, &mut large);
    for (rays, hits) in rays.iter().zip(hits) {
        let mut found = Lanes::new(rays);
        trace::<S, false>(simd, tracer, rays, &mut found, stack);
        *hits = found.hits();
    }
}

/// Blocked rays of each packet.
#[inline(always)]
pub(super) fn occluded<S: Simd>(simd: S, tracer: &Tracer, rays: &[RayPacket], blocked: &mut [u16]) {
    let (mut small, mut large) = ([Entry::EMPTY; SMALL_STACK], Vec::new());
    let stack = tracer.tree.stack(&mut small, &mut large);
    for (rays, blocked) in rays.iter().zip(blocked) {
        let mut found = Lanes::new(rays);
        trace::<S, true>(simd, tracer, rays, &mut found, stack);
        *blocked = found.blocked;
    }
}

/// The state of 16 searches.
#[repr(C, align(64))]
struct Lanes {
    t: [f32; PACKET],
    primitive: [u32; PACKET],
    /// Barycentric weights of the second and third vertex, over `determinant`.
    v: [f32; PACKET],
    w: [f32; PACKET],
    determinant: [f32; PACKET],
    /// For occlusion: rays that need no further search. Their `t` is minus infinity.
    blocked: u16,
}

impl Lanes {
    #[inline(always)]
    fn new(rays: &RayPacket) -> Self {
        Self {
            t: rays.t_max,
            primitive: [u32::MAX; PACKET],
            v: [0.0; PACKET],
            w: [0.0; PACKET],
            determinant: [1.0; PACKET],
            blocked: 0,
        }
    }

    #[inline(always)]
    fn candidate(&self, k: usize) -> Candidate {
        Candidate { t: self.t[k], v: self.v[k], w: self.w[k], determinant: self.determinant[k] }
    }

    #[inline(always)]
    fn set(&mut self, k: usize, primitive: u32, candidate: Candidate) {
        self.primitive[k] = primitive;
        (self.t[k], self.v[k], self.w[k]) = (candidate.t, candidate.v, candidate.w);
        self.determinant[k] = candidate.determinant;
    }

    #[inline(always)]
    fn block(&mut self, k: usize) {
        self.t[k] = f32::NEG_INFINITY;
        self.blocked |= 1 << k;
    }

    #[inline(always)]
    fn hits(&self) -> HitPacket {
        let mut hits = HitPacket::MISS;
        for k in 0..PACKET {
            let [u, v] = self.candidate(k).barycentric();
            let missed = self.primitive[k] == u32::MAX;
            hits.t[k] = if missed { f32::INFINITY } else { self.t[k] };
            hits.primitive[k] = self.primitive[k];
            hits.u[k] = if missed { 0.0 } else { u };
            hits.v[k] = if missed { 0.0 } else { v };
        }
        hits
    }
}

/// The rays of a packet, ready for traversal: [`Prepared`] in arrays.
#[repr(C, align(64))]
struct PreparedPacket {
    near_origin: [[f32; PACKET]; 3],
    far_origin: [[f32; PACKET]; 3],
    inverse: [[f32; PACKET]; 3],
    shear: [[f32; PACKET]; 2],
    inverse_main: [f32; PACKET],
    main_axis: [u32; PACKET],
    valid: [bool; PACKET],
}

impl PreparedPacket {
    /// Branch-free over the rays, so that it is compiled to vectors.
    #[inline(always)]
    fn new(rays: &RayPacket) -> Self {
        let mut p = Self {
            near_origin: [[0.0; PACKET]; 3],
            far_origin: [[0.0; PACKET]; 3],
            inverse: [[0.0; PACKET]; 3],
            shear: [[0.0; PACKET]; 2],
            inverse_main: [0.0; PACKET],
            main_axis: [0; PACKET],
            valid: [false; PACKET],
        };
        for k in 0..PACKET {
            let (origin, direction) = (each_axis!(a => rays.origin[a][k]), each_axis!(a => rays.direction[a][k]));
            let (largest_origin, largest_direction) = (largest(origin), largest(direction));
            let sum = origin[0] + origin[1] + origin[2] + direction[0] + direction[1] + direction[2];
            p.valid[k] = is_valid(largest_origin, largest_direction, sum, rays.t_min[k], rays.t_max[k]);
            for axis in 0..3 {
                let slab = Slab::new(origin[axis], direction[axis], largest_origin, largest_direction);
                p.near_origin[axis][k] = slab.near_origin;
                p.far_origin[axis][k] = slab.far_origin;
                p.inverse[axis][k] = slab.inverse;
            }
            let main = main_axis(direction);
            let pick = |v: [f32; 3], shift: u32| {
                let axis = main + shift; // 0 to 4, cyclic
                if axis == 1 || axis == 4 {
                    v[1]
                } else if axis == 2 {
                    v[2]
                } else {
                    v[0]
                }
            };
            let inverse = [p.inverse[0][k], p.inverse[1][k], p.inverse[2][k]];
            p.main_axis[k] = main;
            p.inverse_main[k] = pick(inverse, 0);
            p.shear[0][k] = pick(direction, 1) * p.inverse_main[k];
            p.shear[1][k] = pick(direction, 2) * p.inverse_main[k];
        }
        p
    }

    /// Ray `k` by itself.
    #[inline(always)]
    fn ray(&self, rays: &RayPacket, k: usize) -> Prepared {
        let axes = axes_of(self.main_axis[k]);
        Prepared {
            slabs: each_axis!(a => Slab {
                near_origin: self.near_origin[a][k],
                far_origin: self.far_origin[a][k],
                inverse: self.inverse[a][k],
            }),
            axes,
            origin: each_axis!(i => rays.origin[axes[i]][k]),
            shear: [self.shear[0][k], self.shear[1][k]],
            t_min: rays.t_min[k],
        }
    }
}

/// Everything that the traversal of a packet reads.
struct Walk<'a, S: Simd> {
    simd: S,
    tracer: &'a Tracer,
    rays: &'a RayPacket,
    prepared: &'a PreparedPacket,
    /// Rows of a node's planes through which the rays enter, by axis.
    near_rows: [usize; 3],
    /// The axes of the shear if all rays share them.
    axes: Option<[usize; 3]>,
}

/// Traces a packet; `ANY` is for occlusion.
#[inline(always)]
fn trace<S: Simd, const ANY: bool>(simd: S, tracer: &Tracer, rays: &RayPacket, found: &mut Lanes, stack: &mut [Entry]) {
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
    let same_main = u32x16::load_array_ref(simd, &prepared.main_axis).simd_eq(u32x16::splat(simd, main));
    let walk = Walk {
        simd,
        tracer,
        rays,
        prepared: &prepared,
        near_rows: each_axis!(a => if negative[a] == 0 { a } else { a + 3 }),
        axes: if same_main.to_bitmask() as u32 & active == active { Some(axes_of(main)) } else { None },
    };
    let agree = |bits: u32| bits == 0 || bits == active;
    if agree(negative[0]) && agree(negative[1]) && agree(negative[2]) && active.count_ones() > ALONE {
        walk.together::<ANY>(active, found, stack);
    } else {
        walk.alone::<ANY>(active, found, 0, stack);
    }
}

impl<S: Simd> Walk<'_, S> {
    /// Traverses the subtree of `node` by each of the rays `lanes` by itself.
    #[inline(always)]
    fn alone<const ANY: bool>(&self, mut lanes: u32, found: &mut Lanes, node: u32, stack: &mut [Entry]) {
        while lanes != 0 {
            let k = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let ray = self.prepared.ray(self.rays, k);
            if ANY {
                let mut search = Occluded::new(found.t[k]);
                traverse_alone(self.simd, self.tracer, &ray, &mut search, node, stack);
                if search.blocked() {
                    found.block(k);
                }
            } else {
                let mut search = Closest { primitive: found.primitive[k], candidate: found.candidate(k) };
                traverse_alone(self.simd, self.tracer, &ray, &mut search, node, stack);
                found.set(k, search.primitive, search.candidate);
            }
        }
    }

    /// Traverses the tree by the rays `active` together.
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
            let (parent, slot) = (entry.name() as usize / WIDTH, entry.name() as usize % WIDTH);
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
            } else if entered.count_ones() <= ALONE {
                self.alone::<ANY>(entered, found, child.index(), &mut stack[len..]);
                limit = self.limit(active, found);
            } else {
                let node = child.index();
                len = beam.push_children(node, &nodes[node as usize], limit, stack, len);
            }
        }
    }

    /// Tests the rays `lanes` against the triangles of a leaf, whose box they enter at `enter`. Whether anything was
    /// hit.
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

    /// The farthest distance that any ray still cares about; minus infinity if all are blocked.
    #[inline(always)]
    fn limit(&self, active: u32, found: &Lanes) -> f32 {
        self.greatest(active, &found.t)
    }

    #[inline(always)]
    fn load(&self, row: &[f32; PACKET]) -> f32x16<S> {
        f32x16::load_array_ref(self.simd, row)
    }

    #[inline(always)]
    fn mask(&self, lanes: u32) -> mask32x16<S> {
        mask32x16::from_bitmask(self.simd, u64::from(lanes))
    }

    /// The greatest value of the rays `active`.
    #[inline(always)]
    fn greatest(&self, active: u32, row: &[f32; PACKET]) -> f32 {
        self.mask(active).select(self.load(row), f32x16::splat(self.simd, f32::NEG_INFINITY)).reduce_max()
    }

    /// The least value of the rays `active`.
    #[inline(always)]
    fn least(&self, active: u32, row: &[f32; PACKET]) -> f32 {
        self.mask(active).select(self.load(row), f32x16::splat(self.simd, f32::INFINITY)).reduce_min()
    }

    /// Which rays enter the box of a child before their limits, and where (not before their `t_min`).
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
        let enter = near[0].max(near[1]).max(near[2].max(self.load(&self.rays.t_min)));
        let leave = far[0].min(far[1]).min(far[2].min(self.load(&found.t)));
        (enter, enter.simd_le(leave).to_bitmask() as u32)
    }

    /// Tests the rays `lanes` against a triangle. `enter` is where they enter its leaf's box. Whether any hit it.
    #[inline(always)]
    fn intersect<const ANY: bool>(
        &self,
        block: &Block,
        slot: usize,
        lanes: u32,
        enter: f32x16<S>,
        found: &mut Lanes,
    ) -> bool {
        let shear = [self.load(&self.prepared.shear[0]), self.load(&self.prepared.shear[1])];
        let edges = edges(self.relative(block, slot), shear);
        let inside = edges.inside() & self.mask(lanes);
        if inside.all_false() {
            return false;
        }
        let zero = f32x16::splat(self.simd, 0.0);
        let (determinant, t) = edges.determinant_and_t(self.load(&self.prepared.inverse_main));
        let degenerate = (inside & determinant.simd_eq(zero)).to_bitmask() as u32;
        let primitive = block.primitives[slot];
        let inside = inside & t.simd_ge(self.load(&self.rays.t_min));
        // As `Candidate::t_from`.
        let t = t.simd_gt(enter).select(t, enter) + zero;
        let best = self.load(&found.t);
        let best_primitive = u32x16::load_array_ref(self.simd, &found.primitive);
        let first = t.simd_eq(best) & u32x16::splat(self.simd, primitive).simd_lt(best_primitive);
        let wanted = (inside & (t.simd_lt(best) | first)).to_bitmask() as u32 & !degenerate;
        let [_, v, w] = edges.weights;
        if block.cutouts >> slot & 1 == 1 || degenerate != 0 {
            let candidates = [t.to_array(), v.to_array(), w.to_array(), determinant.to_array()];
            return self.one_by_one::<ANY>(block, slot, wanted, degenerate, &candidates, &enter.to_array(), found);
        }
        let mask = self.mask(wanted);
        if wanted == 0 {
            return false;
        } else if ANY {
            found.blocked |= wanted as u16;
            mask.select(f32x16::splat(self.simd, f32::NEG_INFINITY), best).store_array(&mut found.t);
        } else {
            mask.select(t, best).store_array(&mut found.t);
            mask.select(v, self.load(&found.v)).store_array(&mut found.v);
            mask.select(w, self.load(&found.w)).store_array(&mut found.w);
            mask.select(determinant, self.load(&found.determinant)).store_array(&mut found.determinant);
            mask.select(u32x16::splat(self.simd, primitive), best_primitive).store_array(&mut found.primitive);
        }
        true
    }

    /// The rare end of [`Self::intersect`]: cut-outs, and triangles whose edge functions all round to zero.
    #[inline(never)]
    fn one_by_one<const ANY: bool>(
        &self,
        block: &Block,
        slot: usize,
        wanted: u32,
        degenerate: u32,
        [t, v, w, determinant]: &[[f32; PACKET]; 4],
        enter: &[f32; PACKET],
        found: &mut Lanes,
    ) -> bool {
        let primitive = block.primitives[slot];
        let mut hit = false;
        let mut lanes = wanted | degenerate;
        while lanes != 0 {
            let k = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let mut candidate = Candidate { t: t[k], v: v[k], w: w[k], determinant: determinant[k] };
            if degenerate >> k & 1 == 1 {
                let ray = self.prepared.ray(self.rays, k);
                let exact = exact(relative(block, slot, &ray), ray.shear, ray.inverse_main());
                let Some(exact) = exact.filter(|exact| exact.t >= ray.t_min) else { continue };
                candidate = Candidate { t: exact.t_from(enter[k]), ..exact };
                let first = candidate.t == found.t[k] && primitive < found.primitive[k];
                if !(candidate.t < found.t[k] || first) {
                    continue;
                }
            }
            let opaque = block.cutouts >> slot & 1 == 0
                || self.tracer.cutouts.is_opaque(&self.tracer.scene, primitive, candidate.barycentric());
            hit |= opaque;
            match (opaque, ANY) {
                (false, _) => {}
                (true, true) => found.block(k),
                (true, false) => found.set(k, primitive, candidate),
            }
        }
        hit
    }

    /// A coordinate of a vertex relative to each ray's origin.
    #[inline(always)]
    fn relative_coordinate(&self, block: &Block, slot: usize, vertex: usize, axis: usize) -> f32x16<S> {
        f32x16::splat(self.simd, block.vertices[vertex][axis][slot]) - self.load(&self.rays.origin[axis])
    }

    /// A triangle's vertices relative to each ray's origin, on the axes of each ray's shear.
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
            // The rows are axes_of(0), axes_of(1), axes_of(2).
            let choices = [[y, z, x], [z, x, y], [x, y, z]];
            each_axis!(i => is_x.select(choices[0][i], is_y.select(choices[1][i], choices[2][i])))
        })
    }
}

/// [`single::traverse`] as a function of its own in code compiled for the SIMD level.
#[inline(always)]
fn traverse_alone<S: Simd, F: single::Found>(
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

/// Intervals around the rays of a packet, in every lane.
struct Beam<S: Simd> {
    simd: S,
    near_rows: [usize; 3],
    /// The extreme `near_origin` and `far_origin` that enter earliest and leave latest.
    near_origin: [f32x8<S>; 3],
    far_origin: [f32x8<S>; 3],
    /// Least and greatest reciprocal direction.
    inverse: [[f32x8<S>; 2]; 3],
    t_min: f32x8<S>,
}

impl<S: Simd> Beam<S> {
    #[inline(always)]
    fn new(walk: &Walk<'_, S>, active: u32) -> Self {
        let (simd, p) = (walk.simd, walk.prepared);
        let positive = each_axis!(a => walk.near_rows[a] == a);
        Self {
            simd,
            near_rows: walk.near_rows,
            near_origin: each_axis!(a => {
                let row = &p.near_origin[a];
                f32x8::splat(simd, if positive[a] { walk.greatest(active, row) } else { walk.least(active, row) })
            }),
            far_origin: each_axis!(a => {
                let row = &p.far_origin[a];
                f32x8::splat(simd, if positive[a] { walk.least(active, row) } else { walk.greatest(active, row) })
            }),
            inverse: each_axis!(a => {
                let row = &p.inverse[a];
                [f32x8::splat(simd, walk.least(active, row)), f32x8::splat(simd, walk.greatest(active, row))]
            }),
            t_min: f32x8::splat(simd, walk.least(active, &walk.rays.t_min)),
        }
    }

    /// Which of a node's children any ray may enter before `limit`, and a lower bound of where. Each operation is
    /// monotone in its arguments, so the bounds hold for the rounded results of every ray.
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
        let leave = far[0].min(far[1]).min(far[2].min(f32x8::splat(self.simd, limit)));
        (enter.to_array(), enter.simd_le(leave).to_bitmask() as u32)
    }

    /// Pushes the children that any ray may enter, the nearest last, and returns the stack's new length.
    #[inline(always)]
    fn push_children(&self, index: u32, node: &Node, limit: f32, stack: &mut [Entry], base: usize) -> usize {
        let (enter, entered) = self.enter(node, limit);
        // The child's box is tested later, so its entry is named by where it hangs.
        push_sorted(stack, base, entered, |slot| Entry::new(enter[slot % WIDTH], index * WIDTH as u32 + slot as u32))
    }
}
