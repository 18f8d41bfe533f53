//! Image sets: pictures with known cameras, with or without depth, as other programs leave them in folders (S12,
//! S16, S24, E2).
//!
//! Every reader turns its format's conventions into those of this crate: eye space X right, Y up, looking down -Z;
//! centres of pixels at halves; depth as a multiple of the ray through its pixel ([`Lens::ray`]). Pictures stay on disk until
//! [`View::load`] is called, so that sets of thousands cost no memory.
//!
//! | format | file of | what is read |
//! |---|---|---|
//! | Seurat `manifest.json` | `seurat` | view groups with matrices, depth of three kinds |
//! | nerfstudio `transforms.json`, NeRF `transforms_train.json` | `nerfstudio` | poses, intrinsics, OpenCV distortion, depth in millimetres, panoramas |
//! | COLMAP, text and binary | `colmap` | cameras, poses; dense depth maps where they are |
//! | RGB-D frames (TSDF demo, 7-Scenes) | `rgbd` | colour, 16-bit depth, pose and intrinsics text |
//! | Middlebury `*_par.txt` | `middlebury` | calibrated photographs |
//! | panoramas | `panorama` | equirectangular, or six cube faces, with depth beside them |
//!
//! Of photographs without depth it is found from the photographs (`dense_depth`), and read from beside them from then on.

pub mod align;
pub mod backdrop;
pub mod check;
mod color_images;
pub mod deep_exr;
pub mod dense_depth;
pub mod depth;
mod exr_layer;
mod lens;
pub mod planar_layers;
mod pose;
mod readers;
mod refine;
mod register;
pub mod traced_view;
mod view;

pub use crate::color_images::{ColorChannels, ColorPicture, read_color};
pub use crate::readers::colmap_points::{SparsePoint, sparse_points};
pub use crate::readers::nerfstudio::{SetWriter, write_set};
pub use align::{AlignError, AlignProgress, AlignStep, Aligned, align};
pub use check::{CheckReport, Residual, check, check_neighbors};
pub use depth::{DepthPicture, DepthSource, write_depth_exr};
pub use lens::{Distortion, Lens, Pinhole};
pub use pose::Pose;
pub use refine::{RefinementReport, RefinementStep};
pub use register::{Kept, Registration, RegistrationReport, RegistrationStep};
pub use view::{FARTHEST_M, LoadedView, View};

use glam::{DMat3, DVec3};
use headbox_core::file_frame::FileFrame;
use headbox_core::image_file::PictureError;
use headbox_core::statistics::median;
use std::path::{Path, PathBuf};

/// Standard deviation of inverse depth of consumer depth sensors, 1/m: structured light errs by some 1.5 mm at a metre and
/// six at two (Khoshelham and Elberink 2012).
const SENSOR_NOISE: f32 = 0.0015;

/// Why an image set could not be read. Each message is one sentence that names the file and, where there is one, the field.
#[derive(Debug, thiserror::Error)]
pub enum ImagesError {
    /// A file or folder cannot be opened or read.
    #[error("{}: cannot be read: {cause}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// The folder holds none of the formats that are read.
    #[error(
        "{}: no image set; expected manifest.json (Seurat), transforms.json (nerfstudio), cameras.bin or cameras.txt \
         (COLMAP), frame-*.pose.txt (RGB-D frames), *_par.txt (Middlebury), or panoramas with depth beside them \
         (NAME.png and NAME_depth.exr); a deep EXR is given by its own name",
        path.display()
    )]
    NoImageSet {
        /// The folder.
        path: PathBuf,
    },
    /// A file of the set is not what it should be.
    #[error("{}: {field}: {cause}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// Which part of it.
        field: String,
        /// What is wrong with it.
        cause: String,
    },
    /// A picture cannot be decoded.
    #[error("{}: {cause}", path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// What was expected or found.
        cause: String,
    },
    /// A path leads out of the set's folder.
    #[error("{}: {field}: \"{leads_to}\" leads out of the folder; allow it by name (--allow-outside) if you trust the file", path.display())]
    Outside {
        /// The file that says so.
        path: PathBuf,
        /// Which part of it.
        field: String,
        /// The path in question.
        leads_to: String,
    },
}

impl ImagesError {
    pub(crate) fn field(path: &Path, field: impl Into<String>, cause: impl Into<String>) -> Self {
        Self::Field {
            path: path.into(),
            field: field.into(),
            cause: cause.into(),
        }
    }

    pub(crate) fn io(path: &Path, cause: std::io::Error) -> Self {
        Self::Io {
            path: path.into(),
            cause,
        }
    }

    fn picture(path: &Path, error: PictureError) -> Self {
        match error {
            PictureError::Io(cause) => Self::io(path, cause),
            error => Self::Picture {
                path: path.into(),
                cause: error.to_string(),
            },
        }
    }
}

