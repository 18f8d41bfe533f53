//! Runs: consecutive shells of a ray on which photographs agree. Where colours hardly vary,
//! photographs agree long before the surface. So only the shell with the best agreement of each run
//! is kept.

use super::Pass;
use super::evidence::EvidenceRow;

/// Candidate that was kept as a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct KeptCandidate {
    /// Number of the pixel on its face.
    pub(super) pixel: u32,
    /// Inverse depth, 1/m.
    pub(super) inverse_depth: f32,
    pub(super) color_srgb: [u8; 3],
}

/// Run of a pixel, and its best shell so far.
#[derive(Clone, Copy, Default)]
struct Run {
    /// Number of shells; 0 for no run.
    length: u32,
    variance: f32,
    inverse_depth: f32,
    color_srgb: [u8; 3],
}

/// Runs of a row of pixels, from column `start` on.
#[derive(Clone, Default)]
pub(super) struct RunRow {
    start: usize,
    runs: Vec<Run>,
    /// True if a run may still be open.
    may_be_open: bool,
}

/// Radius of the window in which variances are averaged, pixels.
const WINDOW: usize = 1;

impl RunRow {
    /// Continues the runs of row number `row` of a face of `side` pixels by the evidence of a shell
    /// at an inverse depth; `evidence` begins at row `first`. Returns the candidates of the runs
    /// that end.
    pub(super) fn step(
        &mut self,
        evidence: &[EvidenceRow],
        first: usize,
        row: usize,
        side: usize,
        inverse_depth: f32,
        pass: &Pass,
    ) -> Vec<KeptCandidate> {
        let own = row
            .checked_sub(first)
            .and_then(|i| evidence.get(i))
            .filter(|own| !own.is_empty());
        if own.is_none() && !self.may_be_open {
            return Vec::new();
        }
        if let Some(own) = own {
            self.extend_to(own.start, own.start + own.variances.len());
        }
        let around = |row: usize| row.saturating_sub(first).min(evidence.len());
        let window = &evidence[around(row.saturating_sub(WINDOW))..around(row + WINDOW + 1)];
        let sums = WindowSums::new(window, self.start, self.runs.len());
        let mut kept = Vec::new();
        self.may_be_open = false;
        for ((i, run), column) in self.runs.iter_mut().enumerate().zip(self.start..) {
            let color = own.and_then(|own| own.color_srgb(column));
            let agreed = color.and_then(|color| Some((sums.mean(i, pass)?, color)));
            if let Some((variance, color_srgb)) = agreed {
                let length = run.length + 1;
                let is_best = run.length == 0 || variance < run.variance;
                *run = if is_best {
                    Run {
                        length,
                        variance,
                        inverse_depth,
                        color_srgb,
                    }
                } else {
                    Run { length, ..*run }
                };
            }
            let ends = run.length > 0 && (agreed.is_none() || run.length == pass.longest_run);
            if ends {
                let pixel = (row * side + column) as u32;
                kept.push(KeptCandidate {
                    pixel,
                    inverse_depth: run.inverse_depth,
                    color_srgb: run.color_srgb,
                });
                run.length = 0;
            }
            self.may_be_open |= run.length > 0;
        }
        kept
    }

    /// Extends the row to contain these columns.
    fn extend_to(&mut self, start: usize, end: usize) {
        if start == end {
            return;
        }
        if self.runs.is_empty() {
            self.start = start;
        }
        let before = self.start.saturating_sub(start);
        self.runs
            .splice(0..0, std::iter::repeat_n(Run::default(), before));
        self.start -= before;
        let length = self.runs.len().max(end - self.start);
        self.runs.resize(length, Run::default());
    }
}

/// Column sums of variances and their counts over some rows.
struct WindowSums {
    /// Sums from the column before the first on.
    variances: Vec<f32>,
    counts: Vec<f32>,
}

impl WindowSums {
    /// Sums the evidence of `columns` columns from `start` on.
    fn new(rows: &[EvidenceRow], start: usize, columns: usize) -> Self {
        let length = columns + 2 * WINDOW;
        let mut sums = Self {
            variances: vec![0.0; length],
            counts: vec![0.0; length],
        };
        for row in rows {
            let skipped = start
                .saturating_sub(row.start + WINDOW)
                .min(row.variances.len());
            let from = (row.start + skipped + WINDOW)
                .saturating_sub(start)
                .min(length);
            let to = sums.variances[from..]
                .iter_mut()
                .zip(&mut sums.counts[from..]);
            for ((sum, count), &variance) in to.zip(&row.variances[skipped..]) {
                let is_visible = variance < f32::INFINITY;
                *sum += if is_visible { variance } else { 0.0 };
                *count += if is_visible { 1.0 } else { 0.0 };
            }
        }
        sums
    }

    /// Returns the mean variance in the window around a column, counted from the first, if
    /// photographs agree there.
    fn mean(&self, column: usize, pass: &Pass) -> Option<f32> {
        let around = column..column + 2 * WINDOW + 1;
        let [sum, count]: [f32; 2] =
            [&self.variances[around.clone()], &self.counts[around]].map(|all| all.iter().sum());
        (count > 0.0 && sum <= pass.agreeing_variance() * count).then_some(sum / count)
    }
}
