//! Overlays of cube LDIs.

use super::effort;
use super::variation::Meaning;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::frame::{Coverage, Frame};
use headbox_core::view::Swatch;
use headbox_core::view::paint::{ENVIRONMENT_RGB, HOLE_RGB, hole_legend, opaque, swatch};

/// Content of the pixels, for the overlay setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Overlay {
    /// The frame.
    None,
    /// Holes in magenta.
    Holes,
    /// Coverage of each pixel by splats.
    Coverage,
    /// Depth pixels in false colours.
    Recolored(Meaning),
    /// Width of the nearest footprint in each pixel.
    Footprints,
    /// Number of times that each pixel was drawn.
    Overdraw,
    /// Samples removed by clipping, on the unfolded faces.
    Clipping,
}

impl Overlay {
    /// All overlays with their names in the panel and in scripts.
    pub(super) const ALL: [(&'static str, Self); 11] = [
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
    ];

    /// Returns the meaning of the LDI's colours.
    pub(super) fn meaning(self) -> Meaning {
        if let Self::Recolored(meaning) = self {
            meaning
        } else {
            Meaning::Captured
        }
    }

    /// Builds the legend of the colours; empty if they need none.
    pub(super) fn legend(self) -> Vec<Swatch> {
        match self {
            Self::None => Vec::new(),
            Self::Holes => hole_legend(),
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
        }
    }
}

/// Paints the coverage of each pixel by splats: white for full, black for none; pure environment
/// blue, holes magenta.
pub(super) fn paint_coverage(frame: &Frame, pixels: &mut [[u8; 4]]) {
    for (pixel, &coverage) in pixels.iter_mut().zip(&frame.coverage) {
        let share = coverage.splat_share();
        *pixel = match coverage {
            Coverage::HOLE | Coverage::FILLED => opaque(HOLE_RGB),
            Coverage::ENVIRONMENT => opaque(ENVIRONMENT_RGB),
            _ => opaque([share; 3]),
        };
    }
}

/// Marks the epipole, the projection of the headbox's centre: a cross if the centre is in front of
/// the eye, a ring if it is behind (then its mirror image through the eye is projected). Paints
/// nothing if the eye is at the centre, or level with it in depth.
pub(super) fn paint_epipole(camera: &Camera, centre: DVec3, pixels: &mut [[u8; 4]]) {
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
            pixels[(y * width + x) as usize] = opaque(HOLE_RGB);
        }
    }
}
