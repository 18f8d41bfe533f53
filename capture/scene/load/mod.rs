//! Scene files: OBJ with MTL, glTF and GLB, PLY and STL.
//!
//! Real files have defects. Those that can be tolerated are counted by kind and reported once in
//! [`Scene::summary`]. A file that cannot be read, or that has no triangle, is a [`LoadError`] that
//! names the file and the cause.

mod builder;
pub mod encoding;
pub(crate) mod gltf;
mod lights;
pub mod lines;
mod named_files;
pub mod notes;
pub mod obj;
mod orientation;
mod ply;
pub mod polygon;
mod stl;
mod textures;
mod vertex_colors;

pub use builder::{Group, GroupedScene};
pub use gltf::HEADBOX_HALF_SIZE;
pub use obj::{material_names, mtl};

use crate::scene::{Scene, SceneError};
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_core::inputs::{PHOTOGRAPHS, REPRESENTATIONS, SCENES, join_extensions};
use headbox_core::read_note::ReadNote;
use headbox_core::{memory, panics};
use std::path::{Path, PathBuf};

/// Up axis and unit of a scene file, if the user specifies them.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LoadOptions {
    /// The axis that points up. `None` is Y for a glTF, as the format defines, and a guess for an
    /// OBJ.
    #[serde(rename = "z_up")]
    pub up: Option<UpAxis>,
    /// Metres per unit of the file. `None` is 1 for a glTF, as the format defines, and a guess for
    /// an OBJ.
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

/// Error of loading a scene file.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file cannot be opened or read.
    #[error("{}: {cause}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        cause: std::io::Error,
    },
    /// The extension is not that of a supported scene format.
    #[error("{}: {}", path.display(), unknown_format(path))]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// The extension is not that of a supported portal model.
    #[error("{}: {}", path.display(), unknown_home(path))]
    UnknownModel {
        /// The file.
        path: PathBuf,
    },
    /// The unit is not a length.
    #[error("{}: the unit is {unit_m} m, but must be positive and finite", path.display())]
    Unit {
        /// The file.
        path: PathBuf,
        /// The requested unit, metres.
        unit_m: f64,
    },
    /// The requested up axis or unit is not that of the file's format.
    #[error("{}: a home defines its own up axis and unit; leave out --up and --unit", path.display())]
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
        /// The defect, and what was expected.
        cause: String,
    },
    /// The file as a whole does not parse.
    #[error("{}: {cause}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The defect, and what was expected.
        cause: String,
    },
    /// The file was read, but the rest of it is not a valid scene.
    #[error("{}: {cause}{}", path.display(), in_brackets(notes))]
    Unusable {
        /// The file.
        path: PathBuf,
        /// The violated invariant; [`SceneError::NoTriangles`] for an empty file.
        cause: SceneError,
        /// Defects that were tolerated before, as in [`crate::scene::LoadSummary`].
        notes: Vec<ReadNote>,
    },
}

impl LoadError {
    /// Creates a [`Self::Malformed`] error.
    pub fn malformed(path: &Path, cause: impl Into<String>) -> Self {
        Self::Malformed {
            path: path.to_path_buf(),
            cause: cause.into(),
        }
    }
}

/// Describes an unsupported home format, and names a home that lies beside the file.
fn unknown_home(path: &Path) -> String {
    let beside = path.with_file_name("Home.xml");
    if beside.is_file() {
        return format!("not a home; use {}, which lies beside it", beside.display());
    }
    "unknown home format; use Home.xml, a .sh3d file, builtin:house, or a .toml file that names \
     a scene and its rooms"
        .into()
}

