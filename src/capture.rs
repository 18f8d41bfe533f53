//! Captures in one call: of a cube LDI, and of sprites.

use crate::{Error, Scene};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::headbox::Headbox;
use headbox_core::progress::{Progress, Silent};
use headbox_cube::model::parameters::CaptureParameters;
use headbox_cube::model::validate::MAX_FACE_SIZE_PX;
use headbox_cube::pack::{PackedCube, SplatIndexLayout, Split};
use headbox_cube::planes as primitives;
use headbox_cube::planes::{DEFAULT_ERROR_PX, MAX_ERROR_PX};
use headbox_ldi::face_size as fineness;
use headbox_ldi::job::CaptureJob;
use headbox_ldi::refine;
use headbox_ldi::settings::Resources;
use headbox_sprite::{
    DisplacementFormat, SlabCapture, SpriteInfo, SpriteSet, capture_slabs, slabs_at_gaps,
};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::sampler::Strata;
use headbox_trace::viewpoint::place_headbox;
use std::path::PathBuf;
use std::sync::Arc;

/// A capture to be made: rays from a headbox into a scene, lit, merged and packed into a [`CubeLdi`](headbox_cube::pack::layout::PackedCube).
///
/// Where nothing is said, the headbox lies in free space, faces have 1024 pixels a side, and 32^4 strata of 16 rays are
/// traced from each face, as in the papers (S15): minutes of work. `face_size(256).strata(12)` takes seconds.
///
/// ```
/// # fn main() -> Result<(), headbox::Error> {
/// let scene = headbox::Scene::open("builtin:miniature")?;
/// let ldi = headbox::Capture::new(&scene).face_size(32).strata(4).rays(4).light_samples(1).error_px(0.0).run()?;
/// assert!(ldi.depth_pixel_count() > 100); // without an error nothing is shown as a picture on a plane
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
    /// Of frames that are to be made of it, if faces are to be as fine as these.
    frames_focal_px: Option<f64>,
    resources: Resources,
    progress: &'a dyn Progress,
}

impl<'a> Capture<'a> {
    /// What `headbox capture` does where nothing is said.
    pub fn new(scene: &'a Scene) -> Self {
        Self {
            scene,
            centre: None,
            half_size_m: None,
            face_size_px: CaptureJob::DEFAULT_FACE_SIZE_PX,
            parameters: CaptureParameters::DEFAULT,
            error_px: DEFAULT_ERROR_PX,
            frames_focal_px: None,
            resources: Resources::default(),
            progress: &Silent,
        }
    }

    /// The headbox's centre, world metres; free space if nothing is said.
    pub fn center(mut self, centre: DVec3) -> Self {
        self.centre = Some(centre);
        self
    }

    /// Half of the headbox's edge, metres; what fits into free space if nothing is said.
    pub fn half_size(mut self, half_size_m: f64) -> Self {
        self.half_size_m = Some(half_size_m);
        self
    }

    /// Pixels a side of each cube face.
    pub fn face_size(mut self, face_size_px: u32) -> Self {
        self.face_size_px = face_size_px;
        self
    }

    /// Faces as fine as frames of such a camera show from nearly anywhere in the headbox, to within [`Self::error_px`], instead of
    /// [`Self::face_size`], with as many rays for each of their pixels; where the camera stands does not matter.
    pub fn for_frames(mut self, camera: &Camera) -> Self {
        self.frames_focal_px = Some(camera.focal_px());
        self
    }

    /// Strata along each of the four dimensions of rays (N).
    pub fn strata(mut self, strata: u32) -> Self {
        self.parameters.strata = strata;
        self
    }

    /// Rays in each stratum (M).
    pub fn rays(mut self, rays_per_stratum: u32) -> Self {
        self.parameters.rays_per_stratum = rays_per_stratum;
        self
    }

    /// Light samples per depth pixel; 0 shows albedo and emission without light.
    pub fn light_samples(mut self, light_samples: u32) -> Self {
        self.parameters.light_samples = light_samples;
        self
    }

    /// Bounces of light between surfaces.
    pub fn bounces(mut self, bounces: u32) -> Self {
        self.parameters.bounces = bounces;
        self
    }

    /// Random seed: the same seed gives the same bytes, on any number of threads.
    pub fn seed(mut self, seed: u64) -> Self {
        self.parameters.seed = seed;
        self
    }

    /// Aims rays at what frames lack until its share of their pixels, with its standard error, is at most this; 1 aims none.
    pub fn holes(mut self, share: f64) -> Self {
        self.parameters.holes = share;
        self
    }

    /// What is flat is shown as pictures on planes where nobody in the headbox sees it elsewhere by more than so many pixels of
    /// a frame as fine as the faces; 0 keeps every sample.
    pub fn error_px(mut self, error_px: f64) -> Self {
        self.error_px = error_px;
        self
    }

