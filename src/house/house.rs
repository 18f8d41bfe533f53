//! Portal model prepared for walking: its scene in the tracer and in the rasteriser.

use super::portal_opening::Opening;
use glam::{DVec3, Vec3};
use headbox_core::environment::Environment;
use headbox_model::PortalModel;
use headbox_model::load::{ModelOptions, load_model};
use headbox_raster::RasterMesh;
use headbox_scene::load::LoadError;
use headbox_scene::scene::{Scene, SceneError};
use headbox_trace::bvh::{Hit, Ray, Tracer};
use headbox_trace::light::Lighting;
use std::path::Path;
use std::sync::Arc;

/// A portal model with its geometry as groups of triangles (one per cell), and the BVH over it.
///
/// Light is baked: the radiance of a surface is its albedo, including vertex colours, plus its
/// emission.
#[derive(Debug)]
pub struct House {
    /// Cells and portals; the scene of the model has moved to the tracer.
    plan: PortalModel,
    tracer: Tracer,
    mesh: RasterMesh,
    lighting: Lighting,
    sky: Environment,
}

/// Error of preparing a model.
#[derive(Debug, thiserror::Error)]
pub enum HouseError {
    /// The model cannot be loaded.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The scene is invalid.
    #[error("the model's scene is invalid: {0}")]
    Scene(#[from] SceneError),
    /// There is no cell.
    #[error("the model has no cells: nothing can be walked")]
    NoCells,
    /// A portal refers to a cell that does not exist, or to the same cell twice.
    #[error(
        "portal {portal} joins the cells {cells:?}; it must join two different ones of {count}"
    )]
    PortalCells {
        /// Index of the portal.
        portal: usize,
        /// Cells on both sides.
        cells: [u32; 2],
        /// Number of cells.
        count: usize,
    },
    /// A portal has fewer than three corners, no area, or a coordinate that is not finite.
    #[error("portal {0} is not a polygon with an area")]
    PortalShape(usize),
}

/// Number of triangles of `builtin:house`.
const BUILTIN_TRIANGLES: usize = 60_000;

impl House {
    /// Opens a portal model, a `.toml` file or a Sweet Home 3D home (`.sh3d`, `Home.xml`), or
    /// `builtin:house`, without baking light (see `headbox_model::bake`).
    ///
    /// # Errors
    /// [`HouseError`].
    pub fn open(name: &str) -> Result<Self, HouseError> {
        let mut model = if name == "builtin:house" {
            let mut model = headbox_scenes::house(0, BUILTIN_TRIANGLES);
            model.repair();
            model
        } else {
            load_model(Path::new(name), &ModelOptions::default())?.model
        };
        model.scene.validate()?;
        model.stitch();
        Self::new(model)
    }

    /// Prepares a model.
    ///
    /// # Errors
    /// [`HouseError`]. Other defects that the model's own checks report (non-planar portals, leaks)
    /// only cause errors in the image.
    pub fn new(mut model: PortalModel) -> Result<Self, HouseError> {
        model.scene.validate()?;
        if model.cells.is_empty() {
            return Err(HouseError::NoCells);
        }
        for (portal, p) in model.portals.iter().enumerate() {
            let count = model.cells.len();
            if p.cells[0] == p.cells[1] || p.cells.iter().any(|&cell| cell as usize >= count) {
                return Err(HouseError::PortalCells {
                    portal,
                    cells: p.cells,
                    count,
                });
            }
            if Opening::new(p, 0).is_none() {
                return Err(HouseError::PortalShape(portal));
            }
        }
        let scene = Arc::new(std::mem::take(&mut model.scene));
        let [low, high] = scene.bounds();
        let origin = (low + high) / 2.0;
        let groups: Vec<_> = model
            .cells
            .iter()
            .map(|cell| cell.triangles.clone())
            .collect();
        let mesh = RasterMesh::new(Arc::clone(&scene), &groups, origin);
        let tracer = Tracer::new(scene, origin);
        let lighting = Lighting::unmetered(&tracer, 0);
        Ok(Self {
            plan: model,
            tracer,
            mesh,
            sky: lighting.environment(),
            lighting,
        })
    }

    /// Cells and portals: the model without its scene.
    pub fn plan(&self) -> &PortalModel {
        &self.plan
    }

    /// The scene with all triangles.
    pub fn scene(&self) -> &Arc<Scene> {
        self.tracer.scene()
    }

    /// Ray tracer of the scene.
    pub fn tracer(&self) -> &Tracer {
        &self.tracer
    }

    /// Mesh for the rasteriser, with a group of triangles per cell.
    pub fn mesh(&self) -> &RasterMesh {
        &self.mesh
    }

