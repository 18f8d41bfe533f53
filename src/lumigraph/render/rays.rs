//! The rays of sixteen pixels: their slopes, the four cameras that each lies between, and where
//! these look (L9, C21).

use super::cells::Bundle;
use super::layer_in_view::LayerInView;
use super::plan::{LumigraphPlan, cell};
use super::pyramid::Level;
use super::taps::LANES;
use fearless_simd::{Simd, f32x16, mask32x16, prelude::*, u32x16};

/// Edge of the square of pixels whose rays are drawn at once: few layers show in one.
pub(super) const TILE: usize = 4;

/// The lanes of a tile's corners.
const CORNERS: [usize; 4] = [0, TILE - 1, LANES - TILE, LANES - 1];

/// The share of a cell's camera along each axis, at least: where it alone sees what a ray meets,
/// beside the grid or just where another cell begins, it is asked.
pub(crate) const LEAST_WEIGHT: f32 = 1.0 / 1024.0;

/// The cameras to either side of some rays, along one axis of the grid.
struct Sides<S: Simd> {
    /// Their places.
    place: [f32x16<S>; 2],
    /// Their bilinear weights.
    weight: [f32x16<S>; 2],
    /// Their numbers.
    number: [u32x16<S>; 2],
    /// The numbers, if they are all rays' own.
    shared: Option<[usize; 2]>,
}

#[inline(always)]
fn sides<S: Simd>(simd: S, places: &[f32], position: f32x16<S>, shift: i32) -> Sides<S> {
    let positions = position.to_array();
    let most = places.len().saturating_sub(2);
    let shifted = |cell: usize| cell.saturating_add_signed(shift as isize).min(most);
    let above = |low: usize| (low + 1).min(places.len() - 1);
    let first = cell(places, positions[0]);
    let begins = if first == 0 {
        f32::NEG_INFINITY
    } else {
        places[first]
    };
    let ends = if first >= most {
        f32::INFINITY
    } else {
        places[first + 1]
    };
    let (place, number, shared);
    if (position.simd_ge(begins) & position.simd_lt(ends)).all_true() {
        let low = shifted(first);
        let high = above(low);
        place = [
            f32x16::splat(simd, places[low]),
            f32x16::splat(simd, places[high]),
        ];
        number = [
            u32x16::splat(simd, low as u32),
            u32x16::splat(simd, high as u32),
        ];
        shared = Some([low, high]);
    } else {
        let (mut place_of, mut number_of) = ([[0.0; LANES]; 2], [[0; LANES]; 2]);
        for i in 0..LANES {
            let low = shifted(cell(places, positions[i]));
            let high = above(low);
            (number_of[0][i], number_of[1][i]) = (low as u32, high as u32);
            (place_of[0][i], place_of[1][i]) = (places[low], places[high]);
        }
        place = [
            f32x16::load_array(simd, place_of[0]),
            f32x16::load_array(simd, place_of[1]),
        ];
        number = [
            u32x16::load_array(simd, number_of[0]),
            u32x16::load_array(simd, number_of[1]),
        ];
        shared = None;
    }
    // A single camera is both.
    let gap = (place[1] - place[0]).max(f32::MIN_POSITIVE);
    let of_high = ((position - place[0]) / gap)
        .max(LEAST_WEIGHT)
        .min(1.0 - LEAST_WEIGHT);
    Sides {
        place,
        weight: [f32x16::splat(simd, 1.0) - of_high, of_high],
        number,
        shared,
    }
}

/// The rays of sixteen pixels.
pub(super) struct Rays<S: Simd> {
    slopes: [f32x16<S>; 2],
    across: Sides<S>,
    up: Sides<S>,
    /// Weights of the four cameras: low and high columns of the low row, then of the high one.
    pub(super) weight: [f32x16<S>; 4],
    /// Index of the first texel of each camera.
    pub(super) base: [u32x16<S>; 4],
    /// `None` where some lie between other cameras.
    pub(super) bundle: Option<Bundle>,
}

impl<S: Simd> Rays<S> {
    /// Rays of some slopes, with the cameras of the cell that is `shift` from each one's own.
    /// `stride`: texels of a camera.
    #[inline(always)]
    pub(super) fn new(
        simd: S,
        plan: &LumigraphPlan,
        stride: usize,
        slopes: [f32x16<S>; 2],
        shift: [i32; 2],
    ) -> Self {
        let eye = plan.view.eye.as_vec3();
        let across = sides(simd, &plan.columns, slopes[0] * -eye.z + eye.x, shift[0]);
        let up = sides(simd, &plan.rows, slopes[1] * -eye.z + eye.y, shift[1]);
        let weight = [
            across.weight[0] * up.weight[0],
            across.weight[1] * up.weight[0],
            across.weight[0] * up.weight[1],
            across.weight[1] * up.weight[1],
        ];
        let (count, stride) = (plan.columns.len() as u32, stride as u32);
        let row = [up.number[0] * count, up.number[1] * count];
        let base = [
            (row[0] + across.number[0]) * stride,
            (row[0] + across.number[1]) * stride,
            (row[1] + across.number[0]) * stride,
            (row[1] + across.number[1]) * stride,
        ];
        let bundle = match (across.shared, up.shared) {
            (Some(columns), Some(rows)) => Some(bundle(plan, slopes, columns, rows)),
            _ => None,
        };
        Self {
            slopes,
            across,
            up,
            weight,
            base,
            bundle,
        }
    }

    /// Positions of a layer's texels in the images of the four cameras.
    #[inline(always)]
    pub(super) fn places(&self, layer: &LayerInView) -> TexelPositions<S> {
        let u = self.slopes[0] * layer.scale + layer.add[0];
        let v = self.slopes[1] * -layer.scale + layer.add[1];
        TexelPositions {
            u: [
                u - self.across.place[0] * layer.shift,
                u - self.across.place[1] * layer.shift,
            ],
            v: [
                v + self.up.place[0] * layer.shift,
                v + self.up.place[1] * layer.shift,
            ],
        }
    }
}

/// Slopes are projective in the pixel: those of a tile lie between those of its corners.
#[inline(always)]
fn bundle<S: Simd>(
    plan: &LumigraphPlan,
    slopes: [f32x16<S>; 2],
    columns: [usize; 2],
    rows: [usize; 2],
) -> Bundle {
    let mut least_and_most = [[f32::INFINITY, f32::NEG_INFINITY]; 2];
    for axis in 0..2 {
        let slopes = slopes[axis].to_array();
        for corner in CORNERS {
            let [least, most] = least_and_most[axis];
            least_and_most[axis] = [least.min(slopes[corner]), most.max(slopes[corner])];
        }
    }
    plan.bundle(least_and_most, columns, rows)
}

/// Texel positions in four cameras: of low and high columns, and of low and high rows.
pub(super) struct TexelPositions<S: Simd> {
    pub(super) u: [f32x16<S>; 2],
    pub(super) v: [f32x16<S>; 2],
}

impl<S: Simd> TexelPositions<S> {
    /// Position in the `k`-th camera, in the order of [`Rays::weight`].
    #[inline(always)]
    pub(super) fn of(&self, k: usize) -> [f32x16<S>; 2] {
        [self.u[k % 2], self.v[k / 2]]
    }
}

/// Mask of positions that lie in an image.
#[inline(always)]
pub(super) fn inside<S: Simd>(level: Level, [u, v]: [f32x16<S>; 2]) -> mask32x16<S> {
    u.simd_ge(0.0) & v.simd_ge(0.0) & u.simd_lt(level.width as f32) & v.simd_lt(level.height as f32)
}
