//! Reader and writer of `transforms.json` of nerfstudio and NeRF.

use super::depth_keys;
use super::lens::{KeyOwners, note_unknown_keys, read_lens};
use crate::cameras::lens::Lens;
use crate::cameras::pose::Pose;
use crate::cameras::rectify::{ImageLens, ViewList};
use crate::depth::{DepthPicture, write_depth_exr};
use crate::readers::json::{self as fields, JsonObject};
use crate::readers::left_out::LeftOut;
use crate::readers::paths::find_without_extension;
use crate::readers::text;
use crate::views::color_images::read_camera_size;
use crate::views::view::{LoadedView, View};
use crate::{ImageSet, ImagesError, resolve};
use glam::{DMat4, DVec3};
use headbox_core::depth_kind::DepthKind;
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_core::files::{self, InputFolder};
use headbox_core::read_note::ReadNote;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use serde_json::{Value, json};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// Axes and unit of poses.
const FRAME: FileFrame = FileFrame {
    up: UpAxis::Z,
    unit_m: 1.0,
};

/// Returns true if a JSON file of any name lists frames.
pub(crate) fn is_transforms(folder: &InputFolder, file: &Path) -> bool {
    fields::read(folder, file).is_ok_and(|value| value["frames"].is_array())
}

/// Opens the set of a `transforms.json`.
pub(crate) fn open(folder: &InputFolder, file: &Path) -> Result<ImageSet, ImagesError> {
    let value = fields::read(folder, file)?;
    let root = JsonObject::root(file, &value);
    let mut list = ViewList::default();
    let mut left_out = LeftOut::default();
    let frames = root.list("frames")?;
    if frames.is_empty() {
        return Err(root.error("frames", "is empty"));
    }
    for frame in frames {
        let name = frame.value["file_path"].as_str().unwrap_or(&frame.path);
        let read = read_view(folder, &root, &frame);
        if let Some((view, lens)) = left_out.keep(name, read)? {
            list.push(view, lens);
        }
    }
    let (views, mut notes) = list.finish();
    notes.extend(left_out.finish()?);
    if file.ends_with("transforms_train.json") {
        let mut others = ["transforms_val.json", "transforms_test.json"]
            .map(str::to_owned)
            .to_vec();
        others.retain(|other| folder.path().join(other).is_file());
        notes.extend(text::note_names(
            "left out images for validation and tests",
            &others,
        ));
    }
    notes.extend(note_unknown_keys(&value).map(ReadNote::from));
    notes.extend(
        depth_keys::note_unknown(&value)
            .into_iter()
            .map(ReadNote::from),
    );
    Ok(ImageSet {
        frame: FRAME,
        notes,
        ..ImageSet::new(folder.path(), "nerfstudio transforms", views)
    })
}

fn read_view(
    folder: &InputFolder,
    root: &JsonObject,
    view: &JsonObject,
) -> Result<(View, ImageLens), ImagesError> {
    // Fields that a frame lacks are taken from the file's root.
    let keys = KeyOwners {
        root: root.clone(),
        frame: view.clone(),
    };
    let find_owner = |key: &str| keys.owner(&[key]);
    let color = find_color(folder, view)?;
    let width_owner = find_owner("w");
    let height_owner = find_owner("h");
    let size_px = if width_owner.has("w") && height_owner.has("h") {
        [width_owner.side("w")?, height_owner.side("h")?]
    } else {
        let [cx, cy] = ["cx", "cy"].map(|key| find_owner(key).number_or(key, f64::NAN));
        read_camera_size(&color, [cx?, cy?])?
    };
    let lens = read_lens(&keys, size_px)?;
    let pose = Pose::from_opengl(view.matrix("transform_matrix")?)
        .map_err(|cause| view.error("transform_matrix", cause))?;
    let resolve_field = |key: &str| {
        if !view.has(key) {
            return Ok(None);
        }
        let field = view.field_path(key);
        resolve(folder, view.file, &field, view.text(key)?).map(Some)
    };
    let kind = if lens == ImageLens::Direct(Lens::Equirectangular) {
        DepthKind::RayDistance
    } else {
        DepthKind::EyeDepth
    };
    let depth = depth_keys::read(folder, root, view, kind)?;
    let name = view.text("file_path")?.to_owned();
    let pose = pose.in_world(&FRAME);
    let view = View {
        mask: resolve_field("mask_path")?,
        ..View::new(name, size_px, Lens::Equirectangular, pose, color, depth)
    };
    Ok((view, lens))
}

/// Writes perspective views as a set of their own: undistorted images as `images/NNNNN.png`, and
/// `transforms.json`. `on_view` is called for each written view. Panoramas are skipped.
///
/// # Errors
/// [`ImagesError`] that names the file.
pub fn write_set(
    views: &[View],
    folder: &Path,
    on_view: &mut dyn FnMut(&str),
) -> Result<(), ImagesError> {
    let mut set = SetWriter::new(folder);
    for (number, view) in views.iter().enumerate() {
        if view.pinhole().is_some() && set.add(number, &view.load()?, false)? {
            on_view(&view.name);
        }
    }
    set.finish()
}

