//! `transforms.json` of nerfstudio, NeRF and instant-ngp: `transforms` reads and writes it; `lens`
//! and `depth_keys` read its keys of lenses and of depth.

mod depth_keys;
mod lens;
mod transforms;

pub use transforms::{SetWriter, write_set};
pub(crate) use transforms::{is_transforms, open};
