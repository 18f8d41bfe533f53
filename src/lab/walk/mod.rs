//! The papers' measurements of a walk: time and error of every variant along one path, exposure
//! errors, clipping, layers and threads (R-N2 to R-N7, P-N1 to P-N10).
//!
//! The variants are timed in turns at each pose ([`crate::turns`]), and the fastest frame counts.
//! Errors are against ray-traced frames of the same geometry with the same baked light.
//!
//! * `rays`: the baseline: a frame by one ray per pixel.
//! * `exposure`: pixels whose backdrop shows a hole or a wrong surface.
//! * `layers`: distribution of samples over layers.
//! * `threads`: speed-up by threads, and how evenly sheets and fragments would divide the work.
//! * `chart`: frame time along the path, as figure 6 of R.
//! * `table`: the results as a Markdown page.

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
use crate::stats::{Spread, psnr_from_mse};
use crate::turns::run_in_turns;
use headbox_core::camera::{Camera, CameraError};
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
use image::RgbImage;
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
    /// Variants to measure, [`HouseVariant::ALL`] or fewer; geometry is always measured.
    pub variants: Vec<HouseVariant>,
    /// Frames of each pose and variant, of which the fastest counts.
    pub repeats: u32,
    /// Interval of poses at which errors are measured, at least 1.
    pub truth_every: usize,
    /// Rays per pixel of truth.
    pub truth_rays: u32,
    /// Number of poses whose frames are passed on, evenly distributed over those with truth.
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

