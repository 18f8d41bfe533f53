//! A wall of cameras in the middle of the headbox that look ahead, as a lumigraph has them, and the
//! eyes before and behind it that it is judged by: where a cube LDI and sprites have something to
//! show as well.

use super::contender::{Contender, LumigraphDraw, Role};
use super::subject::{ReportError, Subject};
use crate::plan::{Eye, EyeSet, Place, Plan};
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

/// The group of what shows a scene from outside.
pub(super) const WALL: &str = "from a wall of cameras";
/// The points of the sampling curve.
pub(super) const CURVE: &str = "lumigraph's sampling curve (all layers)";
/// Name of the placement of layers.
const PLACEMENT: &str = "lumigraph's layers, as many as the curve asks for";

/// Vertical field of view of the images, degrees.
const IMAGE_FOV_DEG: f64 = 60.0;
/// That of the eyes' frames on the wall: the images show more than any of them.
const FRAME_FOV_DEG: f64 = 40.0;
/// Layers at most, as `headbox lumigraph` has them where nothing is said.
const LAYERS: usize = 255;

/// Possible camera positions.
pub(super) struct Wall {
    parts: GridParts,
    half_size_m: f64,
}

impl Wall {
    /// The wall of a plan's headbox; `None` if nothing lies ahead.
    pub(super) fn of(subject: &Subject, plan: &Plan) -> Option<Self> {
        let world_from_eye = CameraGrid::facing(plan.ahead, DVec3::Y)?;
        let [width, height] = plan.quality.frame_px.map(f64::from);
        let focal_px = height / 2.0 / half(FRAME_FOV_DEG).tan();
        let wider = half(IMAGE_FOV_DEG).tan() / half(FRAME_FOV_DEG).tan();
        let size_px = [width, height].map(|side| (side * wider).ceil() as u32);
        let (columns, rows) = (vec![0.0], vec![0.0]);
        let mut parts = GridParts {
            origin: plan.centre,
            world_from_eye,
            columns,
            rows,
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

    /// Amid the cameras, a step before them, behind them, and beside looking across; all at what
    /// the images show.
    ///
    /// # Errors
    /// [`CameraError`] if a frame has no size.
    pub(super) fn eyes(&self, tracer: &Tracer, plan: &Plan) -> Result<Vec<Eye>, CameraError> {
        let (edge, depth) = (2.0 * self.half_size_m, 1.0 / self.parts.convergence);
        // No farther than there is a free sight of the wall.
        let behind = [2.0, 1.0, 0.5, 0.25].map(|share| share * edge);
        let behind = behind
            .into_iter()
            .find(|behind| self.is_seen(tracer, *behind))
            .unwrap_or(0.0);
        // What lies in the middle of depths looks as large as from the wall, as far as the wall is
        // wide enough.
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

    /// Returns true if nothing occludes the wall's middle and corners from a position behind it,
    /// metres.
    fn is_seen(&self, tracer: &Tracer, behind: f64) -> bool {
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
            let (origin, direction) = ((eye - tracer.origin()).as_vec3(), (point - eye).as_vec3());
            !tracer.occluded(&Ray {
                origin,
                direction,
                t_min: 0.0,
                t_max: 1.0,
            })
        })
    }

    /// Images from so many cameras in a row and in a column; `None` if they see nothing.
    fn capture(
        &self,
        subject: &Subject,
        cameras: usize,
        samples: u32,
        progress: &dyn Progress,
    ) -> Result<Option<Images>, ReportError> {
        let start = Instant::now();
        let places = CameraGrid::evenly(cameras, 2.0 * self.half_size_m);
        let grid = CameraGrid::new(GridParts {
            columns: places.clone(),
            rows: places,
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
        Ok(raw.range().is_some().then_some(Images {
            raw,
            cameras,
            rays,
            capture_s,
        }))
    }

    /// Lumigraphs of the scene, each in the groups that it stands for.
    pub(super) fn contenders(
        &self,
        subject: &Subject,
        plan: &Plan,
        pool: &Arc<ThreadPool>,
        progress: &dyn Progress,
    ) -> Result<Vec<Contender>, ReportError> {
        let mut found = Vec::new();
        let usual = plan
            .quality
            .walls
            .iter()
            .copied()
            .find(|cameras| *cameras == USUAL_CAMERAS);
        for &cameras in plan.quality.walls {
            let Some(images) =
                self.capture(subject, cameras, plan.quality.wall_samples, progress)?
            else {
                break;
            };
            let is_usual = usual.is_none_or(|usual| usual == cameras);
            if is_usual {
                found.extend(images.usual(pool)?);
            }
            found.extend(images.of_curve(pool, is_usual)?);
        }
        Ok(found)
    }
}

/// Cameras of a row and of a column, as `headbox lumigraph` has them where nothing is said.
const USUAL_CAMERAS: usize = 4;

fn half(fov_deg: f64) -> f64 {
    fov_deg.to_radians() / 2.0
}

/// Images of the cameras.
struct Images {
    raw: RawLumigraph,
    cameras: usize,
    rays: u64,
    capture_s: f64,
}

impl Images {
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

    fn name(&self, what: &str) -> String {
        format!("lumigraph of {0}x{0} images, {what}", self.cameras)
    }

    /// With as many layers as a byte tells apart, merged for each frame and not.
    fn usual(&self, pool: &Arc<ThreadPool>) -> Result<Vec<Contender>, ReportError> {
        let lumigraph = Arc::new(self.raw.layered(LAYERS, Placement::Histogram)?);
        let named = |merge, what: &str| {
            let role = Role::other(WALL, self.name(what));
            self.contender(vec![role], &lumigraph, merge, pool)
        };
        Ok(vec![
            named(true, "layers merged"),
            named(false, &format!("all {} layers", lumigraph.layers().len())),
        ])
    }

    /// Number of layers that these images need on the minimum sampling curve (Eq. 7), for frames of
    /// their own focal length.
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

    /// The point of the sampling curve that has these images, its layers put where surfaces are;
    /// and, where these are the usual ones, at equal shares of the range as the paper has it.
    fn of_curve(
        &self,
        pool: &Arc<ThreadPool>,
        is_usual: bool,
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
        let mut roles = vec![Role {
            group: CURVE,
            variant: name,
            baseline: is_usual,
        }];
        if !is_usual {
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