/// Writes a set view by view.
pub struct SetWriter {
    folder: PathBuf,
    frames: Vec<Value>,
}

impl SetWriter {
    /// Creates a writer into a folder.
    pub fn new(folder: &Path) -> Self {
        Self {
            folder: folder.into(),
            frames: Vec::new(),
        }
    }

    /// Writes the image of a view as `images/NNNNN.png`, and `depth/NNNNN.exr` if `with_depth`;
    /// returns false if it is not a perspective view.
    ///
    /// # Errors
    /// [`ImagesError`] that names the file.
    pub fn add(
        &mut self,
        number: usize,
        view: &LoadedView,
        with_depth: bool,
    ) -> Result<bool, ImagesError> {
        let Lens::Pinhole(lens) = view.lens else {
            return Ok(false);
        };
        let name = format!("images/{number:05}.png");
        write_picture(view, &self.folder.join(&name))?;
        let axis = |axis: DVec3| FRAME.file_from_world(axis).extend(0.0);
        let turn = view.pose.world_from_eye;
        let matrix = DMat4::from_cols(
            axis(turn.x_axis),
            axis(turn.y_axis),
            axis(turn.z_axis),
            FRAME.file_from_world(view.pose.eye).extend(1.0),
        );
        let [width, height] = view.size_px;
        let mut entry = json!({
            "file_path": name, "transform_matrix": matrix.transpose().to_cols_array_2d(), "w": width, "h": height,
            "fl_x": lens.focal_px[0], "fl_y": lens.focal_px[1], "cx": lens.principal_px[0], "cy": lens.principal_px[1],
        });
        if with_depth {
            let name = format!("depth/{number:05}.exr");
            let path = self.folder.join(&name);
            let depth = DepthPicture {
                width,
                height,
                values: view.depth.clone(),
            };
            write_depth_exr(&depth, &path).map_err(|cause| ImagesError::write(&path, cause))?;
            entry["depth_file_path"] = json!(name);
        }
        self.frames.push(entry);
        Ok(true)
    }

    /// Writes `transforms.json`.
    ///
    /// # Errors
    /// [`ImagesError`] that names the file.
    pub fn finish(self) -> Result<(), ImagesError> {
        let file = self.folder.join("transforms.json");
        let set = json!({"camera_model": "PINHOLE", "frames": self.frames});
        files::write_whole(&file, |writer| {
            serde_json::to_writer_pretty(writer, &set).map_err(io::Error::other)
        })
        .map_err(|cause| ImagesError::write(&file, cause))
    }
}

/// Writes the colours of a view as PNG, with alpha only if a pixel is transparent.
fn write_picture(view: &LoadedView, path: &Path) -> Result<(), ImagesError> {
    let [width, height] = view.size_px;
    let is_opaque = view.color.iter().all(|pixel| pixel[3] == 255);
    let (bytes, kind): (Vec<u8>, _) = if is_opaque {
        let colors = view.color.iter().flat_map(|&[r, g, b, _]| [r, g, b]);
        (colors.collect(), ExtendedColorType::Rgb8)
    } else {
        (view.color.as_flattened().into(), ExtendedColorType::Rgba8)
    };
    let write = |writer: &mut io::BufWriter<&File>| {
        PngEncoder::new(writer)
            .write_image(&bytes, width, height, kind)
            .map_err(io::Error::other)
    };
    files::write_whole(path, write).map_err(|cause| ImagesError::write(path, cause))
}

/// Finds the image of a frame, whose path may lack the extension.
fn find_color(folder: &InputFolder, view: &JsonObject) -> Result<PathBuf, ImagesError> {
    let written = view.text("file_path")?;
    let field = view.field_path("file_path");
    let resolved = resolve(folder, view.file, &field, written).map(add_extension);
    if resolved.as_ref().is_ok_and(|path| path.is_file()) {
        return resolved;
    }
    let base = view.file.parent().unwrap_or(Path::new(""));
    find_without_extension(folder, base, written).map_or(resolved, Ok)
}

/// Adds the extension, which NeRF's synthetic scenes omit (`.png`), to a path without a file.
fn add_extension(path: PathBuf) -> PathBuf {
    if path.is_file() {
        return path;
    }
    // Names such as r_0.5 have a point that begins no extension.
    let with = |extension: &str| {
        let mut name = path.clone().into_os_string();
        name.push(extension);
        PathBuf::from(name)
    };
    let known = [".png", ".jpg", ".jpeg", ".JPG", ".PNG"].map(with);
    if let Some(found) = known.into_iter().find(|path| path.is_file()) {
        return found;
    }
    if path.extension().is_some() {
        path
    } else {
        path.with_extension("png")
    }
}
