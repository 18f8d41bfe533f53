//! Cameras and camera paths as plain JSON files, in the scene file's own axes and unit, with the
//! names of the command line's options.
//!
//! ```json
//! [{"eye": [0, 1.6, 0], "look_at": [0, 1.5, -4], "up": [0, 1, 0], "fov": 60, "size": [1024, 768]}]
//! ```
//!
//! `up`, `fov` and `size` are optional. Three forms are read: a list of cameras, a single camera,
//! and a path that the window has recorded, `{"size": ..., "poses": [...]}` with times.
//!
//! Paths of other programs are read, too: the JSON of nerfstudio's viewer (`{"camera_path":
//! [{"camera_to_world": [16 numbers, row by row], "fov": 50}], "render_height": ...}`), whose
//! cameras are in the scene file's axes and unit, and the cameras of a `.gltf` or `.glb` file with
//! their animation, as Blender exports it: metres, Y up.

use crate::load::gltf::cameras::{self, GltfCamera};
use crate::load::{LoadError, extension_of};
use glam::{DMat4, DVec3};
use headbox_core::camera::{Camera, CameraError};
use headbox_core::file_frame::{FileFrame, UpAxis};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// One camera, as in the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraRecord {
    /// Position of the eye, in the axes and unit of the scene's file.
    pub eye: [f64; 3],
    /// A point that projects to the middle of the image, likewise.
    pub look_at: [f64; 3],
    /// Direction that points up in the image; the file's up axis, or that of the images that were
    /// captured, if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
    /// Vertical field of view, degrees.
    #[serde(default = "default_fov")]
    pub fov: f64,
    /// Width and height, pixels; those of the path if absent, else 1024x768.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<[u32; 2]>,
    /// Time of the recording, seconds from its start; renderers ignore it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
}

/// A path in the form that the window records.
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

/// Error of reading a camera path.
#[derive(Debug, thiserror::Error)]
pub enum PathError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// The JSON has none of the known forms.
    #[error("{}: not a camera path: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// The parser's error.
        source: serde_json::Error,
    },
    /// A glTF file cannot be read or has no cameras.
    #[error(transparent)]
    Gltf(#[from] LoadError),
    /// A pose is not a valid camera.
    #[error("{}: pose {pose}: {source}", path.display())]
    Pose {
        /// The file.
        path: PathBuf,
        /// Number of the pose, from 0.
        pose: usize,
        /// The error.
        source: CameraError,
    },
    /// The path has no poses.
    #[error("{}: the path has no poses", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
}

impl CameraRecord {
    /// Record of a camera at `eye` that looks along `forward`, with `up` in the image (world axes,
    /// metres). The look-at point is one metre ahead.
    pub fn new(eye: DVec3, forward: DVec3, up: DVec3, fov_y_deg: f64, frame: &FileFrame) -> Self {
        let point = |p: DVec3| frame.file_from_world(p).to_array();
        let up = (frame.file_from_world(up) * frame.unit_m).to_array();
        Self {
            eye: point(eye),
            look_at: point(eye + forward),
            up: Some(up),
            fov: fov_y_deg,
            size: None,
            time_s: None,
        }
    }

    /// Returns the camera in the world frame.
    ///
    /// # Errors
    /// See [`CameraError`].
    pub fn camera(&self, frame: &FileFrame) -> Result<Camera, CameraError> {
        let file_up = if frame.up == UpAxis::Z {
            [0.0, 0.0, 1.0]
        } else {
            [0.0, 1.0, 0.0]
        };
        let [eye, look_at] =
            [self.eye, self.look_at].map(|p| frame.world_from_file(DVec3::from(p)));
        let up = frame.world_direction_from_file(DVec3::from(self.up.unwrap_or(file_up)));
        let [width, height] = self.size.unwrap_or(DEFAULT_SIZE);
        Camera::look_at(eye, look_at, up, self.fov, [width, height])
    }
}

/// A camera path of nerfstudio's viewer.
#[derive(Deserialize)]
struct NerfstudioPath {
    camera_path: Vec<NerfstudioPose>,
    render_height: Option<u32>,
    render_width: Option<u32>,
    fps: Option<f64>,
}

#[derive(Deserialize)]
struct NerfstudioPose {
    /// Row-major matrix with the columns right, up, back and position.
    camera_to_world: [f64; 16],
    /// Vertical field of view, degrees.
    #[serde(default = "default_fov")]
    fov: f64,
}

