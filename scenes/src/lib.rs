//! Built-in procedural scenes of headbox, each generated from a seed.
//!
//! Every scene suggests a headbox that no triangle intersects. The same name and seed give the same
//! scene.
//!
//! ```
//! let bump = headbox_scenes::build("bump", 1).unwrap();
//! assert_eq!(bump.validate(), Ok(()));
//! assert!(headbox_scenes::build("no such scene", 1).is_none());
//! ```

mod bump;
mod castle;
mod finishes;
mod furniture;
mod hard;
pub mod house;
mod interior;
mod mesh;
mod sprites;
mod stages;
mod texture;
mod tree;
mod ward;

use headbox_scene::scene::Scene;

pub use house::{HOUSE_TRIANGLES, house};

/// A built-in scene.
#[derive(Clone, Copy, Debug)]
pub struct BuiltinScene {
    /// Name, as in `builtin:NAME`.
    pub name: &'static str,
    /// Description in one line.
    pub description: &'static str,
    generator: fn(u64) -> Scene,
}

impl BuiltinScene {
    /// Generates the scene from a seed.
    pub fn build(&self, seed: u64) -> Scene {
        (self.generator)(seed)
    }
}

/// Returns all built-in scenes.
pub fn all() -> &'static [BuiltinScene] {
    const fn scene(
        name: &'static str,
        generator: fn(u64) -> Scene,
        description: &'static str,
    ) -> BuiltinScene {
        BuiltinScene {
            name,
            description,
            generator,
        }
    }
    const ALL: &[BuiltinScene] = &[
        scene(
            "tree",
            tree::build,
            "broad-leaved tree with 440,000 leaf triangles on a meadow",
        ),
        scene(
            "interior",
            interior::build,
            "furnished room with textures, lamps, and sun through its windows",
        ),
        scene(
            "house",
            house::build_scene,
            "furnished one-storey house of 18 rooms with 52 doors and windows",
        ),
        scene(
            "ward",
            ward::build,
            "storey of a hospital: 40 rooms with 500 panels of light, most of them out of sight",
        ),
        scene(
            "bump",
            bump::build,
            "textured plane with a hemisphere and a pyramid, for sprites",
        ),
        scene(
            "sprites",
            sprites::build,
            "mountains, hills, balloons and boulders: four layers for sprites with depth",
        ),
        scene(
            "net",
            stages::net,
            "net of knotted cord before a wall, at 1.8 to 3.1 m: for lumigraphs",
        ),
        scene(
            "statue",
            stages::statue,
            "figure on a pedestal before a curtain, at 2.3 to 5.8 m: for lumigraphs",
        ),
        scene(
            "blocks",
            stages::blocks,
            "heap of painted blocks, at 0.9 to 3.4 m: for lumigraphs",
        ),
        scene(
            "lacquer",
            stages::lacquer,
            "varnished balls on a polished floor, at 1.9 to 4.2 m: gloss for lumigraphs",
        ),
        scene(
            "castle",
            castle::build,
            "castle's wall with an open gate, towers, and a keep behind: for view-dependent geometry",
        ),
        scene(
            "poles",
            hard::poles,
            "hard case: 240 poles, 1 mm to 4 cm thick, at 2 to 90 m",
        ),
        scene(
            "edge-on",
            hard::edge_on,
            "hard case: planes seen edge-on from the centre of the headbox",
        ),
        scene(
            "contact",
            hard::contact,
            "hard case: panels 1 mm away from every face of the headbox",
        ),
        scene(
            "far-offset",
            hard::far_offset,
            "hard case: millimetre steps at coordinates of 100 km",
        ),
        scene(
            "miniature",
            hard::miniature,
            "hard case: a scene one millimetre across",
        ),
    ];
    ALL
}

/// Generates the scene `name`; `None` if there is no such scene.
pub fn build(name: &str, seed: u64) -> Option<Scene> {
    all()
        .iter()
        .find(|scene| scene.name == name)
        .map(|scene| scene.build(seed))
}
