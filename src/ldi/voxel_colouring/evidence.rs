//! What photographs say of the candidates of a shell: how far they disagree on a colour, and which it is.

use super::Pass;
use super::photograph::{Photograph, Projection};
use super::reach::{common, seen_columns, seen_rows};
use glam::Vec3;
use std::ops::Range;

/// Photographs that see part of a shell's face.
pub(super) struct Witnesses<'a> {
    /// From inside the shell, the nearest to the centre first: their colours count.
    inside: Vec<Witness<'a>>,
    /// From outside: what is between them and the shell is not known yet, but where they see the backdrop there is no surface.
    outside: Vec<Witness<'a>>,
    /// Pixels a side of the face.
    side: usize,
    /// How many must see a surface.
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
    /// Of the row's first pixel, and what a pixel adds: x w, y w, w.
    first: Vec3,
    across: Vec3,
    columns: Range<usize>,
}

/// What is said of a candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Evidence {
    /// Of the colours, summed over channels, levels squared, no more than [`Pass::most_variance`]; infinite where there is no surface,
    /// or too few see it.
    pub(super) variance: f32,
    pub(super) color_srgb: [u8; 3],
}

/// What is said of a row of candidates, from one column on.
pub(super) struct EvidenceRow {
    pub(super) start: usize,
    pub(super) cells: Vec<Evidence>,
}

impl EvidenceRow {
    /// Whether there is none.
    pub(super) fn is_empty(&self) -> bool {
        !self.cells.iter().any(|evidence| evidence.variance.is_finite())
    }

    /// Of a column, unless there is nothing.
    #[inline]
    pub(super) fn at(&self, column: usize) -> Option<&Evidence> {
        self.cells.get(column.checked_sub(self.start)?).filter(|evidence| evidence.variance.is_finite())
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
            (!rows.is_empty()).then_some(Witness { photograph, affine, rows })
        };
        let all = photographs.iter().zip(projections).filter_map(see);
        let (inside, outside) = all.partition(|witness: &Witness| witness.photograph.is_inside(depth));
        Self { inside, outside, side, least }
    }

    /// The rows that enough of them may see.
    pub(super) fn rows(&self) -> Range<usize> {
        common(self.inside.iter().map(|witness| &witness.rows), self.least)
    }

    /// What they say of a row.
    pub(super) fn row(&self, row: usize, pass: &Pass) -> EvidenceRow {
        let of_row = |all: &[Witness<'a>]| -> Vec<RowWitness<'a>> {
            all.iter().filter_map(|witness| witness.of_row(row, self.side)).collect()
        };
        let [inside, outside] = [&self.inside, &self.outside].map(|all| of_row(all));
        let columns = common(inside.iter().map(|witness| &witness.columns), self.least);
        let cells = columns.clone().map(|column| agree(&inside, &outside, column, pass)).collect();
        EvidenceRow { start: columns.start, cells }
    }
}

impl<'a> Witness<'a> {
    fn of_row(&self, row: usize, side: usize) -> Option<RowWitness<'a>> {
        let [corner, across, down] = self.affine;
        let first = corner + down * row as f32;
        let columns = seen_columns(first, across, self.photograph.size(), side);
        (!columns.is_empty()).then_some(RowWitness { photograph: self.photograph, first, across, columns })
    }
}

impl RowWitness<'_> {
    /// Where it sees a candidate, pixels.
    #[inline]
    fn position(&self, column: usize) -> Option<[f32; 2]> {
        let h = self.first + self.across * column as f32;
        self.columns.contains(&column).then(|| [h.x / h.z, h.y / h.z])
    }
}

/// What all who see a candidate say of it.
fn agree(inside: &[RowWitness], outside: &[RowWitness], column: usize, pass: &Pass) -> Evidence {
    const NOTHING: Evidence = Evidence { variance: f32::INFINITY, color_srgb: [0; 3] };
    let shows_through =
        |witness: &RowWitness| witness.position(column).is_some_and(|[x, y]| witness.photograph.is_backdrop(x, y));
    // That is cheap to ask, and rules most candidates out.
    if inside.iter().chain(outside).any(shows_through) {
        return NOTHING;
    }
    let most = pass.most_variance();
    let limit = most * inside.len() as f32;
    let (mut count, mut mean, mut squares) = (0.0f32, Vec3::ZERO, 0.0f32);
    for witness in inside {
        let Some([x, y]) = witness.position(column) else { continue };
        let Some(color) = witness.photograph.at(x, y) else { continue };
        count += 1.0;
        let apart = color - mean;
        mean += apart / count;
        squares += apart.dot(color - mean); // Welford's sum never falls
        if squares > limit && count >= pass.least_views as f32 {
            return Evidence { variance: most, color_srgb: [0; 3] };
        }
    }
    if count < pass.least_views as f32 {
        return NOTHING;
    }
    let color_srgb = mean.to_array().map(|level| (level + 0.5) as u8);
    Evidence { variance: (squares / count).min(most), color_srgb }
}
