//! Scenes in memory.

use crate::Error;
use glam::DVec3;
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_core::headbox::Headbox;
use headbox_core::read_note::ReadNote;
use headbox_ldi::scene_source::SceneSource;
use headbox_scene::load::LoadOptions;
use headbox_trace::bvh::Tracer;
use headbox_trace::viewpoint::place_headbox;
use std::sync::Arc;

/// A scene in memory: triangles, materials and lights, and its name. Cheap to clone.
///
/// ```
/// # fn main() -> Result<(), headbox::Error> {
/// let scene = headbox::Scene::open("builtin:miniature")?;
/// let [low, high] = scene.bounds();
/// assert!(low.y < high.y);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Scene {
    source: SceneSource,
    loaded: Arc<headbox_scene::scene::Scene>,
}

impl Scene {
    /// Opens an `.obj`, `.gltf`, `.glb`, `.ply` or `.stl` file, or `builtin:NAME`.
    ///
    /// # Errors
    /// [`Error::Scene`].
    pub fn open(name: impl Into<String>) -> Result<Self, Error> {
        Self::open_with(name, None, None)
    }

    /// Opens a file with a given up axis and metres per unit. `None` means Y and 1 in a glTF, as
    /// its format rules, and a guess in an OBJ, which [`Self::notes`] reports.
    ///
    /// # Errors
    /// [`Error::Scene`].
    pub fn open_with(
        name: impl Into<String>,
        up: Option<UpAxis>,
        unit_m: Option<f64>,
    ) -> Result<Self, Error> {
        let source = SceneSource {
            options: LoadOptions { up, unit_m },
            ..SceneSource::new(name)
        };
        let loaded = Arc::new(source.open()?);
        Ok(Self { source, loaded })
    }

    /// The name under which it was opened.
    pub fn name(&self) -> &str {
        &self.source.name
    }

    /// Notes of the loader about problems in the file.
    pub fn notes(&self) -> &[ReadNote] {
        &self.loaded.summary.notes
    }

    /// The corners of the bounding box, world metres.
    pub fn bounds(&self) -> [DVec3; 2] {
        self.loaded.bounds()
    }

    /// The mapping of the file's axes and unit to the world.
    pub fn frame(&self) -> FileFrame {
        self.loaded.frame
    }

    /// The suggested headbox: that of the scene itself, else one in free space with much to see
    /// around it.
    ///
    /// # Errors
    /// [`Error::Headbox`] if the scene is so small or so large that there is none.
    pub fn headbox(&self) -> Result<Headbox, Error> {
        Ok(place_headbox(&self.loaded, None, None)?)
    }

    /// A ray tracer of the scene, exact near `origin` (world metres).
    pub fn tracer(&self, origin: DVec3) -> Tracer {
        Tracer::new(Arc::clone(&self.loaded), origin)
    }

    /// The source, from which the scene can be opened again.
    pub(crate) fn source(&self) -> &SceneSource {
        &self.source
    }

    /// The scene of the capture crates.
    pub(crate) fn loaded(&self) -> &Arc<headbox_scene::scene::Scene> {
        &self.loaded
    }
}
