//! How well depth that was found agrees with depth that is known.

/// Shares of depth by which they may differ.
pub const TOLERANCES: [f32; 3] = [0.01, 0.02, 0.05];

/// Pixels counted over any number of pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Agreement {
    /// All pixels.
    pub pixels: u64,
    /// Those whose depth was found.
    pub found: u64,
    /// Those whose depth is known.
    pub known: u64,
    /// Those of which both is so.
    pub both: u64,
    /// How many of these differ by less than each of [`TOLERANCES`].
    pub within: [u64; 3],
}

impl Agreement {
    /// Counts a picture: eye depths, NaN where not found, or not known; `known` may be empty.
    pub fn add(&mut self, found: &[f32], known: &[f32]) {
        self.pixels += found.len() as u64;
        for (i, found) in found.iter().enumerate() {
            let known = known.get(i).copied().unwrap_or(f32::NAN);
            self.found += u64::from(found.is_finite());
            self.known += u64::from(known.is_finite());
            let error = (found / known - 1.0).abs();
            self.both += u64::from(error.is_finite());
            for (within, tolerance) in self.within.iter_mut().zip(TOLERANCES) {
                *within += u64::from(error < tolerance);
            }
        }
    }

    /// Share of all pixels whose depth was found.
    pub fn found_share(&self) -> f64 {
        self.found as f64 / self.pixels.max(1) as f64
    }

    /// Share of the known pixels that were found as well.
    pub fn covered(&self) -> f64 {
        self.both as f64 / self.known.max(1) as f64
    }

    /// Of the pixels that are known and found, the shares that differ by less than each of [`TOLERANCES`].
    pub fn shares_within(&self) -> [f64; 3] {
        self.within.map(|within| within as f64 / self.both.max(1) as f64)
    }
}
