//! Cameras and paths as JSON, in the terms of the command line: `eye`, `look_at`, `up`, `fov`, `size`, in the axes and unit
//! of the scene's file.

use crate::{
    path::{CameraPath, PathError, TimedPose},
    pose::Pose,
};
use glam::DVec3;
use headbox_capture::scene::FileFrame;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Time between poses of a path file that gives no times, seconds.
const DEFAULT_INTERVAL_S: f64 = 1.0 / 30.0;

/// Why a camera or path file could not be read.
#[derive(Debug, thiserror::Error)]
pub enum CameraFileError {
    /// The file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is no camera or path.
    #[error("{} is not a camera path: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong, with line and column.
        source: serde_json::Error,
    },
    /// The poses make no path.
    #[error("{}: {source}", path.display())]
    Path {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: PathError,
    },
    /// A pose cannot be looked from.
    #[error("{}: pose {index} has a coordinate that is not finite, looks at its own eye, or has a field of view outside 1 \
             to 170 degrees", path.display())]
    Pose {
        /// The file.
        path: PathBuf,
        /// Which pose, from 0.
        index: usize,
    },
}

/// One view: `--eye`, `--look-at`, `--up-vector` and `--fov` of the command line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewRecord {
    /// Position of the eye, in the axes and unit of the scene's file.
    pub eye: [f64; 3],
    /// A point that is seen in the middle of the image, likewise.
    pub look_at: [f64; 3],
    /// The direction that points up in the image.
    pub up: [f64; 3],
    /// Vertical field of view, degrees.
    pub fov: f64,
}

/// A camera file: a view and the image's size (`--size`).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraRecord {
    /// The view.
    #[serde(flatten)]
    pub view: ViewRecord,
    /// Width and height of the image in pixels.
    pub size: [u32; 2],
}

/// A path file: views with times, and the image's size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PathRecord {
    /// Width and height of the frames in pixels.
    pub size: [u32; 2],
    /// The poses, in order.
    pub poses: Vec<PathPoseRecord>,
}

/// One pose of a path file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PathPoseRecord {
    /// Seconds since the start; poses without times follow each other at 30 a second.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub time_s: Option<f64>,
    /// The view.
    #[serde(flatten)]
    pub view: ViewRecord,
}

impl ViewRecord {
    /// The record of a pose. The look-at point lies one metre ahead.
    pub fn new(pose: &Pose, frame: &FileFrame) -> Self {
        let point = |p: DVec3| frame.file_from_world(p).to_array();
        let up = (frame.file_from_world(DVec3::Y) * frame.unit_m).to_array();
        Self { eye: point(pose.eye), look_at: point(pose.eye + pose.forward()), up, fov: pose.fov_y_deg }
    }

    /// The pose of a record (`up` is not used: the eye never rolls), or `None` if there is no such view.
    pub fn pose(&self, frame: &FileFrame) -> Option<Pose> {
        let [eye, target] = [self.eye, self.look_at].map(|p| frame.world_from_file(DVec3::from(p)));
        let valid = eye.is_finite() && target.is_finite() && eye != target && Pose::FOV_Y_DEG.contains(&self.fov);
        valid.then(|| Pose::looking_at(eye, target, self.fov))
    }
}

impl PathRecord {
    /// The record of a path.
    pub fn new(path: &CameraPath, size: [u32; 2], frame: &FileFrame) -> Self {
        let record = |p: &TimedPose| PathPoseRecord { time_s: Some(p.time_s), view: ViewRecord::new(&p.pose, frame) };
        Self { size, poses: path.poses().iter().map(record).collect() }
    }

