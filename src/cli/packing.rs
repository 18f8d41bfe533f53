//! Options of packing cube LDIs, and their description.

use super::args::{Names, by_name, parse_length};
use clap::Args;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::planes as primitives;
use headbox_cube::planes::MAX_ERROR_PX;

/// Options of packing a cube LDI.
#[derive(Args)]
pub(super) struct PackingArgs {
    /// What the splat index holds: the paper's normal and depth, or all bits for the normal
    #[arg(long, default_value = "normal", value_parser = by_name(LAYOUTS))]
    layout: SplatIndexLayout,
    /// Near/far split of each face: auto, none, or an eye depth
    #[arg(long, default_value = "auto", value_parser = parse_split, allow_hyphen_values = true)]
    split: Split,
    /// Show what is flat as pictures on planes, where nobody in the headbox sees it elsewhere by
    /// more than E frame pixels; 0 keeps every sample
    #[arg(long, value_name = "E", default_value_t = primitives::DEFAULT_ERROR_PX, value_parser = parse_error_px, allow_hyphen_values = true)]
    error_px: f64,
}

const LAYOUTS: Names<SplatIndexLayout> = &[
    (
        "paper",
        "3 bits nx, 3 bits ny, 5 bits of depth, quantised exponentially (S20)",
        SplatIndexLayout::Paper,
    ),
    (
        "normal",
        "All eleven bits for the normal (C10)",
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

/// The depth in the file's own unit.
fn parse_split(text: &str) -> Result<Split, String> {
    match text {
        "auto" => Ok(Split::Auto),
        "none" => Ok(Split::None),
        depth => parse_length(depth)
            .map(Split::AtDepth)
            .map_err(|_| "give auto, none, or an eye depth above 0".into()),
    }
}

impl PackingArgs {
    /// By how much what is shown may be elsewhere, frame pixels; 0 for not at all.
    pub(super) fn error_px(&self) -> f64 {
        self.error_px
    }

    pub(super) fn pack(
        &self,
        ldi: headbox_cube::model::samples::CubeSamples,
    ) -> anyhow::Result<CubeLdi> {
        let split = match self.split {
            Split::AtDepth(depth) => Split::AtDepth(depth * ldi.info.frame.unit_m),
            split => split,
        };
        Ok(primitives::pack(ldi, self.layout, split, self.error_px)?)
    }
}

/// Depth pixels, and what else there is.
pub(super) fn what_is_kept(cube: &CubeLdi) -> String {
    let (count, planes) = (cube.depth_pixel_count(), &cube.planes);
    match planes.tiles.is_empty() {
        true => format!("{count} depth pixels"),
        false => {
            format!(
                "{count} depth pixels and, for {} more, pictures on {} planes",
                planes.samples,
                planes.planes.len()
            )
        }
    }
}
