//! Creation of sprites: from a scene, from a colour and a depth image, from a photo sequence.

pub(crate) mod capture;
pub(crate) mod from_layers;
pub(crate) mod import;
