//! Image sets: images with known cameras, with or without depth, in the folder layouts of other
//! programs (S12, S16, S24, E2).
//!
//! Every reader converts its format's conventions to those of this crate: eye space X right, Y up,
//! looking down -Z; pixel centres at half-integers; depth as a multiple of the ray through its
//! pixel ([`Lens::ray`]). Images stay on disk until [`View::load`] is called, so that sets of
//! thousands cost no memory.
//!
//! | format | module in `readers` | data read |
//! |---|---|---|
//! | Seurat `manifest.json` | `seurat` | view groups with matrices, depth of three kinds |
//! | nerfstudio `transforms.json`, NeRF `transforms_train.json` | `nerfstudio` | poses, intrinsics, OpenCV distortion, depth in millimetres, panoramas |
//! | COLMAP, text and binary | `colmap` | cameras, poses; dense depth maps if present |
//! | RGB-D frames (TSDF demo, 7-Scenes) | `rgbd::frames` | colour, 16-bit depth, pose and intrinsics text |
//! | ScanNet, TUM and Replica sequences | `rgbd::folders` | colour, 16-bit depth, poses, intrinsics |
//! | Polycam, Record3D, `cameras.json` of 3D Gaussian Splatting | `rgbd::phone_exports` | poses, intrinsics, depth if present |
//! | Metashape's cameras (XML) | `metashape` | aligned cameras, calibrations |
//! | Middlebury `*_par.txt` | `projections::middlebury` | calibrated photographs |
//! | `NAME.P`, or `P` in a MATLAB file | `projections::matrices` | photographs with projection matrices |
//! | panoramas | `panorama` | equirectangular, or six cube faces, with depth files next to them |
//!
//! Modules in the order of work: `readers` open a folder; `views`, `cameras` (with `rectify` for
//! images that are resampled into perspective views), `depth` and `depth_files` describe and load
//! one view; `depth_evidence` finds the kind and unit of depth that no file specifies; `align` runs
//! COLMAP on photographs without poses; `check` compares neighbouring views; `refine` corrects
//! poses and `register` colour cameras; `backdrop` masks a dark background; `dense_depth` estimates
//! depth by multi-view stereo, stored next to the images and read from there afterwards;
//! `planar_layers` segments a sequence into planes; `deep_exr` reads and writes deep images;
//! `traced_view` renders views with exact depth; `error` has their errors.

pub mod align;
pub mod backdrop;
mod cameras;
pub mod check;
pub mod deep_exr;
pub mod dense_depth;
pub mod depth;
mod depth_evidence;
mod depth_files;
mod error;
pub mod planar_layers;
mod readers;
mod refine;
mod register;
mod views;

pub use crate::readers::colmap::{SparsePoint, read_sparse_points};
pub use crate::readers::nerfstudio::{SetWriter, write_set};
pub use crate::views::color_images::{ColorChannels, ColorPicture, read_color};
pub use align::{AlignError, AlignProgress, AlignStep, Alignment, align};
pub use cameras::camera_model::{CameraModel, Polynomial, Projection};
pub use cameras::lens::{Distortion, Lens, Pinhole};
pub use cameras::pose::Pose;
pub use cameras::rectify::SourceCamera;
pub use check::{CheckReport, Residual, check, check_neighbors};
pub use depth::{AssumedDepth, DepthPicture, DepthSource, write_depth_exr};
pub use error::ImagesError;
pub use refine::{RefinementReport, RefinementStep};
pub use register::{
    Exposure, Registration, RegistrationModel, RegistrationReport, RegistrationStep,
};
pub use views::traced_view;
pub use views::view::{LoadedView, MAX_DEPTH_M, View};

use crate::readers::paths::resolve;
use glam::{DMat3, DVec3};
use headbox_core::file_frame::FileFrame;
use headbox_core::files::{InputFolder, Refusal};
use headbox_core::image::codec;
use headbox_core::image::orientation::{self, Orientation};
use headbox_core::read_note::ReadNote;
use headbox_core::statistics::median;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Standard deviation of inverse depth of consumer depth sensors, 1/m: structured light has an
/// error of about 1.5 mm at one metre and 6 mm at two (Khoshelham and Elberink 2012).
const SENSOR_NOISE: f32 = 0.0015;

/// Options of [`ImageSet::open`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImageSetOptions {
    /// Follows paths and links that lead out of the set's folder, even if
    /// [`headbox_core::files::set_permissions`] does not allow it.
    pub allow_outside: bool,
}

