//! Common parts of leave-one-out tests: rows of the report, frames, and their errors.

use crate::stats::{Spread, pooled_psnr_db};
use crate::table::percent;
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_core::metrics;
use headbox_cube::pack::PackError;
use headbox_images::dense_depth::DenseDepthError;
use headbox_images::{Exposure, ImagesError, Lens, LoadedView};
use headbox_photos::view_geometry::GeometryError;
use image::{Rgb, RgbImage};
use serde::Serialize;

/// Error of a leave-one-out test.
#[derive(Debug, thiserror::Error)]
pub enum HoldOutError {
    /// A view could not be read.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// Depth could not be estimated.
    #[error(transparent)]
    Depth(#[from] DenseDepthError),
    /// A cube could not be packed.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// View-dependent geometry could not be opened.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// The folder for estimated depth could not be created.
    #[error("no folder for what is found on the way can be made: {0}")]
    Folder(std::io::Error),
    /// The set has too few views to leave one out.
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

/// Errors and costs of one variant at one left-out view.
#[derive(Clone, Debug, Serialize)]
pub struct HeldOutRow {
    /// Folder of the set.
    pub scene: String,
    /// Name of the variant.
    pub variant: &'static str,
    /// Name of the left-out view.
    pub view: String,
    /// PSNR against the photograph over the compared pixels, dB.
    pub psnr_db: f64,
    /// Mean FLIP over the compared pixels.
    pub flip: f64,
    /// Mean absolute difference over the compared pixels, levels of 255 (E12).
    pub mad: f64,
    /// Mean absolute difference near depth edges of the view, as in the paper's crop (C28); NaN
    /// without edges.
    pub mad_at_edges: f64,
    /// Share of the photograph's pixels that this variant covers.
    pub covered: f64,
    /// Wall time of a frame, ms.
    pub frame_ms: f64,
    /// Wall time from files to a renderable representation, ms.
    pub build_ms: f64,
    /// Wall time to rebuild it from images in memory, ms, if this happens during movement (S24);
    /// NaN otherwise.
    pub rebuild_ms: f64,
    /// Memory of the representation, bytes.
    pub bytes: u64,
}

/// Rows of one variant.
pub(super) struct VariantRows<'a>(Vec<&'a HeldOutRow>);

impl<'a> VariantRows<'a> {
    pub(super) fn new(rows: &'a [HeldOutRow], variant: &str) -> Self {
        Self(rows.iter().filter(|row| row.variant == variant).collect())
    }

    /// Returns the number of left-out views.
    pub(super) fn count(&self) -> usize {
        self.0.len()
    }

    /// Returns the PSNR of the mean squared error, dB.
    pub(super) fn psnr_db(&self) -> f64 {
        pooled_psnr_db(self.0.iter().map(|row| row.psnr_db))
    }

    /// Formats table cells: PSNR in dB, FLIP, mean absolute difference, covered share.
    pub(super) fn errors(&self) -> [String; 4] {
        [
            format!("{:.2}", self.psnr_db()),
            format!("{:.4}", self.mean(|row| row.flip)),
            format!("{:.2}", self.mean(|row| row.mad)),
            percent(self.mean(|row| row.covered)),
        ]
    }

    /// Returns the mean of a value, NaN without rows.
    pub(super) fn mean(&self, value: fn(&HeldOutRow) -> f64) -> f64 {
        Spread::from_values(&self.0.iter().map(|row| value(row)).collect::<Vec<_>>())
            .map_or(f64::NAN, |spread| spread.mean)
    }
}

/// Colour of holes in stored frames.
pub(super) const HOLE: [u8; 3] = [255, 0, 255];

/// Number of pictures in a row of a report's sheets.
pub const SHEET_COLUMNS: usize = 4;

/// Sentence of a summary on the report's sheets.
pub(super) fn sheets_sentence() -> String {
    format!(
        "Each PNG beside this page shows a photograph, then the frames of all variants in the order of the table, \
         {SHEET_COLUMNS} in a row."
    )
}

/// Least splat coverage of a covered pixel, of 255.
const COVERED: u8 = 128;

/// A frame of a left-out view, with its costs.
pub(super) struct HeldOutFrame {
    pub(super) picture: RgbImage,
    pub(super) covered: Vec<bool>,
    pub(super) frame_ms: f64,
    pub(super) build_ms: f64,
    pub(super) rebuild_ms: f64,
    pub(super) bytes: u64,
}

impl HeldOutFrame {
    /// Prepares a frame for comparison: gives it the exposure of the photograph, and sets pixels
    /// that are not covered to `hole`, if given.
    pub(super) fn new(
        frame: &Frame,
        exposure: Exposure,
        hole: Option<[u8; 3]>,
        frame_ms: f64,
        build_ms: f64,
        bytes: usize,
    ) -> Self {
        let covers = |i: usize| frame.coverage[i].splat_share() >= COVERED;
        let pixel = |x: u32, y: u32| {
            let i = (y * frame.width + x) as usize;
            let exposed = |c: usize| exposure.expose(c, f32::from(frame.color[i][c]));
            Rgb(hole
                .filter(|_| !covers(i))
                .unwrap_or([0, 1, 2].map(exposed)))
        };
        Self {
            picture: RgbImage::from_fn(frame.width, frame.height, pixel),
            covered: (0..frame.coverage.len()).map(covers).collect(),
            frame_ms,
            build_ms,
            rebuild_ms: f64::NAN,
            bytes: bytes as u64,
        }
    }
}

/// A left-out photograph with the masks of its comparison.
pub(super) struct HeldOutComparison<'a> {
    pub(super) scene: String,
    pub(super) view: &'a str,
    pub(super) photograph: &'a RgbImage,
    /// Mask of pixels at which errors are measured.
    pub(super) compared: Vec<bool>,
    /// Mask of compared pixels near depth edges.
    pub(super) at_edges: Vec<bool>,
    /// Mask of pixels that should be covered.
    pub(super) visible: Vec<bool>,
}

