//! Constants of the tent kernel, for other implementations that must render the same frames.

use super::size::{FootprintSize, TangentSize, TangentTable};
use crate::render::canvas::surface_canvas;
use crate::render::footprint::tent;
use crate::render::setup::clip;

/// Largest tangent of the angle between a sample's normal and its ray; steeper planes are clamped
/// to it.
pub const MAX_SLOPE: f32 = TangentTable::MAX_SLOPE;
/// Least radius of a tent, px.
pub const MIN_RADIUS_PX: f32 = tent::MIN_RADIUS_PX;
/// Largest radius of a tent, px.
pub const MAX_RADIUS_PX: f32 = <TangentSize<'_> as FootprintSize>::MAX_RADIUS_PX;
/// Least weight in the middle of a tent.
pub const MIN_PEAK: f32 = tent::MIN_PEAK;
/// Least ratio of the eye depths in the frame and in the LDI that is drawn.
pub const W_NEAR: f32 = clip::W_NEAR;
/// Steps of a weight from 0 to 1.
pub const WEIGHT_STEPS: u32 = tent::ONE;
/// Weight at which a surface hides everything behind it.
pub const OPAQUE_WEIGHT: f64 = surface_canvas::OPAQUE as f64 / tent::ONE as f64;
/// Weight up to which coverage equals weight; above it coverage rises linearly to 1 at
/// [`OPAQUE_WEIGHT`].
pub const RAMP_START: f64 = surface_canvas::RAMP_START as f64 / tent::ONE as f64;
