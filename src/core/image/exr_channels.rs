//! Channels of flat EXR files, selected by name: files of renderers and compositors have several
//! parts, and channels whose names carry those of a view layer and a pass, such as
//! `ViewLayer.Combined.R` and `ViewLayer.Depth.Z`.
//!
//! Deep parts are left out; `headbox-images` reads them.

use super::codec::{self, MAX_PIXELS, PictureError};
use crate::memory::{self, Reservation};
use exr::block;
use exr::block::reader::ChunksReader;
use exr::meta::MetaData;
use exr::meta::attribute::SampleType;
use exr::prelude::f16;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Gets the position of a channel, the column and the row of the first sample, and the samples.
pub type RowVisitor<'a> = dyn FnMut(usize, [usize; 2], &[f32]) + 'a;

/// Number of pixels from which decoding one image on several threads is worth it; smaller images
/// are decoded in parallel with each other.
const PARALLEL_PIXELS: usize = 1 << 22;

/// Number of channels that messages name.
const NAMED: usize = 12;

/// A flat part of an EXR file, by its header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExrPart {
    /// Index among all parts of the file.
    index: usize,
    /// Name, if it has any.
    name: Option<String>,
    /// Width and height of its data, pixels.
    pub size_px: [u32; 2],
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
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExrParts(Vec<ExrPart>);

impl ExrParts {
    /// Reads the headers.
    ///
    /// # Errors
    /// [`PictureError`], also if no part is flat.
    pub fn read(path: &Path) -> Result<Self, PictureError> {
        let meta = codec::read_exr(|| MetaData::read_from_file(path, false))?;
        let flat = meta.headers.iter().enumerate().filter(|(_, it)| !it.deep);
        let parts: Vec<ExrPart> = flat
            .map(|(index, header)| ExrPart {
                index,
                name: header
                    .own_attributes
                    .layer_name
                    .as_ref()
                    .map(ToString::to_string),
                size_px: [header.layer_size.x(), header.layer_size.y()].map(|side| side as u32),
                channels: header
                    .channels
                    .list
                    .iter()
                    .map(|it| it.name.to_string())
                    .collect(),
                halves: header
                    .channels
                    .list
                    .iter()
                    .map(|it| it.sample_type == SampleType::F16)
                    .collect(),
            })
            .collect();
        if parts.is_empty() {
            return Err(PictureError::Malformed("the EXR has no flat part".into()));
        }
        Ok(Self(parts))
    }

    /// Width and height of the data of a channel's part, pixels.
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
    /// `Z` of a layer that also has `X` is a coordinate of a vector.
    pub fn depth(&self) -> Option<ExrChannel> {
        let first = |name: &str| {
            let channel = self.0[0].channels.iter().position(|it| it == name)?;
            Some(ExrChannel { part: 0, channel })
        };
        let named = |rank: u32| self.all().find(|it| self.depth_rank(*it) == Some(rank));
        let only = || {
            (self.0[0].channels.len() == 1).then_some(ExrChannel {
                part: 0,
                channel: 0,
            })
        };
        let is_depth = |it: &ExrChannel| self.depth_rank(*it).is_some();
        first("Z")
            .filter(is_depth)
            .or_else(|| (0..DEPTH_RANKS).find_map(named))
            .or_else(|| first("Y"))
            .or_else(|| first("R"))
            .or_else(only)
    }

