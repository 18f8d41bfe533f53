//! Camera paths as plain JSON files, in the scene file's own axes and unit.
//!
//! ```json
//! [{"eye": [0, 1.6, 0], "look_at": [0, 1.5, -4], "up": [0, 1, 0], "fov": 60, "size": [1024, 768]}]
//! ```
//!
//! `up`, `fov` and `size` may be left out. A path that the window has recorded, `{"size": ..., "poses": [...]}` with
//! times, is read too; its poses are rendered one after the other.

use crate::capture::scene::{FileFrame, UpAxis};
use crate::capture::{Camera, CameraError};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// One camera of a path, as in the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// Position of the eye.
    pub eye: [f64; 3],
    /// A point in the middle of the image.
    pub look_at: [f64; 3],
    /// Direction that points up in the image; the file's up axis if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
    /// Vertical field of view, degrees.
    #[serde(default = "default_fov")]
    pub fov: f64,
    /// Width and height, pixels; those of the path if absent, else 1024x768.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<[u32; 2]>,
    /// When the pose was recorded, seconds from the start; of no account here.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
}

/// A path as the window records it.
#[derive(Deserialize)]
struct RecordedPath {
    size: Option<[u32; 2]>,
    poses: Vec<Pose>,
}

const DEFAULT_SIZE: [u32; 2] = [1024, 768];

fn default_fov() -> f64 {
    60.0
}

/// Why a path could not be read.
#[derive(Debug, thiserror::Error)]
pub enum PathError {
    /// The operating system said no.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Its words.
        source: std::io::Error,
    },
    /// Not a list of poses.
    #[error("{}: not a camera path: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// The parser's words, with line and column.
        source: serde_json::Error,
    },
    /// A pose that is no camera.
    #[error("{}: pose {pose}: {source}", path.display())]
    Pose {
        /// The file.
        path: PathBuf,
        /// Which, from 0.
        pose: usize,
        /// What is wrong with it.
        source: CameraError,
    },
    /// An empty list.
    #[error("{}: the path has no poses", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
}

impl Pose {
    /// The camera in the world.
    ///
    /// # Errors
    /// See [`CameraError`].
    pub fn camera(&self, frame: &FileFrame) -> Result<Camera, CameraError> {
        let file_up = if frame.up == UpAxis::Z { [0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0] };
        let [eye, look_at] = [self.eye, self.look_at].map(|p| frame.world_from_file(DVec3::from(p)));
        let up = frame.world_direction_from_file(DVec3::from(self.up.unwrap_or(file_up)));
        let [width, height] = self.size.unwrap_or(DEFAULT_SIZE);
        Camera::look_at(eye, look_at, up, self.fov, width, height)
    }
}

/// Reads a path and turns it into cameras in the world.
///
/// # Errors
/// See [`PathError`].
pub fn read(path: &Path, frame: &FileFrame) -> Result<Vec<Camera>, PathError> {
    let text = std::fs::read_to_string(path).map_err(|source| PathError::Io { path: path.into(), source })?;
    let json = |source| PathError::Json { path: path.into(), source };
    // An untagged enum would swallow the parser's words: look which form it is first.
    let value: serde_json::Value = serde_json::from_str(&text).map_err(json)?;
    let poses = if value.is_array() {
        serde_json::from_str(&text).map_err(json)?
    } else {
        let recorded: RecordedPath = serde_json::from_str(&text).map_err(json)?;
        let sized = |pose: Pose| Pose { size: pose.size.or(recorded.size), ..pose };
        recorded.poses.into_iter().map(sized).collect::<Vec<Pose>>()
    };
    if poses.is_empty() {
        return Err(PathError::Empty { path: path.into() });
    }
    let camera = |(number, pose): (usize, &Pose)| {
        pose.camera(frame).map_err(|source| PathError::Pose { path: path.into(), pose: number, source })
    };
    poses.iter().enumerate().map(camera).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Vec<Camera>, PathError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("path.json");
        std::fs::write(&path, text).unwrap();
        read(&path, &FileFrame { up: UpAxis::Z, unit_m: 0.01 })
    }

    #[test]
    fn poses_are_in_the_files_axes_and_unit() {
        let cameras = read_text(r#"[{"eye": [100, 0, 200], "look_at": [100, 50, 200], "size": [8, 4]}]"#).unwrap();
        assert!((cameras[0].eye() - DVec3::new(1.0, 2.0, 0.0)).length() < 1e-12);
        assert!((cameras[0].forward() - DVec3::NEG_Z).length() < 1e-12, "+Y of a file with Z up is -Z of the world");
        assert!((cameras[0].world_from_eye().y_axis - DVec3::Y).length() < 1e-12);
    }

    #[test]
    fn a_recorded_path_is_read_too() {
        let text = r#"{"size": [8, 4], "poses": [{"time_s": 0.5, "eye": [0, 0, 0], "look_at": [0, 1, 0]}]}"#;
        let cameras = read_text(text).unwrap();
        assert_eq!((cameras[0].width(), cameras[0].height()), (8, 4));
    }

    #[test]
    fn errors_say_where() {
        let message = |text| read_text(text).err().unwrap().to_string();
        assert!(message("[").contains("line 1"));
        assert!(message("[]").contains("no poses"));
        assert!(message(r#"[{"eye": [0,0,0], "look_at": [0,0,0]}]"#).contains("pose 0"));
        assert!(message(r#"[{"eye": [0,0,0], "lookat": [0,0,0]}]"#).contains("lookat"));
    }
}
