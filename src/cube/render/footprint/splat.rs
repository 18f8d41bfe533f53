//! Footprints: which there are ([`SplatKernel`]), splats ready to be drawn, and what they are drawn on (S20, S21,
//! C10, C12).

use super::size::{EllipseSize, LANES};
use crate::render::Spans;
use crate::render::planes::{LARGEST_BY_MIDDLE_PX, PlaneCanvas};
use fearless_simd::{Level, Simd, SimdCvtTruncate, f32x16, i32x16, prelude::*};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Which footprints are drawn.
///
/// How near to truth each comes, what its table of sizes costs `Paper`, and what else was tried: docs/decisions/0047.
/// `tests/library/splat_quality.rs` measures it anew.
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
    pub const ALL: [(&'static str, Self); 8] = [
        ("tent", Self::Tent),
        ("paper", Self::Paper),
        ("opaque", Self::Opaque),
        ("ellipse", Self::Ellipse),
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
            Self::Point => "1x1",
            Self::Plus => "plus",
            Self::Square2 => "2x2",
            Self::Square3 => "3x3",
        }
    }

    /// Whether its canvas knows how far what it shows is.
    pub(crate) fn knows_depths(self) -> bool {
        matches!(self, Self::Tent | Self::Ellipse)
    }

    /// The part of a footprint's radius that is the sample's share of its surface alone.
    pub(crate) fn own_share(self) -> f32 {
        match self {
            Self::Tent => 0.5,
            Self::Ellipse => 0.5 / EllipseSize::SCALE,
            Self::Paper
            | Self::Opaque
            | Self::Point
            | Self::Plus
            | Self::Square2
            | Self::Square3 => 1.0,
        }
    }

    /// True if its canvas compares the depths of splats, and does not rely on their order alone.
    pub(crate) fn compares_depths(self) -> bool {
        matches!(self, Self::Tent | Self::Ellipse)
    }

    /// Whether what its canvas shows depends on the order in which splats come.
    pub(crate) fn needs_order(self) -> bool {
        self != Self::Tent
    }

    /// Half of the width of a stamp of fixed size, px; `None` if samples have sizes of their own.
    pub(crate) fn stamp_radius_px(self) -> Option<f32> {
        match self {
            Self::Point => Some(0.5),
            Self::Square2 => Some(1.0),
            Self::Plus | Self::Square3 => Some(1.5),
            Self::Tent | Self::Paper | Self::Opaque | Self::Ellipse => None,
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

    /// Leaves out what lies behind what pictures on planes show at the middle of a splat, but for [large](Self::is_large) ones.
    pub(crate) fn retain_in_front(&mut self, planes: &PlaneCanvas) {
        if planes.is_empty() {
            return;
        }
        let mut kept = 0;
        for i in 0..self.count() {
            if !self.is_large(i) && planes.hides([self.x[i], self.y[i]], self.inverse_depth[i]) {
                continue;
            }
            if kept < i {
                self.move_to(kept, i);
            }
            kept += 1;
        }
        self.len = kept;
    }

    /// Puts a splat in the place of another.
    #[inline]
    fn move_to(&mut self, place: usize, i: usize) {
        for values in [
            &mut self.x,
            &mut self.y,
            &mut self.inverse_depth,
            &mut self.radius_x,
            &mut self.radius_y,
            &mut self.weight,
            &mut self.correlation,
        ] {
            values[place] = values[i];
        }
        self.color[place] = self.color[i];
    }

    /// Whether a splat is judged pixel by pixel.
    #[inline]
    pub(crate) fn is_large(&self, i: usize) -> bool {
        self.radius_x[i].max(self.radius_y[i]) > LARGEST_BY_MIDDLE_PX
    }

    /// The number of entries, never more than fit.
    #[inline]
    pub(crate) fn count(&self) -> usize {
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

    /// What pictures on planes show, behind all that is drawn.
    fn ground(&self) -> &PlaneCanvas;

    /// The same, to be drawn before [`Self::lay`].
    fn ground_mut(&mut self) -> &mut PlaneCanvas;

    /// Puts the ground behind all that is yet to come; the canvas must be empty. Nothing for a canvas that looks there by itself.
    fn lay(&mut self) {}

    /// Adds what the ground covers in part: where depths are compared, after all splats, and elsewhere before them.
    fn add_rims(&mut self, level: Level);

    /// Draws splats, in their order, with the instructions of a SIMD level.
    fn draw(&mut self, splats: &Splats, level: Level);

    /// Ends drawing: all splats and rims have come.
    fn settle(&mut self, _level: Level) {}

    /// Writes the pixels of a row, counted from its first row on, from a column on: straight colour, and the share of 255
    /// that splats cover; 0 if none touched it.
    fn resolve(&self, row: usize, column: usize, to: &mut [[u8; 4]], level: Level);

    /// Writes 1 / eye depth of what is in front in the same pixels, 0 where nothing is. A canvas that does not know it writes
    /// nothing.
    fn tell_depths(&self, _row: usize, _column: usize, _to: &mut [f32]) {}
}

/// 2^32 / divisor, rounded up, for the divisors below `N`; 0 for 0. `n * reciprocal >> 32` is `n / divisor` for all n below
/// 2^32 / N: n times the excess, which is less than 1, stays below 2^32 / divisor.
pub(crate) const fn reciprocals<const N: usize>() -> [u64; N] {
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
pub(crate) fn covered(position: f32, radius: f32, [start, end]: [f32; 2]) -> [i32; 2] {
    [position - radius, position + radius]
        .map(|border| ceil_to_i32((border - 0.5).max(start).min(end)))
}

/// [`covered`] for the splats from `start` on, as many as there are lanes.
#[inline(always)]
pub(crate) fn covered_lanes<S: Simd>(
    simd: S,
    [position, radius]: [&[f32; Splats::ROOM]; 2],
    start: usize,
    [first, end]: [f32; 2],
) -> [i32x16<S>; 2] {
    let (position, radius) = (load(simd, position, start), load(simd, radius, start));
    let (left, right) = (position - radius - 0.5, position + radius - 0.5);
    let (left, right) = (
        left.max(first).min(end).ceil(),
        right.max(first).min(end).ceil(),
    );
    [i32x16::truncate_from(left), i32x16::truncate_from(right)]
}

/// The values of the splats from `start` on, as many as there are lanes.
#[inline(always)]
pub(crate) fn load<S: Simd>(simd: S, values: &[f32; Splats::ROOM], start: usize) -> f32x16<S> {
    f32x16::from_slice(simd, &values[start..start + LANES])
}

/// `v.ceil() as i32` for |v| < 2^24, without the call into libm that `ceil` is on processors before SSE4.1.
#[inline(always)]
pub(crate) fn ceil_to_i32(v: f32) -> i32 {
    let truncated = v as i32;
    truncated + i32::from((truncated as f32) < v)
}
