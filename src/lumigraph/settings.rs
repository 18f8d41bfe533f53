//! Settings and statistics of rendering lumigraphs.

use crate::render::show::Show;
use serde::Serialize;

/// Blending where some of a ray's cameras show a layer and others see through it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Blend {
    /// The layer hides what is behind it, as the paper's alpha test has it.
    Whole,
    /// The layer takes the share of those cameras that show it; what lies behind takes the rest.
    #[default]
    Shared,
}

impl Blend {
    /// All, with their names on the command line.
    pub const ALL: [(&'static str, Self); 2] = [("shared", Self::Shared), ("whole", Self::Whole)];

    /// Its name.
    pub fn name(self) -> &'static str {
        let [(shared, _), (whole, _)] = Self::ALL;
        if self == Self::Shared { shared } else { whole }
    }
}

/// Settings of rendering.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LumigraphSettings {
    /// Merges layers for each frame (L8).
    pub merge: bool,
    /// Largest disagreement of neighbouring cameras after merging: multiples of an image's or a
    /// frame's pixel, whichever is larger.
    pub tolerance_px: f64,
    /// Takes coarser images where the frame is coarser (L7).
    pub levels: bool,
    /// Leaves layers out that show in no rectangle of the images where a block of the frame would
    /// find them (L10).
    pub skip: bool,
    /// Blending where cameras disagree.
    pub blend: Blend,
    /// Content of the frame.
    pub show: Show,
    /// Colour of pixels of which nothing is known, sRGB.
    pub hole_color_srgb: [u8; 3],
}

impl LumigraphSettings {
    /// Default settings.
    pub const USUAL: Self = Self {
        merge: true,
        tolerance_px: 1.0,
        levels: true,
        skip: true,
        blend: Blend::Shared,
        show: Show::Colors,
        hole_color_srgb: [0; 3],
    };
}

impl Default for LumigraphSettings {
    fn default() -> Self {
        Self::USUAL
    }
}

/// Statistics of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LumigraphStats {
    /// Layers after merging, without those that the eye has passed.
    pub layers: u64,
    /// Layers that blocks of pixels were asked for, times their pixels; without what hidden pixels
    /// asked other cameras.
    pub layer_pixels: u64,
    /// Pixels of which neither the images nor the environment know anything.
    pub hole_pixels: u64,
    /// Milliseconds until the first pixel.
    pub plan_ms: f64,
    /// Milliseconds of the frame.
    pub frame_ms: f64,
}
