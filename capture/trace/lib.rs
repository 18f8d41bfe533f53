//! Ray tracing: [`bvh`] (closest hits), [`sampler`] (where rays start and go), [`light`] (radiance
//! at hits), [`viewpoint`] (where a headbox goes), [`truth`] (reference frames).

pub mod bvh;
pub mod light;
pub mod sampler;
pub mod truth;
pub mod viewpoint;
