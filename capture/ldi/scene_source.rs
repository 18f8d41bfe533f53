//! Scenes by name: a path, or `builtin:NAME`.

pub use headbox_core::light_parameters::{LightParameters, SunPlace};

use headbox_core::file_frame::FileFrame;
use headbox_model::load::load_scene;
use headbox_scene::load::{LoadError, LoadOptions};
use headbox_scene::scene::Scene;
use headbox_scene::scene::{Sky, SkyError};
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
    #[error("there is no built-in scene \"{name}\"{tip}; the built-in scenes are: {known}")]
    NoSuchBuiltin {
        /// What was asked for.
        name: String,
        /// The name that is nearest to it, if one is near.
        tip: String,
        /// What there is.
        known: String,
    },
    /// The name of a built-in scene without what says so.
    #[error("{name}: there is no such file; did you mean builtin:{name}?")]
    MeansBuiltin {
        /// What was asked for.
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
        Self::in_frame_or_own(name, LoadOptions::default())
    }

    /// A scene whose axes and unit are known.
    pub fn in_frame(name: impl Into<String>, frame: FileFrame) -> Self {
        Self::in_frame_or_own(name, frame.into())
    }

    fn in_frame_or_own(name: impl Into<String>, options: LoadOptions) -> Self {
        Self {
            name: name.into(),
            options,
            light: LightParameters::default(),
        }
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
            None if names_builtin(&self.name) && !Path::new(&self.name).exists() => {
                return Err(SceneSourceError::MeansBuiltin {
                    name: self.name.clone(),
                });
            }
            None => load_scene(Path::new(&self.name), &self.options)?,
            Some(builtin) => headbox_scenes::build(builtin, 0).ok_or_else(|| {
                let known: Vec<_> = headbox_scenes::all()
                    .iter()
                    .map(|scene| scene.name)
                    .collect();
                SceneSourceError::NoSuchBuiltin {
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

fn names_builtin(name: &str) -> bool {
    headbox_scenes::all().iter().any(|scene| scene.name == name)
}

/// The built-in scene that a misspelt name means, as a question.
fn tip(name: &str) -> String {
    /// As the command line has it for its own words.
    const NEAR: f64 = 0.7;
    let near = |scene: &headbox_scenes::BuiltinScene| strsim::jaro(name, scene.name);
    let best = headbox_scenes::all()
        .iter()
        .max_by(|a, b| near(a).total_cmp(&near(b)))
        .filter(|best| near(best) > NEAR);
    best.map_or(String::new(), |best| {
        format!(" (did you mean builtin:{}?)", best.name)
    })
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