/// A set of images with known cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageSet {
    /// Opened folder.
    pub folder: PathBuf,
    /// Name of the format, for display.
    pub format: &'static str,
    /// Mapping from the file's positions to the world. Poses of [`Self::views`] are already in
    /// world space.
    pub frame: FileFrame,
    /// Views in the file's order.
    pub views: Vec<View>,
    /// Centre for which the set was made, world metres, if the file specifies one.
    pub headbox_centre: Option<DVec3>,
    /// Notes on skipped or assumed data.
    pub notes: Vec<ReadNote>,
}

/// Creates a note that lists the images of views, and displays the first.
fn note_images(sentence: &str, views: &[&View]) -> ReadNote {
    let images: Vec<String> = views
        .iter()
        .map(|view| view.color.display().to_string())
        .collect();
    ReadNote::with_names(sentence, &images, 1)
}

/// File names of nerfstudio sets and of the training images of NeRF's synthetic scenes.
const TRANSFORMS: [&str; 2] = ["transforms.json", "transforms_train.json"];

impl ImageSet {
    /// Creates a set of views in the default frame.
    fn new(folder: &Path, format: &'static str, views: Vec<View>) -> Self {
        Self {
            folder: folder.into(),
            format,
            frame: FileFrame::default(),
            views,
            headbox_centre: None,
            notes: Vec::new(),
        }
    }

    /// Opens a folder (or a Seurat manifest, or a `transforms.json` of any name).
    ///
    /// # Errors
    /// See [`ImagesError`].
    pub fn open(path: &Path, options: &ImageSetOptions) -> Result<Self, ImagesError> {
        let is_file = path.is_file();
        let folder = if is_file {
            path.parent().unwrap_or(Path::new("."))
        } else {
            path
        };
        let folder = InputFolder::allowing_outside(folder, options.allow_outside);
        let mut set = Self::read(path, is_file, &folder)?;
        set.check_places(&folder)?;
        set.drop_missing()?;
        set.fit_image_sizes();
        set.drop_missing_depth();
        set.note_cut_images();
        set.note_turned_images();
        depth_evidence::examine(&mut set);
        dense_depth::attach(&mut set)?;
        Ok(set)
    }

    /// Drops views whose photograph is missing or is not an image: models and manifests often list
    /// more images than were distributed.
    fn drop_missing(&mut self) -> Result<(), ImagesError> {
        let all = self.views.len();
        let (views, missing): (Vec<View>, Vec<View>) = std::mem::take(&mut self.views)
            .into_iter()
            .partition(|view| view.color.exists());
        let size = |view: &View| views::color_images::read_size(&view.color).map(|_| ());
        let sizes: Vec<Result<(), ImagesError>> = views.par_iter().map(size).collect();
        let mut broken = Vec::new();
        let mut first_error = None;
        for (view, size) in views.into_iter().zip(sizes) {
            match size {
                Ok(()) => self.views.push(view),
                Err(error) => {
                    broken.push(error.to_string());
                    first_error.get_or_insert(error);
                }
            }
        }
        if self.views.is_empty() {
            let missing = missing.first().map(|view| {
                let cause = format!("file not found, nor any other of the {all} images");
                ImagesError::invalid_picture(&view.color, cause)
            });
            return first_error.or(missing).map_or(Ok(()), Err);
        }
        if !missing.is_empty() {
            let sentence = format!(
                "{} of {all} images are missing, and their views skipped",
                missing.len()
            );
            let missing: Vec<&View> = missing.iter().collect();
            self.notes.push(note_images(&sentence, &missing));
        }
        if !broken.is_empty() {
            let sentence = format!(
                "{} of {all} images cannot be read, and their views are skipped",
                broken.len()
            );
            self.notes.push(ReadNote::with_names(&sentence, &broken, 1));
        }
        Ok(())
    }

    /// Adapts views to images that were resized after their cameras were estimated.
    fn fit_image_sizes(&mut self) {
        let sizes: Vec<Option<[u32; 2]>> = self
            .views
            .par_iter()
            .map(|view| views::color_images::read_size(&view.color).ok())
            .collect();
        let mut resized = Vec::new();
        for (view, size) in self.views.iter_mut().zip(sizes) {
            let from = view.size_px;
            let fits = |to: &[u32; 2]| {
                let is_resized = *to != from && depth::has_proportions(*to, from);
                is_resized && view.source.is_none() && view.upright_turn(*to).is_none()
            };
            let Some(to) = size.filter(fits) else {
                continue;
            };
            if let Lens::Pinhole(pinhole) = view.lens {
                view.lens = Lens::Pinhole(pinhole.scaled(from, to));
            }
            view.size_px = to;
            let [[w, h], [width, height]] = [from, to];
            resized.push(format!(
                "{} ({width}x{height} pixels for {w}x{h})",
                view.name
            ));
        }
        if !resized.is_empty() {
            let sentence = format!(
                "{} of {} images have another size than the set states; focal lengths are scaled",
                resized.len(),
                self.views.len()
            );
            self.notes
                .push(ReadNote::with_names(&sentence, &resized, 1));
        }
    }