/// Error of the measurement of a walk.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// A camera is invalid.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// No cell can be walked in.
    #[error("there is no room to walk in: every cell is outside or has no floor")]
    NoPath,
    /// A backdrop could not be captured.
    #[error(transparent)]
    Backdrop(#[from] BackdropError),
    /// The house with false colours is invalid.
    #[error(transparent)]
    House(#[from] HouseError),
    /// A thread pool could not be started.
    #[error("threads could not be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// Measurements of one variant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VariantRow {
    /// Name of the variant.
    pub name: String,
    /// Time of the whole frame, ms.
    pub frame_ms: Spread,
    /// Time of the whole frame at each pose, ms.
    pub along_path_ms: Vec<f64>,
    /// Time of culling and geometry, ms.
    pub geometry_ms: Spread,
    /// Time of the backdrops, ms.
    pub backdrop_ms: Spread,
    /// Ratio of the time of culled geometry for the area behind portals to that of the backdrops,
    /// both summed over the poses with a backdrop in view.
    pub behind_speedup: f64,
    /// Share of the poses at which primary rays are faster.
    pub lost_to_rays: f64,
    /// PSNR of whole frames against truth, dB, from the median squared error of a frame.
    pub psnr_db: f64,
    /// PSNR of whole frames against truth, dB, from the largest squared error of a frame.
    pub least_psnr_db: f64,
    /// PSNR of the pixels behind portals, dB, from their mean squared error.
    pub behind_psnr_db: f64,
    /// Share of the frame that shows backdrops.
    pub backdrop_share: f64,
    /// Share of the backdrops' pixels that are holes.
    pub hole_share: f64,
    /// Mean number of portals that show a backdrop.
    pub portals: f64,
    /// Share of the backdrops' samples that clipping removes.
    pub clipped_share: f64,
    /// Time to capture one side of one portal, seconds.
    pub capture_s: Spread,
    /// Number of captures.
    pub captures: usize,
    /// Mean number of samples of a backdrop.
    pub samples: f64,
    /// Mean size of a backdrop, bytes.
    pub bytes: f64,
}

/// Results of a walk.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WalkReport {
    /// Machine of the measurement.
    pub machine: Machine,
    /// Commit of the program, see [`commit`].
    pub commit: String,
    /// Name of the scene.
    pub scene: String,
    /// Number of cells of the model.
    pub cells: usize,
    /// Number of portals of the model.
    pub portals: usize,
    /// Number of triangles of the scene.
    pub triangles: usize,
    /// Frame size, px.
    pub size: [u32; 2],
    /// Number of poses of the walk.
    pub poses: usize,
    /// Number of poses compared with truth.
    pub truth_poses: usize,
    /// Number of threads.
    pub threads: usize,
    /// Time of a frame by one ray per pixel, ms.
    pub primary_rays_ms: Spread,
    /// Time of a frame by one ray per pixel at each pose, ms.
    pub primary_rays_along_path_ms: Vec<f64>,
    /// Times and errors of each variant.
    pub rows: Vec<VariantRow>,
    /// Exposure errors of each kind of backdrop.
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

/// Measurement of one variant in progress.
struct VariantRun {
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
/// and may contain some already. Frames of some poses are passed to `pictures`.
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
    let mut runs = variant_runs(&settings.variants);
    let mut rays_ms = Vec::new();
    // Captures come first: right after one, caches are cold for rendering and processors hot.
    progress.begin("captures", "poses", cameras.len() as u64);
    for camera in &cameras {
        for run in &mut runs {
            run.capture(house, store, camera, &settings.quality)?;
        }
        progress.advance(1);
    }
    progress.begin("walk", "poses", cameras.len() as u64);
    for (pose, camera) in cameras.iter().enumerate() {
        rays_ms.push(rays::frame_ms(house, camera, settings.repeats));
        time_pose(&mut runs, house, store, camera, settings.repeats);
        if pose % every == 0 {
            let frames = measure_errors(&mut runs, house, store, camera, settings.truth_rays);
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
        primary_rays_ms: Spread::from_values(&rays_ms).unwrap_or_default(),
        rows: rows(&runs, store, &rays_ms),
        primary_rays_along_path_ms: rays_ms,
        layers: layers::layers(store),
        parallel: threads::speedups(house, store, &sparse, &settings.variants)?,
        exposure: exposure::errors(house, &sparse, settings, progress)?,
    })
}

/// Starts a run of geometry, then of the other variants, each with a walker of its own.
fn variant_runs(variants: &[HouseVariant]) -> Vec<VariantRun> {
    let others = variants.iter().filter(|variant| variant.kind.is_some());
    std::iter::once(&HouseVariant::ALL[0])
        .chain(others)
        .map(|&variant| VariantRun {
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

impl VariantRun {
    /// Captures the backdrops that a frame needs and the store lacks.
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

/// Times `repeats` frames of every variant and records the fastest.
fn time_pose(runs: &mut [VariantRun], house: &House, store: &Store, camera: &Camera, repeats: u32) {
    let stats = run_in_turns(runs, repeats.max(1), |_, run| {
        let (_, stats) = run.walker.frame(house, store, camera, &run.settings);
        Some(stats.clone())
    });
    for (run, stats) in runs.iter_mut().zip(stats) {
        let fastest = stats
            .into_iter()
            .min_by(|a, b| a.frame_ms.total_cmp(&b.frame_ms));
        run.stats.extend(fastest);
    }
}

/// Measures the errors of every variant at a pose; returns truth and the frames.
fn measure_errors(
    runs: &mut [VariantRun],
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
    // The pixels behind portals are the same for all variants with backdrops; geometry is compared
    // there too.
    let mut behind: Vec<bool> = Vec::new();
    let mut frames = vec![("truth", truth.clone())];
    for run in runs.iter_mut().rev() {
        // In one band: a sample that survives clipping is then counted once.
        let warp = RenderSettings {
            band_rows: camera.height(),
            ..run.settings.warp
        };
        let settings = WalkSettings {
            warp,
            ..run.settings
        };
        let (frame, stats) = run.walker.frame(house, store, camera, &settings);
        let frame = frame.clone();
        run.samples += stats.backdrop.samples;
        run.samples_in += stats.backdrop.depth_pixels_in;
        if behind.is_empty() {
            let is_behind = |i| matches!(run.walker.last().seen(i), PixelContent::Marker(_));
            behind = (0..frame.color.len()).map(is_behind).collect();
        }
        let mut sums = [0.0; 2];
        for ((color, truth), &behind) in frame.color.iter().zip(truth.pixels()).zip(&behind) {
            let squares = (0..3)
                .map(|c| (f64::from(color[c]) - f64::from(truth.0[c])).powi(2))
                .sum::<f64>();
            sums[usize::from(behind)] += squares / 3.0;
        }
        run.squared_error
            .push((sums[0] + sums[1]) / frame.color.len().max(1) as f64);
        run.behind_error += sums[1];
        run.behind_pixels += behind.iter().filter(|behind| **behind).count() as u64;
        frames.insert(1, (run.variant.name, frame.to_rgb().unwrap_or_default()));
    }
    frames
}

/// Returns the PSNR of a mean squared error in sRGB levels, dB.
fn psnr_db(squared_error: f64) -> f64 {
    psnr_from_mse(squared_error / (255.0 * 255.0))
}

/// Returns `part / whole`, 0 of an empty whole.
fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

fn rows(runs: &[VariantRun], store: &Store, rays_ms: &[f64]) -> Vec<VariantRow> {
    // The first run is geometry.
    let geometry_ms: Vec<f64> = runs[0].stats.iter().map(|s| s.frame_ms).collect();
    runs.iter()
        .map(|run| run.row(store, rays_ms, &geometry_ms))
        .collect()
}

impl VariantRun {
    fn row(&self, store: &Store, rays_ms: &[f64], geometry_ms: &[f64]) -> VariantRow {
        let values = |number: &dyn Fn(&WalkStats) -> f64| {
            self.stats.iter().map(number).collect::<Vec<f64>>()
        };
        let spread = |number: &dyn Fn(&WalkStats) -> f64| {
            Spread::from_values(&values(number)).unwrap_or_default()
        };
        let sum = |number: &dyn Fn(&WalkStats) -> f64| values(number).iter().sum::<f64>();
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
        let capture_mean = |number: &dyn Fn(&Backdrop) -> u64| {
            captured
                .iter()
                .map(|(_, backdrop)| number(backdrop) as f64)
                .sum::<f64>()
                / captured.len().max(1) as f64
        };
        let pixels = sum(&|s| s.backdrop_pixels as f64);
        let squared_error = Spread::from_values(&self.squared_error).unwrap_or_default();
        VariantRow {
            name: self.variant.name.into(),
            frame_ms: spread(&|s| s.frame_ms),
            along_path_ms: values(&|s| s.frame_ms),
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
            capture_s: Spread::from_values(&self.capture_s).unwrap_or_default(),
            captures: self.capture_s.len(),
            samples: capture_mean(&Backdrop::sample_count),
            bytes: capture_mean(&Backdrop::bytes),
        }
    }
}

/// Returns true for LDIs and for backdrops made of depth images.
fn has_depth(kind: BackdropKind) -> bool {
    !matches!(kind, BackdropKind::Texture | BackdropKind::Textures)
}
