//! Blocks of pixels with the sums of each surface in them, each size twice as wide as the one
//! before.

use super::GatheredLight;
use super::surface_key::SurfaceKey;
use super::window::{SHARE, Sums, add, sums};
use crate::surfaces::rows;
use crate::surfaces::surface_samples::FaceSurfaces;
use rayon::prelude::*;
use std::ops::Range;

/// Approximate width of the largest blocks, pixels.
const LARGEST_PX: f32 = 64.0;

/// Minimum width of blocks, pixels, where they can be wider.
const SMALLEST_PX: f32 = 3.0;

/// Minimum share of a large block that a surface must fill to be followed to it; otherwise, there
/// would be hundreds of leaves.
const LEAST_SHARE: f32 = 1.0 / 16.0;

/// Number of levels that follow every surface.
const WHOLE_LEVELS: usize = 2;

/// Parent of a surface that is not followed.
const NOT_FOLLOWED: u32 = u32::MAX;

/// Sums of each surface in one cell.
type Cell = Vec<(SurfaceKey, Sums)>;

/// Sums of each surface in each cell of a square lattice.
#[derive(Clone, Default)]
pub(super) struct Lattice {
    /// Prefix sums over the cells in row-major order.
    starts: Vec<u32>,
    pub(super) keys: Vec<SurfaceKey>,
    pub(super) sums: Vec<Sums>,
}

impl Lattice {
    /// Indices of the surfaces in a cell.
    pub(super) fn cell(&self, cell: usize) -> Range<usize> {
        self.starts[cell] as usize..self.starts[cell + 1] as usize
    }

    /// The sums of a surface in a cell.
    #[inline]
    pub(super) fn find(&self, cell: usize, key: &SurfaceKey) -> Option<&Sums> {
        let run = self.cell(cell);
        let position = self.keys[run.clone()]
            .iter()
            .position(|other| key.is_same(other))?;
        Some(&self.sums[run.start + position])
    }

    /// Indices of the surfaces in row `y` of `side` cells.
    fn row(&self, y: usize, side: u32) -> Range<usize> {
        let [first, end] = [y, y + 1].map(|y| self.starts[y * side as usize] as usize);
        first..end
    }

    /// A lattice of cells, row after row.
    pub(super) fn from_rows(rows: Vec<Vec<Cell>>) -> Self {
        let mut lattice = Self {
            starts: vec![0],
            ..Self::default()
        };
        for cell in rows.into_iter().flatten() {
            for (key, sums) in cell {
                lattice.keys.push(key);
                lattice.sums.push(sums);
            }
            lattice.starts.push(lattice.keys.len() as u32);
        }
        lattice
    }
}

/// The blocks of a face, from the smallest to the largest.
#[derive(Clone)]
pub(crate) struct Blocks {
    pub(super) levels: Vec<BlockLevel>,
}

/// Blocks of one size.
#[derive(Clone)]
pub(super) struct BlockLevel {
    /// Blocks along a side.
    pub(super) blocks: u32,
    pub(super) lattice: Lattice,
    /// Index of each of the lattice's surfaces in the next level, or [`NOT_FOLLOWED`].
    parents: Vec<u32>,
}

/// Membership of a face's surface samples in the smallest blocks.
pub(crate) struct BlockMembership {
    /// Index of each sample's surface in the smallest blocks.
    pub(super) surface: Vec<u32>,
    /// Weight of each sample: one over the number of samples of its surface in its pixel, so that
    /// their mean counts.
    weight: Vec<f32>,
    /// Index of the first sample in each row of the smallest blocks, and the number of all samples.
    rows: Vec<usize>,
}

/// Number of blocks along a side, from the smallest blocks to the largest.
fn level_sizes(size_px: u32) -> Vec<u32> {
    let mut blocks = (size_px as f32 / LARGEST_PX).round().max(1.0) as u32;
    let mut sizes = vec![blocks];
    while size_px as f32 >= SMALLEST_PX * (2 * blocks) as f32 {
        blocks *= 2;
        sizes.insert(0, blocks);
    }
    sizes
}

/// The pixels of a block along one side of a face.
fn pixel_range(block: u32, blocks: u32, size_px: u32) -> Range<u32> {
    (block * size_px).div_ceil(blocks)..((block + 1) * size_px).div_ceil(blocks)
}

