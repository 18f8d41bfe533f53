//! Photographs left out of a set without depth, judged against what voxel colouring makes of the
//! others (S16).
//!
//! Every N-th photograph is left out. It is then shown by `photograph`, the nearest other one on a
//! plane through what all cameras look at, by `ldi`, the cube that the others are coloured into
//! about the camera of the one left out, and by `ldi-beside`, the same about the nearest one's
//! camera. Then depth is found from the others alone, and shown by `depth-ldi` and
//! `depth-ldi-beside`, cubes that their depth images are warped into, and by view-dependent
//! geometry in its two best ways. Before a dark backdrop errors are taken where the photograph
//! shows the object or any of them shows anything, and holes are black; elsewhere where all show
//! something.

use super::held_out::{
    GainedFrame, HeldOut, HeldOutComparison, HoldOutError, Rows, camera_of, photograph,
};
use super::machine::{Machine, commit};
use super::table::{Table, figure};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::progress::Progress;
use headbox_cube::model::samples::CubeSamples;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::render::{RenderSettings, Renderer};
use headbox_images::dense_depth::DenseDepth;
use headbox_images::{ImageSet, ImagesError, LoadedView, View};
use headbox_ldi::from_images::ImagesJob;
use headbox_photos::view_geometry::{
    GeometryRenderer, GeometryResources, GeometrySettings, Texturing, ViewGeometry, WaitPolicy,
};
use headbox_photos::voxel_colouring::PhotographsJob;
use image::{Rgb, RgbImage};
use serde::Serialize;
use std::time::Instant;

/// The fewest photographs of which one can be left out.
const LEAST: usize = 4;

/// View-dependent geometry on depth that was found.
const GEOMETRY: [(&str, Texturing); 2] = [
    ("depth-blended", Texturing::Blended),
    ("depth-averaged", Texturing::Averaged),
];

/// Ways to show a photograph that was left out.
const VARIANTS: [&str; 7] = [
    "photograph",
    "ldi",
    "ldi-beside",
    "depth-ldi",
    "depth-ldi-beside",
    GEOMETRY[0].0,
    GEOMETRY[1].0,
];

/// All rows, and where they were measured.
#[derive(Clone, Debug, Serialize)]
pub struct PhotographsReport {
    /// The computer.
    pub machine: Machine,
    /// The program.
    pub commit: String,
    /// A photograph in so many was left out.
    pub hold_out: usize,
    /// A row for each photograph and variant.
    pub rows: Vec<HeldOut>,
}

/// Measures a set: each `hold_out`-th photograph is left out alone. `show` is given its name, the
/// photograph and a frame for each of the `VARIANTS`.
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
    let mut rows = Vec::new();
    let hold_out = hold_out.clamp(1, set.views.len());
    for view in set.views.iter().skip(hold_out / 2).step_by(hold_out) {
        let held = view.load()?;
        let Some(camera) = camera_of(&held) else {
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
        let (truth, visible) = photograph(&held, &camera);
        let centres = [view.pose.eye, nearest.pose.eye];
        let mut drawn = vec![on_plane(&nearest.load()?, &camera, focus)];
        for centre in centres {
            let coloured = PhotographsJob {
                centre,
                ..job.clone()
            };
            drawn.push(ldi(|| coloured.run(set, &others, progress), 0.0, &camera)?);
        }
        drawn.extend(by_found_depth(set, &others, centres, &camera, progress)?);
        let dark = job.dark(std::slice::from_ref(&held));
        let shows =
            |pixel: &Rgb<u8>| dark.is_none_or(|dark| pixel.0.iter().any(|level| *level > dark));
        let judged: Vec<bool> = truth
            .pixels()
            .enumerate()
            .map(|(p, pixel)| match dark {
                Some(_) => {
                    visible[p] && (shows(pixel) || drawn.iter().any(|drawn| drawn.covered[p]))
                }
                None => visible[p] && drawn.iter().all(|drawn| drawn.covered[p]),
            })
            .collect();
        let object: Vec<bool> = truth
            .pixels()
            .zip(&visible)
            .map(|(pixel, visible)| *visible && shows(pixel))
            .collect();
        let judge = HeldOutComparison {
            scene: set.folder.display().to_string(),
            view: &view.name,
            photograph: &truth,
            judged,
            at_edges: Vec::new(), // nothing is known of its depth
            visible: object,
        };
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
    Ok(PhotographsReport {
        machine: Machine::here(),
        commit: commit(),
        hold_out,
        rows,
    })
}

/// A photograph on the plane through `focus` that faces it.
pub(super) fn on_plane(view: &LoadedView, camera: &Camera, focus: DVec3) -> GainedFrame {
    let (mut picture, mut covered) = (RgbImage::new(camera.width(), camera.height()), Vec::new());
    let started = Instant::now();
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let color = view.color_on_plane(focus, camera.eye(), direction);
        covered.push(color.is_some());
        *pixel = Rgb(color.unwrap_or_default().map(|level| (level + 0.5) as u8));
    }
    let frame_ms = started.elapsed().as_secs_f64() * 1e3;
    GainedFrame {
        picture,
        covered,
        frame_ms,
        build_ms: 0.0,
        rebuild_ms: f64::NAN,
        bytes: view.color.len() as u64 * 4,
    }
}

