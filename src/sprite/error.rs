//! Errors of sprites.

use headbox_core::memory::OverBudget;

/// Error of creating a sprite.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpriteError {
    /// Two images that belong together differ in size (width and height in pixels).
    #[error("the {a} has {}x{} pixels, the {b} {}x{}; they must be equal", a_size.0, a_size.1, b_size.0, b_size.1)]
    SizeMismatch {
        /// Name of one image.
        a: &'static str,
        /// Its size.
        a_size: (u32, u32),
        /// Name of the other image.
        b: &'static str,
        /// Its size.
        b_size: (u32, u32),
    },
    /// The displacement is finer than the image.
    #[error("a displacement of {}x{} for a picture of {}x{} pixels; it may be coarser, not finer",
        displacement.0, displacement.1, color.0, color.1)]
    DisplacementSize {
        /// Columns and rows.
        displacement: (u32, u32),
        /// Columns and rows.
        color: (u32, u32),
    },
    /// The number of values differs from the number of pixels.
    #[error("{found} values for {expected} pixels")]
    Count {
        /// Pixels.
        expected: usize,
        /// Values.
        found: usize,
    },
    /// A displacement or its scale is NaN or infinite.
    #[error("a displacement is not a finite number")]
    NotFinite,
    /// No visible pixel has a depth.
    #[error("no visible pixel has a valid depth (a finite number above 0)")]
    NoValidDepth,
    /// The near and far planes of window depths are invalid.
    #[error(
        "window depth needs a near and a far plane with 0 < near < far (far may be infinite); got {near} and {far}"
    )]
    DepthRange {
        /// Near plane, metres.
        near: f64,
        /// Far plane, metres.
        far: f64,
    },
    /// The image is too large for the memory that is left.
    #[error("making a sprite {0}")]
    Memory(#[from] OverBudget),
    /// The plane passes through the eye of the sprite's camera.
    #[error("the sprite's plane passes through its camera's eye, or is not finite")]
    PlaneThroughEye,
}

impl SpriteError {
    /// Checks that two images have the same size.
    pub(crate) fn check_sizes(
        a: &'static str,
        a_size: (u32, u32),
        b: &'static str,
        b_size: (u32, u32),
    ) -> Result<(), Self> {
        if a_size == b_size {
            Ok(())
        } else {
            Err(Self::SizeMismatch {
                a,
                a_size,
                b,
                b_size,
            })
        }
    }
}
