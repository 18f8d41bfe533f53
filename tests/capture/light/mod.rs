//! Light: skies, lamps and bakes.

mod bake;
mod baked_light;
mod lamps;
mod sky;