/// By depth that is found from `others` alone: cubes about two centres, and view-dependent
/// geometry.
fn by_found_depth(
    set: &ImageSet,
    others: &[&View],
    centres: [DVec3; 2],
    camera: &Camera,
    progress: &dyn Progress,
) -> Result<Vec<GainedFrame>, HoldOutError> {
    let folder = tempfile::tempdir().map_err(HoldOutError::Folder)?;
    let views = others
        .iter()
        .map(|&view| View {
            depth: None,
            ..view.clone()
        })
        .collect();
    let mut found = ImageSet {
        folder: folder.path().into(),
        views,
        ..set.clone()
    };
    let started = Instant::now();
    progress.begin("finding depth", "steps", found.find_depth_steps());
    found.find_depth(
        &DenseDepth::default(),
        &|| progress.advance(1),
        &mut |_, _| {},
    )?;
    let depth_ms = started.elapsed().as_secs_f64() * 1e3;
    let views: Vec<&View> = found.views_with_depth().collect();
    let job = ImagesJob::suggest(&found);
    let mut drawn = Vec::new();
    for centre in centres {
        let job = ImagesJob {
            centre,
            ..job.clone()
        };
        drawn.push(ldi(|| job.run(&found, &views, progress), depth_ms, camera)?);
    }
    let started = Instant::now();
    let geometry = ViewGeometry::open(&found, &views, &GeometryResources::default(), progress)?;
    let build_ms = depth_ms + started.elapsed().as_secs_f64() * 1e3;
    let mut renderer = GeometryRenderer::new();
    for (_, texturing) in GEOMETRY {
        let settings = GeometrySettings {
            texturing,
            ..GeometrySettings::default()
        };
        renderer.render(&geometry, camera, &settings, WaitPolicy::Wait);
        let (frame, stats) = renderer.render(&geometry, camera, &settings, WaitPolicy::Wait);
        drawn.push(GainedFrame::new(frame, [1.0; 3], None).took(
            stats.frame_ms,
            build_ms,
            geometry.bytes(),
        ));
    }
    Ok(drawn)
}

/// A frame of a cube; `before_ms` is what led up to it.
fn ldi(
    build: impl FnOnce() -> Result<CubeSamples, ImagesError>,
    before_ms: f64,
    camera: &Camera,
) -> Result<GainedFrame, HoldOutError> {
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
    Ok(GainedFrame::new(frame, [1.0; 3], None).took(stats.frame_ms, build_ms, cube.bytes()))
}

impl PhotographsReport {
    /// Some lines and a table.
    pub fn summary(&self) -> String {
        let mut table = Table::new([
            "variant", "PSNR dB", "FLIP", "MAD", "covered", "frame ms", "build ms", "MB",
        ]);
        for variant in VARIANTS {
            let rows = Rows::of(&self.rows, variant);
            let costs = [
                figure(rows.mean(|row| row.frame_ms)),
                figure(rows.mean(|row| row.build_ms)),
                figure(rows.mean(|row| row.bytes as f64 / 1e6)),
            ];
            table.row([&[variant.into()][..], &rows.errors(), &costs].concat());
        }
        format!(
            "# Photographs left out of a set\n\n{} photographs left out, one at a time, and shown by the nearest other one on a plane, \
             by layered depth images that the others are coloured into about its own camera and about the nearest one's, and by depth that is found \
             from the others: warped into such cubes, and by view-dependent geometry.\nCommit {}, {}, {} threads, {}.\n\n{table}",
            self.rows.len() / VARIANTS.len(),
            self.commit,
            self.machine.processor,
            self.machine.threads,
            self.machine.simd,
        )
    }
}