    /// Lighting: the sky, the exposure (1, since baked colours are stored unscaled), and the tone
    /// curve of the scene, for frames, backdrops and truth alike.
    pub fn lighting(&self) -> &Lighting {
        &self.lighting
    }

    /// Environment behind all surfaces.
    pub fn sky(&self) -> &Environment {
        &self.sky
    }

    /// Shades a hit: exposed radiance, and the unit normal on the ray's side.
    pub(crate) fn surface(&self, ray: &Ray, hit: &Hit) -> (Vec3, Vec3) {
        let normal = self.scene().geometric_normal(hit.primitive);
        let radiance = self.lighting.unlit_radiance(&self.tracer, hit) * self.lighting.exposure;
        let is_back = normal.dot(ray.direction) > 0.0;
        (radiance, if is_back { -normal } else { normal })
    }

    /// Traces a ray: exposed radiance of the surface or the sky, and the distance of the hit in
    /// units of the ray's direction.
    pub(crate) fn radiance(&self, ray: &Ray) -> (Vec3, Option<f32>) {
        if let Some(hit) = self.tracer.closest(ray) {
            return (self.surface(ray, &hit).0, Some(hit.t));
        }
        let sky = self
            .lighting
            .miss_radiance(ray.direction.normalize_or_zero());
        (Vec3::from(sky) * self.lighting.exposure, None)
    }

    /// Returns the centre of a cell's space at eye height, world metres; `None` for the outside.
    pub fn cell_centre(&self, cell: u32) -> Option<DVec3> {
        let space = &self.plan.cells.get(cell as usize)?.space;
        let corners = || space.iter().flat_map(|prism| prism.outline.iter());
        let low = corners().copied().reduce(glam::DVec2::min)?;
        let high = corners().copied().reduce(glam::DVec2::max)?;
        let floor = space
            .iter()
            .map(|prism| prism.floor_y)
            .fold(f64::INFINITY, f64::min);
        let middle = (low + high) / 2.0;
        Some(DVec3::new(middle.x, floor + EYE_HEIGHT_M, middle.y))
    }

    /// Returns the cell that contains an eye position (world metres). Inside a portal, within the
    /// thickness of the wall, the portal's plane decides; elsewhere the cells' space. `None` in a
    /// wall (between the backs of two surfaces close together) or outside all cells.
    pub fn find_cell(&self, eye: DVec3) -> Option<u32> {
        let passing = (0..self.plan.portals.len()).find_map(|portal| {
            let opening = Opening::new(&self.plan.portals[portal], 0)?;
            let in_front = opening.distance_in_front(eye);
            let inside = in_front.abs() < REVEAL_M && opening.contains(eye);
            inside.then(|| self.plan.portals[portal].cells[usize::from(in_front < 0.0)])
        });
        passing.or_else(|| self.plan.cell_at(eye).filter(|_| !self.is_in_wall(eye)))
    }

    /// Returns true if a point lies inside a wall: between the backs of two surfaces at most a
    /// wall's thickness apart, or, where walls meet, with only backs in all directions, none
    /// farther than a line at that angle can run in the thickest wall. (The distance limit is for
    /// rooms whose surfaces all face outward.)
    fn is_in_wall(&self, p: DVec3) -> bool {
        let origin = (p - self.tracer.origin()).as_vec3();
        let to_back = |direction: Vec3, t_max: f32| {
            let hit = self.tracer.closest(&Ray {
                origin,
                direction,
                t_min: 0.0,
                t_max,
            })?;
            (self.scene().geometric_normal(hit.primitive).dot(direction) > 0.0).then_some(hit.t)
        };
        let between_two = [Vec3::X, Vec3::Z].into_iter().any(|axis| {
            let reach = 2.0 * REVEAL_M as f32;
            let between = to_back(axis, reach)
                .zip(to_back(-axis, reach))
                .map(|(a, b)| f64::from(a + b));
            between.is_some_and(|between| between < 2.0 * REVEAL_M)
        });
        // No direction runs along an axis-aligned wall.
        let around = [[5.0, 12.0], [12.0, 5.0], [12.0, -5.0], [5.0, -12.0]]
            .map(|[x, z]| Vec3::new(x / 13.0, 0.0, z / 13.0));
        let longest = (2.0 * REVEAL_M * 13.0 / 5.0) as f32;
        between_two
            || around
                .iter()
                .flat_map(|d| [*d, -*d])
                .all(|d| to_back(d, longest).is_some())
    }
}

/// Half thickness of the thickest wall in which an eye can be inside a portal, metres.
pub const REVEAL_M: f64 = 0.3;

pub use headbox_trace::viewpoint::EYE_HEIGHT_M;
