//! Scenes by name: a path, or `builtin:NAME`.

pub use headbox_core::light_parameters::{LightParameters, SunPosition};

use headbox_core::file_frame::FileFrame;
use headbox_model::load::load_scene;
use headbox_scene::load::{LoadError, LoadOptions};
use headbox_scene::scene::{Scene, Sky, SkyError};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A scene as named on the command line, with all that is needed to open it again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneSource {
    /// A path, or `builtin:NAME`.
    pub name: String,
    /// Axes and unit, where they differ from the format's default.
    #[serde(flatten)]
    pub options: LoadOptions,
    /// Light, where it differs from the scene's own.
    #[serde(default = "LightParameters::unspecified")]
    pub light: LightParameters,
}

/// Error while a scene is opened.
#[derive(Debug, thiserror::Error)]
pub enum SceneSourceError {
    /// There is no built-in scene of this name.
    #[error("there is no built-in scene \"{name}\"{tip}; the built-in scenes are: {known}")]
    UnknownBuiltin {
        /// The requested name.
        name: String,
        /// A suggestion of the most similar name, if one is similar.
        tip: String,
        /// The names of all built-in scenes.
        known: String,
    },
    /// The name of a built-in scene without its prefix.
    #[error("{name}: there is no such file; did you mean builtin:{name}?")]
    MissingPrefix {
        /// The requested name.
        name: String,
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
        Self::with_options(name, LoadOptions::default())
    }

    /// A scene whose axes and unit are known.
    pub fn in_frame(name: impl Into<String>, frame: FileFrame) -> Self {
        Self::with_options(name, frame.into())
    }

    fn with_options(name: impl Into<String>, options: LoadOptions) -> Self {
        Self {
            name: name.into(),
            options,
            light: LightParameters::default(),
        }
    }

    /// Replaces the light.
    #[must_use]
    pub fn lit_by(self, light: LightParameters) -> Self {
        Self { light, ..self }
    }

    /// Loads or builds the scene with its light.
    ///
    /// # Errors
    /// See [`SceneSourceError`].
    pub fn open(&self) -> Result<Scene, SceneSourceError> {
        let mut scene = match self.name.strip_prefix("builtin:") {
            None if is_builtin(&self.name) && !Path::new(&self.name).exists() => {
                return Err(SceneSourceError::MissingPrefix {
                    name: self.name.clone(),
                });
            }
            None => load_scene(Path::new(&self.name), &self.options)?,
            Some(builtin) => headbox_scenes::build(builtin, 0).ok_or_else(|| {
                let known: Vec<_> = headbox_scenes::all()
                    .iter()
                    .map(|scene| scene.name)
                    .collect();
                SceneSourceError::UnknownBuiltin {
                    name: builtin.into(),
                    tip: tip(builtin),
                    known: known.join(", "),
                }
            })?,
        };
        scene.set_light(&self.light)?;
        Ok(scene)
    }
}

fn is_builtin(name: &str) -> bool {
    headbox_scenes::all().iter().any(|scene| scene.name == name)
}

/// A suggestion of the built-in scene with the most similar name; empty if none is similar.
fn tip(name: &str) -> String {
    /// Minimum similarity, as for flags of the command line.
    const MIN_SIMILARITY: f64 = 0.7;
    let similarity = |scene: &headbox_scenes::BuiltinScene| strsim::jaro(name, scene.name);
    let best = headbox_scenes::all()
        .iter()
        .max_by(|a, b| similarity(a).total_cmp(&similarity(b)))
        .filter(|best| similarity(best) > MIN_SIMILARITY);
    best.map_or(String::new(), |best| {
        format!(" (did you mean builtin:{}?)", best.name)
    })
}

/// Checksum of a scene's geometry, materials and sky picture, by which shards and their merge check
/// that they have the same scene.
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
