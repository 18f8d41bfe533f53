//! Reader of Seurat's `manifest.json`: view groups of RGB-D views with projection matrices.

use super::json::{self, JsonObject};
use crate::cameras::lens::{Distortion, Lens, Pinhole};
use crate::cameras::pose::Pose;
use crate::depth::DepthSource;
use crate::readers::left_out::LeftOut;
use crate::readers::text;
use crate::views::color_images::ColorChannels;
use crate::views::view::View;
use crate::{ImageSet, ImagesError, resolve};
use glam::{DMat4, DVec3};
use headbox_core::depth_kind::DepthKind;
use headbox_core::files::InputFolder;
use std::path::{Path, PathBuf};

/// Opens the set of a manifest.
pub(crate) fn open(folder: &InputFolder, file: &Path) -> Result<ImageSet, ImagesError> {
    let value = json::read(folder, file)?;
    let root = JsonObject::root(file, &value);
    // Seurat has subtracted the centre, the position of the capture in the scene, from the poses.
    let centre = root
        .has("headbox_center")
        .then(|| headbox_centre(&root))
        .transpose()?;
    let mut views = Vec::new();
    let mut left_out = LeftOut::default();
    for group in root.list("view_groups")? {
        for view in group.list("views")? {
            let written = view.value["depth_image_file"]["color"]["path"].as_str();
            let name = written.unwrap_or(&view.path);
            views.extend(left_out.keep(name, read_view(folder, &view))?);
        }
    }
    let note = left_out.finish()?;
    if views.is_empty() {
        return Err(root.error("view_groups", "contains no view"));
    }
    Ok(ImageSet {
        headbox_centre: centre,
        notes: note.into_iter().collect(),
        ..ImageSet::new(folder.path(), "Seurat manifest", views)
    })
}

fn headbox_centre(root: &JsonObject) -> Result<DVec3, ImagesError> {
    let list = root.value["headbox_center"].as_array();
    let numbers: Option<Vec<f64>> =
        list.and_then(|list| list.iter().map(serde_json::Value::as_f64).collect());
    let three: Option<[f64; 3]> = numbers.and_then(|numbers| numbers.try_into().ok());
    three
        .map(DVec3::from)
        .ok_or_else(|| root.error("headbox_center", "must hold three numbers"))
}

fn read_view(folder: &InputFolder, view: &JsonObject) -> Result<View, ImagesError> {
    let camera = view.object("projective_camera")?;
    let size_px = [camera.side("image_width")?, camera.side("image_height")?];
    let clip_from_eye = camera.matrix("clip_from_eye_matrix")?;
    let pinhole = parse_projection(clip_from_eye, size_px)
        .map_err(|cause| camera.error("clip_from_eye_matrix", cause))?;
    let pose = Pose::from_opengl(camera.matrix("world_from_eye_matrix")?)
        .map_err(|cause| camera.error("world_from_eye_matrix", cause))?;
    let kind = match camera.text("depth_type")? {
        "WINDOW_Z" => DepthKind::WindowDepth,
        "EYE_Z" => DepthKind::EyeDepth,
        "RAY_DEPTH" => DepthKind::RayDistance,
        other => {
            return Err(camera.error(
                "depth_type",
                format!("is \"{other}\"; expected WINDOW_Z, EYE_Z or RAY_DEPTH"),
            ));
        }
    };
    let files = view.object("depth_image_file")?;
    let color = files.object("color")?;
    let depth = files.object("depth")?;
    let path = |object: &JsonObject| -> Result<PathBuf, ImagesError> {
        let field = object.field_path("path");
        resolve(folder, object.file, &field, object.text("path")?)
    };
    let rows = clip_from_eye.transpose();
    let depth_path = path(&depth)?;
    let source = DepthSource {
        channel: channel(&depth, "channel_0"),
        // Integer images store fractions of 1.
        unit_m: 1.0 / 65_535.0,
        is_share: true,
        window: Some([rows.z_axis.z, rows.z_axis.w]),
        // Window depth follows from the clip matrix instead; with reversed depth, infinitely far is
        // zero.
        zero_is_far: kind != DepthKind::WindowDepth,
        ..DepthSource::metres(depth_path, kind, 1.0)
    };
    let color_path = path(&color)?;
    let name = text::file_name(&color_path);
    let lens = Lens::Pinhole(pinhole);
    Ok(View {
        color_channels: color_channels(&color),
        ..View::new(name, size_px, lens, pose, color_path, Some(source))
    })
}

fn channel(file: &JsonObject, key: &str) -> Option<String> {
    file.value
        .get(key)
        .and_then(serde_json::Value::as_str)
        .map(str::to_owned)
}

/// Returns the channels of a colour image if they are not R, G, B and A: captures of game engines
/// store depth in alpha.
fn color_channels(color: &JsonObject) -> Option<ColorChannels> {
    let keys = ["channel_0", "channel_1", "channel_2", "channel_alpha"];
    let usual = ColorChannels::default();
    let named =
        std::array::from_fn(|i| channel(color, keys[i]).unwrap_or_else(|| usual.0[i].clone()));
    Some(ColorChannels(named)).filter(|channels| *channels != usual)
}

/// Converts a projection matrix of OpenGL's clip space to a pinhole.
fn parse_projection(clip_from_eye: DMat4, [width, height]: [u32; 2]) -> Result<Pinhole, String> {
    let rows = clip_from_eye.transpose();
    let x = rows.x_axis;
    let y = rows.y_axis;
    let w = rows.w_axis;
    if !clip_from_eye.is_finite()
        || (w.z + 1.0).abs() > 1e-6
        || w.x != 0.0
        || w.y != 0.0
        || w.w != 0.0
    {
        return Err(
            "its last row must be 0, 0, -1, 0: a perspective projection that looks down -Z".into(),
        );
    }
    if !(x.x > 0.0 && y.y > 0.0) {
        return Err("mirrors or has no width: its diagonal must be above 0".into());
    }
    let half = [f64::from(width) / 2.0, f64::from(height) / 2.0];
    let lens = Pinhole {
        focal_px: [x.x * half[0], y.y * half[1]],
        principal_px: [half[0] * (1.0 - x.z), half[1] * (1.0 + y.z)],
        distortion: Distortion::default(),
    };
    Ok(lens.checked()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn off_centre_projection_matches_matrix() {
        let clip = DMat4::from_cols_array(&[
            1.5, 0.0, 0.0, 0.0, //
            0.0, 2.0, 0.0, 0.0, //
            0.2, -0.1, -1.002, -1.0, //
            0.0, 0.0, -0.2, 0.0,
        ]);
        let pinhole = parse_projection(clip, [640, 480]).expect("a pinhole");
        let point = DVec3::new(0.7, -0.4, -3.0);
        let ndc = clip * point.extend(1.0) / (clip * point.extend(1.0)).w;
        let expected = [(ndc.x + 1.0) * 320.0, (1.0 - ndc.y) * 240.0];
        let [x, y, depth] = Lens::Pinhole(pinhole)
            .project(point, [640, 480])
            .expect("in front");
        assert!((x - expected[0]).abs() < 1e-9 && (y - expected[1]).abs() < 1e-9 && depth == 3.0);
        assert!(
            parse_projection(DMat4::IDENTITY, [4, 4]).is_err(),
            "not a perspective"
        );
    }
}
