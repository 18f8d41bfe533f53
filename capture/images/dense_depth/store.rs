//! Estimated depth in files next to a set's images.
//!
//! A folder `headbox-depth` in the set's folder contains an image for each view (OpenEXR, channels
//! `Z`: eye depth in metres, 0 where unknown, and `confidence`) and `index.json`, written last,
//! which maps views to images with a fingerprint of the view's camera, so that depth estimated for
//! other cameras is not used.

use super::EstimatedDepth;
use crate::depth::DepthSource;
use crate::readers::json;
use crate::{ImageSet, ImagesError, Lens, View, resolve};
use exr::prelude::{Encoding, Image, LineOrder, SpecificChannels, WritableImage};
use headbox_core::depth_kind::DepthKind;
use headbox_core::files::{self, InputFolder, StagingFolder};
use headbox_core::random::hash;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::io;
use std::path::{Component, Path, PathBuf};

/// Folder name, next to a set's images.
const FOLDER: &str = "headbox-depth";

/// File name of the index.
const INDEX: &str = "index.json";

/// Version of the index.
const VERSION: u64 = 1;

/// Writer of a set's estimated depth: into a temporary folder next to the images, whose files move
/// to their place at the end, so that a search that fails leaves nothing behind.
pub(super) struct DepthStore {
    folder: PathBuf,
    staging: StagingFolder,
    entries: Map<String, Value>,
    written: BTreeMap<PathBuf, String>,
}

impl DepthStore {
    /// Creates the temporary folder next to a set's images.
    pub(super) fn create(set: &ImageSet) -> Result<Self, ImagesError> {
        let folder = set.folder.join(FOLDER);
        // Checked before the search, which takes long.
        files::refuse_links(&folder, &folder.join(INDEX))
            .and_then(|()| files::check_folder(&folder))
            .map_err(|cause| ImagesError::write(&folder, cause))?;
        let staging = StagingFolder::create_in(&set.folder)
            .map_err(|cause| ImagesError::write(&set.folder, cause))?;
        // Keeps the entries of other views from earlier runs.
        let entries = match read_index(&folder)?.map(|mut index| index["views"].take()) {
            Some(Value::Object(views)) => views,
            _ => Map::new(),
        };
        Ok(Self {
            folder,
            staging,
            entries,
            written: BTreeMap::new(),
        })
    }

    /// Folder of the temporary files.
    pub(super) fn staging_folder(&self) -> &Path {
        self.staging.path()
    }

    /// Writes the depth of a view.
    pub(super) fn add(
        &mut self,
        view: &View,
        estimated: &EstimatedDepth,
    ) -> Result<(), ImagesError> {
        let file = depth_file_name(&view.name);
        let path = self.staging.path().join(&file);
        if let Some(other) = self.written.insert(file.clone(), view.name.clone()) {
            let cause = format!(
                "is also the name of {other}; rename one of them to store the depth of both"
            );
            return Err(ImagesError::Field {
                path,
                field: format!("the name of {}", view.name),
                cause,
            });
        }
        write_exr(&path, estimated).map_err(|cause| ImagesError::write(&path, cause))?;
        let entry = json!({
            "file": file.to_string_lossy(), "camera": fingerprint(view), "deviation": estimated.deviation,
        });
        self.entries.insert(view.name.clone(), entry);
        Ok(())
    }

    /// Moves the files to their place and writes the index, which makes them part of the set.
    pub(super) fn finish(self) -> Result<(), ImagesError> {
        for file in self.written.keys() {
            let to = self.folder.join(file);
            let folder = to.parent().unwrap_or(&self.folder);
            files::refuse_links(&self.folder, &to)
                .and_then(|()| std::fs::create_dir_all(folder))
                .and_then(|()| std::fs::rename(self.staging.path().join(file), &to))
                .map_err(|cause| ImagesError::write(&to, cause))?;
        }
        let index = json!({"version": VERSION, "views": self.entries});
        let path = self.folder.join(INDEX);
        files::write_whole(&path, |writer| {
            serde_json::to_writer_pretty(writer, &index).map_err(io::Error::other)
        })
        .map_err(|cause| ImagesError::write(&path, cause))
    }
}

