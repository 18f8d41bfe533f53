//! Footprints: which there are ([`SplatKernel`]), splats ready to be drawn, and what they are drawn on (inventory S20, S21,
//! C10, C12).

use super::Spans;
use super::size::{EllipseSize, LANES};
use fearless_simd::{Level, Simd, SimdCvtTruncate, f32x16, i32x16, prelude::*};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Which footprints are drawn.
///
/// PSNR in dB against truth on the test bed, by `tests/splat_quality.rs`: faces of 160 px, all eleven bits for the normal,
/// f2/f1 = frame pixels for one face pixel on the axis. `cube map` is a ray-traced cube map of equal face size, resampled
/// bilinearly: the best that is possible from the centre without silhouettes of one's own.
///
/// | kernel     | room, centre: 0.5 | 1.3  | 2    | 3    | off it: 0.5 | 1.3  | 2    | 3    | holes   |
/// |------------|-------------------|------|------|------|-------------|------|------|------|---------|
/// | (cube map) | 42.3              | 42.9 | 37.9 | 37.4 | 19.6        | 19.7 | 21.6 | 21.1 |         |
/// | `Paper`    | 19.0              | 23.8 | 32.2 | 29.1 | 19.8        | 19.4 | 36.3 | 36.6 | 1.7 %   |
/// | `Opaque`   | 31.3              | 36.3 | 34.9 | 35.6 | 31.6        | 33.5 | 37.6 | 37.7 | 0.02 %  |
/// | `Tent`     | 41.5              | 42.0 | 37.2 | 37.2 | 41.6        | 39.5 | 41.4 | 39.9 | 0       |
/// | `Ellipse`  | 40.6              | 40.3 | 36.3 | 36.3 | 40.8        | 38.2 | 40.1 | 39.1 | 0       |
///
/// | kernel     | leaves, centre: 0.5 | 1.3  | 2    | 3    | off it: 0.5 | 1.3  | 2    | 3    | holes   |
/// |------------|---------------------|------|------|------|-------------|------|------|------|---------|
/// | (cube map) | 38.1                | 35.0 | 35.6 | 31.2 | 17.8        | 19.2 | 22.1 | 21.9 |         |
/// | `Paper`    | 22.2                | 27.0 | 30.3 | 30.0 | 22.9        | 26.8 | 27.4 | 30.5 | 0.2 %   |
/// | `Opaque`   | 29.1                | 31.9 | 33.2 | 30.5 | 28.3        | 30.4 | 29.3 | 30.9 | 0.01 %  |
/// | `Tent`     | 35.2                | 33.9 | 34.3 | 30.7 | 34.4        | 33.3 | 30.3 | 31.1 | 0       |
/// | `Ellipse`  | 34.5                | 33.2 | 33.9 | 30.6 | 33.9        | 32.8 | 30.2 | 30.9 | 0       |
///
/// Depth pixels that are not packed ([`crate::packed::ExactCube`]) change none of these by more than 0.06 dB. Integers cost
/// nothing either: what `Ellipse` gains by not rounding it loses to Gaussians being wider than tents.
///
/// Most of what `Paper` loses is its table of sizes, which takes angles to the cameras' axes for angles to the lines of
/// sight: a floor seen through a side face, at 90 degrees to that axis, gets any size. Tried and dropped, at f2/f1 = 1.3
/// in the room: the paper's squares with the thresholds 2, 4, 6 (12 dB, 20 % holes); their rims only where nothing or a
/// farther surface is (0.1 dB better); tents sharpened (w^1.5: 0.9 to 3.3 dB worse) or widened (1.1 times: 0.5 to 0.7
/// dB worse); tents of one radius from w^-3/2 without normals (0 to 0.5 dB worse off the centre, up to 1.5 dB at
/// f2/f1 = 0.5), and from the paper's table (8 dB worse).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SplatKernel {
    /// The paper's: squares of 1, 3, 5 and 7 pixels with the alphas 1, 1/2 and 1/4, each blended over what is there,
    /// their width from the splat table that is refilled for every frame (S20, S21).
    Paper,
    /// Opaque rectangles as large as the sample's share of its surface: nearest-neighbour reconstruction.
    Opaque,
    /// Tents that reach to the neighbouring samples of the surface, averaged by weight per surface: bilinear
    /// reconstruction, with soft silhouettes.
    #[default]
    Tent,
    /// Gaussians that are ellipses, as wide as the sample's share of its surface, averaged by weight per surface in floating
    /// point and linear light: what one would draw if time were no matter. Three times the time of [`Self::Tent`].
    Ellipse,
    /// No footprints: first which sample shows in each pixel, then the colour of its surface there.
    Surface,
    /// One opaque pixel for every sample.
    Point,
    /// An opaque plus of five pixels for every sample, the one that holds it and its four neighbours: the fixed stamp that
    /// Rafferty et al. find enough for LDIs (R7, R12).
    Plus,
    /// An opaque square of two pixels a side for every sample (R7).
    Square2,
    /// An opaque square of three pixels a side for every sample (R7).
    Square3,
}

