//! Creation of lumigraphs: from a scene, from image sets with depth, and sets of several light
//! slabs.

pub(crate) mod capture;
mod find_grid;
pub(crate) mod from_images;
pub(crate) mod from_images_error;
pub(crate) mod layers;
pub(crate) mod raw;
mod reproject;
pub(crate) mod slabs;
