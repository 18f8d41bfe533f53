//! Checks of the inputs of metrics: image sizes and viewing conditions.

use ::image::RgbImage;

/// Bytes per task: whole pixels, and 255^2 times this fits in `u32`.
pub(super) const SCAN_BYTES: usize = 3 * (1 << 14);
const _: () = assert!(
    SCAN_BYTES * 255 * 255 <= u32::MAX as usize,
    "a task's squared error is summed in u32"
);

/// Minimum pixels per degree: below it, FLIP's filters are narrower than a pixel and the metric is
/// meaningless.
pub const MIN_PIXELS_PER_DEGREE: f32 = 1.0;
/// Maximum pixels per degree: at it, the filters span hundreds of pixels; the limit prevents run
/// times of hours.
pub const MAX_PIXELS_PER_DEGREE: f32 = 1000.0;

/// Error of comparing two images.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum MetricError {
    /// The images differ in size; both sizes are width and height in pixels.
    #[error("the images differ in size: {}x{} and {}x{} pixels", reference.0, reference.1, test.0, test.1)]
    SizeMismatch {
        /// Size of the reference image.
        reference: (u32, u32),
        /// Size of the test image.
        test: (u32, u32),
    },
    /// The images have no pixels, so that no mean exists.
    #[error("the images have no pixels")]
    Empty,
    /// The viewing condition of FLIP is outside the supported range.
    #[error(
        "pixels per degree must lie in {MIN_PIXELS_PER_DEGREE}..={MAX_PIXELS_PER_DEGREE}, but {0} was given"
    )]
    PixelsPerDegree(f32),
}

/// Checks that two images have the same, non-empty size.
pub(super) fn check_sizes(reference: &RgbImage, test: &RgbImage) -> Result<(), MetricError> {
    if reference.dimensions() != test.dimensions() {
        return Err(MetricError::SizeMismatch {
            reference: reference.dimensions(),
            test: test.dimensions(),
        });
    }
    if reference.width() == 0 || reference.height() == 0 {
        return Err(MetricError::Empty);
    }
    Ok(())
}
