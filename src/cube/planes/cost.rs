//! Cost model of plane textures against the samples that they replace.

/// Bytes of a texel.
const TEXEL_BYTES: f64 = 4.0;

/// Bytes of a sample with its share of the tables.
const SAMPLE_BYTES: f64 = 8.5;

/// Number of frame pixels per face pixel, for eyes near the centre.
const FRAME_PER_FACE_PX: f64 = 1.7;

// Times on one thread, nanoseconds: estimates, measured on whole frames (docs/decisions/0052).

/// Time of a tile.
const TILE_NS: f64 = 250.0;

/// Time of a frame row of a tile.
const TILE_ROW_NS: f64 = 25.0;

/// Time of a frame pixel of a tile.
const TILE_PIXEL_NS: f64 = 3.0;

/// Time of a sample in the comparison with a tile: less than [`SAMPLE_NS`], because most samples of
/// regions of equal cost are edges, which samples render better.
const REPLACED_SAMPLE_NS: f64 = 12.0;

/// Total time of a sample.
const SAMPLE_NS: f64 = 40.0;

/// Time per frame pixel of the canvas of plane textures, which is cleared, and read under the
/// samples.
const CANVAS_NS: f64 = 0.8;

/// Estimates the time to draw a whole tile, nanoseconds.
fn tile_ns(width: u16, height: u16) -> f64 {
    let (width, height) = (f64::from(width), f64::from(height));
    TILE_NS
        + TILE_ROW_NS * height * FRAME_PER_FACE_PX.sqrt()
        + TILE_PIXEL_NS * width * height * FRAME_PER_FACE_PX
}

/// Estimates the savings of a tile over the samples that it replaces: the sum of those in bytes and
/// in time, each in samples; `None` if the tile is larger or slower.
pub(super) fn savings(samples: usize, width: u16, height: u16) -> Option<f64> {
    let samples = samples as f64;
    let bytes = TEXEL_BYTES * f64::from(width) * f64::from(height) + 20.0;
    let in_bytes = samples - bytes / SAMPLE_BYTES;
    let in_time = samples - tile_ns(width, height) / REPLACED_SAMPLE_NS;
    (in_bytes >= 0.0 && in_time >= 0.0).then_some(in_bytes + in_time)
}

/// Returns true if all tiles of a cube, given by width and height, save more time over the samples
/// that they replace than their canvas costs, in frames of all directions, which show each tile
/// once.
pub(super) fn outweigh_canvas(
    samples: u64,
    tiles: impl Iterator<Item = [u16; 2]>,
    face_pixels: u64,
) -> bool {
    let tiles_ns: f64 = tiles.map(|[width, height]| tile_ns(width, height)).sum();
    samples as f64 * SAMPLE_NS - tiles_ns > face_pixels as f64 * FRAME_PER_FACE_PX * CANVAS_NS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texture_kept_if_smaller_and_faster() {
        // 64x64 texels have the bytes of 1,930 samples, and count as long as 1,936.
        assert_eq!(savings(1935, 64, 64), None);
        assert!(savings(1936, 64, 64).is_some_and(|savings| savings > 0.0));
        // A square of 128 counts as long as 7,331 samples, but has the bytes of 7,713.
        assert_eq!(savings(7712, 128, 128), None);
        assert!(savings(7713, 128, 128).is_some());
    }

    #[test]
    fn few_tiles_do_not_outweigh_canvas() {
        let worth = |squares: usize, face_px: u64| {
            let tiles = std::iter::repeat_n([64, 64], squares);
            outweigh_canvas(4096 * squares as u64, tiles, 6 * face_px * face_px)
        };
        assert!(!worth(6, 1024), "a square of each face");
        assert!(worth(6 * 256, 1024), "all there is");
        assert!(worth(1, 64), "one of six faces");
        assert!(!worth(0, 64));
    }
}
