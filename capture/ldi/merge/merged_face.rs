//! A face of depth pixels, with the bin spans by which their alphas are measured.

use super::coverage::{AlphaMeasure, BinSpan};
use crate::surfaces::rows;
use headbox_core::cube_face::Face;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::samples::{DepthPixel, LayeredDepthImage};
use headbox_trace::bvh::Tracer;
use rayon::prelude::*;

/// A face of depth pixels, merged from surface samples.
pub(crate) struct MergedFace {
    pub(crate) ldi: LayeredDepthImage,
    /// Bin span of each depth pixel.
    pub(crate) spans: Vec<BinSpan>,
}

impl MergedFace {
    /// Builds a face from the depth pixels that `merge_pixel` appends for each pixel (x, y),
    /// farthest first.
    pub(crate) fn new(
        face: Face,
        size_px: u32,
        merge_pixel: impl Fn(u32, u32, &mut Vec<(DepthPixel, BinSpan)>) + Sync,
    ) -> Self {
        let row = |y: u32| {
            let mut depth_pixels = Vec::new();
            let mut counts = Vec::with_capacity(size_px as usize);
            for x in 0..size_px {
                let before = depth_pixels.len();
                merge_pixel(x, y, &mut depth_pixels);
                counts.push((depth_pixels.len() - before) as u32);
            }
            let (samples, spans): (Vec<DepthPixel>, Vec<BinSpan>) =
                depth_pixels.into_iter().unzip();
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

    /// Measures the alphas.
    pub(crate) fn measure_alphas(&mut self, tracer: &Tracer, bins: &DepthBins, half_size_m: f64) {
        let alphas = self.alpha_measure(tracer, bins, half_size_m).alphas();
        self.set_alphas(&alphas);
    }

    /// Measures the alphas of rims in the pixels (x, y) that `is_selected` accepts.
    pub(crate) fn measure_rim_alphas(
        &mut self,
        tracer: &Tracer,
        bins: &DepthBins,
        half_size_m: f64,
        is_selected: impl Fn(u32, u32) -> bool + Sync,
    ) {
        let measure = self.alpha_measure(tracer, bins, half_size_m);
        let alphas = measure.rim_alphas(is_selected);
        self.set_alphas(&alphas);
    }

    fn alpha_measure<'a>(
        &'a self,
        tracer: &'a Tracer,
        bins: &'a DepthBins,
        half_size_m: f64,
    ) -> AlphaMeasure<'a> {
        AlphaMeasure {
            tracer,
            bins,
            half_size_m,
            face: &self.ldi,
            spans: &self.spans,
            has_single_sided: tracer
                .scene()
                .materials
                .iter()
                .any(|material| material.single_sided),
        }
    }

    fn set_alphas(&mut self, alphas: &[u8]) {
        for (sample, alpha) in self.ldi.samples.iter_mut().zip(alphas) {
            sample.color_srgb[3] = *alpha;
        }
    }
}
