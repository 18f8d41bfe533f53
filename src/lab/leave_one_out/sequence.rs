//! Leave-one-out test of sprites from a sequence: left-out photographs are compared with sprites,
//! and the sprites' depth with known depth (S10).
//!
//! Every third photograph is left out. Those near the middle photograph are rendered: by `nearest`,
//! the nearest other photograph on a plane that faces it; by `plane` and `plane-with-depth`, the
//! middle photograph as one sprite, without and with displacements; by `layers` and
//! `layers-with-depth`, one sprite per layer, likewise. Errors are measured at pixels that all
//! variants cover.

use super::held_out::{
    HOLE, HeldOutComparison, HeldOutFrame, HeldOutRow, HoldOutError, VariantRows, pinhole_camera,
    reproject,
};
use super::photographs::draw_on_plane;
use crate::machine::{Machine, commit};
use crate::table::{Table, figure, percent};
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_core::statistics::median;
use headbox_images::dense_depth::Agreement;
use headbox_images::planar_layers::{Frames, LayerJob, LayersError, PlanarLayers};
use headbox_images::{Exposure, ImageSet, LoadedView, Pose, View};
use headbox_sprite::compose::{ComposeSettings, Composer, Composition};
use headbox_sprite::{
    DisplacementFormat, RenderOptions, SpriteError, SpriteSet, SpriteVariant, sprites_from_layers,
};
use image::RgbImage;
use serde::Serialize;
use std::time::Instant;

/// Interval of the left-out photographs.
const HOLD_OUT: usize = 3;

/// Cosine of the maximum angle between the viewing directions of a rendered photograph and the
/// middle one (30 degrees).
const SAME_WAY: f64 = 0.866;

/// Maximum number of rendered photographs.
const SHOWN: usize = 6;

/// Names of all variants.
const VARIANTS: [&str; 5] = [
    "nearest",
    "plane",
    "plane-with-depth",
    "layers",
    "layers-with-depth",
];

