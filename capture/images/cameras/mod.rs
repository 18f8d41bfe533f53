//! Cameras: their pose, lens models, and the rectification of images of other models.

pub(super) mod camera_model;
pub(super) mod lens;
pub(super) mod pose;
pub(super) mod rectify;
