//! Portal models from files: Sweet Home 3D homes, and TOML models that point at scene files.

mod additions;
mod archive;
mod assign;
mod ceilings;
mod finish;
mod home;
mod leaves;
mod plain;
mod split;
mod sweethome;
mod toml;
mod xml;

use crate::{Finding, PortalModel};
use headbox_core::container::HOMES;
use headbox_scene::load::{LoadError, LoadOptions, extension_of, load};
use headbox_scene::scene::Scene;
use headbox_trace::bvh::Tracer;
use std::path::Path;
use std::sync::Arc;

/// Options of loading a portal model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ModelOptions {
    /// Keep the leaves that close doors and windows.
    pub keep_doors: bool,
}

/// A portal model as loaded.
#[derive(Clone, Debug)]
pub struct LoadedModel {
    /// The model, mended ([`PortalModel::mend`]). What was met and survived on the way is in its
    /// scene's summary.
    pub model: PortalModel,
    /// Problems of its cells and portals; those that were left out are numbered on from the last
    /// portal.
    pub findings: Vec<Finding>,
}

/// Adds portals where no wall stands between cells ([`PortalModel::open_borders`]), before
/// triangles are dealt out to them.
fn open_borders(model: &mut PortalModel) -> Vec<Finding> {
    let [low, high] = model.scene.bounds();
    let scene = Arc::new(std::mem::take(&mut model.scene));
    let tracer = Tracer::new(Arc::clone(&scene), (low + high) / 2.0);
    let findings = model.open_borders(&tracer);
    drop(tracer);
    model.scene = Arc::unwrap_or_clone(scene);
    findings
}

impl LoadedModel {
    /// Mends a model whose triangles are dealt out; `found` is what was said of it before.
    fn new(mut model: PortalModel, found: Vec<Finding>) -> Self {
        let joined = model.join_leaking();
        model.suggest_headbox();
        let mut findings = model.mend();
        findings.extend(found.into_iter().chain(joined).chain(model.coplanar()));
        Self { model, findings }
    }
}

/// Loads a scene file or, without the leaves of its doors, a home ([`HOMES`]) as a scene.
///
/// # Errors
/// See [`LoadError`]; a home has its own axes and unit, so that `options` must agree with them.
pub fn load_scene(path: &Path, options: &LoadOptions) -> Result<Scene, LoadError> {
    if !HOMES.contains(&extension_of(path).as_str()) {
        return load(path, options);
    }
    let scene = load_model(path, &ModelOptions::default())?.model.scene;
    // A capture specifies the frame in which it was made when it opens its scene again.
    let is_own_frame = options.up.is_none_or(|up| up == scene.frame.up)
        && options.unit_m.is_none_or(|unit| unit == scene.frame.unit_m);
    is_own_frame
        .then_some(scene)
        .ok_or_else(|| LoadError::Frame {
            path: path.to_path_buf(),
        })
}

/// Loads a portal model: the `Home.xml` of a Sweet Home 3D home with the home's OBJ export beside
/// it, its `.sh3d` archive with or without an export, or a `.toml` model. The formats are described
/// below.
///
/// # Sweet Home 3D
/// The geometry is the home's OBJ export in the same folder: `home.obj`, an OBJ of the plan's own
/// name, or the only OBJ there is. Of an archive without one it is made from the plan and the
/// models and pictures in the archive: walls with their openings, floors, ceilings and furniture;
/// corners of walls overlap, and what is no OBJ becomes a box. Each room with a ceiling becomes a
/// cell; a balcony or terrace open to the sky is outside. If no room has a ceiling, they were
/// switched off to look in from above: those that walls enclose are given one. What stands on a
/// hidden storey is left out. Each door and window becomes a portal in the middle of its wall,
/// between the rooms on its two sides or a room and the outside; the space in the wall belongs to
/// the room on its side, and has a threshold just below its floor: floors that are drawn by hand
/// leave slits there. Where no wall stands at the border of a room there is a portal too. Leaves
/// and panes that close an opening are left out with their handles, open ones stay. Furniture goes
/// as a whole to the cell that it stands in; walls and floors go, triangle by triangle, to the cell
/// that they face, cut where they face several; the rest is outside.
///
/// # TOML
/// ```toml
/// name = "flat"                # optional
/// up = "z"                     # "y" (default) or "z": axis of the scene file and of all coordinates below
/// unit = 0.01                  # metres to a unit; 1 if absent
/// scene = "flat.obj"           # .obj, .gltf or .glb, relative to this file
///
/// [[cell]]
/// name = "hall"
/// groups = ["hall_*"]          # groups of an OBJ, nodes of a glTF; * stands for anything
/// [[cell.prism]]               # its space: one or more upright prisms
/// outline = [[0, 0], [400, 0], [400, 300], [0, 300]]   # corners in plan: (x, z) with Y up, (x, y) with Z up
/// floor = 0
/// ceiling = 250
///
/// [[cell]]
/// name = "garden"
/// outside = true               # at most one cell: all space outside the others
///
/// [[portal]]
/// name = "front door"
/// cells = ["hall", "garden"]
/// polygon = [[100, 0, 0], [200, 0, 0], [200, 0, 210], [100, 0, 210]]
/// ```
/// Groups that no cell names are dealt out as those of a home are. Without an outside cell of the
/// file's own, one called "Outside" is added.
///
/// # Errors
/// See [`LoadError`].
pub fn load_model(path: &Path, options: &ModelOptions) -> Result<LoadedModel, LoadError> {
    match extension_of(path).as_str() {
        "xml" | "sh3d" => sweethome::load(path, options),
        "toml" => toml::load(path),
        _ => Err(LoadError::UnknownModel {
            path: path.to_path_buf(),
        }),
    }
}
