//! Deep OpenEXR images: any number of samples per pixel, each with its own depth.
//!
//! Supports scanline parts without compression, with RLE and with ZIPS, which are all that OpenEXR
//! allows for deep data. The `exr` crate, used for all other EXR files, does not support deep data.
//! Layout: *OpenEXR File Layout*, "Deep Data".

mod compress;
mod header;
#[cfg(test)]
mod tests;

pub use compress::DeepCompression;

use glam::{DMat4, DVec3};
use headbox_core::camera::Camera;
use headbox_core::files;
use headbox_core::memory;
use header::{Cursor, Header};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Error of reading or writing a deep image.
#[derive(Debug, thiserror::Error)]
pub enum DeepExrError {
    /// The file cannot be opened, read or written.
    #[error("{}: {cause}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// A field of the file is invalid.
    #[error("{}: {field}: {cause}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Name of the field.
        field: String,
        /// Problem, as the rest of a sentence about the field.
        cause: String,
    },
}

/// Storage type of a channel's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeepKind {
    /// 32-bit integers, rounded to `f32` beyond 2^24.
    Uint,
    /// 16-bit floats.
    Half,
    /// 32-bit floats.
    Float,
}

/// A channel of a deep image.
#[derive(Clone, Debug, PartialEq)]
pub struct DeepChannel {
    /// `R`, `G`, `B`, `A` (linear, premultiplied), `Z` (metres or the scene's unit), `ZBack`, ...
    pub name: String,
    /// Storage type.
    pub kind: DeepKind,
    /// Values of the samples, pixel by pixel, row by row from the top.
    pub values: Vec<f32>,
}

/// Image with any number of samples in each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct DeepImage {
    /// Width and height of the whole image (the display window), pixels.
    pub size_px: [u32; 2],
    /// Column and row of the stored pixels' corner (the data window), which may lie outside the
    /// image.
    pub origin_px: [i32; 2],
    /// Width and height of the stored pixels.
    pub stored_px: [u32; 2],
    /// Index of the first sample of each stored pixel, followed by the number of samples.
    pub offsets: Vec<u32>,
    /// Channels in the order of their names.
    pub channels: Vec<DeepChannel>,
    /// Camera attributes.
    pub view: DeepView,
}

/// Camera attributes of a deep image's header.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeepView {
    /// True for six cube faces on top of each other, as in OpenEXR's environment maps (`envmap`).
    pub cube: bool,
    /// `worldToCamera` for row vectors, row by row (equal to column by column for column vectors).
    pub world_to_camera: Option<[f32; 16]>,
    /// `worldToNDC` in the same layout.
    pub world_to_ndc: Option<[f32; 16]>,
}

impl DeepView {
    /// Converts a camera by OpenEXR's *Standard Attributes*: camera space is left-handed, x right,
    /// y up, z forward; NDC range from 0 to 1 over the image, y down.
    pub fn from_camera(camera: &Camera) -> Self {
        let forward = DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0));
        let rotation = DMat4::from_mat3(camera.world_from_eye().transpose());
        let camera_from_world = forward * rotation * DMat4::from_translation(-camera.eye());
        let size = DVec3::new(f64::from(camera.width()), f64::from(camera.height()), 1.0);
        let ndc_from_world = DMat4::from_scale(size.recip()) * camera.image_from_world();
        let array = |matrix: DMat4| Some(matrix.as_mat4().to_cols_array());
        Self {
            cube: false,
            world_to_camera: array(camera_from_world),
            world_to_ndc: array(ndc_from_world),
        }
    }
}

/// Maximum number of bytes that a file may unpack to: the size in the header is not trusted.
const MAX_BYTES: u64 = 8 << 30;

/// Maximum compression ratio: deflate reaches 1032.
const MAX_RATIO: u64 = 1100;

impl DeepKind {
    fn bytes(self) -> usize {
        if self == Self::Half { 2 } else { 4 }
    }
}

