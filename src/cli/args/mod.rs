//! Arguments shared by several subcommands. Positions and lengths are in the scene file's own axes
//! and unit.

mod camera;
mod light;
mod source;
mod values;

pub(crate) use camera::{CameraArgs, DefaultCamera};
pub(crate) use light::LightArgs;
pub(crate) use source::{AxesArgs, SceneArgs, SourceArgs, StrictArgs};
pub(crate) use values::{
    Names, by_name, parse_length, parse_sides, parse_size, parse_unit, parse_up, parse_vector,
    refuse_given, refuse_misplaced, split_settings,
};
