//! Cube LDIs from deep images: all samples of each pixel, as written by a film renderer or by
//! `headbox_export::deep`.
//!
//! A deep image has one eye: it is an environment map of six faces, or the image of a camera. Its
//! samples have colour, alpha and depth, but no surface: normals are those of planes through
//! neighbouring samples. Samples so far away that they have no parallax within the headbox become
//! environment.

mod lens;

use glam::DVec3;
use headbox_core::camera::CameraError;
use headbox_core::color::srgb8_from_linear;
use headbox_core::cube_face::Face;
use headbox_core::environment::Environment;
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::model::samples::{CubeSamples, DepthPixel, EncodedNormal, LayeredDepthImage};
use headbox_cube::model::validate::MAX_FACE_SIZE_PX;
use headbox_images::deep_exr::DeepImage;
use lens::Lens;
use rayon::prelude::*;

/// Default of half of the headbox's edge, as a share of the distance of the nearest sample. It is
/// small, because a single eye saw all samples.
const HEADBOX_SHARE: f64 = 0.15;

/// Parallax in the headbox, face pixels, below which a sample counts as infinitely far away.
const STILL_PX: f64 = 0.5;

/// Maximum size of faces from a camera's image, pixels.
const MAX_CAMERA_FACE_PX: u32 = 2048;

/// Maximum size of faces of the environment, pixels.
const MAX_ENVIRONMENT_PX: u32 = 512;

/// Error while a deep image becomes a cube LDI.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum FromDeepError {
    /// A channel is missing.
    #[error("no channel {0}; colours (R, G, B) and depth (Z) are needed")]
    Channel(&'static str),
    /// The environment map does not consist of six faces.
    #[error("an environment map of {0}x{1} pixels, not of six square faces one above another")]
    Faces(u32, u32),
    /// The camera is unknown.
    #[error(
        "the header specifies neither a cubic environment map (envmap) nor a camera (worldToCamera, worldToNDC); give --fov, and \
         --center and --look-at unless the camera is at the origin looking along -Z"
    )]
    View,
    /// An argument specifies what the header specifies: the flag, and the header's statement.
    #[error("{0} does not apply, because the header {1}; leave it out")]
    Redundant(&'static str, &'static str),
    /// The specified camera is invalid.
    #[error(transparent)]
    Lens(#[from] CameraError),
    /// The matrices are not those of a camera.
    #[error("worldToCamera and worldToNDC are not those of a camera that looks at its image")]
    Camera,
    /// No sample has a depth.
    #[error("no sample with a depth above 0 and an alpha above 0")]
    Empty,
}

/// Properties of a capture that the header of a deep image may lack.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeepCameraOptions {
    /// Position of the eye, world metres, unless the header specifies it; the origin if absent.
    pub centre: Option<DVec3>,
    /// Target of the camera, world metres, unless the header specifies it; along -Z if absent.
    pub look_at: Option<DVec3>,
    /// Vertical field of view in degrees, unless the header specifies it.
    pub fov_y_deg: Option<f64>,
    /// Half of the headbox's edge, metres; from the nearest sample if absent.
    pub half_size_m: Option<f64>,
    /// Name of the image.
    pub name: String,
}

/// Builds a cube LDI from a deep image, whose depths are taken as metres.
///
/// # Errors
/// [`FromDeepError`].
pub fn cube(image: &DeepImage, place: DeepCameraOptions) -> Result<CubeSamples, FromDeepError> {
    let sampler = DeepSampler::new(image, &place)?;
    let nearest = sampler.nearest().ok_or(FromDeepError::Empty)?;
    let half_size_m = place.half_size_m.unwrap_or(HEADBOX_SHARE * nearest);
    let face_px = sampler.face_px;
    // Samples beyond this inverse depth move by less than `STILL_PX`.
    let still = STILL_PX * 2.0 / (f64::from(face_px) * half_size_m);
    let faces = Face::ALL
        .into_par_iter()
        .map(|face| build_face(&sampler, face, still))
        .collect();
    let info = CaptureInfo {
        scene: place.name,
        centre: sampler
            .lens
            .map(|lens| lens.eye)
            .or(place.centre)
            .unwrap_or_default(),
        half_size_m,
        exposure: 1.0,
        ahead: sampler.lens.map(|lens| lens.ahead),
        ..CaptureInfo::default()
    };
    Ok(CubeSamples {
        info,
        faces,
        environment: build_environment(&sampler, still),
    })
}

