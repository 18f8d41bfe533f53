//! Cube LDIs from photographs without depth: voxel colouring in the perspective grid of the LDI
//! (S16, C14).
//!
//! The papers march outward along each ray of the LDI, project each candidate into all photographs,
//! and keep a depth pixel where all agree on a colour; they do not say how they track occlusion
//! (C14). Here all rays march together, shell by shell: a shell is a cube about the centre, and
//! every pixel of its faces is a candidate (`shells` sets the spacing). The colours of the
//! photographs that see a candidate are compared (`evidence`). Where they agree on consecutive
//! shells, the best of these is kept (`runs`). A kept candidate claims the pixels that it covers in
//! every photograph, and claimed pixels are ignored farther out (`sweep`).
//!
//! A shell is only compared with photographs taken from inside it: distance by the largest
//! coordinate is convex along a line, so an occluder between such a camera and a point of the shell
//! lies inside as well, and was swept before. Cameras on the other side of an object take part once
//! the shells have grown past them. With a dark background, all photographs are tested at once:
//! where one shows background at a candidate there is no surface, whatever lies between.
//!
//! Real photographs agree to different degrees: passes with increasing tolerance process what
//! earlier ones left open. A pass makes its claims when a run has ended, some shells late, so the
//! method is approximate, like the papers'. Decisions on a shell only depend on claims of earlier
//! shells, and claims are sets of bits, so that the result does not depend on threads.

mod evidence;
mod photograph;
mod reach;
mod runs;
mod shells;
mod sweep;
#[cfg(test)]
mod tests;

use glam::DVec3;
use headbox_core::environment::Environment;
use headbox_core::progress::Progress;
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::model::samples::CubeSamples;
use headbox_images::backdrop;
use headbox_images::{ImageSet, ImagesError, Lens, LoadedView, View};
use photograph::Photograph;
use rayon::prelude::*;
use std::time::Duration;
use sweep::Sweep;

/// Parameters of voxel colouring.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotographsJob {
    /// Centre of the headbox, world metres.
    pub centre: DVec3,
    /// Half of its edge, metres.
    pub half_size_m: f64,
    /// Size of a face, pixels.
    pub face_size_px: u32,
    /// Largest standard deviation of a colour on which photographs agree, levels of 255.
    pub agreement: f32,
    /// Background of the photographs.
    pub backdrop: Backdrop,
}

/// Background of the photographs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backdrop {
    /// Every pixel shows a surface.
    None,
    /// Detects a dark background: most of the image borders are dark.
    Auto,
    /// Pixels with all channels at most this level show background.
    Dark(u8),
}

/// Parameters of one march outward.
struct Pass {
    /// Largest standard deviation on which photographs agree, levels.
    agreement: f32,
    /// Number of photographs that must see a surface.
    min_views: usize,
    /// Maximum number of shells of a run.
    longest_run: u32,
}

impl Pass {
    /// Largest variance of colours that agree, summed over channels, levels squared.
    fn agreeing_variance(&self) -> f32 {
        3.0 * self.agreement.powi(2)
    }

    /// Largest contribution of one candidate to the mean of its window: at edges, some variances
    /// are very large.
    fn max_variance(&self) -> f32 {
        /// Limit in standard deviations.
        const MOST: f32 = 2.2;
        3.0 * (MOST * self.agreement).powi(2)
    }
}

/// Minimum number of photographs that must see a surface: two agree too easily.
const MIN_VIEWS: usize = 3;

/// Maximum bytes of photographs in memory; the nearest to the centre are used.
const PHOTOGRAPHS_BYTES: u64 = 1 << 30;

impl PhotographsJob {
    /// Default of [`Self::agreement`], levels of 255.
    pub const AGREEMENT: f32 = 18.0;

    /// Suggests a cube about the camera in the densest part of the set, with the resolution of its
    /// photograph, that reaches half-way to the nearest camera.
    pub fn suggest(set: &ImageSet) -> Self {
        let densest = set.densest_view();
        let focal = densest.map_or(512.0, |(view, _)| view.lens.pixels_per_radian(view.size_px));
        let centre = densest.map_or(DVec3::ZERO, |(view, _)| view.pose.eye);
        Self {
            centre: set.headbox_centre.unwrap_or(centre),
            half_size_m: densest.map_or(0.1, |(_, nearest)| nearest) / 2.0,
            face_size_px: ((2.0 * focal).ceil() as u32)
                .clamp(16, headbox_cube::model::validate::MAX_FACE_SIZE_PX)
                .next_multiple_of(16),
            agreement: Self::AGREEMENT,
            backdrop: Backdrop::Auto,
        }
    }

