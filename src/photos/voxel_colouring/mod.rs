//! A cube LDI from photographs without depth: voxel colouring in the LDI's own perspective grid
//! (S16, C14).
//!
//! The papers march outward along each ray of the LDI, project what would be there into all
//! photographs, and keep a depth pixel where all agree on a colour; how occlusion is kept in mind
//! they do not say (C14). Here all rays march together, shell by shell: a shell is a cube about the
//! centre, on whose faces every pixel is a candidate (`shells` says how far apart). Photographs
//! that see it are asked for their colours (`evidence`), and where these agree for some shells on
//! end, the best of them is kept (`runs`). What is kept claims the pixels that it covers in every
//! photograph, and claimed pixels have no say farther out (`sweep`).
//!
//! Only photographs taken from inside a shell are asked about it: distance by the largest
//! coordinate is convex along a line, so what hides a point of a shell from a camera inside lies
//! inside as well, and was swept before. Cameras on the other side of an object join in where the
//! shells have grown past them. Before a dark backdrop all are asked at once whether they see
//! through a candidate: where one sees the backdrop there is no surface, whatever lies between.
//!
//! Real photographs agree more or less: passes with ever more patience take what those before left
//! open. A pass knows its claims when a run has ended, some shells late, which is why this is
//! approximate, as the papers' is. Decisions of a shell know the claims of those before it alone,
//! and claims are sets of bits, so that the result does not depend on threads.

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
use headbox_cube::model::samples::{CubeSamples, LayeredDepthImage};
use headbox_images::backdrop;
use headbox_images::{ImageSet, ImagesError, Lens, LoadedView, View};
use photograph::Photograph;
use rayon::prelude::*;
use sweep::Sweep;

/// Parameters of voxel colouring.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotographsJob {
    /// Centre of the headbox, world metres.
    pub centre: DVec3,
    /// Half of its edge, metres.
    pub half_size_m: f64,
    /// Pixels a side of a face.
    pub face_size_px: u32,
    /// Photographs agree on a colour if its standard deviation is no more than this, levels of 255.
    pub agreement: f32,
    /// Dark background: no surface has a pixel whose channels are all at most this level.
    pub backdrop: Backdrop,
}

/// Background of the photographs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backdrop {
    /// Surfaces are everywhere.
    None,
    /// Automatic: a dark background if most of the image borders are dark.
    Auto,
    /// Pixels of which all channels are at most this.
    Dark(u8),
}

/// One march outward.
struct Pass {
    /// Standard deviation up to which photographs agree, levels.
    agreement: f32,
    /// Number of photographs that must see a surface.
    least_views: usize,
    /// The most shells of a run: as long as that photographs may agree before it is decided.
    longest_run: u32,
}

impl Pass {
    /// The variance up to which colours agree, summed over channels.
    fn agreeing_variance(&self) -> f32 {
        3.0 * self.agreement.powi(2)
    }

    /// The most that one candidate counts in the mean of its window: at edges some disagree without
    /// bound.
    fn most_variance(&self) -> f32 {
        /// In standard deviations.
        const MOST: f32 = 2.2;
        3.0 * (MOST * self.agreement).powi(2)
    }
}

/// Photographs that must see a surface: two agree too easily.
const LEAST_VIEWS: usize = 3;

/// Bytes of photographs that are in memory at once, at most; those nearest to the centre are taken.
const PHOTOGRAPHS_BYTES: u64 = 1 << 30;

impl PhotographsJob {
    /// Standard deviation up to which photographs agree by default, levels of 255.
    pub const AGREEMENT: f32 = 18.0;

    /// A cube about the camera that has the most others near it, as fine as its photograph,
    /// reaching half-way to the nearest.
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

    /// Colours the voxels that views agree on; of many views those nearest to the centre, up to a
    /// GiB of pictures.
    ///
    /// # Errors
    /// [`ImagesError`] of the first view that cannot be loaded.
    pub fn run(
        &self,
        set: &ImageSet,
        views: &[&View],
        progress: &dyn Progress,
    ) -> Result<CubeSamples, ImagesError> {
        self.run_smaller(set, views, 1, progress)
    }

