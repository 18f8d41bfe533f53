//! A wall of lumigraph cameras in the middle of the headbox that look ahead, and eyes around it, at
//! which lumigraphs, a cube LDI and sprites can be compared.

use super::{Contender, LumigraphDraw, Role};
use crate::plan::{Eye, EyeSet, Place, Plan};
use crate::report::subject::{ReportError, Subject};
use glam::{DVec2, DVec3};
use headbox_core::camera::{Camera, CameraError};
use headbox_core::progress::Progress;
use headbox_lumigraph::{
    CameraGrid, GridParts, Lumigraph, LumigraphCapture, LumigraphSettings, MAX_LAYERS, Placement,
    RawLumigraph, detail, middle_disparity, min_layers,
};
use headbox_trace::bvh::{Ray, Tracer};
use rayon::ThreadPool;
use std::sync::Arc;
use std::time::Instant;

/// Group of the representations at a camera wall.
pub(crate) const WALL: &str = "from a wall of cameras";
/// Group of the points of the sampling curve.
pub(crate) const CURVE: &str = "lumigraph's sampling curve (all layers)";
/// Group of the placements of layers.
const PLACEMENT: &str = "lumigraph's layers, as many as the curve asks for";

/// Vertical field of view of the images, degrees.
const IMAGE_FOV_DEG: f64 = 60.0;
/// Vertical field of view of the frames at the wall, degrees: the images contain all of them.
const FRAME_FOV_DEG: f64 = 40.0;
/// Maximum number of layers, the default of `headbox lumigraph`.
const LAYERS: usize = 255;
/// Number of cameras per row and per column, the default of `headbox lumigraph`.
const DEFAULT_CAMERAS: usize = 4;

/// A camera wall: intrinsics and orientation of its cameras, and its half-size, metres.
pub(crate) struct Wall {
    parts: GridParts,
    half_size_m: f64,
}

impl Wall {
    /// Creates the wall of a plan's headbox; `None` if no geometry is ahead.
    pub(crate) fn new(subject: &Subject, plan: &Plan) -> Option<Self> {
        let world_from_eye = CameraGrid::facing(plan.ahead, DVec3::Y)?;
        let [width, height] = plan.quality.frame_px.map(f64::from);
        let focal_px = height / 2.0 / half(FRAME_FOV_DEG).tan();
        let wider = half(IMAGE_FOV_DEG).tan() / half(FRAME_FOV_DEG).tan();
        let size_px = [width, height].map(|side| (side * wider).ceil() as u32);
        let mut parts = GridParts {
            origin: plan.centre,
            world_from_eye,
            columns: vec![0.0],
            rows: vec![0.0],
            focal_px,
            size_px,
            convergence: 0.0,
        };
        parts.convergence = middle_disparity(&subject.tracer, &parts);
        (parts.convergence > 0.0).then_some(Self {
            parts,
            half_size_m: plan.half_size_m,
        })
    }

    /// Places four eyes: between the cameras, a step in front of them, behind them, and near an
    /// edge with an oblique view; all within the field of view of the images.
    ///
    /// # Errors
    /// [`CameraError`] if the frames are empty.
    pub(crate) fn eyes(&self, tracer: &Tracer, plan: &Plan) -> Result<Vec<Eye>, CameraError> {
        let (edge, depth) = (2.0 * self.half_size_m, 1.0 / self.parts.convergence);
        // As far back as the wall is visible.
        let behind = [2.0, 1.0, 0.5, 0.25]
            .map(|share| share * edge)
            .into_iter()
            .find(|behind| self.is_visible(tracer, *behind))
            .unwrap_or(0.0);
        // Surfaces at the middle depth appear as large as from the wall, unless the wall is too
        // narrow.
        let aspect = f64::from(plan.quality.frame_px[0]) / f64::from(plan.quality.frame_px[1]);
        let through = 0.9 * self.half_size_m / (behind * aspect.max(1.0)).max(1e-9);
        let far = (half(FRAME_FOV_DEG).tan() * depth / (depth + behind)).min(through);
        let wall = half(FRAME_FOV_DEG).tan();
        let step = (0.5 * self.half_size_m).min(0.25 * depth);
        [
            (DVec3::new(0.26, 0.42, 0.0), DVec2::ZERO, wall),
            (
                DVec3::new(-0.4, 0.3, -step / self.half_size_m),
                DVec2::ZERO,
                wall,
            ),
            (
                DVec3::new(0.1, -0.1, behind / self.half_size_m),
                DVec2::ZERO,
                far,
            ),
            (DVec3::new(0.9, -0.6, 0.0), DVec2::new(-0.2, 0.1), wall),
        ]
        .into_iter()
        .map(|(at, slope, half_height)| {
            let axes = self.parts.world_from_eye;
            let offset = axes * at;
            let eye = plan.centre + offset * self.half_size_m;
            let forward = axes * slope.extend(-1.0);
            let fov_deg = 2.0 * half_height.atan().to_degrees();
            let camera = Camera::look_at(
                eye,
                eye + forward * self.half_size_m,
                axes.y_axis,
                fov_deg,
                plan.quality.frame_px,
            )?;
            Ok(Eye {
                place: Place::Wall,
                offset,
                camera,
            })
        })
        .collect()
    }

    /// Returns true if the wall's middle and corners are visible from a position `behind` it,
    /// metres.
    fn is_visible(&self, tracer: &Tracer, behind: f64) -> bool {
        let axes = self.parts.world_from_eye;
        let eye = self.parts.origin + axes.z_axis * behind;
        let corners = [
            [0.0, 0.0],
            [-1.0, -1.0],
            [1.0, -1.0],
            [-1.0, 1.0],
            [1.0, 1.0],
        ];
        corners.into_iter().all(|[x, y]| {
            let point = self.parts.origin + (axes.x_axis * x + axes.y_axis * y) * self.half_size_m;
            !tracer.occluded(&Ray {
                origin: (eye - tracer.origin()).as_vec3(),
                direction: (point - eye).as_vec3(),
                t_min: 0.0,
                t_max: 1.0,
            })
        })
    }

