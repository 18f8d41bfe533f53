//! Creation of all contenders of a scene.

use super::wall::{WALL, Wall};
use super::{
    BakedLight, BakedRays, Contender, CubeMapDraw, Draw, PathTraced, RasterDraw, Role, ViewDraw,
};
use crate::cube_map::CubeMap;
use crate::plan::{EyeSet, Place, Plan};
use crate::report::captures::{Captures, DEFAULT, REPACKED, pack};
use crate::report::subject::{ReportError, Subject};
use headbox_core::camera::Camera;
use headbox_core::progress::Progress;
use headbox_cube::pack::{CubeLdi, Split};
use headbox_cube::render::RenderSettings;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::{Arc, PoisonError};
use std::time::Instant;

/// Group of clipping: the whole frame is warped by one thread, as in the papers.
pub(crate) const CLIPPING: &str = "clipping (one band, 1 thread)";

/// Group of the sprite variants with nearest sampling.
pub(crate) const NEAREST_SPRITES: &str = "sprites, nearest sampling";

/// Group of the formats of depth pixels with a cheaper footprint, where memory matters more.
pub(crate) const OPAQUE_PACKING: &str = "depth pixel, opaque rectangles";

/// Name of the default capture with plane textures.
pub(super) const WITH_PLANES: &str = "LDI, what is flat on planes";

/// The packed default capture.
pub(crate) struct DefaultCapture {
    /// Cube without plane textures, used by most groups; or the given cube.
    pub(crate) cube: Arc<CubeLdi>,
    /// Cube with plane textures, `None` for a given cube.
    pub(crate) with_planes: Option<Arc<CubeLdi>>,
}

/// List of the contenders of a scene.
pub(crate) struct ContenderList<'a> {
    pub(super) subject: &'a Subject,
    pub(super) plan: &'a Plan,
    pub(super) wall: Option<Wall>,
    pub(crate) all: Arc<ThreadPool>,
    pub(super) one: Arc<ThreadPool>,
    pub(crate) contenders: Vec<Contender>,
}

impl<'a> ContenderList<'a> {
    pub(crate) fn new(
        subject: &'a Subject,
        plan: &'a Plan,
        wall: Option<Wall>,
    ) -> Result<Self, ReportError> {
        let pool = |threads| ThreadPoolBuilder::new().num_threads(threads).build();
        Ok(Self {
            subject,
            plan,
            wall,
            all: Arc::new(pool(rayon::current_num_threads())?),
            one: Arc::new(pool(1)?),
            contenders: Vec::new(),
        })
    }

    /// Adds all contenders that apply to the subject; returns the default capture.
    pub(crate) fn add_all(
        &mut self,
        progress: &dyn Progress,
    ) -> Result<DefaultCapture, ReportError> {
        let default = if let Some(cube) = &self.subject.cube {
            let cube = Arc::new(cube.clone());
            self.add_renderings(&cube, None, &[]);
            DefaultCapture {
                cube,
                with_planes: None,
            }
        } else {
            let captures = Captures {
                subject: self.subject,
                plan: self.plan,
            };
            let capture = captures.capture(|_| {}, progress)?;
            let cube = pack(&capture.ldi, Split::Auto)?;
            let roles: &[_] = if self.plan.quality.variations {
                &DEFAULT
            } else {
                &REPACKED
            };
            self.add_renderings(&cube, Some(capture.seconds), roles);
            self.add_repacked(&capture)?;
            let with_planes = Some(self.add_primitives(&capture)?);
            if self.plan.quality.variations {
                self.add_quantised(&capture.ldi, &cube);
                for (roles, variation) in captures.variations(&capture, progress)? {
                    let cube = pack(&variation.ldi, Split::Auto)?;
                    self.add_ldi(roles, &cube, Some(variation.seconds));
                }
            }
            DefaultCapture { cube, with_planes }
        };
        self.add_without_representation(&default.cube, progress);
        self.add_lumigraphs(&default, progress)?;
        self.add_sprites(&default.cube)?;
        self.add_view();
        Ok(default)
    }

