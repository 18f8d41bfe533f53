//! Depth maps of COLMAP's dense reconstruction.

use crate::ImagesError;
use crate::depth::DepthPicture;
use headbox_core::image::codec::MAX_PIXELS;
use std::path::Path;

/// Reads a map: `width&height&channels&`, then 32-bit floats.
pub(super) fn read(path: &Path) -> Result<DepthPicture, ImagesError> {
    let bytes = std::fs::read(path).map_err(|cause| ImagesError::io(path, cause))?;
    let bad = |cause: &str| ImagesError::invalid_picture(path, cause);
    let mut rest = bytes.as_slice();
    let mut header = [0usize; 3];
    for number in &mut header {
        let end = rest
            .iter()
            .take(12)
            .position(|&byte| byte == b'&')
            .ok_or_else(|| bad("is not a COLMAP depth map"))?;
        let text = std::str::from_utf8(&rest[..end])
            .ok()
            .and_then(|text| text.parse().ok());
        *number = text.ok_or_else(|| bad("is not a COLMAP depth map"))?;
        rest = &rest[end + 1..];
    }
    let [width, height, channels] = header;
    let count = width
        .checked_mul(height)
        .filter(|&count| count as u64 <= MAX_PIXELS && channels == 1);
    let count = count.ok_or_else(|| bad("is not a COLMAP depth map with one channel"))?;
    if rest.len() != count * 4 {
        return Err(bad(
            "has a length that does not match the size in its header",
        ));
    }
    let words = rest.as_chunks().0.iter();
    Ok(DepthPicture {
        width: width as u32,
        height: height as u32,
        values: words.map(|word| f32::from_le_bytes(*word)).collect(),
    })
}
