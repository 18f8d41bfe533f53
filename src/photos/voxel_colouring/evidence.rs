//! Photo-consistency of the candidates of a shell: variance and mean of their colours.

use super::Pass;
use super::photograph::{Photograph, Projection};
use super::reach::{overlap, seen_columns, seen_rows};
use fearless_simd::prelude::*;
use fearless_simd::{dispatch, f32x16, mask32x16, u32x16};
use glam::Vec3;
use headbox_core::image::texels::{LANE_INDICES, LANES};
use headbox_core::simd;
use rayon::prelude::*;
use std::ops::Range;

/// Photographs that see part of a shell's face.
pub(super) struct ShellViews<'a> {
    /// Photographs taken from inside the shell, the nearest to the centre first: their colours are
    /// compared.
    inside: Vec<FaceView<'a>>,
    /// Photographs taken from outside: their occluders are not known yet, but there is no surface
    /// where they show background.
    outside: Vec<FaceView<'a>>,
    /// Size of the face, pixels.
    side: usize,
    /// Number of views that must see a surface.
    min_views: usize,
}

/// Photograph that sees part of a shell's face.
struct FaceView<'a> {
    photograph: &'a Photograph,
    /// Homogeneous position (x w, y w, w) of the first pixel, and its change per pixel right and
    /// down.
    affine: [Vec3; 3],
    rows: Range<usize>,
}

/// Photograph that sees part of a row of candidates.
struct RowView<'a> {
    photograph: &'a Photograph,
    /// Homogeneous position (x w, y w, w) of the row's first pixel, and the step per pixel.
    first: Vec3,
    across: Vec3,
    columns: Range<usize>,
}

/// Photo-consistency of a row of candidates from column `start` on; empty if no candidate is
/// consistent.
#[derive(Default)]
pub(super) struct EvidenceRow {
    pub(super) start: usize,
    /// Variances of colours, summed over channels, levels squared, at most [`Pass::max_variance`];
    /// infinite where background shows or too few photographs see the candidate.
    pub(super) variances: Vec<f32>,
    /// Mean colours, sRGB, as bytes of a word.
    colors_srgb: Vec<u32>,
}

impl EvidenceRow {
    /// Returns true if the row is empty.
    pub(super) fn is_empty(&self) -> bool {
        self.variances.is_empty()
    }

    /// Returns the colour of a column's candidate, if it was seen.
    #[inline]
    pub(super) fn color_srgb(&self, column: usize) -> Option<[u8; 3]> {
        let i = column.checked_sub(self.start)?;
        let is_visible = self.variances.get(i)?.is_finite();
        let [r, g, b, _] = self.colors_srgb.get(i)?.to_le_bytes();
        is_visible.then_some([r, g, b])
    }
}

impl<'a> ShellViews<'a> {
    /// Collects the photographs that see a face's shell at an eye depth, given their projections of
    /// the face.
    pub(super) fn new(
        photographs: &'a [Photograph],
        projections: &[Projection],
        depth: f64,
        side: usize,
        min_views: usize,
    ) -> Self {
        let face_view = |(photograph, projection): (&'a Photograph, &Projection)| {
            let affine = projection.at(depth as f32);
            let rows = seen_rows(&affine, photograph.size(), side);
            (!rows.is_empty()).then_some(FaceView {
                photograph,
                affine,
                rows,
            })
        };
        let all = photographs.iter().zip(projections).filter_map(face_view);
        let (inside, outside) = all.partition(|view: &FaceView| view.photograph.is_inside(depth));
        Self {
            inside,
            outside,
            side,
            min_views,
        }
    }

    /// Returns the range of rows that enough photographs may see.
    pub(super) fn rows(&self) -> Range<usize> {
        overlap(self.inside.iter().map(|view| &view.rows), self.min_views)
    }

    /// Returns the number of pixels of all photographs that a row of candidates is compared with,
    /// at most.
    pub(super) fn pixels(&self, row: usize) -> usize {
        let views = self
            .inside
            .iter()
            .filter_map(|view| view.row_view(row, self.side));
        views.map(|view| view.columns.len()).sum()
    }

    /// Computes the photo-consistency of all candidates, by rows.
    pub(super) fn evidence(&self, pass: &Pass) -> Vec<EvidenceRow> {
        let rows = self.rows().into_par_iter();
        rows.map(|row| self.row(row, pass)).collect()
    }