/// A deep sample as seen from the eye.
#[derive(Clone, Copy)]
struct DeepSample {
    /// 1 / eye depth for a direction of eye depth 1, 1/m; 0 at infinity.
    inverse_depth: f64,
    color_srgb: [u8; 4],
}

/// Lookup of deep samples by direction.
struct DeepSampler<'a> {
    image: &'a DeepImage,
    /// Red, green, blue, depth.
    channels: [&'a [f32]; 4],
    alpha: Option<&'a [f32]>,
    /// Camera of the image; `None` for six faces.
    lens: Option<Lens>,
    /// Pixels along a side of the cube's faces.
    face_px: u32,
}

impl<'a> DeepSampler<'a> {
    fn new(image: &'a DeepImage, place: &DeepCameraOptions) -> Result<Self, FromDeepError> {
        let channel = |name| image.channel(name).ok_or(FromDeepError::Channel(name));
        let channels = [channel("R")?, channel("G")?, channel("B")?, channel("Z")?];
        let alpha = image.channel("A");
        let [width, height] = image.size_px;
        let lens = Lens::new(image, place)?;
        let face_px = match &lens {
            // In the middle, a face pixel is as wide as a pixel of the image.
            Some(lens) => {
                let focal_px = lens
                    .focal_px(image.size_px.map(f64::from))
                    .ok_or(FromDeepError::Camera)?;
                ((2.0 * focal_px).round() as u32).clamp(16, MAX_CAMERA_FACE_PX)
            }
            None if u64::from(height) != 6 * u64::from(width)
                || width == 0
                || width > MAX_FACE_SIZE_PX =>
            {
                return Err(FromDeepError::Faces(width, height));
            }
            None => width,
        };
        Ok(Self {
            image,
            channels,
            alpha,
            lens,
            face_px,
        })
    }

    /// Position in the image, pixels, of a direction from the eye, and its depth in the camera's
    /// axes.
    fn project(&self, direction: DVec3) -> Option<[f64; 3]> {
        let [x, y, depth] = match &self.lens {
            None => {
                let face = Face::containing(direction);
                let [x, y, depth] = face.project(direction, self.face_px);
                [x, y + f64::from(self.face_px) * face.index() as f64, depth]
            }
            Some(lens) => lens.project(direction, self.image.size_px.map(f64::from)),
        };
        (depth > 0.0 && x.is_finite() && y.is_finite()).then_some([x, y, depth])
    }

    /// Depth of the nearest sample, metres, as the image stores it.
    fn nearest(&self) -> Option<f64> {
        let depths = self.channels[3]
            .iter()
            .enumerate()
            .filter(|(i, z)| **z > 0.0 && z.is_finite() && self.alpha(*i) > 0.0);
        depths.map(|(_, z)| f64::from(*z)).min_by(f64::total_cmp)
    }

    /// Alpha of sample `i`.
    fn alpha(&self, i: usize) -> f32 {
        self.alpha.map_or(1.0, |values| values[i])
    }

    /// The samples in a direction from the eye, farthest first.
    fn samples(&self, direction: DVec3) -> Vec<DeepSample> {
        let Some([x, y, depth]) = self.project(direction) else {
            return Vec::new();
        };
        let [width, height] = self.image.size_px.map(f64::from);
        if !(0.0..width).contains(&x) || !(0.0..height).contains(&y) {
            return Vec::new();
        }
        let mut samples: Vec<DeepSample> = self
            .image
            .samples_at(x as u32, y as u32)
            .filter_map(|i| self.sample(i, depth))
            .collect();
        samples.sort_by(|a, b| a.inverse_depth.total_cmp(&b.inverse_depth));
        samples
    }

