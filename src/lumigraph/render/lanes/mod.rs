//! Sixteen rays at a time: their cameras and texels (`rays`), texture lookups (`taps`), and hits of
//! different layers (`pending`).

pub(super) mod pending;
pub(crate) mod rays;
pub(super) mod taps;
