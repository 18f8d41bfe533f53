//! The built-in procedural scenes of headbox: small generators over a seed.
//!
//! Every scene suggests a headbox that no triangle touches. The same name and seed give the same scene.
//!
//! ```
//! let tree = headbox_scenes::build("tree", 1).unwrap();
//! assert_eq!(tree.validate(), Ok(()));
//! assert!(headbox_scenes::build("no such scene", 1).is_none());
//! ```

mod mesh;
mod rng;
mod sprites;
mod texture;
mod tree;

use headbox_capture::Scene;

/// A scene that a generator makes.
#[derive(Clone, Copy, Debug)]
pub struct BuiltinScene {
    /// As in `builtin:NAME`.
    pub name: &'static str,
    /// One line for a list.
    pub description: &'static str,
    generator: fn(u64) -> Scene,
}

impl BuiltinScene {
    /// Makes the scene from a seed.
    pub fn build(&self, seed: u64) -> Scene {
        (self.generator)(seed)
    }
}

/// All built-in scenes.
pub fn all() -> &'static [BuiltinScene] {
    &[
        BuiltinScene {
            name: "tree",
            description: "broad-leaved tree with 440,000 leaf triangles on a meadow",
            generator: tree::build,
        },
        BuiltinScene {
            name: "sprites",
            description: "mountains, hills, balloons and boulders: four layers for sprites with depth",
            generator: sprites::build,
        },
    ]
}

/// Makes the scene called `name`, or `None` if there is none of that name.
pub fn build(name: &str, seed: u64) -> Option<Scene> {
    all().iter().find(|scene| scene.name == name).map(|scene| scene.build(seed))
}
