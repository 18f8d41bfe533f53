//! Blocks of pixels and the sums of each surface in them, each size twice as wide as the one before.

use super::Gathered;
use super::surface::Surface;
use super::window::{SHARE, Sums, sums_of};
use crate::surfaces::rows;
use crate::surfaces::surface_samples::FaceParts;
use rayon::prelude::*;
use std::ops::Range;

/// Width of the largest blocks, pixels, about.
const LARGEST_PX: f32 = 64.0;

/// No blocks are narrower, pixels, where they can be wider.
const SMALLEST_PX: f32 = 3.0;

/// A surface that fills less of a large block is not followed to it: of leaves there would be hundreds.
const LEAST_SHARE: f32 = 1.0 / 16.0;

/// Levels that follow every surface.
const WHOLE_LEVELS: usize = 2;

/// Of a surface that is not followed.
const NOT_FOLLOWED: u32 = u32::MAX;

/// What is found of each surface in one cell.
type Cell = Vec<(Surface, Sums)>;

/// What is found of each surface in each cell of a square lattice.
#[derive(Default)]
pub(super) struct Lattice {
    /// Prefix sums over the cells in row-major order.
    starts: Vec<u32>,
    pub(super) surfaces: Vec<Surface>,
    pub(super) sums: Vec<Sums>,
}

impl Lattice {
    pub(super) fn cell(&self, cell: usize) -> Range<usize> {
        self.starts[cell] as usize..self.starts[cell + 1] as usize
    }

    /// The sums of a surface in a cell.
    #[inline]
    pub(super) fn find(&self, cell: usize, surface: &Surface) -> Option<&Sums> {
        let run = self.cell(cell);
        let at = self.surfaces[run.clone()]
            .iter()
            .position(|other| surface.is_same(other))?;
        Some(&self.sums[run.start + at])
    }

    /// The surfaces in row `y` of `side` cells.
    fn row(&self, y: usize, side: u32) -> Range<usize> {
        let [first, end] = [y, y + 1].map(|y| self.starts[y * side as usize] as usize);
        first..end
    }

    /// Of cells, row after row.
    pub(super) fn of_rows(rows: Vec<Vec<Cell>>) -> Self {
        let mut lattice = Self {
            starts: vec![0],
            ..Self::default()
        };
        for cell in rows.into_iter().flatten() {
            for (surface, sums) in cell {
                lattice.surfaces.push(surface);
                lattice.sums.push(sums);
            }
            lattice.starts.push(lattice.surfaces.len() as u32);
        }
        lattice
    }
}

/// The blocks of a face, from the smallest to the largest.
pub(crate) struct Blocks {
    pub(super) levels: Vec<Level>,
}

/// Blocks of one size.
pub(super) struct Level {
    /// Blocks a side.
    pub(super) blocks: u32,
    pub(super) lattice: Lattice,
    /// The number of each of the lattice's surfaces in the next level, or [`NOT_FOLLOWED`].
    parents: Vec<u32>,
}

/// To what each part of a face is added.
pub(crate) struct Members {
    /// The number of its surface in the smallest blocks.
    entry: Vec<u32>,
    /// One over the number of parts of that surface in its pixel, of which the mean counts.
    weight: Vec<f32>,
    /// The number of the first part in each row of the smallest blocks, and of all parts.
    rows: Vec<usize>,
}

impl Members {
    /// The number of a part's surface in the smallest blocks.
    pub(super) fn of(&self, part: usize) -> usize {
        self.entry[part] as usize
    }
}

/// Blocks a side, from the smallest to the largest.
fn sizes(size_px: u32) -> Vec<u32> {
    let mut blocks = (size_px as f32 / LARGEST_PX).round().max(1.0) as u32;
    let mut sizes = vec![blocks];
    while size_px as f32 >= SMALLEST_PX * (2 * blocks) as f32 {
        blocks *= 2;
        sizes.insert(0, blocks);
    }
    sizes
}

/// The pixels of a block along one side of a face.
fn pixels_of(block: u32, blocks: u32, size_px: u32) -> Range<u32> {
    (block * size_px).div_ceil(blocks)..((block + 1) * size_px).div_ceil(blocks)
}

