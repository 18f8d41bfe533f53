//! Overlays of cube LDIs.

use super::effort::swatch;
use super::variation::Meaning;
use crate::overlays::effort;
use crate::sources::progressive_capture::LitScene;
use crate::sources::reference::{Reference, Traced};
use glam::{DVec3, Vec3};
use headbox_core::camera::Camera;
use headbox_core::color::{linear_from_srgb8, srgb8_from_linear};
use headbox_core::frame::{Coverage, Frame};
use headbox_core::metrics;
use headbox_raster::{PixelContent, RasterOutput};
use headbox_viewer::{Figure, Ongoing, Refinement, Swatch};
use image::{Rgb, RgbImage};
use std::time::Duration;

/// Content of the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Overlay {
    /// The frame.
    None,
    /// Holes in a colour that no scene has.
    Holes,
    /// Coverage of each pixel by splats.
    Coverage,
    /// Colours of another meaning.
    Recolored(Meaning),
    /// Width of the nearest footprint in each pixel.
    Footprints,
    /// Number of times that each pixel was drawn.
    Overdraw,
    /// Samples removed by clipping, on the unfolded faces.
    Clipping,
    /// The ray-traced reference.
    Truth,
    /// FLIP error against truth.
    Error,
}

impl Overlay {
    /// All, with the names under which the panel and scripts know them.
    pub(crate) const ALL: [(&'static str, Self); 13] = [
        ("none", Self::None),
        ("holes", Self::Holes),
        ("coverage", Self::Coverage),
        ("depth", Self::Recolored(Meaning::Depth)),
        ("layer", Self::Recolored(Meaning::Layer)),
        ("face", Self::Recolored(Meaning::Face)),
        ("segment", Self::Recolored(Meaning::Segment)),
        ("primitive", Self::Recolored(Meaning::Primitive)),
        ("footprint", Self::Footprints),
        ("overdraw", Self::Overdraw),
        ("clipping", Self::Clipping),
        ("truth", Self::Truth),
        ("error", Self::Error),
    ];

    /// Meaning of the LDI's colours.
    pub(crate) fn meaning(self) -> Meaning {
        if let Self::Recolored(meaning) = self {
            meaning
        } else {
            Meaning::Captured
        }
    }

    /// Legend of its colours; empty if they need none.
    pub(crate) fn legend(self) -> Vec<Swatch> {
        match self {
            Self::None | Self::Truth => Vec::new(),
            Self::Holes => vec![swatch(HOLE_RGB, "hole: nothing is known")],
            Self::Coverage => vec![
                swatch([255; 3], "footprints cover all of the pixel"),
                swatch([0; 3], "they cover next to none of it"),
                swatch(ENVIRONMENT_RGB, "the environment alone"),
                swatch(HOLE_RGB, "hole: nothing is known"),
            ],
            Self::Recolored(meaning) => meaning.legend(),
            Self::Footprints => effort::footprint_legend(),
            Self::Overdraw => effort::overdraw_legend(),
            Self::Clipping => effort::clipping_legend(),
            Self::Error => {
                vec![
                    swatch([0, 0, 4], "FLIP 0: no difference is seen"),
                    swatch([252, 253, 191], "FLIP 1: as far as it goes"),
                ]
            }
        }
    }

    /// Returns true if ray-traced truth is needed.
    pub(crate) fn needs_truth(self) -> bool {
        matches!(self, Self::Truth | Self::Error)
    }
}

const HOLE_RGB: [u8; 3] = [255, 0, 220];
pub(super) const HOLE_COLOR: [u8; 4] = [HOLE_RGB[0], HOLE_RGB[1], HOLE_RGB[2], OPAQUE];
const ENVIRONMENT_RGB: [u8; 3] = [40, 70, 130];
const OPAQUE: u8 = 255;

/// Paints a frame with its holes in magenta, the rest dimmed so that single pixels stand out.
pub(crate) fn paint_holes(frame: &Frame, pixels: &mut [[u8; 4]]) {
    for ((pixel, color), coverage) in pixels.iter_mut().zip(&frame.color).zip(&frame.coverage) {
        let [r, g, b, _] = color.map(|c| c / 2);
        *pixel = if coverage.is_hole() {
            HOLE_COLOR
        } else {
            [r, g, b, OPAQUE]
        };
    }
}

/// Paints a frame of a walk with its geometry in grey, so that what comes from backdrops stands
/// out.
pub(crate) fn paint_backdrops(walk: &RasterOutput, pixels: &mut [[u8; 4]]) {
    for (i, (pixel, &[r, g, b, a])) in pixels.iter_mut().zip(&walk.frame.color).enumerate() {
        let grey = ((u16::from(r) + u16::from(g) + u16::from(b)) / 3) as u8;
        *pixel = if matches!(walk.seen(i), PixelContent::Marker(_)) {
            [r, g, b, a]
        } else {
            [grey, grey, grey, a]
        };
    }
}

/// Paints the share of each pixel that splats cover: white all, black none; the environment alone
/// blue, holes magenta.
pub(crate) fn paint_coverage(frame: &Frame, pixels: &mut [[u8; 4]]) {
    for (pixel, &coverage) in pixels.iter_mut().zip(&frame.coverage) {
        let share = coverage.splat_share();
        *pixel = match coverage {
            Coverage::HOLE | Coverage::FILLED => HOLE_COLOR,
            Coverage::ENVIRONMENT => [
                ENVIRONMENT_RGB[0],
                ENVIRONMENT_RGB[1],
                ENVIRONMENT_RGB[2],
                OPAQUE,
            ],
            _ => [share, share, share, OPAQUE],
        };
    }
}

/// Paints the epipole, where the centre of the headbox projects to: a cross if it lies ahead, a
/// ring if behind (then it is the point seen through the eye from there). Nothing, if the eye is at
/// the centre or moves sideways.
pub(crate) fn paint_epipole(camera: &Camera, centre: DVec3, pixels: &mut [[u8; 4]]) {
    const RADIUS_PX: i64 = 9;
    let (ahead, behind) = (
        camera.project(centre),
        camera.project(2.0 * camera.eye() - centre),
    );
    let Some([x, y, _]) = ahead.or(behind) else {
        return;
    };
    let (width, height) = (i64::from(camera.width()), i64::from(camera.height()));
    for (dy, dx) in
        (-RADIUS_PX..=RADIUS_PX).flat_map(|dy| (-RADIUS_PX..=RADIUS_PX).map(move |dx| (dy, dx)))
    {
        let on_ring = (dx * dx + dy * dy - RADIUS_PX * RADIUS_PX).abs() <= RADIUS_PX;
        let drawn = if ahead.is_some() {
            dx == 0 || dy == 0
        } else {
            on_ring
        };
        let (x, y) = (x as i64 + dx, y as i64 + dy);
        if drawn && (0..width).contains(&x) && (0..height).contains(&y) {
            pixels[(y * width + x) as usize] = HOLE_COLOR;
        }
    }
}

/// Compares frames with ray-traced truth of their views.
#[derive(Default)]
pub(crate) struct TruthComparison {
    reference: Option<Reference>,
}

/// Interval between two polls of truth.
const LOOK_AGAIN: Duration = Duration::from_millis(150);

impl TruthComparison {
    /// No truth is needed until the next view asks.
    pub(crate) fn rest(&self) {
        if let Some(reference) = &self.reference {
            reference.rest();
        }
    }

