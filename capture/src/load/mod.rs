//! Scene files: OBJ with MTL, glTF and GLB.
//!
//! Real files are dirty. What can be survived is survived, counted by kind and told once in
//! [`Scene::summary`]; a file that cannot be read, or that holds nothing to see, is a [`LoadError`] that names the
//! file and the cause.

mod builder;
mod gltf;
mod lines;
mod mtl;
mod notes;
mod obj;
mod obj_lines;
mod polygon;
mod textures;

use crate::scene::{FileFrame, Scene, SceneError, UpAxis};
use std::path::{Path, PathBuf};

/// What the user says about a file, where the file does not say it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoadOptions {
    /// The axis that points up; `None` is the format's own (glTF) or usual (OBJ) one: Y.
    pub up: Option<UpAxis>,
    /// Metres per unit of the file; `None` is 1.
    pub unit_m: Option<f64>,
}

/// Why a scene file could not be loaded.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file cannot be opened or read.
    #[error("cannot read {}: {cause}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// The file's ending is not one of those that are read.
    #[error("{}: unknown kind of scene file; expected .obj, .gltf or .glb", path.display())]
    UnknownFormat {
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

/// Loads a scene file; the ending `.obj`, `.gltf` or `.glb` (in any case) decides how. The scene gets the default sun
/// and sky; positions are brought to metres, Y up.
///
/// # Errors
/// See [`LoadError`].
pub fn load(path: &Path, options: &LoadOptions) -> Result<Scene, LoadError> {
    let frame = FileFrame { up: options.up.unwrap_or_default(), unit_m: options.unit_m.unwrap_or(1.0) };
    if !(frame.unit_m.is_finite() && frame.unit_m > 0.0) {
        return Err(LoadError::Unit { path: path.to_path_buf(), unit_m: frame.unit_m });
    }
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    let loader = match extension.as_deref() {
        Some("obj") => obj::load,
        Some("gltf" | "glb") => gltf::load,
        _ => return Err(LoadError::UnknownFormat { path: path.to_path_buf() }),
    };
    let bytes = std::fs::read(path).map_err(|cause| LoadError::Io { path: path.to_path_buf(), cause })?;
    loader(path, &bytes, frame)
}

/// The folder that a file lies in.
fn folder_of(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}