impl NerfstudioPath {
    fn records(self) -> Vec<CameraRecord> {
        let size = self
            .render_width
            .zip(self.render_height)
            .map(|(width, height)| [width, height]);
        let record = |(i, pose): (usize, NerfstudioPose)| {
            let camera = DMat4::from_cols_array(&pose.camera_to_world).transpose();
            let [up, back, eye] =
                [camera.y_axis, camera.z_axis, camera.w_axis].map(|column| column.truncate());
            CameraRecord {
                eye: eye.to_array(),
                look_at: (eye - back).to_array(),
                up: Some(up.to_array()),
                fov: pose.fov,
                size,
                time_s: self.fps.filter(|fps| *fps > 0.0).map(|fps| i as f64 / fps),
            }
        };
        self.camera_path
            .into_iter()
            .enumerate()
            .map(record)
            .collect()
    }
}

/// Converts a glTF camera. The default image height applies if the camera has an aspect ratio.
fn gltf_record(camera: &GltfCamera, frame: &FileFrame) -> CameraRecord {
    let width = |aspect: f64| {
        (aspect * f64::from(DEFAULT_SIZE[1]))
            .round()
            .clamp(1.0, f64::from(Camera::MAX_SIDE_PX)) as u32
    };
    CameraRecord {
        size: camera.aspect.map(|aspect| [width(aspect), DEFAULT_SIZE[1]]),
        time_s: Some(camera.time_s),
        ..CameraRecord::new(
            camera.eye,
            camera.forward,
            camera.up,
            camera.fov_y.to_degrees(),
            frame,
        )
    }
}

/// Reads a file of any form. Poses without a size have that of the path. Animations are sampled
/// `fps` times a second.
///
/// # Errors
/// See [`PathError`]; poses are not validated.
pub fn read_records(
    path: &Path,
    frame: &FileFrame,
    fps: f64,
) -> Result<Vec<CameraRecord>, PathError> {
    let bytes = std::fs::read(path).map_err(|source| PathError::Io {
        path: path.into(),
        source,
    })?;
    let json = |source| PathError::Json {
        path: path.into(),
        source,
    };
    let poses: Vec<CameraRecord> = if matches!(extension_of(path).as_str(), "gltf" | "glb") {
        cameras::read(path, &bytes, fps)?
            .iter()
            .map(|camera| gltf_record(camera, frame))
            .collect()
    } else {
        // The form is determined first: an untagged enum would hide the parser's error.
        let value: serde_json::Value = serde_json::from_slice(&bytes).map_err(json)?;
        if value.is_array() {
            serde_json::from_slice(&bytes).map_err(json)?
        } else if value.get("eye").is_some() {
            vec![serde_json::from_slice(&bytes).map_err(json)?]
        } else if value.get("camera_path").is_some() {
            serde_json::from_slice::<NerfstudioPath>(&bytes)
                .map_err(json)?
                .records()
        } else {
            let path: PathRecord = serde_json::from_slice(&bytes).map_err(json)?;
            let sized = |pose: CameraRecord| CameraRecord {
                size: pose.size.or(path.size),
                ..pose
            };
            path.poses.into_iter().map(sized).collect()
        }
    };
    if poses.is_empty() {
        Err(PathError::Empty { path: path.into() })
    } else {
        Ok(poses)
    }
}

