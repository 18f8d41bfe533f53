//! Channels of flat EXR files, selected by name: files of renderers and compositors have several
//! parts, and channels whose names carry those of a view layer and a pass, such as
//! `ViewLayer.Combined.R` and `ViewLayer.Depth.Z`.
//!
//! The picture is the display window: samples outside of it are left out, and those that the data
//! window lacks are 0. Deep parts are left out; `headbox-images` reads them.

#[cfg(test)]
mod tests;

use super::codec::{self, MAX_PIXELS, PictureError};
use crate::memory::{self, Reservation};
use exr::block;
use exr::block::reader::ChunksReader;
use exr::meta::MetaData;
use exr::meta::attribute::{Chromaticities, SampleType};
use exr::meta::header::Header;
use exr::prelude::f16;
use glam::{DMat3, DVec3, Vec3};
use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::path::Path;

/// Gets the position of a channel, the column and the row of the first sample, and the samples.
pub type RowVisitor<'a> = dyn FnMut(usize, [usize; 2], &[f32]) + 'a;

/// Number of pixels from which decoding one image on several threads is worth it; smaller images
/// are decoded in parallel with each other.
const PARALLEL_PIXELS: usize = 1 << 22;

/// Number of channels that messages name.
const NAMED: usize = 12;

/// A flat part of an EXR file, by its header.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrPart {
    /// Index among all parts of the file.
    index: usize,
    /// Name, if it has any.
    name: Option<String>,
    /// Width and height of its picture, pixels.
    pub size_px: [u32; 2],
    /// Column and row of the picture that has the first sample.
    data_start: [i64; 2],
    /// Width and height of its data, pixels.
    data_size: [usize; 2],
    /// Conversion of its colours to the primaries of Rec. 709, if they have others.
    rec709_from_file: Option<DMat3>,
    /// Names of the channels in the file's order.
    channels: Vec<String>,
    /// True for each channel of half floats.
    halves: Vec<bool>,
}

/// A channel of an EXR file: part and channel, as indices into the list of parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExrChannel {
    part: usize,
    channel: usize,
}

/// Headers of the flat parts of an EXR file.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrParts(Vec<ExrPart>);

impl ExrPart {
    fn new(index: usize, header: &Header) -> Self {
        let channels = &header.channels.list;
        let shared = &header.shared_attributes;
        let [data, display] = [
            (header.own_attributes.layer_position, header.layer_size),
            (shared.display_window.position, shared.display_window.size),
        ]
        .map(|(start, size)| {
            let start = [start.x(), start.y()].map(i64::from);
            (start, [size.x(), size.y()])
        });
        let overlaps = (0..2).all(|k| {
            let end = |(start, size): ([i64; 2], [usize; 2])| start[k] + size[k] as i64;
            data.0[k] < end(display) && display.0[k] < end(data)
        });
        let picture = if overlaps { display } else { data };
        let name = header.own_attributes.layer_name.as_ref();
        Self {
            index,
            name: name.map(ToString::to_string),
            size_px: picture.1.map(|side| side as u32),
            data_start: std::array::from_fn(|k| data.0[k] - picture.0[k]),
            data_size: data.1,
            rec709_from_file: shared.chromaticities.as_ref().and_then(rec709_from),
            channels: channels.iter().map(|it| it.name.to_string()).collect(),
            halves: channels
                .iter()
                .map(|it| it.sample_type == SampleType::F16)
                .collect(),
        }
    }

    /// Returns true if the data window covers the picture.
    fn is_complete(&self) -> bool {
        (0..2).all(|k| {
            let end = self.data_start[k] + self.data_size[k] as i64;
            self.data_start[k] <= 0 && end >= i64::from(self.size_px[k])
        })
    }

    /// Returns the column and the row in the picture of samples of a row of the data, and the range
    /// of those inside the picture; `None` if there are none.
    fn place(&self, [x, y]: [usize; 2], count: usize) -> Option<([usize; 2], Range<usize>)> {
        let [width, height] = self.size_px.map(i64::from);
        let left = self.data_start[0] + x as i64;
        let row = self.data_start[1] + y as i64;
        let start = left.max(0);
        let end = (left + count as i64).min(width);
        let is_inside = start < end && (0..height).contains(&row);
        is_inside.then(|| {
            let samples = (start - left) as usize..(end - left) as usize;
            ([start as usize, row as usize], samples)
        })
    }
}

