//! Guiding of paths: directions from learned densities (`square`, `training`, `guide`), and rays
//! aimed at surfaces next to lamps (`reflectors`).

pub(super) mod guide;
mod reflectors;
mod square;
mod training;
