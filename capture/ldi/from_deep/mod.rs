//! A deep picture as a cube LDI: all samples of each pixel, as a film renderer or [`headbox_export::deep`] wrote them.
//!
//! A deep picture is of one eye: an environment map of six faces, or the picture of a camera. Its samples know colour, alpha and depth,
//! but no surface: normals are those of planes through neighbouring samples. What is so far that no eye in the headbox sees it elsewhere
//! becomes environment.

mod lens;

use glam::DVec3;
use headbox_core::camera::CameraError;
use headbox_core::color::srgb8_from_linear;
use headbox_core::cube_face::Face;
use headbox_core::environment::Environment;
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::model::samples::{CubeLdi, DepthPixel, EncodedNormal, LayeredDepthImage};
use headbox_cube::model::validate::MAX_FACE_SIZE_PX;
use headbox_images::deep_exr::DeepImage;
use lens::Lens;
use rayon::prelude::*;

/// Half of the headbox's edge over the distance of what is nearest, if nobody says more: one eye has seen it all.
const HEADBOX_SHARE: f64 = 0.15;
/// What moves by less than this share of a face pixel in the headbox lies at infinity.
const STILL_PX: f64 = 0.5;
/// The widest face, px, of a camera's picture.
const MAX_PICTURE_FACE_PX: u32 = 2048;
/// The widest face of the environment, px.
const MAX_SKY_PX: u32 = 512;

/// Why a deep picture is no cube LDI.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum FromDeepError {
    /// A channel is missing.
    #[error("it has no channel {0}; colours (R, G, B) and depth (Z) are needed")]
    Channel(&'static str),
    /// An environment map is not one of six faces.
    #[error(
        "it is an environment map of {0}x{1} pixels; six square faces one above another are read"
    )]
    Faces(u32, u32),
    /// Nothing says where the camera stands.
    #[error(
        "its header says neither that it is a cubic environment map (envmap) nor where its camera stands and what it sees (worldToCamera, \
         worldToNDC); give --fov, and --center and --look-at where the camera is not at the origin looking along -Z"
    )]
    View,
    /// What a header says is said once more.
    #[error("{0} has no meaning for it, as its header {1}; leave it out")]
    Told(&'static str, &'static str),
    /// There is no such camera.
    #[error(transparent)]
    Lens(#[from] CameraError),
    /// The matrices are no camera's.
    #[error("its worldToCamera and worldToNDC are not those of a camera that looks at its picture")]
    Camera,
    /// No sample has a depth.
    #[error("it has no sample with a depth above 0 and an alpha above 0")]
    Empty,
}

/// What of a capture a deep picture does not tell.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeepPlace {
    /// Where it was taken, world metres, if it does not say so itself; the origin if absent.
    pub centre: Option<DVec3>,
    /// Where its camera looked, world metres, if it does not say so itself; along -Z if absent.
    pub look_at: Option<DVec3>,
    /// Degrees between the top and the bottom edge of a camera's picture that does not say so itself.
    pub fov_y_deg: Option<f64>,
    /// Half of the headbox's edge, metres; by the nearest sample if absent.
    pub half_size_m: Option<f64>,
    /// What it is called.
    pub name: String,
}

/// The cube. Depths are taken for metres.
///
/// # Errors
/// [`FromDeepError`].
pub fn cube(image: &DeepImage, place: DeepPlace) -> Result<CubeLdi, FromDeepError> {
    let picture = Picture::new(image, &place)?;
    let nearest = picture.nearest().ok_or(FromDeepError::Empty)?;
    let half_size_m = place.half_size_m.unwrap_or(HEADBOX_SHARE * nearest);
    let face_px = picture.face_px;
    // What is beyond moves by less.
    let still = STILL_PX * 2.0 / (f64::from(face_px) * half_size_m);
    let faces = Face::ALL
        .into_par_iter()
        .map(|face| face_of(&picture, face, still))
        .collect();
    let info = CaptureInfo {
        scene: place.name,
        centre: picture
            .lens
            .map(|lens| lens.eye)
            .or(place.centre)
            .unwrap_or_default(),
        half_size_m,
        exposure: 1.0,
        ahead: picture.lens.map(|lens| lens.ahead),
        ..CaptureInfo::default()
    };
    Ok(CubeLdi {
        info,
        faces,
        environment: sky(&picture, still),
    })
}