impl Blocks {
    /// Blocks of a face's surfaces, with their shares of the pixels but without light.
    pub(crate) fn new(surfaces: &FaceSurfaces) -> (Self, BlockMembership) {
        let keys: Vec<SurfaceKey> = surfaces.samples.par_iter().map(SurfaceKey::new).collect();
        let sizes = level_sizes(surfaces.size_px);
        let (smallest, membership) = smallest_level(surfaces, &keys, sizes[0]);
        let mut levels = vec![smallest];
        for (number, &blocks) in sizes.iter().enumerate().skip(1) {
            let width_px = surfaces.size_px as f32 / blocks as f32;
            let least = if number < WHOLE_LEVELS {
                0.0
            } else {
                LEAST_SHARE * width_px * width_px
            };
            let next = levels
                .last_mut()
                .map(|below| next_level(below, blocks, least));
            levels.extend(next);
        }
        (Self { levels }, membership)
    }

    /// The surfaces of the smallest blocks, each with the middle of its block, pixels.
    pub(super) fn middles(&self, size_px: u32) -> Vec<(SurfaceKey, [f32; 2])> {
        let BlockLevel {
            blocks, lattice, ..
        } = &self.levels[0];
        let middle = |cell: u32| {
            [cell % blocks, cell / blocks]
                .map(|c| (c as f32 + 0.5) * size_px as f32 / *blocks as f32)
        };
        let middles = (0..blocks * blocks)
            .flat_map(|cell| lattice.cell(cell as usize).map(move |_| middle(cell)));
        lattice.keys.iter().copied().zip(middles).collect()
    }

    /// Sums the gathered light of the surface samples.
    pub(crate) fn fill(&mut self, membership: &BlockMembership, gathered: &[GatheredLight]) {
        self.levels[0].for_each_row(|y, first, row_sums| {
            for i in membership.rows[y]..membership.rows[y + 1] {
                let index = membership.surface[i] as usize - first;
                add(
                    &mut row_sums[index],
                    &sums(&gathered[i]),
                    membership.weight[i],
                );
            }
        });
        for number in 1..self.levels.len() {
            let (below, above) = self.levels.split_at_mut(number);
            let below = &below[number - 1];
            above[0].for_each_row(|y, first, row_sums| {
                let [upper, lower] = [2 * y, 2 * y + 1].map(|y| below.lattice.row(y, below.blocks));
                for child in upper.start..lower.end {
                    if below.parents[child] != NOT_FOLLOWED {
                        let index = below.parents[child] as usize - first;
                        add(&mut row_sums[index], &below.lattice.sums[child], 1.0);
                    }
                }
            });
        }
    }
}

impl BlockLevel {
    /// Calls `fill` for each row of blocks with its number, the index of its first surface and the
    /// row's sums, which are zero.
    fn for_each_row(&mut self, fill: impl Fn(usize, usize, &mut [Sums]) + Sync) {
        let Lattice { starts, sums, .. } = &mut self.lattice;
        let rows = rows::split_rows(starts, self.blocks, sums);
        rows.into_par_iter()
            .enumerate()
            .for_each(|(y, (first, sums))| {
                sums.fill(Sums::default());
                fill(y, first, sums);
            });
    }
}

/// Membership of a surface sample before the surfaces of all cells are numbered.
#[derive(Clone, Copy)]
struct CellMember {
    /// Column of the cell.
    column: u32,
    /// Index of the sample's surface in its cell.
    index: u32,
    weight: f32,
}