    /// Progress of truth, if the overlay shows it.
    pub(crate) fn ongoing(&self, overlay: Overlay) -> Option<Ongoing> {
        self.reference
            .as_ref()
            .filter(|_| overlay.needs_truth())?
            .ongoing()
    }

    /// Paints truth, or the frame's FLIP error in the magma colours, as far as it is known; `scene`
    /// is called once, on another thread, when the first truth is wanted.
    ///
    /// # Errors
    /// One sentence.
    pub(crate) fn paint(
        &mut self,
        overlay: Overlay,
        frame: &Frame,
        camera: &Camera,
        scene: impl FnOnce() -> Result<LitScene, String> + Send + 'static,
        pixels: &mut [[u8; 4]],
    ) -> Result<(Vec<Figure>, Refinement), String> {
        if self.reference.is_none() {
            self.reference = Some(Reference::start(scene)?);
        }
        let traced = match &self.reference {
            Some(reference) => reference.ask(camera)?,
            None => None,
        };
        let Some(traced) = traced else {
            return Ok((Vec::new(), Refinement::Later(LOOK_AGAIN)));
        };
        let refinement = if traced.is_final() {
            Refinement::Done
        } else {
            Refinement::Later(LOOK_AGAIN)
        };
        Ok((judge(overlay, frame, &traced, pixels)?, refinement))
    }
}

/// A picture with one pixel for each square of `side`, the mean of those of it that there are.
fn averaged(image: &RgbImage, side: u32) -> RgbImage {
    let (width, height) = image.dimensions();
    RgbImage::from_fn(width.div_ceil(side), height.div_ceil(side), |x, y| {
        let columns = x * side..((x + 1) * side).min(width);
        let square = (y * side..((y + 1) * side).min(height))
            .flat_map(|y| columns.clone().map(move |x| (x, y)));
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for (x, y) in square {
            sum += Vec3::from(image.get_pixel(x, y).0.map(linear_from_srgb8));
            count += 1.0;
        }
        Rgb((sum / count).to_array().map(srgb8_from_linear))
    })
}

fn judge(
    overlay: Overlay,
    frame: &Frame,
    traced: &Traced,
    pixels: &mut [[u8; 4]],
) -> Result<Vec<Figure>, String> {
    let mut image = frame.to_rgb().map_err(|error| error.to_string())?;
    let (truth, side) = (&traced.truth.rgb(), traced.coarseness());
    if side > 1 {
        image = averaged(&image, side);
    }
    let words = |error: metrics::MetricError| error.to_string();
    let map =
        metrics::flip_map(truth, &image, metrics::DEFAULT_PIXELS_PER_DEGREE).map_err(words)?;
    let psnr_db = metrics::psnr_db(truth, &image).map_err(words)?;
    let shown = if overlay == Overlay::Truth {
        truth
    } else {
        &map.to_magma()
    };
    let width = frame.width.max(1) as usize;
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let (x, y) = ((i % width) as u32 / side, (i / width) as u32 / side);
        let [r, g, b] = shown
            .get_pixel_checked(x, y)
            .map_or([0; 3], |color| color.0);
        *pixel = [r, g, b, OPAQUE];
    }
    Ok(vec![
        Figure {
            name: "FLIP",
            value: map.mean,
            unit: "",
        },
        Figure {
            name: "PSNR",
            value: psnr_db,
            unit: "dB",
        },
        Figure {
            name: "rays per pixel of truth",
            value: traced.samples().into(),
            unit: "",
        },
        Figure {
            name: "truth's own error",
            value: traced.truth.standard_error_psnr_db,
            unit: "dB",
        },
    ])
}
