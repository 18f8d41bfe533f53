//! Everything that is compared in a scene, made.

use super::captures::{Captures, DEFAULT, Made, PRIMITIVES, REPACKED};
use super::contender::{
    BakedLight, BakedRays, Contender, CubeMapDraw, ExactDraw, FragmentDraw, LdiDraw, OracleDraw,
    PathTraced, PointCloud, RasterDraw, Role, SpriteDraw, ViewDraw, WarpArithmetic, WarpOnly,
};
use super::subject::{ReportError, Subject};
use super::wall::{WALL, Wall};
use crate::cube_map::CubeMap;
use crate::plan::EyeSet;
use crate::plan::{Place, Plan};
use headbox_core::camera::Camera;
use headbox_core::progress::{Progress, Silent};
use headbox_cube::pack::{CubeLdi, ExactCube, SplatIndexLayout, Split};
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

/// The group of what clipping saves: the whole frame by one thread, as the papers warped it.
pub(super) const CLIPPING: &str = "clipping (one band, 1 thread)";

/// The group of ways in which threads share a frame.
const PARALLEL: &str = "threads share a frame by";

/// The groups of forms of depth pixels, under two footprints: with the dearer one less depends on
/// memory.
const PACKING: &str = "depth pixel";
const OPAQUE_PACKING: &str = "depth pixel, opaque rectangles";
/// The default form in both.
const PACKED: &str = "8 bytes, 11 bits of normal";

/// Name of the default capture.
pub(super) const WITH_PLANES: &str = "LDI, what is flat on planes";

/// The default capture, as far as facts need it.
pub(super) struct DefaultCapture {
    /// Cube without plane textures, to which most groups refer; or as it was given.
    pub(super) cube: Arc<CubeLdi>,
    /// With what is flat on planes, if it was made here.
    pub(super) with_planes: Option<Arc<CubeLdi>>,
}

/// The contenders of a scene as they gather.
pub(super) struct ContenderField<'a> {
    subject: &'a Subject,
    plan: &'a Plan,
    wall: Option<Wall>,
    pub(super) all: Arc<ThreadPool>,
    one: Arc<ThreadPool>,
    pub(super) contenders: Vec<Contender>,
}

impl<'a> ContenderField<'a> {
    pub(super) fn new(
        subject: &'a Subject,
        plan: &'a Plan,
        wall: Option<Wall>,
    ) -> Result<Self, ReportError> {
        let pool = |threads| {
            Ok::<_, ReportError>(Arc::new(
                ThreadPoolBuilder::new().num_threads(threads).build()?,
            ))
        };
        let (all, one) = (pool(rayon::current_num_threads())?, pool(1)?);
        Ok(Self {
            subject,
            plan,
            wall,
            all,
            one,
            contenders: Vec::new(),
        })
    }

    /// All that apply to the subject; the capture that facts are about.
    pub(super) fn add_all(
        &mut self,
        progress: &dyn Progress,
    ) -> Result<DefaultCapture, ReportError> {
        let captures = Captures {
            subject: self.subject,
            plan: self.plan,
        };
        let default = match &self.subject.cube {
            Some(cube) => {
                let cube = Arc::new(cube.clone());
                self.add_renderings(&cube, None, &[]);
                DefaultCapture {
                    cube,
                    with_planes: None,
                }
            }
            None => {
                let made = captures.make(|_| {}, progress)?;
                let cube = Arc::new(captures.pack(&made, Split::Auto)?);
                let stands_for: &[_] = if self.plan.quality.variations {
                    &DEFAULT
                } else {
                    &REPACKED
                };
                self.add_renderings(&cube, Some(made.seconds), stands_for);
                self.add_repacked(&captures, &made)?;
                let with_planes = Some(self.add_primitives(&captures, &made)?);
                if self.plan.quality.variations {
                    self.add_quantised(&made.ldi, &cube);
                    self.add_captures(&captures, &made, progress)?;
                }
                DefaultCapture { cube, with_planes }
            }
        };
        self.add_without_representation(&default.cube, progress);
        self.add_lumigraphs(&default, progress)?;
        self.add_sprites(&default.cube)?;
        self.add_view();
        Ok(default)
    }

    /// The given view under each of its variants.
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

    /// A contender that draws a packed cube.
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

