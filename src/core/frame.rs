//! Frame: colours, coverage and eye depth of a finished image.

use crate::camera::CameraError;
use crate::files::write_whole;
use crate::image::codec;
use crate::image::codec::PictureError;
use ::image::RgbImage;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Origin of a pixel's colour, in one byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct Coverage(u8);

impl Coverage {
    /// Hole: no splat and no environment texel that a real miss reached.
    pub const HOLE: Self = Self(0);
    /// Environment only.
    pub const ENVIRONMENT: Self = Self(1);
    /// Small hole, filled from the background around it.
    pub const FILLED: Self = Self(2);
    /// Completely covered by splats.
    pub const FULL: Self = Self(255);

    /// Creates the coverage of a pixel of which splats cover `share`, 0..=255; at least the
    /// smallest value that is not one of the constants.
    pub fn from_splat_share(share: u8) -> Self {
        Self(share.max(3))
    }

    /// Inverse of [`Self::byte`].
    #[inline]
    pub const fn from_byte(byte: u8) -> Self {
        Self(byte)
    }

    /// Encoding as one byte.
    #[inline]
    pub const fn byte(self) -> u8 {
        self.0
    }

    /// Returns true for holes, filled or not.
    pub fn is_hole(self) -> bool {
        self == Self::HOLE || self == Self::FILLED
    }

    /// Share of the pixel that splats cover, 0..=255; 0 for holes and for environment only.
    pub fn splat_share(self) -> u8 {
        if self <= Self::FILLED { 0 } else { self.0 }
    }
}

/// Image, row 0 on top, with the coverage and optionally the eye depth of each pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// sRGB, alpha 255; `width * height` entries.
    pub color: Vec<[u8; 4]>,
    /// Coverage of each pixel.
    pub coverage: Vec<Coverage>,
    /// Eye depth of each pixel in metres, infinite where no splat covers it; empty unless
    /// requested.
    pub depth_m: Vec<f32>,
}

/// Error of encoding or writing a frame.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// Invalid frame size.
    #[error(transparent)]
    Size(#[from] CameraError),
    /// Target buffer with too short or too few rows.
    #[error(
        "a buffer of {bytes} bytes with rows of {stride} cannot hold {rows} rows of {row_bytes} bytes"
    )]
    Buffer {
        /// Size of the buffer, bytes.
        bytes: usize,
        /// Distance between the starts of rows, bytes.
        stride: usize,
        /// Height of the frame, rows.
        rows: u32,
        /// Size of a row of the frame, bytes.
        row_bytes: usize,
    },
    /// Write error.
    #[error("{}: cannot write: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: io::Error,
    },
    /// PNG encoder error.
    #[error("cannot encode the frame as PNG: {0}")]
    Png(#[from] PictureError),
}

impl Frame {
    /// Resizes to `width` x `height` pixels, all holes of colour `color_srgb`. Reuses memory.
    pub fn reset(&mut self, width: u32, height: u32, color_srgb: [u8; 3]) {
        let count = width as usize * height as usize;
        let [r, g, b] = color_srgb;
        self.width = width;
        self.height = height;
        self.color.clear();
        self.color.resize(count, [r, g, b, 255]);
        self.coverage.clear();
        self.coverage.resize(count, Coverage::HOLE);
        self.depth_m.clear();
    }

    /// Resizes to `width` x `height` pixels, with or without depth; pixel values are unspecified.
    /// Reuses memory.
    pub fn resize(&mut self, width: u32, height: u32, depth: bool) {
        let count = width as usize * height as usize;
        self.width = width;
        self.height = height;
        self.color.resize(count, [0; 4]);
        self.coverage.resize(count, Coverage::HOLE);
        self.depth_m
            .resize(if depth { count } else { 0 }, f32::INFINITY);
    }

