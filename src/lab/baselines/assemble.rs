//! Assembly of a frame from the canvases of fragments and boundaries (P6).

use super::epipolar::{Boundary, Rays, RowDivision};
use headbox_core::frame::Frame;
use headbox_cube::render::band::BandRenderer;
use headbox_cube::render::resolve::composite_environment::{
    EnvironmentBackground, Pixels, depth_chunks,
};
use headbox_cube::render::settings::FrameStats;
use headbox_cube::render::setup::plan::FramePlan;
use rayon::prelude::*;
use std::time::Instant;

/// Number of rows in a task of a thread.
const ROWS_AT_ONCE: usize = 8;

/// Columns of a row up to `end`, and the index of the canvas that has their pixels.
#[derive(Clone, Copy)]
struct Owner {
    end: u32,
    canvas: usize,
}

/// Owners of the columns of each row, from left to right. Reused from frame to frame.
#[derive(Default)]
pub(super) struct RowOwners {
    rows: Vec<Vec<Owner>>,
}

/// Inputs of the assembly of a frame.
pub(super) struct Assembly<'a> {
    pub(super) plan: &'a FramePlan,
    pub(super) boundaries: &'a [Boundary],
    /// A canvas for each fragment between `boundaries`, then one for each boundary.
    pub(super) canvases: &'a [BandRenderer],
    pub(super) background: EnvironmentBackground<'a>,
}

impl RowOwners {
    /// Assembles the frame row by row. Returns hole pixels and time, and the number of pixels in
    /// masks.
    pub(super) fn assemble(
        &mut self,
        assembly: &Assembly,
        frame: &mut Frame,
        inverse_depths: &mut [f32],
        rays: impl Fn(u32) -> Rays + Sync,
    ) -> (FrameStats, u64) {
        let width = frame.width;
        self.rows
            .resize_with(self.rows.len().max(frame.height as usize), Vec::new);
        let Frame {
            color: colors,
            coverage: coverages,
            depth_m: depths_m,
            ..
        } = frame;
        let chunk = width as usize * ROWS_AT_ONCE;
        let count = colors.len().div_ceil(chunk);
        let depths =
            depth_chunks(depths_m, chunk, count).zip(depth_chunks(inverse_depths, chunk, count));
        let chunks = colors
            .par_chunks_mut(chunk)
            .zip(coverages.par_chunks_mut(chunk))
            .zip(depths);
        let owners = self.rows.par_chunks_mut(ROWS_AT_ONCE);
        let add = |(mut stats, masked): (FrameStats, u64), (part, part_masked)| {
            stats.add(&part);
            (stats, masked + part_masked)
        };
        chunks
            .zip(owners)
            .enumerate()
            .map(
                |(i, (((colors, coverages), (depths_m, inverse_depths)), owners))| {
                    let started = Instant::now();
                    let pixels = Pixels {
                        colors,
                        coverages,
                        depths_m,
                        inverse_depths,
                    };
                    let mut stats = FrameStats::default();
                    let mut masked = 0;
                    let mut division = RowDivision::default();
                    let rows = pixels.rows(width).zip((i * ROWS_AT_ONCE) as u32..);
                    for ((pixels, y), owners) in rows.zip(owners) {
                        let boundaries = assembly.boundaries;
                        masked += assign_row(boundaries, &rays(y), width, &mut division, owners);
                        stats.hole_pixels += assembly.assemble_row(y, owners, pixels);
                    }
                    stats.finish_ms = started.elapsed().as_secs_f64() * 1e3;
                    (stats, masked)
                },
            )
            .reduce(Default::default, add)
    }
}

impl Assembly<'_> {
    /// Copies a row from the canvases of its owners, and composites it over the background. Returns
    /// the number of holes.
    fn assemble_row(&self, y: u32, owners: &[Owner], pixels: Pixels) -> u64 {
        let mut start = 0;
        for owner in owners {
            let range = start..owner.end as usize;
            let mut part = Pixels {
                colors: &mut pixels.colors[range.clone()],
                coverages: &mut [],
                depths_m: pixels.depths_m.get_mut(range.clone()).unwrap_or_default(),
                inverse_depths: pixels.inverse_depths.get_mut(range).unwrap_or_default(),
            };
            self.canvases[owner.canvas].resolve(self.plan, y as usize, start, &mut part);
            start = owner.end as usize;
        }
        self.background.composite_row(y, pixels)
    }
}

/// Assigns the columns of a row to canvases: those in masks to boundaries, all others to fragments.
/// Returns the number of pixels in masks.
fn assign_row(
    boundaries: &[Boundary],
    rays: &Rays,
    width: u32,
    division: &mut RowDivision,
    owners: &mut Vec<Owner>,
) -> u64 {
    owners.clear();
    let fragments = boundaries.len().max(1);
    let mut masked = 0;
    for part in division.divide(boundaries, rays, &(0..width)) {
        let mut start = part.columns.start;
        while start < part.columns.end {
            // The column's mask, or its sector up to the next mask.
            let masks = boundaries.iter().map(|boundary| boundary.mask(rays, width));
            let owner = match masks.clone().position(|mask| mask.contains(&start)) {
                Some(k) => Owner {
                    end: boundaries[k].mask(rays, width).end.min(part.columns.end),
                    canvas: fragments + k,
                },
                None => Owner {
                    end: masks
                        .map(|mask| mask.start)
                        .filter(|mask_start| *mask_start > start)
                        .fold(part.columns.end, u32::min),
                    canvas: part.fragment,
                },
            };
            if owner.canvas >= fragments {
                masked += u64::from(owner.end - start);
            }
            owners.push(owner);
            start = owner.end;
        }
    }
    masked
}