/// How an image set is opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImageSetOptions {
    /// Follows paths in manifests that lead out of the set's folder.
    pub allow_outside: bool,
}

/// Pictures with known cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageSet {
    /// The folder that was opened.
    pub folder: PathBuf,
    /// The format, in words.
    pub format: &'static str,
    /// How the file's positions map to the world. Poses of [`Self::views`] are in the world already.
    pub frame: FileFrame,
    /// The views, in the file's order.
    pub views: Vec<View>,
    /// The centre that the set was made for, world metres, if it says so.
    pub headbox_centre: Option<DVec3>,
    /// What was met and survived: one sentence each.
    pub notes: Vec<String>,
}

/// What nerfstudio's files are called, and those of NeRF's synthetic scenes, of which the pictures to learn from are taken.
pub const TRANSFORMS: [&str; 2] = ["transforms.json", "transforms_train.json"];

impl ImageSet {
    /// Opens a folder (or a Seurat manifest, or one of [`TRANSFORMS`]).
    ///
    /// # Errors
    /// See [`ImagesError`].
    pub fn open(path: &Path, options: &ImageSetOptions) -> Result<Self, ImagesError> {
        let mut set = Self::read(path, options)?;
        set.leave_out_missing()?;
        dense_depth::attach(&mut set)?;
        Ok(set)
    }

    /// Leaves out photographs that are not there: models and manifests often know more than were kept. Where depth comes with them, that
    /// is damage, which loading names.
    fn leave_out_missing(&mut self) -> Result<(), ImagesError> {
        let is_missing = |view: &View| view.depth.is_none() && !view.color.is_file();
        let all = self.views.len();
        let Some(first) = self
            .views
            .iter()
            .find(|view| is_missing(view))
            .map(|view| view.color.clone())
        else {
            return Ok(());
        };
        self.views.retain(|view| !is_missing(view));
        let left_out = all - self.views.len();
        if self.views.is_empty() {
            let cause = format!("there is no such file, nor any other of the {all} pictures");
            return Err(ImagesError::Picture { path: first, cause });
        }
        self.notes.push(format!(
            "{left_out} of {all} pictures are not there, such as {}; their views are left out",
            first.display()
        ));
        Ok(())
    }

    /// The set without depth that was found from its pictures.
    fn read(path: &Path, options: &ImageSetOptions) -> Result<Self, ImagesError> {
        let is_file = path.is_file();
        let folder = if is_file {
            path.parent().unwrap_or(Path::new("."))
        } else {
            path
        };
        if !is_file {
            std::fs::read_dir(path).map_err(|cause| ImagesError::io(path, cause))?;
        }
        let named = |name: &str| match is_file {
            true => path
                .file_name()
                .is_some_and(|found| found == name)
                .then(|| path.to_path_buf()),
            false => Some(folder.join(name)).filter(|file| file.is_file()),
        };
        let allow = options.allow_outside;
        if let Some(file) = TRANSFORMS.into_iter().find_map(named) {
            return readers::nerfstudio::open(&file, allow);
        }
        if let Some(file) = named("manifest.json").or_else(|| is_file.then(|| path.to_path_buf())) {
            return readers::seurat::open(&file, allow);
        }
        for reader in [
            readers::colmap::open,
            readers::rgbd::open,
            readers::middlebury::open,
            readers::panorama::open,
        ] {
            if let Some(set) = reader(folder)? {
                return Ok(set);
            }
        }
        Err(ImagesError::NoImageSet { path: path.into() })
    }

    /// The views whose depth is known.
    pub fn with_depth(&self) -> impl Iterator<Item = &View> {
        self.views.iter().filter(|view| view.depth.is_some())
    }

    /// Whether all depth that there is was found from the pictures themselves.
    pub fn depth_is_found(&self) -> bool {
        let mut sources = self
            .views
            .iter()
            .filter_map(|view| view.depth.as_ref())
            .peekable();
        sources.peek().is_some() && sources.all(|source| source.found.is_some())
    }

    /// Standard deviation of the views' inverse depths, 1/m: what was measured where depth was found from the pictures, that of sensors where
    /// depth is in integers beside perspective pictures, else 0.
    pub fn depth_noise(&self) -> f32 {
        let found = self
            .views
            .iter()
            .filter_map(|view| view.depth.as_ref()?.found)
            .map(f64::from);
        if self.depth_is_found() {
            return median(found).unwrap_or(0.0) as f32;
        }
        let from_sensor = |view: &View| {
            view.depth
                .as_ref()
                .is_some_and(|depth| depth.path.extension().is_some_and(|e| e == "png"))
        };
        let first = self.with_depth().next();
        let sensor =
            first.is_some_and(|view| from_sensor(view) && matches!(view.lens, Lens::Pinhole(_)));
        if sensor { SENSOR_NOISE } else { 0.0 }
    }

