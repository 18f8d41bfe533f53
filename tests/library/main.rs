//! Promises of the library, one file a promise; `cargo test --test library warp_` runs those of one
//! name.
//!
//! One program, because each costs a link of all of headbox. Tests of the command line are in
//! `tests/program`; what watches over allocations needs an allocator of its own, and is in
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
