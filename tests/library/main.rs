//! Promises of the library, one file each; `cargo test --test library warp_` runs those with one
//! prefix.
//!
//! A single test program, because each one links all of headbox. Tests of the command line are in
//! `tests/program`; those that monitor allocations need their own allocator and are in
//! `tests/mutated`.

#[path = "../common/mod.rs"]
mod common;

mod bounced_light;
mod capture;
mod cube;
mod exposure;
mod from_images;
mod house;
mod metrics;
mod orientation;
mod report;
mod sprite;
