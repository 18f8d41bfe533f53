//! Depth that was found, in files beside a set's pictures.
//!
//! A folder `headbox-depth` in that of the set holds a picture for each view (OpenEXR, channels `Z`: eye depth in metres, 0 where unknown, and
//! `confidence`), and `index.json`, which is written last: which picture belongs to which view, with a fingerprint of the view's camera,
//! so that depth found for other cameras is not taken for these.

use super::FoundDepth;
use crate::depth::DepthSource;
use crate::readers::json;
use crate::{ImageSet, ImagesError, Lens, View};
use exr::prelude::{Encoding, Image, LineOrder, SpecificChannels, WritableImage};
use headbox_core::depth_kind::DepthKind;
use headbox_core::files;
use headbox_core::random::hash;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::io;
use std::path::{Component, Path, PathBuf};

/// The folder, beside a set's pictures.
const FOLDER: &str = "headbox-depth";

/// What lists its pictures.
const INDEX: &str = "index.json";

/// Of the index.
const VERSION: u64 = 1;

/// Writes what is found of a set.
pub(super) struct DepthStore {
    folder: PathBuf,
    entries: Map<String, Value>,
    written: BTreeMap<PathBuf, String>,
}

impl DepthStore {
    /// Beside the pictures of a set; makes the folder.
    pub(super) fn beside(set: &ImageSet) -> Result<Self, ImagesError> {
        let folder = set.folder.join(FOLDER);
        std::fs::create_dir_all(&folder)
            .and_then(|()| files::check_folder(&folder))
            .map_err(|cause| ImagesError::io(&folder, cause))?;
        let mut store = Self {
            folder,
            entries: Map::new(),
            written: BTreeMap::new(),
        };
        // What another run found of other views stays.
        if let Some(Value::Object(views)) =
            read_index(&store.folder)?.map(|mut index| index["views"].take())
        {
            store.entries = views;
        }
        Ok(store)
    }

    /// Where it is.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Writes what was found of a view.
    pub(super) fn add(&mut self, view: &View, found: &FoundDepth) -> Result<(), ImagesError> {
        let file = file_of(&view.name);
        let path = self.folder.join(&file);
        if let Some(other) = self.written.insert(file.clone(), view.name.clone()) {
            let cause = format!(
                "is that of {other} as well, so that the depth of only one of them can be kept"
            );
            return Err(ImagesError::Field {
                path,
                field: format!("the name of {}", view.name),
                cause,
            });
        }
        write_exr(&path, found).map_err(|cause| ImagesError::io(&path, cause))?;
        let entry = json!({
            "file": file.to_string_lossy(), "camera": fingerprint(view), "deviation": found.deviation,
        });
        self.entries.insert(view.name.clone(), entry);
        Ok(())
    }

    /// Writes the index: from now on the set has this depth.
    pub(super) fn finish(self) -> Result<(), ImagesError> {
        let index = json!({"version": VERSION, "views": self.entries});
        let path = self.folder.join(INDEX);
        files::write_whole(&path, |writer| {
            serde_json::to_writer_pretty(writer, &index).map_err(io::Error::other)
        })
        .map_err(|cause| ImagesError::io(&path, cause))
    }
}

fn write_exr(path: &Path, found: &FoundDepth) -> io::Result<()> {
    let [width, height] = found.view.size_px.map(|side| side as usize);
    let depth = &found.view.depth;
    let pixel = |at: exr::math::Vec2<usize>| {
        let i = at.y() * width + at.x();
        let known = depth
            .get(i)
            .copied()
            .filter(|depth| depth.is_finite())
            .unwrap_or(0.0);
        (known, exr::prelude::f16::from_f32(found.confidence[i]))
    };
    let channels = SpecificChannels::build()
        .with_channel("Z")
        .with_channel("confidence")
        .with_pixel_fn(pixel);
    // Blocks in their order, whichever thread is done first: the same bytes each time.
    let encoding = Encoding {
        line_order: LineOrder::Increasing,
        ..Encoding::SMALL_FAST_LOSSLESS
    };
    let image = Image::from_encoded_channels((width, height), encoding, channels);
    files::write_whole(path, |writer| {
        image.write().to_buffered(writer).map_err(io::Error::other)
    })
}

/// A view's name as a path of its own, which stays below the folder.
fn file_of(name: &str) -> PathBuf {
    let normal = Path::new(name).components().filter_map(|part| match part {
        Component::Normal(part) => Some(part),
        _ => None,
    });
    let mut file = normal.collect::<PathBuf>().into_os_string();
    file.push(".exr");
    file.into()
}

/// Changes with a view's camera: its picture's size, its lens and its pose.
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
    // 0.0 and -0.0 are one camera.
    let of_all = numbers
        .iter()
        .fold(0, |sum, number| hash(sum ^ (number + 0.0).to_bits()));
    format!("{of_all:016x}")
}

fn read_index(folder: &Path) -> Result<Option<Value>, ImagesError> {
    let path = folder.join(INDEX);
    if !path.is_file() {
        return Ok(None);
    }
    let index = json::read(&path)?;
    match index["version"].as_u64() {
        Some(VERSION) => Ok(Some(index)),
        _ => Err(ImagesError::field(
            &path,
            "version",
            format!("is not {VERSION}: remove the folder, and find depth again"),
        )),
    }
}

/// Gives views that have no depth what was found of them, and says so.
pub(crate) fn attach(set: &mut ImageSet) -> Result<(), ImagesError> {
    let folder = set.folder.join(FOLDER);
    let Some(index) = read_index(&folder)? else {
        return Ok(());
    };
    let path = folder.join(INDEX);
    let (mut found, mut other) = (0, 0);
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
            .ok_or_else(|| bad("file", "is no text"))?;
        let file = super::super::resolve(&path, "file", file, false)?;
        if entry["camera"].as_str() != Some(&fingerprint(view)) {
            other += 1;
            continue;
        }
        let deviation = entry["deviation"]
            .as_f64()
            .filter(|deviation| (0.0..1e6).contains(deviation));
        let deviation =
            deviation.ok_or_else(|| bad("deviation", "is no number that is at least 0"))? as f32;
        // Metres of the world, whatever the set's own unit is.
        let mut source = DepthSource::metres(file, DepthKind::EyeDepth, 1.0 / view.depth_scale);
        source.channel = Some("Z".into());
        source.estimated_deviation = Some(deviation);
        view.depth = Some(source);
        found += 1;
    }
    if found > 0 {
        set.notes.push(format!(
            "depth of {found} views was found from the pictures ({})",
            folder.display()
        ));
    }
    if other > 0 {
        set.notes.push(format!(
            "depth of {other} views in {} was found for other cameras than they have now, and is not used: find it again \
             (headbox images {} --depth)",
            folder.display(),
            set.folder.display()
        ));
    }
    Ok(())
}
