//! Tree layout: nodes of eight children and blocks of eight triangles, in the order of traversal.

use super::prepared::GROWTH;
use fearless_simd::{Simd, f32x8, prelude::*};
use glam::Vec3;

/// Number of children of a node.
pub(super) const WIDTH: usize = 8;

/// Maximum number of triangles of a block.
pub(super) const BLOCK: usize = 8;

/// Eight bounding boxes and their children. Unused slots are inverted boxes, which no ray enters.
#[repr(C, align(64))]
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// Lower planes on x, y, z, then upper planes on x, y, z.
    pub(super) planes: [[f32; WIDTH]; 6],
    /// Child in each box.
    pub(super) child: [Child; WIDTH],
}

const _: () = assert!(size_of::<Node>() == 256, "four cache lines");

impl Node {
    /// Node without children.
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

    /// Returns the bounding box of all children.
    pub(super) fn bounds(&self) -> Bounds {
        let over =
            |row: [f32; WIDTH], f: fn(f32, f32) -> f32, start| row.into_iter().fold(start, f);
        let p = &self.planes;
        Bounds {
            min: Vec3::from_array([0, 1, 2].map(|a| over(p[a], f32::min, f32::INFINITY))),
            max: Vec3::from_array([3, 4, 5].map(|a| over(p[a], f32::max, f32::NEG_INFINITY))),
        }
    }

    /// Loads a row of planes as a vector.
    #[inline(always)]
    pub(super) fn row<S: Simd>(&self, simd: S, row: usize) -> f32x8<S> {
        f32x8::load_array_ref(simd, &self.planes[row])
    }
}

/// Returns the row of planes on the opposite side of the box.
#[inline]
pub(super) fn opposite(row: usize) -> usize {
    if row < 3 { row + 3 } else { row - 3 }
}

/// Axis-aligned bounding box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub(super) min: Vec3,
    pub(super) max: Vec3,
}

impl Bounds {
    /// Computes the bounding box of a leaf's triangles, enlarged as [`super::prepared`] requires.
    pub(super) fn from_triangles(triangles: impl Iterator<Item = [Vec3; 3]>) -> Self {
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

/// Block of up to eight triangles. Unused slots are NaN, which no ray hits.
#[repr(C, align(64))]
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// Vertex positions, `[vertex][axis][slot]`, local metres.
    pub(super) vertices: [[[f32; BLOCK]; 3]; 3],
    /// Indices into the scene's triangles.
    pub(super) primitives: [u32; BLOCK],
    /// Mask of the triangles with a cut-out: bit k for slot k.
    pub(super) cutouts: u32,
    /// Mask of the single-sided triangles, likewise.
    pub(super) single_sided: u32,
    /// Number of triangles.
    pub(super) len: u16,
    /// True if the next block belongs to the same leaf.
    pub(super) more: bool,
}

const _: () = assert!(size_of::<Block>() == 384, "six cache lines");

impl Block {
    /// Block without triangles.
    pub(super) const EMPTY: Self = Self {
        vertices: [[[f32::NAN; BLOCK]; 3]; 3],
        primitives: [u32::MAX; BLOCK],
        cutouts: 0,
        single_sided: 0,
        len: 0,
        more: false,
    };

    /// Adds a triangle to a block that is not full.
    pub(super) fn push(
        &mut self,
        primitive: u32,
        triangle: [Vec3; 3],
        cutout: bool,
        single_sided: bool,
    ) {
        let slot = usize::from(self.len);
        for (vertex, position) in triangle.into_iter().enumerate() {
            for axis in 0..3 {
                self.vertices[vertex][axis][slot] = position[axis];
            }
        }
        self.primitives[slot] = primitive;
        self.cutouts |= u32::from(cutout) << slot;
        self.single_sided |= u32::from(single_sided) << slot;
        self.len += 1;
    }
}

/// Bounding volume hierarchy. Node 0 is the root; children come after their parents. Without nodes
/// there is nothing to hit.
#[derive(Debug, Default)]
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    pub(super) blocks: Vec<Block>,
    /// Maximum number of entries on a traversal's stack.
    pub(super) stack_len: usize,
}

/// Reference to a child: the index of a node or, with the highest bit set, of a leaf's first block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Child(u32);

impl Child {
    /// Value of unused slots, which no ray enters. (The root, node 0, is never a child.)
    pub(super) const NONE: Self = Self(0);
    const LEAF: u32 = 1 << 31;

    pub(super) fn node(index: usize) -> Self {
        Self(index as u32)
    }

    pub(super) fn leaf(first_block: usize) -> Self {
        Self(first_block as u32 | Self::LEAF)
    }

    /// Returns the first block, if this is a leaf.
    #[inline]
    pub(super) fn first_block(self) -> Option<usize> {
        (self.0 & Self::LEAF != 0).then_some((self.0 & !Self::LEAF) as usize)
    }

    /// Returns the node's index; call only if this is not a leaf.
    #[inline]
    pub(super) fn index(self) -> u32 {
        self.0
    }

    #[inline]
    pub(super) fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// Returns the bits, which are the payload of an [`Entry`].
    #[inline]
    pub(super) fn bits(self) -> u32 {
        self.0
    }
}

/// Entry of a traversal's stack: a payload of 32 bits that identifies a box, and the distance at
/// which the ray (or the first ray of a packet) enters it. Both are packed into one word that sorts
/// by distance: the bits of a non-negative `f32`, read as an integer, keep its order. (As two
/// fields of a struct, moving an entry stalled on loads wider than the stores before them.)
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Entry(u64);

impl Entry {
    pub(super) const EMPTY: Self = Self(0);

    /// Creates an entry; `enter` must not be negative.
    #[inline]
    pub(super) fn new(enter: f32, payload: u32) -> Self {
        Self(u64::from(enter.to_bits()) << 32 | u64::from(payload))
    }

    /// Returns the entry distance.
    #[inline]
    pub(super) fn enter(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }

    #[inline]
    pub(super) fn payload(self) -> u32 {
        self.0 as u32
    }
}

/// Pushes an entry for each bit set in `slots`, from far to near, and returns the new stack length.
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
        let mut position = len;
        while position > base && stack[position - 1] < new {
            stack[position] = stack[position - 1];
            position -= 1;
        }
        stack[position] = new;
        len += 1;
    }
    len
}

/// Stack length that needs no allocation; enough for a tree 13 levels deep (8^13 leaves if
/// balanced).
pub(super) const SMALL_STACK: usize = 96;

impl Tree {
    /// Returns a stack long enough for this tree: `small` if that suffices.
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
