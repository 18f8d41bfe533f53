//! Checks of the inputs of metrics: image sizes and viewing conditions.

use image::RgbImage;

/// Bytes that one task scans: whole pixels, and 255^2 times as many still fits `u32`.
pub(super) const SCAN_BYTES: usize = 3 * (1 << 14);
const _: () = assert!(
    SCAN_BYTES * 255 * 255 <= u32::MAX as usize,
    "a task's squared error is summed in u32"
);

/// Below this the filters are narrower than a pixel and the metric means nothing.
pub const MIN_PIXELS_PER_DEGREE: f32 = 1.0;
/// At this the filters span hundreds of pixels; a bound keeps a wild number from taking hours.
pub const MAX_PIXELS_PER_DEGREE: f32 = 1000.0;

/// Why two images could not be compared.
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

/// Two images can be compared if they have the same, non-empty extent.
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