    /// All parameters at once.
    #[doc(hidden)]
    pub fn parameters(mut self, parameters: CaptureParameters) -> Self {
        self.parameters = parameters;
        self
    }

    /// Bytes that samples may take in memory; what does not fit goes to a temporary file in `folder`.
    pub fn memory(mut self, bytes: u64, folder: impl Into<PathBuf>) -> Self {
        self.resources.budget = Some((bytes, folder.into()));
        self
    }

    /// Who is told how far the capture is, and may give it up.
    pub fn progress(mut self, progress: &'a dyn Progress) -> Self {
        self.progress = progress;
        self
    }

    /// Traces, lights, merges and packs.
    ///
    /// # Errors
    /// [`Error::Parameter`], [`Error::Headbox`]; [`Error::Capture`] if it was given up or memory could not be spilled.
    pub fn run(self) -> Result<PackedCube, Error> {
        self.check()?;
        let Headbox {
            centre,
            half_size_m,
        } = place_headbox(self.scene.loaded(), self.centre, self.half_size_m)?;
        let mut job = CaptureJob {
            scene: self.scene.source().clone(),
            centre,
            half_size_m,
            face_size_px: self.face_size_px,
            parameters: self.parameters,
        };
        let tracer = Tracer::new(Arc::clone(self.scene.loaded()), centre);
        if let Some(focal_px) = self.frames_focal_px {
            fineness::settle(&mut job, &tracer, focal_px, self.error_px);
        }
        let lighting = Lighting::prepare(
            &tracer,
            job.parameters.bounces,
            job.parameters.light_samples > 0,
        );
        let (ldi, _) = refine::capture(&job, &tracer, &lighting, &self.resources, self.progress)?;
        Ok(primitives::pack(
            ldi,
            SplatIndexLayout::Normal,
            Split::Auto,
            self.error_px,
        )?)
    }

    fn check(&self) -> Result<(), Error> {
        let CaptureParameters {
            strata,
            rays_per_stratum,
            novelty,
            holes,
            ..
        } = self.parameters;
        let within = |name, value: f64, allowed: [f64; 2]| match (allowed[0]..=allowed[1])
            .contains(&value)
        {
            true => Ok(()),
            false => Err(Error::Parameter {
                name,
                value,
                allowed,
            }),
        };
        within(
            "the face size",
            self.face_size_px.into(),
            [1.0, MAX_FACE_SIZE_PX.into()],
        )?;
        within(
            "the number of strata",
            strata.into(),
            [1.0, Strata::MAX_PER_DIMENSION.into()],
        )?;
        within(
            "the number of rays in a stratum",
            rays_per_stratum.into(),
            [1.0, Strata::MAX_RAYS.into()],
        )?;
        within(
            "the error of primitives",
            self.error_px,
            [0.0, MAX_ERROR_PX],
        )?;
        within("novelty", novelty, [0.0, 1.0])?;
        within("the share of holes", holes, [0.0, 1.0])
    }
}

/// Sprites with depth to be captured of what a camera sees: slabs of eye depth, cut where there are gaps (S4).
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
    /// Three slabs at most, 16 rays a pixel.
    pub fn new(scene: &'a Scene, camera: &Camera) -> Self {
        Self {
            scene,
            camera: *camera,
            slabs: 3,
            samples: 16,
            progress: &Silent,
        }
    }

    /// At most so many sprites.
    pub fn slabs(mut self, slabs: usize) -> Self {
        self.slabs = slabs;
        self
    }

    /// Rays per pixel.
    pub fn samples(mut self, samples: u32) -> Self {
        self.samples = samples;
        self
    }

    /// Who is told how far the capture is.
    pub fn progress(mut self, progress: &'a dyn Progress) -> Self {
        self.progress = progress;
        self
    }

    /// Traces and lights; a set without sprites where the camera sees nothing.
    ///
    /// # Errors
    /// [`Error::Sprite`].
    pub fn run(self) -> Result<SpriteSet, Error> {
        let tracer = Tracer::new(Arc::clone(self.scene.loaded()), self.camera.eye());
        let lighting = Lighting::prepare(&tracer, CaptureParameters::DEFAULT.bounces, true);
        let (lit, samples, format) = (true, self.samples, DisplacementFormat::default());
        let capture = SlabCapture {
            tracer: &tracer,
            lighting: &lighting,
            lit,
            samples,
            format,
        };
        let slabs = slabs_at_gaps(&tracer, &self.camera, self.slabs);
        let mut set = SpriteSet::new(capture_slabs(
            &capture,
            &self.camera,
            &slabs,
            self.progress,
        )?);
        set.info = SpriteInfo {
            source: self.scene.name().to_owned(),
            frame: self.scene.frame(),
            light: self.scene.source().light.clone(),
        };
        set.environment = lighting.environment();
        Ok(set)
    }
}
