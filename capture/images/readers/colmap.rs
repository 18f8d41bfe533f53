//! COLMAP's models, text and binary: `cameras`, `images`; dense depth maps where they are.

use crate::depth::DepthSource;
use crate::lens::{Distortion, Lens, Pinhole};
use crate::pose::Pose;
use crate::view::View;
use crate::{ImageSet, ImagesError};
use glam::{DMat3, DQuat, DVec3};
use headbox_core::depth_kind::DepthKind;
use headbox_core::file_frame::FileFrame;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

struct Camera {
    size_px: [u32; 2],
    lens: Lens,
}

struct Image {
    pose: Pose,
    camera: u32,
    name: String,
}

/// Folders below the one that was named in which a model may lie.
const PLACES: [&str; 4] = ["", "sparse/0", "sparse", "colmap/sparse/0"];

/// The folder of a model in a folder or below it, and how its files' names end.
pub(super) fn model_of(folder: &Path) -> Option<(PathBuf, &'static str)> {
    PLACES
        .iter()
        .map(|place| folder.join(place))
        .find_map(|place| {
            let holds = |ending: &str| place.join(format!("cameras.{ending}")).is_file();
            ["bin", "txt"]
                .into_iter()
                .find(|ending| holds(ending))
                .map(|ending| (place.clone(), ending))
        })
}

