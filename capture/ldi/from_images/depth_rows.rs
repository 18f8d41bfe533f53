//! Surfaces at the pixels of a depth image, sixteen at a time: their position, tilt and validity.

use fearless_simd::prelude::*;
use fearless_simd::{f32x16, i32x16, u32x16};
use glam::{DVec3, Vec3};
use headbox_images::{Lens, LoadedView, MAX_DEPTH_M};
use std::ops::Range;

pub(super) const LANES: usize = 16;

/// X, Y and Z of sixteen vectors.
pub(super) type Vectors<S> = [f32x16<S>; 3];

/// The surfaces at sixteen pixels of a row, relative to the cube's centre, metres, world axes.
pub(super) struct SurfacePatches<S: Simd> {
    /// Bits of the pixels that show a surface; the other lanes are undefined.
    pub(super) known: u64,
    /// The points that the pixels show.
    pub(super) point: Vectors<S>,
    /// Change of the points over one pixel to the right.
    pub(super) across: Vectors<S>,
    /// Change of the points over one pixel down.
    pub(super) down: Vectors<S>,
    /// Unit normals, toward the eye.
    pub(super) normal: Vectors<S>,
    /// Areas of the pixels' patches up to the focal length of the image, Z^3 / |n . p| (C10).
    pub(super) area: f32x16<S>,
    /// Cosines between the normals and the directions to the eye, over the squared distances from
    /// it.
    pub(super) weight: f32x16<S>,
}

/// A few rows of a depth image, visited one by one.
pub(super) struct DepthRows<'a> {
    view: &'a LoadedView,
    /// The eye, relative to the cube's centre.
    eye: Vec3,
    /// The first of the rows.
    first: u32,
    /// Columns, rounded up to whole blocks.
    columns: usize,
    /// Rays through the pixels of a row and of the one below, and of one more on the right: X, Y
    /// and Z, world axes.
    rays: [[Vec<f32>; 3]; 2],
    /// Inverse depths, as multiples of the rays, of the pixels of these rows and a border of one;
    /// NaN if unknown or outside.
    inverse_depths: Vec<f32>,
    /// Maximum change of inverse depth from pixel to pixel on one surface: by noise of the sensor,
    /// 1/m, and by tilt, as a share of the inverse depth.
    tolerance: [f32; 2],
    has_noise: bool,
}

/// Steepest slope of a surface: relative change of inverse depth from a pixel to the next, per
/// radian of a pixel's width.
pub(super) const STEEPEST: f32 = 12.0;

/// Minimum number of neighbours (of eight) on a pixel's own surface. A pixel with fewer is a flying
/// pixel, a mixture of both sides of an edge.
pub(super) const LEAST_NEIGHBORS: u32 = 3;

/// Minimum cosine at which a sensor must see a surface; below it, its depth is that of an edge.
pub(super) const LEAST_COSINE: f32 = 0.03;

impl<'a> DepthRows<'a> {
    /// Some rows of an image. `noise` is the standard deviation of inverse depth, 1/m.
    #[inline(always)]
    pub(super) fn new(view: &'a LoadedView, rows: Range<u32>, centre: DVec3, noise: f32) -> Self {
        let [width, height] = view.size_px;
        let width = width as usize;
        let columns = width.next_multiple_of(LANES);
        let mut inverse_depths = vec![f32::NAN; (rows.len() + 2) * (columns + 2)];
        for (y, row) in
            (i64::from(rows.start) - 1..).zip(inverse_depths.chunks_exact_mut(columns + 2))
        {
            let start = y.max(0) as usize * width;
            let depths = view
                .depth
                .get(start..start + width)
                .filter(|_| (0..i64::from(height)).contains(&y));
            let Some(depths) = depths else { continue };
            for ((inverse_depth, &depth), color) in
                row[1..].iter_mut().zip(depths).zip(&view.color[start..])
            {
                // As in `LoadedView::depth_at`.
                let known = depth > 0.0 && color[3] > 0;
                *inverse_depth = if known {
                    1.0 / depth.min(MAX_DEPTH_M)
                } else {
                    f32::NAN
                };
            }
        }
        let pixel = 1.0 / view.lens.pixels_per_radian(view.size_px) as f32;
        let mut surfaces = Self {
            view,
            eye: (view.pose.eye - centre).as_vec3(),
            first: rows.start,
            columns,
            rays: [0, 1].map(|_| [0, 1, 2].map(|_| vec![0.0; columns + 1])),
            inverse_depths,
            tolerance: [3.0 * noise, STEEPEST * pixel],
            has_noise: noise > 0.0,
        };
        surfaces.next_row(rows.start);
        surfaces
    }

