//! Bins of inverse depth: the depth threshold below which samples of one pixel form one surface.

/// Fixed bins of inverse depth, the depth threshold ("epsilon") of the papers.
///
/// The bins are uniform in `half_size / eye_depth`, which lies in 0..1 because the headbox is
/// empty. Moving the eye by the headbox's half-diagonal shifts a sample on a face image by
/// `sqrt(3) * half_size * (face_size / 2) / eye_depth` pixels; a bin is [`Self::PARALLAX_PX`] of
/// that, so that two samples in one bin of one pixel never separate by more, in any scene. Near
/// surfaces get fine bins, far ones coarse bins, and nothing needs tuning per model (Rafferty et
/// al. chose their threshold by trial and error).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthBins {
    half_size_m: f32,
    count: f32,
}

impl DepthBins {
    /// Maximum parallax between two samples of one bin inside the headbox, face pixels.
    pub const PARALLAX_PX: f64 = 1.0;

    /// Creates the bins for a headbox and a face resolution.
    pub fn new(half_size_m: f64, face_size_px: u32) -> Self {
        let count = 3f64.sqrt() * f64::from(face_size_px) / 2.0 / Self::PARALLAX_PX;
        Self {
            half_size_m: half_size_m as f32,
            count: count.ceil().clamp(1.0, 65_535.0) as f32,
        }
    }

    /// Computes the bin of an inverse depth, and the position inside the bin in 1/65,536 of its
    /// width.
    #[inline]
    pub fn place(&self, inverse_depth: f32) -> (u16, u16) {
        let x = (inverse_depth * self.half_size_m * self.count).clamp(0.0, self.count - 0.001);
        let bin = x as u32;
        let position = ((x - bin as f32) * 65_536.0).min(65_535.0);
        (bin as u16, position as u16)
    }

    /// Computes the inverse depth, 1/m, at a position in bins.
    pub fn inverse_depth(&self, position: f64) -> f64 {
        position / (f64::from(self.half_size_m) * f64::from(self.count))
    }
}
