//! Cameras and camera paths as plain JSON files, in the scene file's own axes and unit and in the words of the command
//! line.
//!
//! ```json
//! [{"eye": [0, 1.6, 0], "look_at": [0, 1.5, -4], "up": [0, 1, 0], "fov": 60, "size": [1024, 768]}]
//! ```
//!
//! `up`, `fov` and `size` may be left out. Three forms are read: a list of cameras, one camera alone, and a path that the
//! window has recorded, `{"size": ..., "poses": [...]}` with times.

use crate::scene::{FileFrame, UpAxis};
use crate::{Camera, CameraError};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// One camera, as in the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraRecord {
    /// Position of the eye, in the axes and unit of the scene's file.
    pub eye: [f64; 3],
    /// A point in the middle of the image, likewise.
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
    /// When the pose was recorded, seconds from the start; of no account to a renderer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
}

/// A path as the window records it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PathRecord {
    /// Width and height of the frames, pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<[u32; 2]>,
    /// The poses, in order.
    pub poses: Vec<CameraRecord>,
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

impl CameraRecord {
    /// The record of a camera that stands at `eye`, looks along `forward` and has `up` in its image (world axes, metres).
    /// The look-at point lies one metre ahead.
    pub fn new(eye: DVec3, forward: DVec3, up: DVec3, fov_y_deg: f64, frame: &FileFrame) -> Self {
        let point = |p: DVec3| frame.file_from_world(p).to_array();
        let up = (frame.file_from_world(up) * frame.unit_m).to_array();
        Self { eye: point(eye), look_at: point(eye + forward), up: Some(up), fov: fov_y_deg, size: None, time_s: None }
    }

    /// The camera in the world.
    ///
    /// # Errors
    /// See [`CameraError`].
    pub fn camera(&self, frame: &FileFrame) -> Result<Camera, CameraError> {
        let file_up = if frame.up == UpAxis::Z { [0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0] };
        let [eye, look_at] = [self.eye, self.look_at].map(|p| frame.world_from_file(DVec3::from(p)));
        let up = frame.world_direction_from_file(DVec3::from(self.up.unwrap_or(file_up)));
        let [width, height] = self.size.unwrap_or(DEFAULT_SIZE);
        Camera::look_at(eye, look_at, up, self.fov, [width, height])
    }
}

/// Reads a file of any of the three forms; poses without a size of their own have that of the path.
///
/// # Errors
/// See [`PathError`]; poses are not looked at here.
pub fn read_records(path: &Path) -> Result<Vec<CameraRecord>, PathError> {
    let text = std::fs::read_to_string(path).map_err(|source| PathError::Io { path: path.into(), source })?;
    let json = |source| PathError::Json { path: path.into(), source };
    // An untagged enum would swallow the parser's words: look which form it is first.
    let value: serde_json::Value = serde_json::from_str(&text).map_err(json)?;
    let poses = if value.is_array() {
        serde_json::from_str(&text).map_err(json)?
    } else if value.get("eye").is_some() {
        vec![serde_json::from_str(&text).map_err(json)?]
    } else {
        let path: PathRecord = serde_json::from_str(&text).map_err(json)?;
        let sized = |pose: CameraRecord| CameraRecord { size: pose.size.or(path.size), ..pose };
        path.poses.into_iter().map(sized).collect()
    };
    if poses.is_empty() { Err(PathError::Empty { path: path.into() }) } else { Ok(poses) }
}

/// Reads a path and turns it into cameras in the world.
///
/// # Errors
/// See [`PathError`].
pub fn read(path: &Path, frame: &FileFrame) -> Result<Vec<Camera>, PathError> {
    let camera = |(number, pose): (usize, &CameraRecord)| {
        pose.camera(frame).map_err(|source| PathError::Pose { path: path.into(), pose: number, source })
    };
    read_records(path)?.iter().enumerate().map(camera).collect()
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
    fn a_saved_camera_is_a_path_of_one_pose() {
        let frame = FileFrame { up: UpAxis::Z, unit_m: 0.01 };
        let (eye, forward) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.6, 0.0, -0.8));
        let record = CameraRecord { size: Some([8, 4]), ..CameraRecord::new(eye, forward, DVec3::Y, 55.0, &frame) };
        assert_eq!((record.eye, record.up), ([100.0, -300.0, 200.0], Some([0.0, 0.0, 1.0])));
        let cameras = read_text(&serde_json::to_string(&record).unwrap()).unwrap();
        assert_eq!((cameras.len(), cameras[0].width()), (1, 8));
        assert!((cameras[0].eye() - eye).length() < 1e-12 && (cameras[0].forward() - forward).length() < 1e-12);
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
