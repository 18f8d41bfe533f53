//! Reader of COLMAP's models, text and binary: `cameras`, `images`, and dense depth maps if
//! present.

use crate::depth::DepthSource;
use crate::lens::{Distortion, Lens, Pinhole};
use crate::pose::Pose;
use crate::view::View;
use crate::{ImageSet, ImagesError};
use glam::{DMat3, DQuat, DVec3};
use headbox_core::depth_kind::DepthKind;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Intrinsics of an entry of `cameras`.
struct ColmapCamera {
    size_px: [u32; 2],
    lens: Lens,
}

/// Entry of `images`.
struct ColmapImage {
    pose: Pose,
    camera: u32,
    name: String,
}

/// Subfolders in which a model may lie.
const MODEL_FOLDERS: [&str; 4] = ["", "sparse/0", "sparse", "colmap/sparse/0"];

/// Finds a model in a folder or below it: its folder and the extension of its files.
pub(super) fn find_model(folder: &Path) -> Option<(PathBuf, &'static str)> {
    MODEL_FOLDERS
        .iter()
        .map(|subfolder| folder.join(subfolder))
        .find_map(|model| {
            let has = |extension: &str| model.join(format!("cameras.{extension}")).is_file();
            ["bin", "txt"]
                .into_iter()
                .find(|extension| has(extension))
                .map(|extension| (model.clone(), extension))
        })
}

/// Opens the set in a folder; `None` without a model.
pub(crate) fn open(folder: &Path) -> Result<Option<ImageSet>, ImagesError> {
    let Some((model, extension)) = find_model(folder) else {
        return Ok(None);
    };
    let cameras_file = model.join(format!("cameras.{extension}"));
    let images_file = model.join(format!("images.{extension}"));
    let (format, cameras, images) = if extension == "bin" {
        let cameras = binary_cameras(&cameras_file)?;
        (
            "COLMAP model (binary)",
            cameras,
            binary_images(&images_file)?,
        )
    } else {
        let cameras = text_cameras(&cameras_file)?;
        ("COLMAP model (text)", cameras, text_images(&images_file)?)
    };
    if images.is_empty() {
        return Err(ImagesError::field(
            &images_file,
            "the file",
            "contains no image",
        ));
    }
    let mut views = Vec::new();
    let pictures = find_image_folder(folder, &model, &images[0].name);
    for image in images {
        let camera = cameras.get(&image.camera).ok_or_else(|| {
            let cause = format!(
                "refers to camera {}, which is missing in {}",
                image.camera,
                cameras_file.display()
            );
            ImagesError::field(&images_file, format!("image {}", image.name), cause)
        })?;
        let color = pictures.join(&image.name);
        let depth = ["geometric", "photometric"].into_iter().find_map(|kind| {
            let path = folder
                .join("stereo/depth_maps")
                .join(format!("{}.{kind}.bin", image.name));
            path.is_file()
                .then(|| DepthSource::metres(path, DepthKind::EyeDepth, 1.0))
        });
        let &ColmapCamera { size_px, lens } = camera;
        views.push(View::new(
            image.name, size_px, lens, image.pose, color, depth,
        ));
    }
    views.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(Some(ImageSet::new(folder, format, views)))
}

/// Finds the folder of a model's images by the first image's name: `images`, or a folder that
/// contains the model.
fn find_image_folder(folder: &Path, model: &Path, first: &str) -> PathBuf {
    let mut candidates = vec![folder.join("images"), model.join("images")];
    candidates.extend(model.parent().map(|parent| parent.join("images")));
    candidates.push(folder.to_owned());
    candidates
        .iter()
        .find(|candidate| candidate.join(first).is_file())
        .cloned()
        .unwrap_or_else(|| folder.join("images"))
}

/// Names and parameter counts of COLMAP's camera models by number.
const MODELS: [(&str, usize); 7] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
];

