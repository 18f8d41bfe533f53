//! Exports: every format, deep images and Gaussian splats.

mod deep_exr_cli;
mod export_cli;
mod splats_cli;