impl<'a> HeldOutComparison<'a> {
    /// Compares the visible pixels that all frames cover; `edges`: mask of pixels near depth edges.
    pub(super) fn covered_by_all(
        scene: &str,
        view: &'a str,
        photograph: &'a RgbImage,
        visible: &[bool],
        edges: &[bool],
        frames: &[HeldOutFrame],
    ) -> Self {
        let compared: Vec<bool> = (0..visible.len())
            .map(|p| visible[p] && frames.iter().all(|frame| frame.covered[p]))
            .collect();
        let at_edges = compared
            .iter()
            .zip(edges)
            .map(|(compared, edge)| *compared && *edge)
            .collect();
        Self {
            scene: scene.into(),
            view,
            photograph,
            compared,
            at_edges,
            visible: visible.to_vec(),
        }
    }

    /// Returns the photograph and the frames.
    pub(super) fn pictures<'b>(&'b self, frames: &'b [HeldOutFrame]) -> Vec<&'b RgbImage> {
        let frames = frames.iter().map(|frame| &frame.picture);
        std::iter::once(self.photograph).chain(frames).collect()
    }

    /// Compares the frames of all variants, in order.
    pub(super) fn rows(
        &self,
        variants: impl IntoIterator<Item = &'static str>,
        frames: &[HeldOutFrame],
    ) -> impl Iterator<Item = HeldOutRow> {
        variants
            .into_iter()
            .zip(frames)
            .map(|(variant, frame)| self.row(variant, frame))
    }

    fn row(&self, variant: &'static str, frame: &HeldOutFrame) -> HeldOutRow {
        let (psnr_db, flip) = errors(self.photograph, &frame.picture, &self.compared);
        let mad = |pixels: &[bool]| mean_difference(self.photograph, &frame.picture, pixels);
        let visible = self.visible.iter().filter(|visible| **visible).count();
        let covered = frame
            .covered
            .iter()
            .zip(&self.visible)
            .filter(|(covered, visible)| **covered && **visible)
            .count();
        HeldOutRow {
            scene: self.scene.clone(),
            variant,
            view: self.view.to_owned(),
            psnr_db,
            flip,
            mad: mad(&self.compared),
            mad_at_edges: mad(&self.at_edges),
            covered: covered as f64 / visible.max(1) as f64,
            frame_ms: frame.frame_ms,
            build_ms: frame.build_ms,
            rebuild_ms: frame.rebuild_ms,
            bytes: frame.bytes,
        }
    }
}

/// Returns the camera of a pinhole view, with square pixels; `None` for another lens.
pub(super) fn pinhole_camera(view: &LoadedView) -> Option<Camera> {
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

/// Reprojects a view to a camera's pixels; returns the image and a mask of covered pixels.
pub(super) fn reproject(view: &LoadedView, camera: &Camera) -> (RgbImage, Vec<bool>) {
    let (mut picture, mut visible) = (RgbImage::new(camera.width(), camera.height()), Vec::new());
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let position = view.lens.project(
            view.pose.world_from_eye.transpose() * direction,
            view.size_px,
        );
        let color = position.and_then(|[px, py, _]| {
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

/// Returns the PSNR in dB and the mean FLIP over the compared pixels.
fn errors(photograph: &RgbImage, frame: &RgbImage, compared: &[bool]) -> (f64, f64) {
    let mut test = frame.clone();
    let (mut squares, mut count) = (0.0, 0u64);
    for ((truth, test), compared) in photograph.pixels().zip(test.pixels_mut()).zip(compared) {
        if *compared {
            count += 1;
            squares += (0..3)
                .map(|c| f64::from(truth[c].abs_diff(test[c])).powi(2))
                .sum::<f64>();
        } else {
            *test = *truth; // no error
        }
    }
    let mean_square = squares / (3.0 * count.max(1) as f64);
    let share = count as f64 / compared.len().max(1) as f64;
    let flip =
        metrics::compare(photograph, &test).map_or(f64::NAN, |comparison| comparison.flip / share);
    (10.0 * (255.0f64.powi(2) / mean_square).log10(), flip)
}

/// Returns the mean absolute difference over the compared pixels, levels of 255; NaN without any.
fn mean_difference(photograph: &RgbImage, frame: &RgbImage, compared: &[bool]) -> f64 {
    let pixels = photograph
        .pixels()
        .zip(frame.pixels())
        .zip(compared)
        .filter(|(_, compared)| **compared);
    let (mut sum, mut count) = (0u64, 0u64);
    for ((truth, test), _) in pixels {
        sum += (0..3)
            .map(|c| u64::from(truth[c].abs_diff(test[c])))
            .sum::<u64>();
        count += 3;
    }
    sum as f64 / count as f64
}
