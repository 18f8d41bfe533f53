//! Promises of the warp of cubes: against closed forms and oracles, in bands and fragments.

mod warp_analytic;
mod warp_bands;
mod warp_fragments;
mod warp_hard_cases;
mod warp_oracle;
mod warp_stamps;
