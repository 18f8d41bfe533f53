//! Shared parts of measuring held-out views: a row of the report, a judged frame, and errors.

use crate::stats::{Spread, pooled_psnr_db};
use crate::table::percent;
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_core::metrics;
use headbox_cube::pack::PackError;
use headbox_images::dense_depth::DenseDepthError;
use headbox_images::{ImagesError, Lens, LoadedView};
use headbox_photos::view_geometry::GeometryError;
use image::{Rgb, RgbImage};
use serde::Serialize;

/// Why a set could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum HoldOutError {
    /// A view could not be read.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// Depth could not be found.
    #[error(transparent)]
    Depth(#[from] DenseDepthError),
    /// A cube could not be packed.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// There is no view-dependent geometry.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// Depth that is found has nowhere to lie.
    #[error("no folder for what is found on the way can be made: {0}")]
    Folder(std::io::Error),
    /// There is nothing to leave out.
    #[error("{found} {what}: at least {least} are needed, so that one can be left out")]
    TooFew {
        /// Number found.
        found: usize,
        /// Kind of item.
        what: &'static str,
        /// Number needed.
        least: usize,
    },
}

/// One way to show one view that was left out.
#[derive(Clone, Debug, Serialize)]
pub struct HeldOut {
    /// The set.
    pub scene: String,
    /// The way it was shown.
    pub variant: &'static str,
    /// The view that was left out.
    pub view: String,
    /// Against the photograph, over the pixels that are judged, dB.
    pub psnr_db: f64,
    /// Mean FLIP there.
    pub flip: f64,
    /// Mean absolute difference there, levels of 255 (E12).
    pub mad: f64,
    /// The same near depth edges of the view, which is what the paper's crop shows (C28); NaN
    /// without any.
    pub mad_at_edges: f64,
    /// Share of the photograph's pixels that this variant covers.
    pub covered: f64,
    /// Wall time of a frame, ms.
    pub frame_ms: f64,
    /// From files to what frames are drawn from, by the clock, ms.
    pub build_ms: f64,
    /// The same from images in memory, for what is made anew as one moves (S24); NaN for what is
    /// not.
    pub rebuild_ms: f64,
    /// Memory of that, bytes.
    pub bytes: u64,
}

/// The rows of one variant.
pub(super) struct Rows<'a>(Vec<&'a HeldOut>);

impl<'a> Rows<'a> {
    pub(super) fn of(rows: &'a [HeldOut], variant: &str) -> Self {
        Self(rows.iter().filter(|row| row.variant == variant).collect())
    }

    /// Number of held-out views.
    pub(super) fn count(&self) -> usize {
        self.0.len()
    }

    /// PSNR of the mean squared error, dB.
    pub(super) fn psnr_db(&self) -> f64 {
        pooled_psnr_db(self.0.iter().map(|row| row.psnr_db))
    }

    /// Cells of a table: PSNR in dB, FLIP, mean absolute difference, and the share covered.
    pub(super) fn errors(&self) -> [String; 4] {
        [
            format!("{:.2}", self.psnr_db()),
            format!("{:.4}", self.mean(|row| row.flip)),
            format!("{:.2}", self.mean(|row| row.mad)),
            percent(self.mean(|row| row.covered)),
        ]
    }

    /// NaN where no row has the value.
    pub(super) fn mean(&self, value: fn(&HeldOut) -> f64) -> f64 {
        Spread::of(&self.0.iter().map(|row| value(row)).collect::<Vec<_>>())
            .map_or(f64::NAN, |spread| spread.mean)
    }
}

/// Colour of unknown pixels in stored frames.
pub(super) const HOLE: [u8; 3] = [255, 0, 255];

/// A pixel counts as covered from this share of 255 on.
const COVERED: u8 = 128;

/// A frame that is judged.
pub(super) struct GainedFrame {
    pub(super) picture: RgbImage,
    pub(super) covered: Vec<bool>,
    pub(super) frame_ms: f64,
    pub(super) build_ms: f64,
    pub(super) rebuild_ms: f64,
    pub(super) bytes: u64,
}

impl GainedFrame {
    /// Prepares a frame for comparison: each channel's levels times its gain, and `hole` where it
    /// does not cover a pixel, if given.
    pub(super) fn new(frame: &Frame, gain: [f32; 3], hole: Option<[u8; 3]>) -> Self {
        let covers = |i: usize| frame.coverage[i].splat_share() >= COVERED;
        let pixel = |x: u32, y: u32| {
            let i = (y * frame.width + x) as usize;
            let exposed =
                |c: usize| (f32::from(frame.color[i][c]) * gain[c] + 0.5).min(255.0) as u8;
            Rgb(hole
                .filter(|_| !covers(i))
                .unwrap_or([0, 1, 2].map(exposed)))
        };
        Self {
            picture: RgbImage::from_fn(frame.width, frame.height, pixel),
            covered: (0..frame.coverage.len()).map(covers).collect(),
            frame_ms: f64::NAN,
            build_ms: f64::NAN,
            rebuild_ms: f64::NAN,
            bytes: 0,
        }
    }

    /// With what it took.
    pub(super) fn took(self, frame_ms: f64, build_ms: f64, bytes: usize) -> Self {
        Self {
            frame_ms,
            build_ms,
            bytes: bytes as u64,
            ..self
        }
    }
}