impl DeepImage {
    /// A channel's values.
    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        self.channels
            .iter()
            .find(|channel| channel.name == name)
            .map(|channel| channel.values.as_slice())
    }

    /// Returns the indices of the samples at a pixel of the whole image; none outside the stored
    /// pixels.
    pub fn samples_at(&self, x: u32, y: u32) -> std::ops::Range<usize> {
        let [column, row] = [
            i64::from(x) - i64::from(self.origin_px[0]),
            i64::from(y) - i64::from(self.origin_px[1]),
        ];
        let [width, height] = self.stored_px.map(i64::from);
        if !(0..width).contains(&column) || !(0..height).contains(&row) {
            return 0..0;
        }
        let pixel = (row * width + column) as usize;
        self.offsets[pixel] as usize..self.offsets[pixel + 1] as usize
    }

    /// Composites the samples of all images at a pixel of the whole image, nearest first, to linear
    /// premultiplied RGBA; at equal depth the earlier image lies in front. Missing channels are 0,
    /// missing alpha 1.
    pub fn composite(images: &[&Self], x: u32, y: u32) -> [f32; 4] {
        let mut samples: Vec<(f32, [f32; 4])> = Vec::new();
        for image in images {
            let [r, g, b, a, z] = ["R", "G", "B", "A", "Z"].map(|name| image.channel(name));
            for i in image.samples_at(x, y) {
                let value = |channel: Option<&[f32]>, missing: f32| {
                    channel.map_or(missing, |values| values[i])
                };
                samples.push((
                    value(z, 0.0),
                    [value(r, 0.0), value(g, 0.0), value(b, 0.0), value(a, 1.0)],
                ));
            }
        }
        samples.sort_by(|a, b| a.0.total_cmp(&b.0));
        samples.iter().fold([0.0; 4], |over, (_, under)| {
            let open = 1.0 - over[3];
            [0, 1, 2, 3].map(|c| over[c] + open * under[c])
        })
    }

    /// Reads the first deep scanline part of a file with one part.
    ///
    /// # Errors
    /// [`DeepExrError`] that names the file and the field.
    pub fn read(path: &Path) -> Result<Self, DeepExrError> {
        let bytes = memory::read_file(path).map_err(|cause| DeepExrError::Io {
            path: path.into(),
            cause,
        })?;
        parse(&bytes).map_err(|(field, cause)| DeepExrError::Format {
            path: path.into(),
            field,
            cause,
        })
    }

    /// Writes the file atomically.
    ///
    /// # Errors
    /// [`DeepExrError`] if the file cannot be written, or if counts and channels are inconsistent.
    pub fn write(&self, path: &Path, compression: DeepCompression) -> Result<(), DeepExrError> {
        let format = |(field, cause): FieldError| DeepExrError::Format {
            path: path.into(),
            field,
            cause,
        };
        let bytes = self.to_bytes(compression).map_err(format)?;
        files::write_whole(path, |out| out.write_all(&bytes)).map_err(|cause| DeepExrError::Io {
            path: path.into(),
            cause,
        })
    }

    /// Encodes the file.
    ///
    /// # Errors
    /// The invalid field if counts and channels are inconsistent.
    pub fn to_bytes(&self, compression: DeepCompression) -> Result<Vec<u8>, FieldError> {
        self.check()?;
        let mut order: Vec<&DeepChannel> = self.channels.iter().collect();
        order.sort_by(|a, b| a.name.cmp(&b.name));
        let mut out = header::encode(self, &order, compression);
        let [width, height] = self.stored_px.map(|side| side as usize);
        let table = out.len();
        out.resize(table + 8 * height, 0);
        for row in 0..height {
            let offset = out.len() as u64;
            out[table + 8 * row..][..8].copy_from_slice(&offset.to_le_bytes());
            let offsets = &self.offsets[row * width..=(row + 1) * width];
            let counts: Vec<u8> = offsets[1..]
                .iter()
                .flat_map(|end| (end - offsets[0]).to_le_bytes())
                .collect();
            let samples = offsets[0] as usize..offsets[width] as usize;
            let mut data = Vec::new();
            for channel in &order {
                header::put_values(channel.kind, &channel.values[samples.clone()], &mut data);
            }
            let [packed_counts, packed_data] = [&counts, &data].map(|raw| compression.pack(raw));
            out.extend((self.origin_px[1] + row as i32).to_le_bytes());
            for length in [packed_counts.len(), packed_data.len(), data.len()] {
                out.extend((length as u64).to_le_bytes());
            }
            out.extend(packed_counts);
            out.extend(packed_data);
        }
        Ok(out)
    }

    fn check(&self) -> Result<(), FieldError> {
        let pixels = self.stored_px[0] as usize * self.stored_px[1] as usize;
        let total = self.offsets.last().copied().unwrap_or(0) as usize;
        let rising = self.offsets.windows(2).all(|pair| pair[0] <= pair[1]);
        if self.offsets.len() != pixels + 1 || self.offsets[0] != 0 || !rising || pixels == 0 {
            return Err(field_error("offsets", "do not match the stored pixels"));
        }
        let is_wrong =
            |channel: &&DeepChannel| channel.values.len() != total || channel.name.is_empty();
        self.channels.iter().find(is_wrong).map_or(Ok(()), |wrong| {
            let field = format!("channel \"{}\"", wrong.name);
            Err(field_error(
                &field,
                "does not have one value for each sample",
            ))
        })
    }
}