/// Explains why a file that is not a supported scene is refused.
fn unknown_format(path: &Path) -> String {
    let extension = extension_of(path);
    if SPLAT_FORMATS.contains(&extension.as_str()) {
        SPLATS_REFUSED.into()
    } else if FORMATS_TO_CONVERT.contains(&extension.as_str()) {
        format!(
            ".{extension} scenes are not read; save the scene as .glb and open that (for example \
             in Blender: File > Import, then File > Export > glTF 2.0)"
        )
    } else if extension == "house" {
        format!(
            "a house with baked light; show it with headbox view or headbox render {}, or name the \
             home that it was made of, with the --exposure that headbox house printed",
            path.display()
        )
    } else if REPRESENTATIONS.contains(&extension.as_str()) {
        format!(
            "already captured; show it with headbox view or headbox render {}",
            path.display()
        )
    } else if PHOTOGRAPHS.contains(&extension.as_str()) {
        "an image, not a scene; name the folder of a set of images with known cameras".into()
    } else {
        format!(
            "unknown scene format; use an {} file, a home (Home.xml, .sh3d or .toml), or \
             builtin:NAME (see headbox scenes)",
            join_extensions(&SCENES)
        )
    }
}

/// Extensions of files of Gaussian splats.
const SPLAT_FORMATS: [&str; 4] = ["ksplat", "sog", "splat", "spz"];

/// Message about a file with Gaussian splats alone.
const SPLATS_REFUSED: &str = "a cloud of Gaussian splats, not a mesh: splats have no surface that \
     rays could meet and are not read; open the scene, images or capture that they were made from";

/// Extensions of scene files that are known and not read.
const FORMATS_TO_CONVERT: [&str; 31] = [
    "3dm", "3ds", "3mf", "abc", "blend", "c4d", "dae", "dwg", "dxf", "fbx", "ifc", "iges", "igs",
    "jt", "lwo", "ma", "max", "mb", "off", "rvt", "skp", "step", "stp", "usd", "usda", "usdc",
    "usdz", "vrml", "wrl", "x3d", "xsi",
];

fn in_brackets(notes: &[ReadNote]) -> String {
    if notes.is_empty() {
        String::new()
    } else {
        let notes: Vec<String> = notes.iter().map(ToString::to_string).collect();
        format!(" ({})", notes.join("; "))
    }
}

/// Loads a scene file by its extension (in any case), one of [`SCENES`]. The scene gets the lights
/// of a glTF (KHR_lights_punctual), else the default sun, and the default sky; positions are
/// converted to metres, Y up.
///
/// # Errors
/// See [`LoadError`].
pub fn load(path: &Path, options: &LoadOptions) -> Result<Scene, LoadError> {
    load_file(path, options, false).map(|grouped| grouped.scene)
}

/// Loads a scene file as [`load`] does, with the groups and objects of an OBJ or the nodes of a
/// glTF. Groups do not share vertices.
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
        "ply" => ply::load,
        "stl" => stl::load,
        _ => {
            return Err(LoadError::UnknownFormat {
                path: path.to_path_buf(),
            });
        }
    };
    let bytes = read(path)?;
    catch_panics(path, || loader(path, &bytes, options, groups))
}

/// Calls a loader. A panic in it, or in a parser that it calls, becomes [`LoadError::Malformed`].
///
/// # Errors
/// Those of `load`.
pub fn catch_panics<T>(
    path: &Path,
    load: impl FnOnce() -> Result<T, LoadError>,
) -> Result<T, LoadError> {
    panics::catch(load).unwrap_or_else(|panic| {
        let cause = format!("its parser failed: {panic}");
        Err(LoadError::malformed(path, cause))
    })
}

/// Returns the extension of a path in lower case, or an empty string.
pub fn extension_of(path: &Path) -> String {
    path.extension()
        .map(|extension| extension.to_string_lossy().to_lowercase())
        .unwrap_or_default()
}

/// Reads a file.
///
/// # Errors
/// [`LoadError::Io`].
pub fn read(path: &Path) -> Result<Vec<u8>, LoadError> {
    memory::read_file(path).map_err(|cause| LoadError::Io {
        path: path.to_path_buf(),
        cause,
    })
}

/// Returns the name of a file without its extension.
pub fn file_stem(path: &Path) -> String {
    path.file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// Returns the folder of a file.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}