/// A sample about the eye.
#[derive(Clone, Copy)]
struct Sample {
    /// 1 / eye depth for a direction of eye depth 1, 1/m; 0 at infinity.
    pub inverse_depth: f64,
    color_srgb: [u8; 4],
}

/// A deep picture as it is asked.
struct Picture<'a> {
    image: &'a DeepImage,
    /// Red, green, blue, depth.
    channels: [&'a [f32]; 4],
    alpha: Option<&'a [f32]>,
    /// Of a camera; none for six faces.
    lens: Option<Lens>,
    face_px: u32,
}

impl<'a> Picture<'a> {
    fn new(image: &'a DeepImage, place: &DeepPlace) -> Result<Self, FromDeepError> {
        let channel = |name| image.channel(name).ok_or(FromDeepError::Channel(name));
        let channels = [channel("R")?, channel("G")?, channel("B")?, channel("Z")?];
        let alpha = image.channel("A");
        let [width, height] = image.size_px;
        let lens = Lens::of(image, place)?;
        let face_px = match &lens {
            // A face pixel in the middle is as wide as one of the picture's.
            Some(lens) => {
                let focal_px = lens
                    .focal_px(image.size_px.map(f64::from))
                    .ok_or(FromDeepError::Camera)?;
                ((2.0 * focal_px).round() as u32).clamp(16, MAX_PICTURE_FACE_PX)
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

    /// Position in the picture, px, of a direction from the eye, and how deep it goes in the camera's axes.
    fn place(&self, direction: DVec3) -> Option<[f64; 3]> {
        let [x, y, depth] = match &self.lens {
            None => {
                let face = Face::containing(direction);
                let [x, y, depth] = face.project(direction, self.face_px);
                [x, y + f64::from(self.face_px) * face.index() as f64, depth]
            }
            Some(lens) => lens.place(direction, self.image.size_px.map(f64::from)),
        };
        (depth > 0.0 && x.is_finite() && y.is_finite()).then_some([x, y, depth])
    }

    /// Distance of what is nearest, metres, along the picture's own depth.
    fn nearest(&self) -> Option<f64> {
        let alpha = |i: usize| self.alpha.map_or(1.0, |values| values[i]);
        let depths = self.channels[3]
            .iter()
            .enumerate()
            .filter(|(i, z)| **z > 0.0 && z.is_finite() && alpha(*i) > 0.0);
        depths.map(|(_, z)| f64::from(*z)).min_by(f64::total_cmp)
    }

    /// What is seen in a direction from the eye, farthest first.
    fn samples(&self, direction: DVec3) -> Vec<Sample> {
        let Some([x, y, depth]) = self.place(direction) else {
            return Vec::new();
        };
        let [width, height] = self.image.size_px.map(f64::from);
        if !(0.0..width).contains(&x) || !(0.0..height).contains(&y) {
            return Vec::new();
        }
        let mut samples: Vec<Sample> = self
            .image
            .samples_at(x as u32, y as u32)
            .filter_map(|i| self.sample(i, depth))
            .collect();
        samples.sort_by(|a, b| a.inverse_depth.total_cmp(&b.inverse_depth));
        samples
    }

    /// A sample in a direction that goes so deep in the picture's axes.
    fn sample(&self, i: usize, depth: f64) -> Option<Sample> {
        let [r, g, b, z] = self.channels.map(|values| values[i]);
        let alpha = self.alpha.map_or(1.0, |values| values[i]).min(1.0);
        let level = (alpha * 255.0).round() as u8;
        if level == 0 || z.is_nan() || z <= 0.0 {
            return None;
        }
        let [r, g, b] = [r, g, b].map(|c| srgb8_from_linear(c / alpha));
        Some(Sample {
            inverse_depth: depth / f64::from(z),
            color_srgb: [r, g, b, level],
        })
    }
}

fn face_of(picture: &Picture, face: Face, still: f64) -> LayeredDepthImage {
    let face_px = picture.face_px;
    let rows: Vec<Vec<Vec<Sample>>> = (0..face_px)
        .into_par_iter()
        .map(|y| {
            let at = |x: u32| {
                picture.samples(face.direction(f64::from(x) + 0.5, f64::from(y) + 0.5, face_px))
            };
            (0..face_px)
                .map(|x| {
                    at(x)
                        .into_iter()
                        .filter(|sample| sample.inverse_depth > still)
                        .collect()
                })
                .collect()
        })
        .collect();
    let mut image = LayeredDepthImage::empty(face, face_px);
    for at in 0..face_px * face_px {
        let (x, y) = ((at % face_px) as usize, (at / face_px) as usize);
        image
            .samples
            .extend(rows[y][x].iter().map(|sample| DepthPixel {
                inverse_depth: sample.inverse_depth as f32,
                normal: EncodedNormal::new(
                    normal(&rows, face, [x, y], sample.inverse_depth).as_vec3(),
                ),
                color_srgb: sample.color_srgb,
            }));
        image.offsets[at as usize + 1] = image.samples.len() as u32;
    }
    image
}

/// The normal of the plane through a sample and its neighbours, toward the eye: on a plane n . P = 1 inverse depth is n . direction.
fn normal(rows: &[Vec<Vec<Sample>>], face: Face, [x, y]: [usize; 2], q: f64) -> DVec3 {
    let nearest = |x: Option<usize>, y: Option<usize>| {
        let samples = rows
            .get(y?)?
            .get(x?)?
            .iter()
            .map(|sample| sample.inverse_depth);
        samples.min_by(|a, b| (a - q).abs().total_cmp(&(b - q).abs()))
    };
    // Over a gap the side that changes less is the surface's own.
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

/// What lies at infinity; of size 0 if nothing does.
fn sky(picture: &Picture, still: f64) -> Environment {
    let size_px = picture.face_px.min(MAX_SKY_PX);
    let per_face = size_px * size_px;
    let texel = |at: u32| {
        let (x, y) = (at % per_face % size_px, at % per_face / size_px);
        let direction = Face::ALL[(at / per_face) as usize].direction(
            f64::from(x) + 0.5,
            f64::from(y) + 0.5,
            size_px,
        );
        let far = picture
            .samples(direction)
            .into_iter()
            .find(|sample| sample.inverse_depth <= still);
        far.map_or([0; 4], |sample| {
            [
                sample.color_srgb[0],
                sample.color_srgb[1],
                sample.color_srgb[2],
                255,
            ]
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
        let (mut offsets, mut values) = (vec![0u32], [const { Vec::new() }; 5]);
        for at in 0..6 * n * n {
            let face = Face::ALL[(at / (n * n)) as usize];
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
        let (size_px, view) = (
            [n, 6 * n],
            DeepView {
                cube: true,
                ..DeepView::default()
            },
        );
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
    fn a_room_with_half_a_roof() {
        let place = DeepPlace {
            centre: Some(DVec3::new(1.0, 2.0, 3.0)),
            ..DeepPlace::default()
        };
        let cube = cube(&room(16), place).expect("a cube");
        assert_eq!(cube.info.centre, DVec3::new(1.0, 2.0, 3.0));
        assert!((cube.info.half_size_m - 0.3).abs() < 1e-12);
        for image in &cube.faces {
            assert_eq!(
                image.samples.len(),
                256,
                "{:?}: a sample a pixel, the sky apart",
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
                let (color, roof) = (sample.color_srgb, image.face == Face::PosY);
                // Half of red over alpha of half is red; 128 of 255 is half.
                assert_eq!(
                    color,
                    if roof {
                        [255, 0, 0, 128]
                    } else {
                        [124, 170, 203, 255]
                    }
                );
            }
        }
        let sky = cube.environment.sample(glam::Vec3::Y);
        assert_eq!(
            (sky, cube.environment.sample(glam::Vec3::X)),
            (Some([0, 0, 255]), None)
        );
    }

    #[test]
    fn what_is_no_such_picture_is_told() {
        let with = |change: &dyn Fn(&mut DeepImage)| {
            let mut image = room(4);
            change(&mut image);
            cube(&image, DeepPlace::default())
                .map(|_| ())
                .expect_err("refused")
        };
        assert_eq!(
            with(&|image| image.channels.retain(|channel| channel.name != "Z")),
            FromDeepError::Channel("Z")
        );
        assert_eq!(with(&|image| image.view.cube = false), FromDeepError::View);
        assert_eq!(
            with(&|image| image.size_px = [4, 8]),
            FromDeepError::Faces(4, 8)
        );
        let no_camera = Some([0.0; 16]);
        let view = DeepView {
            cube: false,
            world_to_camera: no_camera,
            world_to_ndc: no_camera,
        };
        assert_eq!(with(&|image| image.view = view), FromDeepError::Camera);
        assert_eq!(
            with(&|image| image.channels[0].values.fill(f32::NAN)),
            FromDeepError::Empty
        );
    }
}