/// The smallest blocks. Surfaces are identified by the first sample of each.
fn smallest_level(
    surfaces: &FaceSurfaces,
    keys: &[SurfaceKey],
    blocks: u32,
) -> (BlockLevel, BlockMembership) {
    let size_px = surfaces.size_px;
    // A row of blocks: its cells, and the membership of its samples.
    let row = |block_row: u32| {
        let rows = pixel_range(block_row, blocks, size_px);
        let [first, end] =
            [rows.start, rows.end].map(|y| surfaces.offsets[(y * size_px) as usize] as usize);
        let mut cells = vec![Cell::new(); blocks as usize];
        let unset = CellMember {
            column: 0,
            index: 0,
            weight: 0.0,
        };
        let mut members = vec![unset; end - first];
        for y in rows {
            for (column, cell) in (0..).zip(&mut cells) {
                for run in pixel_range(column, blocks, size_px).map(|x| surfaces.range(x, y)) {
                    for i in run.clone() {
                        members[i - first] = CellMember {
                            column,
                            index: find_or_add(cell, &keys[i]) as u32,
                            weight: 0.0,
                        };
                    }
                    let pixel = &mut members[run.start - first..run.end - first];
                    for i in 0..pixel.len() {
                        let index = pixel[i].index;
                        let count = pixel.iter().filter(|other| other.index == index).count();
                        let weight = 1.0 / count as f32;
                        pixel[i].weight = weight;
                        cell[index as usize].1[SHARE] += weight;
                    }
                }
            }
        }
        (cells, members)
    };
    let (rows, members): (Vec<_>, Vec<_>) = (0..blocks).into_par_iter().map(row).unzip();
    let lattice = Lattice::from_rows(rows);
    let mut membership = BlockMembership {
        surface: Vec::with_capacity(keys.len()),
        weight: Vec::with_capacity(keys.len()),
        rows: vec![0],
    };
    for (block_row, members) in members.into_iter().enumerate() {
        membership
            .rows
            .push(membership.surface.len() + members.len());
        for member in members {
            let cell = block_row * blocks as usize + member.column as usize;
            membership.surface.push(lattice.starts[cell] + member.index);
            membership.weight.push(member.weight);
        }
    }
    let level = BlockLevel {
        blocks,
        lattice,
        parents: Vec::new(),
    };
    (level, membership)
}

/// The index of a surface in a cell, to which it is added if it is new.
fn find_or_add(cell: &mut Cell, key: &SurfaceKey) -> usize {
    let index = cell.iter().position(|(other, _)| key.is_same(other));
    index.unwrap_or_else(|| {
        cell.push((*key, Sums::default()));
        cell.len() - 1
    })
}

/// The blocks twice as wide as those `below`. Surfaces that fill fewer pixels than `least` are left
/// out.
fn next_level(below: &mut BlockLevel, blocks: u32, least: f32) -> BlockLevel {
    // A row of blocks: its cells, and for each surface of the two rows below, the new block and the
    // index there if the surface is followed.
    let row = |y: u32| {
        let mut cells = Vec::with_capacity(blocks as usize);
        let mut parents = Vec::new();
        for x in 0..blocks {
            let (cell, children) = merge_cells(below, [x, y], least);
            cells.push(cell);
            parents.extend(
                children
                    .into_iter()
                    .map(|(child, index)| (child, index.map(|index| (x, index)))),
            );
        }
        (cells, parents)
    };
    let (rows, parents): (Vec<_>, Vec<_>) = (0..blocks).into_par_iter().map(row).unzip();
    let lattice = Lattice::from_rows(rows);
    below.parents = vec![NOT_FOLLOWED; below.lattice.keys.len()];
    for (y, parents) in (0..).zip(parents) {
        for (child, parent) in parents {
            let parent = parent.map(|(x, index)| lattice.starts[(y * blocks + x) as usize] + index);
            below.parents[child] = parent.unwrap_or(NOT_FOLLOWED);
        }
    }
    BlockLevel {
        blocks,
        lattice,
        parents: Vec::new(),
    }
}

/// The surfaces of block (x, y) of twice the width, and for each surface of the four blocks below
/// its index among them, if it is followed.
fn merge_cells(
    below: &BlockLevel,
    [x, y]: [u32; 2],
    least: f32,
) -> (Cell, Vec<(usize, Option<u32>)>) {
    let children = [
        (2 * x, 2 * y),
        (2 * x + 1, 2 * y),
        (2 * x, 2 * y + 1),
        (2 * x + 1, 2 * y + 1),
    ];
    let mut cell = Cell::new();
    let mut members = Vec::new();
    for child in children
        .into_iter()
        .flat_map(|(x, y)| below.lattice.cell((y * below.blocks + x) as usize))
    {
        let index = find_or_add(&mut cell, &below.lattice.keys[child]);
        add(&mut cell[index].1, &below.lattice.sums[child], 1.0);
        members.push((child, index));
    }
    let is_followed = |(_, sums): &(SurfaceKey, Sums)| sums[SHARE] >= least;
    let mut indices = 0..;
    let new_index = |surface| is_followed(surface).then(|| indices.next()).flatten();
    let new_indices: Vec<Option<u32>> = cell.iter().map(new_index).collect();
    cell.retain(is_followed);
    let members = members
        .into_iter()
        .map(|(child, index)| (child, new_indices[index]))
        .collect();
    (cell, members)
}
