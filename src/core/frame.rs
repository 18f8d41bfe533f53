//! A finished frame.

use crate::camera::CameraError;
use crate::files::write_whole;
use crate::image_file;
use crate::image_file::PictureError;
use image::RgbImage;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// How a pixel of a frame came about, in one byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct Coverage(u8);

impl Coverage {
    /// No splat touched the pixel and no environment texel that a real miss reached is there.
    pub const HOLE: Self = Self(0);
    /// The environment alone.
    pub const ENVIRONMENT: Self = Self(1);
    /// A small hole that was given the colour of what lies beside and behind it.
    pub const FILLED: Self = Self(2);
    /// Splats cover the pixel wholly.
    pub const FULL: Self = Self(255);

    /// A pixel of which splats cover `share` of 255; at least the smallest value that is not
    /// one of those.
    pub fn of_splats(share: u8) -> Self {
        Self(share.max(3))
    }

    /// The coverage of a [`Self::byte`].
    #[inline]
    pub const fn of_byte(byte: u8) -> Self {
        Self(byte)
    }

    /// The byte that it is kept in.
    #[inline]
    pub const fn byte(self) -> u8 {
        self.0
    }

    /// True if nothing is known of the pixel, filled or not.
    pub fn is_hole(self) -> bool {
        self == Self::HOLE || self == Self::FILLED
    }

    /// Share of the pixel that splats cover, of 255; 0 for a hole and for the environment alone.
    pub fn splat_share(self) -> u8 {
        if self <= Self::FILLED { 0 } else { self.0 }
    }
}

/// An image, row 0 on top, and where it came from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// sRGB, alpha 255; `width * height` entries.
    pub color: Vec<[u8; 4]>,
    /// One for each pixel.
    pub coverage: Vec<Coverage>,
    /// Eye depth in metres of what covers each pixel, infinite where no splat does; empty unless it was asked for.
    pub depth_m: Vec<f32>,
}

/// Why a frame could not be encoded.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// The size of the frame cannot be that of an image.
    #[error(transparent)]
    Size(#[from] CameraError),
    /// The rows of a buffer are too short, or too few.
    #[error("{bytes} bytes in rows of {stride} do not hold {rows} rows of {row_bytes} bytes")]
    Buffer {
        /// Bytes of the buffer.
        bytes: usize,
        /// Bytes from the start of a row to that of the next.
        stride: usize,
        /// Rows of the frame.
        rows: u32,
        /// Bytes that a row of the frame needs.
        row_bytes: usize,
    },
    /// The file could not be written.
    #[error("{} could not be written: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The encoder failed.
    #[error("cannot encode the frame as PNG: {0}")]
    Png(#[from] PictureError),
}

impl Frame {
    /// Makes the frame `width` by `height`, all holes of the colour `color_srgb`; keeps the memory it has.
    pub fn reset(&mut self, width: u32, height: u32, color_srgb: [u8; 3]) {
        let count = width as usize * height as usize;
        let [r, g, b] = color_srgb;
        (self.width, self.height) = (width, height);
        self.color.clear();
        self.color.resize(count, [r, g, b, 255]);
        self.coverage.clear();
        self.coverage.resize(count, Coverage::HOLE);
        self.depth_m.clear();
    }

    /// Makes the frame `width` by `height`, with or without depths; what its pixels hold may be anything. Keeps the memory it
    /// has.
    pub fn resize(&mut self, width: u32, height: u32, depth: bool) {
        let count = width as usize * height as usize;
        (self.width, self.height) = (width, height);
        self.color.resize(count, [0; 4]);
        self.coverage.resize(count, Coverage::HOLE);
        self.depth_m
            .resize(if depth { count } else { 0 }, f32::INFINITY);
    }

    /// Copies the colours, 4 bytes a pixel, to a buffer whose rows start `stride` bytes apart, as those of windows and of
    /// parts of larger images do. Bytes between rows stay as they are.
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

    /// The colours as a picture.
    ///
    /// # Errors
    /// [`FrameError::Size`] if width, height and the number of colours do not fit together.
    pub fn to_rgb(&self) -> Result<RgbImage, FrameError> {
        let rgb = self
            .color
            .iter()
            .flat_map(|&[r, g, b, _]| [r, g, b])
            .collect();
        Ok(RgbImage::from_raw(self.width, self.height, rgb)
            .ok_or(CameraError::Size(self.width, self.height))?)
    }

    /// Saves the frame as a PNG file, whole or not at all.
    ///
    /// # Errors
    /// As [`Self::to_png`]; [`FrameError::Write`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), FrameError> {
        let (path, png) = (path.as_ref(), self.to_png()?);
        let written = write_whole(path, |file| file.write_all(&png));
        written.map_err(|source| FrameError::Write {
            path: path.into(),
            source,
        })
    }

    /// The frame as the bytes of a PNG file (8-bit sRGB with alpha).
    ///
    /// # Errors
    /// [`FrameError`] if width, height and the number of colours do not fit together, or the encoder fails.
    pub fn to_png(&self) -> Result<Vec<u8>, FrameError> {
        if self.color.len() as u64 != u64::from(self.width) * u64::from(self.height) {
            return Err(CameraError::Size(self.width, self.height).into());
        }
        let kind = image::ExtendedColorType::Rgba8;
        Ok(image_file::png(
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
    fn frames_fit_into_rows_of_any_length() {
        let mut frame = Frame::default();
        frame.reset(3, 2, [1, 2, 3]);
        let mut wide = [9; 2 * 20];
        frame.copy_to(&mut wide, 20).expect("fits");
        for row in wide.chunks(20) {
            assert_eq!(row[..12], [1, 2, 3, 255, 1, 2, 3, 255, 1, 2, 3, 255]);
            assert_eq!(row[12..], [9; 8]);
        }
        // The last row needs no room behind it.
        assert!(
            frame.copy_to(&mut [0; 32], 20).is_ok() && frame.copy_to(&mut [0; 31], 20).is_err()
        );
        assert!(
            frame.copy_to(&mut [0; 100], 11).is_err(),
            "rows that are too short"
        );
        assert!(Frame::default().copy_to(&mut [], 0).is_ok());
    }

    #[test]
    fn png_round_trips_and_a_frame_of_the_wrong_size_is_refused() {
        let mut frame = Frame::default();
        frame.reset(3, 2, [1, 2, 3]);
        frame.color[4] = [250, 128, 7, 255];
        let png = frame.to_png().expect("encodes");
        let back = image::load_from_memory(&png).expect("decodes").to_rgba8();
        assert_eq!(back.get_pixel(1, 1).0, [250, 128, 7, 255]);
        assert_eq!(back.get_pixel(0, 0).0, [1, 2, 3, 255]);
        assert_eq!(frame.hole_count(), 6);
        frame.color.pop();
        assert!(matches!(frame.to_png(), Err(FrameError::Size(_))));
    }
}