    /// Computes the photo-consistency of a row of candidates.
    fn row(&self, row: usize, pass: &Pass) -> EvidenceRow {
        let row_views = |all: &[FaceView<'a>]| -> Vec<RowView<'a>> {
            all.iter()
                .filter_map(|view| view.row_view(row, self.side))
                .collect()
        };
        let [inside, outside] = [&self.inside, &self.outside].map(|all| row_views(all));
        let columns = overlap(inside.iter().map(|view| &view.columns), self.min_views);
        let count = columns.len();
        let mut found = EvidenceRow {
            start: columns.start,
            variances: Vec::with_capacity(count),
            colors_srgb: Vec::with_capacity(count),
        };
        dispatch!(simd::level(), simd => {
            for first in columns.clone().step_by(LANES) {
                let (variances, colors_srgb) = color_statistics(simd, &inside, &outside, first, pass);
                let count = LANES.min(columns.end - first);
                found.variances.extend_from_slice(&variances[..count]);
                found.colors_srgb.extend_from_slice(&colors_srgb[..count]);
            }
        });
        // Most rows have no consistent candidate; they are skipped later.
        if found.variances.iter().any(|variance| variance.is_finite()) {
            found
        } else {
            EvidenceRow::default()
        }
    }
}

impl<'a> FaceView<'a> {
    fn row_view(&self, row: usize, side: usize) -> Option<RowView<'a>> {
        let [corner, across, down] = self.affine;
        let first = corner + down * row as f32;
        let columns = seen_columns(first, across, self.photograph.size(), side);
        (!columns.is_empty()).then_some(RowView {
            photograph: self.photograph,
            first,
            across,
            columns,
        })
    }
}

impl RowView<'_> {
    /// Returns a mask of the columns that it sees.
    #[inline(always)]
    fn sees<S: Simd>(&self, columns: f32x16<S>) -> mask32x16<S> {
        columns.simd_ge(self.columns.start as f32) & columns.simd_lt(self.columns.end as f32)
    }

    /// Projects columns into the image, pixels; arbitrary for columns that it does not see.
    #[inline(always)]
    fn positions<S: Simd>(&self, columns: f32x16<S>) -> [f32x16<S>; 2] {
        let w = columns * self.across.z + self.first.z;
        [
            (columns * self.across.x + self.first.x) / w,
            (columns * self.across.y + self.first.y) / w,
        ]
    }
}

/// Clears the lanes of `left` at which a photograph shows background.
#[inline(always)]
fn exclude_backdrop<S: Simd>(
    views: &[RowView],
    columns: f32x16<S>,
    mut left: mask32x16<S>,
) -> mask32x16<S> {
    for view in views.iter().filter(|view| view.photograph.has_backdrop) {
        let seen = view.sees(columns) & left;
        if seen.to_bitmask() == 0 {
            continue;
        }
        let shows = view.photograph.shows_backdrop(view.positions(columns));
        left &= !(seen & shows);
        if left.to_bitmask() == 0 {
            break;
        }
    }
    left
}

/// Computes the variances and mean colours of sixteen candidates from a column on, over all
/// photographs that see them.
#[inline(always)]
fn color_statistics<S: Simd>(
    simd: S,
    inside: &[RowView],
    outside: &[RowView],
    column: usize,
    pass: &Pass,
) -> ([f32; LANES], [u32; LANES]) {
    let zero = f32x16::splat(simd, 0.0);
    let columns = f32x16::from_slice(simd, &LANE_INDICES) + column as f32;
    // This test is cheap and excludes most candidates.
    let mut left = exclude_backdrop(inside, columns, columns.simd_ge(0.0));
    left = exclude_backdrop(outside, columns, left);
    let (max_variance, min_views) = (pass.max_variance(), pass.min_views as f32);
    let limit = max_variance * inside.len() as f32;
    let (mut count, mut mean, mut squares) = (zero, [zero; 3], zero);
    let mut variance = f32x16::splat(simd, f32::INFINITY);
    for view in inside {
        if left.to_bitmask() == 0 {
            break;
        }
        let seen = view.sees(columns) & left;
        if seen.to_bitmask() == 0 {
            continue;
        }
        let (color, counts) = view.photograph.colors(simd, view.positions(columns));
        let counts = counts & seen;
        count = counts.select(count + 1.0, count);
        let share = counts.select(1.0 / count, zero);
        for channel in 0..3 {
            let level = f32x16::float_from((color >> (8 * channel as u32)) & 0xff);
            let difference = level - mean[channel];
            mean[channel] += difference * share;
            // Welford's sum never decreases.
            squares += counts.select(difference * (level - mean[channel]), zero);
        }
        let disagree = squares.simd_gt(limit) & count.simd_ge(min_views) & left;
        variance = disagree.select(f32x16::splat(simd, max_variance), variance);
        left &= !disagree;
    }
    let enough = count.simd_ge(min_views) & left;
    let variance = enough.select((squares / count).min(max_variance), variance);
    let mut color = u32x16::splat(simd, 0);
    for channel in 0..3 {
        color |= u32x16::truncate_from(mean[channel] + 0.5) << (8 * channel as u32);
    }
    (variance.to_array(), color.to_array())
}
