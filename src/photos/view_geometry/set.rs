//! Image set prepared for rendering: its cameras with their samples, and the image store.

use crate::cache::{self, FileLock};
use crate::view_geometry::cameras::picture::Picture;
use crate::view_geometry::cameras::sample_cache;
use crate::view_geometry::cameras::samples::{SampleGrid, Samples};
use crate::view_geometry::cameras::store::PictureStore;
use glam::DVec3;
use headbox_core::file_frame::FileFrame;
use headbox_core::progress::Progress;
use headbox_images::{ImageSet, ImagesError, Lens, LoadedView, Pinhole, Pose, View};
use rayon::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// Error of opening view-dependent geometry.
#[derive(Debug, thiserror::Error)]
pub enum GeometryError {
    /// A view cannot be read.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// No view is usable.
    #[error(
        "{}: none of its {views} views is a perspective picture with depth, which view-dependent geometry is made of",
        folder.display()
    )]
    NoCameras {
        /// Folder of the set.
        folder: PathBuf,
        /// Number of its views.
        views: usize,
    },
}

/// Camera of an image, and the samples of its depth.
#[derive(Clone, Debug)]
pub struct RealCamera {
    /// Pose of the camera, world metres.
    pub pose: Pose,
    /// Lens without distortion.
    pub lens: Pinhole,
    /// True to exclude the camera from frames, for example while its own image is compared with
    /// them.
    pub left_out: bool,
    pub(super) samples: Arc<Samples>,
}

impl RealCamera {
    /// Samples a view in memory, relative to `origin`, world metres; `None` for a panorama.
    pub(super) fn from_loaded(view: &LoadedView, grid: &SampleGrid, origin: DVec3) -> Option<Self> {
        let Lens::Pinhole(lens) = view.lens else {
            return None;
        };
        let samples = Arc::new(Samples::new(view, grid, origin));
        Some(Self {
            pose: view.pose,
            lens,
            left_out: false,
            samples,
        })
    }

    /// Viewing direction.
    pub(super) fn forward(&self) -> DVec3 {
        -self.pose.world_from_eye.z_axis
    }

    /// Projects a point or direction of eye space to (x w, y w, w), x and y in pixels.
    pub(super) fn homogeneous(&self, p: DVec3) -> DVec3 {
        let [fx, fy] = self.lens.focal_px;
        let [cx, cy] = self.lens.principal_px;
        DVec3::new(fx * p.x - cx * p.z, -fy * p.y - cy * p.z, -p.z)
    }
}

/// Memory and cache for an image set.
#[derive(Clone, Debug, PartialEq)]
pub struct GeometryResources {
    /// Sampling of depth images.
    pub grid: SampleGrid,
    /// Bytes of images in memory.
    pub budget: usize,
    /// Folder of cached samples, created if necessary; `None` for no cache.
    pub cache: Option<PathBuf>,
}

impl Default for GeometryResources {
    /// 1 GiB of images, and no cache on disk.
    fn default() -> Self {
        Self {
            grid: SampleGrid::default(),
            budget: 1 << 30,
            cache: None,
        }
    }
}

/// Image set ready for rendering.
pub struct ViewGeometry {
    /// Cameras, in the set's order.
    pub(super) cameras: Vec<RealCamera>,
    pub(super) pictures: PictureStore,
    /// Origin of the samples, world metres.
    pub(super) origin: DVec3,
    /// Standard deviation of inverse depths, 1/m.
    pub(super) depth_noise: f32,
    /// Mapping from the set's positions to the world.
    pub frame: FileFrame,
    folder: PathBuf,
    /// Lock on the file with the samples.
    _in_use: Option<FileLock>,
    notes: Vec<String>,
}