fn write_exr(path: &Path, estimated: &EstimatedDepth) -> io::Result<()> {
    let [width, height] = estimated.view.size_px.map(|side| side as usize);
    let depth = &estimated.view.depth;
    let pixel = |position: exr::math::Vec2<usize>| {
        let i = position.y() * width + position.x();
        let known = depth
            .get(i)
            .copied()
            .filter(|depth| depth.is_finite())
            .unwrap_or(0.0);
        (known, exr::prelude::f16::from_f32(estimated.confidence[i]))
    };
    let channels = SpecificChannels::build()
        .with_channel("Z")
        .with_channel("confidence")
        .with_pixel_fn(pixel);
    // Blocks in a fixed order, so that the bytes do not depend on threads.
    let encoding = Encoding {
        line_order: LineOrder::Increasing,
        ..Encoding::SMALL_FAST_LOSSLESS
    };
    let image = Image::from_encoded_channels((width, height), encoding, channels);
    files::write_whole(path, |writer| {
        image.write().to_buffered(writer).map_err(io::Error::other)
    })
}

/// Returns a relative path for a view's name that stays inside the folder.
fn depth_file_name(name: &str) -> PathBuf {
    let normal = Path::new(name).components().filter_map(|part| match part {
        Component::Normal(part) => Some(part),
        _ => None,
    });
    let mut file = normal.collect::<PathBuf>().into_os_string();
    file.push(".exr");
    file.into()
}

/// Returns a hash of a view's camera: image size, lens and pose.
fn fingerprint(view: &View) -> String {
    let mut numbers: Vec<f64> = view.size_px.map(f64::from).to_vec();
    if let Lens::Pinhole(lens) = view.lens {
        numbers.extend(lens.focal_px.into_iter().chain(lens.principal_px));
        numbers.extend(
            lens.distortion
                .radial
                .into_iter()
                .chain(lens.distortion.tangential),
        );
    }
    numbers.extend(view.pose.eye.to_array());
    numbers.extend(view.pose.world_from_eye.to_cols_array());
    if let Some(source) = &view.source {
        let text = format!("{source:?}");
        numbers.extend(text.bytes().map(f64::from));
    }
    // Adding 0.0 makes -0.0 equal to 0.0.
    let hash = numbers
        .iter()
        .fold(0, |sum, number| hash(sum ^ (number + 0.0).to_bits()));
    format!("{hash:016x}")
}

fn read_index(folder: &Path) -> Result<Option<Value>, ImagesError> {
    let path = folder.join(INDEX);
    if !path.is_file() {
        return Ok(None);
    }
    let index = json::read(&InputFolder::new(folder), &path)?;
    match index["version"].as_u64() {
        Some(VERSION) => Ok(Some(index)),
        _ => Err(ImagesError::field(
            &path,
            "version",
            format!("is not {VERSION}: remove the folder and estimate depth again"),
        )),
    }
}

/// Attaches the stored depth to views without depth, with a note.
pub(crate) fn attach(set: &mut ImageSet) -> Result<(), ImagesError> {
    let folder = set.folder.join(FOLDER);
    if let Err(link) = files::refuse_links(&folder, &folder.join(INDEX)) {
        let note = format!("estimated depth is not used: {link}");
        set.notes.push(note.into());
        return Ok(());
    }
    let Some(index) = read_index(&folder)? else {
        return Ok(());
    };
    let path = folder.join(INDEX);
    let estimates = InputFolder::new(&folder);
    let mut attached = 0;
    let mut outdated = 0;
    for view in &mut set.views {
        let entry = &index["views"][&view.name];
        if entry.is_null() || view.depth.is_some() {
            continue;
        }
        let bad = |field: &str, cause: &str| {
            ImagesError::field(&path, format!("views.{}.{field}", view.name), cause)
        };
        let file = entry["file"]
            .as_str()
            .ok_or_else(|| bad("file", "is not a text"))?;
        let file = resolve(&estimates, &path, "file", file)?;
        if entry["camera"].as_str() != Some(&fingerprint(view)) {
            outdated += 1;
            continue;
        }
        let deviation = entry["deviation"]
            .as_f64()
            .filter(|deviation| (0.0..1e6).contains(deviation));
        let deviation =
            deviation.ok_or_else(|| bad("deviation", "is not a number of at least 0"))? as f32;
        // Metres of the world, independent of the set's unit.
        let mut source = DepthSource::metres(file, DepthKind::EyeDepth, 1.0 / view.depth_scale);
        source.channel = Some("Z".into());
        source.estimated_deviation = Some(deviation);
        view.depth = Some(source);
        attached += 1;
    }
    if attached > 0 {
        set.notes.push(
            format!(
                "depth of {attached} views was estimated from the images ({})",
                folder.display()
            )
            .into(),
        );
    }
    if outdated > 0 {
        set.notes.push(format!(
            "depth of {outdated} views in {} is not used, because it was estimated for other cameras; estimate it again with \
                         headbox images {} --depth",
            folder.display(),
            set.folder.display()
        ).into());
    }
    Ok(())
}
