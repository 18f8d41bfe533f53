//! A face whose parts are merged, with what its alphas are measured by.

use super::coverage::{AlphaMeasure, BinSpan};
use crate::surfaces::rows;
use headbox_core::cube_face::Face;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::samples::{DepthPixel, LayeredDepthImage};
use headbox_trace::bvh::Tracer;
use rayon::prelude::*;

/// A face whose parts are merged.
pub(crate) struct MergedFace {
    pub(crate) ldi: LayeredDepthImage,
    /// Of its samples.
    pub(crate) spans: Vec<BinSpan>,
}

impl MergedFace {
    /// A face of the depth pixels that `depth_pixels` appends for each pixel (x, y), farthest first.
    pub(crate) fn of(
        face: Face,
        size_px: u32,
        depth_pixels: impl Fn(u32, u32, &mut Vec<(DepthPixel, BinSpan)>) + Sync,
    ) -> Self {
        let row = |y: u32| {
            let (mut found, mut counts) = (Vec::new(), Vec::with_capacity(size_px as usize));
            for x in 0..size_px {
                let before = found.len();
                depth_pixels(x, y, &mut found);
                counts.push((found.len() - before) as u32);
            }
            let (samples, spans): (Vec<DepthPixel>, Vec<BinSpan>) = found.into_iter().unzip();
            (samples, spans, counts)
        };
        let rows: Vec<_> = (0..size_px).into_par_iter().map(row).collect();
        let mut ldi = LayeredDepthImage::empty(face, size_px);
        let mut total = 0;
        for (slot, count) in ldi.offsets[1..]
            .iter_mut()
            .zip(rows.iter().flat_map(|row| &row.2))
        {
            total += count;
            *slot = total;
        }
        ldi.samples = rows::concat(&rows, |row| &row.0);
        let spans = rows::concat(&rows, |row| &row.1);
        Self { ldi, spans }
    }

    /// The depth pixels of pixel (x, y), each with its span.
    pub(crate) fn pixel(&self, x: u32, y: u32) -> impl Iterator<Item = (DepthPixel, BinSpan)> {
        let first = self.ldi.offsets[(y * self.ldi.size_px + x) as usize] as usize;
        self.ldi
            .pixel(x, y)
            .iter()
            .copied()
            .zip(self.spans[first..].iter().copied())
    }

    /// Measures the alphas of the pixels (x, y) for which `wanted` says so.
    pub(crate) fn measure_alphas(
        &mut self,
        tracer: &Tracer,
        bins: &DepthBins,
        half_size_m: f64,
        wanted: impl Fn(u32, u32) -> bool + Sync,
    ) {
        let alphas = AlphaMeasure {
            tracer,
            bins,
            half_size_m,
            face: &self.ldi,
            spans: &self.spans,
        }
        .alphas(wanted);
        self.ldi
            .samples
            .iter_mut()
            .zip(alphas)
            .for_each(|(sample, alpha)| sample.color_srgb[3] = alpha);
    }
}
