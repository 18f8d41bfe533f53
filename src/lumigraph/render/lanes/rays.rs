//! Rays of sixteen pixels: slopes, the four cameras around each, and texel positions in their
//! images (L9, C21).

use super::taps::LANES;
use crate::render::cells::Bundle;
use crate::render::layer_in_view::LayerInView;
use crate::render::plan::{LumigraphPlan, cell};
use crate::render::pyramid::Level;
use fearless_simd::{Simd, f32x16, mask32x16, prelude::*, u32x16};

/// Edge of the square tile of pixels that is drawn at once: few layers are visible in one.
pub(crate) const TILE: usize = 4;

/// Lanes of a tile's corners.
const CORNERS: [usize; 4] = [0, TILE - 1, LANES - TILE, LANES - 1];

/// Smallest weight of a cell's camera along each axis: outside the grid, and at the border to
/// another cell, a camera may be the only one that sees the surface.
pub(crate) const LEAST_WEIGHT: f32 = 1.0 / 1024.0;

/// Cameras to either side of sixteen rays along one axis of the grid.
struct Sides<S: Simd> {
    /// Positions of the cameras, metres.
    camera: [f32x16<S>; 2],
    /// Bilinear weights of the cameras.
    weight: [f32x16<S>; 2],
    /// Column (row) numbers of the cameras.
    number: [u32x16<S>; 2],
    /// The numbers, if they are the same for all rays.
    shared: Option<[usize; 2]>,
}

/// Finds the cameras of the cell at `shift` from each ray's own along an axis, with crossings at
/// `position`.
#[inline(always)]
fn find_sides<S: Simd>(simd: S, cameras: &[f32], position: f32x16<S>, shift: i32) -> Sides<S> {
    let positions = position.to_array();
    let most = cameras.len().saturating_sub(2);
    let shifted = |cell: usize| cell.saturating_add_signed(shift as isize).min(most);
    let above = |low: usize| (low + 1).min(cameras.len() - 1);
    let first = cell(cameras, positions[0]);
    let begins = if first == 0 {
        f32::NEG_INFINITY
    } else {
        cameras[first]
    };
    let ends = if first >= most {
        f32::INFINITY
    } else {
        cameras[first + 1]
    };
    let (camera, number, shared);
    if (position.simd_ge(begins) & position.simd_lt(ends)).all_true() {
        let low = shifted(first);
        let high = above(low);
        camera = [
            f32x16::splat(simd, cameras[low]),
            f32x16::splat(simd, cameras[high]),
        ];
        number = [
            u32x16::splat(simd, low as u32),
            u32x16::splat(simd, high as u32),
        ];
        shared = Some([low, high]);
    } else {
        let (mut lane_cameras, mut lane_numbers) = ([[0.0; LANES]; 2], [[0; LANES]; 2]);
        for i in 0..LANES {
            let low = shifted(cell(cameras, positions[i]));
            let high = above(low);
            (lane_numbers[0][i], lane_numbers[1][i]) = (low as u32, high as u32);
            (lane_cameras[0][i], lane_cameras[1][i]) = (cameras[low], cameras[high]);
        }
        camera = [
            f32x16::load_array(simd, lane_cameras[0]),
            f32x16::load_array(simd, lane_cameras[1]),
        ];
        number = [
            u32x16::load_array(simd, lane_numbers[0]),
            u32x16::load_array(simd, lane_numbers[1]),
        ];
        shared = None;
    }
    // A single camera is on both sides.
    let gap = (camera[1] - camera[0]).max(f32::MIN_POSITIVE);
    let high_weight = ((position - camera[0]) / gap)
        .max(LEAST_WEIGHT)
        .min(1.0 - LEAST_WEIGHT);
    Sides {
        camera,
        weight: [f32x16::splat(simd, 1.0) - high_weight, high_weight],
        number,
        shared,
    }
}

/// Rays of sixteen pixels.
pub(crate) struct Rays<S: Simd> {
    slopes: [f32x16<S>; 2],
    across: Sides<S>,
    up: Sides<S>,
    /// Weights of the four cameras: low and high column of the low row, then of the high row.
    pub(crate) weight: [f32x16<S>; 4],
    /// Index of the first texel of each camera.
    pub(crate) base: [u32x16<S>; 4],
    /// Bundle of the rays; `None` if they lie in different cells.
    pub(crate) bundle: Option<Bundle>,
}

impl<S: Simd> Rays<S> {
    /// Creates rays from slopes, with the cameras of the cell at `shift` from each ray's own.
    /// `stride` is the number of texels of a camera.
    #[inline(always)]
    pub(crate) fn new(
        simd: S,
        plan: &LumigraphPlan,
        stride: usize,
        slopes: [f32x16<S>; 2],
        shift: [i32; 2],
    ) -> Self {
        let eye = plan.view.eye.as_vec3();
        let across = find_sides(simd, &plan.columns, slopes[0] * -eye.z + eye.x, shift[0]);
        let up = find_sides(simd, &plan.rows, slopes[1] * -eye.z + eye.y, shift[1]);
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

    /// Returns the texel positions of a layer in the images of the four cameras.
    #[inline(always)]
    pub(crate) fn texel_positions(&self, layer: &LayerInView) -> TexelPositions<S> {
        let u = self.slopes[0] * layer.scale + layer.add[0];
        let v = self.slopes[1] * -layer.scale + layer.add[1];
        TexelPositions {
            u: [
                u - self.across.camera[0] * layer.shift,
                u - self.across.camera[1] * layer.shift,
            ],
            v: [
                v + self.up.camera[0] * layer.shift,
                v + self.up.camera[1] * layer.shift,
            ],
        }
    }
}

/// Creates the bundle of a tile. Slopes are projective in the pixel, so that those of the corners
/// bound the others.
#[inline(always)]
fn bundle<S: Simd>(
    plan: &LumigraphPlan,
    slopes: [f32x16<S>; 2],
    columns: [usize; 2],
    rows: [usize; 2],
) -> Bundle {
    let mut bounds = [[f32::INFINITY, f32::NEG_INFINITY]; 2];
    for axis in 0..2 {
        let slopes = slopes[axis].to_array();
        for corner in CORNERS {
            let [low, high] = bounds[axis];
            bounds[axis] = [low.min(slopes[corner]), high.max(slopes[corner])];
        }
    }
    plan.bundle(bounds, columns, rows)
}

/// Texel positions in four cameras: u for the low and the high column, v for the low and the high
/// row.
pub(crate) struct TexelPositions<S: Simd> {
    pub(crate) u: [f32x16<S>; 2],
    pub(crate) v: [f32x16<S>; 2],
}

impl<S: Simd> TexelPositions<S> {
    /// Returns the position in the `k`-th camera, in the order of [`Rays::weight`].
    #[inline(always)]
    pub(crate) fn in_camera(&self, k: usize) -> [f32x16<S>; 2] {
        [self.u[k % 2], self.v[k / 2]]
    }
}

/// Returns a mask of the positions inside an image.
#[inline(always)]
pub(crate) fn inside<S: Simd>(level: Level, [u, v]: [f32x16<S>; 2]) -> mask32x16<S> {
    u.simd_ge(0.0) & v.simd_ge(0.0) & u.simd_lt(level.width as f32) & v.simd_lt(level.height as f32)
}
