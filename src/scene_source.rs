//! Scenes by name: a path, or `builtin:NAME`.

use crate::capture::Scene;
use crate::capture::load::{LoadError, LoadOptions, load};
use crate::capture::scene::FileFrame;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A scene as named on the command line; enough to open it again when shards are merged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneSource {
    /// A path, or `builtin:NAME`.
    pub name: String,
    /// Its axes and unit, where they are not the format's default.
    #[serde(flatten)]
    pub options: LoadOptions,
}

/// Why a scene could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum SceneSourceError {
    /// No such built-in scene.
    #[error("there is no built-in scene \"{name}\"; the built-in scenes are: {known}")]
    NoSuchBuiltin {
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// The file could not be loaded.
    #[error(transparent)]
    Load(#[from] LoadError),
}

impl SceneSource {
    /// A scene in its format's own frame.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), options: LoadOptions::default() }
    }

    /// A scene whose axes and unit are known.
    pub fn in_frame(name: impl Into<String>, frame: FileFrame) -> Self {
        Self { name: name.into(), options: frame.into() }
    }

    /// Loads or builds the scene.
    ///
    /// # Errors
    /// See [`SceneSourceError`].
    pub fn open(&self) -> Result<Scene, SceneSourceError> {
        let Some(builtin) = self.name.strip_prefix("builtin:") else {
            return Ok(load(Path::new(&self.name), &self.options)?);
        };
        crate::scenes::build(builtin, 0).ok_or_else(|| {
            let known: Vec<_> = crate::scenes::all().iter().map(|scene| scene.name).collect();
            SceneSourceError::NoSuchBuiltin { name: builtin.into(), known: known.join(", ") }
        })
    }
}

/// A checksum of a scene's geometry and materials: tells whether two processes see the same scene.
pub fn fingerprint(scene: &Scene) -> u32 {
    let mut hash = crc32fast::Hasher::new();
    hash.update(bytemuck::cast_slice(&scene.positions));
    for triangle in &scene.triangles {
        hash.update(bytemuck::cast_slice(&triangle.vertices));
        hash.update(&triangle.material.to_le_bytes());
    }
    for material in &scene.materials {
        hash.update(bytemuck::cast_slice(&[material.albedo, material.emission]));
    }
    hash.finalize()
}
