//! Captures in one call: of a cube LDI, and of sprites.

use crate::{CubeLdi, Error, Scene};
use glam::DVec3;
use headbox_core::bounces::Bounces;
use headbox_core::camera::Camera;
use headbox_core::headbox::Headbox;
use headbox_core::progress::{Progress, Silent};
use headbox_cube::model::parameters::CaptureParameters;
use headbox_cube::pack::{SplatIndexLayout, Split};
use headbox_cube::planes::{self, DEFAULT_ERROR_PX, MAX_ERROR_PX};
use headbox_ldi::capture::SceneCapture;
use headbox_ldi::face_size::choose_face_size;
use headbox_ldi::spec::{CaptureSpec, RangeError, RunOptions};
use headbox_sprite::{
    DisplacementFormat, SlabCapture, SpriteInfo, SpriteSet, capture_slabs, slabs_at_gaps,
};
use headbox_trace::light::Lighting;
use headbox_trace::viewpoint::place_headbox;
use std::path::PathBuf;

/// Builder of a capture: rays from a headbox into a scene, lit, merged and packed into a
/// [`CubeLdi`].
///
/// By default the headbox lies in free space, faces have 1024 pixels along a side, and 32^4 strata
/// of 16 rays are traced from each face, as in the papers (S15), which takes minutes.
/// `face_size(256).strata(12)` takes seconds.
///
/// ```
/// # fn main() -> Result<(), headbox::Error> {
/// let scene = headbox::Scene::open("builtin:miniature")?;
/// let capture = headbox::Capture::new(&scene).face_size(32).strata(4).rays(4).light_samples(1);
/// let ldi = capture.error_px(0.0).run()?;
/// assert!(ldi.depth_pixel_count() > 100); // without an error, all samples are kept
/// # Ok(())
/// # }
/// ```
#[derive(Clone)]
#[must_use = "nothing is captured before `run`"]
pub struct Capture<'a> {
    scene: &'a Scene,
    centre: Option<DVec3>,
    half_size_m: Option<f64>,
    face_size_px: u32,
    parameters: CaptureParameters,
    error_px: f64,
    /// Focal length of the frames for which the face size is chosen, pixels.
    frames_focal_px: Option<f64>,
    options: RunOptions<'a>,
}

impl<'a> Capture<'a> {
    /// A capture with the default quality of `headbox capture`.
    pub fn new(scene: &'a Scene) -> Self {
        Self {
            scene,
            centre: None,
            half_size_m: None,
            face_size_px: CaptureSpec::DEFAULT_FACE_SIZE_PX,
            parameters: CaptureParameters::DEFAULT,
            error_px: DEFAULT_ERROR_PX,
            frames_focal_px: None,
            options: RunOptions::default(),
        }
    }

    /// Sets the headbox's centre, world metres; in free space by default.
    pub fn center(mut self, centre: DVec3) -> Self {
        self.centre = Some(centre);
        self
    }

    /// Sets half of the headbox's edge, metres; as large as fits into free space by default.
    pub fn half_size(mut self, half_size_m: f64) -> Self {
        self.half_size_m = Some(half_size_m);
        self
    }

    /// Sets the pixels along a side of each cube face.
    pub fn face_size(mut self, face_size_px: u32) -> Self {
        self.face_size_px = face_size_px;
        self
    }

    /// Chooses faces as fine as frames of such a camera show from nearly anywhere in the headbox,
    /// within [`Self::error_px`], instead of [`Self::face_size`], with as many rays for each face
    /// pixel. The camera's position does not matter.
    pub fn for_frames(mut self, camera: &Camera) -> Self {
        self.frames_focal_px = Some(camera.focal_px());
        self
    }

    /// Sets the number of strata along each of the four dimensions of rays (N).
    pub fn strata(mut self, strata: u32) -> Self {
        self.parameters.strata = strata;
        self
    }

    /// Sets the number of rays in each stratum (M).
    pub fn rays(mut self, rays_per_stratum: u32) -> Self {
        self.parameters.rays_per_stratum = rays_per_stratum;
        self
    }

    /// Sets the light samples per depth pixel; 0 shows albedo and emission without light.
    pub fn light_samples(mut self, light_samples: u32) -> Self {
        self.parameters.light_samples = light_samples;
        self
    }

    /// Sets the number of bounces of light between surfaces; [`Bounces::Full`], all, is the
    /// default.
    pub fn bounces(mut self, bounces: impl Into<Bounces>) -> Self {
        self.parameters.bounces = bounces.into();
        self
    }

    /// Sets the random seed. The same seed gives the same bytes, on any number of threads.
    pub fn seed(mut self, seed: u64) -> Self {
        self.parameters.seed = seed;
        self
    }