/// Returns the conversion of linear RGB of these primaries and white to those of Rec. 709, adapted
/// to the white (Bradford); `None` if they are the same or degenerate.
fn rec709_from(file: &Chromaticities) -> Option<DMat3> {
    const REC709: [[f64; 2]; 4] = [[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.3127, 0.329]];
    const ROUNDING: f64 = 1e-3;
    let bradford = DMat3::from_cols_array_2d(&[
        [0.8951, -0.7502, 0.0389],
        [0.2664, 1.7135, -0.0685],
        [-0.1614, 0.0367, 1.0296],
    ]);
    let of_file = [file.red, file.green, file.blue, file.white]
        .map(|point| [point.x(), point.y()].map(f64::from));
    let mut pairs = of_file.as_flattened().iter().zip(REC709.as_flattened());
    if pairs.all(|(a, b)| (a - b).abs() < ROUNDING) {
        return None;
    }
    let xyz_from_rgb = |points: [[f64; 2]; 4]| {
        let [r, g, b, white] = points.map(|[x, y]| DVec3::new(x, y, 1.0 - x - y) / y);
        let unscaled = DMat3::from_cols(r, g, b);
        (
            unscaled * DMat3::from_diagonal(unscaled.inverse() * white),
            bradford * white,
        )
    };
    let (xyz_from_file, file_white) = xyz_from_rgb(of_file);
    let (xyz_from_rec709, rec709_white) = xyz_from_rgb(REC709);
    let adapt = DMat3::from_diagonal(rec709_white / file_white);
    let matrix = xyz_from_rec709.inverse() * bradford.inverse() * adapt * bradford * xyz_from_file;
    matrix.is_finite().then_some(matrix)
}

impl ExrParts {
    /// Reads the headers.
    ///
    /// # Errors
    /// [`PictureError`], also if no part is flat, or one has more than [`MAX_PIXELS`].
    pub fn read(path: &Path) -> Result<Self, PictureError> {
        let meta = codec::read_exr(|| MetaData::read_from_file(path, false))?;
        let flat = meta.headers.iter().enumerate().filter(|(_, it)| !it.deep);
        let parts: Vec<ExrPart> = flat
            .map(|(index, header)| ExrPart::new(index, header))
            .collect();
        if parts.is_empty() {
            return Err(PictureError::Malformed("the EXR has no flat part".into()));
        }
        for part in &parts {
            for [width, height] in [part.size_px, part.data_size.map(|side| side as u32)] {
                if u64::from(width) * u64::from(height) > MAX_PIXELS {
                    return Err(PictureError::TooLarge { width, height });
                }
            }
        }
        Ok(Self(parts))
    }

    /// Width and height of the picture of a channel's part, pixels.
    pub fn size_px(&self, of: ExrChannel) -> [u32; 2] {
        self.0[of.part].size_px
    }

    /// Width and height of the first part, pixels.
    pub fn first_size_px(&self) -> [u32; 2] {
        self.0[0].size_px
    }

    /// Returns true if a channel has half floats.
    pub fn is_half(&self, of: ExrChannel) -> bool {
        self.0[of.part].halves[of.channel]
    }

    /// Name of a channel, after that of its part if there are several.
    pub fn name(&self, of: ExrChannel) -> String {
        let part = &self.0[of.part];
        let channel = &part.channels[of.channel];
        match &part.name {
            Some(name) if self.0.len() > 1 => format!("{name}.{channel}"),
            _ => channel.clone(),
        }
    }

    /// Names of the channels, at most a dozen, for messages.
    pub fn describe(&self) -> String {
        let all: Vec<String> = self.all().map(|channel| self.name(channel)).collect();
        let rest = all.len().saturating_sub(NAMED);
        let named = all[..all.len() - rest].join(", ");
        if rest > 0 {
            format!("{named} and {rest} more")
        } else {
            named
        }
    }

    fn all(&self) -> impl Iterator<Item = ExrChannel> {
        let parts = self.0.iter().enumerate();
        parts.flat_map(|(part, it)| {
            (0..it.channels.len()).map(move |channel| ExrChannel { part, channel })
        })
    }

    /// Finds a channel by its own name, or by its name after that of its part; the first part that
    /// has it.
    pub fn find(&self, name: &str) -> Option<ExrChannel> {
        let is_own = |it: &ExrChannel| self.0[it.part].channels[it.channel] == name;
        self.all()
            .find(is_own)
            .or_else(|| self.all().find(|it| self.name(*it) == name))
    }

