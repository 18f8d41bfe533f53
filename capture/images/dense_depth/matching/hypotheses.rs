//! Plane hypotheses of all pixels, in separate arrays for the two colours of a chequerboard, so
//! that one half can be improved from the other in parallel.

/// Plane hypothesis of a pixel: the inverse depth of every plane in space is affine in the pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct Hypothesis {
    /// 1/eye depth at the pixel's centre, 1/m; 0 where unknown.
    pub(crate) inverse_depth: f32,
    /// Change of inverse depth per pixel to the right and down.
    pub(crate) slopes: [f32; 2],
    /// Matching cost: 0 to [`super::zncc::WORST`], plus a penalty for inconsistency.
    pub(crate) cost: f32,
}

impl Hypothesis {
    /// Returns the same plane at another pixel, `dx` to the right and `dy` down.
    #[inline(always)]
    pub(crate) fn shifted(&self, dx: f32, dy: f32) -> Self {
        let inverse_depth = self.inverse_depth + self.slopes[0] * dx + self.slopes[1] * dy;
        Self {
            inverse_depth,
            ..*self
        }
    }
}

/// Hypotheses of an image.
#[derive(Clone, Debug)]
pub(crate) struct Chequerboard {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Squares whose column and row have an even sum, and the others. Row-major, with rows of
    /// [`Self::stride`].
    pub(crate) halves: [Vec<Hypothesis>; 2],
}

impl Chequerboard {
    pub(crate) fn new(width: usize, height: usize) -> Self {
        let half = vec![Hypothesis::default(); width.div_ceil(2) * height];
        Self {
            width,
            height,
            halves: [half.clone(), half],
        }
    }

    /// Returns the length of a row of one colour.
    pub(crate) fn stride(&self) -> usize {
        self.width.div_ceil(2)
    }

    /// Returns the column of the first square of a colour in a row.
    #[inline(always)]
    pub(super) fn first_column(colour: usize, y: usize) -> usize {
        (colour + y) % 2
    }

    pub(crate) fn get(&self, x: usize, y: usize) -> &Hypothesis {
        &self.halves[(x + y) % 2][y * self.stride() + x / 2]
    }

    pub(crate) fn get_mut(&mut self, x: usize, y: usize) -> &mut Hypothesis {
        let index = y * self.stride() + x / 2;
        &mut self.halves[(x + y) % 2][index]
    }

    /// Returns the same planes in an image of twice the resolution.
    pub(crate) fn doubled(&self, width: usize, height: usize) -> Self {
        let mut fine = Self::new(width, height);
        for y in 0..height {
            for x in 0..width {
                let cx = (x / 2).min(self.width - 1);
                let cy = (y / 2).min(self.height - 1);
                let offset =
                    |fine: usize, coarse: usize| (fine as f32 + 0.5) / 2.0 - (coarse as f32 + 0.5);
                let plane = self.get(cx, cy).shifted(offset(x, cx), offset(y, cy));
                *fine.get_mut(x, y) = Hypothesis {
                    slopes: plane.slopes.map(|slope| slope / 2.0),
                    ..plane
                };
            }
        }
        fine
    }

    /// Returns all hypotheses, row by row.
    pub(crate) fn rows(&self) -> Vec<Hypothesis> {
        (0..self.height)
            .flat_map(|y| (0..self.width).map(move |x| *self.get(x, y)))
            .collect()
    }

    /// Creates a board from all hypotheses, row by row.
    pub(crate) fn from_rows(width: usize, height: usize, rows: &[Hypothesis]) -> Self {
        let mut board = Self::new(width, height);
        for (i, hypothesis) in rows.iter().enumerate() {
            *board.get_mut(i % width, i / width) = *hypothesis;
        }
        board
    }
}