    /// Leaves out depth files that are missing or broken, unless all are.
    fn drop_missing_depth(&mut self) {
        let problem = |view: &View| {
            let path = &view.depth.as_ref()?.path;
            depth_files::read_size(path)
                .err()
                .map(|_| path.display().to_string())
        };
        let problems: Vec<Option<String>> = self.views.par_iter().map(problem).collect();
        let bad: Vec<String> = problems.iter().flatten().cloned().collect();
        let all = self.views_with_depth().count();
        if bad.is_empty() || bad.len() == all {
            return;
        }
        for (view, problem) in self.views.iter_mut().zip(&problems) {
            if problem.is_some() {
                view.depth = None;
            }
        }
        let sentence = format!(
            "{} of {all} depth files are missing or cannot be read, and their views have no depth",
            bad.len()
        );
        self.notes.push(ReadNote::with_names(&sentence, &bad, 1));
    }

    /// Notes images that are cut short: decoders pass over that.
    fn note_cut_images(&mut self) {
        let is_cut = |view: &&View| codec::is_file_cut_short(&view.color);
        let cut: Vec<&View> = self.views.iter().filter(is_cut).collect();
        if !cut.is_empty() {
            let sentence = format!(
                "{} of {} images are cut short, and their last rows missing",
                cut.len(),
                self.views.len()
            );
            let note = note_images(&sentence, &cut);
            self.notes.push(note);
        }
    }

    /// Notes images with an EXIF orientation: those that are turned upright, and those that are
    /// read as stored, because the set's size is that of the file.
    fn note_turned_images(&mut self) {
        let turn = |view: &View| orientation::read(&view.color) != Orientation::NoTransforms;
        let has_turn: Vec<bool> = self.views.par_iter().map(turn).collect();
        let marked = self.views.iter().zip(has_turn).filter(|(_, turn)| *turn);
        let is_turned = |view: &&View| {
            let size = views::color_images::read_size(&view.color);
            size.is_ok_and(|size| view.upright_turn(size).is_some())
        };
        let (turned, stored): (Vec<&View>, Vec<&View>) =
            marked.map(|(view, _)| view).partition(is_turned);
        let kinds = [
            (turned, "are turned upright by their EXIF orientation"),
            (
                stored,
                "have an EXIF orientation, but are read as stored: the set states their stored size, or none",
            ),
        ];
        for (views, what) in kinds {
            if !views.is_empty() {
                let sentence = format!("{} of {} images {what}", views.len(), self.views.len());
                self.notes.push(note_images(&sentence, &views));
            }
        }
    }

    /// Checks that the files of all views may be read: paths and links may lead out of the set.
    fn check_places(&self, folder: &InputFolder) -> Result<(), ImagesError> {
        let check = |view: &View| {
            let depth = view.depth.as_ref().map(|depth| &depth.path);
            let mut files = [Some(&view.color), depth, view.mask.as_ref()]
                .into_iter()
                .flatten();
            files.try_for_each(|file| {
                let refused = |refusal: Refusal| ImagesError::io(file, refusal.into());
                folder.check(file).map_err(refused)
            })
        };
        self.views.iter().try_for_each(check)
    }

    /// Reads the set without estimated depth.
    fn read(path: &Path, is_file: bool, folder: &InputFolder) -> Result<Self, ImagesError> {
        if !is_file {
            std::fs::read_dir(path).map_err(|cause| ImagesError::io(path, cause))?;
        }
        let find_file = |name: &str| {
            if is_file {
                let has_name = path.file_name().is_some_and(|own| own == name);
                has_name.then(|| path.to_path_buf())
            } else {
                Some(folder.path().join(name)).filter(|file| file.is_file())
            }
        };
        if let Some(file) = TRANSFORMS.into_iter().find_map(find_file) {
            return readers::nerfstudio::open(folder, &file);
        }
        if is_file && readers::nerfstudio::is_transforms(folder, path) {
            return readers::nerfstudio::open(folder, path);
        }
        let manifest = find_file("manifest.json").or_else(|| is_file.then(|| path.to_path_buf()));
        if let Some(file) = manifest {
            return readers::seurat::open(folder, &file);
        }
        for reader in [
            readers::colmap::open,
            readers::rgbd::frames::open,
            readers::rgbd::folders::open,
            readers::rgbd::phone_exports::open,
            readers::metashape::open,
            readers::projections::middlebury::open,
            readers::panorama::open,
            readers::projections::matrices::open,
        ] {
            if let Some(set) = reader(folder)? {
                return Ok(set);
            }
        }
        Err(ImagesError::NoImageSet { path: path.into() })
    }

