//! Photo-consistency of the candidates of a shell: variance of their colours, and the mean.

use super::Pass;
use super::photograph::{Photograph, Projection};
use super::reach::{common, seen_columns, seen_rows};
use fearless_simd::prelude::*;
use fearless_simd::{dispatch, f32x16, mask32x16, u32x16};
use glam::Vec3;
use headbox_core::simd;
use headbox_core::texels::LANES;
use std::ops::Range;

/// From a column to the sixteen that are asked about together.
const STEPS: [f32; LANES] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0,
];

/// Photographs that see part of a shell's face.
pub(super) struct Witnesses<'a> {
    /// From inside the shell, the nearest to the centre first: their colours count.
    inside: Vec<Witness<'a>>,
    /// From outside: what is between them and the shell is not known yet, but where they see the
    /// backdrop there is no surface.
    outside: Vec<Witness<'a>>,
    /// Pixels a side of the face.
    side: usize,
    /// Number of views that must see a surface.
    least: usize,
}

/// One of them.
struct Witness<'a> {
    photograph: &'a Photograph,
    /// x w, y w and w of the first pixel, and what a step to the right and down adds.
    affine: [Vec3; 3],
    rows: Range<usize>,
}

/// A photograph that sees part of a row of candidates.
struct RowWitness<'a> {
    photograph: &'a Photograph,
    /// Homogeneous position (x w, y w, w) of the row's first pixel, and the step per pixel.
    first: Vec3,
    across: Vec3,
    columns: Range<usize>,
}

/// Photo-consistency of a row of candidates, from one column on; empty if there is none.
#[derive(Default)]
pub(super) struct EvidenceRow {
    pub(super) start: usize,
    /// Variances of colours, summed over channels, levels squared, at most [`Pass::most_variance`];
    /// infinite where there is no surface or too few views see it.
    pub(super) variances: Vec<f32>,
    /// The colours, sRGB, as bytes of a word.
    colors_srgb: Vec<u32>,
}

impl EvidenceRow {
    /// Returns true if the row is empty.
    pub(super) fn is_empty(&self) -> bool {
        self.variances.is_empty()
    }

    /// The colour of a column, unless there is nothing.
    #[inline]
    pub(super) fn color_srgb(&self, column: usize) -> Option<[u8; 3]> {
        let i = column.checked_sub(self.start)?;
        let is_seen = self.variances.get(i)?.is_finite();
        let [r, g, b, _] = self.colors_srgb.get(i)?.to_le_bytes();
        is_seen.then_some([r, g, b])
    }
}

impl<'a> Witnesses<'a> {
    /// Those of a face at an eye depth, by the photographs' projections from it.
    pub(super) fn new(
        photographs: &'a [Photograph],
        projections: &[Projection],
        depth: f64,
        side: usize,
        least: usize,
    ) -> Self {
        let see = |(photograph, projection): (&'a Photograph, &Projection)| {
            let affine = projection.at(depth as f32);
            let rows = seen_rows(&affine, photograph.size(), side);
            (!rows.is_empty()).then_some(Witness {
                photograph,
                affine,
                rows,
            })
        };
        let all = photographs.iter().zip(projections).filter_map(see);
        let (inside, outside) =
            all.partition(|witness: &Witness| witness.photograph.is_inside(depth));
        Self {
            inside,
            outside,
            side,
            least,
        }
    }

    /// The rows that enough of them may see.
    pub(super) fn rows(&self) -> Range<usize> {
        common(self.inside.iter().map(|witness| &witness.rows), self.least)
    }

