//! Conversion of poses to and from the camera and path files of [`headbox_scene::camera_path`].

use crate::input::pose::Pose;
use crate::playback::eye_path::{CameraPath, PathError, TimedPose};
use glam::DVec3;
use headbox_core::file_frame::FileFrame;
use headbox_scene::camera_path::{self, CameraRecord, PathRecord};
use std::path::{Path, PathBuf};

/// Time between poses of a path file without times, seconds.
const DEFAULT_INTERVAL_S: f64 = 1.0 / 30.0;

/// Error of reading a path file.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CameraFileError {
    /// The file cannot be read, or is not a path.
    #[error(transparent)]
    File(#[from] camera_path::PathError),
    /// The times do not increase.
    #[error("{}: {source}", path.display())]
    Times { path: PathBuf, source: PathError },
}

/// Camera record of a pose.
pub(crate) fn record(pose: &Pose, frame: &FileFrame) -> CameraRecord {
    CameraRecord::new(pose.eye, pose.forward(), pose.up, pose.fov_y_deg, frame)
}

/// Path record of a path; `size` is the size of its frames, pixels.
pub(crate) fn path_record(path: &CameraPath, size: [u32; 2], frame: &FileFrame) -> PathRecord {
    let timed = |p: &TimedPose| CameraRecord {
        time_s: Some(p.time_s),
        ..record(&p.pose, frame)
    };
    PathRecord {
        size: Some(size),
        poses: path.poses().iter().map(timed).collect(),
    }
}

/// Reads a path file. Roll is dropped, since the eye never rolls: all poses have the same `up`.
/// Poses without times follow each other at 30 per second.
pub(crate) fn read_path(
    file: &Path,
    frame: &FileFrame,
    up: DVec3,
) -> Result<CameraPath, CameraFileError> {
    let timed = |(index, record): (usize, CameraRecord)| {
        let camera = record.camera(frame);
        let camera = camera.map_err(|source| camera_path::PathError::Pose {
            path: file.into(),
            pose: index,
            source,
        })?;
        let pose = Pose::upright(
            camera.eye(),
            camera.eye() + camera.forward(),
            up,
            record.fov,
        );
        Ok(TimedPose {
            time_s: record.time_s.unwrap_or(index as f64 * DEFAULT_INTERVAL_S),
            pose,
        })
    };
    let poses = camera_path::read_records(file, frame, 1.0 / DEFAULT_INTERVAL_S)?
        .into_iter()
        .enumerate()
        .map(timed);
    let poses = poses.collect::<Result<Vec<_>, camera_path::PathError>>()?;
    CameraPath::new(poses).map_err(|source| CameraFileError::Times {
        path: file.into(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;
    use headbox_core::file_frame::UpAxis;

    /// Rounding of a rotation and a change of unit, metres.
    const POSE_TOLERANCE_M: f64 = 1e-12;

    const CENTIMETRES_Z_UP: FileFrame = FileFrame {
        up: UpAxis::Z,
        unit_m: 0.01,
    };

    fn pose() -> Pose {
        Pose::looking_at(dvec3(1.0, 2.0, 3.0), dvec3(-1.0, 2.5, 0.0), 55.0)
    }

    #[test]
    fn paths_round_trip() {
        let poses = (0..5).map(|i| TimedPose {
            time_s: f64::from(i),
            pose: pose().turned(0.1 * f64::from(i), 0.0),
        });
        let path = CameraPath::new(poses.collect()).unwrap();
        let file = tempfile::NamedTempFile::new().unwrap();
        serde_json::to_writer(&file, &path_record(&path, [64, 48], &CENTIMETRES_Z_UP)).unwrap();
        let back = read_path(file.path(), &CENTIMETRES_Z_UP, DVec3::Y).unwrap();
        for (a, b) in path.poses().iter().zip(back.poses()) {
            assert_eq!(a.time_s, b.time_s);
            assert!(a.pose.eye.distance(b.pose.eye) < POSE_TOLERANCE_M);
            assert!(a.pose.forward().distance(b.pose.forward()) < POSE_TOLERANCE_M);
        }
        let cameras = camera_path::read(file.path(), &CENTIMETRES_Z_UP, DVec3::Y, 30.0).unwrap();
        assert_eq!(
            (cameras.len(), cameras[4].width()),
            (5, 64),
            "`headbox render --path` reads it too"
        );
    }

    #[test]
    fn damaged_paths_are_named() {
        let read = |text: &str| {
            let file = tempfile::NamedTempFile::new().unwrap();
            std::fs::write(file.path(), text).unwrap();
            read_path(file.path(), &FileFrame::default(), DVec3::Y)
        };
        let view = r#""eye":[0,0,0],"look_at":[0,0,-1],"up":[0,1,0],"fov":60"#;
        let bad_fov = format!(
            r#"{{"size":[4,4],"poses":[{{{view}}},{{{}}}]}}"#,
            view.replace("60", "0")
        );
        let error = read(&bad_fov).unwrap_err();
        assert!(
            matches!(
                error,
                CameraFileError::File(camera_path::PathError::Pose { pose: 1, .. })
            ),
            "{error}"
        );
        let timed = format!(r#"[{{{view},"time_s":1}},{{{view},"time_s":1}}]"#);
        assert!(matches!(
            read(&timed).unwrap_err(),
            CameraFileError::Times {
                source: PathError::Time(1),
                ..
            }
        ));
        let missing = read_path(
            Path::new("no/such/file.json"),
            &FileFrame::default(),
            DVec3::Y,
        )
        .unwrap_err();
        assert!(missing.to_string().contains("no/such/file.json"));
        let untimed = read(&format!("[{{{view}}},{{{view}}},{{{view}}}]")).unwrap();
        assert!(
            (untimed.duration_s() - 2.0 / 30.0).abs() < 1e-12,
            "without times: 30 a second"
        );
    }
}
