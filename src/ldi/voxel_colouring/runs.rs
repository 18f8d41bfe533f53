//! Runs: consecutive shells of a ray on which photographs agree. Where little tells shells apart they agree long before the
//! surface; so of each run only the shell is kept on which they agree best.

use super::Pass;
use super::evidence::EvidenceRow;

/// A candidate that was kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Kept {
    /// Number of the pixel on its face.
    pub(super) pixel: u32,
    /// 1/m.
    pub(super) inverse_depth: f32,
    pub(super) color_srgb: [u8; 3],
}

/// The best of a run so far.
#[derive(Clone, Copy, Default)]
struct Run {
    /// Shells; 0 for none.
    length: u32,
    variance: f32,
    inverse_depth: f32,
    color_srgb: [u8; 3],
}

/// Runs of a row of pixels, from one column on.
#[derive(Clone, Default)]
pub(super) struct RunRow {
    start: usize,
    runs: Vec<Run>,
}

/// Colours are compared in a window of so many pixels to each side.
const WINDOW: usize = 1;

impl RunRow {
    /// Whether there may be a run.
    pub(super) fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// Takes in the evidence of a shell at an inverse depth, of rows from `first` on, and gives what is kept for good of row number `row`
    /// of a face of `side` pixels.
    pub(super) fn step(
        &mut self,
        evidence: &[EvidenceRow],
        first: usize,
        row: usize,
        side: usize,
        inverse_depth: f32,
        pass: &Pass,
    ) -> Vec<Kept> {
        let own = row.checked_sub(first).and_then(|i| evidence.get(i));
        if let Some(own) = own {
            self.reach(own.start, own.start + own.cells.len());
        }
        let around = |row: usize| row.saturating_sub(first).min(evidence.len());
        let window = &evidence[around(row.saturating_sub(WINDOW))..around(row + WINDOW + 1)];
        let mut kept = Vec::new();
        for (run, column) in self.runs.iter_mut().zip(self.start..) {
            let center = own.and_then(|own| own.at(column));
            let agreed = center.and_then(|center| Some((mean_variance(window, column, pass)?, center.color_srgb)));
            if let Some((variance, color_srgb)) = agreed {
                let length = run.length + 1;
                let is_best = run.length == 0 || variance < run.variance;
                *run =
                    if is_best { Run { length, variance, inverse_depth, color_srgb } } else { Run { length, ..*run } };
            }
            let ends = run.length > 0 && (agreed.is_none() || run.length == pass.longest_run);
            if ends {
                let pixel = (row * side + column) as u32;
                kept.push(Kept { pixel, inverse_depth: run.inverse_depth, color_srgb: run.color_srgb });
                run.length = 0;
            }
        }
        kept
    }

    /// Makes room for runs of these columns.
    fn reach(&mut self, start: usize, end: usize) {
        if start == end {
            return;
        }
        if self.runs.is_empty() {
            self.start = start;
        }
        let before = self.start.saturating_sub(start);
        self.runs.splice(0..0, std::iter::repeat_n(Run::default(), before));
        self.start -= before;
        let length = self.runs.len().max(end - self.start);
        self.runs.resize(length, Run::default());
    }
}

/// The mean variance of the candidates around a column, if photographs agree there.
fn mean_variance(window: &[EvidenceRow], column: usize, pass: &Pass) -> Option<f32> {
    let (mut sum, mut count) = (0.0, 0.0);
    for row in window {
        for evidence in (column.saturating_sub(WINDOW)..=column + WINDOW).filter_map(|column| row.at(column)) {
            sum += evidence.variance;
            count += 1.0;
        }
    }
    (count > 0.0 && sum <= pass.agreeing_variance() * count).then_some(sum / count)
}