/// A photograph that was left out, and over which of its pixels frames are judged.
pub(super) struct HeldOutComparison<'a> {
    pub(super) scene: String,
    pub(super) view: &'a str,
    pub(super) photograph: &'a RgbImage,
    /// Mask of pixels at which errors are measured.
    pub(super) judged: Vec<bool>,
    /// Mask of those near depth edges.
    pub(super) at_edges: Vec<bool>,
    /// Mask of pixels that should be covered.
    pub(super) visible: Vec<bool>,
}

impl<'a> HeldOutComparison<'a> {
    /// Judges where all frames show something; `edges` are the pixels near depth edges.
    pub(super) fn where_all_show(
        scene: &str,
        view: &'a str,
        photograph: &'a RgbImage,
        (visible, edges): (&[bool], &[bool]),
        drawn: &[GainedFrame],
    ) -> Self {
        let judged: Vec<bool> = (0..visible.len())
            .map(|p| visible[p] && drawn.iter().all(|drawn| drawn.covered[p]))
            .collect();
        let at_edges = judged
            .iter()
            .zip(edges)
            .map(|(judged, edge)| *judged && *edge)
            .collect();
        Self {
            scene: scene.into(),
            view,
            photograph,
            judged,
            at_edges,
            visible: visible.to_vec(),
        }
    }

    /// The row of a frame.
    pub(super) fn row(&self, variant: &'static str, drawn: &GainedFrame) -> HeldOut {
        let (psnr_db, flip) = errors(self.photograph, &drawn.picture, &self.judged);
        let mad = |pixels: &[bool]| mean_difference(self.photograph, &drawn.picture, pixels);
        let covered = drawn
            .covered
            .iter()
            .zip(&self.visible)
            .filter(|(covered, visible)| **covered && **visible)
            .count();
        HeldOut {
            scene: self.scene.clone(),
            variant,
            view: self.view.to_owned(),
            psnr_db,
            flip,
            mad: mad(&self.judged),
            mad_at_edges: mad(&self.at_edges),
            covered: covered as f64
                / self
                    .visible
                    .iter()
                    .filter(|visible| **visible)
                    .count()
                    .max(1) as f64,
            frame_ms: drawn.frame_ms,
            build_ms: drawn.build_ms,
            rebuild_ms: drawn.rebuild_ms,
            bytes: drawn.bytes,
        }
    }
}

/// The camera of a view with square pixels.
pub(super) fn camera_of(view: &LoadedView) -> Option<Camera> {
    let Lens::Pinhole(pinhole) = view.lens else {
        return None;
    };
    let [width, height] = view.size_px;
    let camera = Camera::from_parts(
        view.pose.eye,
        view.pose.world_from_eye,
        pinhole.focal_px[1],
        width,
        height,
    )
    .ok()?;
    Some(camera.with_principal_px(pinhole.principal_px))
}

/// Reprojects a view to a camera's pixels, with a mask of those that it covers.
pub(super) fn photograph(view: &LoadedView, camera: &Camera) -> (RgbImage, Vec<bool>) {
    let (mut picture, mut visible) = (RgbImage::new(camera.width(), camera.height()), Vec::new());
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let there = view.lens.project(
            view.pose.world_from_eye.transpose() * direction,
            view.size_px,
        );
        let color = there.and_then(|[px, py, _]| {
            let inside = px >= 0.0
                && py >= 0.0
                && px < f64::from(view.size_px[0])
                && py < f64::from(view.size_px[1]);
            let opaque =
                inside && view.color[py as usize * view.size_px[0] as usize + px as usize][3] > 0;
            opaque.then(|| view.color_at([px, py])).flatten()
        });
        visible.push(color.is_some());
        *pixel = Rgb(color.unwrap_or_default().map(|c| (c + 0.5) as u8));
    }
    (picture, visible)
}

/// PSNR in dB and mean FLIP over the pixels that are judged.
fn errors(photograph: &RgbImage, frame: &RgbImage, judged: &[bool]) -> (f64, f64) {
    let mut test = frame.clone();
    let (mut squares, mut count) = (0.0, 0u64);
    for ((truth, test), judged) in photograph.pixels().zip(test.pixels_mut()).zip(judged) {
        if *judged {
            count += 1;
            squares += (0..3)
                .map(|c| f64::from(truth[c].abs_diff(test[c])).powi(2))
                .sum::<f64>();
        } else {
            *test = *truth; // no error
        }
    }
    let mean_square = squares / (3.0 * count.max(1) as f64);
    let share = count as f64 / judged.len().max(1) as f64;
    let flip =
        metrics::compare(photograph, &test).map_or(f64::NAN, |comparison| comparison.flip / share);
    (10.0 * (255.0f64.powi(2) / mean_square).log10(), flip)
}

/// Mean absolute difference over the pixels that are judged, levels of 255; NaN if there are none.
fn mean_difference(photograph: &RgbImage, frame: &RgbImage, judged: &[bool]) -> f64 {
    let pixels = photograph
        .pixels()
        .zip(frame.pixels())
        .zip(judged)
        .filter(|(_, judged)| **judged);
    let (mut sum, mut count) = (0u64, 0u64);
    for ((truth, test), _) in pixels {
        sum += (0..3)
            .map(|c| u64::from(truth[c].abs_diff(test[c])))
            .sum::<u64>();
        count += 3;
    }
    sum as f64 / count as f64
}
