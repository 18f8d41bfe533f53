//! Blocks of pixels: their positions on the plane, mip level and cells, computed once in f64.

use super::backward::{BackwardPlan, Cells, Parallax};
use super::footprints::SMALL_PARALLAX;
use super::sampling::{LANES, TexelMap};
use crate::warp::transfer::SpriteTransfer;
use glam::{DVec3, dvec3};

/// Returns the number of pixels to draw as one block: all `pixels` if both ends use the same mip
/// level, else one vector.
#[inline(always)]
pub(super) fn pixels_of_one_level(plan: &BackwardPlan, [x, y]: [usize; 2], pixels: usize) -> usize {
    let h = &plan.transfer.sprite_from_target;
    let level = |x: f64| {
        let at = h.x_axis * x + (h.y_axis * (y as f64 + 0.5) + h.z_axis);
        let inverse_w = 1.0 / at.z;
        let levels = plan.texture.levels.len();
        (at.z > 0.0).then(|| {
            mip_level(
                plan.transfer,
                inverse_w,
                [at.x * inverse_w, at.y * inverse_w],
                levels,
            )
        })
    };
    let (first, last) = (level(x as f64 + 0.5), level((x + pixels) as f64 - 0.5));
    if first == last {
        pixels
    } else {
        pixels.min(LANES)
    }
}

/// Values computed once per block in f64: positions are relative to a whole texel near the block
/// (the *anchor*), so that f32 resolves them to 1e-5 px.
pub(super) struct PixelBlock<'a> {
    /// (x3 w, y3 w, w) relative to the anchor at the first pixel, divided by `normalizer`.
    pub(super) start: [f32; 3],
    /// Change of `start` per pixel.
    pub(super) step: [f32; 3],
    pub(super) normalizer: f32,
    pub(super) texels: TexelMap,
    /// True if all pixels of the block are in front of the eye and over texels.
    pub(super) over_texels: bool,
    pub(super) lookup: Option<Lookup<'a>>,
}

/// Parameters of the cell lookup of a block.
pub(super) struct Lookup<'a> {
    pub(super) cells: &'a [u32],
    pub(super) stride: i32,
    pub(super) cells_per_px: [f32; 2],
    /// Cell position of the anchor relative to `base`.
    pub(super) fraction: [f32; 2],
    pub(super) base: [i32; 2],
    pub(super) size: [i32; 2],
    /// Bounds of visible positions, relative to the anchor.
    pub(super) low: [f32; 2],
    pub(super) high: [f32; 2],
    /// e21, with the first two components relative to the anchor.
    pub(super) epipole: [f32; 3],
    /// True if all pixels of the block are in front of the eye and over cells.
    pub(super) inside: bool,
    /// True if displacements are so small that
    /// [`reciprocal_near_one`](super::footprints::reciprocal_near_one) is accurate.
    pub(super) small_parallax: bool,
}

/// Bound of anchor coordinates, pixels: keeps integers small; farther out the precision does not
/// matter.
const FARTHEST_ANCHOR: f64 = 131_072.0;

impl<'a> PixelBlock<'a> {
    /// Prepares a block; `None` if no pixel of it is visible.
    #[inline(always)]
    pub(super) fn new(
        plan: &BackwardPlan<'a>,
        cells: Option<Cells<'a>>,
        [x, y]: [usize; 2],
        pixels: usize,
    ) -> Option<Self> {
        let h = &plan.transfer.sprite_from_target;
        let y = y as f64 + 0.5;
        let at = |x: f64| h.x_axis * x + (h.y_axis * y + h.z_axis);
        let x = x as f64;
        // Only the drawn pixels count: beyond a narrow frame a plane may appear at a very different
        // scale.
        let length = pixels as f64;
        let (first, middle, last) = (at(x + 0.5), at(x + 0.5 * length), at(x + length - 0.5));
        if first.z <= 0.0 && last.z <= 0.0 {
            return None; // the plane is behind the target eye all along
        }
        let inverse_w = 1.0 / middle.z;
        let center = [middle.x * inverse_w, middle.y * inverse_w];
        let level = mip_level(plan.transfer, inverse_w, center, plan.texture.levels.len());
        // Pixels this far outside the image can still touch its border's texels.
        let rim = f64::from(1u32 << level) + 1.0;
        let (low, high) = bounds(plan, cells, rim);
        if first.z > 0.0 && last.z > 0.0 && outside([first, last], low, high) {
            return None;
        }
        let anchor = [floor_clamped(center[0]), floor_clamped(center[1])];
        let normalizer = if middle.z > 0.0 {
            middle.z
        } else {
            first.z.max(last.z)
        };
        let to_anchor = dvec3(anchor[0], anchor[1], 0.0);
        let inverse_w = if middle.z > 0.0 {
            inverse_w
        } else {
            1.0 / normalizer
        };
        let start = (first - to_anchor * first.z) * inverse_w;
        let step = (h.x_axis - to_anchor * h.x_axis.z) * inverse_w;
        Some(Self {
            start: start.as_vec3().to_array(),
            step: step.as_vec3().to_array(),
            normalizer: normalizer as f32,
            texels: TexelMap::new(plan.texture, level, anchor),
            over_texels: over(
                [first, last],
                [0.0; 2],
                [
                    f64::from(plan.texture.levels[0].width),
                    f64::from(plan.texture.levels[0].height),
                ],
            ),
            lookup: cells.map(|cells| Lookup::new(plan, cells, anchor, low, high, [first, last])),
        })
    }
}