impl Blocks {
    /// Blocks of a face's surfaces, in which each part counts as present and has no light yet.
    pub(crate) fn new(parts: &FaceParts) -> (Self, Members) {
        let surfaces: Vec<Surface> = parts.parts.par_iter().map(Surface::of).collect();
        let sizes = sizes(parts.size_px);
        let (smallest, members) = smallest(parts, &surfaces, sizes[0]);
        let mut levels = vec![smallest];
        for (number, &blocks) in sizes.iter().enumerate().skip(1) {
            let width_px = parts.size_px as f32 / blocks as f32;
            let least = if number < WHOLE_LEVELS {
                0.0
            } else {
                LEAST_SHARE * width_px * width_px
            };
            let next = levels.last_mut().map(|below| above(below, blocks, least));
            levels.extend(next);
        }
        (Self { levels }, members)
    }

    /// The surfaces of the smallest blocks, each with the middle of its block, pixels.
    pub(super) fn middles(&self, size_px: u32) -> Vec<(Surface, [f32; 2])> {
        let Level {
            blocks, lattice, ..
        } = &self.levels[0];
        let middle = |cell: u32| {
            [cell % blocks, cell / blocks]
                .map(|c| (c as f32 + 0.5) * size_px as f32 / *blocks as f32)
        };
        let cells = (0..blocks * blocks)
            .flat_map(|cell| lattice.cell(cell as usize).map(move |_| middle(cell)));
        lattice.surfaces.iter().copied().zip(cells).collect()
    }

    /// Sums what the parts have gathered.
    pub(crate) fn fill(&mut self, members: &Members, gathered: &[Gathered]) {
        self.levels[0].for_each_row(|y, first, sums| {
            for p in members.rows[y]..members.rows[y + 1] {
                let place = members.entry[p] as usize - first;
                add(&mut sums[place], &sums_of(&gathered[p]), members.weight[p]);
            }
        });
        for number in 1..self.levels.len() {
            let (below, above) = self.levels.split_at_mut(number);
            let below = &below[number - 1];
            above[0].for_each_row(|y, first, sums| {
                let [upper, lower] = [2 * y, 2 * y + 1].map(|y| below.lattice.row(y, below.blocks));
                for child in upper.start..lower.end {
                    if below.parents[child] != NOT_FOLLOWED {
                        let place = below.parents[child] as usize - first;
                        add(&mut sums[place], &below.lattice.sums[child], 1.0);
                    }
                }
            });
        }
    }
}

impl Level {
    /// Calls `fill` for each row of blocks with its number, the number of its first surface and the row's sums, which are nothing yet.
    fn for_each_row(&mut self, fill: impl Fn(usize, usize, &mut [Sums]) + Sync) {
        let Lattice { starts, sums, .. } = &mut self.lattice;
        let rows = rows::of_face(starts, self.blocks, sums);
        rows.into_par_iter()
            .enumerate()
            .for_each(|(y, (first, sums))| {
                sums.fill(Sums::default());
                fill(y, first, sums);
            });
    }
}

#[inline]
fn add(to: &mut Sums, sums: &Sums, weight: f32) {
    to.iter_mut()
        .zip(sums)
        .for_each(|(to, value)| *to += weight * value);
}