    /// Copies the colours, 4 bytes a pixel, to a buffer whose rows start `stride` bytes apart, such
    /// as a window's or a part of a larger image. Leaves the bytes between rows unchanged.
    ///
    /// # Errors
    /// [`FrameError::Buffer`] if the frame does not fit.
    pub fn copy_to(&self, to: &mut [u8], stride: usize) -> Result<(), FrameError> {
        let row_bytes = self.width as usize * 4;
        let rows = self.height;
        let needed = (rows as usize)
            .saturating_sub(1)
            .saturating_mul(stride)
            .saturating_add(row_bytes);
        if row_bytes > stride || (rows > 0 && needed > to.len()) {
            return Err(FrameError::Buffer {
                bytes: to.len(),
                stride,
                rows,
                row_bytes,
            });
        }
        if row_bytes > 0 {
            for (to, from) in to
                .chunks_mut(stride)
                .zip(self.color.chunks_exact(self.width as usize))
            {
                to[..row_bytes].copy_from_slice(from.as_flattened());
            }
        }
        Ok(())
    }

    /// Number of hole pixels.
    pub fn hole_count(&self) -> u64 {
        self.coverage.iter().filter(|c| c.is_hole()).count() as u64
    }

    /// Converts the colours to an RGB image.
    ///
    /// # Errors
    /// [`FrameError::Size`] if the number of colours is not width x height.
    pub fn to_rgb(&self) -> Result<RgbImage, FrameError> {
        let rgb = self
            .color
            .iter()
            .flat_map(|&[r, g, b, _]| [r, g, b])
            .collect();
        Ok(RgbImage::from_raw(self.width, self.height, rgb)
            .ok_or(CameraError::Size(self.width, self.height))?)
    }

    /// Writes the frame as a PNG file, completely or not at all.
    ///
    /// # Errors
    /// Those of [`Self::to_png`]; [`FrameError::Write`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), FrameError> {
        let path = path.as_ref();
        let png = self.to_png()?;
        let written = write_whole(path, |file| file.write_all(&png));
        written.map_err(|source| FrameError::Write {
            path: path.into(),
            source,
        })
    }

    /// Encodes the frame as PNG (8-bit sRGB with alpha).
    ///
    /// # Errors
    /// [`FrameError`] if the number of colours is not width x height, or the encoder fails.
    pub fn to_png(&self) -> Result<Vec<u8>, FrameError> {
        if self.color.len() as u64 != u64::from(self.width) * u64::from(self.height) {
            return Err(CameraError::Size(self.width, self.height).into());
        }
        let kind = image::ExtendedColorType::Rgba8;
        Ok(codec::png(
            self.color.as_flattened(),
            self.width,
            self.height,
            kind,
        )?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copy_to_fits_any_stride() {
        let mut frame = Frame::default();
        frame.reset(3, 2, [1, 2, 3]);
        let mut wide = [9; 2 * 20];
        frame.copy_to(&mut wide, 20).expect("fits");
        for row in wide.chunks(20) {
            assert_eq!(row[..12], [1, 2, 3, 255, 1, 2, 3, 255, 1, 2, 3, 255]);
            assert_eq!(row[12..], [9; 8]);
        }
        // The last row needs no padding.
        assert!(
            frame.copy_to(&mut [0; 32], 20).is_ok() && frame.copy_to(&mut [0; 31], 20).is_err()
        );
        assert!(
            frame.copy_to(&mut [0; 100], 11).is_err(),
            "rows are too short"
        );
        assert!(Frame::default().copy_to(&mut [], 0).is_ok());
    }

    #[test]
    fn png_round_trips_and_wrong_size_is_refused() {
        let mut frame = Frame::default();
        frame.reset(3, 2, [1, 2, 3]);
        frame.color[4] = [250, 128, 7, 255];
        let png = frame.to_png().expect("encodes");
        let back = ::image::load_from_memory(&png).expect("decodes").to_rgba8();
        assert_eq!(back.get_pixel(1, 1).0, [250, 128, 7, 255]);
        assert_eq!(back.get_pixel(0, 0).0, [1, 2, 3, 255]);
        assert_eq!(frame.hole_count(), 6);
        frame.color.pop();
        assert!(matches!(frame.to_png(), Err(FrameError::Size(_))));
    }
}
