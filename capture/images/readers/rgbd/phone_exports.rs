//! Reader of the exports of phones and of splat trainers: Polycam's raw data (`keyframes`),
//! Record3D (`metadata.json`) and the `cameras.json` of 3D Gaussian Splatting.

use super::folders::pose_from_words;
use crate::cameras::lens::{Distortion, Lens, Pinhole};
use crate::cameras::pose::Pose;
use crate::depth::DepthSource;
use crate::readers::json::{self, JsonObject};
use crate::readers::left_out::LeftOut;
use crate::readers::paths::{find_image, find_named_image};
use crate::readers::text;
use crate::views::color_images::read_camera_size;
use crate::views::view::View;
use crate::{ImageSet, ImagesError};
use glam::{DMat4, DVec4};
use headbox_core::depth_kind::DepthKind;
use headbox_core::files::InputFolder;
use headbox_core::read_note::ReadNote;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Metres per step of Polycam's depth.
const POLYCAM_UNIT_M: f32 = 0.001;

/// Opens the export in a folder; `None` if it has none of the layouts.
pub(crate) fn open(set: &InputFolder) -> Result<Option<ImageSet>, ImagesError> {
    let folder = set.path();
    for keyframes in [folder.join("keyframes"), folder.into()] {
        for [cameras, images] in [
            ["corrected_cameras", "corrected_images"],
            ["cameras", "images"],
        ] {
            let [cameras, images] = [cameras, images].map(|name| keyframes.join(name));
            if !(cameras.is_dir() && images.is_dir()) {
                continue;
            }
            if let Some(set) = open_polycam(set, &keyframes, &cameras, &images)? {
                return Ok(Some(set));
            }
        }
    }
    for below in ["", "EXR_RGBD"] {
        let metadata = folder.join(below).join("metadata.json");
        let is_record3d = metadata.is_file()
            && json::read(set, &metadata)
                .is_ok_and(|value| value["poses"].is_array() && value["K"].is_array());
        if is_record3d {
            return open_record3d(set, &metadata).map(Some);
        }
    }
    let cameras = folder.join("cameras.json");
    if cameras.is_file() {
        return open_splat_cameras(set, &cameras).map(Some);
    }
    Ok(None)
}

fn create_pinhole(focal_px: [f64; 2], principal_px: [f64; 2]) -> Pinhole {
    Pinhole {
        focal_px,
        principal_px,
        distortion: Distortion::default(),
    }
}

fn find_depth(folder: &Path, stem: &str, unit_m: f32) -> Option<DepthSource> {
    let files = [("exr", 1.0), ("png", unit_m)];
    files.into_iter().find_map(|(extension, unit_m)| {
        let path = folder.join(format!("{stem}.{extension}"));
        let source = |path| DepthSource::metres(path, DepthKind::EyeDepth, unit_m);
        path.is_file().then(|| source(path))
    })
}

fn finish(
    folder: &Path,
    format: &'static str,
    views: Vec<View>,
    left_out: LeftOut,
    mut notes: Vec<ReadNote>,
) -> Result<ImageSet, ImagesError> {
    notes.extend(left_out.finish()?);
    if views.is_empty() {
        return Err(ImagesError::field(folder, format, "lists no image"));
    }
    Ok(ImageSet {
        notes,
        ..ImageSet::new(folder, format, views)
    })
}

