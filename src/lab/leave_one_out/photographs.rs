//! Leave-one-out test of a set without depth: photographs are compared with representations of the
//! others (S16).
//!
//! Every N-th photograph is left out. It is then rendered by `photograph`, the nearest other
//! photograph on a plane through the common focus of all cameras; by `ldi`, a cube from voxel
//! colouring of the others about the left-out camera; and by `ldi-beside`, the same about the
//! nearest camera. Depth is then estimated from the others alone and rendered by `depth-ldi` and
//! `depth-ldi-beside`, cubes of the warped depth images about both cameras, and by view-dependent
//! geometry with its two best texturing variants. With a dark background, errors are measured where
//! the photograph shows the object or any variant covers a pixel, and holes are black; otherwise
//! where all variants cover a pixel.

use super::held_out::{
    HeldOutComparison, HeldOutFrame, HeldOutRow, HoldOutError, VariantRows, pinhole_camera,
    reproject, sheets_sentence,
};
use crate::machine::{Machine, commit};
use crate::table::{Table, figure};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::progress::Progress;
use headbox_cube::model::samples::CubeSamples;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::render::{RenderSettings, Renderer};
use headbox_images::dense_depth::{DenseDepth, DenseDepthError};
use headbox_images::{Exposure, ImageSet, ImagesError, LoadedView, View};
use headbox_ldi::from_images::ImageSetCapture;
use headbox_photos::view_geometry::{
    GeometryRenderer, GeometryResources, GeometrySettings, Texturing, ViewGeometry, WaitPolicy,
};
use headbox_photos::voxel_colouring::PhotographsJob;
use image::{Rgb, RgbImage};
use serde::Serialize;
use std::time::Instant;

/// Minimum number of photographs.
const LEAST: usize = 4;

/// Variants of view-dependent geometry with estimated depth.
const GEOMETRY: [(&str, Texturing); 2] = [
    ("depth-blended", Texturing::Blended),
    ("depth-averaged", Texturing::Averaged),
];

/// Names of all variants.
const VARIANTS: [&str; 7] = [
    "photograph",
    "ldi",
    "ldi-beside",
    "depth-ldi",
    "depth-ldi-beside",
    GEOMETRY[0].0,
    GEOMETRY[1].0,
];

/// Results of the leave-one-out test of a set without depth.
#[derive(Clone, Debug, Serialize)]
pub struct PhotographsReport {
    /// Machine of the measurement.
    pub machine: Machine,
    /// Commit of the program, see [`commit`].
    pub commit: String,
    /// Interval of the left-out photographs.
    pub hold_out: usize,
    /// Rows for each photograph and variant.
    pub rows: Vec<HeldOutRow>,
    /// Names of the photographs without which no depth was found: they have no rows of the variants
    /// with depth.
    pub without_depth: Vec<String>,
}

/// Measures a set: every `hold_out`-th photograph is left out, one at a time. `show` receives its
/// name, the photograph and a frame of each of the `VARIANTS`.
///
/// # Errors
/// See [`HoldOutError`].
pub fn measure(
    set: &ImageSet,
    job: &PhotographsJob,
    hold_out: usize,
    progress: &dyn Progress,
    show: &mut dyn FnMut(&str, &[&RgbImage]),
) -> Result<PhotographsReport, HoldOutError> {
    if set.views.len() < LEAST {
        return Err(HoldOutError::TooFew {
            found: set.views.len(),
            what: "photographs",
            least: LEAST,
        });
    }
    let focus = set.focus();
    let (mut rows, mut without_depth) = (Vec::new(), Vec::new());
    let hold_out = hold_out.clamp(1, set.views.len());
    for view in set.views.iter().skip(hold_out / 2).step_by(hold_out) {
        let held = view.load()?;
        let Some(camera) = pinhole_camera(&held) else {
            continue;
        };
        let others: Vec<&View> = set
            .views
            .iter()
            .filter(|other| other.name != view.name)
            .collect();
        let angle = |other: &&&View| (other.pose.eye - focus).angle_between(view.pose.eye - focus);
        let Some(nearest) = others.iter().min_by(|a, b| angle(a).total_cmp(&angle(b))) else {
            continue;
        };
        let (truth, visible) = reproject(&held, &camera);
        let centres = [view.pose.eye, nearest.pose.eye];
        let mut frames = vec![draw_on_plane(&nearest.load()?, &camera, focus)];
        for centre in centres {
            let job = PhotographsJob {
                centre,
                ..job.clone()
            };
            frames.push(draw_cube(|| job.run(set, &others, progress), 0.0, &camera)?);
        }
        match draw_with_estimated_depth(set, &others, centres, &camera, progress) {
            Ok(drawn) => frames.extend(drawn),
            Err(HoldOutError::Depth(DenseDepthError::NothingFound(_))) => {
                without_depth.push(view.name.clone());
            }
            Err(error) => return Err(error),
        }
        let dark = job.dark(std::slice::from_ref(&held));
        let is_object =
            |pixel: &Rgb<u8>| dark.is_none_or(|dark| pixel.0.iter().any(|level| *level > dark));
        let compared: Vec<bool> = truth
            .pixels()
            .enumerate()
            .map(|(p, pixel)| {
                let mut covered = frames.iter().map(|frame| frame.covered[p]);
                visible[p]
                    && if dark.is_some() {
                        is_object(pixel) || covered.any(|covered| covered)
                    } else {
                        covered.all(|covered| covered)
                    }
            })
            .collect();
        let object: Vec<bool> = truth
            .pixels()
            .zip(&visible)
            .map(|(pixel, visible)| *visible && is_object(pixel))
            .collect();
        let comparison = HeldOutComparison {
            scene: set.folder.display().to_string(),
            view: &view.name,
            photograph: &truth,
            compared,
            at_edges: Vec::new(), // its depth is unknown
            visible: object,
        };
        rows.extend(comparison.rows(VARIANTS, &frames));
        show(&view.name, &comparison.pictures(&frames));
    }
    Ok(PhotographsReport {
        machine: Machine::here(),
        commit: commit(),
        hold_out,
        rows,
        without_depth,
    })
}

