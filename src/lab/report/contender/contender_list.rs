//! Creation of all contenders of a scene.

use super::wall::{WALL, Wall};
use super::{
    BakedLight, BakedRays, Contender, CubeMapDraw, Draw, ExactDraw, FragmentDraw, LdiDraw,
    OracleDraw, PathTraced, PointCloud, RasterDraw, Role, SpriteDraw, ViewDraw, WarpArithmetic,
    WarpOnly,
};
use crate::cube_map::CubeMap;
use crate::plan::{EyeSet, Place, Plan};
use crate::report::captures::{
    Captures, DEFAULT, PRIMITIVES, REPACKED, TimedCapture, pack, pack_planes, quantised,
};
use crate::report::subject::{ReportError, Subject};
use headbox_core::camera::Camera;
use headbox_core::progress::{Progress, Silent};
use headbox_cube::model::samples::CubeSamples;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split, UnquantisedCube};
use headbox_cube::planes::DEFAULT_ERROR_PX;
use headbox_cube::render::RenderSettings;
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_sprite::compose::Composition;
use headbox_sprite::{
    Displacement, DisplacementFormat, PreparedSprite, RenderOptions, SlabCapture, SpriteSampling,
    SpriteSet, SpriteVariant, SpriteWithDepth, capture_slabs, slabs_at_gaps,
};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::{Arc, PoisonError};
use std::time::Instant;

/// Group of clipping: the whole frame is warped by one thread, as in the papers.
pub(crate) const CLIPPING: &str = "clipping (one band, 1 thread)";

/// Group of the sprite variants with nearest sampling.
pub(crate) const NEAREST_SPRITES: &str = "sprites, nearest sampling";

/// Group of the divisions of a frame among threads.
const PARALLEL: &str = "threads share a frame by";

