//! Lenses of `transforms.json`: the keys of nerfstudio, NeRF and instant-ngp.

use crate::ImagesError;
use crate::cameras::camera_model::{CameraModel, Polynomial, Projection};
use crate::cameras::lens::{Distortion, Lens, Pinhole};
use crate::cameras::rectify::ImageLens;
use crate::readers::json::JsonObject;
use serde_json::Value;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Keys that the reader uses.
const READ: [&str; 35] = [
    "camera_angle_x",
    "camera_angle_y",
    "camera_model",
    "cx",
    "cy",
    "depth_file_path",
    "depth_path",
    "depth_unit_scale_factor",
    "distortion_params",
    "enable_depth_loading",
    "equirectangular",
    "file_path",
    "fl_x",
    "fl_y",
    "frames",
    "ftheta_p0",
    "ftheta_p1",
    "ftheta_p2",
    "ftheta_p3",
    "ftheta_p4",
    "h",
    "integer_depth_scale",
    "is_fisheye",
    "k1",
    "k2",
    "k3",
    "k4",
    "latlong",
    "mask_path",
    "p1",
    "p2",
    "transform_matrix",
    "w",
    "x_fov",
    "y_fov",
];

/// Keys that do not change what views show: names, the scene's extent, training.
const HARMLESS: [&str; 46] = [
    "aabb",
    "aabb_scale",
    "applied_scale",
    "applied_transform",
    "bbox",
    "black_transparent",
    "camera_id",
    "camera_label_to_vis_idx",
    "colmap_im_id",
    "comment",
    "date",
    "exposure",
    "from_na",
    "frame_id",
    "fix_premult",
    "id",
    "image_id",
    "latent",
    "linear_colors",
    "n_extra_learnable_dims",
    "n_frames",
    "name",
    "normal_file_path",
    "offset",
    "orientation_override",
    "ply_file_path",
    "render_aabb",
    "render_aabb_max",
    "render_aabb_min",
    "rotation",
    "scale",
    "sh_degree",
    "sharpen",
    "sharpness",
    "test_filenames",
    "time",
    "timestamp",
    "timestamps",
    "train_filenames",
    "up",
    "val_filenames",
    "version",
    "white_transparent",
    "auto_scale_poses_override",
    "center_method_override",
    "capture_time",
];

/// Returns a note on the keys that are neither read nor known to be harmless; keys of depth are not
/// looked at.
pub(super) fn note_unknown_keys(root: &Value) -> Option<String> {
    let frames = root["frames"].as_array();
    let objects = std::iter::once(root).chain(frames.into_iter().flatten());
    let mut unknown: BTreeMap<&str, usize> = BTreeMap::new();
    for (key, value) in objects.filter_map(Value::as_object).flatten() {
        let is_known = READ.contains(&key.as_str()) || HARMLESS.contains(&key.as_str());
        let is_depth = key.to_lowercase().contains("depth");
        if !is_known && !is_depth && !value.is_null() {
            *unknown.entry(key).or_default() += 1;
        }
    }
    let names: Vec<String> = unknown
        .iter()
        .map(|(key, times)| {
            if *times > 1 {
                format!("{key} ({times} times)")
            } else {
                (*key).to_owned()
            }
        })
        .collect();
    (!names.is_empty()).then(|| {
        format!(
            "{} unknown keys are ignored; the views are wrong if one of them describes the lens \
             or the depth: {}",
            names.len(),
            names.join(", ")
        )
    })
}

/// Finds the object, the frame or the file's root, that has a key.
pub(super) struct KeyOwners<'a> {
    pub(super) root: JsonObject<'a>,
    pub(super) frame: JsonObject<'a>,
}

impl<'a> KeyOwners<'a> {
    /// Returns the frame if it has one of the keys or the root has none of them, else the root.
    pub(super) fn owner(&self, keys: &[&str]) -> &JsonObject<'a> {
        let has = |object: &JsonObject| keys.iter().any(|key| object.has(key));
        if has(&self.frame) || !has(&self.root) {
            &self.frame
        } else {
            &self.root
        }
    }

    fn number(&self, key: &str, default: f64) -> Result<f64, ImagesError> {
        self.owner(&[key]).number_or(key, default)
    }

    fn is_set(&self, key: &str) -> bool {
        let owner = self.owner(&[key]);
        owner.has(key) && owner.value[key] != Value::Bool(false)
    }

    /// Returns the focal length along an axis, pixels, if a key of `owner` specifies it.
    fn focal(&self, axis: &str, side: f64) -> Result<Option<f64>, ImagesError> {
        let keys = [
            format!("fl_{axis}"),
            format!("camera_angle_{axis}"),
            format!("{axis}_fov"),
        ];
        let owner = self.owner(&keys.each_ref().map(String::as_str));
        let [length, radians, degrees] = &keys;
        if owner.has(length) {
            return owner.number(length).map(Some);
        }
        for (key, half_turn, unit) in [(radians, PI, "0 and pi"), (degrees, 180.0, "0 and 180")] {
            if owner.has(key) {
                let angle = owner.number(key)?;
                if angle > 0.0 && angle < half_turn {
                    return Ok(Some(0.5 * side / (angle / half_turn * PI / 2.0).tan()));
                }
                let cause = format!("is {angle}, not an angle between {unit}");
                return Err(owner.error(key, cause));
            }
        }
        Ok(None)
    }

    /// Reads the distortion coefficients: k1 to k4, p1, p2, or the twelve of FISHEYE624.
    fn distortion(&self) -> Result<Vec<f64>, ImagesError> {
        let owner = self.owner(&["distortion_params"]);
        if !owner.has("distortion_params") {
            let keys = ["k1", "k2", "k3", "k4", "p1", "p2"];
            return keys.iter().map(|key| self.number(key, 0.0)).collect();
        }
        let list = owner.value["distortion_params"].as_array();
        let numbers = list.and_then(|list| list.iter().map(Value::as_f64).collect());
        numbers
            .filter(|numbers: &Vec<f64>| matches!(numbers.len(), 6 | 12))
            .ok_or_else(|| owner.error("distortion_params", "must hold 6 or 12 numbers"))
    }
}

