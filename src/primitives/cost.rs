//! What primitives cost, where two hold the bound.

/// Bytes of a texel, and of a sample with its share of the tables.
const BYTES: [f64; 2] = [4.0, 8.5];

/// Frame pixels for one face pixel, where a picture is seen about as the centre sees it.
const FRAME_PER_FACE_PX: f64 = 1.7;

/// Nanoseconds on one thread: a tile, a frame row of a tile, a frame pixel of a tile, and a sample.
/// Rough figures; `benches/primitives.rs` measures whole frames.
const NS: [f64; 4] = [250.0, 25.0, 3.0, 12.0];

/// What a picture of some texels saves over the samples that it stands for, by bytes and by time, each in samples; `None` if it is
/// larger or slower.
pub(super) fn saved(samples: usize, width: u16, height: u16) -> Option<f64> {
    let (samples, width, height) = (samples as f64, f64::from(width), f64::from(height));
    let bytes = BYTES[0] * width * height + 20.0;
    let ns = NS[0] + NS[1] * height * FRAME_PER_FACE_PX.sqrt() + NS[2] * width * height * FRAME_PER_FACE_PX;
    let saved = [samples - bytes / BYTES[1], samples - ns / NS[3]];
    (saved[0] >= 0.0 && saved[1] >= 0.0).then_some(saved[0] + saved[1])
}
