//! The papers' measurements of a walk: time and error of every way to draw it along one path,
//! exposure errors, clipping, layers and threads (R-N2 to R-N7, P-N1 to P-N10).
//!
//! All times of a pose are taken in turns ([`crate::turns`]): the best of these is the pose's.
//! Errors are against ray-traced frames of the same geometry with the same baked light.
//!
//! * `rays`: the rival: a frame by one ray a pixel.
//! * `exposure`: pixels whose backdrop shows nothing or a wrong surface.
//! * `layers`: how many samples lie in which layer.
//! * `threads`: what threads gain, and how evenly sheets and fragments would divide the work.
//! * `chart`: frame time along the path, as figure 6 of R.
//! * `table`: what was found, as a page.

mod chart;
mod exposure;
mod layers;
mod rays;
mod table;
mod threads;

pub use exposure::ExposureRow;
pub use layers::LayerRow;
pub use threads::ThreadRow;

use crate::machine::{Machine, commit};
use crate::stats::{Spread, psnr_of_mse};
use crate::turns::in_turns;
use headbox_core::camera::{Camera, CameraError};
use headbox_core::frame::Frame;
use headbox_core::progress::{Progress, Silent};
use headbox_cube::render::RenderSettings;
use headbox_house::backdrop::{Backdrop, BackdropError, BackdropKind, BackdropQuality};
use headbox_house::house::{House, HouseError};
use headbox_house::settings::{WalkSettings, WalkStats};
use headbox_house::store::Store;
use headbox_house::variant::HouseVariant;
use headbox_house::walk::Walker;
use headbox_house::walk_path::WalkPath;
use headbox_raster::PixelContent;
use headbox_trace::truth;
use image::{Rgb, RgbImage};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Instant;

/// Settings of the measurement.
#[derive(Clone, Debug)]
pub struct MeasureSettings {
    /// The walk.
    pub path: WalkPath,
    /// Quality of backdrops.
    pub quality: BackdropQuality,
    /// The ways to draw it, [`HouseVariant::ALL`] or fewer; geometry is always measured.
    pub variants: Vec<HouseVariant>,
    /// Frames of each pose and variant of which the fastest counts.
    pub repeats: u32,
    /// Errors are taken at every so manieth pose, at least 1.
    pub truth_every: usize,
    /// Rays of a pixel of truth.
    pub truth_rays: u32,
    /// Frames of how many poses are handed out, evenly spread over those with truth.
    pub pictures: usize,
}

impl Default for MeasureSettings {
    fn default() -> Self {
        Self {
            path: WalkPath::default(),
            quality: BackdropQuality::default(),
            variants: HouseVariant::ALL.to_vec(),
            repeats: 3,
            truth_every: 4,
            truth_rays: 8,
            pictures: 8,
        }
    }
}