    /// Channel with depth: `Z` of any part; else one named after depth, in any layer; else `Y`,
    /// `R` or the only channel of the first part. `None` if there is none of them.
    ///
    /// `Z` of a layer that also has `X` is a coordinate of a vector. Mist, a share of fog, is not
    /// depth.
    pub fn depth(&self) -> Option<ExrChannel> {
        let first = |name: &str| {
            let channel = self.0[0].channels.iter().position(|it| it == name)?;
            Some(ExrChannel { part: 0, channel })
        };
        let named = |rank: u32| self.all().find(|it| self.depth_rank(*it) == Some(rank));
        let only = || {
            let is_alone = self.0[0].channels.len() == 1;
            let first = ExrChannel {
                part: 0,
                channel: 0,
            };
            (is_alone && !self.is_mist(first)).then_some(first)
        };
        let is_depth = |it: &ExrChannel| self.depth_rank(*it).is_some();
        first("Z")
            .filter(is_depth)
            .or_else(|| (0..DEPTH_RANKS).find_map(named))
            .or_else(|| first("Y").filter(|it| !self.is_vector(*it)))
            .or_else(|| first("R"))
            .or_else(only)
    }

    /// Returns true if a channel's layer also has `X`: it is a coordinate.
    fn is_vector(&self, of: ExrChannel) -> bool {
        let name = &self.0[of.part].channels[of.channel];
        let layer = name.rfind('.').map_or("", |dot| &name[..=dot]);
        self.find_in(of.part, &format!("{layer}X")).is_some()
    }

    fn is_mist(&self, of: ExrChannel) -> bool {
        self.full_name(of).split('.').any(|word| word == "mist")
    }

    /// Rank of a channel among those with depth, best first; `None` if it is not one.
    fn depth_rank(&self, of: ExrChannel) -> Option<u32> {
        let full = self.full_name(of);
        let (layer, last) = full.rsplit_once('.').unwrap_or(("", &full));
        let is_depth = |word: &str| word.contains("depth") || word == "z";
        let layer_is_depth = layer.split('.').any(is_depth);
        let rank = match last {
            "z" if self.is_vector(of) => return None,
            "z" if layer_is_depth => 0,
            "z" => 1,
            _ if is_depth(last) => 2,
            "v" | "y" | "d" if layer_is_depth => 3,
            "r" if layer_is_depth => 4,
            _ => return None,
        };
        // The depth that denoisers use is that behind mirrors and glass.
        let rank = if full.contains("denois") { 5 } else { rank };
        (!self.is_mist(of)).then_some(rank)
    }

    /// Name of a channel after that of its part, in lower case.
    fn full_name(&self, of: ExrChannel) -> String {
        let part = &self.0[of.part];
        let channel = &part.channels[of.channel];
        let name = part.name.as_ref().filter(|_| self.0.len() > 1);
        name.map_or_else(|| channel.clone(), |name| format!("{name}.{channel}"))
            .to_lowercase()
    }

    /// Channels of the same layer as `of`, if it is its red one and they are green and blue.
    pub fn green_and_blue(&self, of: ExrChannel) -> Option<[ExrChannel; 2]> {
        let name = &self.0[of.part].channels[of.channel];
        let layer = name.strip_suffix(['R', 'r'])?;
        let find = |letter: &str| self.find_in(of.part, &format!("{layer}{letter}"));
        Some([find("G")?, find("B")?])
    }

    /// Red, green, blue and, if there is one, alpha of the picture: those without a layer or in a
    /// part without a name; else those of a layer or part, first of one with the usual name of the
    /// finished picture; else the only grey channel.
    pub fn color(&self) -> Option<[Option<ExrChannel>; 4]> {
        let reds = self.all().filter_map(|red| {
            let [green, blue] = self.green_and_blue(red)?;
            let name = &self.0[red.part].channels[red.channel];
            let layer = &name[..name.len() - 1];
            let alpha = self.find_in(red.part, &format!("{layer}A"));
            let full = self.full_name(red);
            let rank = if full == "r" {
                u32::from(name != "R")
            } else if full.split('.').any(|word| FINISHED.contains(&word)) {
                2
            } else if layer.is_empty() {
                3
            } else {
                4
            };
            Some((rank, [Some(red), Some(green), Some(blue), alpha]))
        });
        if let Some((_, found)) = reds.min_by_key(|(rank, _)| *rank) {
            return Some(found);
        }
        let grey = self.all().find(|it| {
            let channels = &self.0[it.part].channels;
            let is_chroma = |name: &String| name == "RY" || name == "BY";
            channels[it.channel] == "Y" && !channels.iter().any(is_chroma) && !self.is_vector(*it)
        })?;
        let alpha = self.find_in(grey.part, "A");
        Some([Some(grey), Some(grey), Some(grey), alpha])
    }

