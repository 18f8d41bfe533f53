//! Windows over the blocks of all faces.
//!
//! A window that is many pixels wide is nearly the same for neighbours, so it is computed once for
//! a block of pixels: over three by three blocks, of which the middle counts most ([1 2 1] / 4 in
//! each direction), and interpolated between the middles of blocks. Beyond a face's border its
//! plane continues: a block there has the content of the block of another face that lies in the
//! direction of its middle. So faces that meet on a wall read the same sums on either side of their
//! border.

use super::blocks::{BlockLevel, Blocks, Lattice};
use super::surface_key::SurfaceKey;
use super::window::{Sums, add, gaussian_support};
use headbox_core::cube_face::Face;
use rayon::prelude::*;

/// Standard deviation of a window in each direction, widths of its blocks: from a box, [1 2 1] / 4,
/// and a tent.
const RADIUS: f32 = 0.866;

/// Windows of a face, in all sizes.
pub(crate) struct BlockWindows {
    pub(super) levels: Vec<WindowLevel>,
}

impl BlockWindows {
    /// Windows of `face` over its blocks, `own`, and over those of `others` that are known, by
    /// index of the face.
    pub(crate) fn new(
        face: Face,
        size_px: u32,
        own: &Blocks,
        others: [Option<&Blocks>; 6],
    ) -> Self {
        let level = |(number, own): (usize, &BlockLevel)| {
            let mut faces = others.map(|blocks| blocks.map(|blocks| &blocks.levels[number]));
            faces[face.index()] = Some(own);
            let surrounding = SurroundingBlocks {
                faces,
                face,
                blocks: own.blocks,
                size_px: size_px as f32,
            };
            WindowLevel {
                blocks: own.blocks,
                size_px: size_px as f32,
                lattice: surrounding.windows(),
            }
        };
        Self {
            levels: own.levels.iter().enumerate().map(level).collect(),
        }
    }

    /// A reader for each size.
    pub(super) fn readers(&self) -> Vec<WindowReader<'_>> {
        let reader = |level| WindowReader {
            level,
            last: (usize::MAX, SurfaceKey::NONE),
            cells: [None; 4],
        };
        self.levels.iter().map(reader).collect()
    }
}

/// Windows of one size: about each block of a face, and about one more row and column of blocks on
/// each side.
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

    /// See [`gaussian_support`].
    pub(super) fn support(&self) -> f32 {
        gaussian_support(self.radius_px())
    }
}

/// Reads windows of one size at one surface sample after another. Consecutive samples mostly lie on
/// one surface among the same four blocks, so these are cached.
pub(super) struct WindowReader<'a> {
    pub(super) level: &'a WindowLevel,
    /// The first of the four blocks and the surface that were read last.
    last: (usize, SurfaceKey),
    /// The sums of that surface in each of the four blocks.
    cells: [Option<&'a Sums>; 4],
}

impl WindowReader<'_> {
    /// The window of a surface about a position, pixels.
    #[inline]
    pub(super) fn read(&mut self, key: &SurfaceKey, position: [f32; 2]) -> Sums {
        let level = self.level;
        let [x, y] = position.map(|c| c / level.width_px() + 0.5);
        let (column, row) = (x as usize, y as usize);
        let (right, down) = (x - column as f32, y - row as f32);
        let side = level.blocks as usize + 2;
        let first = row * side + column;
        if self.last != (first, *key) {
            let cells = [first, first + 1, first + side, first + side + 1];
            self.cells = cells.map(|cell| level.lattice.find(cell, key));
            self.last = (first, *key);
        }
        let weights = [
            (1.0 - right) * (1.0 - down),
            right * (1.0 - down),
            (1.0 - right) * down,
            right * down,
        ];
        let mut total = Sums::default();
        for (sums, weight) in self.cells.iter().zip(weights) {
            if let Some(sums) = sums {
                add(&mut total, sums, weight);
            }
        }
        total
    }
}

/// The blocks of one size around a face: its own, and those of other faces beyond its border.
struct SurroundingBlocks<'a> {
    faces: [Option<&'a BlockLevel>; 6],
    face: Face,
    blocks: u32,
    size_px: f32,
}

impl<'a> SurroundingBlocks<'a> {
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
        Lattice::from_rows((-1..=side).into_par_iter().map(cells).collect())
    }

    /// The window of each surface about a block.
    fn windows_about(&self, x: i32, y: i32) -> Vec<(SurfaceKey, Sums)> {
        let Some((lattice, cell)) = self.block(x, y) else {
            return Vec::new();
        };
        let mut windows: Vec<(SurfaceKey, Sums)> = lattice.keys[lattice.cell(cell)]
            .iter()
            .map(|key| (*key, Sums::default()))
            .collect();
        if windows.is_empty() {
            return windows;
        }
        // Turns sums into means over pixels.
        let per_pixel = (self.blocks as f32 / self.size_px).powi(2);
        for (dy, weight_y) in [(-1, 0.25), (0, 0.5), (1, 0.25)] {
            for (dx, weight_x) in [(-1, 0.25), (0, 0.5), (1, 0.25)] {
                let Some((lattice, cell)) = self.block(x + dx, y + dy) else {
                    continue;
                };
                for other in lattice.cell(cell) {
                    let key = &lattice.keys[other];
                    let sums = &lattice.sums[other];
                    for (_, window) in windows.iter_mut().filter(|(own, _)| own.is_same(key)) {
                        add(window, sums, weight_x * weight_y * per_pixel);
                    }
                }
            }
        }
        windows
    }
}