    /// Adds the given view under each of its variants.
    fn add_view(&mut self) {
        let Some(view) = &self.subject.view else {
            return;
        };
        let (kind, bytes) = {
            let view = view.lock().unwrap_or_else(PoisonError::into_inner);
            (view.kind(), view.bytes())
        };
        for (variant, draw) in ViewDraw::variants(view) {
            let name = if variant.is_empty() {
                kind.to_owned()
            } else {
                format!("{kind}, {variant}")
            };
            self.contenders.push(Contender {
                roles: vec![Role::other("representation", name)],
                eyes: EyeSet::All,
                traces: false,
                pool: Arc::clone(&self.all),
                bytes,
                depth_pixels: 0,
                capture_s: None,
                rays: None,
                draw: Box::new(draw),
            });
        }
    }

    /// Adds alternatives that draw the scene itself, or a cube map.
    fn add_without_representation(&mut self, cube: &Arc<CubeLdi>, progress: &dyn Progress) {
        let quality = self.plan.quality;
        let (tracer, lighting) = (&self.subject.tracer, &self.subject.lighting);
        let all = Arc::clone(&self.all);
        let contender = |name: String, draw: Box<dyn Draw + Send>| Contender {
            roles: vec![Role::other("representation", name)],
            eyes: EyeSet::All,
            traces: true,
            pool: Arc::clone(&all),
            bytes: tracer.scene().bytes(),
            depth_pixels: 0,
            capture_s: None,
            rays: None,
            draw,
        };
        let path_samples: &[u32] = if quality.variations { &[2, 8] } else { &[2] };
        for &samples in path_samples {
            let (tracer, lit) = (Arc::clone(tracer), self.subject.lit);
            self.contenders.push(contender(
                format!("path tracing, {samples} rays/px"),
                Box::new(PathTraced::new(tracer, lighting.clone(), lit, samples)),
            ));
        }
        let eyes = self.plan.eyes.iter();
        let cameras: Vec<Camera> = eyes
            .filter(|eye| eye.belongs_to(EyeSet::All) || eye.place == Place::Path)
            .map(|eye| eye.camera)
            .collect();
        let (face_px, samples) = (cube.face_size_px, quality.baked_samples);
        let start = Instant::now();
        let map = CubeMap::trace_for(
            tracer,
            lighting,
            self.plan.centre,
            &cameras,
            face_px,
            samples,
            progress,
        );
        self.contenders.push(Contender {
            traces: false,
            bytes: map.bytes(),
            capture_s: Some(start.elapsed().as_secs_f64()),
            ..contender("cube map".into(), Box::new(CubeMapDraw::new(Arc::new(map))))
        });
        if self.subject.lit {
            let start = Instant::now();
            let mut baked = BakedLight::new(Arc::clone(tracer), lighting.clone(), face_px, samples);
            cameras.iter().for_each(|camera| baked.bake_view(camera));
            let capture_s = Some(start.elapsed().as_secs_f64());
            RasterDraw::bake_views(&mut baked, &cameras);
            let bytes = tracer.scene().bytes() + baked.bytes();
            let baked = Arc::new(baked);
            let rays = Box::new(BakedRays::new(Arc::clone(&baked)));
            self.contenders.push(Contender {
                bytes,
                capture_s,
                ..contender("1 ray/px, baked light".into(), rays)
            });
            self.contenders.push(Contender {
                bytes,
                capture_s,
                ..contender(
                    "rasterised, baked light".into(),
                    Box::new(RasterDraw::new(baked)),
                )
            });
        }
    }

    /// Adds lumigraphs of a camera wall, and the LDI for comparison.
    fn add_lumigraphs(
        &mut self,
        default: &DefaultCapture,
        progress: &dyn Progress,
    ) -> Result<(), ReportError> {
        let Some(wall) = &self.wall else {
            return Ok(());
        };
        let lumigraphs = wall.contenders(self.subject, self.plan, &self.all, progress)?;
        let at_wall = |role, cube| Contender {
            eyes: EyeSet::Wall,
            ..self.ldi(vec![role], cube, RenderSettings::default(), None)
        };
        let samples = at_wall(Role::baseline(WALL, "LDI"), &default.cube);
        let planes = default
            .with_planes
            .as_ref()
            .map(|cube| at_wall(Role::other(WALL, WITH_PLANES), cube));
        self.contenders.push(samples);
        self.contenders.extend(planes);
        self.contenders.extend(lumigraphs);
        Ok(())
    }
}
