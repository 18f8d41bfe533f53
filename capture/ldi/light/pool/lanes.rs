//! Pools the light of many points, in lanes, from narrow windows to wide.

use super::block_windows::{BlockWindows, WindowReader};
use super::narrow_windows::{self, NarrowWindows};
use super::surface_key::SurfaceKey;
use super::window::{LANES, SHARE, SumLanes, Window, WindowChoice};
use super::{PooledLight, SMALL_LEVEL};
use fearless_simd::{Simd, dispatch, f32x8, mask32x8, prelude::*};
use headbox_core::simd;
use rayon::prelude::*;

/// Minimum share of the window of [`SMALL_LEVEL`] that a surface must fill for its narrowest window
/// to be one of rows and columns. On smaller surfaces (leaves) such windows contain too little.
const LARGE_SHARE: f32 = 0.6;

/// Number of points in a unit of work of a thread.
const AT_ONCE: usize = 128 * LANES;

/// A point of a surface where light is pooled.
#[derive(Clone, Copy)]
pub(super) struct PoolingPoint<'a> {
    pub(super) key: &'a SurfaceKey,
    /// Pixels.
    pub(super) position: [f32; 2],
    /// Width of a pixel there, metres.
    pub(super) width_m: f32,
    /// Expected variance of the luminance of single light samples on such surfaces.
    pub(super) expected: f32,
}

/// Pools the light of `count` points over their windows. If narrowest windows are given, the points
/// must be their surface samples.
pub(super) fn pool_points<'a>(
    count: usize,
    point: impl Fn(usize) -> PoolingPoint<'a> + Sync,
    windows: &BlockWindows,
    narrow: Option<&NarrowWindows>,
) -> Vec<PooledLight> {
    let mut pooled = vec![PooledLight::default(); count];
    let level = simd::level();
    let chunks = pooled.par_chunks_mut(AT_ONCE).enumerate();
    chunks.for_each_init(
        || windows.readers(),
        |readers, (number, pooled)| {
            let first = number * AT_ONCE;
            dispatch!(level, simd => pool_chunk(simd, pooled, first, &point, readers, narrow));
        },
    );
    pooled
}

/// Pools the points from index `first` on.
#[inline(always)]
fn pool_chunk<'a, S: Simd>(
    simd: S,
    pooled: &mut [PooledLight],
    first: usize,
    point: &impl Fn(usize) -> PoolingPoint<'a>,
    readers: &mut [WindowReader],
    narrow: Option<&NarrowWindows>,
) {
    let last = first + pooled.len() - 1;
    for (i, pooled) in pooled.chunks_mut(LANES).enumerate() {
        let indices: [usize; LANES] =
            std::array::from_fn(|lane| (first + i * LANES + lane).min(last));
        let points = indices.map(point);
        let light = pool_lanes(simd, &points, indices, readers, narrow);
        pooled.copy_from_slice(&light[..pooled.len()]);
    }
}

/// Pools eight points with their indices.
#[inline(always)]
fn pool_lanes<S: Simd>(
    simd: S,
    points: &[PoolingPoint; LANES],
    indices: [usize; LANES],
    readers: &mut [WindowReader],
    narrow: Option<&NarrowWindows>,
) -> [PooledLight; LANES] {
    let mut widths = [0.0; LANES];
    let mut expected = [0.0; LANES];
    for lane in 0..LANES {
        widths[lane] = points[lane].width_m;
        expected[lane] = points[lane].expected;
    }
    let widths = f32x8::load_array(simd, widths);
    let expected = f32x8::load_array(simd, expected);
    let mut small = [SumLanes::default(); SMALL_LEVEL + 1];
    for (small, reader) in small.iter_mut().zip(readers.iter_mut()) {
        read(reader, points, small);
    }
    let mut choice = match narrow {
        Some(narrow) => {
            let is_large = small[SMALL_LEVEL].load(simd, SHARE).simd_ge(LARGE_SHARE);
            choose_narrowest(
                narrow,
                indices,
                [widths, expected],
                readers.get_mut(SMALL_LEVEL),
                is_large,
            )
        }
        None => WindowChoice::none(simd),
    };
    for (number, reader) in readers.iter_mut().enumerate() {
        let mut sums = SumLanes::default();
        match small.get(number) {
            Some(known) => sums = *known,
            None if choice.may_widen() => read(reader, points, &mut sums),
            None => break,
        }
        let window = Window::new(
            simd,
            &sums,
            f32x8::splat(simd, reader.level.support()),
            expected,
        );
        choice.take(&window, widths * reader.level.radius_px());
    }
    choice.pooled()
}

#[inline(always)]
fn read(reader: &mut WindowReader, points: &[PoolingPoint; LANES], sums: &mut SumLanes) {
    for (lane, point) in points.iter().enumerate() {
        sums.set(lane, &reader.read(point.key, point.position));
    }
}

/// Chooses the narrowest windows of surface samples on large surfaces, and windows along isolines
/// where light comes from so near that a wider window would be biased.
#[inline(always)]
fn choose_narrowest<S: Simd>(
    narrow: &NarrowWindows,
    indices: [usize; LANES],
    [widths, expected]: [f32x8<S>; 2],
    reader: Option<&mut WindowReader>,
    is_large: mask32x8<S>,
) -> WindowChoice<S> {
    let simd = widths.token();
    let mut sums = SumLanes::default();
    for lane in 0..LANES {
        sums.set(lane, &narrow.sums[indices[lane]]);
    }
    let own = Window::new(
        simd,
        &sums,
        f32x8::splat(simd, narrow_windows::support()),
        expected,
    );
    let mut choice = WindowChoice::first(own, is_large);
    let Some(reader) = reader else { return choice };
    let mut near = choice
        .is_near(widths * reader.level.radius_px())
        .to_bitmask();
    let mut supports = [1.0; LANES];
    let mut has_line = 0;
    while near != 0 {
        let lane = near.trailing_zeros() as usize;
        near &= near - 1;
        let line = narrow
            .pooling
            .along_isoline(indices[lane], &narrow.sums, reader);
        if let Some((line_sums, support)) = line {
            sums.set(lane, &line_sums);
            supports[lane] = support;
            has_line |= 1 << lane;
        }
    }
    if has_line != 0 {
        let line = Window::new(simd, &sums, f32x8::load_array(simd, supports), expected);
        choice.widen(
            &line,
            f32x8::splat(simd, 0.0),
            mask32x8::from_bitmask(simd, has_line),
        );
    }
    choice
}
