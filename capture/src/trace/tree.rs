//! Nodes of eight children and blocks of four triangles, in the order of traversal.

use super::prepared::GROWTH;
use fearless_simd::{Simd, f32x8, prelude::*};
use glam::Vec3;

/// Children of a node.
pub(super) const WIDTH: usize = 8;

/// Triangles of a block.
pub(super) const BLOCK: usize = 4;

/// Eight boxes and what is in them. Unused slots are inside out, so that no ray enters them.
#[repr(C, align(64))]
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// Lower planes on x, y, z, then upper planes on x, y, z.
    pub(super) planes: [[f32; WIDTH]; 6],
    /// Index of a node, or of a leaf's first block.
    pub(super) child: [u32; WIDTH],
    /// Blocks of a leaf; 0 for an inner node.
    pub(super) blocks: [u8; WIDTH],
}

const _: () = assert!(size_of::<Node>() == 256, "four cache lines");

impl Node {
    /// A node without children.
    pub(super) const EMPTY: Self = Self {
        planes: [
            [f32::INFINITY; WIDTH],
            [f32::INFINITY; WIDTH],
            [f32::INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
        ],
        child: [0; WIDTH],
        blocks: [0; WIDTH],
    };

    /// Sets the box of a slot.
    pub(super) fn set_bounds(&mut self, slot: usize, bounds: Bounds) {
        for axis in 0..3 {
            self.planes[axis][slot] = bounds.min[axis];
            self.planes[axis + 3][slot] = bounds.max[axis];
        }
    }

    /// The box around all children.
    pub(super) fn bounds(&self) -> Bounds {
        let over = |row: [f32; WIDTH], f: fn(f32, f32) -> f32, start| row.into_iter().fold(start, f);
        let p = &self.planes;
        Bounds {
            min: Vec3::from_array([0, 1, 2].map(|a| over(p[a], f32::min, f32::INFINITY))),
            max: Vec3::from_array([3, 4, 5].map(|a| over(p[a], f32::max, f32::NEG_INFINITY))),
        }
    }

    /// A row of planes as a vector.
    #[inline(always)]
    pub(super) fn row<S: Simd>(&self, simd: S, row: usize) -> f32x8<S> {
        f32x8::load_array_ref(simd, &self.planes[row])
    }
}

/// The row of planes on the other side of the box.
#[inline(always)]
pub(super) fn opposite(row: usize) -> usize {
    if row < 3 { row + 3 } else { row - 3 }
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub(super) min: Vec3,
    pub(super) max: Vec3,
}

impl Bounds {
    /// The box around the vertices of a leaf's triangles, grown as [`super::prepared`] requires.
    pub(super) fn of_leaf(triangles: impl Iterator<Item = [Vec3; 3]>) -> Self {
        let empty = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };
        let tight =
            triangles.flatten().fold(empty, |bounds, p| Self { min: bounds.min.min(p), max: bounds.max.max(p) });
        let growth = tight.min.abs().max(tight.max.abs()).max_element() * GROWTH;
        Self { min: tight.min - growth, max: tight.max + growth }
    }
}

/// Up to four triangles. Unused slots are NaN, which no ray hits.
#[repr(C, align(64))]
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// `[vertex][axis][slot]`, local metres.
    pub(super) vertices: [[[f32; BLOCK]; 3]; 3],
    /// Indices into the scene's triangles.
    pub(super) primitives: [u32; BLOCK],
    /// Bit k: the triangle in slot k has a cut-out.
    pub(super) cutouts: u32,
    /// Number of triangles.
    pub(super) len: u32,
}

const _: () = assert!(size_of::<Block>() == 192, "three cache lines");

impl Block {
    /// A block without triangles.
    pub(super) const EMPTY: Self =
        Self { vertices: [[[f32::NAN; BLOCK]; 3]; 3], primitives: [u32::MAX; BLOCK], cutouts: 0, len: 0 };

    /// Adds a triangle; ignored if the block is full.
    pub(super) fn push(&mut self, primitive: u32, triangle: [Vec3; 3], cutout: bool) {
        let slot = self.len as usize;
        if slot == BLOCK {
            return;
        }
        for (vertex, position) in triangle.into_iter().enumerate() {
            for axis in 0..3 {
                self.vertices[vertex][axis][slot] = position[axis];
            }
        }
        self.primitives[slot] = primitive;
        self.cutouts |= u32::from(cutout) << slot;
        self.len += 1;
    }
}

/// The tree. Node 0 is the root; children come after their parents. No nodes: nothing to hit.
#[derive(Debug, Default)]
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    pub(super) blocks: Vec<Block>,
    /// The most entries a traversal's stack can hold.
    pub(super) stack_len: usize,
}

/// An entry of a traversal's stack: a child of a node and where the ray (or the first ray of a packet) enters it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    pub(super) near: f32,
    pub(super) node: u32,
    pub(super) slot: u32,
}

impl Entry {
    pub(super) const EMPTY: Self = Self { near: 0.0, node: 0, slot: 0 };
}

/// Entries that a traversal keeps without allocating; enough for a tree 13 levels deep (8^13 leaves if balanced).
pub(super) const SMALL_STACK: usize = 96;

impl Tree {
    /// A stack long enough for this tree: `small` if that will do.
    #[inline(always)]
    pub(super) fn stack<'a>(&self, small: &'a mut [Entry; SMALL_STACK], large: &'a mut Vec<Entry>) -> &'a mut [Entry] {
        if self.stack_len <= SMALL_STACK {
            small
        } else {
            large.resize(self.stack_len, Entry::EMPTY);
            large
        }
    }
}