/// Reads the cameras of a path in the world frame; animations are sampled `fps` times a second.
/// Poses that do not say what is up have the direction `up` (world axes) upward.
///
/// # Errors
/// See [`PathError`].
pub fn read(path: &Path, frame: &FileFrame, up: DVec3, fps: f64) -> Result<Vec<Camera>, PathError> {
    let file_up = (frame.file_from_world(up) * frame.unit_m).to_array();
    let camera = |(number, pose): (usize, CameraRecord)| {
        let pose = CameraRecord {
            up: pose.up.or(Some(file_up)),
            ..pose
        };
        pose.camera(frame).map_err(|source| PathError::Pose {
            path: path.into(),
            pose: number,
            source,
        })
    };
    read_records(path, frame, fps)?
        .into_iter()
        .enumerate()
        .map(camera)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: FileFrame = FileFrame {
        up: UpAxis::Z,
        unit_m: 0.01,
    };

    fn read_text(text: &str) -> Result<Vec<Camera>, PathError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("path.json");
        std::fs::write(&path, text).unwrap();
        read(&path, &FRAME, DVec3::Y, 30.0)
    }

    #[test]
    fn poses_are_in_the_files_axes_and_unit() {
        let cameras =
            read_text(r#"[{"eye": [100, 0, 200], "look_at": [100, 50, 200], "size": [8, 4]}]"#)
                .unwrap();
        assert!((cameras[0].eye() - DVec3::new(1.0, 2.0, 0.0)).length() < 1e-12);
        assert!(
            (cameras[0].forward() - DVec3::NEG_Z).length() < 1e-12,
            "+Y of a file with Z up is -Z of the world"
        );
        assert!((cameras[0].world_from_eye().y_axis - DVec3::Y).length() < 1e-12);
    }

    #[test]
    fn poses_without_an_up_direction_take_that_of_the_images() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("path.json");
        let text = r#"[{"eye": [0, 0, 0], "look_at": [0, 1, 0]},
            {"eye": [0, 0, 0], "look_at": [0, 1, 0], "up": [0, 0, 1]}]"#;
        std::fs::write(&path, text).unwrap();
        let cameras = read(&path, &FRAME, DVec3::NEG_Y, 30.0).unwrap();
        let ups = [0, 1].map(|i: usize| cameras[i].world_from_eye().y_axis);
        assert!(ups[0].distance(DVec3::NEG_Y) < 1e-12, "{ups:?}");
        assert!(ups[1].distance(DVec3::Y) < 1e-12, "its own: {ups:?}");
    }

    #[test]
    fn recorded_path_is_read() {
        let text = r#"{"size": [8, 4], "poses": [{"time_s": 0.5, "eye": [0, 0, 0], "look_at": [0, 1, 0]}]}"#;
        let cameras = read_text(text).unwrap();
        assert_eq!((cameras[0].width(), cameras[0].height()), (8, 4));
    }

    #[test]
    fn saved_camera_is_path_of_one_pose() {
        let (eye, forward) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.6, 0.0, -0.8));
        let record = CameraRecord {
            size: Some([8, 4]),
            ..CameraRecord::new(eye, forward, DVec3::Y, 55.0, &FRAME)
        };
        assert_eq!(
            (record.eye, record.up),
            ([100.0, -300.0, 200.0], Some([0.0, 0.0, 1.0]))
        );
        let cameras = read_text(&serde_json::to_string(&record).unwrap()).unwrap();
        assert_eq!((cameras.len(), cameras[0].width()), (1, 8));
        assert!(
            (cameras[0].eye() - eye).length() < 1e-12
                && (cameras[0].forward() - forward).length() < 1e-12
        );
    }

    #[test]
    fn nerfstudio_path_is_read() {
        // Right is +X, up +Z, back -Y of the file: it looks along +Y, which is -Z of the world.
        let pose = r#"{"camera_to_world": [1,0,0,100, 0,0,-1,0, 0,1,0,200, 0,0,0,1], "fov": 50, "aspect": 2}"#;
        let text = format!(
            r#"{{"camera_path": [{pose}, {pose}], "render_height": 4, "render_width": 8, "fps": 24, "seconds": 1}}"#
        );
        let cameras = read_text(&text).unwrap();
        assert_eq!(
            (cameras.len(), cameras[1].width(), cameras[1].height()),
            (2, 8, 4)
        );
        assert!((cameras[0].eye() - DVec3::new(1.0, 2.0, 0.0)).length() < 1e-12);
        assert!((cameras[0].forward() - DVec3::NEG_Z).length() < 1e-12);
        assert!((cameras[0].world_from_eye().y_axis - DVec3::Y).length() < 1e-12);
        assert!((cameras[0].focal_px() - 2.0 / 25f64.to_radians().tan()).abs() < 1e-9);
    }

    /// A camera on an arm: the arm turns by 90 degrees about Y in 1 s, the camera is 2 m in front
    /// of it and moves up by 1 m.
    fn arm(interpolation: &str) -> String {
        let half = 0.5f32.sqrt();
        let times = [0.0f32, 1.0];
        let rotations = [[0.0, 0.0, 0.0, 1.0], [0.0, half, 0.0, half]];
        let translations = [[0.0, 0.0, 2.0], [0.0, 1.0, 2.0]];
        let numbers: Vec<String> = times
            .iter()
            .chain(rotations.as_flattened())
            .chain(translations.as_flattened())
            .flat_map(|f| f.to_le_bytes())
            .map(|byte| format!("%{byte:02x}"))
            .collect();
        format!(
            r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}],
            "nodes": [{{"children": [1]}}, {{"camera": 0, "translation": [9, 9, 9]}}],
            "cameras": [{{"type": "perspective", "perspective": {{"yfov": 0.8, "znear": 0.1, "aspectRatio": 2.0}}}}],
            "buffers": [{{"byteLength": 64, "uri": "data:application/octet-stream,{}"}}],
            "bufferViews": [{{"buffer": 0, "byteOffset": 0, "byteLength": 8}}, {{"buffer": 0, "byteOffset": 8, "byteLength": 32}},
                {{"buffer": 0, "byteOffset": 40, "byteLength": 24}}],
            "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 2, "type": "SCALAR"}},
                {{"bufferView": 1, "componentType": 5126, "count": 2, "type": "VEC4"}},
                {{"bufferView": 2, "componentType": 5126, "count": 2, "type": "VEC3"}}],
            "animations": [{{"samplers": [{{"input": 0, "output": 1, "interpolation": "{interpolation}"}},
                {{"input": 0, "output": 2, "interpolation": "{interpolation}"}}],
                "channels": [{{"sampler": 0, "target": {{"node": 0, "path": "rotation"}}}},
                {{"sampler": 1, "target": {{"node": 1, "path": "translation"}}}}]}}]}}"#,
            numbers.concat()
        )
    }

    fn read_gltf(text: &str, fps: f64) -> Result<Vec<Camera>, PathError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("path.gltf");
        std::fs::write(&path, text).unwrap();
        read(&path, &FileFrame::default(), DVec3::Y, fps)
    }

    #[test]
    fn animated_gltf_camera_is_path() {
        let cameras = read_gltf(&arm("LINEAR"), 4.0).unwrap();
        assert_eq!(
            (cameras.len(), cameras[0].width(), cameras[0].height()),
            (5, 1536, 768)
        );
        for (i, camera) in cameras.iter().enumerate() {
            let t = i as f64 / 4.0;
            let angle = t * std::f64::consts::FRAC_PI_2;
            let eye = DVec3::new(2.0 * angle.sin(), t, 2.0 * angle.cos());
            // Keys are floats.
            assert!(
                (camera.eye() - eye).length() < 1e-6,
                "{t}: {}",
                camera.eye()
            );
            assert!((camera.forward() + eye.with_y(0.0) / 2.0).length() < 1e-6);
        }
        let held = read_gltf(&arm("STEP"), 4.0).unwrap();
        assert!(
            (held[3].eye() - DVec3::new(0.0, 0.0, 2.0)).length() < 1e-6
                && (held[4].eye().y - 1.0).abs() < 1e-6
        );
        let standing = arm("LINEAR").replace("\"animations\"", "\"stillness\"");
        let standing = read_gltf(&standing, 4.0).unwrap();
        assert!(standing.len() == 1 && (standing[0].eye() - DVec3::splat(9.0)).length() < 1e-12);
    }

    #[test]
    fn gltf_without_path_is_rejected() {
        let message = |text: &str| read_gltf(text, 30.0).err().unwrap().to_string();
        assert!(message(r#"{"asset": {"version": "2.0"}}"#).contains("it has no camera"));
        assert!(
            message(&arm("LINEAR").replace(
                "\"count\": 2, \"type\": \"VEC4\"",
                "\"count\": 3, \"type\": \"VEC4\""
            ))
            .contains("keys")
        );
        assert!(
            message(&arm("CUBICSPLINE")).contains("keys"),
            "three values a key"
        );
        assert!(message("glTF").contains("path.gltf"));
    }

    #[test]
    fn errors_name_file_and_pose() {
        let message = |text| read_text(text).err().unwrap().to_string();
        assert!(message("[").contains("line 1"));
        assert!(message("[]").contains("no poses"));
        assert!(message(r#"[{"eye": [0,0,0], "look_at": [0,0,0]}]"#).contains("pose 0"));
        assert!(message(r#"[{"eye": [0,0,0], "lookat": [0,0,0]}]"#).contains("lookat"));
    }
}
