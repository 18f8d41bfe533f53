//! Test bed of the cases: random numbers, small captures, small LDIs, comparisons.

use glam::{DVec3, Vec3};
use headbox_core::camera::{Camera, CameraError};
use headbox_core::cube_face::Face;
use headbox_core::environment::Environment;
use headbox_core::frame::Frame;
use headbox_core::progress::Silent;
use headbox_core::random::Rng;
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_cube::model::samples::{CubeSamples, DepthPixel, EncodedNormal, LayeredDepthImage};
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_cube::render::{RenderSettings, Renderer};
use headbox_ldi::capture::SceneCapture;
use headbox_ldi::scene_source::SceneSource;
use headbox_ldi::spec::{CaptureSpec, RunOptions};
use headbox_scene::scene::Scene;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use image::RgbImage;
use std::sync::{Arc, LazyLock};

/// Chance: a stream of numbers for each case of a seed.
pub(super) struct Dice(Rng);

impl Dice {
    pub(super) fn new(seed: u64, stream: u64) -> Self {
        Self(Rng::keyed(
            seed.wrapping_mul(0x2545_f491_4f6c_dd1d) ^ stream.wrapping_mul(0x9e37_79b9_7f4a_7c15),
        ))
    }

    pub(super) fn bits(&mut self) -> u64 {
        self.0.bits()
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0.between(low, high)
    }

    pub(super) fn below(&mut self, count: u32) -> u32 {
        self.0.below(count.into()) as u32
    }

    pub(super) fn in_cube(&mut self, half: f64) -> DVec3 {
        self.0.in_cube(half)
    }

    pub(super) fn direction(&mut self) -> DVec3 {
        loop {
            let v = self.in_cube(1.0);
            if (0.01..=1.0).contains(&v.length()) {
                return v.normalize();
            }
        }
    }
}

/// Captures a scene without light about a centre: small and quick.
pub(super) fn capture(
    scene: Arc<Scene>,
    centre: DVec3,
    half_size_m: f64,
    face_size_px: u32,
) -> Option<CubeSamples> {
    capture_with(scene, centre, half_size_m, face_size_px, (8, 12))
}

fn capture_with(
    scene: Arc<Scene>,
    centre: DVec3,
    half_size_m: f64,
    face_size_px: u32,
    (strata, rays): (u32, u32),
) -> Option<CubeSamples> {
    let spec = CaptureSpec {
        face_size_px,
        parameters: CaptureParameters {
            seed: 1,
            ..CaptureParameters::unlit(strata, rays)
        },
        ..CaptureSpec::new(SceneSource::new("stability"), centre, half_size_m)
    };
    let tracer = Tracer::new(scene, centre);
    let lighting = Lighting::of_scene(&tracer, 0);
    let (ldi, _) = SceneCapture::new(&spec, &tracer, &lighting, &RunOptions::default())
        .run()
        .ok()?;
    Some(ldi)
}

/// Packs in the default layout.
pub(super) fn pack(ldi: &CubeSamples) -> Option<CubeLdi> {
    CubeLdi::pack(ldi, SplatIndexLayout::Normal, Split::Auto).ok()
}

/// A room, captured without light: half-size, LDI, packed.
pub(super) static ROOM: LazyLock<Option<TestBed>> = LazyLock::new(|| {
    let scene = Arc::new(headbox_scenes::build("interior", 0)?);
    let headbox = scene.headbox?;
    let ldi = capture_with(
        Arc::clone(&scene),
        headbox.centre,
        headbox.half_size_m,
        128,
        (12, 8),
    )?;
    let cube = pack(&ldi)?;
    let tracer = Tracer::new(scene, headbox.centre);
    Some(TestBed {
        centre: headbox.centre,
        half: headbox.half_size_m,
        ldi,
        cube,
        tracer,
    })
});

/// A captured room.
pub(super) struct TestBed {
    pub(super) centre: DVec3,
    pub(super) half: f64,
    pub(super) ldi: CubeSamples,
    pub(super) cube: CubeLdi,
    tracer: Tracer,
}

impl TestBed {
    /// A camera in the room, `offset` half-sizes from the centre.
    pub(super) fn camera(&self, offset: DVec3, forward: DVec3, fov_deg: f64) -> Option<Camera> {
        look(self.centre + offset * self.half, forward, fov_deg, [64, 48]).ok()
    }

