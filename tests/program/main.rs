//! Promises of the command line, tested on the built program as a user runs it.

mod align_cli;
mod bad_inputs;
mod cli;
mod demo_cli;
mod export_cli;
mod headbox_cli;
mod house;
mod image_faults_cli;
mod images_cli;
mod light_cli;
mod lumigraph_cli;
mod paths_cli;
mod photographs_cli;
mod portal_cli;
mod run;
mod sequence_cli;
mod splats_cli;
mod sprite_cli;
mod streams_cli;
mod strict_cli;
