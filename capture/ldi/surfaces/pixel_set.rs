//! Some of the pixels of a face.

/// Some of the pixels of a face.
pub(crate) struct PixelSet {
    size_px: u32,
    has: Vec<bool>,
}

impl PixelSet {
    /// None of a face of so many pixels a side.
    pub(super) fn new(size_px: u32) -> Self {
        Self {
            size_px,
            has: vec![false; (size_px as usize).pow(2)],
        }
    }

    /// Adds pixel (x, y).
    pub(super) fn insert(&mut self, x: u32, y: u32) {
        let place = self.place(x, y);
        self.has[place] = true;
    }

    /// Whether pixel (x, y), which may lie beyond the face, is one of them.
    pub(super) fn contains(&self, x: u32, y: u32) -> bool {
        x.max(y) < self.size_px && self.has[self.place(x, y)]
    }

    /// With the pixels around each.
    pub(super) fn grown(&self) -> Self {
        let size = self.size_px as usize;
        let mut grown = Self::new(self.size_px);
        for place in (0..self.has.len()).filter(|&place| self.has[place]) {
            let around = |c: usize| c.saturating_sub(1)..(c + 2).min(size);
            let columns = around(place % size);
            around(place / size).for_each(|y| grown.has[y * size..][columns.clone()].fill(true));
        }
        grown
    }

    fn place(&self, x: u32, y: u32) -> usize {
        y as usize * self.size_px as usize + x as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_grows_by_the_pixels_around_and_not_beyond_the_face() {
        let pixels = |set: &PixelSet| -> Vec<[u32; 2]> {
            (0..25)
                .map(|i| [i % 5, i / 5])
                .filter(|&[x, y]| set.contains(x, y))
                .collect()
        };
        let mut set = PixelSet::new(5);
        assert!(pixels(&set.grown()).is_empty());
        set.insert(4, 0);
        assert_eq!(pixels(&set), [[4, 0]]);
        assert_eq!(pixels(&set.grown()), [[3, 0], [4, 0], [3, 1], [4, 1]]);
        assert_eq!(pixels(&set.grown().grown()).len(), 9);
        assert!(
            !set.contains(0, 5) && !set.contains(9, 0) && !set.contains(5, u32::MAX),
            "tiles reach beyond faces"
        );
    }
}
