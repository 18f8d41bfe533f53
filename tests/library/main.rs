//! Promises of the library, one file each; `cargo test --test library warp_` runs those with one
//! prefix.
//!
//! A single test program, because each one links all of headbox. Tests of the command line are in
//! `tests/program`; those that monitor allocations need their own allocator and are in
//! `tests/mutated`.

#[path = "../common/mod.rs"]
mod common;

mod capture;
mod citations;
mod compose;
mod from_images;
mod metrics;
mod metrics_flip;
mod metrics_images;
mod orientation;
mod packed_ldi;
mod portal_backdrops;
mod portal_cull;
mod portal_eyes;
mod portal_walk;
mod primitives;
mod raster;
mod report;
mod results_page;
mod splat_quality;
mod sprite;
mod sprite_figure;
mod sprite_files;
mod sprite_oracle;
mod stability;
mod three_rooms;
mod version_1;
mod warp_analytic;
mod warp_bands;
mod warp_fragments;
mod warp_hard_cases;
mod warp_oracle;
mod warp_stamps;