/// Draws a photograph on the plane through `focus` that faces its camera.
pub(super) fn draw_on_plane(view: &LoadedView, camera: &Camera, focus: DVec3) -> HeldOutFrame {
    let (mut picture, mut covered) = (RgbImage::new(camera.width(), camera.height()), Vec::new());
    let started = Instant::now();
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let color = view.color_on_plane(focus, camera.eye(), direction);
        covered.push(color.is_some());
        *pixel = Rgb(color.unwrap_or_default().map(|level| (level + 0.5) as u8));
    }
    HeldOutFrame {
        picture,
        covered,
        frame_ms: started.elapsed().as_secs_f64() * 1e3,
        build_ms: 0.0,
        rebuild_ms: f64::NAN,
        bytes: view.color.len() as u64 * 4,
    }
}

/// Estimates depth from `others` alone; draws cubes about two centres, and view-dependent geometry.
fn draw_with_estimated_depth(
    set: &ImageSet,
    others: &[&View],
    centres: [DVec3; 2],
    camera: &Camera,
    progress: &dyn Progress,
) -> Result<Vec<HeldOutFrame>, HoldOutError> {
    let folder = tempfile::tempdir().map_err(HoldOutError::Folder)?;
    let views = others
        .iter()
        .map(|&view| View {
            depth: None,
            ..view.clone()
        })
        .collect();
    let mut estimated = ImageSet {
        folder: folder.path().into(),
        views,
        ..set.clone()
    };
    let started = Instant::now();
    progress.begin("finding depth", "steps", estimated.find_depth_steps());
    estimated.estimate_depth(
        &DenseDepth::default(),
        &|steps| progress.advance(steps),
        &mut |_, _| {},
    )?;
    let depth_ms = started.elapsed().as_secs_f64() * 1e3;
    let views: Vec<&View> = estimated.views_with_depth().collect();
    let job = ImageSetCapture::suggest(&estimated);
    let mut frames = Vec::new();
    for centre in centres {
        let job = ImageSetCapture {
            centre,
            ..job.clone()
        };
        let build = || job.run(&estimated, &views, progress);
        frames.push(draw_cube(build, depth_ms, camera)?);
    }
    let started = Instant::now();
    let resources = GeometryResources::default();
    let geometry = ViewGeometry::open(&estimated, &views, &resources, progress)?;
    let build_ms = depth_ms + started.elapsed().as_secs_f64() * 1e3;
    let mut renderer = GeometryRenderer::new();
    for (_, texturing) in GEOMETRY {
        let settings = GeometrySettings {
            texturing,
            ..GeometrySettings::default()
        };
        renderer.render(&geometry, camera, &settings, WaitPolicy::Wait);
        let (frame, stats) = renderer.render(&geometry, camera, &settings, WaitPolicy::Wait);
        frames.push(HeldOutFrame::new(
            frame,
            Exposure::EVEN,
            None,
            stats.frame_ms,
            build_ms,
            geometry.bytes(),
        ));
    }
    Ok(frames)
}

/// Builds and draws a cube; `before_ms`: time of the preceding steps.
fn draw_cube(
    build: impl FnOnce() -> Result<CubeSamples, ImagesError>,
    before_ms: f64,
    camera: &Camera,
) -> Result<HeldOutFrame, HoldOutError> {
    let started = Instant::now();
    let cube = CubeLdi::pack(&build()?, SplatIndexLayout::Normal, Split::Auto)?;
    let build_ms = before_ms + started.elapsed().as_secs_f64() * 1e3;
    let settings = RenderSettings {
        hole_color_srgb: [0; 3],
        ..RenderSettings::default()
    };
    let mut renderer = Renderer::new();
    renderer.render(&cube, camera, &settings);
    let (frame, stats) = renderer.render_with_stats(&cube, camera, &settings);
    Ok(HeldOutFrame::new(
        frame,
        Exposure::EVEN,
        None,
        stats.frame_ms,
        build_ms,
        cube.bytes(),
    ))
}

impl PhotographsReport {
    /// Formats a summary with a table.
    pub fn summary(&self) -> String {
        let mut table = Table::new([
            "variant", "PSNR dB", "FLIP", "MAD", "covered", "frame ms", "build ms", "MB",
        ]);
        for variant in VARIANTS {
            let rows = VariantRows::new(&self.rows, variant);
            let costs = [
                figure(rows.mean(|row| row.frame_ms)),
                figure(rows.mean(|row| row.build_ms)),
                figure(rows.mean(|row| row.bytes as f64 / 1e6)),
            ];
            table.row([&[variant.into()][..], &rows.errors(), &costs].concat());
        }
        let without_depth = if self.without_depth.is_empty() {
            String::new()
        } else {
            let names = self.without_depth.join(", ");
            format!("\nNo depth was found without {names}.\n")
        };
        format!(
            "# Photographs left out of a set\n\n{} photographs left out, one at a time, and shown by the nearest other one on a plane, \
             by layered depth images that the others are coloured into about its own camera and about the nearest one's, and by depth that is found \
             from the others: warped into such cubes, and by view-dependent geometry.\n{}\nCommit {}, {}, {} threads, {}.\n\n{table}{without_depth}",
            VariantRows::new(&self.rows, VARIANTS[0]).count(),
            sheets_sentence(),
            self.commit,
            self.machine.processor,
            self.machine.threads,
            self.machine.simd,
        )
    }
}