fn stem_of(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

fn open_polycam(
    set: &InputFolder,
    keyframes: &Path,
    cameras: &Path,
    images: &Path,
) -> Result<Option<ImageSet>, ImagesError> {
    let mut files = text::list_folder(cameras)?;
    files.retain(|file| {
        file.extension()
            .is_some_and(|extension| extension == "json")
    });
    // Other programs have folders of these names, too.
    let is_polycam =
        |file: &PathBuf| json::read(set, file).is_ok_and(|camera| camera["t_00"].is_number());
    if !files.iter().any(is_polycam) {
        return Ok(None);
    }
    let mut views = Vec::new();
    let mut left_out = LeftOut::default();
    let mut without_depth = Vec::new();
    for file in files {
        let stem = stem_of(&file);
        let color = find_image(images, &stem);
        let name = text::file_name(&color);
        let Some((size_px, lens, pose)) =
            left_out.keep(&name, polycam_camera(set, &file, &color))?
        else {
            continue;
        };
        let depth = find_depth(&keyframes.join("depth"), &stem, POLYCAM_UNIT_M);
        if depth.is_none() {
            without_depth.push(name.clone());
        }
        views.push(View::new(name, size_px, lens, pose, color, depth));
    }
    let notes = text::note_names(text::WITHOUT_DEPTH, &without_depth);
    finish(
        set.path(),
        "Polycam raw data",
        views,
        left_out,
        notes.into_iter().collect(),
    )
    .map(Some)
}

/// Reads a camera of Polycam: a pose of OpenGL's axes whose world has Y up.
fn polycam_camera(
    set: &InputFolder,
    file: &Path,
    color: &Path,
) -> Result<([u32; 2], Lens, Pose), ImagesError> {
    let value = json::read(set, file)?;
    let camera = JsonObject::root(file, &value);
    let written = [camera.side("width")?, camera.side("height")?];
    let [fx, fy, cx, cy] = ["fx", "fy", "cx", "cy"].map(|key| camera.number(key));
    let row = |i: usize| -> Result<DVec4, ImagesError> {
        let mut row = DVec4::ZERO;
        for j in 0..4 {
            row[j] = camera.number(&format!("t_{i}{j}"))?;
        }
        Ok(row)
    };
    let rows = DMat4::from_cols(row(0)?, row(1)?, row(2)?, DVec4::W);
    let pose = Pose::from_opengl(rows.transpose()).map_err(|cause| camera.error("t_00", cause))?;
    let size_px = read_written_size(color, written)?;
    let lens = create_pinhole([fx?, fy?], [cx?, cy?]).scaled(written, size_px);
    let lens = lens.checked().map_err(|cause| camera.error("fx", cause))?;
    Ok((size_px, Lens::Pinhole(lens), pose))
}

/// Reads the size of the image that a camera of the size `written` took, upright if the camera is.
fn read_written_size(color: &Path, written: [u32; 2]) -> Result<[u32; 2], ImagesError> {
    read_camera_size(color, written.map(|side| f64::from(side) / 2.0))
}

/// Reads the numbers of a list.
fn numbers(value: &Value) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(Value::as_f64).collect()
}

fn open_record3d(set: &InputFolder, metadata: &Path) -> Result<ImageSet, ImagesError> {
    let folder = set.path();
    let value = json::read(set, metadata)?;
    let root = JsonObject::root(metadata, &value);
    let written = [root.side("w")?, root.side("h")?];
    // The 3x3 matrix is stored column by column.
    let k: [f64; 9] = numbers(&value["K"])
        .and_then(|k| k.try_into().ok())
        .ok_or_else(|| root.error("K", "must hold 9 numbers, column by column"))?;
    let shared = [k[0], k[4], k[6], k[7]];
    let below = metadata.parent().unwrap_or(folder);
    let places = ["rgb", "rgbd", "images"].map(|name| below.join(name));
    let images = places.into_iter().find(|place| place.is_dir());
    let images = images.unwrap_or_else(|| below.join("rgb"));
    let poses = value["poses"].as_array().map_or(&[][..], Vec::as_slice);
    let mut views = Vec::new();
    let mut left_out = LeftOut::default();
    let mut compressed = 0;
    for (i, pose) in poses.iter().enumerate() {
        let stem = i.to_string();
        let color = find_image(&images, &stem);
        let field = format!("poses[{i}]");
        let frame = || {
            let bad = |cause: String| root.error(&field, cause);
            let p = numbers(pose).filter(|p| p.len() == 7);
            let p = p.ok_or_else(|| bad("must hold 7 numbers".into()))?;
            // The quaternion comes first.
            let words: Vec<String> = p[4..].iter().chain(&p[..4]).map(f64::to_string).collect();
            let matrix = pose_from_words(&words).map_err(bad)?;
            let pose = Pose::from_opengl(matrix).map_err(bad)?;
            let own = numbers(&value["perFrameIntrinsicCoeffs"][i]);
            let own = own.and_then(|own| own.get(..4)?.try_into().ok());
            let [fx, fy, cx, cy]: [f64; 4] = own.unwrap_or(shared);
            let size_px = read_written_size(&color, written)?;
            let lens = create_pinhole([fx, fy], [cx, cy]).scaled(written, size_px);
            let lens = lens.checked().map_err(|cause| bad(cause.into()))?;
            Ok((size_px, Lens::Pinhole(lens), pose))
        };
        let name = text::file_name(&color);
        let Some((size_px, lens, pose)) = left_out.keep(&name, frame())? else {
            continue;
        };
        let depth = find_depth(&below.join("depth"), &stem, 0.001);
        compressed += u32::from(images.join(format!("{stem}.depth")).is_file());
        views.push(View::new(name, size_px, lens, pose, color, depth));
    }
    let mut notes = Vec::new();
    if compressed > 0 {
        notes.push(format!(
            "{compressed} compressed depth files (.depth) are not read; export \"EXR + RGB\" from \
             Record3D instead"
        ).into());
    }
    finish(folder, "Record3D export", views, left_out, notes)
}