/// Rounds a position down to a whole pixel; 0 if it is not finite.
#[inline(always)]
fn floor_clamped(position: f64) -> f64 {
    if position.is_finite() {
        position.floor().clamp(-FARTHEST_ANCHOR, FARTHEST_ANCHOR)
    } else {
        0.0
    }
}

/// Selects the mip level whose texels are about as large as the frame's pixels, by the stretch of
/// the homography along the frame's rows and columns at the block's middle; `inverse_w` is 1 / w
/// there.
#[inline(always)]
fn mip_level(transfer: &SpriteTransfer, inverse_w: f64, center: [f64; 2], levels: usize) -> usize {
    let h = &transfer.sprite_from_target;
    let squared = |column: DVec3| {
        let [x, y] = [
            column.x - center[0] * column.z,
            column.y - center[1] * column.z,
        ];
        (x * x + y * y) * (inverse_w * inverse_w)
    };
    let stretch = squared(h.x_axis).max(squared(h.y_axis));
    // floor(log2(stretch^1/2) + 1/2) = floor(log2(2 stretch) / 2), read off the exponent.
    let exponent = ((2.0 * stretch).to_bits() >> 52 & 0x7ff) as i64 - 1023;
    if stretch.is_finite() {
        (exponent.max(0) / 2) as usize
    } else {
        0
    }
    .min(levels - 1)
}

/// Returns the rectangle of plane positions, in pixels of the image, outside of which nothing is
/// visible.
#[inline(always)]
fn bounds(plan: &BackwardPlan, cells: Option<Cells>, rim: f64) -> ([f64; 2], [f64; 2]) {
    match cells {
        None => {
            let level = &plan.texture.levels[0];
            (
                [-rim; 2],
                [f64::from(level.width) + rim, f64::from(level.height) + rim],
            )
        }
        Some(Cells { origin, size, .. }) => {
            let [px, py] = plan.cell_px;
            let (x, y) = (f64::from(origin[0]), f64::from(origin[1]));
            let high = [
                (x + f64::from(size[0])) * px + rim,
                (y + f64::from(size[1])) * py + rim,
            ];
            ([x * px - rim, y * py - rim], high)
        }
    }
}

/// Returns true if both ends of a line segment are in front of the eye and inside a rectangle.
#[inline(always)]
fn over(ends: [DVec3; 2], low: [f64; 2], high: [f64; 2]) -> bool {
    let inside = |p: &DVec3| {
        p.z > 0.0
            && p.x > low[0] * p.z
            && p.x < high[0] * p.z
            && p.y > low[1] * p.z
            && p.y < high[1] * p.z
    };
    ends.iter().all(inside)
}

/// Returns true if both ends of a line segment (w > 0) lie beyond one side of a rectangle.
#[inline(always)]
fn outside(ends: [DVec3; 2], low: [f64; 2], high: [f64; 2]) -> bool {
    ends.iter().all(|p| p.x < low[0] * p.z)
        || ends.iter().all(|p| p.x > high[0] * p.z)
        || ends.iter().all(|p| p.y < low[1] * p.z)
        || ends.iter().all(|p| p.y > high[1] * p.z)
}

impl<'a> Lookup<'a> {
    #[inline(always)]
    pub(super) fn new(
        plan: &BackwardPlan,
        cells: Cells<'a>,
        anchor: [f64; 2],
        low: [f64; 2],
        high: [f64; 2],
        ends: [DVec3; 2],
    ) -> Self {
        let [px, py] = plan.cell_px;
        let x = anchor[0] / px - f64::from(cells.origin[0]);
        let y = anchor[1] / py - f64::from(cells.origin[1]);
        let (column, row) = (x.floor(), y.floor());
        let e = -plan.transfer.epipole_in_sprite;
        let e = match plan.parallax {
            Parallax::Affine(_) => dvec3(e.x, e.y, 0.0),
            _ => e - dvec3(anchor[0], anchor[1], 0.0) * e.z,
        };
        // A line between two positions over the field stays over it; the margin of an eighth of a
        // cell is for rounding.
        let [left, top] = [px, py].map(|side| 0.125 * side);
        let [left, top] = [
            left + f64::from(cells.origin[0]) * px,
            top + f64::from(cells.origin[1]) * py,
        ];
        let right = left + (f64::from(cells.size[0]) - 0.25) * px;
        let bottom = top + (f64::from(cells.size[1]) - 0.25) * py;
        Self {
            inside: over(ends, [left, top], [right, bottom]),
            small_parallax: f64::from(cells.largest) * e.z.abs() < SMALL_PARALLAX,
            cells: cells.cells,
            stride: cells.size[0] as i32,
            cells_per_px: [(1.0 / px) as f32, (1.0 / py) as f32],
            fraction: [(x - column) as f32, (y - row) as f32],
            base: [column as i32, row as i32],
            size: [cells.size[0] as i32, cells.size[1] as i32],
            low: [(low[0] - anchor[0]) as f32, (low[1] - anchor[1]) as f32],
            high: [(high[0] - anchor[0]) as f32, (high[1] - anchor[1]) as f32],
            epipole: e.as_vec3().to_array(),
        }
    }
}