    /// Sample `i` in a direction with this depth in the image's axes.
    fn sample(&self, i: usize, depth: f64) -> Option<DeepSample> {
        let [r, g, b, z] = self.channels.map(|values| values[i]);
        let alpha = self.alpha(i).min(1.0);
        let level = (alpha * 255.0).round() as u8;
        if level == 0 || z.is_nan() || z <= 0.0 {
            return None;
        }
        let [r, g, b] = [r, g, b].map(|c| srgb8_from_linear(c / alpha));
        Some(DeepSample {
            inverse_depth: depth / f64::from(z),
            color_srgb: [r, g, b, level],
        })
    }
}

fn build_face(sampler: &DeepSampler, face: Face, still: f64) -> LayeredDepthImage {
    let face_px = sampler.face_px;
    let near_samples = |x: u32, y: u32| {
        let direction = face.direction(f64::from(x) + 0.5, f64::from(y) + 0.5, face_px);
        let mut samples = sampler.samples(direction);
        samples.retain(|sample| sample.inverse_depth > still);
        samples
    };
    let rows: Vec<Vec<Vec<DeepSample>>> = (0..face_px)
        .into_par_iter()
        .map(|y| (0..face_px).map(|x| near_samples(x, y)).collect())
        .collect();
    let mut image = LayeredDepthImage::empty(face, face_px);
    for (pixel, samples) in rows.iter().flatten().enumerate() {
        let position = [pixel % rows.len(), pixel / rows.len()];
        image.samples.extend(samples.iter().map(|sample| {
            let normal = normal(&rows, face, position, sample.inverse_depth);
            DepthPixel {
                inverse_depth: sample.inverse_depth as f32,
                normal: EncodedNormal::new(normal.as_vec3()),
                color_srgb: sample.color_srgb,
            }
        }));
        image.offsets[pixel + 1] = image.samples.len() as u32;
    }
    image
}

/// The normal, toward the eye, of the plane through a sample of inverse depth `q` in pixel (x, y)
/// and its neighbours: on a plane n . P = 1, inverse depth is n . direction.
fn normal(rows: &[Vec<Vec<DeepSample>>], face: Face, [x, y]: [usize; 2], q: f64) -> DVec3 {
    let nearest = |x: Option<usize>, y: Option<usize>| {
        let samples = rows
            .get(y?)?
            .get(x?)?
            .iter()
            .map(|sample| sample.inverse_depth);
        samples.min_by(|a, b| (a - q).abs().total_cmp(&(b - q).abs()))
    };
    // At an edge, the side that changes less is that of the sample's own surface.
    let change = |before: Option<f64>, after: Option<f64>| {
        let steps = [
            before.map(|before| q - before),
            after.map(|after| after - q),
        ];
        steps
            .into_iter()
            .flatten()
            .min_by(|a, b| a.abs().total_cmp(&b.abs()))
            .unwrap_or(0.0)
    };
    let px = rows.len() as u32;
    let half = f64::from(px) / 2.0;
    let across = change(
        nearest(x.checked_sub(1), Some(y)),
        nearest(Some(x + 1), Some(y)),
    ) * half;
    let up = -change(
        nearest(Some(x), y.checked_sub(1)),
        nearest(Some(x), Some(y + 1)),
    ) * half;
    let direction = face.direction(x as f64 + 0.5, y as f64 + 0.5, px);
    let ahead = q - across * direction.dot(face.right()) - up * direction.dot(face.up());
    -(face.right() * across + face.up() * up + face.normal() * ahead).normalize_or(direction)
}

