//! Scene files: OBJ with MTL, glTF and GLB; portal models: Sweet Home 3D and TOML.
//!
//! Real files are dirty. What can be survived is survived, counted by kind and told once in
//! [`Scene::summary`]; a file that cannot be read, or that holds nothing to see, is a [`LoadError`] that names the
//! file and the cause.

mod builder;
pub(crate) mod gltf;
mod lights;
pub mod lines;
pub mod mtl;
pub mod notes;
pub mod obj;
mod obj_prepare;
mod orientation;
pub mod polygon;
mod textures;

pub use builder::{Group, GroupedScene};
pub use gltf::HEADBOX_HALF_SIZE;

use crate::scene::{Scene, SceneError};
use headbox_core::file_frame::{FileFrame, UpAxis};
use std::path::{Path, PathBuf};

/// What the user says about a file, where the file does not say it.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LoadOptions {
    /// The axis that points up; `None` is Y in a glTF, as its format rules, and guessed from evidence in an OBJ.
    #[serde(rename = "z_up")]
    pub up: Option<UpAxis>,
    /// Metres per unit of the file; `None` is 1 in a glTF, and guessed in an OBJ.
    pub unit_m: Option<f64>,
}

impl From<FileFrame> for LoadOptions {
    fn from(frame: FileFrame) -> Self {
        Self {
            up: Some(frame.up),
            unit_m: Some(frame.unit_m),
        }
    }
}

/// Why a scene file could not be loaded.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file cannot be opened or read.
    #[error("{}: {cause}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// The file's ending is not one of those that are read.
    #[error("{}: not a kind of scene that is read; give an .obj, .gltf or .glb file, a home (Home.xml, .sh3d or .toml), or builtin:NAME (see headbox scenes)", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// The file's ending is not one of the portal models that are read.
    #[error("{}: not a kind of home that is read; give a .toml, Home.xml or .sh3d file, or builtin:house", path.display())]
    UnknownModel {
        /// The file.
        path: PathBuf,
    },
    /// The unit is not a length.
    #[error("{}: a unit of {unit_m} m; it must be positive and finite", path.display())]
    Unit {
        /// The file.
        path: PathBuf,
        /// The unit asked for.
        unit_m: f64,
    },
    /// Another up axis or unit was asked for than the file has by its format.
    #[error("{}: a home knows its up axis and its unit: leave them out", path.display())]
    Frame {
        /// The file.
        path: PathBuf,
    },
    /// A line does not parse.
    #[error("{}, line {line}: {cause}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// What was expected or found.
        cause: String,
    },
    /// The file as a whole does not parse.
    #[error("{}: {cause}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What was expected or found.
        cause: String,
    },
    /// The file was read, but what is left of it is no scene.
    #[error("{}: {cause}{}{survived}", path.display(), if survived.is_empty() { "" } else { " after this: " })]
    Unusable {
        /// The file.
        path: PathBuf,
        /// The broken promise; [`SceneError::NoTriangles`] for an empty file.
        cause: SceneError,
        /// What was met on the way, as in [`crate::scene::LoadSummary`].
        survived: String,
    },
}

/// Loads a scene file; its extension (in any case) decides how: `.obj`, `.gltf` or `.glb`. The scene gets the lights of a
/// glTF (KHR_lights_punctual), else the default sun, and the default sky; positions are converted to metres, Y up.
///
/// # Errors
/// See [`LoadError`].
pub fn load(path: &Path, options: &LoadOptions) -> Result<Scene, LoadError> {
    load_file(path, options, false).map(|grouped| grouped.scene)
}

/// As [`load`], and keeps the groups and objects of an OBJ, and the nodes of a glTF, apart. Vertices are not shared
/// between groups.
///
/// # Errors
/// See [`LoadError`].
pub fn load_grouped(path: &Path, options: &LoadOptions) -> Result<GroupedScene, LoadError> {
    load_file(path, options, true)
}

fn load_file(path: &Path, options: &LoadOptions, groups: bool) -> Result<GroupedScene, LoadError> {
    if let Some(unit_m) = options
        .unit_m
        .filter(|unit_m| !(unit_m.is_finite() && *unit_m > 0.0))
    {
        return Err(LoadError::Unit {
            path: path.to_path_buf(),
            unit_m,
        });
    }
    let loader = match extension_of(path).as_str() {
        "obj" => obj::load,
        "gltf" | "glb" => gltf::load,
        _ => {
            return Err(LoadError::UnknownFormat {
                path: path.to_path_buf(),
            });
        }
    };
    loader(path, &read(path)?, options, groups)
}

/// The ending of a path in lower case; empty if it has none.
pub fn extension_of(path: &Path) -> String {
    path.extension()
        .map(|extension| extension.to_string_lossy().to_lowercase())
        .unwrap_or_default()
}

/// Reads a file, with an error that names it.
pub fn read(path: &Path) -> Result<Vec<u8>, LoadError> {
    std::fs::read(path).map_err(|cause| LoadError::Io {
        path: path.to_path_buf(),
        cause,
    })
}

/// The folder that a file lies in.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}
