//! The numbers by which tents are drawn, for renderers elsewhere that are held to this one's frames.

use super::size::{Size, TangentSize, TangentTable};
use crate::render::canvas::surface;
use crate::render::footprint::tent;
use crate::render::setup::clip;

/// The largest tangent of the angle to its normal under which a sample's plane is believed.
pub const MAX_SLOPE: f32 = TangentTable::MAX_SLOPE;
/// The least radius of a tent, px.
pub const MIN_RADIUS_PX: f32 = crate::render::TENT_MIN_RADIUS_PX;
/// The largest radius of a tent, px.
pub const MAX_RADIUS_PX: f32 = <TangentSize<'_> as Size>::MAX_RADIUS_PX;
/// The least weight in the middle of a tent.
pub const MIN_PEAK: f32 = tent::MIN_PEAK;
/// The least ratio of the eye depths in the frame and in the LDI that is drawn.
pub const W_NEAR: f32 = clip::W_NEAR;
/// Weights are whole numbers of one over this.
pub const WEIGHT_STEPS: u32 = tent::ONE;
/// The weight at which a surface hides wholly what is behind it.
pub const OPAQUE_WEIGHT: f64 = surface::OPAQUE as f64 / tent::ONE as f64;
/// The least share of a pixel that a surface has where it has any.
pub const MIN_SHARE: f64 = surface::MIN_SHARE as f64 / 255.0;
