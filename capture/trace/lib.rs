//! Ray tracing: [`bvh`] (closest hits), [`sampler`] (ray sampling), [`light`] (radiance at hits),
//! [`viewpoint`] (placement of the headbox), [`truth`] (reference frames).

pub mod bvh;
pub mod light;
pub mod sampler;
pub mod truth;
pub mod viewpoint;
