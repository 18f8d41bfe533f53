//! Blocks of pixels and the sums of each surface in them, each size twice as wide as the one before.

use super::Gathered;
use super::surface::Surface;
use super::window::{SHARE, Sums, sums_of};
use crate::ldi::parts::FaceParts;
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
        let at = self.surfaces[run.clone()].iter().position(|other| surface.is_same(other))?;
        Some(&self.sums[run.start + at])
    }

    /// Of cells, row after row.
    pub(super) fn of_rows(rows: Vec<Vec<Vec<(Surface, Sums)>>>) -> Self {
        let mut lattice = Self { starts: vec![0], ..Self::default() };
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
pub(in crate::ldi) struct Blocks {
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
pub(in crate::ldi) struct Members {
    /// The number of its surface in the smallest blocks.
    entry: Vec<u32>,
    /// One over the number of parts of that surface in its pixel, of which the mean counts.
    weight: Vec<f32>,
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
    pub(super) fn new(parts: &FaceParts, surfaces: &[Surface]) -> (Self, Members) {
        let sizes = sizes(parts.size_px);
        let (smallest, members) = smallest(parts, surfaces, sizes[0]);
        let mut levels = vec![smallest];
        for (number, &blocks) in sizes.iter().enumerate().skip(1) {
            let width_px = parts.size_px as f32 / blocks as f32;
            let least = if number < WHOLE_LEVELS { 0.0 } else { LEAST_SHARE * width_px * width_px };
            let next = levels.last_mut().map(|below| above(below, blocks, least));
            levels.extend(next);
        }
        (Self { levels }, members)
    }

    /// Sums what the parts have gathered.
    pub(in crate::ldi) fn fill(&mut self, members: &Members, gathered: &[Gathered]) {
        let smallest = &mut self.levels[0].lattice.sums;
        smallest.fill(Sums::default());
        for ((&entry, &weight), gathered) in members.entry.iter().zip(&members.weight).zip(gathered) {
            add(&mut smallest[entry as usize], &sums_of(gathered), weight);
        }
        for number in 1..self.levels.len() {
            let (below, above) = self.levels.split_at_mut(number);
            add_up(&below[number - 1], &mut above[0].lattice.sums);
        }
    }
}

#[inline]
fn add(to: &mut Sums, sums: &Sums, weight: f32) {
    to.iter_mut().zip(sums).for_each(|(to, value)| *to += weight * value);
}

fn add_up(below: &Level, above: &mut [Sums]) {
    above.fill(Sums::default());
    for (&parent, sums) in below.parents.iter().zip(&below.lattice.sums) {
        if parent != NOT_FOLLOWED {
            add(&mut above[parent as usize], sums, 1.0);
        }
    }
}

/// The smallest blocks: their surfaces are told apart by the first part of each.
fn smallest(parts: &FaceParts, surfaces: &[Surface], blocks: u32) -> (Level, Members) {
    let size_px = parts.size_px;
    // By rows of blocks: cells, and the place in its cell and the weight of each of the row's parts.
    let row = |by: u32| {
        let rows = pixels_of(by, blocks, size_px);
        let [first, end] = [rows.start, rows.end].map(|y| parts.offsets[(y * size_px) as usize] as usize);
        let mut cells = vec![Vec::<(Surface, Sums)>::new(); blocks as usize];
        let mut members = vec![(0u32, 0u32, 0.0f32); end - first];
        for y in rows {
            for (bx, cell) in (0..).zip(&mut cells) {
                for run in pixels_of(bx, blocks, size_px).map(|x| parts.range(x, y)) {
                    for part in run.clone() {
                        let place = cell.iter().position(|(other, _)| surfaces[part].is_same(other));
                        let place = place.unwrap_or_else(|| {
                            cell.push((surfaces[part], Sums::default()));
                            cell.len() - 1
                        });
                        members[part - first] = (bx, place as u32, 0.0);
                    }
                    let of_pixel = &mut members[run.start - first..run.end - first];
                    for p in 0..of_pixel.len() {
                        let place = of_pixel[p].1;
                        let weight = 1.0 / of_pixel.iter().filter(|other| other.1 == place).count() as f32;
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
    let mut found = Members { entry: Vec::with_capacity(surfaces.len()), weight: Vec::with_capacity(surfaces.len()) };
    for (by, members) in members.into_iter().enumerate() {
        for (bx, place, weight) in members {
            found.entry.push(lattice.starts[by * blocks as usize + bx as usize] + place);
            found.weight.push(weight);
        }
    }
    (Level { blocks, lattice, parents: Vec::new() }, found)
}

/// The blocks twice as wide as those `below`; surfaces that fill fewer pixels than `least` are left out.
fn above(below: &mut Level, blocks: u32, least: f32) -> Level {
    let mut parents = vec![NOT_FOLLOWED; below.lattice.surfaces.len()];
    let mut lattice = Lattice { starts: vec![0], ..Lattice::default() };
    for block in 0..blocks * blocks {
        let (x, y) = (2 * (block % blocks), 2 * (block / blocks));
        let children = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
        let mut cell = Vec::<(Surface, Sums)>::new();
        let mut members = Vec::new();
        for child in children.into_iter().flat_map(|(x, y)| below.lattice.cell((y * below.blocks + x) as usize)) {
            let (surface, sums) = (below.lattice.surfaces[child], &below.lattice.sums[child]);
            let place = cell.iter().position(|(other, _)| surface.is_same(other)).unwrap_or_else(|| {
                cell.push((surface, Sums::default()));
                cell.len() - 1
            });
            add(&mut cell[place].1, sums, 1.0);
            members.push((child, place));
        }
        let mut kept = vec![NOT_FOLLOWED; cell.len()];
        for (kept, (surface, sums)) in kept.iter_mut().zip(cell).filter(|(_, (_, sums))| sums[SHARE] >= least) {
            *kept = lattice.surfaces.len() as u32;
            lattice.surfaces.push(surface);
            lattice.sums.push(sums);
        }
        lattice.starts.push(lattice.surfaces.len() as u32);
        members.into_iter().for_each(|(child, place)| parents[child] = kept[place]);
    }
    below.parents = parents;
    Level { blocks, lattice, parents: Vec::new() }
}