/// Error of the test of a sequence.
#[derive(Debug, thiserror::Error)]
pub enum SequenceError {
    /// Error of left-out views and frames.
    #[error(transparent)]
    HoldOut(#[from] HoldOutError),
    /// Layers could not be segmented.
    #[error(transparent)]
    Layers(#[from] LayersError),
    /// Layers could not be converted to sprites.
    #[error(transparent)]
    Sprite(#[from] SpriteError),
}

/// Agreement of estimated depth with known depth.
#[derive(Clone, Debug, Serialize)]
pub struct DepthRow {
    /// Kind of depth: `matched`, `planes` or `layers`.
    pub of: &'static str,
    /// Share of the pixels with known depth that have an estimate.
    pub covered: f64,
    /// Shares of estimates within 1, 2 and 5 %.
    pub within: [f64; 3],
    /// Median relative error.
    pub median: f64,
}

/// Results of the test of a sequence.
#[derive(Clone, Debug, Serialize)]
pub struct SequenceReport {
    /// Machine of the measurement.
    pub machine: Machine,
    /// Commit of the program, see [`commit`].
    pub commit: String,
    /// Names of the photographs that the sprites were made from, the middle one first.
    pub used: Vec<String>,
    /// Number of layers.
    pub layers: usize,
    /// Rows for each photograph and variant.
    pub rows: Vec<HeldOutRow>,
    /// Errors of the depth of the middle photograph; empty if its depth is unknown.
    pub depth: Vec<DepthRow>,
}

/// Splits a set: returns the set and the job without the left-out views, and the left-out views,
/// nearest to the middle one first.
///
/// # Errors
/// [`HoldOutError::TooFew`].
pub fn leave_out(
    set: &ImageSet,
    job: &LayerJob,
) -> Result<(ImageSet, LayerJob, Vec<View>), SequenceError> {
    let is_left_out = |i: usize| (i + HOLD_OUT - job.view % HOLD_OUT) % HOLD_OUT == 1;
    let (left_out, kept): (Vec<usize>, Vec<usize>) =
        (0..set.views.len()).partition(|i| is_left_out(*i));
    let too_few = |found, what, least| HoldOutError::TooFew { found, what, least };
    let view = kept.iter().position(|i| *i == job.view);
    let Some(view) = view.filter(|_| !left_out.is_empty()) else {
        return Err(too_few(set.views.len(), "photographs", HOLD_OUT).into());
    };
    let mut left_out: Vec<View> = left_out.iter().map(|i| set.views[*i].clone()).collect();
    let Pose {
        eye,
        world_from_eye,
    } = set.views[job.view].pose;
    left_out.retain(|view| view.pose.world_from_eye.z_axis.dot(world_from_eye.z_axis) > SAME_WAY);
    if left_out.is_empty() {
        let what = "photographs that look the same way";
        return Err(too_few(kept.len() + 1, what, 2).into());
    }
    left_out.sort_by(|a, b| {
        a.pose
            .eye
            .distance(eye)
            .total_cmp(&b.pose.eye.distance(eye))
    });
    // At most `SHOWN`, from near to far.
    let step = left_out.len().div_ceil(SHOWN);
    let left_out = left_out.into_iter().step_by(step).collect();
    let views = kept.iter().map(|i| set.views[*i].clone()).collect();
    Ok((
        ImageSet {
            views,
            ..set.clone()
        },
        LayerJob {
            view,
            ..job.clone()
        },
        left_out,
    ))
}

/// Measures the layers of `frames`; `show` receives the name of each left-out photograph, the
/// photograph and a frame of each variant.
///
/// # Errors
/// See [`SequenceError`].
pub fn measure(
    set: &ImageSet,
    job: &LayerJob,
    frames: &Frames,
    left_out: &[View],
    show: &mut dyn FnMut(&str, &[&RgbImage]),
) -> Result<(SequenceReport, PlanarLayers), SequenceError> {
    let started = Instant::now();
    let layers = job.segment(frames)?;
    let build_ms = started.elapsed().as_secs_f64() * 1e3;
    let single = LayerJob {
        layers: 1,
        masks: Vec::new(),
        ..job.clone()
    }
    .segment(frames)?;
    let composition = |layers: &PlanarLayers| -> Result<Composition, SpriteError> {
        let sprites = sprites_from_layers(layers, DisplacementFormat::default())?;
        Ok(Composition::new(SpriteSet::new(sprites), Vec::new()))
    };
    let sprites = [composition(&single)?, composition(&layers)?];
    let used: Vec<&View> = set
        .views
        .iter()
        .filter(|view| layers.used.contains(&view.name))
        .collect();
    let ahead = median(
        layers
            .matched_depth
            .iter()
            .filter(|d| d.is_finite())
            .map(|d| f64::from(*d)),
    )
    .unwrap_or(1.0);
    let focus = layers.camera.eye() + layers.camera.forward() * ahead;
    let mut rows = Vec::new();
    for view in left_out {
        let held = view.load().map_err(HoldOutError::from)?;
        let Some(camera) = pinhole_camera(&held) else {
            continue;
        };
        let (truth, visible) = reproject(&held, &camera);
        let distance = |other: &&&View| other.pose.eye.distance(view.pose.eye);
        let nearest = used
            .iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let Some(nearest) = nearest else { continue };
        let nearest = nearest.load().map_err(HoldOutError::from)?;
        let mut frames = vec![draw_on_plane(&nearest, &camera, focus)];
        for sprites in &sprites {
            for variant in [SpriteVariant::Homography, SpriteVariant::TwoPass] {
                frames.push(draw_sprites(sprites, variant, &camera, build_ms));
            }
        }
        let scene = set.folder.display().to_string();
        let comparison = HeldOutComparison::covered_by_all(
            &scene,
            &view.name,
            &truth,
            &visible,
            &vec![false; visible.len()],
            &frames,
        );
        rows.extend(comparison.rows(VARIANTS, &frames));
        show(&view.name, &comparison.pictures(&frames));
    }
    let depth = depth_rows(&set.views[job.view], &layers)?;
    let report = SequenceReport {
        machine: Machine::here(),
        commit: commit(),
        used: layers.used.clone(),
        layers: layers.layers.len(),
        rows,
        depth,
    };
    Ok((report, layers))
}

/// Draws a frame of sprites; holes are magenta.
fn draw_sprites(
    sprites: &Composition,
    variant: SpriteVariant,
    camera: &Camera,
    build_ms: f64,
) -> HeldOutFrame {
    let (mut composer, mut frame) = (Composer::default(), Frame::default());
    let settings = ComposeSettings {
        sprites: RenderOptions {
            variant,
            ..RenderOptions::default()
        },
        ..ComposeSettings::default()
    };
    sprites.render(&mut composer, camera, &settings, &mut frame);
    let stats = sprites.render(&mut composer, camera, &settings, &mut frame);
    let bytes = sprites.sprites().sprites().iter().map(|sprite| {
        let sprite = sprite.sprite();
        let (columns, rows) = sprite.displacement().size();
        sprite.sprite().color().len() + (columns * rows) as usize
    });
    let frame_ms = stats.sprites_ms + stats.cubes_ms + stats.compose_ms;
    let hole = Some(HOLE);
    HeldOutFrame::new(
        &frame,
        Exposure::EVEN,
        hole,
        frame_ms,
        build_ms,
        bytes.sum(),
    )
}

/// Compares the estimated depth of the middle view, and that of its planes and layers, with the
/// depth in its files.
fn depth_rows(view: &View, layers: &PlanarLayers) -> Result<Vec<DepthRow>, HoldOutError> {
    if !view.has_own_depth() {
        return Ok(Vec::new());
    }
    let known = reproject_depth(&view.load()?, &layers.camera);
    let row = |of: &'static str, depth: &[f32]| {
        let mut agreement = Agreement::default();
        agreement.add(depth, &known);
        DepthRow {
            of,
            covered: agreement.covered_share(),
            within: agreement.shares_within(),
            median: agreement.median_error(),
        }
    };
    Ok(vec![
        row("matched", &layers.matched_depth),
        row("planes", &layers.plane_depth),
        row("layers", &layers.depth()),
    ])
}

/// Samples the depth of a view at the pixels of a camera with the same pose, NaN where unknown.
fn reproject_depth(view: &LoadedView, camera: &Camera) -> Vec<f32> {
    let depth = |pixel: u32| {
        let (x, y) = (pixel % camera.width(), pixel / camera.width());
        let ahead = camera.eye() + camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let [px, py, _] = view.lens.project(view.pose.to_eye(ahead), view.size_px)?;
        let [width, height] = view.size_px.map(f64::from);
        let inside = px >= 0.0 && py >= 0.0 && px < width && py < height;
        inside
            .then(|| view.depth_at(px as u32, py as u32))
            .flatten()
    };
    (0..camera.width() * camera.height())
        .map(|pixel| depth(pixel).unwrap_or(f32::NAN))
        .collect()
}

impl SequenceReport {
    /// Formats a summary with tables.
    pub fn summary(&self) -> String {
        let mut table = Table::new([
            "variant", "PSNR dB", "FLIP", "MAD", "covered", "frame ms", "MB",
        ]);
        for variant in VARIANTS {
            let rows = VariantRows::new(&self.rows, variant);
            let costs = [
                figure(rows.mean(|row| row.frame_ms)),
                figure(rows.mean(|row| row.bytes as f64 / 1e6)),
            ];
            table.row([&[variant.into()][..], &rows.errors(), &costs].concat());
        }
        let mut summary = format!(
            "# Sprites of a sequence\n\n{} photographs left out, shown by the nearest one on a plane, by one sprite of {} and by {} sprites, a layer each, without and with \
             what lies off their planes; {} other photographs were used.\nCommit {}, {}, {} threads, {}.\n\n{table}",
            self.rows.len() / VARIANTS.len(),
            self.used.first().map_or("", String::as_str),
            self.layers,
            self.used.len().saturating_sub(1),
            self.commit,
            self.machine.processor,
            self.machine.threads,
            self.machine.simd,
        );
        if !self.depth.is_empty() {
            let mut table = Table::new([
                "depth",
                "known pixels",
                "within 1 %",
                "within 2 %",
                "within 5 %",
                "median error",
            ]);
            for row in &self.depth {
                let [one, two, five] = row.within.map(percent);
                table.row([
                    row.of.into(),
                    percent(row.covered),
                    one,
                    two,
                    five,
                    format!("{:.2} %", row.median * 100.0),
                ]);
            }
            summary +=
                &format!("\nDepth of the middle photograph beside what its file says:\n\n{table}");
        }
        summary
    }
}
