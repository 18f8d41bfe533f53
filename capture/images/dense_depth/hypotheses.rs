//! What is believed of each pixel's surface: a plane, and what it costs; kept apart for the black and the white squares of a
//! chequerboard, so that one half can be improved from the other on many threads.

/// A plane through a pixel: inverse depth is affine in the pixel for every plane in space.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Hypothesis {
    /// 1/eye depth at the pixel's centre, 1/m; 0 where nothing is known.
    pub(super) inverse_depth: f32,
    /// What a pixel to the right and one down add to it.
    pub(super) slopes: [f32; 2],
    /// 0 to [`super::zncc::WORST`], and what inconsistency adds.
    pub(super) cost: f32,
}

impl Hypothesis {
    /// The same plane at a pixel so far away.
    #[inline(always)]
    pub(super) fn moved(&self, dx: f32, dy: f32) -> Self {
        let inverse_depth = self.inverse_depth + self.slopes[0] * dx + self.slopes[1] * dy;
        Self {
            inverse_depth,
            ..*self
        }
    }
}

/// Hypotheses of a picture.
#[derive(Clone, Debug)]
pub(super) struct Chequerboard {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Of the squares of which column and row add up to an even number, and of the others. Row-major, rows of [`Self::stride`].
    pub(super) halves: [Vec<Hypothesis>; 2],
}

impl Chequerboard {
    pub(super) fn new(width: usize, height: usize) -> Self {
        let half = vec![Hypothesis::default(); width.div_ceil(2) * height];
        Self {
            width,
            height,
            halves: [half.clone(), half],
        }
    }

    /// Squares of a colour that a row has room for.
    pub(super) fn stride(&self) -> usize {
        self.width.div_ceil(2)
    }

    /// The column of the first square of a colour in a row.
    #[inline(always)]
    pub(super) fn first(colour: usize, y: usize) -> usize {
        (colour + y) % 2
    }

    pub(super) fn get(&self, x: usize, y: usize) -> &Hypothesis {
        &self.halves[(x + y) % 2][y * self.stride() + x / 2]
    }

    pub(super) fn get_mut(&mut self, x: usize, y: usize) -> &mut Hypothesis {
        let at = y * self.stride() + x / 2;
        &mut self.halves[(x + y) % 2][at]
    }

    /// The same planes in a picture twice as fine.
    pub(super) fn doubled(&self, width: usize, height: usize) -> Self {
        let mut fine = Self::new(width, height);
        for y in 0..height {
            for x in 0..width {
                let (cx, cy) = ((x / 2).min(self.width - 1), (y / 2).min(self.height - 1));
                let offset =
                    |fine: usize, coarse: usize| (fine as f32 + 0.5) / 2.0 - (coarse as f32 + 0.5);
                let plane = self.get(cx, cy).moved(offset(x, cx), offset(y, cy));
                *fine.get_mut(x, y) = Hypothesis {
                    slopes: plane.slopes.map(|slope| slope / 2.0),
                    ..plane
                };
            }
        }
        fine
    }

    /// All, row by row.
    pub(super) fn rows(&self) -> Vec<Hypothesis> {
        (0..self.height)
            .flat_map(|y| (0..self.width).map(move |x| *self.get(x, y)))
            .collect()
    }

    /// Of all, row by row.
    pub(super) fn from_rows(width: usize, height: usize, rows: &[Hypothesis]) -> Self {
        let mut board = Self::new(width, height);
        for (i, hypothesis) in rows.iter().enumerate() {
            *board.get_mut(i % width, i / width) = *hypothesis;
        }
        board
    }
}
