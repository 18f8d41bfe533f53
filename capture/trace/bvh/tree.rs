//! Nodes of eight children and blocks of eight triangles, in the order of traversal.

use super::prepared::GROWTH;
use fearless_simd::{Simd, f32x8, prelude::*};
use glam::Vec3;

/// Children of a node.
pub(super) const WIDTH: usize = 8;

/// Triangles of a block.
pub(super) const BLOCK: usize = 8;

/// Eight boxes and what is in them. Unused slots are inside out, so that no ray enters them.
#[repr(C, align(64))]
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// Lower planes on x, y, z, then upper planes on x, y, z.
    pub(super) planes: [[f32; WIDTH]; 6],
    /// What is in each box.
    pub(super) child: [Child; WIDTH],
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
        child: [Child::NONE; WIDTH],
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
        let over =
            |row: [f32; WIDTH], f: fn(f32, f32) -> f32, start| row.into_iter().fold(start, f);
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
#[inline]
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
        let empty = Self {
            min: Vec3::INFINITY,
            max: Vec3::NEG_INFINITY,
        };
        let tight = triangles.flatten().fold(empty, |bounds, p| Self {
            min: bounds.min.min(p),
            max: bounds.max.max(p),
        });
        let growth = tight.min.abs().max(tight.max.abs()).max_element() * GROWTH;
        Self {
            min: tight.min - growth,
            max: tight.max + growth,
        }
    }
}

/// Up to eight triangles. Unused slots are NaN, which no ray hits.
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
    pub(super) len: u16,
    /// Whether the next block belongs to the same leaf.
    pub(super) more: bool,
}

const _: () = assert!(size_of::<Block>() == 384, "six cache lines");

impl Block {
    /// A block without triangles.
    pub(super) const EMPTY: Self = Self {
        vertices: [[[f32::NAN; BLOCK]; 3]; 3],
        primitives: [u32::MAX; BLOCK],
        cutouts: 0,
        len: 0,
        more: false,
    };

    /// Adds a triangle; ignored if the block is full.
    pub(super) fn push(&mut self, primitive: u32, triangle: [Vec3; 3], cutout: bool) {
        let slot = usize::from(self.len);
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

/// What a box holds: the index of a node, or with the highest bit set that of a leaf's first block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Child(u32);

impl Child {
    /// In unused slots, which no ray enters. (Node 0 is nobody's child.)
    pub(super) const NONE: Self = Self(0);
    const LEAF: u32 = 1 << 31;

    pub(super) fn node(index: usize) -> Self {
        Self(index as u32)
    }

    pub(super) fn leaf(first_block: usize) -> Self {
        Self(first_block as u32 | Self::LEAF)
    }

    /// The first block, if this is a leaf.
    #[inline]
    pub(super) fn first_block(self) -> Option<usize> {
        if self.0 & Self::LEAF == 0 {
            None
        } else {
            Some((self.0 & !Self::LEAF) as usize)
        }
    }

    /// The node, if this is not a leaf.
    #[inline]
    pub(super) fn index(self) -> u32 {
        self.0
    }

    #[inline]
    pub(super) fn from_name(name: u32) -> Self {
        Self(name)
    }

    /// Its name in an [`Entry`].
    #[inline]
    pub(super) fn name(self) -> u32 {
        self.0
    }
}

/// An entry of a traversal's stack: a box, named by 32 bits, and where the ray (or the first ray of
/// a packet) enters it. In one word, so that entries sort by distance: the bits of a non-negative
/// `f32`, read as an integer, keep its order. (With the parts in a struct, moving an entry stalled
/// on loads wider than the stores before them.)
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Entry(u64);

impl Entry {
    pub(super) const EMPTY: Self = Self(0);

    /// `enter` is not negative.
    #[inline]
    pub(super) fn new(enter: f32, name: u32) -> Self {
        Self(u64::from(enter.to_bits()) << 32 | u64::from(name))
    }

    /// Where the box is entered.
    #[inline]
    pub(super) fn enter(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }

    #[inline]
    pub(super) fn name(self) -> u32 {
        self.0 as u32
    }
}

/// Pushes an entry for each bit of `slots`, from far to near, and returns the stack's new length.
#[inline(always)]
pub(super) fn push_sorted(
    stack: &mut [Entry],
    base: usize,
    mut slots: u32,
    entry: impl Fn(usize) -> Entry,
) -> usize {
    let mut len = base;
    while slots != 0 {
        let new = entry(slots.trailing_zeros() as usize);
        slots &= slots - 1;
        let mut at = len;
        while at > base && stack[at - 1] < new {
            stack[at] = stack[at - 1];
            at -= 1;
        }
        stack[at] = new;
        len += 1;
    }
    len
}

/// Entries that a traversal keeps without allocating; enough for a tree 13 levels deep (8^13 leaves
/// if balanced).
pub(super) const SMALL_STACK: usize = 96;

impl Tree {
    /// A stack long enough for this tree: `small` if that will do.
    #[inline(always)]
    pub(super) fn stack<'a>(
        &self,
        small: &'a mut [Entry; SMALL_STACK],
        large: &'a mut Vec<Entry>,
    ) -> &'a mut [Entry] {
        if self.stack_len <= SMALL_STACK {
            small
        } else {
            large.resize(self.stack_len, Entry::EMPTY);
            large
        }
    }
}
