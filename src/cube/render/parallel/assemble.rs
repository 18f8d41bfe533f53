//! From the canvases of fragments to one frame: who painted which pixels (P6).

use super::epipolar::{Boundary, Rays, spans};
use crate::render::canvas::depth::DepthCanvas;
use crate::render::footprint::splat::Canvas;
use crate::render::resolve::finish::{Background, Pixels, depth_pieces};
use crate::render::{FramePlan, FrameStats};
use headbox_core::frame::Frame;
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;

/// Rows that a thread puts together at a time.
const ROWS_AT_A_TIME: usize = 8;

/// Pixels of a row up to a column, and the index of their painter.
#[derive(Clone, Copy)]
struct Owner {
    end: u32,
    painter: usize,
}

/// Of each row of a frame, from left to right, who painted which columns. Kept from frame to frame for its memory.
#[derive(Default)]
pub(super) struct Owners {
    rows: Vec<Vec<Owner>>,
}

impl Owners {
    /// Puts the frame together, row by row, from the canvases of the painters: one for each fragment between `boundaries`, then one
    /// for each boundary.
    pub(super) fn assemble<'c, C: Canvas + Sync + 'c>(
        &mut self,
        plan: &FramePlan,
        boundaries: &[Boundary],
        background: &Background,
        (frame, inverse_depths): (&mut Frame, &mut [f32]),
        rays: impl Fn(u32) -> Rays + Sync,
        painter: impl Fn(usize) -> (&'c C, &'c DepthCanvas) + Sync,
    ) -> FrameStats {
        let width = frame.width;
        self.rows
            .resize_with(self.rows.len().max(frame.height as usize), Vec::new);
        let finish_one = |y: u32, pixels: Pixels, owners: &mut Vec<Owner>| {
            let started = Instant::now();
            let redone_pixels = share_row(boundaries, &rays(y), width, owners);
            let mut start = 0;
            for owner in &*owners {
                let (canvas, depth) = painter(owner.painter);
                let range = start..owner.end as usize;
                canvas.resolve(
                    y as usize,
                    start,
                    &mut pixels.colors[range.clone()],
                    plan.level,
                );
                if let Some(inverse_depths) = pixels.inverse_depths.get_mut(range.clone()) {
                    canvas.tell_depths(y as usize, start, inverse_depths);
                }
                if let Some(depths_m) = pixels.depths_m.get_mut(range) {
                    depth.resolve(y as usize, start, depths_m);
                }
                start = owner.end as usize;
            }
            let hole_pixels = background.put_under(y, pixels);
            let finish_ms = started.elapsed().as_secs_f64() * 1e3;
            FrameStats {
                hole_pixels,
                finish_ms,
                redone_pixels,
                ..FrameStats::default()
            }
        };
        let add = |mut sum: FrameStats, row: FrameStats| {
            sum.absorb(&row);
            sum
        };
        let Frame {
            color: colors,
            coverage: coverages,
            depth_m: depths_m,
            ..
        } = frame;
        let piece = width as usize * ROWS_AT_A_TIME;
        let pieces = colors.len().div_ceil(piece);
        let depths =
            depth_pieces(depths_m, piece, pieces).zip(depth_pieces(inverse_depths, piece, pieces));
        let rows = colors
            .par_chunks_mut(piece)
            .zip(coverages.par_chunks_mut(piece))
            .zip(depths);
        let owners = self.rows.par_chunks_mut(ROWS_AT_A_TIME);
        let finish_piece = |(i, (((colors, coverages), (depths_m, inverse_depths)), owners)): (
            usize,
            (_, &mut [Vec<Owner>]),
        )| {
            let rows = Pixels {
                colors,
                coverages,
                depths_m,
                inverse_depths,
            }
            .rows(width)
            .zip((i * ROWS_AT_A_TIME) as u32..);
            rows.zip(owners)
                .fold(FrameStats::default(), |sum, ((row, y), owners)| {
                    add(sum, finish_one(y, row, owners))
                })
        };
        rows.zip(owners)
            .enumerate()
            .map(finish_piece)
            .reduce(FrameStats::default, add)
    }
}

/// Writes who painted which pixels of a row to `owners`: boundaries in their masks, fragments elsewhere. Returns how many
/// pixels lie in masks.
fn share_row(boundaries: &[Boundary], rays: &Rays, width: u32, owners: &mut Vec<Owner>) -> u64 {
    owners.clear();
    let fragments = boundaries.len().max(1);
    let (mut start, mut redone) = (0, 0);
    while start < width {
        // The pixel's mask, or its sector up to the next mask.
        let masks = boundaries.iter().map(|boundary| boundary.mask(rays, width));
        let mask = masks.clone().position(|mask| mask.contains(&start));
        let before = |range: &Range<u32>, end: u32| {
            if range.start > start {
                end.min(range.start)
            } else {
                end
            }
        };
        let owner = match mask {
            Some(k) => Owner {
                end: boundaries[k].mask(rays, width).end,
                painter: fragments + k,
            },
            None => {
                let mut owner = Owner {
                    end: width,
                    painter: 0,
                };
                for k in 0..fragments {
                    for span in spans(boundaries, k, rays, &(0..width)) {
                        match span.contains(&start) {
                            true => {
                                owner = Owner {
                                    end: owner.end.min(span.end),
                                    painter: k,
                                }
                            }
                            false => owner.end = before(&span, owner.end),
                        }
                    }
                }
                Owner {
                    end: masks
                        .clone()
                        .fold(owner.end, |end, mask| before(&mask, end)),
                    ..owner
                }
            }
        };
        redone += if mask.is_some() {
            u64::from(owner.end - start)
        } else {
            0
        };
        owners.push(owner);
        start = owner.end;
    }
    redone
}
