//! Places on surfaces whose windows are chosen side by side, from narrow to wide.

use super::around::{Reader, Windows};
use super::narrow::Narrow;
use super::surface::Surface;
use super::window::{Beside, Chosen, LANES, SHARE, Window};
use super::{Pooled, SMALL_LEVEL};
use fearless_simd::{Simd, dispatch, f32x8, mask32x8, prelude::*};
use headbox_core::simd;
use rayon::prelude::*;

/// Share of the window of [`SMALL_LEVEL`] that a surface fills at least if its narrowest window is that of rows and columns. Of smaller
/// ones (leaves) these find too little.
const LARGE_SHARE: f32 = 0.6;

/// Places that a thread takes at once.
const AT_ONCE: usize = 128 * LANES;

/// Where light is wanted.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub(super) surface: &'a Surface,
    /// Pixels.
    pub(super) position: [f32; 2],
    /// Width of a pixel there, metres.
    pub(super) width_m: f32,
    /// Variance of the luminance of single samples on such surfaces.
    pub(super) expected: f32,
}

/// The light of so many places over their windows; if narrowest windows are known, the places are the parts of these.
pub(super) fn pooled<'a>(
    count: usize,
    place: impl Fn(usize) -> Place<'a> + Sync,
    windows: &Windows,
    narrow: Option<&Narrow>,
) -> Vec<Pooled> {
    let mut pooled = vec![Pooled::default(); count];
    let level = simd::level();
    let chunks = pooled.par_chunks_mut(AT_ONCE).enumerate();
    chunks.for_each_init(
        || windows.readers(),
        |readers, (number, pooled)| {
            let first = number * AT_ONCE;
            dispatch!(level, simd => chunk(simd, pooled, first, &place, readers, narrow));
        },
    );
    pooled
}

/// Of the places from number `first` on.
#[inline(always)]
fn chunk<'a, S: Simd>(
    simd: S,
    pooled: &mut [Pooled],
    first: usize,
    place: &impl Fn(usize) -> Place<'a>,
    readers: &mut [Reader],
    narrow: Option<&Narrow>,
) {
    let last = first + pooled.len() - 1;
    for (i, pooled) in pooled.chunks_mut(LANES).enumerate() {
        let numbers: [usize; LANES] =
            std::array::from_fn(|lane| (first + i * LANES + lane).min(last));
        let places = numbers.map(place);
        let found = batch(simd, &places, numbers, readers, narrow);
        pooled.copy_from_slice(&found[..pooled.len()]);
    }
}

/// Of eight places, which have these numbers.
#[inline(always)]
fn batch<S: Simd>(
    simd: S,
    places: &[Place; LANES],
    numbers: [usize; LANES],
    readers: &mut [Reader],
    narrow: Option<&Narrow>,
) -> [Pooled; LANES] {
    let (mut widths, mut expected) = ([0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        (widths[lane], expected[lane]) = (places[lane].width_m, places[lane].expected);
    }
    let (widths, expected) = (
        f32x8::load_array(simd, widths),
        f32x8::load_array(simd, expected),
    );
    let mut small = [Beside::default(); SMALL_LEVEL + 1];
    for (small, reader) in small.iter_mut().zip(readers.iter_mut()) {
        read(reader, places, small);
    }
    let mut chosen = match narrow {
        Some(narrow) => {
            let is_large = small[SMALL_LEVEL].of(simd, SHARE).simd_ge(LARGE_SHARE);
            narrowest(
                narrow,
                numbers,
                [widths, expected],
                readers.get_mut(SMALL_LEVEL),
                is_large,
            )
        }
        None => Chosen::none(simd),
    };
    for (number, reader) in readers.iter_mut().enumerate() {
        let mut sums = Beside::default();
        match small.get(number) {
            Some(known) => sums = *known,
            None if chosen.is_open() => read(reader, places, &mut sums),
            None => break,
        }
        let window = Window::new(
            simd,
            &sums,
            f32x8::splat(simd, reader.level.parts()),
            expected,
        );
        chosen.take(&window, widths * reader.level.radius_px());
    }
    chosen.pooled()
}

#[inline(always)]
fn read(reader: &mut Reader, places: &[Place; LANES], sums: &mut Beside) {
    for (lane, place) in places.iter().enumerate() {
        sums.set(lane, &reader.at(place.surface, place.position));
    }
}

/// The narrowest windows of parts of large surfaces, and where light comes from too near for a wider one, what lies along their lines.
#[inline(always)]
fn narrowest<S: Simd>(
    narrow: &Narrow,
    parts: [usize; LANES],
    [widths, expected]: [f32x8<S>; 2],
    reader: Option<&mut Reader>,
    is_large: mask32x8<S>,
) -> Chosen<S> {
    let simd = widths.token();
    let mut sums = Beside::default();
    for lane in 0..LANES {
        sums.set(lane, &narrow.sums[parts[lane]]);
    }
    let own = Window::new(
        simd,
        &sums,
        f32x8::splat(simd, super::narrow::parts()),
        expected,
    );
    let mut chosen = Chosen::first(own, is_large);
    let Some(reader) = reader else { return chosen };
    let mut near = chosen
        .is_near(widths * reader.level.radius_px())
        .to_bitmask();
    let (mut counts, mut found) = ([1.0; LANES], 0);
    while near != 0 {
        let lane = near.trailing_zeros() as usize;
        near &= near - 1;
        if let Some((of_line, count)) = narrow.pooling.along(parts[lane], &narrow.sums, reader) {
            sums.set(lane, &of_line);
            (counts[lane], found) = (count, found | 1 << lane);
        }
    }
    if found != 0 {
        let line = Window::new(simd, &sums, f32x8::load_array(simd, counts), expected);
        chosen.widen(
            &line,
            f32x8::splat(simd, 0.0),
            mask32x8::from_bitmask(simd, found),
        );
    }
    chosen
}
