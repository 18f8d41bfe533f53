//! Making sprites: from a scene, from a colour and a depth image, from a sequence of photographs.

pub(crate) mod capture;
pub(crate) mod from_layers;
pub(crate) mod import;
