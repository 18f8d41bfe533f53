//! Promises of houses: culling, backdrops, walks, the rasteriser.

mod portal_backdrops;
mod portal_cull;
mod portal_eyes;
mod portal_walk;
mod raster;
mod raster_colors;
mod raster_coverage;
mod three_rooms;
mod tone;
