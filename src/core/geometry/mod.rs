//! Geometry of all stages: cameras, cube faces, the headbox, kinds of depth, and the axes of files.

pub mod camera;
pub mod cube_face;
pub mod depth_kind;
pub mod file_frame;
pub mod headbox;