    /// Ray-traced truth of the camera, unlit as the capture is.
    pub(super) fn truth(&self, camera: &Camera) -> RgbImage {
        let lighting = Lighting::of_scene(&self.tracer, 0);
        headbox_trace::truth::render(&self.tracer, &lighting, false, camera, 8, &Silent).rgb()
    }
}

/// A camera that looks along a direction.
pub(super) fn look(
    eye: DVec3,
    forward: DVec3,
    fov_deg: f64,
    [width, height]: [u32; 2],
) -> Result<Camera, CameraError> {
    Camera::look_at(eye, eye + forward, DVec3::Y, fov_deg, [width, height])
}

/// A cube LDI about the origin with a headbox of half-size 0.5: of each pixel of the given faces,
/// the samples (farthest first) that `samples` makes of its position on the face in pixels.
pub(super) fn ldi_of(
    face_px: u32,
    faces: &[Face],
    mut samples: impl FnMut(Face, f64, f64) -> Vec<DepthPixel>,
) -> CubeSamples {
    let mut all = Vec::with_capacity(6);
    for face in Face::ALL {
        let mut ldi = LayeredDepthImage::empty(face, face_px);
        if faces.contains(&face) {
            for p in 0..face_px * face_px {
                let (x, y) = (f64::from(p % face_px) + 0.5, f64::from(p / face_px) + 0.5);
                ldi.samples.extend(samples(face, x, y));
                ldi.offsets[p as usize + 1] = ldi.samples.len() as u32;
            }
        }
        all.push(ldi);
    }
    let info = CaptureInfo {
        scene: "stability".into(),
        half_size_m: 0.5,
        exposure: 1.0,
        ..CaptureInfo::default()
    };
    CubeSamples {
        info,
        faces: all,
        environment: Environment::default(),
    }
}

/// An opaque sample that faces the centre of its cube face.
pub(super) fn sample(face: Face, inverse_depth: f64, [r, g, b]: [u8; 3]) -> DepthPixel {
    sample_with_normal(-face.normal().as_vec3(), inverse_depth, [r, g, b])
}

/// An opaque sample.
pub(super) fn sample_with_normal(
    normal: Vec3,
    inverse_depth: f64,
    [r, g, b]: [u8; 3],
) -> DepthPixel {
    DepthPixel {
        inverse_depth: inverse_depth as f32,
        normal: EncodedNormal::new(normal),
        color_srgb: [r, g, b, 255],
    }
}

/// Draws a frame.
pub(super) fn draw(cube: &CubeLdi, camera: &Camera, settings: &RenderSettings) -> Frame {
    Renderer::new().render(cube, camera, settings).clone()
}

/// The settings of a kernel.
pub(super) fn kernel(kernel: SplatKernel) -> RenderSettings {
    RenderSettings {
        kernel,
        ..RenderSettings::default()
    }
}

/// Root mean square difference of two frames' channels, levels.
pub(super) fn rms_levels(a: &Frame, b: &Frame) -> f64 {
    let squares = a
        .color
        .iter()
        .zip(&b.color)
        .flat_map(|(p, q)| (0..3).map(|c| (f64::from(p[c]) - f64::from(q[c])).powi(2)));
    (squares.sum::<f64>() / (3 * a.color.len().max(1)) as f64).sqrt()
}

/// Mean difference of a frame's channels from those of a picture, levels.
pub(super) fn mean_levels(frame: &Frame, picture: &RgbImage) -> f64 {
    let of_pixel = |(a, b): (&[u8; 4], &image::Rgb<u8>)| {
        (0..3)
            .map(|c| f64::from(a[c].abs_diff(b.0[c])))
            .sum::<f64>()
    };
    let sum: f64 = frame.color.iter().zip(picture.pixels()).map(of_pixel).sum();
    sum / (3 * frame.color.len().max(1)) as f64
}

/// Pixels that differ in any channel by more than `levels`.
pub(super) fn differing(a: &Frame, b: &Frame, levels: u8) -> usize {
    let differs = |(p, q): &(&[u8; 4], &[u8; 4])| (0..3).any(|c| p[c].abs_diff(q[c]) > levels);
    a.color.iter().zip(&b.color).filter(differs).count() + a.color.len().abs_diff(b.color.len())
}

/// The largest of some values; `None` if there are none, or one is missing.
pub(super) fn largest(values: impl IntoIterator<Item = Option<f64>>) -> Option<f64> {
    values.into_iter().try_fold(f64::NEG_INFINITY, |a, b| {
        b.map(|b| if b.is_nan() { b } else { a.max(b) })
    })
}
