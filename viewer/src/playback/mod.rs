//! Camera paths: recorded, replayed, scripted, and written to files.

pub(crate) mod automation;
pub(crate) mod camera_file;
pub(crate) mod export;
pub(crate) mod eye_path;
pub(crate) mod path_recorder;
pub(crate) mod recent;