/// Converts a camera model and its parameters.
fn parse_lens(model: &str, p: &[f64]) -> Result<Lens, String> {
    let one_focal = |radial: [f64; 6]| {
        (
            [p[0]; 2],
            [p[1], p[2]],
            Distortion {
                radial,
                tangential: [0.0; 2],
            },
        )
    };
    let two_focals = |distortion| ([p[0], p[1]], [p[2], p[3]], distortion);
    let (focal_px, principal_px, distortion) = match model {
        "SIMPLE_PINHOLE" => one_focal([0.0; 6]),
        "PINHOLE" => two_focals(Distortion::default()),
        "SIMPLE_RADIAL" => one_focal([p[3], 0.0, 0.0, 0.0, 0.0, 0.0]),
        "RADIAL" => one_focal([p[3], p[4], 0.0, 0.0, 0.0, 0.0]),
        "OPENCV" => two_focals(Distortion {
            radial: [p[4], p[5], 0.0, 0.0, 0.0, 0.0],
            tangential: [p[6], p[7]],
        }),
        "FULL_OPENCV" => two_focals(Distortion {
            radial: [p[4], p[5], p[8], p[9], p[10], p[11]],
            tangential: [p[6], p[7]],
        }),
        other => {
            let known = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV or FULL_OPENCV";
            return Err(format!(
                "has the unsupported model {other}; expected {known}: run COLMAP's image_undistorter first"
            ));
        }
    };
    Ok(Lens::Pinhole(
        Pinhole {
            focal_px,
            principal_px,
            distortion,
        }
        .checked()?,
    ))
}

fn parse_camera(
    id: u32,
    model: &str,
    size: [u64; 2],
    parameters: &[f64],
    file: &Path,
) -> Result<ColmapCamera, ImagesError> {
    let bad = |cause: String| ImagesError::field(file, format!("camera {id}"), cause);
    let lens = parse_lens(model, parameters).map_err(bad)?;
    let side = |side: u64| {
        u32::try_from(side)
            .ok()
            .filter(|side| (1..=headbox_core::camera::Camera::MAX_SIDE_PX).contains(side))
    };
    let (Some(width), Some(height)) = (side(size[0]), side(size[1])) else {
        return Err(bad(format!("is {}x{} pixels", size[0], size[1])));
    };
    Ok(ColmapCamera {
        size_px: [width, height],
        lens,
    })
}

fn parse_pose([w, x, y, z]: [f64; 4], translation: [f64; 3]) -> Result<Pose, String> {
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    if !(quaternion.length() > 1e-6 && quaternion.is_finite()) {
        return Err("has a quaternion that is not a rotation".into());
    }
    Pose::from_camera_from_world(
        DMat3::from_quat(quaternion.normalize()),
        DVec3::from(translation),
    )
}

/// Bounds-checked reader of little-endian numbers.
pub(super) struct ByteReader<'a> {
    pub(super) file: &'a Path,
    pub(super) rest: &'a [u8],
}

impl<'a> ByteReader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], ImagesError> {
        let (taken, rest) = self
            .rest
            .split_at_checked(count)
            .ok_or_else(|| self.truncated())?;
        self.rest = rest;
        Ok(taken)
    }

    /// Skips a list of items of a size: their number, and the items.
    pub(super) fn skip_list(&mut self, item_bytes: usize) -> Result<(), ImagesError> {
        let bytes = usize::try_from(self.u64()?)
            .ok()
            .and_then(|count| count.checked_mul(item_bytes));
        self.take(bytes.ok_or_else(|| self.truncated())?)?;
        Ok(())
    }

    fn truncated(&self) -> ImagesError {
        ImagesError::field(
            self.file,
            "the file",
            "ends too early: it is truncated or not a COLMAP model",
        )
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], ImagesError> {
        let taken = self.take(N)?;
        taken.try_into().map_err(|_| self.truncated())
    }

    fn u32(&mut self) -> Result<u32, ImagesError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub(super) fn u64(&mut self) -> Result<u64, ImagesError> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    fn f64(&mut self) -> Result<f64, ImagesError> {
        Ok(f64::from_le_bytes(self.array()?))
    }

    pub(super) fn f64s<const N: usize>(&mut self) -> Result<[f64; N], ImagesError> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.f64()?;
        }
        Ok(numbers)
    }
}

fn binary_cameras(file: &Path) -> Result<BTreeMap<u32, ColmapCamera>, ImagesError> {
    let bytes = std::fs::read(file).map_err(|cause| ImagesError::io(file, cause))?;
    let mut bytes = ByteReader { file, rest: &bytes };
    let mut cameras = BTreeMap::new();
    for _ in 0..bytes.u64()? {
        let id = bytes.u32()?;
        let model = bytes.u32()?;
        let size = [bytes.u64()?, bytes.u64()?];
        let known = MODELS.get(model as usize);
        let &(name, count) = known.ok_or_else(|| {
            ImagesError::field(
                file,
                format!("camera {id}"),
                format!("has the unknown model number {model}"),
            )
        })?;
        let parameters: Result<Vec<f64>, _> = (0..count).map(|_| bytes.f64()).collect();
        cameras.insert(id, parse_camera(id, name, size, &parameters?, file)?);
    }
    Ok(cameras)
}

