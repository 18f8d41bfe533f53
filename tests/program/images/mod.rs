//! Image sets: with depth, with faults, as photographs, as sequences, and without poses.

mod align_cli;
mod image_faults_cli;
mod images_cli;
mod photographs_cli;
mod sequence_cli;