    /// The mean of the cameras' up directions, unless they disagree.
    pub fn up(&self) -> Option<DVec3> {
        /// Of the mean of unit vectors: they spread by about 60 degrees.
        const LEAST_LENGTH: f64 = 0.5;
        let sum: DVec3 = self
            .views
            .iter()
            .map(|view| view.pose.world_from_eye.y_axis)
            .sum();
        (sum.length() > LEAST_LENGTH * self.views.len() as f64).then(|| sum.normalize())
    }

    /// The view that has the most others near it, and how far away the nearest other eye is, metres (0.1 if there is none).
    pub fn densest_view(&self) -> Option<(&View, f64)> {
        /// Others that count.
        const NEIGHBORS: usize = 4;
        let spread = |view: &View| {
            let mut apart: Vec<f64> = self
                .views
                .iter()
                .map(|other| other.pose.eye.distance(view.pose.eye))
                .collect();
            if apart.len() > NEIGHBORS + 1 {
                apart.select_nth_unstable_by(NEIGHBORS, f64::total_cmp);
            }
            apart.truncate(NEIGHBORS + 1); // itself is one of them
            apart.sort_by(f64::total_cmp);
            apart
        };
        let sum = |apart: &[f64]| apart.iter().sum::<f64>();
        let spreads = self.views.iter().map(|view| (view, spread(view)));
        let (view, apart) = spreads.min_by(|a, b| sum(&a.1).total_cmp(&sum(&b.1)))?;
        // Poses of one place are written with some digits.
        let same = apart.last().map_or(0.0, |distance| distance * 1e-3);
        Some((
            view,
            apart
                .into_iter()
                .find(|distance| *distance > same)
                .unwrap_or(0.1),
        ))
    }

    /// The point nearest to all viewing axes.
    pub fn focus(&self) -> DVec3 {
        let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for view in &self.views {
            let axis = view.pose.world_from_eye.z_axis;
            let across =
                DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
            matrix += across;
            right += across * view.pose.eye;
        }
        let ahead = self.views.first().map_or(DVec3::ZERO, |view| {
            view.pose.eye - view.pose.world_from_eye.z_axis
        });
        if matrix.determinant().abs() > 1e-9 {
            matrix.inverse() * right
        } else {
            ahead
        }
    }

    /// The view whose eye is nearest to the mean of all eyes: an original camera suits best as the centre of an LDI, for
    /// fewer pixels are resampled twice (S12).
    pub fn central_view(&self) -> Option<&View> {
        let mean = self.views.iter().map(|view| view.pose.eye).sum::<DVec3>()
            / self.views.len().max(1) as f64;
        let apart = |view: &&View| view.pose.eye.distance_squared(mean);
        self.views
            .iter()
            .min_by(|a, b| apart(a).total_cmp(&apart(b)))
    }
}

/// Makes a path of a manifest one of the file system: relative to the manifest's folder, and under it unless `allow_outside`.
fn resolve(
    manifest: &Path,
    field: &str,
    written: &str,
    allow_outside: bool,
) -> Result<PathBuf, ImagesError> {
    use std::path::Component;
    if written.is_empty() {
        return Err(ImagesError::field(
            manifest,
            field,
            "is empty, and names no file",
        ));
    }
    let folder = manifest.parent().unwrap_or(Path::new(""));
    let path = Path::new(written);
    let mut depth = 0i32;
    let escapes = path.is_absolute()
        || path.components().any(|component| {
            depth += match component {
                Component::ParentDir => -1,
                Component::Normal(_) => 1,
                _ => 0,
            };
            depth < 0
        });
    if escapes && !allow_outside {
        return Err(ImagesError::Outside {
            path: manifest.into(),
            field: field.into(),
            leads_to: written.into(),
        });
    }
    Ok(folder.join(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_stay_under_their_manifest() {
        let manifest = Path::new("/data/set/manifest.json");
        let resolved = |written, allow| resolve(manifest, "color", written, allow);
        assert_eq!(
            resolved("a/../b.png", false).expect("inside"),
            Path::new("/data/set/a/../b.png")
        );
        for outside in ["../b.png", "a/../../b.png", "/etc/passwd"] {
            let error = resolved(outside, false).expect_err(outside).to_string();
            assert!(
                error.contains("manifest.json") && error.contains("color"),
                "{error}"
            );
            assert!(resolved(outside, true).is_ok());
        }
        assert!(
            resolved("", true)
                .expect_err("no name")
                .to_string()
                .contains("names no file")
        );
    }
}
