//! Cube LDIs from depth images of many cameras (S12, C1, C24, D1, D2).
//!
//! Every image is warped into the cube by one path. Images are loaded one after the other, so that
//! thousands of them need little memory beyond the cube's own: 0.4 MB each.
//!
//! * `depth_rows`: pixels of a depth image become patches of surface.
//! * `face_patches`: patches projected onto a face of the cube.
//! * `footprint`: patches cover face pixels.
//! * `color_queue`: interpolates the colours of samples.
//! * [`row_samples`]: samples by row of the cube.
//! * [`layers`]: samples of all images are merged by one of the papers' rules ([`MergeRule`]).
//! * `free_space`: drops averaged layers that other images see through.
//! * `nearest`: the images nearest to a view, as a cube.
//!
//! *Similar depth* is a parallax of one pixel inside the headbox, or three standard deviations of
//! the sensor's noise if that is more. Noise of structured light and stereo is constant in inverse
//! depth: sigma(Z) = sigma(1/Z) Z^2.

mod color_queue;
mod depth_rows;
mod face_patches;
mod footprint;
mod free_space;
pub mod layers;
mod nearest;
#[cfg(test)]
mod oracle;
pub mod row_samples;

pub use nearest::NearestImages;

use footprint::WarpTarget;
use free_space::FreeSpace;
use glam::DVec3;
use headbox_core::environment::Environment;
use headbox_core::memory;
use headbox_core::progress::{Progress, Silent};
use headbox_core::simd;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::model::parameters::{CaptureParameters, MergeRule};
use headbox_cube::model::samples::CubeSamples;
use headbox_images::{ImageSet, ImagesError, LoadedView, View};
use layers::LayerCube;
use rayon::prelude::*;
use row_samples::{ImageSample, RowSamplePool};
use std::sync::Arc;

/// A capture of an image set.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageSetCapture {
    /// Centre of the headbox, world metres.
    pub centre: DVec3,
    /// Half of its edge, metres.
    pub half_size_m: f64,
    /// Pixels along a side of a face.
    pub face_size_px: u32,
    /// Rule for samples at similar depth.
    pub merge_rule: MergeRule,
    /// Standard deviation of the images' inverse depths, 1/m; 0 for rendered depth.
    pub depth_noise: f32,
}

/// Number of views whose samples are in memory at once.
const BATCH: usize = 4;

/// Loader of a view by its index.
type Load<'a> = dyn Fn(usize) -> Result<Arc<LoadedView>, ImagesError> + Sync + 'a;

/// Mean direction of views; `None` if they look in all directions.
fn mean_direction(views: &[&View]) -> Option<DVec3> {
    let sum: DVec3 = views
        .iter()
        .map(|view| -view.color_pose().world_from_eye.z_axis)
        .sum();
    (sum.length() > 0.1 * views.len() as f64).then(|| sum.normalize())
}

impl ImageSetCapture {
    /// Suggests a cube about the eye nearest to the middle of a set's views (an original camera
    /// suits best, because fewer pixels are resampled twice), with the resolution of the views, and
    /// so large that it contains most of their eyes. Photographs with computed depth may surround
    /// an object: for them, a cube about the view that has the most others near it, reaching
    /// half-way to the nearest.
    pub fn suggest(set: &ImageSet) -> Self {
        let suggested = Self::for_most_eyes(set);
        match set.densest_view().filter(|_| set.has_estimated_depth()) {
            Some((view, nearest)) => Self {
                centre: set.headbox_centre.unwrap_or(view.pose.eye),
                half_size_m: nearest / 2.0,
                ..suggested
            },
            None => suggested,
        }
    }

    fn for_most_eyes(set: &ImageSet) -> Self {
        let centre = set
            .headbox_centre
            .or_else(|| set.central_view().map(|view| view.pose.eye))
            .unwrap_or(DVec3::ZERO);
        let mut distances: Vec<f64> = set
            .views
            .iter()
            .map(|view| (view.pose.eye - centre).abs().max_element())
            .collect();
        distances.sort_by(f64::total_cmp);
        let most = distances
            .get(distances.len() * 9 / 10)
            .copied()
            .unwrap_or(0.0);
        let mut focal: Vec<f64> = set
            .views_with_depth()
            .map(|view| view.lens.pixels_per_radian(view.size_px))
            .collect();
        focal.sort_by(f64::total_cmp);
        // In the middle of a face, a radian has half as many pixels as its side.
        let side = focal
            .get(focal.len() / 2)
            .map_or(1024.0, |focal| (2.0 * focal).ceil());
        Self {
            centre,
            half_size_m: most.max(0.05),
            face_size_px: (side as u32)
                .clamp(16, headbox_cube::model::validate::MAX_FACE_SIZE_PX)
                .next_multiple_of(16),
            merge_rule: MergeRule::Average,
            depth_noise: set.depth_noise(),
        }
    }

