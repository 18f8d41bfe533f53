//! Fixtures of the cases: random numbers, small captures, small LDIs, comparisons of frames.

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

/// Returns the random numbers of a case: a stream for each seed.
pub(super) fn case_rng(seed: u64, stream: u64) -> Rng {
    Rng::keyed(
        seed.wrapping_mul(0x2545_f491_4f6c_dd1d) ^ stream.wrapping_mul(0x9e37_79b9_7f4a_7c15),
    )
}

/// Returns a uniform unit vector.
pub(super) fn random_direction(rng: &mut Rng) -> DVec3 {
    loop {
        let v = rng.in_cube(1.0);
        if (0.01..=1.0).contains(&v.length()) {
            return v.normalize();
        }
    }
}

/// Returns the parameters of a small capture without light.
pub(super) fn small_capture(strata: u32, rays: u32) -> CaptureParameters {
    CaptureParameters {
        seed: 1,
        ..CaptureParameters::unlit(strata, rays)
    }
}

/// Captures a scene about a centre.
pub(super) fn capture(
    scene: Arc<Scene>,
    centre: DVec3,
    half_size_m: f64,
    face_size_px: u32,
    parameters: CaptureParameters,
) -> Option<CubeSamples> {
    let spec = CaptureSpec {
        face_size_px,
        parameters,
        ..CaptureSpec::new(SceneSource::new("stability"), centre, half_size_m)
    };
    let tracer = Tracer::new(scene, centre);
    let lighting = Lighting::unmetered(&tracer, 0);
    let (ldi, _) = SceneCapture::new(&spec, &tracer, &lighting, &RunOptions::default())
        .run()
        .ok()?;
    Some(ldi)
}

/// Packs an LDI in the default layout.
pub(super) fn pack(ldi: &CubeSamples) -> Option<CubeLdi> {
    CubeLdi::pack(ldi, SplatIndexLayout::Normal, Split::Auto).ok()
}

/// The scene `interior`, captured without light.
pub(super) static ROOM: LazyLock<Option<CapturedRoom>> = LazyLock::new(|| {
    let scene = Arc::new(headbox_scenes::build("interior", 0)?);
    let headbox = scene.headbox?;
    let ldi = capture(
        Arc::clone(&scene),
        headbox.centre,
        headbox.half_size_m,
        128,
        small_capture(12, 8),
    )?;
    let cube = pack(&ldi)?;
    let tracer = Tracer::new(scene, headbox.centre);
    Some(CapturedRoom {
        centre: headbox.centre,
        half_size_m: headbox.half_size_m,
        ldi,
        cube,
        tracer,
    })
});

/// A captured room.
pub(super) struct CapturedRoom {
    pub(super) centre: DVec3,
    pub(super) half_size_m: f64,
    pub(super) ldi: CubeSamples,
    pub(super) cube: CubeLdi,
    tracer: Tracer,
}

impl CapturedRoom {
    /// Returns a camera in the room, `offset` half-sizes from the centre.
    pub(super) fn camera(&self, offset: DVec3, forward: DVec3, fov_deg: f64) -> Option<Camera> {
        let eye = self.centre + offset * self.half_size_m;
        look_along(eye, forward, fov_deg, [64, 48]).ok()
    }

    /// Renders the ray-traced truth of a camera, without light, like the capture.
    pub(super) fn truth(&self, camera: &Camera) -> RgbImage {
        let lighting = Lighting::unmetered(&self.tracer, 0);
        headbox_trace::truth::render(&self.tracer, &lighting, false, camera, 8, &Silent).rgb()
    }
}

/// Returns a camera that looks along a direction.
pub(super) fn look_along(
    eye: DVec3,
    forward: DVec3,
    fov_deg: f64,
    size_px: [u32; 2],
) -> Result<Camera, CameraError> {
    Camera::look_at(eye, eye + forward, DVec3::Y, fov_deg, size_px)
}

/// Builds a cube LDI about the origin with a headbox of half-size 0.5. `samples` returns the
/// samples of a pixel of the given faces, farthest first, from its position on the face, px.
pub(super) fn build_ldi(
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
    CubeSamples {
        info: CaptureInfo {
            scene: "stability".into(),
            half_size_m: 0.5,
            exposure: 1.0,
            ..CaptureInfo::default()
        },
        faces: all,
        environment: Environment::default(),
    }
}

/// Returns an opaque sample whose normal is opposite to that of its cube face.
pub(super) fn sample(face: Face, inverse_depth: f64, color: [u8; 3]) -> DepthPixel {
    sample_with_normal(-face.normal().as_vec3(), inverse_depth, color)
}

/// Returns an opaque sample.
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

/// Returns the default settings with another kernel.
pub(super) fn with_kernel(kernel: SplatKernel) -> RenderSettings {
    RenderSettings {
        kernel,
        ..RenderSettings::default()
    }
}

/// Returns the root mean square difference of two frames' channels, levels.
pub(super) fn rms_levels(a: &Frame, b: &Frame) -> f64 {
    let squares = a
        .color
        .iter()
        .zip(&b.color)
        .flat_map(|(p, q)| (0..3).map(|c| (f64::from(p[c]) - f64::from(q[c])).powi(2)));
    (squares.sum::<f64>() / (3 * a.color.len().max(1)) as f64).sqrt()
}

/// Returns the mean absolute difference of the channels of a frame and an image, levels.
pub(super) fn mean_levels(frame: &Frame, image: &RgbImage) -> f64 {
    let difference = |(a, b): (&[u8; 4], &image::Rgb<u8>)| {
        (0..3)
            .map(|c| f64::from(a[c].abs_diff(b.0[c])))
            .sum::<f64>()
    };
    let sum: f64 = frame.color.iter().zip(image.pixels()).map(difference).sum();
    sum / (3 * frame.color.len().max(1)) as f64
}

/// Counts the pixels that differ in a colour channel.
pub(super) fn differing_pixels(a: &Frame, b: &Frame) -> usize {
    let differs = |(p, q): &(&[u8; 4], &[u8; 4])| p[..3] != q[..3];
    a.color.iter().zip(&b.color).filter(differs).count() + a.color.len().abs_diff(b.color.len())
}

/// Returns the largest of the values, or a NaN among them; `None` if one is missing.
pub(super) fn largest(values: impl IntoIterator<Item = Option<f64>>) -> Option<f64> {
    values.into_iter().try_fold(f64::NEG_INFINITY, |a, b| {
        b.map(|b| if b.is_nan() { b } else { a.max(b) })
    })
}
