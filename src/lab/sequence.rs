//! Sprites of a sequence judged by photographs that were left out, and their depth by depth that is
//! known (S10).
//!
//! Every third photograph is left out, and those of them that are nearest to the middle one are
//! shown: by `nearest`, the nearest photograph that was used on a plane that faces it; by `plane`
//! and `plane-with-depth`, all that the middle one shows as one sprite, without and with what lies
//! off its plane; by `layers` and `layers-with-depth`, a sprite a layer, likewise. Errors are taken
//! where all show something.

use super::held_out::{
    GainedFrame, HOLE, HeldOut, HeldOutComparison, HoldOutError, Rows, camera_of, photograph,
};
use super::machine::{Machine, commit};
use super::photographs::on_plane;
use super::table::{Table, figure, percent};
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_core::statistics::median;
use headbox_images::dense_depth::Agreement;
use headbox_images::planar_layers::{Frames, LayerJob, LayersError, PlanarLayers};
use headbox_images::{ImageSet, LoadedView, Pose, View};
use headbox_sprite::compose::{ComposeSettings, Composer, Composition};
use headbox_sprite::{
    DisplacementFormat, RenderOptions, SpriteError, SpriteSet, SpriteVariant, sprites_of_layers,
};
use image::RgbImage;
use serde::Serialize;
use std::time::Instant;

/// One photograph of so many is left out.
const HOLD_OUT: usize = 3;

/// The cosine of the angle by which those that are shown look another way than the middle one at
/// most.
const SAME_WAY: f64 = 0.866;

/// Number of frames shown.
const SHOWN: usize = 6;

/// Ways to show a photograph that was left out.
const VARIANTS: [&str; 5] = [
    "nearest",
    "plane",
    "plane-with-depth",
    "layers",
    "layers-with-depth",
];

