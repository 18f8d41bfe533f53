//! Views: one image of a set with its camera and files (`view`, `view_files`, `color_images`),
//! points that others see, and rendered views.

pub(super) mod color_images;
pub(super) mod seen_points;
pub mod traced_view;
pub(super) mod view;
mod view_files;
