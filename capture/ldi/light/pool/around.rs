//! Windows over blocks of all faces.
//!
//! A window that is many pixels wide is nearly the same for neighbours, so it is made once for a block of pixels: of three by three
//! blocks, of which the middle counts most ([1 2 1] / 4 each way), and read between the middles of blocks. Beyond a face's border
//! its plane goes on: a block there holds what that block of another face holds through which its middle is seen. So faces that
//! meet on a wall read the same sums on either side of their border.

use super::blocks::{Blocks, Lattice, Level};
use super::surface::Surface;
use super::window::{Sums, parts_within};
use headbox_core::cube_face::Face;
use rayon::prelude::*;

/// Standard deviation of a window in each direction, widths of its blocks: of a box, of [1 2 1] / 4, and of a tent.
const RADIUS: f32 = 0.866;

/// Windows of a face, in all sizes.
pub(crate) struct Windows {
    pub(super) levels: Vec<WindowLevel>,
}

impl Windows {
    /// Windows of `face`, whose blocks are `own`, over these and those of the `others` that are known, by number of the face.
    pub(crate) fn new(
        face: Face,
        size_px: u32,
        own: &Blocks,
        others: [Option<&Blocks>; 6],
    ) -> Self {
        let level = |(number, own): (usize, &Level)| {
            let mut faces = others.map(|blocks| blocks.map(|blocks| &blocks.levels[number]));
            faces[face.index()] = Some(own);
            let (blocks, size_px) = (own.blocks, size_px as f32);
            WindowLevel {
                blocks,
                size_px,
                lattice: Around {
                    faces,
                    face,
                    blocks,
                    size_px,
                }
                .windows(),
            }
        };
        Self {
            levels: own.levels.iter().enumerate().map(level).collect(),
        }
    }
}

/// Windows of one size: about each block of a face, and about those of one more row and column at each side.
pub(super) struct WindowLevel {
    blocks: u32,
    size_px: f32,
    lattice: Lattice,
}

impl WindowLevel {
    fn width_px(&self) -> f32 {
        self.size_px / self.blocks as f32
    }

    /// Standard deviation in each direction, pixels.
    pub(super) fn radius_px(&self) -> f32 {
        RADIUS * self.width_px()
    }

    /// See [`parts_within`].
    pub(super) fn parts(&self) -> f32 {
        parts_within(self.radius_px())
    }
}

/// Reads windows of one size at one part after the other: parts that follow on each other mostly lie on one surface among the same
/// four blocks.
pub(super) struct Reader<'a> {
    pub(super) level: &'a WindowLevel,
    /// The first of the four blocks and the surface that were read last...
    last: (usize, Surface),
    /// ...and what is found of it in each.
    found: [Option<&'a Sums>; 4],
}

impl Windows {
    /// Readers of all sizes.
    pub(super) fn readers(&self) -> Vec<Reader<'_>> {
        let reader = |level| Reader {
            level,
            last: (usize::MAX, Surface::NONE),
            found: [None; 4],
        };
        self.levels.iter().map(reader).collect()
    }
}

impl Reader<'_> {
    /// The window of a surface about a position, pixels.
    #[inline]
    pub(super) fn at(&mut self, surface: &Surface, position: [f32; 2]) -> Sums {
        let level = self.level;
        let [x, y] = position.map(|c| c / level.width_px() + 0.5);
        let (column, row) = (x as usize, y as usize);
        let (right, down) = (x - column as f32, y - row as f32);
        let side = level.blocks as usize + 2;
        let first = row * side + column;
        if self.last != (first, *surface) {
            let cells = [first, first + 1, first + side, first + side + 1];
            self.found = cells.map(|cell| level.lattice.find(cell, surface));
            self.last = (first, *surface);
        }
        let weights = [
            (1.0 - right) * (1.0 - down),
            right * (1.0 - down),
            (1.0 - right) * down,
            right * down,
        ];
        let mut all = Sums::default();
        for (sums, weight) in self.found.iter().zip(weights) {
            if let Some(sums) = sums {
                all.iter_mut()
                    .zip(*sums)
                    .for_each(|(all, value)| *all += weight * value);
            }
        }
        all
    }
}

/// The blocks of one size of all faces, as one face sees them: its own, and those beyond its border.
struct Around<'a> {
    faces: [Option<&'a Level>; 6],
    face: Face,
    blocks: u32,
    size_px: f32,
}

impl<'a> Around<'a> {
    /// The lattice and the cell of a block of the face, or of one beyond it.
    fn block(&self, x: i32, y: i32) -> Option<(&'a Lattice, usize)> {
        let side = self.blocks.cast_signed();
        let (face, [x, y]) = if (0..side).contains(&x) && (0..side).contains(&y) {
            (self.face, [x, y])
        } else {
            let middle = self
                .face
                .direction(f64::from(x) + 0.5, f64::from(y) + 0.5, self.blocks);
            let face = Face::containing(middle);
            let [x, y, _] = face.project(middle, self.blocks);
            (face, [x, y].map(|c| (c as i32).clamp(0, side - 1)))
        };
        Some((&self.faces[face.index()]?.lattice, (y * side + x) as usize))
    }

    /// Windows about blocks -1 to the number of blocks, row after row.
    fn windows(&self) -> Lattice {
        let side = self.blocks.cast_signed();
        let cells = |y: i32| (-1..=side).map(|x| self.windows_about(x, y)).collect();
        Lattice::of_rows((-1..=side).into_par_iter().map(cells).collect())
    }

    /// The window of each surface about a block.
    fn windows_about(&self, x: i32, y: i32) -> Vec<(Surface, Sums)> {
        let Some((lattice, cell)) = self.block(x, y) else {
            return Vec::new();
        };
        let window = |surface: &Surface| (*surface, Sums::default());
        let mut windows: Vec<(Surface, Sums)> = lattice.surfaces[lattice.cell(cell)]
            .iter()
            .map(window)
            .collect();
        if windows.is_empty() {
            return windows;
        }
        // Of sums, means over pixels.
        let per_pixel = (self.blocks as f32 / self.size_px).powi(2);
        for (dy, weight_y) in [(-1, 0.25), (0, 0.5), (1, 0.25)] {
            for (dx, weight_x) in [(-1, 0.25), (0, 0.5), (1, 0.25)] {
                let Some((lattice, cell)) = self.block(x + dx, y + dy) else {
                    continue;
                };
                for other in lattice.cell(cell) {
                    let (surface, sums) = (&lattice.surfaces[other], &lattice.sums[other]);
                    for (_, window) in windows.iter_mut().filter(|(here, _)| here.is_same(surface))
                    {
                        let weight = weight_x * weight_y * per_pixel;
                        window
                            .iter_mut()
                            .zip(sums)
                            .for_each(|(window, value)| *window += weight * value);
                    }
                }
            }
        }
        windows
    }
}