    /// Computes the photo-consistency of a row.
    pub(super) fn row(&self, row: usize, pass: &Pass) -> EvidenceRow {
        let of_row = |all: &[Witness<'a>]| -> Vec<RowWitness<'a>> {
            all.iter()
                .filter_map(|witness| witness.of_row(row, self.side))
                .collect()
        };
        let [inside, outside] = [&self.inside, &self.outside].map(|all| of_row(all));
        let columns = common(inside.iter().map(|witness| &witness.columns), self.least);
        let count = columns.len();
        let mut found = EvidenceRow {
            start: columns.start,
            variances: Vec::with_capacity(count),
            colors_srgb: Vec::with_capacity(count),
        };
        dispatch!(simd::level(), simd => {
            for first in columns.clone().step_by(LANES) {
                let (variances, colors_srgb) = agree(simd, &inside, &outside, first, pass);
                let count = LANES.min(columns.end - first);
                found.variances.extend_from_slice(&variances[..count]);
                found.colors_srgb.extend_from_slice(&colors_srgb[..count]);
            }
        });
        // Most rows have nothing to tell, and are then passed over.
        if found.variances.iter().any(|variance| variance.is_finite()) {
            found
        } else {
            EvidenceRow::default()
        }
    }
}

impl<'a> Witness<'a> {
    fn of_row(&self, row: usize, side: usize) -> Option<RowWitness<'a>> {
        let [corner, across, down] = self.affine;
        let first = corner + down * row as f32;
        let columns = seen_columns(first, across, self.photograph.size(), side);
        (!columns.is_empty()).then_some(RowWitness {
            photograph: self.photograph,
            first,
            across,
            columns,
        })
    }
}

impl RowWitness<'_> {
    /// Mask of columns that it sees.
    #[inline(always)]
    fn sees<S: Simd>(&self, columns: f32x16<S>) -> mask32x16<S> {
        columns.simd_ge(self.columns.start as f32) & columns.simd_lt(self.columns.end as f32)
    }

    /// Image positions of columns, pixels. Arbitrary for columns that it does not see.
    #[inline(always)]
    fn positions<S: Simd>(&self, columns: f32x16<S>) -> [f32x16<S>; 2] {
        let w = columns * self.across.z + self.first.z;
        [
            (columns * self.across.x + self.first.x) / w,
            (columns * self.across.y + self.first.y) / w,
        ]
    }
}

/// For each lane set in `left`: true if no photograph sees background at that candidate.
#[inline(always)]
fn hidden_backdrop<S: Simd>(
    witnesses: &[RowWitness],
    columns: f32x16<S>,
    mut left: mask32x16<S>,
) -> mask32x16<S> {
    for witness in witnesses
        .iter()
        .filter(|witness| witness.photograph.has_backdrop())
    {
        let seen = witness.sees(columns) & left;
        if seen.to_bitmask() == 0 {
            continue;
        }
        let shows = witness.photograph.show_backdrop(witness.positions(columns));
        left &= !(seen & shows);
        if left.to_bitmask() == 0 {
            break;
        }
    }
    left
}

/// Variances and mean colours of sixteen candidates from a column on, over all views that see them.
#[inline(always)]
fn agree<S: Simd>(
    simd: S,
    inside: &[RowWitness],
    outside: &[RowWitness],
    column: usize,
    pass: &Pass,
) -> ([f32; LANES], [u32; LANES]) {
    let zero = f32x16::splat(simd, 0.0);
    let columns = f32x16::from_slice(simd, &STEPS) + column as f32;
    // That is cheap to ask, and rules most candidates out.
    let mut left = hidden_backdrop(inside, columns, columns.simd_ge(0.0));
    left = hidden_backdrop(outside, columns, left);
    let (most, least) = (pass.most_variance(), pass.least_views as f32);
    let limit = most * inside.len() as f32;
    let (mut count, mut mean, mut squares) = (zero, [zero; 3], zero);
    let mut variance = f32x16::splat(simd, f32::INFINITY);
    for witness in inside {
        if left.to_bitmask() == 0 {
            break;
        }
        let seen = witness.sees(columns) & left;
        if seen.to_bitmask() == 0 {
            continue;
        }
        let (color, says) = witness.photograph.colors(simd, witness.positions(columns));
        let says = says & seen;
        count = says.select(count + 1.0, count);
        let share = says.select(1.0 / count, zero);
        for channel in 0..3 {
            let level = f32x16::float_from((color >> (8 * channel as u32)) & 0xff);
            let apart = level - mean[channel];
            mean[channel] += apart * share;
            // Welford's sum never falls.
            squares += says.select(apart * (level - mean[channel]), zero);
        }
        let disagree = squares.simd_gt(limit) & count.simd_ge(least) & left;
        variance = disagree.select(f32x16::splat(simd, most), variance);
        left &= !disagree;
    }
    let enough = count.simd_ge(least) & left;
    let variance = enough.select((squares / count).min(most), variance);
    let mut color = u32x16::splat(simd, 0);
    for channel in 0..3 {
        color |= u32x16::truncate_from(mean[channel] + 0.5) << (8 * channel as u32);
    }
    (variance.to_array(), color.to_array())
}