    /// Rank of a channel among those with depth, best first; `None` if it is not one.
    fn depth_rank(&self, of: ExrChannel) -> Option<u32> {
        let full = self.full_name(of);
        let (layer, last) = full.rsplit_once('.').unwrap_or(("", &full));
        let mut siblings = self.all().map(|it| self.full_name(it));
        let is_vector = siblings.any(|it| it.rsplit_once('.').unwrap_or(("", &it)) == (layer, "x"));
        let is_depth = |word: &str| word.contains("depth") || word == "z";
        let layer_is_depth = layer.split('.').any(is_depth);
        match last {
            "z" if !is_vector && layer_is_depth => Some(0),
            "z" if !is_vector => Some(1),
            _ if is_depth(last) && last != "z" => Some(2),
            "v" | "y" | "d" if layer_is_depth => Some(3),
            "r" if layer_is_depth => Some(4),
            _ => None,
        }
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

    /// Red, green, blue and, if there is one, alpha of the picture: those named so; else those of a
    /// layer, first of one with the usual name of the finished picture; else the only grey channel.
    pub fn color(&self) -> Option<[Option<ExrChannel>; 4]> {
        let reds = self.all().filter_map(|red| {
            let [green, blue] = self.green_and_blue(red)?;
            let name = &self.0[red.part].channels[red.channel];
            let layer = &name[..name.len() - 1];
            let alpha = self.find_in(red.part, &format!("{layer}A"));
            let rank = if name == "R" {
                0
            } else if layer.is_empty() {
                1
            } else {
                let full = self.full_name(red);
                let words: Vec<&str> = full.split('.').collect();
                let is_finished = words.iter().any(|word| FINISHED.contains(word));
                if is_finished { 2 } else { 3 }
            };
            Some((rank, [Some(red), Some(green), Some(blue), alpha]))
        });
        if let Some((_, found)) = reds.min_by_key(|(rank, _)| *rank) {
            return Some(found);
        }
        let grey = self.find("Y").filter(|it| {
            let channels = &self.0[it.part].channels;
            !channels
                .iter()
                .any(|name| ["RY", "BY"].contains(&name.as_str()))
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
    /// [`PictureError`] if it has more than [`MAX_PIXELS`], or they do not fit the budget.
    pub fn reserve(
        &self,
        of: ExrChannel,
        bytes_per_pixel: u64,
    ) -> Result<Reservation, PictureError> {
        let [width, height] = self.size_px(of);
        let pixels = u64::from(width) * u64::from(height);
        if pixels > MAX_PIXELS {
            return Err(PictureError::TooLarge { width, height });
        }
        Ok(memory::reserve(bytes_per_pixel * pixels)?)
    }

    /// Decodes channels of one part. `on_row` gets the position of a channel in `channels`, the
    /// column and the row of the first sample, and samples of that row.
    ///
    /// # Errors
    /// [`PictureError`], also if a part has more than [`MAX_PIXELS`] pixels.
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
        let [width, height] = part.size_px;
        if u64::from(width) * u64::from(height) > MAX_PIXELS {
            return Err(PictureError::TooLarge { width, height });
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
                    for k in wanted {
                        on_row(k, [position.x(), position.y()], &row);
                    }
                }
                Ok(())
            };
            if (width as usize * height as usize) < PARALLEL_PIXELS {
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
const DEPTH_RANKS: u32 = 5;

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

#[cfg(test)]
mod tests {
    use super::*;

    fn parts(of: &[(Option<&str>, &[&str])]) -> ExrParts {
        let part = |(index, (name, channels)): (usize, &(Option<&str>, &[&str]))| ExrPart {
            index,
            name: name.map(str::to_owned),
            size_px: [4, 2],
            channels: channels.iter().map(|&name| name.to_owned()).collect(),
            halves: vec![false; channels.len()],
        };
        ExrParts(of.iter().enumerate().map(part).collect())
    }

    fn depth_name(of: &[(Option<&str>, &[&str])]) -> Option<String> {
        let parts = parts(of);
        parts.depth().map(|channel| parts.name(channel))
    }

    #[test]
    fn depth_channel_found_by_any_name() {
        let combined = [
            "ViewLayer.Combined.A",
            "ViewLayer.Combined.B",
            "ViewLayer.Combined.G",
            "ViewLayer.Combined.R",
        ];
        let normal = [
            "ViewLayer.Normal.X",
            "ViewLayer.Normal.Y",
            "ViewLayer.Normal.Z",
        ];
        let with = |more: &[&'static str]| [combined.as_slice(), more, &normal].concat();
        for name in [
            "ViewLayer.Depth.Z",
            "depth.V",
            "Depth.R",
            "ViewLayer.Depth.V",
            "depth",
            "ZDepth",
            "depth.Y",
        ] {
            assert_eq!(depth_name(&[(None, &with(&[name]))]).as_deref(), Some(name));
        }
        assert_eq!(depth_name(&[(None, &with(&[]))]), None);
        assert_eq!(
            depth_name(&[(None, &["A", "B", "G", "R", "Z"])]).as_deref(),
            Some("Z")
        );
        assert_eq!(
            depth_name(&[(None, &["B", "G", "R"])]).as_deref(),
            Some("R")
        );
        assert_eq!(
            depth_name(&[(None, &["B", "G", "R", "zdepth"])]).as_deref(),
            Some("zdepth")
        );
        assert_eq!(depth_name(&[(None, &["V"])]).as_deref(), Some("V"));
        let several: &[(Option<&str>, &[&str])] = &[
            (Some("rgba"), &["A", "B", "G", "R"]),
            (Some("depth"), &["Z"]),
        ];
        assert_eq!(depth_name(several).as_deref(), Some("depth.Z"));
        let several: &[(Option<&str>, &[&str])] = &[
            (Some("rgba"), &["A", "B", "G", "R"]),
            (Some("normal"), &["X", "Y", "Z"]),
            (Some("depth"), &["R"]),
        ];
        assert_eq!(depth_name(several).as_deref(), Some("depth.R"));
    }

    #[test]
    fn color_channels_found_by_any_name() {
        let names = |of: &[(Option<&str>, &[&str])]| {
            let parts = parts(of);
            let found = parts.color()?;
            Some(
                found
                    .map(|it| it.map_or_else(|| "-".into(), |it| parts.name(it)))
                    .join(" "),
            )
        };
        let found = |of: &[(Option<&str>, &[&str])]| names(of).unwrap_or_default();
        assert_eq!(found(&[(None, &["A", "B", "G", "R"])]), "R G B A");
        assert_eq!(found(&[(None, &["b", "g", "r"])]), "r g b -");
        assert_eq!(found(&[(None, &["Y"])]), "Y Y Y -");
        let layers = [
            "L.Diffuse.B",
            "L.Diffuse.G",
            "L.Diffuse.R",
            "L.Combined.A",
            "L.Combined.B",
            "L.Combined.G",
            "L.Combined.R",
        ];
        assert_eq!(
            found(&[(None, &layers)]),
            "L.Combined.R L.Combined.G L.Combined.B L.Combined.A"
        );
        let several: &[(Option<&str>, &[&str])] =
            &[(Some("z"), &["Z"]), (Some("rgba"), &["B", "G", "R"])];
        assert_eq!(found(several), "rgba.R rgba.G rgba.B -");
        assert_eq!(names(&[(None, &["BY", "RY", "Y"])]), None);
        assert_eq!(names(&[(None, &["Z"])]), None);
    }
}