fn binary_images(file: &Path) -> Result<Vec<ColmapImage>, ImagesError> {
    let bytes = std::fs::read(file).map_err(|cause| ImagesError::io(file, cause))?;
    let mut bytes = ByteReader { file, rest: &bytes };
    let mut images = Vec::new();
    for _ in 0..bytes.u64()? {
        let _id = bytes.u32()?;
        let quaternion = bytes.f64s()?;
        let translation = bytes.f64s()?;
        let camera = bytes.u32()?;
        let end = bytes
            .rest
            .iter()
            .position(|&byte| byte == 0)
            .ok_or_else(|| bytes.truncated())?;
        let name = String::from_utf8_lossy(bytes.take(end)?).into_owned();
        bytes.take(1)?;
        bytes.skip_list(24)?; // features
        let pose = parse_pose(quaternion, translation);
        images.push(check_image(file, name, camera, pose)?);
    }
    Ok(images)
}

fn check_image(
    file: &Path,
    name: String,
    camera: u32,
    pose: Result<Pose, String>,
) -> Result<ColmapImage, ImagesError> {
    let pose = pose.map_err(|cause| ImagesError::field(file, format!("image {name}"), cause))?;
    let path = Path::new(&name);
    if path.is_absolute()
        || path
            .components()
            .any(|part| part == std::path::Component::ParentDir)
    {
        return Err(ImagesError::Outside {
            path: file.into(),
            field: "name".into(),
            leads_to: name,
        });
    }
    Ok(ColmapImage { pose, camera, name })
}

/// Returns the lines of a text model that are not comments, numbered from 1.
pub(super) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .zip(1..)
        .map(|(line, number)| (number, line.trim()))
        .filter(|(_, line)| !line.starts_with('#'))
}

fn text_cameras(file: &Path) -> Result<BTreeMap<u32, ColmapCamera>, ImagesError> {
    let text = std::fs::read_to_string(file).map_err(|cause| ImagesError::io(file, cause))?;
    let mut cameras = BTreeMap::new();
    for (number, line) in lines(&text).filter(|(_, line)| !line.is_empty()) {
        let bad = || {
            ImagesError::field(
                file,
                format!("line {number}"),
                "expected CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]",
            )
        };
        let mut words = line.split_whitespace();
        let (Some(id), Some(model)) = (words.next().and_then(|id| id.parse().ok()), words.next())
        else {
            return Err(bad());
        };
        let numbers: Option<Vec<f64>> = words.map(|word| word.parse().ok()).collect();
        let numbers = numbers
            .filter(|numbers| numbers.len() >= 2)
            .ok_or_else(bad)?;
        let count = MODELS
            .iter()
            .find(|known| known.0 == model)
            .map(|known| known.1);
        if count.is_some_and(|count| numbers.len() != count + 2) {
            return Err(bad());
        }
        let size = [numbers[0] as u64, numbers[1] as u64];
        cameras.insert(id, parse_camera(id, model, size, &numbers[2..], file)?);
    }
    Ok(cameras)
}

fn text_images(file: &Path) -> Result<Vec<ColmapImage>, ImagesError> {
    let text = std::fs::read_to_string(file).map_err(|cause| ImagesError::io(file, cause))?;
    let mut images = Vec::new();
    // Every second line lists the image's points and may be empty.
    for (number, line) in lines(&text).step_by(2).filter(|(_, line)| !line.is_empty()) {
        let bad = || {
            ImagesError::field(
                file,
                format!("line {number}"),
                "expected IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME",
            )
        };
        let words: Vec<&str> = line.splitn(10, char::is_whitespace).collect();
        let [_, qw, qx, qy, qz, tx, ty, tz, camera, name] = words[..] else {
            return Err(bad());
        };
        let numbers: Option<Vec<f64>> = [qw, qx, qy, qz, tx, ty, tz]
            .iter()
            .map(|word| word.parse().ok())
            .collect();
        let (Some(numbers), Ok(camera)) = (numbers, camera.parse()) else {
            return Err(bad());
        };
        let [qw, qx, qy, qz, tx, ty, tz] = numbers[..] else {
            return Err(bad());
        };
        let pose = parse_pose([qw, qx, qy, qz], [tx, ty, tz]);
        images.push(check_image(file, name.trim().into(), camera, pose)?);
    }
    Ok(images)
}