    /// Advances to row `y`, which follows the last.
    #[inline(always)]
    pub(super) fn next_row(&mut self, y: u32) {
        self.rays.swap(0, 1);
        if y == self.first {
            fill_with_rays(self.view, y, &mut self.rays[0]);
        }
        fill_with_rays(self.view, y + 1, &mut self.rays[1]);
    }

    /// The surfaces of sixteen pixels from (x, y) on, where `y` is the current row; `None` if all
    /// are unknown.
    #[inline(always)]
    pub(super) fn patches<S: Simd>(&self, simd: S, x: u32, y: u32) -> Option<SurfacePatches<S>> {
        let stride = self.columns + 2;
        let before = (y - self.first) as usize * stride + x as usize;
        let rows = [before, before + stride, before + 2 * stride];
        let own = f32x16::from_slice(simd, &self.inverse_depths[rows[1] + 1..][..LANES]);
        // False for NaN.
        let mut known = own.simd_gt(0.0);
        if known.to_bitmask() == 0 {
            return None;
        }
        let tolerance = own * self.tolerance[1] + self.tolerance[0];
        let changes = [
            NeighborChange::new(simd, &self.inverse_depths[rows[1]..], own, tolerance),
            NeighborChange::new(simd, &self.inverse_depths[rows[1] + 2..], own, tolerance),
            NeighborChange::new(simd, &self.inverse_depths[rows[0] + 1..], own, tolerance),
            NeighborChange::new(simd, &self.inverse_depths[rows[2] + 1..], own, tolerance),
        ];
        // Rendered depth has one surface in each pixel.
        if self.has_noise {
            let mut neighbors =
                ((changes[0].same + changes[1].same) + changes[2].same) + changes[3].same;
            for corner in [rows[0], rows[0] + 2, rows[2], rows[2] + 2] {
                neighbors +=
                    NeighborChange::new(simd, &self.inverse_depths[corner..], own, tolerance).same;
            }
            known &= neighbors.simd_ge(LEAST_NEIGHBORS);
        }
        let [left, right, above, below] = changes;
        let slopes = [slope(left, right), slope(above, below)];
        let [here, under] = [&self.rays[0], &self.rays[1]];
        let column = x as usize;
        let ray = load(simd, here, column);
        let depth = 1.0 / own;
        // From point = ray / q: d point = (d ray - ray dq / q) / q.
        let across = step(load(simd, here, column + 1), ray, slopes[0], depth);
        let down = step(load(simd, under, column), ray, slopes[1], depth);
        let normal = cross(down, across);
        let area = dot(normal, normal).sqrt();
        let reciprocal = 1.0 / area;
        known &= reciprocal.simd_gt(0.0) & reciprocal.simd_lt(f32::INFINITY);
        // Toward the eye.
        let along = dot(normal, ray);
        let reciprocal = along.simd_gt(0.0).select(-reciprocal, reciprocal);
        let normal = scaled(normal, reciprocal);
        let against = -(along * reciprocal);
        let squared = dot(ray, ray);
        let length = squared.sqrt();
        if self.has_noise {
            known &= against.simd_ge(length * LEAST_COSINE);
        }
        let eye = self.eye;
        Some(SurfacePatches {
            known: known.to_bitmask(),
            point: [
                ray[0] * depth + eye.x,
                ray[1] * depth + eye.y,
                ray[2] * depth + eye.z,
            ],
            across,
            down,
            normal,
            area,
            weight: against / (length * squared) * (own * own),
        })
    }
}

/// Fills in the rays through the pixels of a row and beyond, world axes. Those of a pinhole are
/// affine in the pixel.
#[inline(always)]
fn fill_with_rays(view: &LoadedView, y: u32, rays: &mut [Vec<f32>; 3]) {
    let ray = |x: usize| {
        view.pose.world_from_eye
            * view
                .lens
                .ray([x as f64 + 0.5, f64::from(y) + 0.5], view.size_px)
    };
    match view.lens {
        Lens::Pinhole(_) => {
            let start = ray(0);
            let step = ray(1) - start;
            for (axis, rays) in rays.iter_mut().enumerate() {
                for (x, to) in (0u32..).zip(rays) {
                    *to = (start[axis] + step[axis] * f64::from(x)) as f32;
                }
            }
        }
        Lens::Equirectangular => {
            for x in 0..rays[0].len() {
                let ray = ray(x).as_vec3();
                (0..3).for_each(|axis| rays[axis][x] = ray[axis]);
            }
        }
    }
}

