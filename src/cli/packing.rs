//! Options of packing cube LDIs, and the description of packed ones.

use super::args::{Names, by_name, parse_length};
use clap::Args;
use headbox_cube::model::samples::CubeSamples;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::planes::{self, MAX_ERROR_PX};

/// Options of packing a cube LDI.
#[derive(Args)]
pub(super) struct PackingArgs {
    /// Content of the 11-bit splat index: the paper's normal and depth, or the normal alone
    #[arg(long, default_value = "normal", value_parser = by_name(LAYOUTS))]
    layout: SplatIndexLayout,
    /// Near/far split of each face: auto, none, or an eye depth in the file's unit
    #[arg(long, default_value = "auto", value_parser = parse_split, allow_hyphen_values = true)]
    split: Split,
    /// Error bound of plane textures, frame pixels, 0 to 1000000: planar surfaces become textures
    /// if no view inside the headbox displaces them by more than E; 0 keeps every sample
    #[arg(long, value_name = "E", default_value_t = planes::DEFAULT_ERROR_PX, value_parser = parse_error_px, allow_hyphen_values = true)]
    pub(super) error_px: f64,
}

const LAYOUTS: Names<SplatIndexLayout> = &[
    (
        "paper",
        "3 bits nx, 3 bits ny, 5 bits of exponentially quantised depth (S20)",
        SplatIndexLayout::Paper,
    ),
    (
        "normal",
        "All 11 bits for the normal (C10)",
        SplatIndexLayout::Normal,
    ),
];

fn parse_error_px(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(error) if (0.0..=MAX_ERROR_PX).contains(&error) => Ok(error),
        _ => Err(format!(
            "give a number of frame pixels from 0 to {MAX_ERROR_PX}"
        )),
    }
}

/// Parses a split; the depth is in the file's own unit.
fn parse_split(text: &str) -> Result<Split, String> {
    match text {
        "auto" => Ok(Split::Auto),
        "none" => Ok(Split::None),
        depth => parse_length(depth)
            .map(Split::AtDepth)
            .map_err(|_| "give auto, none, or an eye depth above 0".into()),
    }
}

impl Default for PackingArgs {
    fn default() -> Self {
        Self {
            layout: SplatIndexLayout::Normal,
            split: Split::Auto,
            error_px: planes::DEFAULT_ERROR_PX,
        }
    }
}

impl PackingArgs {
    pub(super) fn pack(&self, ldi: CubeSamples) -> anyhow::Result<CubeLdi> {
        let split = match self.split {
            Split::AtDepth(depth) => Split::AtDepth(depth * ldi.info.frame.unit_m),
            split => split,
        };
        Ok(planes::pack(ldi, self.layout, split, self.error_px)?)
    }
}

/// Describes the content of a cube LDI: depth pixels and plane textures.
pub(super) fn describe_cube(cube: &CubeLdi) -> String {
    let (count, planes) = (cube.depth_pixel_count(), &cube.planes);
    if planes.tiles.is_empty() {
        format!("{count} depth pixels")
    } else {
        format!(
            "{count} depth pixels and, for {} more, pictures on {} planes",
            planes.samples,
            planes.planes.len()
        )
    }
}