    /// Reads a path file and turns it into poses and the frames' size.
    ///
    /// # Errors
    /// [`CameraFileError`] names the file and what is wrong with it.
    pub fn read(path: &Path, frame: &FileFrame) -> Result<(CameraPath, [u32; 2]), CameraFileError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| CameraFileError::Read { path: path.into(), source })?;
        let record: Self =
            serde_json::from_str(&text).map_err(|source| CameraFileError::Json { path: path.into(), source })?;
        let timed = |(index, record): (usize, &PathPoseRecord)| {
            let pose = record.view.pose(frame).ok_or_else(|| CameraFileError::Pose { path: path.into(), index })?;
            Ok(TimedPose { time_s: record.time_s.unwrap_or(index as f64 * DEFAULT_INTERVAL_S), pose })
        };
        let poses = record.poses.iter().enumerate().map(timed).collect::<Result<Vec<_>, CameraFileError>>()?;
        let poses = CameraPath::new(poses).map_err(|source| CameraFileError::Path { path: path.into(), source })?;
        Ok((poses, record.size))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;
    use headbox_capture::scene::UpAxis;

    /// Rounding of a rotation and a change of unit, metres.
    const POSE_TOLERANCE_M: f64 = 1e-12;

    const CENTIMETRES_Z_UP: FileFrame = FileFrame { up: UpAxis::Z, unit_m: 0.01 };

    fn pose() -> Pose {
        Pose::looking_at(dvec3(1.0, 2.0, 3.0), dvec3(-1.0, 2.5, 0.0), 55.0)
    }

    #[test]
    fn cameras_are_written_in_the_files_axes_and_unit() {
        let record = CameraRecord { view: ViewRecord::new(&pose(), &CENTIMETRES_Z_UP), size: [640, 480] };
        assert_eq!(record.view.eye, [100.0, -300.0, 200.0]);
        assert_eq!(record.view.up, [0.0, 0.0, 1.0]);
        let json = serde_json::to_value(record).unwrap();
        let mut keys: Vec<_> = json.as_object().unwrap().keys().map(String::as_str).collect();
        keys.sort_unstable();
        assert_eq!(keys, ["eye", "fov", "look_at", "size", "up"], "the words of the command line");
        let back: CameraRecord = serde_json::from_value(json).unwrap();
        assert_eq!(back, record);
        let back = back.view.pose(&CENTIMETRES_Z_UP).unwrap();
        assert!(back.eye.distance(pose().eye) < POSE_TOLERANCE_M);
        assert!(back.forward().distance(pose().forward()) < POSE_TOLERANCE_M);
    }

    #[test]
    fn paths_survive_the_file() {
        let poses = (0..5).map(|i| TimedPose { time_s: f64::from(i), pose: pose().turned(0.1 * f64::from(i), 0.0) });
        let path = CameraPath::new(poses.collect()).unwrap();
        let file = tempfile::NamedTempFile::new().unwrap();
        let record = PathRecord::new(&path, [64, 48], &CENTIMETRES_Z_UP);
        serde_json::to_writer(&file, &record).unwrap();
        let (back, size) = PathRecord::read(file.path(), &CENTIMETRES_Z_UP).unwrap();
        assert_eq!(size, [64, 48]);
        for (a, b) in path.poses().iter().zip(back.poses()) {
            assert_eq!(a.time_s, b.time_s);
            assert!(a.pose.eye.distance(b.pose.eye) < POSE_TOLERANCE_M);
            assert!(a.pose.forward().distance(b.pose.forward()) < POSE_TOLERANCE_M);
        }
    }

    #[test]
    fn damaged_paths_are_named() {
        let read = |text: &str| {
            let file = tempfile::NamedTempFile::new().unwrap();
            std::fs::write(file.path(), text).unwrap();
            PathRecord::read(file.path(), &FileFrame::default()).unwrap_err()
        };
        let view = r#""eye":[0,0,0],"look_at":[0,0,-1],"up":[0,1,0],"fov":60"#;
        assert!(matches!(read("{"), CameraFileError::Json { .. }));
        assert!(matches!(read(r#"{"size":[4,4],"poses":[]}"#), CameraFileError::Path { source: PathError::Empty, .. }));
        let bad_fov = format!(r#"{{"size":[4,4],"poses":[{{{view}}},{{{}}}]}}"#, view.replace("60", "0"));
        assert!(matches!(read(&bad_fov), CameraFileError::Pose { index: 1, .. }));
        let missing = PathRecord::read(Path::new("no/such/file.json"), &FileFrame::default()).unwrap_err();
        assert!(missing.to_string().contains("no/such/file.json"));
    }

    #[test]
    fn poses_without_times_follow_at_30_a_second() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let view = r#"{"eye":[0,0,0],"look_at":[0,0,-1],"up":[0,1,0],"fov":60}"#;
        std::fs::write(file.path(), format!(r#"{{"size":[4,4],"poses":[{view},{view},{view}]}}"#)).unwrap();
        let (path, _) = PathRecord::read(file.path(), &FileFrame::default()).unwrap();
        assert!((path.duration_s() - 2.0 / 30.0).abs() < 1e-12);
    }
}