/// Change from pixels to their neighbours on one side.
#[derive(Clone, Copy)]
struct NeighborChange<S: Simd> {
    /// Change of inverse depth; 0 where the neighbour is of another surface.
    change: f32x16<S>,
    /// 1 where the neighbour is of the same surface, otherwise 0.
    same: u32x16<S>,
}

impl<S: Simd> NeighborChange<S> {
    #[inline(always)]
    fn new(simd: S, neighbors: &[f32], own: f32x16<S>, tolerance: f32x16<S>) -> Self {
        let change = f32x16::from_slice(simd, &neighbors[..LANES]) - own;
        // False for NaN.
        let is_same = change.abs().simd_le(tolerance);
        let [change, one] = [change, f32x16::splat(simd, f32::from_bits(1))].map(bits);
        let zero = u32x16::splat(simd, 0);
        Self {
            change: is_same.select(change, zero).bitcast(),
            same: is_same.select(one, zero),
        }
    }
}

#[inline(always)]
fn bits<S: Simd>(values: f32x16<S>) -> u32x16<S> {
    values.bitcast()
}

/// Change of inverse depth from pixel to pixel, from the neighbours on both sides if they are of
/// the same surface.
#[inline(always)]
fn slope<S: Simd>(before: NeighborChange<S>, after: NeighborChange<S>) -> f32x16<S> {
    let sum = after.change - before.change;
    (before.same & after.same).simd_eq(1).select(sum * 0.5, sum)
}

#[inline(always)]
fn load<S: Simd>(simd: S, axes: &[Vec<f32>; 3], first: usize) -> Vectors<S> {
    [
        f32x16::from_slice(simd, &axes[0][first..first + LANES]),
        f32x16::from_slice(simd, &axes[1][first..first + LANES]),
        f32x16::from_slice(simd, &axes[2][first..first + LANES]),
    ]
}

#[inline(always)]
fn step<S: Simd>(
    next: Vectors<S>,
    ray: Vectors<S>,
    slope: f32x16<S>,
    depth: f32x16<S>,
) -> Vectors<S> {
    let share = slope * depth;
    [
        ((next[0] - ray[0]) - ray[0] * share) * depth,
        ((next[1] - ray[1]) - ray[1] * share) * depth,
        ((next[2] - ray[2]) - ray[2] * share) * depth,
    ]
}

#[inline(always)]
fn dot<S: Simd>(a: Vectors<S>, b: Vectors<S>) -> f32x16<S> {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

#[inline(always)]
fn cross<S: Simd>(a: Vectors<S>, b: Vectors<S>) -> Vectors<S> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
fn scaled<S: Simd>(a: Vectors<S>, by: f32x16<S>) -> Vectors<S> {
    [a[0] * by, a[1] * by, a[2] * by]
}

/// Encodes sixteen unit vectors as the bits of
/// [`EncodedNormal`](headbox_cube::model::samples::EncodedNormal).
#[inline(always)]
pub(super) fn encode_normals<S: Simd>([x, y, z]: Vectors<S>) -> u32x16<S> {
    let reciprocal = 1.0 / ((x.abs() + y.abs()) + z.abs());
    let (x, y) = (x * reciprocal, y * reciprocal);
    let one = f32x16::splat(z.token(), 1.0);
    let behind = z.simd_lt(0.0);
    let (u, v) = (
        behind.select((1.0 - y.abs()) * one.copysign(x), x),
        behind.select((1.0 - x.abs()) * one.copysign(y), y),
    );
    (to_snorm16(u) & 0xffff) | (to_snorm16(v) << 16)
}

/// Quantises -1..1 to 16 bits, to the nearest.
#[inline(always)]
fn to_snorm16<S: Simd>(value: f32x16<S>) -> u32x16<S> {
    i32x16::truncate_from(value * 32767.0 + f32x16::splat(value.token(), 0.5).copysign(value))
        .bitcast()
}