/// Group of the formats of depth pixels.
const PACKING: &str = "depth pixel";
/// Group of the formats of depth pixels with a cheaper footprint, where memory matters more.
pub(crate) const OPAQUE_PACKING: &str = "depth pixel, opaque rectangles";
/// Name of the default format of depth pixels.
const PACKED: &str = "8 bytes, 11 bits of normal";

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
    subject: &'a Subject,
    plan: &'a Plan,
    wall: Option<Wall>,
    pub(crate) all: Arc<ThreadPool>,
    one: Arc<ThreadPool>,
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

    /// Adds a packed cube with the default settings of the renderer.
    fn add_ldi(&mut self, roles: Vec<Role>, cube: &Arc<CubeLdi>, capture_s: Option<f64>) {
        let contender = self.ldi(roles, cube, RenderSettings::default(), capture_s);
        self.contenders.push(contender);
    }

    /// Returns a contender that draws a packed cube.
    fn ldi(
        &self,
        roles: Vec<Role>,
        cube: &Arc<CubeLdi>,
        settings: RenderSettings,
        capture_s: Option<f64>,
    ) -> Contender {
        Contender {
            roles,
            eyes: EyeSet::All,
            traces: false,
            pool: Arc::clone(&self.all),
            bytes: cube.bytes() as u64,
            depth_pixels: cube.depth_pixel_count() as u64,
            capture_s,
            rays: Some(cube.info.rays_traced),
            draw: Box::new(LdiDraw::new(Arc::clone(cube), settings)),
        }
    }

    /// Adds the default capture under every setting of the renderer; `more`: further roles of the
    /// default settings.
    fn add_renderings(
        &mut self,
        cube: &Arc<CubeLdi>,
        capture_s: Option<f64>,
        more: &[(&'static str, &str, bool)],
    ) {
        let default = RenderSettings::default();
        let mut roles = vec![
            Role::baseline("representation", "LDI"),
            Role::baseline("footprints", "tents, averaged per surface"),
            Role::other(
                "threads",
                format!("{} threads", self.all.current_num_threads()),
            ),
            Role::baseline(PARALLEL, "bands of rows"),
            Role::baseline(PACKING, PACKED),
        ];
        roles.extend(
            more.iter()
                .map(|&(group, variant, baseline)| Role::new(group, variant, baseline)),
        );
        self.add_ldi(roles, cube, capture_s);
        let footprint = |name| Role::other("footprints", name);
        for (kernel, roles) in [
            (
                SplatKernel::Paper,
                vec![
                    Role::other("representation", "LDI, paper's splats"),
                    footprint("squares of 4 integer sizes (paper)"),
                ],
            ),
            (
                SplatKernel::Opaque,
                vec![
                    Role::other("representation", "LDI, opaque rectangles"),
                    footprint("opaque rectangles of exact size"),
                    Role::baseline(OPAQUE_PACKING, PACKED),
                ],
            ),
            (
                SplatKernel::Ellipse,
                vec![footprint("elliptical Gaussians in floating point")],
            ),
            (SplatKernel::Point, vec![footprint("single pixels")]),
            (
                SplatKernel::Square3,
                vec![footprint("3x3 px, whatever their size")],
            ),
        ] {
            let settings = RenderSettings { kernel, ..default };
            let contender = self.ldi(roles, cube, settings, capture_s);
            self.contenders.push(contender);
        }
        for (unclipped, name) in [(false, "on"), (true, "off")] {
            let settings = RenderSettings {
                unclipped,
                // One band: without clipping, each band would warp every depth pixel.
                band_rows: self.plan.quality.frame_px[1],
                ..default
            };
            let role = Role::new(CLIPPING, name, !unclipped);
            self.contenders.push(Contender {
                pool: Arc::clone(&self.one),
                ..self.ldi(vec![role], cube, settings, capture_s)
            });
        }
        for (count, name) in [
            (0, "fragments along epipolar lines, one a thread"),
            (8, "eight such fragments"),
        ] {
            let role = Role::other(PARALLEL, name);
            self.contenders.push(Contender {
                draw: Box::new(FragmentDraw::new(Arc::clone(cube), count)),
                ..self.ldi(vec![role], cube, default, capture_s)
            });
        }
        let role = Role::baseline("threads", "1 thread");
        self.contenders.push(Contender {
            pool: Arc::clone(&self.one),
            ..self.ldi(vec![role], cube, default, capture_s)
        });
        for (stamp, name) in [(1, "points, 1 px"), (3, "points, 3x3 px")] {
            let points = PointCloud::new(cube, stamp);
            let role = Role::other("representation", name);
            self.contenders.push(Contender {
                bytes: points.bytes(),
                draw: Box::new(points),
                ..self.ldi(vec![role], cube, default, capture_s)
            });
        }
        for (arithmetic, name) in [
            (WarpArithmetic::Direct, "direct, in f64"),
            (
                WarpArithmetic::RunningSum,
                "a running sum along each row, in f32 (paper)",
            ),
            (
                WarpArithmetic::Anchored,
                "from an anchor every 64 columns, in f32",
            ),
        ] {
            let group = "incremental warp (single pixels, 1 thread)";
            let role = Role::new(group, name, arithmetic == WarpArithmetic::Direct);
            self.contenders.push(Contender {
                pool: Arc::clone(&self.one),
                draw: Box::new(WarpOnly::new(Arc::clone(cube), arithmetic)),
                ..self.ldi(vec![role], cube, default, capture_s)
            });
        }
    }

    /// Adds the default capture packed with other settings.
    fn add_repacked(&mut self, capture: &TimedCapture) -> Result<(), ReportError> {
        let capture_s = Some(capture.seconds);
        let unsplit = pack(&capture.ldi, Split::None)?;
        let roles = vec![Role::other("near/far split", "none")];
        self.add_ldi(roles, &unsplit, capture_s);
        for (group, kernel) in [
            (PACKING, SplatKernel::Tent),
            (OPAQUE_PACKING, SplatKernel::Opaque),
        ] {
            let exact = UnquantisedCube::pack(&capture.ldi, SplatIndexLayout::Normal, Split::Auto)?;
            let settings = RenderSettings {
                kernel,
                ..RenderSettings::default()
            };
            let packed_bytes: usize = exact
                .cube
                .segments
                .iter()
                .map(|s| size_of_val(&s.depth_pixels[..]))
                .sum();
            let role = Role::other(group, "24 bytes, nothing quantised");
            self.contenders.push(Contender {
                bytes: (exact.cube.bytes() - packed_bytes + exact.depth_pixel_bytes()) as u64,
                draw: Box::new(ExactDraw::new(exact, settings)),
                ..self.ldi(vec![role], &unsplit, settings, capture_s)
            });
        }
        let paper = CubeLdi::pack(&capture.ldi, SplatIndexLayout::Paper, Split::Auto)?;
        let roles = vec![
            Role::other(
                "normal in the splat index",
                "6 bits, and 5 of depth (paper)",
            ),
            Role::other(PACKING, "8 bytes, 6 bits of normal and 5 of depth (paper)"),
        ];
        self.add_ldi(roles, &Arc::new(paper), capture_s);
        Ok(())
    }

    /// Adds the default capture with plane textures within several error bounds; returns that of
    /// the default bound.
    fn add_primitives(&mut self, capture: &TimedCapture) -> Result<Arc<CubeLdi>, ReportError> {
        let default = pack_planes(&capture.ldi, DEFAULT_ERROR_PX)?;
        let within =
            |error_px: f64| Role::other(PRIMITIVES, format!("planes within {error_px} px"));
        let roles = vec![
            Role::other("representation", WITH_PLANES),
            within(DEFAULT_ERROR_PX),
        ];
        self.add_ldi(roles, &default, Some(capture.seconds));
        for error_px in [0.25, 1.0, 2.0] {
            let cube = pack_planes(&capture.ldi, error_px)?;
            self.add_ldi(vec![within(error_px)], &cube, Some(capture.seconds));
        }
        Ok(default)
    }

    /// Adds contenders that measure the cost of quantisation, one quantity at a time, with the
    /// reference renderer, which quantises nothing.
    fn add_quantised(&mut self, ldi: &CubeSamples, cube: &Arc<CubeLdi>) {
        for (variant, baseline, edited) in quantised(ldi, cube) {
            let role = Role::new("quantisation (direct warp in f64)", variant, baseline);
            self.contenders.push(Contender {
                eyes: EyeSet::Ahead,
                pool: Arc::clone(&self.one),
                draw: Box::new(OracleDraw::new(edited)),
                ..self.ldi(vec![role], cube, RenderSettings::default(), None)
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

    /// Adds sprites with depth in the paper's variants.
    fn add_sprites(&mut self, cube: &Arc<CubeLdi>) -> Result<(), ReportError> {
        let start = Instant::now();
        let given = self.subject.sprites.as_ref();
        let Some(sprites) = (match given {
            Some(set) => Some(set.clone()),
            None => self.capture_sprites()?,
        }) else {
            return Ok(());
        };
        let capture_s = given.is_none().then(|| start.elapsed().as_secs_f64());
        if sprites.sprites().is_empty() {
            return Ok(());
        }
        let layers = |set: SpriteSet| (set.bytes(), Arc::new(Composition::new(set, Vec::new())));
        // Given sprites keep their format.
        let default = layers(if given.is_some() {
            sprites.clone()
        } else {
            converted(&sprites, DisplacementFormat::I8)?
        });
        let contender = |roles: Vec<Role>,
                         (bytes, layers): &(u64, Arc<Composition>),
                         options: RenderOptions| Contender {
            roles,
            eyes: EyeSet::Ahead,
            traces: false,
            pool: Arc::clone(&self.all),
            bytes: *bytes,
            depth_pixels: 0,
            capture_s,
            rays: None,
            draw: Box::new(SpriteDraw::new(Arc::clone(layers), options)),
        };
        let options = RenderOptions::default();
        let mut contenders = Vec::new();
        if self.wall.is_some() {
            let role = Role::other(WALL, format!("sprites, {}", SpriteVariant::TwoPass.name()));
            contenders.push(Contender {
                eyes: EyeSet::Wall,
                ..contender(vec![role], &default, options)
            });
        }
        let mut add = |roles, options| contenders.push(contender(roles, &default, options));
        for variant in [
            SpriteVariant::TwoPass,
            SpriteVariant::OnePass,
            SpriteVariant::Homography,
            SpriteVariant::ShiftField,
            SpriteVariant::AsPrinted,
        ] {
            let mut roles = vec![Role::other("sprites", variant.name())];
            if variant == SpriteVariant::TwoPass {
                roles.push(Role::baseline("sprite displacement", "8 bits"));
                roles.push(Role::baseline("sprite gap filling", "3 steps"));
                roles.push(Role::baseline("sprite sampling", "bilinear"));
            }
            add(roles, RenderOptions { variant, ..options });
        }
        for variant in [
            SpriteVariant::Homography,
            SpriteVariant::OnePass,
            SpriteVariant::TwoPass,
        ] {
            let is_baseline = variant == SpriteVariant::Homography;
            let mut roles = vec![Role::new(NEAREST_SPRITES, variant.name(), is_baseline)];
            if variant == SpriteVariant::TwoPass {
                roles.push(Role::other("sprite sampling", "nearest"));
            }
            let options = RenderOptions {
                variant,
                sampling: SpriteSampling::Nearest,
                ..options
            };
            add(roles, options);
        }
        for (fill_steps, name) in [(0, "0 steps"), (1, "1 step"), (8, "8 steps")] {
            let options = RenderOptions {
                fill_steps,
                ..options
            };
            add(vec![Role::other("sprite gap filling", name)], options);
        }
        if given.is_none() {
            for (format, name) in [
                (DisplacementFormat::I16, "16 bits"),
                (DisplacementFormat::F32, "32-bit float"),
            ] {
                let role = Role::other("sprite displacement", name);
                let layers = layers(converted(&sprites, format)?);
                contenders.push(contender(vec![role], &layers, options));
            }
        }
        self.add_ldi(vec![Role::baseline("sprites", "LDI")], cube, None);
        self.contenders.extend(contenders);
        Ok(())
    }

    /// Captures sprites from the centre, looking ahead, with a wider view than the frames.
    fn capture_sprites(&self) -> Result<Option<SpriteSet>, ReportError> {
        const MARGIN: f64 = 1.5;
        const LAYERS: usize = 4;
        let Some(first) = self
            .plan
            .eyes
            .iter()
            .find(|eye| eye.place == Place::Line(0.0))
        else {
            return Ok(None);
        };
        let camera = &first.camera;
        let [width, height] =
            [camera.width(), camera.height()].map(|side| (f64::from(side) * MARGIN) as u32);
        let wider = Camera::from_parts(
            camera.eye(),
            camera.world_from_eye(),
            camera.focal_px(),
            width,
            height,
        )?;
        let Subject {
            tracer,
            lighting,
            lit,
            ..
        } = self.subject;
        let capture = SlabCapture {
            tracer,
            lighting,
            lit: *lit,
            samples: self.plan.quality.baked_samples,
            format: DisplacementFormat::F32,
        };
        let slabs = slabs_at_gaps(tracer, &wider, LAYERS);
        let mut set = SpriteSet::new(capture_slabs(&capture, &wider, &slabs, &Silent)?);
        if lighting.sky.is_some() {
            set.environment = lighting.environment_where(128, |_| true);
        }
        Ok(Some(set))
    }
}

/// Returns the sprites with their displacements in another format.
fn converted(set: &SpriteSet, format: DisplacementFormat) -> Result<SpriteSet, ReportError> {
    let convert = |prepared: &PreparedSprite| {
        let (sprite, d) = (prepared.sprite().sprite(), prepared.sprite().displacement());
        let (width, height) = d.size();
        let values: Vec<f32> = (0..height)
            .flat_map(|y| (0..width).map(move |x| d.at(x, y)))
            .collect();
        SpriteWithDepth::new(
            sprite.clone(),
            Displacement::new(width, height, &values, format)?,
        )
    };
    let mut converted = SpriteSet::new(
        set.sprites()
            .iter()
            .map(convert)
            .collect::<Result<_, _>>()?,
    );
    converted.environment = set.environment.clone();
    Ok(converted)
}