    /// Aims rays at holes until the share of frame pixels with holes, plus its standard error, is
    /// at most `share`; 1 does not search for holes.
    pub fn holes(mut self, share: f64) -> Self {
        self.parameters.holes = share;
        self
    }

    /// Replaces flat parts by plane textures where this moves nothing by more than `error_px`
    /// pixels, seen from anywhere in the headbox in a frame as fine as the faces; 0 keeps every
    /// sample.
    pub fn error_px(mut self, error_px: f64) -> Self {
        self.error_px = error_px;
        self
    }

    /// Limits the memory of samples to `bytes`; the rest goes to a temporary file in `folder`.
    pub fn memory(mut self, bytes: u64, folder: impl Into<PathBuf>) -> Self {
        self.options.budget = Some((bytes, folder.into()));
        self
    }

    /// Sets the receiver of the progress, which can cancel the capture.
    pub fn progress(mut self, progress: &'a dyn Progress) -> Self {
        self.options.progress = progress;
        self
    }

    /// Traces, lights, merges and packs.
    ///
    /// # Errors
    /// [`Error::Parameter`], [`Error::Headbox`]; [`Error::Capture`] if it was cancelled or memory
    /// could not be spilled.
    pub fn run(self) -> Result<CubeLdi, Error> {
        CaptureSpec::check_quality(self.face_size_px, &self.parameters)?;
        RangeError::check(
            "the error of primitives",
            self.error_px,
            [0.0, MAX_ERROR_PX],
        )?;
        let Headbox {
            centre,
            half_size_m,
        } = place_headbox(self.scene.loaded(), self.centre, self.half_size_m)?;
        let mut spec = CaptureSpec {
            scene: self.scene.source().clone(),
            centre,
            half_size_m,
            face_size_px: self.face_size_px,
            parameters: self.parameters,
        };
        if self.half_size_m.is_none() {
            spec.fit_half_size(self.scene.loaded());
        }
        let tracer = self.scene.tracer(centre);
        if let Some(focal_px) = self.frames_focal_px {
            choose_face_size(&mut spec, &tracer, focal_px, self.error_px);
        }
        let is_lit = spec.parameters.light_samples > 0;
        let lighting = Lighting::prepare(&tracer, centre, spec.parameters.bounces, is_lit);
        let (ldi, _) = SceneCapture::new(&spec, &tracer, &lighting, &self.options).run()?;
        let layout = SplatIndexLayout::Normal;
        Ok(planes::pack(ldi, layout, Split::Auto, self.error_px)?)
    }
}

/// Builder of sprites with depth of a camera's view: slabs of eye depth, cut at gaps (S4).
#[derive(Clone)]
#[must_use = "nothing is captured before `run`"]
pub struct SpriteCapture<'a> {
    scene: &'a Scene,
    camera: Camera,
    slabs: usize,
    samples: u32,
    progress: &'a dyn Progress,
}

impl<'a> SpriteCapture<'a> {
    /// A capture of at most three slabs, with 16 rays per pixel.
    pub fn new(scene: &'a Scene, camera: &Camera) -> Self {
        Self {
            scene,
            camera: *camera,
            slabs: 3,
            samples: 16,
            progress: &Silent,
        }
    }

    /// Sets the maximum number of sprites.
    pub fn slabs(mut self, slabs: usize) -> Self {
        self.slabs = slabs;
        self
    }

    /// Sets the number of rays per pixel.
    pub fn samples(mut self, samples: u32) -> Self {
        self.samples = samples;
        self
    }

    /// Sets the receiver of the progress.
    pub fn progress(mut self, progress: &'a dyn Progress) -> Self {
        self.progress = progress;
        self
    }

    /// Traces and lights. The set is empty if the camera sees no surface.
    ///
    /// # Errors
    /// [`Error::Sprite`].
    pub fn run(self) -> Result<SpriteSet, Error> {
        let tracer = self.scene.tracer(self.camera.eye());
        let lighting = Lighting::prepare(
            &tracer,
            self.camera.eye(),
            CaptureParameters::DEFAULT.bounces,
            true,
        );
        let capture = SlabCapture {
            tracer: &tracer,
            lighting: &lighting,
            lit: true,
            samples: self.samples,
            format: DisplacementFormat::default(),
        };
        let slabs = slabs_at_gaps(&tracer, &self.camera, self.slabs);
        let sprites = capture_slabs(&capture, &self.camera, &slabs, self.progress)?;
        let mut set = SpriteSet::new(sprites);
        set.info = SpriteInfo {
            source: self.scene.name().to_owned(),
            frame: self.scene.frame(),
            light: self.scene.source().light.clone(),
        };
        set.environment = lighting.environment();
        Ok(set)
    }
}