/// The smallest blocks: their surfaces are told apart by the first part of each.
fn smallest(parts: &FaceParts, surfaces: &[Surface], blocks: u32) -> (Level, Members) {
    let size_px = parts.size_px;
    // By rows of blocks: cells, and the place in its cell and the weight of each of the row's parts.
    let row = |by: u32| {
        let rows = pixels_of(by, blocks, size_px);
        let [first, end] =
            [rows.start, rows.end].map(|y| parts.offsets[(y * size_px) as usize] as usize);
        let mut cells = vec![Cell::new(); blocks as usize];
        let mut members = vec![(0u32, 0u32, 0.0f32); end - first];
        for y in rows {
            for (bx, cell) in (0..).zip(&mut cells) {
                for run in pixels_of(bx, blocks, size_px).map(|x| parts.range(x, y)) {
                    for part in run.clone() {
                        let place = cell
                            .iter()
                            .position(|(other, _)| surfaces[part].is_same(other));
                        let place = place.unwrap_or_else(|| {
                            cell.push((surfaces[part], Sums::default()));
                            cell.len() - 1
                        });
                        members[part - first] = (bx, place as u32, 0.0);
                    }
                    let of_pixel = &mut members[run.start - first..run.end - first];
                    for p in 0..of_pixel.len() {
                        let place = of_pixel[p].1;
                        let weight =
                            1.0 / of_pixel.iter().filter(|other| other.1 == place).count() as f32;
                        of_pixel[p].2 = weight;
                        cell[place as usize].1[SHARE] += weight;
                    }
                }
            }
        }
        (cells, members)
    };
    let (rows, members): (Vec<_>, Vec<_>) = (0..blocks).into_par_iter().map(row).unzip();
    let lattice = Lattice::of_rows(rows);
    let (entry, weight) = (
        Vec::with_capacity(surfaces.len()),
        Vec::with_capacity(surfaces.len()),
    );
    let mut found = Members {
        entry,
        weight,
        rows: vec![0],
    };
    for (by, members) in members.into_iter().enumerate() {
        found.rows.push(found.entry.len() + members.len());
        for (bx, place, weight) in members {
            found
                .entry
                .push(lattice.starts[by * blocks as usize + bx as usize] + place);
            found.weight.push(weight);
        }
    }
    (
        Level {
            blocks,
            lattice,
            parents: Vec::new(),
        },
        found,
    )
}

/// The blocks twice as wide as those `below`; surfaces that fill fewer pixels than `least` are left out.
fn above(below: &mut Level, blocks: u32, least: f32) -> Level {
    // By rows of blocks: cells, and the block and the place there of each surface of the two rows below, if it is followed.
    let row = |y: u32| {
        let mut cells = Vec::with_capacity(blocks as usize);
        let mut parents = Vec::new();
        for x in 0..blocks {
            let (cell, children) = merged(below, [x, y], least);
            cells.push(cell);
            parents.extend(
                children
                    .into_iter()
                    .map(|(child, place)| (child, place.map(|place| (x, place)))),
            );
        }
        (cells, parents)
    };
    let (rows, parents): (Vec<_>, Vec<_>) = (0..blocks).into_par_iter().map(row).unzip();
    let lattice = Lattice::of_rows(rows);
    below.parents = vec![NOT_FOLLOWED; below.lattice.surfaces.len()];
    for (y, parents) in (0..).zip(parents) {
        for (child, place) in parents {
            let parent = place.map(|(x, place)| lattice.starts[(y * blocks + x) as usize] + place);
            below.parents[child] = parent.unwrap_or(NOT_FOLLOWED);
        }
    }
    Level {
        blocks,
        lattice,
        parents: Vec::new(),
    }
}

/// The surfaces of block (x, y) of twice the width, and the place among them of each surface of the four blocks below, if it is followed.
fn merged(below: &Level, [x, y]: [u32; 2], least: f32) -> (Cell, Vec<(usize, Option<u32>)>) {
    let children = [
        (2 * x, 2 * y),
        (2 * x + 1, 2 * y),
        (2 * x, 2 * y + 1),
        (2 * x + 1, 2 * y + 1),
    ];
    let (mut cell, mut members) = (Cell::new(), Vec::new());
    for child in children
        .into_iter()
        .flat_map(|(x, y)| below.lattice.cell((y * below.blocks + x) as usize))
    {
        let (surface, sums) = (below.lattice.surfaces[child], &below.lattice.sums[child]);
        let place = cell
            .iter()
            .position(|(other, _)| surface.is_same(other))
            .unwrap_or_else(|| {
                cell.push((surface, Sums::default()));
                cell.len() - 1
            });
        add(&mut cell[place].1, sums, 1.0);
        members.push((child, place));
    }
    let mut kept = 0;
    let follow = |(_, sums): &(Surface, Sums)| (sums[SHARE] >= least).then(|| (kept, kept += 1).0);
    let places: Vec<Option<u32>> = cell.iter().map(follow).collect();
    cell.retain(|(_, sums)| sums[SHARE] >= least);
    (
        cell,
        members
            .into_iter()
            .map(|(child, place)| (child, places[place]))
            .collect(),
    )
}