    /// Prepares voxel colouring of photographs reduced by a factor, into a cube as much coarser:
    /// its time falls by about the factor's third power. Of many views, those nearest to the centre
    /// are used, up to 1 GiB of images.
    ///
    /// # Errors
    /// [`ImagesError`] of the first view that cannot be loaded.
    pub fn prepare(
        &self,
        set: &ImageSet,
        views: &[&View],
        reduction: u32,
    ) -> Result<Colouring, ImagesError> {
        let nearest = self.nearest(views);
        let load = |view: &&View| view.load().map(|loaded| loaded.downscaled(reduction));
        let loaded: Result<Vec<LoadedView>, ImagesError> = nearest.par_iter().map(load).collect();
        let face_size_px = (self.face_size_px / reduction.max(1)).max(16);
        let job = Self {
            face_size_px,
            ..self.clone()
        };
        let (sweep, depths) = job.sweep(loaded?);
        // Cameras around an object look in all directions; take the direction of the nearest one.
        let axes = nearest.first().map(|view| view.pose.world_from_eye);
        let info = CaptureInfo {
            ahead: axes.map(|axes| -axes.z_axis),
            up: axes.map(|axes| axes.y_axis),
            ..headbox_ldi::from_images::image_set_info(set, self.centre, self.half_size_m)
        };
        Ok(Colouring {
            sweep,
            depths,
            passes: self.passes(),
            info,
        })
    }

    /// Runs voxel colouring of the whole photographs.
    ///
    /// # Errors
    /// As [`Self::prepare`].
    pub fn run(
        &self,
        set: &ImageSet,
        views: &[&View],
        progress: &dyn Progress,
    ) -> Result<CubeSamples, ImagesError> {
        Ok(self.prepare(set, views, 1)?.run(progress))
    }

    /// Creates the sweep of photographs, and the eye depths of its shells, metres.
    fn sweep(&self, views: Vec<LoadedView>) -> (Sweep, Vec<f64>) {
        let dark = self.dark(&views);
        let photographs: Vec<Photograph> = views
            .into_iter()
            .filter_map(|view| Photograph::new(view, self.centre, dark))
            .collect();
        let depths = shells::depths(&photographs, MIN_VIEWS);
        (Sweep::new(self, photographs), depths)
    }

    fn passes(&self) -> [Pass; 3] {
        [(1.0, 16), (2.0, 32), (4.0, 64)].map(|(patience, longest_run)| Pass {
            agreement: self.agreement * patience,
            min_views: MIN_VIEWS,
            longest_run,
        })
    }

    /// Returns the level up to which pixels of these views show background, if there is one.
    pub fn dark(&self, views: &[LoadedView]) -> Option<u8> {
        match self.backdrop {
            Backdrop::None => None,
            Backdrop::Dark(level) => Some(level),
            Backdrop::Auto => backdrop::find_threshold(views),
        }
    }

    /// Returns a message about photographs that do not fit into memory: their number, and a remedy.
    pub fn left_out(&self, views: &[&View]) -> Option<String> {
        let perspective = views
            .iter()
            .filter(|view| matches!(view.lens, Lens::Pinhole(_)))
            .count();
        let left_out = perspective - self.nearest(views).len();
        (left_out > 0).then(|| {
            format!(
                "{left_out} of {perspective} photographs are left out, those farthest from the headbox: all of them would need more than the {} MiB \
                 that photographs may take; make them smaller, capture from several places (--center), or find their depth first \
                 (headbox images FOLDER --depth), for then any number of them is used",
                PHOTOGRAPHS_BYTES >> 20
            )
        })
    }

    /// Returns the perspective views, the nearest to the centre first, as many as fit into memory.
    fn nearest<'a>(&self, views: &[&'a View]) -> Vec<&'a View> {
        let mut views: Vec<&View> = views
            .iter()
            .copied()
            .filter(|view| matches!(view.lens, Lens::Pinhole(_)))
            .collect();
        let distance_squared = |view: &View| view.pose.eye.distance_squared(self.centre);
        views.sort_by(|a, b| distance_squared(a).total_cmp(&distance_squared(b)));
        let mut bytes = 0;
        views.retain(|view| {
            bytes += Photograph::BYTES_PER_PIXEL
                * u64::from(view.size_px[0])
                * u64::from(view.size_px[1]);
            bytes <= PHOTOGRAPHS_BYTES
        });
        views
    }
}

/// Voxel colouring that is ready to run.
pub struct Colouring {
    sweep: Sweep,
    /// Eye depths of the shells, metres, near to far.
    depths: Vec<f64>,
    passes: [Pass; 3],
    info: CaptureInfo,
}

impl Colouring {
    /// Size of the cube's faces, pixels.
    pub fn face_size_px(&self) -> u32 {
        self.sweep.face_size_px()
    }

    /// Estimates the time of [`Self::run`] by timing a small sample of its work.
    pub fn estimate(&self) -> Duration {
        self.sweep.estimate(&self.depths, &self.passes)
    }

    /// Runs voxel colouring, as one stage of progress. A cancelled run returns what it has.
    pub fn run(self, progress: &dyn Progress) -> CubeSamples {
        CubeSamples {
            info: self.info,
            faces: self.sweep.run(&self.depths, &self.passes, progress),
            environment: Environment::default(),
        }
    }
}
