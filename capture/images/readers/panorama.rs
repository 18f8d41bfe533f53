//! Reader of panoramas: an equirectangular image, or six cube faces, with depth next to them. They
//! have no poses, so all lie at the origin, the centre of the image (the front face) looking down
//! -Z.
//!
//! A panorama is `NAME.png` (or `.jpg`, `.exr`), twice as wide as high, with `NAME_depth.exr`
//! (metres along the ray, as Blender writes for panoramas), `NAME_depth.png` (16 bits,
//! millimetres), `.tif`, `.tiff` or `.npy`. Cube faces are `NAME_front`, `_back`, `_left`,
//! `_right`, `_bottom`, `_top` (as Seurat's: front -Z, right +X, top +Y) with `NAME_front_depth`
//! and so on, eye depth.

use crate::cameras::lens::{Distortion, Lens, Pinhole};
use crate::cameras::pose::Pose;
use crate::depth::{DepthSource, extension};
use crate::readers::text;
use crate::views::color_images::read_size;
use crate::views::view::View;
use crate::{ImageSet, ImagesError};
use glam::DVec3;
use headbox_core::cube_face::Face;
use headbox_core::depth_kind::DepthKind;
use headbox_core::files::InputFolder;
use std::path::{Path, PathBuf};

/// Names of cube faces.
const FACES: [(&str, Face); 6] = [
    ("front", Face::NegZ),
    ("back", Face::PosZ),
    ("left", Face::NegX),
    ("right", Face::PosX),
    ("bottom", Face::NegY),
    ("top", Face::PosY),
];

/// Opens the panoramas in a folder; `None` if no image has a depth file.
pub(crate) fn open(folder: &InputFolder) -> Result<Option<ImageSet>, ImagesError> {
    let folder = folder.path();
    let mut views = Vec::new();
    for color in list_images(folder)? {
        let stem = color
            .file_stem()
            .map(|stem| stem.to_string_lossy().into_owned())
            .unwrap_or_default();
        let Some(depth) = find_depth_file(folder, &stem) else {
            continue;
        };
        let size_px = read_size(&color)?;
        let face = FACES
            .iter()
            .find(|(name, _)| stem.ends_with(&format!("_{name}")) || stem == *name);
        let (lens, kind, world_from_eye) = match face {
            Some((_, face)) if size_px[0] == size_px[1] => (
                face_lens(size_px[0]),
                DepthKind::EyeDepth,
                face.world_from_eye(),
            ),
            None if size_px[0] == 2 * size_px[1] => (
                Lens::Equirectangular,
                DepthKind::RayDistance,
                Face::NegZ.world_from_eye(),
            ),
            _ => {
                let [width, height] = size_px;
                let cause = format!(
                    "is {width}x{height} pixels; a panorama must be twice as wide as high, a cube face square"
                );
                return Err(ImagesError::invalid_picture(&color, cause));
            }
        };
        let depth = Some(DepthSource::assumed(depth, kind));
        let pose = Pose {
            eye: DVec3::ZERO,
            world_from_eye,
        };
        views.push(View::new(stem, size_px, lens, pose, color, depth));
    }
    if views.is_empty() {
        return Ok(None);
    }
    Ok(Some(ImageSet {
        notes: vec!["no poses: every panorama lies at the origin".into()],
        ..ImageSet::new(folder, "panoramas", views)
    }))
}

fn face_lens(side_px: u32) -> Lens {
    let half = f64::from(side_px) / 2.0;
    Lens::Pinhole(Pinhole {
        focal_px: [half; 2],
        principal_px: [half; 2],
        distortion: Distortion::default(),
    })
}

/// Lists the images of a folder that are not depth files, sorted by name.
fn list_images(folder: &Path) -> Result<Vec<PathBuf>, ImagesError> {
    let mut images = text::list_folder(folder)?;
    images.retain(|path| {
        let is_picture =
            ["png", "jpg", "jpeg", "exr", "hdr", "tif", "tiff"].contains(&extension(path).as_str());
        let is_depth = path
            .file_stem()
            .is_some_and(|stem| stem.to_string_lossy().ends_with("_depth"));
        is_picture && !is_depth
    });
    Ok(images)
}

fn find_depth_file(folder: &Path, stem: &str) -> Option<PathBuf> {
    ["exr", "png", "tif", "tiff", "npy"]
        .into_iter()
        .map(|ending| folder.join(format!("{stem}_depth.{ending}")))
        .find(|path| path.is_file())
}
