//! Settings and statistics of rendering lumigraphs.

use crate::render::show::LumigraphOverlay;
use serde::Serialize;

/// Blending where some of a ray's cameras see a layer and others see through it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Blend {
    /// The layer is opaque, as in the paper's alpha test.
    Whole,
    /// The layer's opacity is the weight of the cameras that see it.
    #[default]
    Shared,
}

headbox_core::named_variants!(Blend { Shared => "shared", Whole => "whole" });

/// Settings of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LumigraphSettings {
    /// Merges layers for each frame (L8).
    pub merge: bool,
    /// Largest disagreement of neighbouring cameras after merging, in pixels of an image or of the
    /// frame, whichever are larger.
    pub tolerance_px: f64,
    /// Samples coarser levels of detail where the frame is coarser (L7).
    pub levels: bool,
    /// Skips layers that no relevant rectangle of the images contains (L10).
    pub skip: bool,
    /// Blending where cameras disagree.
    pub blend: Blend,
    /// Content of the frame.
    pub show: LumigraphOverlay,
    /// Colour of hole pixels, sRGB.
    pub hole_color_srgb: [u8; 3],
}

impl Default for LumigraphSettings {
    fn default() -> Self {
        Self {
            merge: true,
            tolerance_px: 1.0,
            levels: true,
            skip: true,
            blend: Blend::Shared,
            show: LumigraphOverlay::Colors,
            hole_color_srgb: [0; 3],
        }
    }
}

/// Statistics of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LumigraphStats {
    /// Number of layers after merging, without those behind the eye.
    pub layers: u64,
    /// Number of layers tested per pixel block times its pixels; without the search of hidden
    /// pixels in other cells.
    pub layer_pixels: u64,
    /// Number of hole pixels: neither the images nor the environment cover them.
    pub hole_pixels: u64,
    /// Time of planning the frame, ms.
    pub plan_ms: f64,
    /// Time of the whole frame, ms.
    pub frame_ms: f64,
}
