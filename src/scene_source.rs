//! Scenes by name: a path, or `builtin:NAME`.

mod light;

pub use light::{LightParameters, SunPlace};

use crate::capture::Scene;
use crate::capture::load::{LoadError, LoadOptions, load};
use crate::capture::scene::{FileFrame, Sky, SkyError};
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
    /// Its light, where it is not the scene's own.
    #[serde(default)]
    pub light: LightParameters,
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
    /// The sky could not be read.
    #[error(transparent)]
    Sky(#[from] SkyError),
}

impl SceneSource {
    /// A scene in its format's own frame.
    pub fn new(name: impl Into<String>) -> Self {
        Self::in_frame_or_own(name, LoadOptions::default())
    }

    /// A scene whose axes and unit are known.
    pub fn in_frame(name: impl Into<String>, frame: FileFrame) -> Self {
        Self::in_frame_or_own(name, frame.into())
    }

    fn in_frame_or_own(name: impl Into<String>, options: LoadOptions) -> Self {
        Self { name: name.into(), options, light: LightParameters::default() }
    }

    /// The same scene in this light.
    #[must_use]
    pub fn lit_by(self, light: LightParameters) -> Self {
        Self { light, ..self }
    }

    /// Loads or builds the scene, in its light.
    ///
    /// # Errors
    /// See [`SceneSourceError`].
    pub fn open(&self) -> Result<Scene, SceneSourceError> {
        let mut scene = match self.name.strip_prefix("builtin:") {
            None => load(Path::new(&self.name), &self.options)?,
            Some(builtin) => crate::scenes::build(builtin, 0).ok_or_else(|| {
                let known: Vec<_> = crate::scenes::all().iter().map(|scene| scene.name).collect();
                SceneSourceError::NoSuchBuiltin { name: builtin.into(), known: known.join(", ") }
            })?,
        };
        self.light.apply(&mut scene)?;
        Ok(scene)
    }
}

/// A checksum of a scene's geometry, materials and picture of the sky: tells whether two processes see the same scene.
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
    if let Some(Sky::Picture(picture)) = &scene.sky {
        hash.update(bytemuck::cast_slice(picture.texels()));
    }
    hash.finalize()
}