    fn find_in(&self, part: usize, name: &str) -> Option<ExrChannel> {
        let mut channels = self.0[part].channels.iter();
        let channel = channels.position(|it| it.eq_ignore_ascii_case(name))?;
        Some(ExrChannel { part, channel })
    }

    /// Reserves memory for the pixels of a channel's part.
    ///
    /// # Errors
    /// [`PictureError`] if they do not fit the budget.
    pub fn reserve(
        &self,
        of: ExrChannel,
        bytes_per_pixel: u64,
    ) -> Result<Reservation, PictureError> {
        let [width, height] = self.size_px(of);
        let pixels = u64::from(width) * u64::from(height);
        Ok(memory::reserve(bytes_per_pixel * pixels)?)
    }

    /// Converts linear colours of a channel's part to the primaries of Rec. 709. Those that are not
    /// finite stay: products with infinity would not be numbers.
    pub fn convert_to_rec709<'a>(
        &self,
        of: ExrChannel,
        colors: impl Iterator<Item = &'a mut [f32; 3]>,
    ) {
        let Some(matrix) = self.0[of.part].rec709_from_file else {
            return;
        };
        let matrix = matrix.as_mat3();
        for color in colors.filter(|it| it.iter().all(|c| c.is_finite())) {
            *color = (matrix * Vec3::from(*color)).to_array();
        }
    }

    /// Decodes channels of one part. `on_row` gets the position of a channel in `channels`, the
    /// column and the row of the first sample, and samples of that row. Where the file has none, it
    /// gets zeros first.
    ///
    /// # Errors
    /// [`PictureError`].
    pub fn decode(
        &self,
        path: &Path,
        channels: &[ExrChannel],
        on_row: &mut RowVisitor,
    ) -> Result<(), PictureError> {
        let Some(first) = channels.first() else {
            return Ok(());
        };
        let part = &self.0[first.part];
        if !part.is_complete() {
            let [width, height] = part.size_px.map(|side| side as usize);
            let zeros = vec![0.0; width];
            for k in 0..channels.len() {
                (0..height).for_each(|y| on_row(k, [0, y], &zeros));
            }
        }
        codec::read_exr(|| {
            let reader = block::read(BufReader::new(File::open(path)?), false)?;
            let chunks = reader.filter_chunks(false, |_, tile, block| {
                block.layer == part.index && tile.is_largest_resolution_level()
            })?;
            let mut row = Vec::new();
            let mut insert = |meta: &MetaData, block: block::UncompressedBlock| {
                let header = &meta.headers[block.index.layer];
                for line in block.lines(&header.channels) {
                    let mut wanted = (0..channels.len())
                        .filter(|&k| channels[k].channel == line.location.channel)
                        .peekable();
                    if wanted.peek().is_none() {
                        continue;
                    }
                    row.clear();
                    match header.channels.list[line.location.channel].sample_type {
                        SampleType::F16 => {
                            for sample in line.read_samples::<f16>() {
                                row.push(sample?.to_f32());
                            }
                        }
                        SampleType::F32 => {
                            for sample in line.read_samples::<f32>() {
                                row.push(sample?);
                            }
                        }
                        SampleType::U32 => {
                            for sample in line.read_samples::<u32>() {
                                row.push(sample? as f32);
                            }
                        }
                    }
                    let position = line.location.position;
                    let placed = part.place([position.x(), position.y()], row.len());
                    let Some((start, inside)) = placed else {
                        continue;
                    };
                    for k in wanted {
                        on_row(k, start, &row[inside.clone()]);
                    }
                }
                Ok(())
            };
            if part.data_size.iter().product::<usize>() < PARALLEL_PIXELS {
                chunks.decompress_sequential(false, &mut insert)
            } else {
                chunks.decompress_parallel(false, &mut insert)
            }
        })
    }

    /// Decodes one channel, row-major.
    ///
    /// # Errors
    /// See [`Self::decode`].
    pub fn decode_one(&self, path: &Path, channel: ExrChannel) -> Result<Vec<f32>, PictureError> {
        let _memory = self.reserve(channel, 4)?;
        let [width, height] = self.size_px(channel);
        let width = width as usize;
        let mut samples = vec![0.0; width * height as usize];
        self.decode(path, &[channel], &mut |_, [x, y], row| {
            let start = y * width + x;
            samples[start..start + row.len()].copy_from_slice(row);
        })?;
        Ok(samples)
    }
}

/// Number of ranks of channels with depth.
const DEPTH_RANKS: u32 = 6;

/// Names of the finished picture among the layers of renderers.
const FINISHED: [&str; 8] = [
    "combined",
    "composite",
    "beauty",
    "rgba",
    "rgb",
    "color",
    "image",
    "final",
];