    /// Same as [`Self::run`] with photographs reduced by a factor, and a cube as much coarser:
    /// faster by about its third power.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn run_smaller(
        &self,
        set: &ImageSet,
        views: &[&View],
        times: u32,
        progress: &dyn Progress,
    ) -> Result<CubeSamples, ImagesError> {
        let nearest = self.nearest(views);
        let load = |view: &&View| view.load().map(|loaded| loaded.downscaled(times));
        let loaded: Result<Vec<LoadedView>, ImagesError> = nearest.par_iter().map(load).collect();
        let (photographs, depths) = self.prepare(loaded?);
        let face_size_px = (self.face_size_px / times.max(1)).max(16);
        let faces = Self {
            face_size_px,
            ..self.clone()
        }
        .sweep(photographs, &depths, progress);
        // Cameras around an object look all ways; one looks at it as the nearest does.
        let held = nearest.first().map(|view| view.pose.world_from_eye);
        let info = CaptureInfo {
            ahead: held.map(|held| -held.z_axis),
            up: held.map(|held| held.y_axis),
            ..headbox_ldi::from_images::image_set_info(set, self.centre, self.half_size_m)
        };
        Ok(CubeSamples {
            info,
            faces,
            environment: Environment::default(),
        })
    }

    /// Prepares the photographs and the eye depths of the shells, metres.
    fn prepare(&self, views: Vec<LoadedView>) -> (Vec<Photograph>, Vec<f64>) {
        let dark = self.dark(&views);
        let photographs: Vec<Photograph> = views
            .into_iter()
            .filter_map(|view| Photograph::new(view, self.centre, dark))
            .collect();
        let depths = shells::depths(&photographs, LEAST_VIEWS);
        (photographs, depths)
    }

    fn passes(&self) -> [Pass; 3] {
        [(1.0, 16), (2.0, 32), (4.0, 64)].map(|(patience, longest_run)| Pass {
            agreement: self.agreement * patience,
            least_views: LEAST_VIEWS,
            longest_run,
        })
    }

    /// The six faces.
    fn sweep(
        &self,
        photographs: Vec<Photograph>,
        depths: &[f64],
        progress: &dyn Progress,
    ) -> Vec<LayeredDepthImage> {
        let mut sweep = Sweep::new(self, photographs);
        // Where nobody has anything to say in one pass nobody will in the next.
        let mut may_hold = vec![true; depths.len()];
        for pass in &self.passes() {
            progress.begin("colouring", "shells", depths.len() as u64);
            for (depth, may_hold) in depths.iter().zip(&mut may_hold) {
                if progress.is_cancelled() {
                    break;
                }
                if *may_hold {
                    *may_hold = sweep.shell(*depth, pass);
                } else {
                    sweep.end(pass);
                }
                progress.advance(1);
            }
            sweep.end(pass);
        }
        sweep.finish()
    }

    /// The level up to which pixels of these views show a backdrop, if they have one.
    pub fn dark(&self, views: &[LoadedView]) -> Option<u8> {
        match self.backdrop {
            Backdrop::None => None,
            Backdrop::Dark(level) => Some(level),
            Backdrop::Auto => backdrop::find_threshold(views),
        }
    }

    /// A sentence on photographs for which there is no room in memory: how many, and what to do.
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

    /// The views that are asked, the nearest first, as many as memory holds.
    fn nearest<'a>(&self, views: &[&'a View]) -> Vec<&'a View> {
        let mut views: Vec<&View> = views
            .iter()
            .copied()
            .filter(|view| matches!(view.lens, Lens::Pinhole(_)))
            .collect();
        let apart = |view: &View| view.pose.eye.distance_squared(self.centre);
        views.sort_by(|a, b| apart(a).total_cmp(&apart(b)));
        let mut bytes = 0;
        views.retain(|view| {
            bytes +=
                Photograph::BYTES_A_PIXEL * u64::from(view.size_px[0]) * u64::from(view.size_px[1]);
            bytes <= PHOTOGRAPHS_BYTES
        });
        views
    }
}