/// Why a walk could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// The path has no cameras.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// There is no cell to walk in.
    #[error("there is no room to walk in: every cell is outside or has no floor")]
    NoPath,
    /// A backdrop could not be captured.
    #[error(transparent)]
    Backdrop(#[from] BackdropError),
    /// The house with false colours is none.
    #[error(transparent)]
    House(#[from] HouseError),
    /// Threads could not be started.
    #[error("threads could not be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// Measurements of one way to draw the walk.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VariantRow {
    /// Its name.
    pub name: String,
    /// Whole frame, ms.
    pub frame_ms: Spread,
    /// Whole frame of each pose, ms.
    pub along_path_ms: Vec<f64>,
    /// Culling and geometry, ms.
    pub geometry_ms: Spread,
    /// Backdrops, ms.
    pub backdrop_ms: Spread,
    /// Over the poses that see a backdrop: what culled geometry takes for the same, over what the
    /// backdrops take; the ratio of the sums.
    pub behind_speedup: f64,
    /// Share of the poses at which primary rays are faster.
    pub lost_to_rays: f64,
    /// PSNR of whole frames against truth, dB, from the median and the largest squared error.
    pub psnr_db: f64,
    /// See [`Self::psnr_db`].
    pub least_psnr_db: f64,
    /// The same of the pixels behind portals alone, from the mean squared error.
    pub behind_psnr_db: f64,
    /// Share of the frame that shows backdrops.
    pub backdrop_share: f64,
    /// Share of that of which nothing is known.
    pub hole_share: f64,
    /// Portals that show a backdrop, mean over poses.
    pub portals: f64,
    /// Share of the backdrops' samples that clipping removes.
    pub clipped_share: f64,
    /// Seconds for one side of one portal.
    pub capture_s: Spread,
    /// Number of captures.
    pub captures: usize,
    /// Samples of one, mean.
    pub samples: f64,
    /// Bytes of one, mean.
    pub bytes: f64,
}

/// All that was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WalkReport {
    /// Machine of the measurement.
    pub machine: Machine,
    /// By which program, as in [`commit`].
    pub commit: String,
    /// Name of the scene.
    pub scene: String,
    /// Cells of the model.
    pub cells: usize,
    /// Portals of the model.
    pub portals: usize,
    /// Triangles of the scene.
    pub triangles: usize,
    /// Frame size, px.
    pub size: [u32; 2],
    /// Poses of the walk.
    pub poses: usize,
    /// Number of poses compared with truth.
    pub truth_poses: usize,
    /// Threads.
    pub threads: usize,
    /// A frame by one ray a pixel, ms.
    pub primary_rays_ms: Spread,
    /// The same of each pose.
    pub primary_rays_along_path_ms: Vec<f64>,
    /// Times and errors.
    pub rows: Vec<VariantRow>,
    /// Exposure errors.
    pub exposure: Vec<ExposureRow>,
    /// Samples by layer.
    pub layers: Vec<LayerRow>,
    /// Speed-up by threads.
    pub parallel: Vec<ThreadRow>,
}