impl SplatKernel {
    /// All kernels with the names under which the command line knows them; the default first.
    pub const ALL: [(&'static str, Self); 9] = [
        ("tent", Self::Tent),
        ("paper", Self::Paper),
        ("opaque", Self::Opaque),
        ("ellipse", Self::Ellipse),
        ("surface", Self::Surface),
        ("1x1", Self::Point),
        ("plus", Self::Plus),
        ("2x2", Self::Square2),
        ("3x3", Self::Square3),
    ];

    /// The name in [`Self::ALL`].
    pub fn name(self) -> &'static str {
        match self {
            Self::Tent => "tent",
            Self::Paper => "paper",
            Self::Opaque => "opaque",
            Self::Ellipse => "ellipse",
            Self::Surface => "surface",
            Self::Point => "1x1",
            Self::Plus => "plus",
            Self::Square2 => "2x2",
            Self::Square3 => "3x3",
        }
    }

    /// The part of a footprint's radius that is the sample's share of its surface alone.
    pub(crate) fn own_share(self) -> f32 {
        match self {
            Self::Tent => 0.5,
            Self::Ellipse => 0.5 / EllipseSize::SCALE,
            Self::Paper | Self::Opaque | Self::Surface | Self::Point | Self::Plus | Self::Square2 | Self::Square3 => 1.0,
        }
    }

    /// Half of the width of a stamp of fixed size, px; `None` if samples have sizes of their own.
    pub(crate) fn stamp_radius_px(self) -> Option<f32> {
        match self {
            Self::Point => Some(0.5),
            Self::Square2 => Some(1.0),
            Self::Plus | Self::Square3 => Some(1.5),
            Self::Tent | Self::Paper | Self::Opaque | Self::Ellipse | Self::Surface => None,
        }
    }
}

/// Splats that are ready to be drawn, in drawing order; each part in an array of its own, so that loops over them are
/// vectorised.
pub(crate) struct Splats {
    /// Number of entries in use.
    pub(crate) len: usize,
    /// How many are about 1, 3, 5, and 7 or more pixels wide.
    pub(crate) by_footprint: [u64; 4],
    /// Position in frame pixels.
    pub(crate) x: [f32; Splats::ROOM],
    /// Position in frame pixels, row 0 on top.
    pub(crate) y: [f32; Splats::ROOM],
    /// 1 / eye depth in the frame, 1/m.
    pub(crate) inverse_depth: [f32; Splats::ROOM],
    /// Half of the width, px.
    pub(crate) radius_x: [f32; Splats::ROOM],
    /// Half of the height, px.
    pub(crate) radius_y: [f32; Splats::ROOM],
    /// Weight at the middle, 0..1: such that the weights of a whole surface add up to 1 everywhere.
    pub(crate) weight: [f32; Splats::ROOM],
    /// Of x and y along the footprint, if it is an ellipse.
    pub(crate) correlation: [f32; Splats::ROOM],
    /// The four bytes of the depth pixel's colour (sRGB, straight alpha), as they lie in memory.
    pub(crate) color: [u32; Splats::ROOM],
}

