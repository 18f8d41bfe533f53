//! Captures of scenes: the command, its headbox and its light.

pub(crate) mod capture_cli;
mod headbox_cli;
mod light_cli;
