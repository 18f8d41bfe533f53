//! Camera paths: recorded, replayed, scripted, and written to files. Lists between runs: recent
//! files with their thumbnails, bookmarks.

pub(crate) mod automation;
pub(crate) mod bookmarks;
pub(crate) mod camera_file;
pub(crate) mod export;
pub(crate) mod eye_path;
pub(crate) mod path_recorder;
pub(crate) mod recent;
mod saving;
pub(crate) mod thumbnails;
