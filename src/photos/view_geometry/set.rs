//! An image set as frames are drawn from it: its cameras with their samples, and the store of
//! pictures.

use crate::cache;
use crate::cache::InUse;
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

/// Why there is no view-dependent geometry.
#[derive(Debug, thiserror::Error)]
pub enum GeometryError {
    /// A view could not be read.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// Nothing to draw from.
    #[error(
        "{}: none of its {views} views is a perspective picture with depth, which view-dependent geometry is made of",
        folder.display()
    )]
    NoCameras {
        /// The set.
        folder: PathBuf,
        /// Its views.
        views: usize,
    },
}

/// A camera that took a picture, and what its depth image was reduced to.
#[derive(Clone, Debug)]
pub struct RealCamera {
    /// Pose of the camera, world metres.
    pub pose: Pose,
    /// Its ideal lens.
    pub lens: Pinhole,
    /// Takes no part in frames: what is judged is shown without itself.
    pub left_out: bool,
    pub(super) samples: Arc<Samples>,
}

impl RealCamera {
    /// Samples a view in memory; `None` for a panorama. Samples are relative to `origin`, world
    /// metres.
    pub(super) fn of_loaded(view: &LoadedView, grid: &SampleGrid, origin: DVec3) -> Option<Self> {
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

    /// Its viewing direction.
    pub(super) fn forward(&self) -> DVec3 {
        -self.pose.world_from_eye.z_axis
    }

    /// (x w, y w, w) of a point or direction of its eye space, x and y in pixels.
    pub(super) fn homogeneous(&self, p: DVec3) -> DVec3 {
        let Pinhole {
            focal_px,
            principal_px,
            ..
        } = self.lens;
        DVec3::new(
            focal_px[0] * p.x - principal_px[0] * p.z,
            -focal_px[1] * p.y - principal_px[1] * p.z,
            -p.z,
        )
    }
}

/// Resources for opening an image set.
#[derive(Clone, Debug, PartialEq)]
pub struct GeometryResources {
    /// Sampling of depth images.
    pub grid: SampleGrid,
    /// Bytes of pictures that are kept in memory.
    pub budget: usize,
    /// The folder in which samples are kept, so that they are there when the set is opened again;
    /// made if need be.
    pub cache: Option<PathBuf>,
}

impl Default for GeometryResources {
    /// A gibibyte of pictures, and nothing kept on disk.
    fn default() -> Self {
        Self {
            grid: SampleGrid::default(),
            budget: 1 << 30,
            cache: None,
        }
    }
}

/// An image set ready to be walked through.
pub struct ViewGeometry {
    /// The cameras, in the set's order.
    pub(super) cameras: Vec<RealCamera>,
    pub(super) pictures: PictureStore,
    /// Origin of the samples, world metres.
    pub(super) origin: DVec3,
    /// Standard deviation of inverse depths, 1/m.
    pub(super) depth_noise: f32,
    /// Mapping from the set's positions to the world.
    pub frame: FileFrame,
    folder: PathBuf,
    /// The file that samples are mapped from.
    _in_use: Option<InUse>,
    notes: Vec<String>,
}

impl ViewGeometry {
    /// Takes views (perspective pictures with depth; others are left out), samples their depth, or
    /// finds the samples kept, and keeps as many of their pictures as fit into the budget.
    ///
    /// # Errors
    /// [`GeometryError`] of the first view that cannot be read, or if there is none to draw from.
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
        let GeometryResources {
            grid,
            budget,
            cache,
        } = resources;
        let file = cache
            .as_ref()
            .and_then(|folder| sample_cache::path(folder, &views, grid, origin));
        let kept = || match &file {
            Some(file) => cache::read(file, |file| sample_cache::open(file, views.len())),
            None => (None, None),
        };
        let pictures = PictureStore::new(views.clone(), *budget);
        let (known, note) = kept();
        let cameras = match known {
            Some(cameras) => cameras,
            None => {
                let sampled = sampled(&views, grid, origin, &pictures, progress)?;
                // A cache that cannot be written costs time, and no more. What is written need not
                // stay in memory.
                let written = file
                    .as_ref()
                    .is_some_and(|file| sample_cache::write(file, &sampled).is_ok());
                match kept().0.filter(|_| written) {
                    Some(mapped) => {
                        // Of pictures that are at hand already nobody will ask for samples again.
                        mapped.iter().zip(&sampled).for_each(|(mapped, sampled)| {
                            mapped.samples.check(|| Samples::clone(&sampled.samples));
                        });
                        mapped
                    }
                    None => sampled,
                }
            }
        };
        pictures.when_read(sample_cache::check(&cameras, *grid, origin, file.clone()));
        let in_use = file.as_deref().and_then(|file| InUse::of(file).ok());
        if let Some(folder) = cache {
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

    /// Problems found when the set was opened: a sentence each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The cameras.
    pub fn cameras(&self) -> &[RealCamera] {
        &self.cameras
    }

    /// Leaves out the cameras of these indices, and no others.
    pub fn leave_out(&mut self, left_out: &[usize]) {
        for (number, camera) in self.cameras.iter_mut().enumerate() {
            camera.left_out = left_out.contains(&number);
        }
    }

    /// Bytes in memory: samples that are not mapped, and the pictures at hand.
    pub fn bytes(&self) -> usize {
        self.cameras
            .iter()
            .map(|camera| camera.samples.bytes())
            .sum::<usize>()
            + self.pictures.bytes()
    }

    /// The name of a camera's view.
    pub fn name(&self, camera: u32) -> String {
        self.pictures.name(camera)
    }

    /// Time since a camera's image was loaded, seconds; `None` if it is not in memory.
    pub fn age_s(&self, camera: u32) -> Option<f32> {
        self.pictures.age_s(camera)
    }

    /// Images that can no longer be read, with the reason: a sentence each.
    pub fn lost(&self) -> Vec<String> {
        self.pictures.lost()
    }

    /// Damaged samples in the cache that were recomputed: a sentence each.
    pub fn mended(&self) -> Vec<String> {
        let mended = self
            .cameras
            .iter()
            .zip(0..)
            .filter(|(camera, _)| camera.samples.mended().is_some());
        let sentence = |(_, number)| {
            format!(
                "the samples of {} in the cache are damaged; they are made anew",
                self.name(number)
            )
        };
        mended.map(sentence).collect()
    }

    /// A sentence for a frame that no camera serves.
    pub fn nothing_seen(&self) -> String {
        format!(
            "none of the {} cameras of {} sees what this eye looks at, within its field of view: the frame is empty",
            self.cameras.len(),
            self.folder.display()
        )
    }
}

/// Cameras of views, their depth sampled; their pictures are offered to the store, as they are read
/// anyhow.
fn sampled(
    views: &[View],
    grid: &SampleGrid,
    origin: DVec3,
    pictures: &PictureStore,
    progress: &dyn Progress,
) -> Result<Vec<RealCamera>, GeometryError> {
    progress.begin("sampling depth", "images", views.len() as u64);
    let camera = |(view, number): (&View, u32)| {
        let loaded = view.load()?;
        pictures.offer(number, || Picture::new(&loaded));
        progress.advance(1);
        Ok(RealCamera::of_loaded(&loaded, grid, origin))
    };
    let cameras: Result<Vec<Option<RealCamera>>, ImagesError> = views
        .par_iter()
        .zip(0..views.len() as u32)
        .map(camera)
        .collect();
    Ok(cameras?.into_iter().flatten().collect())
}