    /// The default capture under every setting of the renderer; `more`: other groups for which the
    /// default stands.
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
        roles.extend(more.iter().map(|&(group, variant, baseline)| Role {
            group,
            variant: variant.into(),
            baseline,
        }));
        self.contenders
            .push(self.ldi(roles, cube, default, capture_s));
        let kernel = |kernel| RenderSettings { kernel, ..default };
        let paper = vec![
            Role::other("representation", "LDI, paper's splats"),
            Role::other("footprints", "squares of 4 integer sizes (paper)"),
        ];
        self.contenders
            .push(self.ldi(paper, cube, kernel(SplatKernel::Paper), capture_s));
        let opaque = vec![
            Role::other("representation", "LDI, opaque rectangles"),
            Role::other("footprints", "opaque rectangles of exact size"),
            Role::baseline(OPAQUE_PACKING, PACKED),
        ];
        self.contenders
            .push(self.ldi(opaque, cube, kernel(SplatKernel::Opaque), capture_s));
        for (kind, name) in [
            (
                SplatKernel::Ellipse,
                "elliptical Gaussians in floating point",
            ),
            (SplatKernel::Point, "single pixels"),
            (SplatKernel::Square3, "3x3 px, whatever their size"),
        ] {
            self.contenders.push(self.ldi(
                vec![Role::other("footprints", name)],
                cube,
                kernel(kind),
                capture_s,
            ));
        }
        for (unclipped, name) in [(false, "on"), (true, "off")] {
            // In bands, a frame without clipping would warp every depth pixel once for each.
            let band_rows = self.plan.quality.frame_px[1];
            let role = Role {
                group: CLIPPING,
                variant: name.into(),
                baseline: !unclipped,
            };
            let like = self.ldi(
                vec![role],
                cube,
                RenderSettings {
                    unclipped,
                    band_rows,
                    ..default
                },
                capture_s,
            );
            self.contenders.push(Contender {
                pool: Arc::clone(&self.one),
                ..like
            });
        }
        for (count, name) in [
            (0, "fragments along epipolar lines, one a thread"),
            (8, "eight such fragments"),
        ] {
            let like = self.ldi(vec![Role::other(PARALLEL, name)], cube, default, capture_s);
            let draw = Box::new(FragmentDraw::new(Arc::clone(cube), count));
            self.contenders.push(Contender { draw, ..like });
        }
        let one = self.ldi(
            vec![Role::baseline("threads", "1 thread")],
            cube,
            default,
            capture_s,
        );
        self.contenders.push(Contender {
            pool: Arc::clone(&self.one),
            ..one
        });
        for (stamp, name) in [(1, "points, 1 px"), (3, "points, 3x3 px")] {
            let points = PointCloud::new(cube, stamp);
            let like = self.ldi(
                vec![Role::other("representation", name)],
                cube,
                default,
                capture_s,
            );
            self.contenders.push(Contender {
                bytes: points.bytes(),
                draw: Box::new(points),
                ..like
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
            let baseline = arithmetic == WarpArithmetic::Direct;
            let role = Role {
                group: "incremental warp (single pixels, 1 thread)",
                variant: name.into(),
                baseline,
            };
            let like = self.ldi(vec![role], cube, default, capture_s);
            let draw = Box::new(WarpOnly::new(Arc::clone(cube), arithmetic));
            self.contenders.push(Contender {
                pool: Arc::clone(&self.one),
                draw,
                ..like
            });
        }
    }

    /// The default capture, packed otherwise.
    fn add_repacked(&mut self, captures: &Captures, made: &Made) -> Result<(), ReportError> {
        let whole = Arc::new(captures.pack(made, Split::None)?);
        let roles = vec![Role::other("near/far split", "none")];
        self.contenders.push(self.ldi(
            roles,
            &whole,
            RenderSettings::default(),
            Some(made.seconds),
        ));
        for (group, kernel) in [
            (PACKING, SplatKernel::Tent),
            (OPAQUE_PACKING, SplatKernel::Opaque),
        ] {
            let exact = ExactCube::pack(&made.ldi, SplatIndexLayout::Normal, Split::Auto)?;
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
            let like = self.ldi(
                vec![Role::other(group, "24 bytes, nothing quantised")],
                &whole,
                settings,
                None,
            );
            let bytes = (exact.cube.bytes() - packed_bytes + exact.depth_pixel_bytes()) as u64;
            let draw = Box::new(ExactDraw::new(exact, settings));
            self.contenders.push(Contender {
                bytes,
                capture_s: Some(made.seconds),
                draw,
                ..like
            });
        }
        let paper = CubeLdi::pack(&made.ldi, SplatIndexLayout::Paper, Split::Auto)?;
        let roles = vec![
            Role::other(
                "normal in the splat index",
                "6 bits, and 5 of depth (paper)",
            ),
            Role::other(PACKING, "8 bytes, 6 bits of normal and 5 of depth (paper)"),
        ];
        self.contenders.push(self.ldi(
            roles,
            &Arc::new(paper),
            RenderSettings::default(),
            Some(made.seconds),
        ));
        Ok(())
    }

    /// The default capture with what is flat as pictures on planes, within several bounds; that of
    /// the default bound.
    fn add_primitives(
        &mut self,
        captures: &Captures,
        made: &Made,
    ) -> Result<Arc<CubeLdi>, ReportError> {
        let default = captures.pack_planes(made, DEFAULT_ERROR_PX)?;
        let within =
            |error_px: f64| Role::other(PRIMITIVES, format!("planes within {error_px} px"));
        let roles = vec![
            Role::other("representation", WITH_PLANES),
            within(DEFAULT_ERROR_PX),
        ];
        self.contenders.push(self.ldi(
            roles,
            &default,
            RenderSettings::default(),
            Some(made.seconds),
        ));
        for error_px in [0.25, 1.0, 2.0] {
            let cube = captures.pack_planes(made, error_px)?;
            let settings = RenderSettings::default();
            self.contenders.push(self.ldi(
                vec![within(error_px)],
                &cube,
                settings,
                Some(made.seconds),
            ));
        }
        Ok(default)
    }

    /// Adds rows that measure the cost of quantisation, one quantity at a time, with the renderer
    /// that needs none.
    fn add_quantised(
        &mut self,
        ldi: &headbox_cube::model::samples::CubeSamples,
        cube: &Arc<CubeLdi>,
    ) {
        for (variant, baseline, edited) in super::captures::quantised(ldi, cube) {
            let like = self.ldi(vec![], cube, RenderSettings::default(), None);
            self.contenders.push(Contender {
                roles: vec![Role {
                    group: "quantisation (direct warp in f64)",
                    variant: variant.into(),
                    baseline,
                }],
                eyes: EyeSet::Ahead,
                pool: Arc::clone(&self.one),
                draw: Box::new(OracleDraw::new(edited)),
                ..like
            });
        }
    }

    /// Other captures of the scene.
    fn add_captures(
        &mut self,
        captures: &Captures,
        default: &Made,
        progress: &dyn Progress,
    ) -> Result<(), ReportError> {
        for (roles, made) in captures.variations(default, progress)? {
            let cube = Arc::new(captures.pack(&made, Split::Auto)?);
            self.contenders.push(self.ldi(
                roles,
                &cube,
                RenderSettings::default(),
                Some(made.seconds),
            ));
        }
        Ok(())
    }

    fn cameras(&self, set: EyeSet) -> Vec<Camera> {
        self.plan
            .eyes
            .iter()
            .filter(|eye| eye.belongs_to(set) || eye.place == Place::Path)
            .map(|e| e.camera)
            .collect()
    }

    /// Adds alternatives without a representation.
    fn add_without_representation(&mut self, cube: &Arc<CubeLdi>, progress: &dyn Progress) {
        let quality = self.plan.quality;
        let (tracer, lighting) = (&self.subject.tracer, &self.subject.lighting);
        let like = |name: &str| Contender {
            roles: vec![Role::other("representation", name)],
            eyes: EyeSet::All,
            traces: false,
            pool: Arc::clone(&self.all),
            bytes: tracer.scene().bytes(),
            depth_pixels: 0,
            capture_s: None,
            rays: None,
            draw: Box::new(PathTraced::new(
                Arc::clone(tracer),
                lighting.clone(),
                self.subject.lit,
                2,
            )),
        };
        let path_traced = |samples| Contender {
            traces: true,
            draw: Box::new(PathTraced::new(
                Arc::clone(tracer),
                lighting.clone(),
                self.subject.lit,
                samples,
            )),
            ..like(&format!("path tracing, {samples} rays/px"))
        };
        let mut found = vec![path_traced(2)];
        if quality.variations {
            found.push(path_traced(8));
        }
        let cameras = self.cameras(EyeSet::All);
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
        let capture_s = Some(start.elapsed().as_secs_f64());
        let bytes = map.bytes();
        found.push(Contender {
            bytes,
            capture_s,
            draw: Box::new(CubeMapDraw::new(Arc::new(map))),
            ..like("cube map")
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
            found.push(Contender {
                traces: true,
                bytes,
                capture_s,
                draw: rays,
                ..like("1 ray/px, baked light")
            });
            let raster = Box::new(RasterDraw::new(baked));
            found.push(Contender {
                traces: true,
                bytes,
                capture_s,
                draw: raster,
                ..like("rasterised, baked light")
            });
        }
        self.contenders.extend(found);
    }

    /// Lumigraphs of a wall of cameras, beside the LDI.
    fn add_lumigraphs(
        &mut self,
        default: &DefaultCapture,
        progress: &dyn Progress,
    ) -> Result<(), ReportError> {
        let Some(wall) = &self.wall else {
            return Ok(());
        };
        let lumigraphs = wall.contenders(self.subject, self.plan, &self.all, progress)?;
        let of_wall = |role, cube| Contender {
            eyes: EyeSet::Wall,
            ..self.ldi(vec![role], cube, RenderSettings::default(), None)
        };
        let samples = of_wall(Role::baseline(WALL, "LDI"), &default.cube);
        let planes = default
            .with_planes
            .as_ref()
            .map(|cube| of_wall(Role::other(WALL, WITH_PLANES), cube));
        self.contenders
            .extend([samples].into_iter().chain(planes).chain(lumigraphs));
        Ok(())
    }

    /// Sprites that look ahead, by the paper's variants.
    fn add_sprites(&mut self, cube: &Arc<CubeLdi>) -> Result<(), ReportError> {
        let start = Instant::now();
        let given = self.subject.sprites.as_ref();
        let Some(floats) = (match given {
            Some(set) => Some(set.clone()),
            None => self.capture_sprites()?,
        }) else {
            return Ok(());
        };
        let capture_s = given.is_none().then(|| start.elapsed().as_secs_f64());
        if floats.sprites().is_empty() {
            return Ok(());
        }
        let layers = |set: SpriteSet| (set.bytes(), Arc::new(Composition::new(set, Vec::new())));
        // Sprites that are given stay as they are.
        let stored = |format| {
            if given.is_some() {
                Ok(floats.clone())
            } else {
                stored_as(&floats, format)
            }
        };
        let default = layers(stored(DisplacementFormat::I8)?);
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
        let mut found = Vec::new();
        if self.wall.is_some() {
            let role = Role::other(WALL, format!("sprites, {}", SpriteVariant::TwoPass.name()));
            found.push(Contender {
                eyes: EyeSet::Wall,
                ..contender(vec![role], &default, options)
            });
        }
        for variant in [
            SpriteVariant::TwoPass,
            SpriteVariant::OnePass,
            SpriteVariant::Homography,
            SpriteVariant::ShiftField,
            SpriteVariant::AsPrinted,
        ] {
            let mut roles = vec![Role {
                group: "sprites",
                variant: variant.name().into(),
                baseline: false,
            }];
            if variant == SpriteVariant::TwoPass {
                roles.push(Role::baseline("sprite displacement", "8 bits"));
                roles.push(Role::baseline("sprite gap filling", "3 steps"));
                roles.push(Role::baseline("sprite sampling", "bilinear"));
            }
            found.push(contender(
                roles,
                &default,
                RenderOptions { variant, ..options },
            ));
        }
        for variant in [
            SpriteVariant::Homography,
            SpriteVariant::OnePass,
            SpriteVariant::TwoPass,
        ] {
            let baseline = variant == SpriteVariant::Homography;
            let mut roles = vec![Role {
                group: "sprites, nearest sampling",
                variant: variant.name().into(),
                baseline,
            }];
            if variant == SpriteVariant::TwoPass {
                roles.push(Role::other("sprite sampling", "nearest"));
            }
            found.push(contender(
                roles,
                &default,
                RenderOptions {
                    variant,
                    sampling: SpriteSampling::Nearest,
                    ..options
                },
            ));
        }
        for steps in [0, 1, 8] {
            let role = Role::other(
                "sprite gap filling",
                format!("{steps} step{}", if steps == 1 { "" } else { "s" }),
            );
            found.push(contender(
                vec![role],
                &default,
                RenderOptions {
                    fill_steps: steps,
                    ..options
                },
            ));
        }
        for (format, name) in [
            (DisplacementFormat::I16, "16 bits"),
            (DisplacementFormat::F32, "32-bit float"),
        ] {
            if given.is_none() {
                let layers = layers(stored(format)?);
                found.push(contender(
                    vec![Role::other("sprite displacement", name)],
                    &layers,
                    options,
                ));
            }
        }
        let ldi = self.ldi(
            vec![Role::baseline("sprites", "LDI")],
            cube,
            RenderSettings::default(),
            None,
        );
        self.contenders.push(ldi);
        self.contenders.extend(found);
        Ok(())
    }

    /// Sprites as seen from the centre, ahead, wider than the frames.
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
        let taken = Camera::from_parts(
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
        let (samples, format) = (self.plan.quality.baked_samples, DisplacementFormat::F32);
        let capture = SlabCapture {
            tracer,
            lighting,
            lit: *lit,
            samples,
            format,
        };
        let slabs = slabs_at_gaps(tracer, &taken, LAYERS);
        let mut set = SpriteSet::new(capture_slabs(&capture, &taken, &slabs, &Silent)?);
        if lighting.sky.is_some() {
            set.environment = lighting.environment_where(128, |_| true);
        }
        Ok(Some(set))
    }
}

/// The same sprites, their displacements stored otherwise.
fn stored_as(set: &SpriteSet, format: DisplacementFormat) -> Result<SpriteSet, ReportError> {
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
