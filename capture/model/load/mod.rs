//! Portal models from files: Sweet Home 3D homes, and TOML models that refer to scene files.

mod assign;
mod homes;
mod split;
mod toml;

use crate::{Finding, PortalModel};
use headbox_core::inputs::HOMES;
use headbox_scene::load::{LoadError, LoadOptions, catch_panics, extension_of, load};
use headbox_scene::scene::Scene;
use std::path::Path;

/// Options of loading a portal model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ModelOptions {
    /// Keep the leaves that close doors and windows.
    pub keep_doors: bool,
}

/// A loaded portal model.
#[derive(Clone, Debug)]
pub struct LoadedModel {
    /// The model, repaired by [`PortalModel::repair`]. The summary of its scene has the loader's
    /// notes.
    pub model: PortalModel,
    /// Defects of cells and portals. Portals that were left out are numbered after the last portal.
    pub findings: Vec<Finding>,
}

impl LoadedModel {
    /// Repairs a model whose triangles are assigned; `found` are earlier findings.
    fn new(mut model: PortalModel, found: Vec<Finding>) -> Self {
        let joined = model.join_leaking_cells();
        let mut findings = model.repair();
        findings.extend(found.into_iter().chain(joined));
        findings.extend(model.find_coplanar());
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
    // A capture passes its frame when it opens its scene again.
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
/// The geometry is the home's OBJ export in the same folder: `home.obj`, an OBJ with the name of
/// the plan, or the only OBJ with groups of rooms or walls. Without one the geometry is built from
/// the plan and the models and images in the archive: walls with openings, floors, ceilings and
/// furniture. There corners of walls overlap, models that are not OBJ become boxes, holes of doors
/// and windows are rectangles, and staircases do not cut the floors above them; notes report this.
///
/// Each room with a ceiling becomes a cell; balconies and terraces are outside. If no room has a
/// ceiling, they were switched off to look in from above, and rooms enclosed by walls get one.
/// Hidden storeys are left out. Each door and window becomes a portal in the middle of its wall,
/// between the rooms on its two sides or a room and the outside. The space in the wall belongs to
/// the room on its side and has a threshold just below its floor, because floors drawn by hand
/// leave slits there. The border of a room without a wall is a portal, too. Leaves and panes that
/// close an opening are left out with their handles; open ones stay. Furniture belongs as a whole
/// to its cell; triangles of walls and floors belong to the cells that they face and are cut where
/// they face several; the rest is outside.
///
/// # TOML
/// ```toml
/// name = "flat"                # optional
/// up = "z"                     # "y" (default) or "z": axis of the scene file and of all coordinates below
/// unit = 0.01                  # metres to a unit; 1 if absent
/// scene = "flat.obj"           # .obj, .gltf, .glb, .ply or .stl, relative to this file
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
/// Groups without a cell are assigned as those of a home. A cell called "Outside" is added if the
/// file has no outside cell.
///
/// # Errors
/// See [`LoadError`].
pub fn load_model(path: &Path, options: &ModelOptions) -> Result<LoadedModel, LoadError> {
    catch_panics(path, || match extension_of(path).as_str() {
        "xml" | "sh3d" => homes::sweethome::load(path, options),
        "toml" => toml::load(path),
        _ => Err(LoadError::UnknownModel {
            path: path.to_path_buf(),
        }),
    })
}