pub(crate) fn open(folder: &Path) -> Result<Option<ImageSet>, ImagesError> {
    let Some((place, ending)) = model_of(folder) else {
        return Ok(None);
    };
    let (cameras_file, images_file) = (
        place.join(format!("cameras.{ending}")),
        place.join(format!("images.{ending}")),
    );
    let (cameras, images) = match ending {
        "bin" => (binary_cameras(&cameras_file)?, binary_images(&images_file)?),
        _ => (text_cameras(&cameras_file)?, text_images(&images_file)?),
    };
    if images.is_empty() {
        return Err(ImagesError::field(
            &images_file,
            "the file",
            "holds no image",
        ));
    }
    let mut views = Vec::new();
    let pictures = picture_folder(folder, &place, &images[0].name);
    for image in images {
        let camera = cameras.get(&image.camera).ok_or_else(|| {
            let cause = format!(
                "is of camera {}, which {} does not have",
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
        let &Camera { size_px, lens } = camera;
        views.push(View {
            name: image.name,
            size_px,
            lens,
            pose: image.pose,
            color,
            depth,
            mask: None,
            depth_scale: 1.0,
            color_channels: None,
            registration: None,
        });
    }
    views.sort_by(|a, b| a.name.cmp(&b.name));
    let format = if ending == "bin" {
        "COLMAP model (binary)"
    } else {
        "COLMAP model (text)"
    };
    let frame = FileFrame::default();
    Ok(Some(ImageSet {
        folder: folder.into(),
        format,
        frame,
        views,
        headbox_centre: None,
        notes: Vec::new(),
    }))
}

/// The folder of a model's pictures, of which one is called `first`: `images`, or where the model was made among them.
fn picture_folder(folder: &Path, model: &Path, first: &str) -> PathBuf {
    let mut candidates = vec![folder.join("images"), model.join("images")];
    candidates.extend(model.parent().map(|parent| parent.join("images")));
    candidates.push(folder.to_owned());
    candidates
        .iter()
        .find(|candidate| candidate.join(first).is_file())
        .cloned()
        .unwrap_or_else(|| folder.join("images"))
}

/// Names of COLMAP's camera models by number, and how many parameters each has.
const MODELS: [(&str, usize); 7] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
];

fn lens_of(model: &str, p: &[f64]) -> Result<Lens, String> {
    let shared = |radial: [f64; 6]| {
        (
            [p[0]; 2],
            [p[1], p[2]],
            Distortion {
                radial,
                tangential: [0.0; 2],
            },
        )
    };
    let own = |distortion| ([p[0], p[1]], [p[2], p[3]], distortion);
    let (focal_px, principal_px, distortion) = match model {
        "SIMPLE_PINHOLE" => shared([0.0; 6]),
        "PINHOLE" => own(Distortion::default()),
        "SIMPLE_RADIAL" => shared([p[3], 0.0, 0.0, 0.0, 0.0, 0.0]),
        "RADIAL" => shared([p[3], p[4], 0.0, 0.0, 0.0, 0.0]),
        "OPENCV" => own(Distortion {
            radial: [p[4], p[5], 0.0, 0.0, 0.0, 0.0],
            tangential: [p[6], p[7]],
        }),
        "FULL_OPENCV" => own(Distortion {
            radial: [p[4], p[5], p[8], p[9], p[10], p[11]],
            tangential: [p[6], p[7]],
        }),
        other => {
            let known = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV or FULL_OPENCV";
            return Err(format!(
                "has the model {other}; expected {known}: run COLMAP's image_undistorter first"
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

fn camera_of(
    id: u32,
    model: &str,
    size: [u64; 2],
    parameters: &[f64],
    file: &Path,
) -> Result<Camera, ImagesError> {
    let bad = |cause: String| ImagesError::field(file, format!("camera {id}"), cause);
    let lens = lens_of(model, parameters).map_err(bad)?;
    let side = |side: u64| {
        u32::try_from(side)
            .ok()
            .filter(|side| (1..=headbox_core::camera::Camera::MAX_SIDE_PX).contains(side))
    };
    let (Some(width), Some(height)) = (side(size[0]), side(size[1])) else {
        return Err(bad(format!("is {}x{} pixels", size[0], size[1])));
    };
    Ok(Camera {
        size_px: [width, height],
        lens,
    })
}

fn pose_of([w, x, y, z]: [f64; 4], translation: [f64; 3]) -> Result<Pose, String> {
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    if !(quaternion.length() > 1e-6 && quaternion.is_finite()) {
        return Err("has a quaternion that is no rotation".into());
    }
    Pose::from_camera_from_world(
        DMat3::from_quat(quaternion.normalize()),
        DVec3::from(translation),
    )
}

/// Little-endian numbers of a file, none taken for granted.
pub(super) struct Bytes<'a> {
    pub(super) file: &'a Path,
    pub(super) rest: &'a [u8],
}

impl<'a> Bytes<'a> {
    pub(super) fn take(&mut self, count: usize) -> Result<&'a [u8], ImagesError> {
        let (taken, rest) = self
            .rest
            .split_at_checked(count)
            .ok_or_else(|| self.truncated())?;
        self.rest = rest;
        Ok(taken)
    }

    pub(super) fn truncated(&self) -> ImagesError {
        ImagesError::field(
            self.file,
            "the file",
            "ends before what it says it holds: it is truncated, or no COLMAP model",
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

fn binary_cameras(file: &Path) -> Result<BTreeMap<u32, Camera>, ImagesError> {
    let bytes = std::fs::read(file).map_err(|cause| ImagesError::io(file, cause))?;
    let mut bytes = Bytes { file, rest: &bytes };
    let mut cameras = BTreeMap::new();
    for _ in 0..bytes.u64()? {
        let (id, model) = (bytes.u32()?, bytes.u32()?);
        let size = [bytes.u64()?, bytes.u64()?];
        let known = MODELS.get(model as usize);
        let &(name, count) = known.ok_or_else(|| {
            ImagesError::field(
                file,
                format!("camera {id}"),
                format!("has the unknown model number {model}"),
            )
        })?;
        let mut parameters = Vec::with_capacity(count);
        for _ in 0..count {
            parameters.push(bytes.f64()?);
        }
        cameras.insert(id, camera_of(id, name, size, &parameters, file)?);
    }
    Ok(cameras)
}

fn binary_images(file: &Path) -> Result<Vec<Image>, ImagesError> {
    let bytes = std::fs::read(file).map_err(|cause| ImagesError::io(file, cause))?;
    let mut bytes = Bytes { file, rest: &bytes };
    let mut images = Vec::new();
    for _ in 0..bytes.u64()? {
        let _id = bytes.u32()?;
        let (quaternion, translation) = (bytes.f64s()?, bytes.f64s()?);
        let camera = bytes.u32()?;
        let end = bytes
            .rest
            .iter()
            .position(|&byte| byte == 0)
            .ok_or_else(|| bytes.truncated())?;
        let name = String::from_utf8_lossy(bytes.take(end)?).into_owned();
        bytes.take(1)?;
        let points = usize::try_from(bytes.u64()?)
            .ok()
            .and_then(|points| points.checked_mul(24));
        bytes.take(points.ok_or_else(|| bytes.truncated())?)?;
        images.push(image_of(
            file,
            name,
            camera,
            pose_of(quaternion, translation),
        )?);
    }
    Ok(images)
}

fn image_of(
    file: &Path,
    name: String,
    camera: u32,
    pose: Result<Pose, String>,
) -> Result<Image, ImagesError> {
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
    Ok(Image { pose, camera, name })
}

/// Lines of a text model without comments, numbered from 1.
pub(super) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .zip(1..)
        .map(|(line, number)| (number, line.trim()))
        .filter(|(_, line)| !line.starts_with('#'))
}

fn text_cameras(file: &Path) -> Result<BTreeMap<u32, Camera>, ImagesError> {
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
        cameras.insert(
            id,
            camera_of(
                id,
                model,
                [numbers[0] as u64, numbers[1] as u64],
                &numbers[2..],
                file,
            )?,
        );
    }
    Ok(cameras)
}

fn text_images(file: &Path) -> Result<Vec<Image>, ImagesError> {
    let text = std::fs::read_to_string(file).map_err(|cause| ImagesError::io(file, cause))?;
    let mut images = Vec::new();
    // Every second line holds the image's points, and may be empty.
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
        images.push(image_of(
            file,
            name.trim().into(),
            camera,
            pose_of([qw, qx, qy, qz], [tx, ty, tz]),
        )?);
    }
    Ok(images)
}