fn open_splat_cameras(set: &InputFolder, file: &Path) -> Result<ImageSet, ImagesError> {
    let value = json::read(set, file)?;
    let list = value.as_array().map_or(&[][..], Vec::as_slice);
    let is_camera = |value: &Value| !value["position"].is_null() && !value["rotation"].is_null();
    if !list.iter().any(is_camera) {
        let cause = "is not a cameras.json of 3D Gaussian Splatting: a list of objects with \
                     position, rotation, fx and fy";
        return Err(ImagesError::field(file, "the file", cause));
    }
    let mut views = Vec::new();
    let mut left_out = LeftOut::default();
    let mut resized = Vec::new();
    for (i, value) in list.iter().enumerate() {
        let camera = JsonObject {
            file,
            path: format!("[{i}]"),
            value,
        };
        let written = camera.value["img_name"].as_str().unwrap_or_default();
        let frame = || {
            let name = camera.text("img_name")?;
            let color = find_named_image(set, file, name)?;
            let color = color.ok_or_else(|| {
                camera.error("img_name", format!("is {name}: not found in images"))
            })?;
            let written = [camera.side("width")?, camera.side("height")?];
            let size_px = read_written_size(&color, written)?;
            let focal_px = [camera.number("fx")?, camera.number("fy")?];
            let centre = written.map(|side| f64::from(side) / 2.0);
            let lens = create_pinhole(focal_px, centre).scaled(written, size_px);
            let lens = lens.checked().map_err(|cause| camera.error("fx", cause))?;
            let rows = camera.value["rotation"].as_array();
            let rows = rows.and_then(|rows| rows.iter().map(numbers).collect::<Option<Vec<_>>>());
            let rows = rows
                .map(|rows| rows.concat())
                .filter(|rows| rows.len() == 9);
            let rows = rows.ok_or_else(|| camera.error("rotation", "must hold 3x3 numbers"))?;
            let eye = numbers(&camera.value["position"]).filter(|eye| eye.len() == 3);
            let eye = eye.ok_or_else(|| camera.error("position", "must hold 3 numbers"))?;
            let row = |i: usize| [rows[3 * i], rows[3 * i + 1], rows[3 * i + 2], eye[i]];
            let pose =
                crate::readers::intrinsics::pose_from_rows(&[row(0), row(1), row(2)].concat());
            let pose = pose.map_err(|cause| camera.error("rotation", cause))?;
            Ok((color, written, size_px, Lens::Pinhole(lens), pose))
        };
        let Some((color, named, size_px, lens, pose)) = left_out.keep(written, frame())? else {
            continue;
        };
        if named != size_px {
            resized.push(written.to_owned());
        }
        views.push(View::new(written.into(), size_px, lens, pose, color, None));
    }
    let resized = text::note_names(
        "the sizes of images differ from cameras.json; focal lengths are scaled",
        &resized,
    );
    let notes = resized.into_iter().collect();
    finish(
        set.path(),
        "3D Gaussian Splatting cameras.json",
        views,
        left_out,
        notes,
    )
}
