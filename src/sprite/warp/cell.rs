//! Cell format of the displacements that the first pass hands to the second: 4 bytes per cell,
//! value and slope.
//!
//! | bits | content |
//! |---|---|
//! | 31 | 1 if the sprite is visible there, 0 if it is transparent |
//! | 16..31 | value, 1..=32767: displacement = (value - zero) * scale |
//! | 8..16 | change of the displacement from column to column, signed, in units of `slope_scale` |
//! | 0..8 | the same from row to row |
//!
//! An empty cell is 0, which no other cell is. When two samples reach one cell, the larger number
//! wins: a visible one before a transparent one, then the nearer one (values grow towards the
//! target eye, [`crate::SpriteTransfer::side`]). So the first pass does not depend on order and
//! needs no occlusion-compatible traversal (C7).
//!
//! Thanks to the slope one cell per lookup suffices: a cell is read as a small tilted plane about
//! its centre, which is as accurate as interpolation between four cells where the surface is
//! smooth, and keeps edges sharp.

/// Largest value of a cell.
const MAX_VALUE: f32 = 32767.0;
/// Bit that is set in visible cells.
pub(super) const VISIBLE: u32 = 1 << 31;
/// Largest slope per cell as a share of the whole range; steeper changes are edges. Half a unit of
/// slope is then 1/4064 of the range, at most 1/80 px for +-25 px of parallax half a cell away.
pub const STEEPEST: f32 = 1.0 / 16.0;

/// Encoding of displacements in cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Coding {
    /// Displacement per step; negative if the target eye is behind the plane.
    pub scale: f32,
    /// Cell value of displacement 0, exact; may lie outside 1..=32767.
    pub zero: f32,
    /// Displacement per cell and unit of slope.
    pub slope_scale: f32,
}

impl Coding {
    /// Creates the encoding of displacements from `low` to `high` with slopes up to `steepest` per
    /// cell. `side` is the sign by which larger displacements are nearer.
    pub(super) fn new(low: f32, high: f32, steepest: f32, side: f32) -> Self {
        let steepest = steepest.min((high - low) * STEEPEST);
        // Extrapolating half a cell (or a whole one, when filling) may leave the range.
        let (low, high) = (low - steepest, high + steepest);
        let step = (high - low) / (MAX_VALUE - 1.0);
        if !step.is_normal() {
            return Self {
                scale: side,
                zero: 16384.0,
                slope_scale: 1.0,
            };
        }
        let nearest_zero = if side > 0.0 { -low / step } else { high / step };
        let slope_scale = steepest / 127.0;
        let slope_scale = if slope_scale.is_normal() {
            slope_scale
        } else {
            1.0
        };
        Self {
            scale: step * side,
            zero: (nearest_zero + 1.0).round(),
            slope_scale,
        }
    }

    /// Returns an upper bound of the absolute displacement at most one cell from a cell's centre.
    pub(super) fn largest(&self) -> f32 {
        let ends = [1.0, MAX_VALUE].map(|value| ((value - self.zero) * self.scale).abs());
        ends[0].max(ends[1]) + 2.0 * 127.0 * self.slope_scale
    }

    /// Packs one cell.
    pub(super) fn pack(&self, visible: bool, d: f32, slope: [f32; 2]) -> u32 {
        let value = (d / self.scale + self.zero + 0.5).clamp(1.0, MAX_VALUE) as u32;
        let [x, y] =
            slope.map(|s| ((s / self.slope_scale).round().clamp(-127.0, 127.0) as i8) as u8);
        (u32::from(visible) << 31) | (value << 16) | (u32::from(x) << 8) | u32::from(y)
    }

    /// Returns the displacement at (dx, dy) cells from the centre of a cell.
    pub(crate) fn displacement(&self, cell: u32, dx: f32, dy: f32) -> f32 {
        let [x, y] = slopes(cell);
        let value = (cell >> 16 & 0x7fff) as f32;
        (value - self.zero) * self.scale + (x * self.slope_scale * dx + y * self.slope_scale * dy)
    }
}

/// Returns the two slopes of a cell in units of [`Coding::slope_scale`].
pub(super) fn slopes(cell: u32) -> [f32; 2] {
    [
        f32::from((cell >> 8) as u8 as i8),
        f32::from(cell as u8 as i8),
    ]
}