impl Splats {
    /// As many as a batch of depth pixels can make, and room to write a whole register behind the last.
    pub(crate) const ROOM: usize = crate::render::BATCH_CAPACITY + LANES;

    pub(crate) fn new() -> Self {
        let zero = [0.0; Self::ROOM];
        Self {
            len: 0,
            by_footprint: [0; 4],
            x: zero,
            y: zero,
            inverse_depth: zero,
            radius_x: zero,
            radius_y: zero,
            weight: zero,
            correlation: zero,
            color: [0; Self::ROOM],
        }
    }

    /// The number of entries, never more than fit.
    #[inline(always)]
    pub(super) fn count(&self) -> usize {
        self.len.min(Self::ROOM)
    }
}

/// What splats are drawn on.
pub(crate) trait Canvas {
    /// Makes it empty, for these rows of a frame that is `width` pixels wide, keeping the memory it has.
    fn clear(&mut self, width: u32, rows: Range<u32>);

    /// Makes it empty in some columns of each row of a frame of a given width and height; what is elsewhere may be
    /// anything.
    fn clear_spans(&mut self, frame_px: [u32; 2], spans: &dyn Fn(u32) -> Spans);

    /// Draws splats, in their order, with the instructions of a SIMD level.
    fn draw(&mut self, splats: &Splats, level: Level);

    /// Writes the pixels of a row, counted from its first row on, from a column on: straight colour, and the share of 255
    /// that splats cover; 0 if none touched it.
    fn resolve(&self, row: usize, column: usize, to: &mut [[u8; 4]], level: Level);
}

/// 2^32 / divisor, rounded up, for the divisors below `N`; 0 for 0. `n * reciprocal >> 32` is `n / divisor` for all n below
/// 2^32 / N: n times the excess, which is less than 1, stays below 2^32 / divisor.
pub(super) const fn reciprocals<const N: usize>() -> [u64; N] {
    let mut reciprocals = [0; N];
    let mut divisor = 1;
    while divisor < N {
        reciprocals[divisor] = (1u64 << 32).div_ceil(divisor as u64);
        divisor += 1;
    }
    reciprocals
}

/// Fills some columns of each row with a value; `margin` pixels of a row lie left of column 0.
pub(crate) fn clear_spans<T: Copy>(
    pixels: &mut [T],
    stride: usize,
    margin: usize,
    value: T,
    spans: &dyn Fn(u32) -> Spans,
) {
    for (y, row) in (0..).zip(pixels.chunks_exact_mut(stride.max(1))) {
        for span in spans(y) {
            row[margin..][span.start as usize..span.end as usize].fill(value);
        }
    }
}

/// The pixels from `position - radius` to `position + radius` whose centres lie inside, clipped to `bounds`: the first, and
/// the one after the last.
#[inline(always)]
pub(super) fn covered(position: f32, radius: f32, [start, end]: [f32; 2]) -> [i32; 2] {
    [position - radius, position + radius].map(|border| ceil_to_i32((border - 0.5).max(start).min(end)))
}

/// [`covered`] for the splats from `start` on, as many as there are lanes.
#[inline(always)]
pub(super) fn covered_lanes<S: Simd>(
    simd: S,
    [position, radius]: [&[f32; Splats::ROOM]; 2],
    start: usize,
    [first, end]: [f32; 2],
) -> [i32x16<S>; 2] {
    let load = |values: &[f32; Splats::ROOM]| f32x16::from_slice(simd, &values[start..start + LANES]);
    let (position, radius) = (load(position), load(radius));
    let (first, end) = (f32x16::splat(simd, first), f32x16::splat(simd, end));
    // Not by `map`: within a function of the standard library, which is compiled for no level, each operation is a call.
    let beyond = |border: f32x16<S>| i32x16::truncate_from((border - 0.5).max(first).min(end).ceil());
    [beyond(position - radius), beyond(position + radius)]
}

/// `v.ceil() as i32` for |v| < 2^24, without the call into libm that `ceil` is on processors before SSE4.1.
#[inline(always)]
pub(super) fn ceil_to_i32(v: f32) -> i32 {
    let truncated = v as i32;
    truncated + i32::from((truncated as f32) < v)
}