/// Why a sequence could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum SequenceError {
    /// Error of held-out views and frames.
    #[error(transparent)]
    HoldOut(#[from] HoldOutError),
    /// There are no layers.
    #[error(transparent)]
    Layers(#[from] LayersError),
    /// Layers make no sprites.
    #[error(transparent)]
    Sprite(#[from] SpriteError),
}

/// Agreement of depth with known depth.
#[derive(Clone, Debug, Serialize)]
pub struct DepthRow {
    /// Whose depth: what was `matched`, of the `planes`, of the `layers`.
    pub of: &'static str,
    /// Share of the known pixels that have it.
    pub covered: f64,
    /// Shares within 1, 2 and 5 %.
    pub within: [f64; 3],
    /// The middle one's error, share of its depth.
    pub median: f64,
}

/// All rows, and where they were measured.
#[derive(Clone, Debug, Serialize)]
pub struct SequenceReport {
    /// The computer.
    pub machine: Machine,
    /// The program.
    pub commit: String,
    /// The photographs that were used, the middle one first.
    pub used: Vec<String>,
    /// Number of layers.
    pub layers: usize,
    /// A row for each photograph and variant.
    pub rows: Vec<HeldOut>,
    /// Depth of the middle photograph; none if none is known.
    pub depth: Vec<DepthRow>,
}

/// The set and the job without the views that layers are to be judged by, and these, nearest to the
/// middle one first.
///
/// # Errors
/// [`HoldOutError::TooFew`].
pub fn leave_out(
    set: &ImageSet,
    job: &LayerJob,
) -> Result<(ImageSet, LayerJob, Vec<View>), SequenceError> {
    let is_left_out = |i: usize| (i + HOLD_OUT - job.view % HOLD_OUT) % HOLD_OUT == 1;
    let of = |left_out: bool| (0..set.views.len()).filter(move |i| is_left_out(*i) == left_out);
    let kept: Vec<usize> = of(false).collect();
    let mut left_out: Vec<View> = of(true).map(|i| set.views[i].clone()).collect();
    let (Some(view), false) = (
        kept.iter().position(|i| *i == job.view),
        left_out.is_empty(),
    ) else {
        return Err(HoldOutError::TooFew {
            found: set.views.len(),
            what: "photographs",
            least: HOLD_OUT,
        }
        .into());
    };
    let Pose {
        eye,
        world_from_eye,
    } = set.views[job.view].pose;
    left_out.retain(|view| view.pose.world_from_eye.z_axis.dot(world_from_eye.z_axis) > SAME_WAY);
    if left_out.is_empty() {
        return Err(HoldOutError::TooFew {
            found: kept.len() + 1,
            what: "photographs that look the same way",
            least: 2,
        }
        .into());
    }
    left_out.sort_by(|a, b| {
        a.pose
            .eye
            .distance(eye)
            .total_cmp(&b.pose.eye.distance(eye))
    });
    // Some of them, from near to far.
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

/// Measures the layers of some frames; `show` is given the name of each photograph that was left
/// out, the photograph and a frame for each of the variants.
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
        let sprites = sprites_of_layers(layers, DisplacementFormat::default())?;
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
        let Some(camera) = camera_of(&held) else {
            continue;
        };
        let (truth, visible) = photograph(&held, &camera);
        let apart = |other: &&&View| other.pose.eye.distance(view.pose.eye);
        let nearest = used.iter().min_by(|a, b| apart(a).total_cmp(&apart(b)));
        let Some(nearest) = nearest else { continue };
        let mut drawn = vec![on_plane(
            &nearest.load().map_err(HoldOutError::from)?,
            &camera,
            focus,
        )];
        for sprites in &sprites {
            for variant in [SpriteVariant::Homography, SpriteVariant::TwoPass] {
                drawn.push(draw(sprites, variant, &camera, build_ms));
            }
        }
        let scene = set.folder.display().to_string();
        let nowhere = vec![false; visible.len()];
        let judge = HeldOutComparison::where_all_show(
            &scene,
            &view.name,
            &truth,
            (&visible, &nowhere),
            &drawn,
        );
        rows.extend(
            VARIANTS
                .into_iter()
                .zip(&drawn)
                .map(|(variant, drawn)| judge.row(variant, drawn)),
        );
        let pictures: Vec<&RgbImage> = std::iter::once(&truth)
            .chain(drawn.iter().map(|drawn| &drawn.picture))
            .collect();
        show(&view.name, &pictures);
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

/// A frame of sprites, magenta where nothing is known.
fn draw(
    sprites: &Composition,
    variant: SpriteVariant,
    camera: &Camera,
    build_ms: f64,
) -> GainedFrame {
    let (mut composer, mut frame) = (Composer::default(), Frame::default());
    let options = RenderOptions {
        variant,
        ..RenderOptions::default()
    };
    let settings = ComposeSettings {
        sprites: options,
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
    GainedFrame::new(&frame, [1.0; 3], Some(HOLE)).took(frame_ms, build_ms, bytes.sum())
}

/// Depth found for the middle view, and that of its layers, compared with the depth in its files.
fn depth_rows(view: &View, layers: &PlanarLayers) -> Result<Vec<DepthRow>, HoldOutError> {
    if !view.has_own_depth() {
        return Ok(Vec::new());
    }
    let known = on_canvas(&view.load()?, &layers.camera);
    let row = |of: &'static str, depth: &[f32]| {
        let mut agreement = Agreement::default();
        agreement.add(depth, &known);
        let (covered, within, median) = (
            agreement.covered_share(),
            agreement.shares_within(),
            agreement.median_error(),
        );
        DepthRow {
            of,
            covered,
            within,
            median,
        }
    };
    Ok(vec![
        row("matched", &layers.matched_depth),
        row("planes", &layers.plane_depth),
        row("layers", &layers.depth()),
    ])
}

/// The depth of a view on the pixels of a camera with its eye and direction, NaN where unknown.
fn on_canvas(view: &LoadedView, camera: &Camera) -> Vec<f32> {
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
    /// Some lines and tables.
    pub fn summary(&self) -> String {
        let mut table = Table::new([
            "variant", "PSNR dB", "FLIP", "MAD", "covered", "frame ms", "MB",
        ]);
        for variant in VARIANTS {
            let rows = Rows::of(&self.rows, variant);
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
