//! A set of pixels of a face.

/// A set of pixels of a face.
pub(crate) struct PixelSet {
    size_px: u32,
    contained: Vec<bool>,
}

impl PixelSet {
    /// The empty set of a face of `size_px` pixels along a side.
    pub(crate) fn new(size_px: u32) -> Self {
        Self {
            size_px,
            contained: vec![false; (size_px as usize).pow(2)],
        }
    }

    /// Adds pixel (x, y).
    pub(crate) fn insert(&mut self, x: u32, y: u32) {
        let index = self.index(x, y);
        self.contained[index] = true;
    }

    /// Returns true if the set contains no pixel.
    pub(super) fn is_empty(&self) -> bool {
        !self.contained.contains(&true)
    }

    /// Returns true if the set contains pixel (x, y), which may lie beyond the face.
    pub(super) fn contains(&self, x: u32, y: u32) -> bool {
        x.max(y) < self.size_px && self.contained[self.index(x, y)]
    }

    /// The set and all pixels adjacent to it, diagonals included.
    pub(super) fn dilated(&self) -> Self {
        let size = self.size_px as usize;
        let mut dilated = Self::new(self.size_px);
        for index in (0..self.contained.len()).filter(|&index| self.contained[index]) {
            let around = |c: usize| c.saturating_sub(1)..(c + 2).min(size);
            let columns = around(index % size);
            for y in around(index / size) {
                dilated.contained[y * size..][columns.clone()].fill(true);
            }
        }
        dilated
    }

    fn index(&self, x: u32, y: u32) -> usize {
        y as usize * self.size_px as usize + x as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dilation_stays_within_the_face() {
        let pixels = |set: &PixelSet| -> Vec<[u32; 2]> {
            (0..25)
                .map(|i| [i % 5, i / 5])
                .filter(|&[x, y]| set.contains(x, y))
                .collect()
        };
        let mut set = PixelSet::new(5);
        assert!(pixels(&set.dilated()).is_empty());
        set.insert(4, 0);
        assert_eq!(pixels(&set), [[4, 0]]);
        assert_eq!(pixels(&set.dilated()), [[3, 0], [4, 0], [3, 1], [4, 1]]);
        assert_eq!(pixels(&set.dilated().dilated()).len(), 9);
        assert!(
            !set.contains(0, 5) && !set.contains(9, 0) && !set.contains(5, u32::MAX),
            "tiles reach beyond faces"
        );
    }
}