impl ViewGeometry {
    /// Opens the perspective views with depth among `views`: samples their depth or reads the
    /// cached samples, and keeps as many of their images as fit into the budget.
    ///
    /// # Errors
    /// [`GeometryError`] of the first view that cannot be read, or if no view is usable.
    pub fn open(
        set: &ImageSet,
        views: &[&View],
        resources: &GeometryResources,
        progress: &dyn Progress,
    ) -> Result<Self, GeometryError> {
        let usable = |view: &&&View| matches!(view.lens, Lens::Pinhole(_)) && view.depth.is_some();
        let views: Vec<View> = views
            .iter()
            .filter(usable)
            .map(|view| (*view).clone())
            .collect();
        if views.is_empty() {
            return Err(GeometryError::NoCameras {
                folder: set.folder.clone(),
                views: set.views.len(),
            });
        }
        let origin = views.iter().map(|view| view.pose.eye).sum::<DVec3>() / views.len() as f64;
        let (grid, cache) = (&resources.grid, &resources.cache);
        let file = cache
            .as_ref()
            .and_then(|folder| sample_cache::path(folder, &views, grid, origin));
        let (file, link) = cache::refuse_links(file);
        let read_cached = || match &file {
            Some(file) => cache::read(file, |file| sample_cache::open(file, views.len())),
            None => (None, link.clone()),
        };
        let pictures = PictureStore::new(views.clone(), resources.budget);
        let (known, note) = read_cached();
        let cameras = match known {
            Some(cameras) => cameras,
            None => {
                let sampled =
                    sample_views(&views, grid, origin, (&pictures, file.is_some()), progress)?;
                // A cache that cannot be written only costs time. Written samples need not stay in
                // memory.
                let written = file
                    .as_ref()
                    .is_some_and(|file| sample_cache::write(file, &sampled).is_ok());
                let stored = read_cached().0.filter(|_| written);
                stored.unwrap_or(sampled)
            }
        };
        pictures.set_on_load(sample_cache::read_on_load(
            &cameras,
            *grid,
            origin,
            file.clone(),
        ));
        let in_use = file.as_deref().and_then(|file| FileLock::of(file).ok());
        if let Some(folder) = cache.as_ref().filter(|_| file.is_some()) {
            cache::evict_to(folder, cache::MOST_BYTES);
        }
        Ok(Self {
            cameras,
            pictures,
            origin,
            depth_noise: set.depth_noise(),
            frame: set.frame,
            folder: set.folder.clone(),
            _in_use: in_use,
            notes: note.into_iter().collect(),
        })
    }

    /// Returns problems found when the set was opened, a sentence each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Returns the cameras.
    pub fn cameras(&self) -> &[RealCamera] {
        &self.cameras
    }

    /// Excludes exactly the cameras with these indices from frames.
    pub fn leave_out(&mut self, left_out: &[usize]) {
        for (number, camera) in self.cameras.iter_mut().enumerate() {
            camera.left_out = left_out.contains(&number);
        }
    }

    /// Bytes in memory: samples that are not in a file, and images.
    pub fn bytes(&self) -> usize {
        self.cameras
            .iter()
            .map(|camera| camera.samples.bytes())
            .sum::<usize>()
            + self.pictures.bytes()
    }

    /// Reports damaged samples in the cache that were recomputed, a sentence each.
    pub fn repaired(&self) -> Vec<String> {
        let repaired = self
            .cameras
            .iter()
            .zip(0..)
            .filter(|(camera, _)| camera.samples.is_damaged());
        let sentence = |(_, number)| {
            let name = self.pictures.name(number);
            format!("the samples of {name} in the cache are damaged; they are made anew")
        };
        repaired.map(sentence).collect()
    }

    /// Returns the message for a frame without a valid camera.
    pub fn nothing_seen(&self) -> String {
        format!(
            "none of the {} cameras of {} sees what this eye looks at, within its field of view: the frame is empty",
            self.cameras.len(),
            self.folder.display()
        )
    }
}

/// Samples the depth of views, and offers their images to the store, as they are loaded anyway;
/// with their samples if these will be stored in a file.
fn sample_views(
    views: &[View],
    grid: &SampleGrid,
    origin: DVec3,
    (pictures, stores): (&PictureStore, bool),
    progress: &dyn Progress,
) -> Result<Vec<RealCamera>, GeometryError> {
    progress.begin("sampling depth", "images", views.len() as u64);
    let camera = |(view, number): (&View, u32)| {
        let loaded = view.load()?;
        let camera = RealCamera::from_loaded(&loaded, grid, origin);
        let samples = camera.as_ref().filter(|_| stores);
        pictures.offer(number, || {
            let samples = samples.map(|camera| Arc::clone(&camera.samples));
            Picture::new(&loaded).with_samples(samples)
        });
        progress.advance(1);
        Ok(camera)
    };
    let cameras: Result<Vec<Option<RealCamera>>, ImagesError> = views
        .par_iter()
        .zip(0..views.len() as u32)
        .map(camera)
        .collect();
    Ok(cameras?.into_iter().flatten().collect())
}