/// Frames of one pose: truth first, then each variant.
pub struct PosePictures {
    /// Number of the pose.
    pub pose: usize,
    /// Names and frames.
    pub frames: Vec<(&'static str, RgbImage)>,
}

/// One variant on its way.
struct Course {
    variant: HouseVariant,
    settings: WalkSettings,
    walker: Walker,
    stats: Vec<WalkStats>,
    squared_error: Vec<f64>,
    behind_error: f64,
    behind_pixels: u64,
    samples: u64,
    samples_in: u64,
    capture_s: Vec<f64>,
}

/// Measures a walk. `store` must have room for the backdrops that one pose needs in all variants,
/// and may hold some already. Frames of some poses are handed to `pictures`.
///
/// # Errors
/// See [`MeasureError`].
pub fn measure(
    house: &House,
    store: &Store,
    settings: &MeasureSettings,
    progress: &dyn Progress,
    pictures: &mut dyn FnMut(PosePictures),
) -> Result<WalkReport, MeasureError> {
    let cameras = settings.path.cameras(house)?;
    if cameras.is_empty() {
        return Err(MeasureError::NoPath);
    }
    let every = settings.truth_every.max(1);
    let truth_poses = cameras.len().div_ceil(every);
    let picture_every = every * truth_poses.div_ceil(settings.pictures.max(1));
    let mut courses = courses(&settings.variants);
    let mut rays_ms = Vec::new();
    // First, so that no frame is timed in the wake of a capture, with other things in the caches
    // and warm processors.
    progress.begin("captures", "poses", cameras.len() as u64);
    for camera in &cameras {
        for course in &mut courses {
            course.capture(house, store, camera, &settings.quality)?;
        }
        progress.advance(1);
    }
    progress.begin("walk", "poses", cameras.len() as u64);
    for (pose, camera) in cameras.iter().enumerate() {
        rays_ms.push(rays::frame_ms(house, camera, settings.repeats));
        time_pose(&mut courses, house, store, camera, settings.repeats);
        if pose % every == 0 {
            let frames = errors_of_pose(&mut courses, house, store, camera, settings.truth_rays);
            if pose % picture_every == 0 && settings.pictures > 0 {
                pictures(PosePictures { pose, frames });
            }
        }
        progress.advance(1);
    }
    let sparse: Vec<Camera> = cameras.iter().step_by(every).copied().collect();
    Ok(WalkReport {
        machine: Machine::here(),
        commit: commit(),
        scene: house.scene().name.clone(),
        cells: house.plan().cells.len(),
        portals: house.plan().portals.len(),
        triangles: house.scene().triangles.len(),
        size: settings.path.size,
        poses: cameras.len(),
        truth_poses,
        threads: rayon::current_num_threads(),
        primary_rays_ms: Spread::of(&rays_ms).unwrap_or_default(),
        primary_rays_along_path_ms: rays_ms.clone(),
        rows: rows(&courses, store, &rays_ms),
        layers: layers::layers(store),
        parallel: threads::gains(house, store, &sparse, &settings.variants)?,
        exposure: exposure::errors(house, &sparse, settings, progress)?,
    })
}

/// Geometry, then the other variants, each with its own memory of the frame before.
fn courses(variants: &[HouseVariant]) -> Vec<Course> {
    let others = variants.iter().filter(|variant| variant.kind.is_some());
    std::iter::once(&HouseVariant::ALL[0])
        .chain(others)
        .map(|&variant| Course {
            variant,
            settings: variant.settings(),
            walker: Walker::new(),
            stats: Vec::new(),
            squared_error: Vec::new(),
            behind_error: 0.0,
            behind_pixels: 0,
            samples: 0,
            samples_in: 0,
            capture_s: Vec::new(),
        })
        .collect()
}

impl Course {
    /// Captures what a frame lacks, until it lacks nothing.
    fn capture(
        &mut self,
        house: &House,
        store: &Store,
        camera: &Camera,
        quality: &BackdropQuality,
    ) -> Result<(), BackdropError> {
        let Some(kind) = self.settings.backdrops else {
            return Ok(());
        };
        while let Some(at) = Walker::missing(house, store, camera, &self.settings)
            .first()
            .copied()
        {
            let started = Instant::now();
            let backdrop = Backdrop::capture(house, at, kind, quality)?;
            self.capture_s.push(started.elapsed().as_secs_f64());
            if !store.insert((at, kind), Arc::new(backdrop)) {
                return Ok(());
            }
        }
        Ok(())
    }
}

/// The fastest of some frames of every variant.
fn time_pose(courses: &mut [Course], house: &House, store: &Store, camera: &Camera, repeats: u32) {
    let times = in_turns(courses, repeats.max(1), |_, course| {
        Some(
            course
                .walker
                .frame(house, store, camera, &course.settings)
                .1
                .clone(),
        )
    });
    for (course, times) in courses.iter_mut().zip(times) {
        course.stats.extend(
            times
                .into_iter()
                .min_by(|a, b| a.frame_ms.total_cmp(&b.frame_ms)),
        );
    }
}

/// Errors of every variant at a pose; returns truth and the frames.
fn errors_of_pose(
    courses: &mut [Course],
    house: &House,
    store: &Store,
    camera: &Camera,
    truth_rays: u32,
) -> Vec<(&'static str, RgbImage)> {
    let truth = truth::render(
        house.tracer(),
        house.lighting(),
        false,
        camera,
        truth_rays,
        &Silent,
    )
    .rgb();
    // Which pixels are behind portals is the same for all variants with backdrops; geometry is
    // judged by these too.
    let mut behind: Vec<bool> = Vec::new();
    let mut frames = vec![("truth", truth.clone())];
    for course in courses.iter_mut().rev() {
        // The same frame in one band: what clipping lets through is then counted once.
        let warp = RenderSettings {
            band_rows: camera.height(),
            ..course.settings.warp
        };
        let settings = WalkSettings {
            warp,
            ..course.settings
        };
        let (frame, stats) = course.walker.frame(house, store, camera, &settings);
        let frame = frame.clone();
        course.samples += stats.backdrop.samples;
        course.samples_in += stats.backdrop.depth_pixels_in;
        if behind.is_empty() {
            let seen = |i| matches!(course.walker.last().seen(i), PixelContent::Marker(_));
            behind = (0..frame.color.len()).map(seen).collect();
        }
        let mut sums = [0.0; 2];
        for ((found, expected), &behind) in frame.color.iter().zip(truth.pixels()).zip(&behind) {
            let squares = (0..3)
                .map(|c| (f64::from(found[c]) - f64::from(expected.0[c])).powi(2))
                .sum::<f64>();
            sums[usize::from(behind)] += squares / 3.0;
        }
        course
            .squared_error
            .push((sums[0] + sums[1]) / frame.color.len().max(1) as f64);
        course.behind_error += sums[1];
        course.behind_pixels += behind.iter().filter(|behind| **behind).count() as u64;
        frames.insert(1, (course.variant.name, image_of(&frame)));
    }
    frames
}

fn image_of(frame: &Frame) -> RgbImage {
    RgbImage::from_fn(frame.width, frame.height, |x, y| {
        let [r, g, b, _] = frame.color[(y * frame.width + x) as usize];
        Rgb([r, g, b])
    })
}

/// dB of a mean squared error in levels.
fn psnr_db(squared_error: f64) -> f64 {
    psnr_of_mse(squared_error / (255.0 * 255.0))
}

fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

fn rows(courses: &[Course], store: &Store, rays_ms: &[f64]) -> Vec<VariantRow> {
    let geometry_ms: Vec<f64> = courses
        .iter()
        .take(1)
        .flat_map(|c| c.stats.iter().map(|s| s.frame_ms))
        .collect();
    courses
        .iter()
        .map(|course| course.row(store, rays_ms, &geometry_ms))
        .collect()
}

impl Course {
    fn row(&self, store: &Store, rays_ms: &[f64], geometry_ms: &[f64]) -> VariantRow {
        let of = |number: &dyn Fn(&WalkStats) -> f64| {
            self.stats.iter().map(number).collect::<Vec<f64>>()
        };
        let spread =
            |number: &dyn Fn(&WalkStats) -> f64| Spread::of(&of(number)).unwrap_or_default();
        let sum = |number: &dyn Fn(&WalkStats) -> f64| of(number).iter().sum::<f64>();
        let lost = self
            .stats
            .iter()
            .zip(rays_ms)
            .filter(|(stats, rays)| stats.frame_ms > **rays)
            .count();
        let with_backdrops = || {
            self.stats
                .iter()
                .zip(geometry_ms)
                .filter(|(stats, _)| stats.portals > 0)
        };
        let behind_ms: f64 = with_backdrops()
            .map(|(stats, all)| (all - stats.geometry_ms).max(0.0))
            .sum();
        let backdrops_ms: f64 = with_backdrops().map(|(stats, _)| stats.backdrop_ms).sum();
        let captured: Vec<_> = store
            .all()
            .into_iter()
            .filter(|((_, kind), _)| Some(*kind) == self.variant.kind)
            .collect();
        let of_captures = |number: &dyn Fn(&Backdrop) -> u64| {
            captured
                .iter()
                .map(|(_, backdrop)| number(backdrop) as f64)
                .sum::<f64>()
                / captured.len().max(1) as f64
        };
        let pixels = sum(&|s| s.backdrop_pixels as f64);
        let squared_error = Spread::of(&self.squared_error).unwrap_or_default();
        VariantRow {
            name: self.variant.name.into(),
            frame_ms: spread(&|s| s.frame_ms),
            along_path_ms: of(&|s| s.frame_ms),
            geometry_ms: spread(&|s| s.geometry_ms),
            backdrop_ms: spread(&|s| s.backdrop_ms),
            behind_speedup: share(behind_ms, backdrops_ms),
            lost_to_rays: share(lost as f64, self.stats.len() as f64),
            psnr_db: psnr_db(squared_error.median),
            least_psnr_db: psnr_db(squared_error.worst),
            behind_psnr_db: psnr_db(share(self.behind_error, self.behind_pixels as f64)),
            backdrop_share: share(pixels, sum(&|s| s.pixels as f64)),
            hole_share: share(sum(&|s| s.hole_pixels as f64), pixels),
            portals: share(sum(&|s| f64::from(s.portals)), self.stats.len() as f64),
            clipped_share: match self.samples_in {
                0 => 0.0,
                entered => 1.0 - share(entered as f64, self.samples as f64),
            },
            capture_s: Spread::of(&self.capture_s).unwrap_or_default(),
            captures: self.capture_s.len(),
            samples: of_captures(&Backdrop::sample_count),
            bytes: of_captures(&Backdrop::bytes),
        }
    }
}

/// The kinds that are layered depth images or made of depth images.
fn has_depth(kind: BackdropKind) -> bool {
    !matches!(kind, BackdropKind::Texture | BackdropKind::Textures)
}
