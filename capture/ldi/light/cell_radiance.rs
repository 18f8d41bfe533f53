//! Radiance beyond the first rays of light samples, shared by all samples of a round that arrive in
//! one cell of space ([`Arrival`]).

use super::sample_light::FaceLight;
use crate::surfaces::rows;
use glam::Vec3;
use headbox_trace::light::{Arrival, LightSample};
use headbox_trace::sampler::random4;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// Maximum number of samples of the radiance beyond a cell of arrivals.
const MAX_CELL_SAMPLES: usize = 8;

/// A light sample after its first ray.
pub(super) struct PartialSample {
    /// Index of the surface sample.
    pub(super) surface: u32,
    /// See [`Arrival::cell`].
    pub(super) cell: u64,
    /// Light gathered before the arrival.
    pub(super) before: Vec3,
    pub(super) arrival: Arrival,
}

/// Unfinished results of a row of surface samples.
#[derive(Default)]
pub(super) struct SampledRow {
    pub(super) partial: Vec<PartialSample>,
    /// Sums of the gradients of light gathered before arrivals, exposed, with the index of each
    /// surface sample that is smoothly shaded.
    pub(super) gradients: Vec<(u32, Vec3)>,
}

impl FaceLight<'_> {
    /// The radiance beyond the arrivals of the samples of each row, in a round.
    pub(super) fn light_beyond(&self, round: u32, rows: &[SampledRow]) -> Vec<Vec<Vec3>> {
        let tracer = self.shader.capture.tracer;
        let lighting = self.shader.capture.lighting;
        let mut count = 0;
        let mut firsts: Vec<u32> = Vec::with_capacity(rows.len());
        for row in rows {
            firsts.push(count);
            count += row.partial.len() as u32;
        }
        let cell_keys = |(first, row): (&u32, &SampledRow)| -> Vec<(u64, u32, u32)> {
            // Representatives of a cell are drawn in a fixed order that is unrelated to position.
            (*first..)
                .zip(&row.partial)
                .map(|(i, partial)| (partial.cell, i.wrapping_mul(0x9e37_79b9), i))
                .collect()
        };
        let cell_keys: Vec<Vec<_>> = firsts.par_iter().zip(rows).map(cell_keys).collect();
        let mut order = rows::concat(&cell_keys, |row| row);
        order.par_sort_unstable();
        let cells: Vec<&[(u64, u32, u32)]> = order.chunk_by(|a, b| a.0 == b.0).collect();
        // The cell of each sample, written by the thread that has the cell.
        let sample_cells: Vec<AtomicU32> = order.par_iter().map(|_| AtomicU32::new(0)).collect();
        let cell_light = |(number, cell): (usize, &&[(u64, u32, u32)])| {
            for &(_, _, i) in cell.iter() {
                sample_cells[i as usize].store(number as u32, Ordering::Relaxed);
            }
            if self.progress.is_cancelled() {
                return Vec3::ZERO;
            }
            // Copied first, so that the cache misses of the arrivals overlap.
            let mut drawn = [None; MAX_CELL_SAMPLES];
            for (arrival, &(_, _, i)) in drawn.iter_mut().zip(*cell) {
                let row = firsts.partition_point(|&first| first <= i) - 1;
                *arrival = Some(rows[row].partial[(i - firsts[row]) as usize].arrival);
            }
            let [stream, ..] = random4([cell[0].0 as u32, (cell[0].0 >> 32) as u32, 0xce11, round]);
            let light = |(index, arrival): (u32, &Arrival)| {
                lighting.beyond(tracer, arrival, &LightSample { stream, index })
            };
            (0..).zip(drawn.iter().flatten()).map(light).sum::<Vec3>()
                / cell.len().min(MAX_CELL_SAMPLES) as f32
        };
        let light: Vec<Vec3> = cells.par_iter().enumerate().map(cell_light).collect();
        let sample_light_beyond =
            |i: usize| light[sample_cells[i].load(Ordering::Relaxed) as usize];
        let row_light = |(&first, row): (&u32, &SampledRow)| {
            (first as usize..)
                .take(row.partial.len())
                .map(sample_light_beyond)
                .collect()
        };
        firsts.par_iter().zip(rows).map(row_light).collect()
    }
}