/// Kinds of lenses.
enum LensKind {
    Perspective,
    Fisheye,
    Fisheye624,
}

fn read_kind(keys: &KeyOwners) -> Result<Option<LensKind>, ImagesError> {
    for (key, what) in [
        ("ftheta_p0", "describes an f-theta lens of instant-ngp"),
        (
            "equirectangular",
            "describes an equal-area panorama of instant-ngp",
        ),
    ] {
        if keys.is_set(key) {
            let cause = format!("{what}, which is not supported: resample the images first");
            return Err(keys.owner(&[key]).error(key, cause));
        }
    }
    let owner = keys.owner(&["camera_model"]);
    let model = if owner.has("camera_model") {
        owner.text("camera_model")?
    } else {
        "OPENCV"
    };
    if keys.is_set("latlong") {
        return Ok(None);
    }
    Ok(Some(match model {
        "EQUIRECTANGULAR" => return Ok(None),
        "OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" => {
            if keys.is_set("is_fisheye") {
                LensKind::Fisheye
            } else {
                LensKind::Perspective
            }
        }
        "OPENCV_FISHEYE"
        | "FISHEYE"
        | "SIMPLE_FISHEYE"
        | "SIMPLE_RADIAL_FISHEYE"
        | "RADIAL_FISHEYE" => LensKind::Fisheye,
        "FISHEYE624" => LensKind::Fisheye624,
        other => {
            let cause = format!(
                "is \"{other}\"; expected PINHOLE, OPENCV, OPENCV_FISHEYE, FISHEYE624 or EQUIRECTANGULAR: undistort the images first"
            );
            return Err(owner.error("camera_model", cause));
        }
    }))
}

/// Reads the lens of a frame.
///
/// # Errors
/// [`ImagesError::Field`] that names the key.
pub(super) fn read_lens(keys: &KeyOwners, size_px: [u32; 2]) -> Result<ImageLens, ImagesError> {
    let Some(kind) = read_kind(keys)? else {
        return Ok(ImageLens::Direct(Lens::Equirectangular));
    };
    let [width, height] = size_px.map(f64::from);
    let fl_x = keys.focal("x", width)?;
    let fl_y = keys.focal("y", height)?;
    let view = &keys.frame;
    let Some(focal_x) = fl_x.or(fl_y) else {
        return Err(view.error(
            "fl_x",
            "is missing, and so is camera_angle_x: one of them must specify the field of view",
        ));
    };
    let focal_px = [focal_x, fl_y.unwrap_or(focal_x)];
    let principal_px = [
        keys.number("cx", width / 2.0)?,
        keys.number("cy", height / 2.0)?,
    ];
    let k = keys.distortion()?;
    let projection = match (kind, &k[..]) {
        (LensKind::Perspective, &[k1, k2, k3, 0.0, p1, p2]) => {
            let lens = Pinhole {
                focal_px,
                principal_px,
                distortion: Distortion {
                    radial: [k1, k2, k3, 0.0, 0.0, 0.0],
                    tangential: [p1, p2],
                },
            };
            return lens
                .checked()
                .map(|lens| ImageLens::Direct(Lens::Pinhole(lens)))
                .map_err(|cause| view.error("fl_x", cause));
        }
        (LensKind::Perspective, &[k1, k2, k3, k4, p1, p2]) => {
            Projection::Plane(Polynomial::of_plane(&[k1, k2, k3, k4], [p1, p2]))
        }
        (LensKind::Fisheye, &[k1, k2, k3, k4, p1, p2]) => Projection::Fisheye(
            Polynomial::of_angles(&[k1, k2, k3, k4], [p1, p2], [0.0; 4], false),
        ),
        (LensKind::Fisheye624, &[.., p0, p1, s0, s1, s2, s3]) if k.len() == 12 => {
            let radial = &k[..6];
            let fisheye = Polynomial::of_angles(radial, [p1, p0], [s0, s1, s2, s3], true);
            Projection::Fisheye(fisheye)
        }
        _ => {
            let cause = format!(
                "holds {} numbers, which the camera model does not have",
                k.len()
            );
            return Err(keys
                .owner(&["distortion_params"])
                .error("distortion_params", cause));
        }
    };
    let model = CameraModel {
        focal_px,
        principal_px,
        projection,
    };
    model
        .checked()
        .map(ImageLens::Resampled)
        .map_err(|cause| view.error("fl_x", cause))
}