/// The environment of all samples at infinity; empty if there are none.
fn build_environment(sampler: &DeepSampler, still: f64) -> Environment {
    let size_px = sampler.face_px.min(MAX_ENVIRONMENT_PX);
    let per_face = size_px * size_px;
    let texel = |index: u32| {
        let x = index % per_face % size_px;
        let y = index % per_face / size_px;
        let face = Face::ALL[(index / per_face) as usize];
        let direction = face.direction(f64::from(x) + 0.5, f64::from(y) + 0.5, size_px);
        let far = sampler
            .samples(direction)
            .into_iter()
            .find(|sample| sample.inverse_depth <= still);
        far.map_or([0; 4], |sample| {
            let [r, g, b, _] = sample.color_srgb;
            [r, g, b, 255]
        })
    };
    let texels: Vec<[u8; 4]> = (0..6 * per_face).into_par_iter().map(texel).collect();
    if texels.iter().all(|texel| texel[3] == 0) {
        Environment::default()
    } else {
        Environment { size_px, texels }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_images::deep_exr::{DeepChannel, DeepKind, DeepView};

    /// Six faces of `n` pixels: a room of walls at 2 m, half open before a sky at infinity on +Y.
    fn room(n: u32) -> DeepImage {
        let mut offsets = vec![0u32];
        let mut values = [const { Vec::new() }; 5];
        for pixel in 0..6 * n * n {
            let face = Face::ALL[(pixel / (n * n)) as usize];
            let stack: &[[f32; 5]] = match face {
                Face::PosY => &[
                    [f32::INFINITY, 0.0, 0.0, 1.0, 1.0],
                    [2.0, 0.5, 0.0, 0.0, 0.5],
                ],
                _ => &[[2.0, 0.2, 0.4, 0.6, 1.0]],
            };
            for sample in stack {
                values
                    .iter_mut()
                    .zip(sample)
                    .for_each(|(values, value)| values.push(*value));
            }
            offsets.push(values[0].len() as u32);
        }
        let names = ["Z", "R", "G", "B", "A"];
        let channel = |(name, values): (&str, Vec<f32>)| DeepChannel {
            name: name.into(),
            kind: DeepKind::Float,
            values,
        };
        let channels = names.into_iter().zip(values).map(channel).collect();
        let size_px = [n, 6 * n];
        let view = DeepView {
            cube: true,
            ..DeepView::default()
        };
        DeepImage {
            size_px,
            origin_px: [0, 0],
            stored_px: size_px,
            offsets,
            channels,
            view,
        }
    }

    #[test]
    fn half_open_room_becomes_a_cube() {
        let place = DeepCameraOptions {
            centre: Some(DVec3::new(1.0, 2.0, 3.0)),
            ..DeepCameraOptions::default()
        };
        let cube = cube(&room(16), place).expect("a cube");
        assert_eq!(cube.info.centre, DVec3::new(1.0, 2.0, 3.0));
        assert!((cube.info.half_size_m - 0.3).abs() < 1e-12);
        for image in &cube.faces {
            assert_eq!(
                image.samples.len(),
                256,
                "{:?}: one sample per pixel, without the sky",
                image.face
            );
            for sample in &image.samples {
                assert!((sample.inverse_depth - 0.5).abs() < 1e-6);
                let toward = -image.face.normal().as_vec3();
                assert!(
                    sample.normal.decode().dot(toward) > 0.9999,
                    "{:?}",
                    sample.normal.decode()
                );
                // Half of red over an alpha of half is red; 128 of 255 is half.
                let expected = if image.face == Face::PosY {
                    [255, 0, 0, 128]
                } else {
                    [124, 170, 203, 255]
                };
                assert_eq!(sample.color_srgb, expected);
            }
        }
        let environment = &cube.environment;
        assert_eq!(environment.sample(glam::Vec3::Y), Some([0, 0, 255]));
        assert_eq!(environment.sample(glam::Vec3::X), None);
    }

    #[test]
    fn unusable_images_are_refused() {
        let error = |change: &dyn Fn(&mut DeepImage)| {
            let mut image = room(4);
            change(&mut image);
            cube(&image, DeepCameraOptions::default())
                .map(|_| ())
                .expect_err("refused")
        };
        assert_eq!(
            error(&|image| image.channels.retain(|channel| channel.name != "Z")),
            FromDeepError::Channel("Z")
        );
        assert_eq!(error(&|image| image.view.cube = false), FromDeepError::View);
        assert_eq!(
            error(&|image| image.size_px = [4, 8]),
            FromDeepError::Faces(4, 8)
        );
        let singular = Some([0.0; 16]);
        let view = DeepView {
            cube: false,
            world_to_camera: singular,
            world_to_ndc: singular,
        };
        assert_eq!(error(&|image| image.view = view), FromDeepError::Camera);
        assert_eq!(
            error(&|image| image.channels[0].values.fill(f32::NAN)),
            FromDeepError::Empty
        );
    }
}