    /// Returns the views that have depth.
    pub fn views_with_depth(&self) -> impl Iterator<Item = &View> {
        self.views.iter().filter(|view| view.depth.is_some())
    }

    /// Returns true if there is depth and all of it was estimated from the photographs.
    pub fn has_estimated_depth(&self) -> bool {
        let mut sources = self
            .views
            .iter()
            .filter_map(|view| view.depth.as_ref())
            .peekable();
        sources.peek().is_some() && sources.all(|source| source.estimated_deviation.is_some())
    }

    /// Returns the standard deviation of the views' inverse depths, 1/m: the measured one if depth
    /// was estimated from the photographs, [`SENSOR_NOISE`] if depth is stored as integers next to
    /// perspective images, else 0.
    pub fn depth_noise(&self) -> f32 {
        let deviations = self
            .views
            .iter()
            .filter_map(|view| view.depth.as_ref()?.estimated_deviation)
            .map(f64::from);
        if self.has_estimated_depth() {
            return median(deviations).unwrap_or(0.0) as f32;
        }
        let is_from_sensor = |view: &View| {
            view.depth
                .as_ref()
                .is_some_and(|depth| depth.path.extension().is_some_and(|e| e == "png"))
        };
        let first = self.views_with_depth().next();
        let sensor =
            first.is_some_and(|view| is_from_sensor(view) && matches!(view.lens, Lens::Pinhole(_)));
        if sensor { SENSOR_NOISE } else { 0.0 }
    }

    /// Returns the mean of the cameras' up directions, or `None` if they disagree.
    pub fn up(&self) -> Option<DVec3> {
        /// Minimum length of the mean of the unit vectors: a spread of about 60 degrees.
        const MIN_LENGTH: f64 = 0.5;
        let sum: DVec3 = self
            .views
            .iter()
            .map(|view| view.pose.world_from_eye.y_axis)
            .sum();
        (sum.length() > MIN_LENGTH * self.views.len() as f64).then(|| sum.normalize())
    }

    /// Returns the view with the closest neighbours, and the distance of the nearest other eye,
    /// metres (0.1 if there is none).
    pub fn densest_view(&self) -> Option<(&View, f64)> {
        /// Number of nearest views considered.
        const NEIGHBORS: usize = 4;
        let neighbor_distances = |view: &View| {
            let mut distances: Vec<f64> = self
                .views
                .iter()
                .filter(|other| !other.is_same_photograph(view))
                .map(|other| other.pose.eye.distance(view.pose.eye))
                .collect();
            if distances.len() > NEIGHBORS + 1 {
                distances.select_nth_unstable_by(NEIGHBORS, f64::total_cmp);
            }
            distances.truncate(NEIGHBORS + 1); // including the view itself
            distances.sort_by(f64::total_cmp);
            distances
        };
        let sum = |distances: &[f64]| distances.iter().sum::<f64>();
        let candidates = self
            .views
            .iter()
            .map(|view| (view, neighbor_distances(view)));
        let (view, distances) = candidates.min_by(|a, b| sum(&a.1).total_cmp(&sum(&b.1)))?;
        // Equal positions differ by the rounding of their digits in the file.
        let same = distances.last().map_or(0.0, |distance| distance * 1e-3);
        Some((
            view,
            distances
                .into_iter()
                .find(|distance| *distance > same)
                .unwrap_or(0.1),
        ))
    }

    /// Returns the point nearest to all viewing axes.
    pub fn focus(&self) -> DVec3 {
        let mut matrix = DMat3::ZERO;
        let mut right = DVec3::ZERO;
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

    /// Returns the view whose eye is nearest to the mean of all eyes: an original camera is the
    /// best centre of an LDI, because fewer pixels are resampled twice (S12).
    pub fn central_view(&self) -> Option<&View> {
        let mean = self.views.iter().map(|view| view.pose.eye).sum::<DVec3>()
            / self.views.len().max(1) as f64;
        let distance = |view: &&View| view.pose.eye.distance_squared(mean);
        self.views
            .iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }
}
