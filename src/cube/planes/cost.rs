//! Cost model of primitives, where two satisfy the bound.

/// Bytes of a texel, and of a sample with its share of the tables.
const BYTES: [f64; 2] = [4.0, 8.5];

/// Frame pixels for one face pixel, where a picture is seen about as the centre sees it.
const FRAME_PER_FACE_PX: f64 = 1.7;

/// Nanoseconds on one thread: a tile, a frame row of a tile, a frame pixel of a tile, and a sample
/// that a picture may stand for. Estimates, measured on whole frames (docs/decisions/0052). A
/// sample counts for less than it takes, because most samples of regions at the limit are edges,
/// which samples show better.
const NS: [f64; 4] = [250.0, 25.0, 3.0, 12.0];

/// Nanoseconds that a sample takes on one thread, all told.
const SAMPLE_NS: f64 = 40.0;

/// Nanoseconds for a frame pixel that there are pictures at all: a canvas of colours and depths is
/// cleared, and read again under the samples.
const CANVAS_NS: f64 = 0.8;

/// Time to draw a plane texture completely, nanoseconds.
fn picture_ns(width: u16, height: u16) -> f64 {
    let (width, height) = (f64::from(width), f64::from(height));
    NS[0] + NS[1] * height * FRAME_PER_FACE_PX.sqrt() + NS[2] * width * height * FRAME_PER_FACE_PX
}

/// Savings of a plane texture over the samples that it replaces, in bytes and in time, each in
/// samples; `None` if it is larger or slower.
pub(super) fn saved(samples: usize, width: u16, height: u16) -> Option<f64> {
    let samples = samples as f64;
    let bytes = BYTES[0] * f64::from(width) * f64::from(height) + 20.0;
    let saved = [
        samples - bytes / BYTES[1],
        samples - picture_ns(width, height) / NS[3],
    ];
    (saved[0] >= 0.0 && saved[1] >= 0.0).then_some(saved[0] + saved[1])
}

/// True if all pictures of a cube, of some widths and heights, save more time over so many samples
/// than their canvas takes: in frames all around, which show each of them once.
pub(super) fn are_worth_a_canvas(
    samples: u64,
    pictures: impl Iterator<Item = [u16; 2]>,
    face_pixels: u64,
) -> bool {
    let pictures_ns: f64 = pictures
        .map(|[width, height]| picture_ns(width, height))
        .sum();
    samples as f64 * SAMPLE_NS - pictures_ns > face_pixels as f64 * FRAME_PER_FACE_PX * CANVAS_NS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texture_kept_if_smaller_and_faster() {
        // 64x64 texels have the bytes of 1,930 samples, and count as long as 1,936.
        assert_eq!(saved(1935, 64, 64), None);
        assert!(saved(1936, 64, 64).is_some_and(|saved| saved > 0.0));
        // A square of 128 counts as long as 7,331 samples, but has the bytes of 7,713.
        assert_eq!(saved(7712, 128, 128), None);
        assert!(saved(7713, 128, 128).is_some());
    }

    #[test]
    fn few_pictures_are_not_worth_a_canvas() {
        let worth = |squares: usize, face_px: u64| {
            let pictures = std::iter::repeat_n([64, 64], squares);
            are_worth_a_canvas(4096 * squares as u64, pictures, 6 * face_px * face_px)
        };
        assert!(!worth(6, 1024), "a square of each face");
        assert!(worth(6 * 256, 1024), "all there is");
        assert!(worth(1, 64), "one of six faces");
        assert!(!worth(0, 64));
    }
}
