//! Channels of a flat EXR by name.

use super::ImagesError;
use exr::image::{AnyChannel, FlatSamples};
use exr::meta::MetaData;
use exr::prelude::{ReadChannels, ReadLayers, read};
use headbox_core::image::codec::{self, MAX_PIXELS};
use std::path::Path;

/// Number of pixels from which decoding one image on several threads is worth it; smaller images
/// are decoded in parallel with each other.
const PARALLEL_PIXELS: usize = 1 << 22;

/// First flat layer of an EXR.
pub(super) struct ExrLayer {
    pub(super) width: u32,
    pub(super) height: u32,
    channels: Vec<AnyChannel<FlatSamples>>,
}

impl ExrLayer {
    /// Reads the layer.
    ///
    /// # Errors
    /// [`ImagesError`] that names the file.
    pub(super) fn read(path: &Path) -> Result<Self, ImagesError> {
        let failed = |error| ImagesError::picture(path, error);
        let meta = codec::read_exr(|| MetaData::read_from_file(path, false)).map_err(failed)?;
        let pixels = meta
            .headers
            .iter()
            .map(|header| header.layer_size.area())
            .max()
            .unwrap_or(0);
        if pixels as u64 > MAX_PIXELS {
            let cause = format!("has more than {MAX_PIXELS} pixels");
            return Err(ImagesError::invalid_picture(path, cause));
        }
        let reader = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes();
        let reader = if pixels < PARALLEL_PIXELS {
            reader.non_parallel()
        } else {
            reader
        };
        let image = codec::read_exr(|| reader.from_file(path)).map_err(failed)?;
        let layer = image.layer_data;
        let size = layer.size;
        Ok(Self {
            width: size.x() as u32,
            height: size.y() as u32,
            channels: layer.channel_data.list.into_vec(),
        })
    }

    /// Returns the samples of a channel, row-major.
    pub(super) fn channel(&self, name: &str) -> Option<&FlatSamples> {
        self.channels
            .iter()
            .find(|channel| channel.name == *name)
            .map(|channel| &channel.sample_data)
    }

    /// Returns the samples of the channel if there is exactly one.
    pub(super) fn only_channel(&self) -> Option<&FlatSamples> {
        match &self.channels[..] {
            [channel] => Some(&channel.sample_data),
            _ => None,
        }
    }
}