    /// Warps views into the cube, in the order given; the first is the central one (C11).
    ///
    /// # Errors
    /// [`ImagesError`] of the first view that cannot be loaded; [`ImagesError::Memory`].
    pub fn run(
        &self,
        set: &ImageSet,
        views: &[&View],
        progress: &dyn Progress,
    ) -> Result<CubeSamples, ImagesError> {
        progress.begin("images", "images", views.len() as u64);
        let merged = self.merge(views.len(), &|i| views[i].load().map(Arc::new), progress)?;
        Ok(self.cube(set, views, merged))
    }

    /// [`Self::run`] for views that are in memory.
    fn run_loaded(
        &self,
        set: &ImageSet,
        views: &[&View],
        loaded: &[Arc<LoadedView>],
    ) -> Result<CubeSamples, ImagesError> {
        let merged = self.merge(loaded.len(), &|i| Ok(Arc::clone(&loaded[i])), &Silent)?;
        Ok(self.cube(set, views, merged))
    }

    /// Warps `count` views, which `load` loads by index, and merges them in order.
    fn merge(
        &self,
        count: usize,
        load: &Load<'_>,
        progress: &dyn Progress,
    ) -> Result<LayerCube, ImagesError> {
        let parallax =
            DepthBins::new(self.half_size_m, self.face_size_px).inverse_depth(1.0) as f32;
        let tolerance = parallax.max(3.0 * self.depth_noise);
        let target = WarpTarget {
            centre: self.centre,
            face_px: self.face_size_px,
            tolerance,
            noise: self.depth_noise,
            level: simd::level(),
        };
        let mut cube = LayerCube::new(self.face_size_px, self.merge_rule, tolerance);
        let averages = self.merge_rule == MergeRule::Average;
        let mut free_spaces = Vec::new();
        let pool = RowSamplePool::default();
        let reserve = |bytes| memory::reserve(bytes as u64).map_err(ImagesError::Memory);
        // Before images are read: the faces alone may be too large.
        drop(reserve(cube.finished_bytes())?);
        for first in (0..count).step_by(BATCH) {
            if progress.is_cancelled() {
                break;
            }
            // Decoding takes longer than warping, so a batch of images is read in parallel.
            let batch = (first..count.min(first + BATCH)).into_par_iter();
            let warped = batch.map(|i| {
                let view = load(i)?;
                // Later batches reuse the memory of the first one.
                let new = if first == 0 { view.depth.len() } else { 0 };
                let memory = reserve(size_of::<ImageSample>() * new)?;
                let samples = target.warp(&view, i as u32, &pool);
                drop(memory);
                progress.advance(1);
                Ok((samples, averages.then(|| FreeSpace::new(&view))))
            });
            let warped: Vec<_> = warped.collect::<Result<_, _>>()?;
            let mut samples = Vec::new();
            for (of_view, free_space) in warped {
                samples.extend(of_view);
                free_spaces.extend(free_space);
            }
            if reserve(layers::max_layer_bytes(&samples)).is_ok() {
                cube.add(&samples);
            } else {
                // Images that show the same surfaces need less.
                for image in samples.chunk_by(|a, b| a.image == b.image) {
                    drop(reserve(layers::max_layer_bytes(image))?);
                    cube.add(image);
                }
            }
            pool.put_back(samples);
            drop(reserve(cube.finished_bytes().saturating_sub(pool.bytes()))?);
        }
        cube.drop_contradicted(&free_spaces, self.centre, tolerance);
        Ok(cube)
    }

    /// The cube LDI of merged views.
    fn cube(&self, set: &ImageSet, views: &[&View], merged: LayerCube) -> CubeSamples {
        // Cameras around an object look in all directions; the nearest one is the default.
        let distance = |view: &&&View| view.color_pose().eye.distance_squared(self.centre);
        let nearest = views
            .iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .filter(|_| set.has_estimated_depth());
        let nearest = nearest.map(|view| view.color_pose().world_from_eye);
        let info = CaptureInfo {
            ahead: nearest
                .map(|axes| -axes.z_axis)
                .or_else(|| mean_direction(views)),
            up: nearest.map(|axes| axes.y_axis).or_else(|| set.up()),
            parameters: CaptureParameters {
                merge_rule: self.merge_rule,
                ..CaptureParameters::unlit(0, 0)
            },
            ..image_set_info(set, self.centre, self.half_size_m)
        };
        CubeSamples {
            info,
            faces: merged.finish(),
            environment: Environment::default(),
        }
    }
}

/// Header fields of a capture from an image set, whose images contain their light and exposure.
pub fn image_set_info(set: &ImageSet, centre: DVec3, half_size_m: f64) -> CaptureInfo {
    CaptureInfo {
        scene: set.folder.display().to_string(),
        centre,
        half_size_m,
        frame: set.frame,
        exposure: 1.0,
        parameters: CaptureParameters::unlit(0, 0),
        ..CaptureInfo::default()
    }
}
