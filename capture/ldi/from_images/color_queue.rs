//! Queue of samples without colour, whose colours are interpolated sixteen at a time.

use super::depth_rows::LANES;
use super::row_samples::{ImageSample, LinearColor16, RowSamples};
use fearless_simd::f32x16;
use fearless_simd::prelude::*;
use headbox_core::image::texels::{blend_quads, gather_quads, locate};
use headbox_images::LoadedView;

/// Up to sixteen samples of an image without colour.
pub(super) struct ColorQueue<'a> {
    view: &'a LoadedView,
    /// Linear value of every sRGB level.
    linear: &'static [u16; 256],
    /// Receives the samples.
    rows_out: &'a mut RowSamples,
    count: usize,
    rows: [u32; LANES],
    samples: [ImageSample; LANES],
    /// Positions of their colours in the image: columns and rows of pixels, whose middles are at
    /// whole numbers.
    positions: [[f32; LANES]; 2],
}

impl<'a> ColorQueue<'a> {
    pub(super) fn new(view: &'a LoadedView, rows_out: &'a mut RowSamples) -> Self {
        Self {
            view,
            linear: LinearColor16::srgb_table(),
            rows_out,
            count: 0,
            rows: [0; LANES],
            samples: [ImageSample::NONE; LANES],
            positions: [[0.0; LANES]; 2],
        }
    }

    /// Adds a sample of a row of the cube, whose colour is at a position in the image.
    #[inline(always)]
    pub(super) fn add<S: Simd>(
        &mut self,
        simd: S,
        row: u32,
        sample: ImageSample,
        [x, y]: [f32; 2],
    ) {
        let i = self.count % LANES;
        self.rows[i] = row;
        self.samples[i] = sample;
        self.positions[0][i] = x;
        self.positions[1][i] = y;
        self.count += 1;
        if self.count == LANES {
            self.flush(simd);
        }
    }

    /// Interpolates all colours and pushes the samples.
    pub(super) fn flush<S: Simd>(&mut self, simd: S) {
        simd.vectorize(
            #[inline(always)]
            || self.flush_all(simd),
        );
    }

    #[inline(always)]
    fn flush_all<S: Simd>(&mut self, simd: S) {
        let [width, height] = self.view.size_px;
        let (left, across) = locate(f32x16::load_array_ref(simd, &self.positions[0]), width);
        let (top, down) = locate(f32x16::load_array_ref(simd, &self.positions[1]), height);
        let texels = gather_quads(simd, &self.view.color, top * width + left, width as usize);
        let (colors, masked) = match texels {
            Some(four) => {
                let known = ((four[0] & four[1]) & (four[2] & four[3])) >> 24;
                (
                    blend_quads(four, [across, down]).to_array(),
                    known.simd_eq(0).to_bitmask(),
                )
            }
            // An image of one pixel along a side.
            None => ([0; LANES], u64::MAX),
        };
        for i in 0..std::mem::take(&mut self.count).min(LANES) {
            let [r, g, b, _] = match masked >> i & 1 {
                0 => colors[i].to_le_bytes(),
                _ => self.masked_color(i),
            };
            let color = LinearColor16([r, g, b].map(|level| self.linear[usize::from(level)]));
            self.rows_out.push(
                self.rows[i],
                ImageSample {
                    color,
                    ..self.samples[i]
                },
            );
        }
    }

    /// The colour of a sample where some of the four surrounding pixels may be masked out.
    #[cold]
    fn masked_color(&self, i: usize) -> [u8; 4] {
        let position = [self.positions[0][i], self.positions[1][i]].map(|c| f64::from(c) + 0.5);
        let [width, height] = self.view.size_px.map(f64::from);
        let inside = [
            position[0].clamp(0.0, width),
            position[1].clamp(0.0, height),
        ];
        // Always known: the pixel that the sample comes from is one of the four.
        let [r, g, b] = self
            .view
            .color_at(inside)
            .unwrap_or_default()
            .map(|level| (level + 0.5) as u8);
        [r, g, b, u8::MAX]
    }
}