    /// Captures the images of `cameras` x `cameras` cameras; `None` if they see no geometry.
    fn capture(
        &self,
        subject: &Subject,
        cameras: usize,
        samples: u32,
        progress: &dyn Progress,
    ) -> Result<Option<WallImages>, ReportError> {
        let start = Instant::now();
        let positions = CameraGrid::even_positions(cameras, 2.0 * self.half_size_m);
        let grid = CameraGrid::new(GridParts {
            columns: positions.clone(),
            rows: positions,
            ..self.parts.clone()
        })?;
        let Subject {
            tracer,
            lighting,
            lit,
            ..
        } = subject;
        let raw = LumigraphCapture {
            tracer,
            lighting,
            lit: *lit,
            samples,
        }
        .run(&grid, progress)?;
        let rays = (grid.camera_count() * grid.picture_pixels()) as u64 * u64::from(samples);
        let capture_s = start.elapsed().as_secs_f64();
        Ok(raw.range().is_some().then_some(WallImages {
            raw,
            cameras,
            rays,
            capture_s,
        }))
    }

    /// Captures the lumigraphs of the scene; returns them as contenders.
    pub(crate) fn contenders(
        &self,
        subject: &Subject,
        plan: &Plan,
        pool: &Arc<ThreadPool>,
        progress: &dyn Progress,
    ) -> Result<Vec<Contender>, ReportError> {
        let quality = &plan.quality;
        let mut contenders = Vec::new();
        let has_default = quality.walls.contains(&DEFAULT_CAMERAS);
        for &cameras in quality.walls {
            let Some(images) = self.capture(subject, cameras, quality.wall_samples, progress)?
            else {
                break;
            };
            let is_default = !has_default || cameras == DEFAULT_CAMERAS;
            if is_default {
                contenders.extend(images.default_layers(pool)?);
            }
            contenders.extend(images.curve_point(pool, is_default)?);
        }
        Ok(contenders)
    }
}

/// Returns half of a field of view, radians.
fn half(fov_deg: f64) -> f64 {
    fov_deg.to_radians() / 2.0
}

/// Images of a camera wall.
struct WallImages {
    raw: RawLumigraph,
    /// Number of cameras per row and per column.
    cameras: usize,
    rays: u64,
    capture_s: f64,
}

impl WallImages {
    fn contender(
        &self,
        roles: Vec<Role>,
        lumigraph: &Arc<Lumigraph>,
        merge: bool,
        pool: &Arc<ThreadPool>,
    ) -> Contender {
        let settings = LumigraphSettings {
            merge,
            ..LumigraphSettings::default()
        };
        Contender {
            roles,
            eyes: EyeSet::Wall,
            traces: false,
            pool: Arc::clone(pool),
            bytes: lumigraph.bytes(),
            depth_pixels: 0,
            capture_s: Some(self.capture_s),
            rays: Some(self.rays),
            draw: Box::new(LumigraphDraw::new(Arc::clone(lumigraph), settings)),
        }
    }

    /// Returns the lumigraph with [`LAYERS`] layers, which a frame merges or not.
    fn default_layers(&self, pool: &Arc<ThreadPool>) -> Result<[Contender; 2], ReportError> {
        let lumigraph = Arc::new(self.raw.layered(LAYERS, Placement::Histogram)?);
        let contender = |merge, layers: &str| {
            let name = format!("lumigraph of {0}x{0} images, {layers}", self.cameras);
            self.contender(vec![Role::other(WALL, name)], &lumigraph, merge, pool)
        };
        Ok([
            contender(true, "layers merged"),
            contender(false, &format!("all {} layers", lumigraph.layers().len())),
        ])
    }

    /// Returns the number of layers that these images need on the minimum sampling curve (Eq. 7),
    /// for frames of their own focal length.
    fn curve_layers(&self) -> Option<usize> {
        let grid = self.raw.grid();
        let pixel = 1.0 / grid.focal_px();
        let layers = min_layers(
            1.0,
            self.raw.range()?,
            grid.spacing(),
            detail(pixel, pixel, None),
        );
        Some(layers.ceil().clamp(1.0, MAX_LAYERS as f64) as usize)
    }

    /// Returns the point of the sampling curve for these images, with layers placed at surfaces,
    /// and, for the default number of cameras, with layers uniform in the range, as in the paper.
    fn curve_point(
        &self,
        pool: &Arc<ThreadPool>,
        is_default: bool,
    ) -> Result<Vec<Contender>, ReportError> {
        let Some(layers) = self.curve_layers() else {
            return Ok(Vec::new());
        };
        let [placed, uniform] = [Placement::Histogram, Placement::Uniform]
            .map(|placement| self.raw.layered(layers, placement).map(Arc::new));
        let (placed, uniform) = (placed?, uniform?);
        let name = format!(
            "{0}x{0} images, {1} layers",
            self.cameras,
            placed.layers().len()
        );
        let mut roles = vec![Role::new(CURVE, name, is_default)];
        if !is_default {
            return Ok(vec![self.contender(roles, &placed, false, pool)]);
        }
        roles.push(Role::baseline(PLACEMENT, "where surfaces are"));
        let even = vec![Role::other(PLACEMENT, "equal shares of the range (paper)")];
        Ok(vec![
            self.contender(roles, &placed, false, pool),
            self.contender(even, &uniform, false, pool),
        ])
    }
}