/// An invalid field and its problem, as the rest of a sentence.
pub type FieldError = (String, String);

fn field_error(field: &str, cause: impl Into<String>) -> FieldError {
    (field.into(), cause.into())
}

fn parse(bytes: &[u8]) -> Result<DeepImage, FieldError> {
    let header = Header::read(bytes)?;
    let Header {
        compression,
        stored_px,
        ref channels,
        ..
    } = header;
    let [width, height] = stored_px.map(|side| side as usize);
    let mut cursor = Cursor {
        bytes,
        position: header.end,
    };
    let table: Vec<u64> = (0..height)
        .map(|_| cursor.u64("the table of scanlines"))
        .collect::<Result<_, _>>()?;
    let sample_bytes: u64 = channels.iter().map(|(_, kind)| kind.bytes() as u64).sum();
    let pixels = width as u64 * height as u64;
    let reserve = |field: &str, bytes: u64| {
        memory::reserve(bytes).map_err(|error| field_error(field, error.to_string()))
    };
    // Counts and offsets.
    let _pixel_memory = reserve("the counts of samples", 8 * pixels)?;
    let mut counts = vec![0u32; width * height];
    // Packed samples of each row, and their unpacked length.
    let mut rows: Vec<(&[u8], u64)> = vec![(&[], 0); height];
    let mut is_listed = vec![false; height];
    let mut total = 0u64;
    for start in table {
        let mut chunk = Cursor {
            bytes,
            position: usize::try_from(start).unwrap_or(usize::MAX),
        };
        let y = chunk.i32("a scanline's number")?;
        let row = (i64::from(y) - i64::from(header.origin_px[1])) as usize;
        if row >= height {
            return Err(field_error(
                "a scanline's number",
                format!("is {y}, outside the data window"),
            ));
        }
        if std::mem::replace(&mut is_listed[row], true) {
            let cause = format!("lists scanline {y} twice, so that another is missing");
            return Err(field_error("the table of scanlines", cause));
        }
        let field = format!("scanline {y}");
        let packed: [u64; 3] = [chunk.u64(&field)?, chunk.u64(&field)?, chunk.u64(&field)?];
        let packed_counts = chunk.take(packed[0], &field)?;
        rows[row] = (chunk.take(packed[1], &field)?, packed[2]);
        let ends = compression
            .unpack(packed_counts, 4 * width)
            .map_err(|cause| field_error(&field, cause))?;
        let mut before = 0;
        for (count, end) in counts[row * width..].iter_mut().zip(ends.as_chunks().0) {
            let end = u32::from_le_bytes(*end);
            *count = end
                .checked_sub(before)
                .ok_or_else(|| field_error(&field, "has decreasing counts of samples"))?;
            before = end;
        }
        let expected = u64::from(before) * sample_bytes;
        total += expected;
        if expected != packed[2] || expected > (packed[1] + 1) * MAX_RATIO || total > MAX_BYTES {
            return Err(field_error(
                &field,
                format!(
                    "has {} bytes of samples, but counts {before} samples",
                    packed[2]
                ),
            ));
        }
    }
    let mut offsets = Vec::with_capacity(counts.len() + 1);
    let mut sum = 0u32;
    offsets.push(0);
    for count in counts {
        sum = sum
            .checked_add(count)
            .ok_or_else(|| field_error("the counts of samples", "add up to more than 2^32"))?;
        offsets.push(sum);
    }
    // The values, and the samples of the cube LDI or the frame that they become.
    let _sample_memory = reserve(
        "the samples",
        u64::from(sum) * (4 * channels.len() as u64 + 16),
    )?;
    let mut read: Vec<DeepChannel> = channels
        .iter()
        .map(|(name, kind)| DeepChannel {
            name: name.clone(),
            kind: *kind,
            values: Vec::with_capacity(sum as usize),
        })
        .collect();
    for (row, (packed, length)) in rows.into_iter().enumerate() {
        let field = || format!("scanline {}", i64::from(header.origin_px[1]) + row as i64);
        let data = compression
            .unpack(packed, length as usize)
            .map_err(|cause| field_error(&field(), cause))?;
        let samples = (offsets[(row + 1) * width] - offsets[row * width]) as usize;
        let mut rest = data.as_slice();
        for channel in &mut read {
            let (own, after) = rest.split_at(samples * channel.kind.bytes());
            header::take_values(channel.kind, own, &mut channel.values);
            rest = after;
        }
    }
    Ok(DeepImage {
        size_px: header.size_px,
        origin_px: header.origin_px,
        stored_px,
        offsets,
        channels: read,
        view: header.view,
    })
}
