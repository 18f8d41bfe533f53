//! Stereo images: side by side, in all directions (omni-directional stereo, ODS) and of the front
//! half sphere (VR180).
//!
//! An ODS image suits every heading: each column is rendered for the head turned toward it. The
//! eyes move on a circle, and a column's rays leave it along its tangents (*Rendering
//! Omni-directional Stereo Content*, Google, 2015). Here a few columns share an eye.

use crate::film::panorama::{bilinear, equirectangular, half_sphere, level_axes};
use glam::{DMat3, DVec3};
use headbox_core::camera::{Camera, CameraError};
use image::RgbImage;
use image::imageops::replace;
use std::f64::consts::{FRAC_PI_4, FRAC_PI_8, PI, TAU};

/// Projection of the surroundings onto an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum View {
    /// The camera's own frame.
    Frame,
    /// Frames of two eyes at this distance, metres, the left one on the left.
    SideBySide(f64),
    /// All directions, equirectangular.
    Panorama,
    /// All directions for two eyes at this distance, metres, the left one above.
    StereoPanorama(f64),
    /// 180 by 180 degrees for two eyes at this distance, metres, the left one on the left.
    HalfSpheres(f64),
}

/// Largest angle between the eye of a column and its exact position, radians: at a distance of 1 m
/// and 64 mm between the eyes, points are displaced by 0.2 mm.
const MAX_EYE_ANGLE: f64 = TAU / 1024.0;
/// Margin of a strip beyond the columns that are taken from it, pixels.
const MARGIN_PX: f64 = 2.0;

impl View {
    /// Returns the width and height of the image that [`Self::draw`] makes of a camera with a frame
    /// of this size. A panorama has the height of the frame for each eye.
    pub fn size_px(self, [width, height]: [u32; 2]) -> [u32; 2] {
        match self {
            Self::Frame => [width, height],
            Self::SideBySide(_) => [2 * width, height],
            Self::Panorama | Self::HalfSpheres(_) => [2 * height, height],
            Self::StereoPanorama(_) => [2 * height, 2 * height],
        }
    }

    /// Renders the image of a camera; `draw` renders the frames that it is composed of.
    ///
    /// # Errors
    /// [`CameraError`], and errors of `draw`.
    pub fn draw<E: From<CameraError>>(
        self,
        camera: &Camera,
        mut draw: impl FnMut(&Camera) -> Result<RgbImage, E>,
    ) -> Result<RgbImage, E> {
        let height = camera.height();
        let eyes = |distance_m: f64, axes: DMat3| {
            let aside = axes.x_axis * (distance_m / 2.0);
            [
                camera.with_eye(camera.eye() - aside),
                camera.with_eye(camera.eye() + aside),
            ]
        };
        let (first, second, at) = match self {
            Self::Frame => return draw(camera),
            Self::Panorama => return equirectangular(camera, height, draw),
            Self::SideBySide(distance_m) => {
                let [left, right] = eyes(distance_m, camera.world_from_eye());
                (draw(&left)?, draw(&right)?, [i64::from(camera.width()), 0])
            }
            Self::HalfSpheres(distance_m) => {
                let [left, right] = eyes(distance_m, level_axes(camera));
                let left = half_sphere(&left, height, &mut draw)?;
                (
                    left,
                    half_sphere(&right, height, &mut draw)?,
                    [i64::from(height), 0],
                )
            }
            Self::StereoPanorama(distance_m) => {
                let left = rotating_eye(camera, height, -distance_m / 2.0, &mut draw)?;
                (
                    left,
                    rotating_eye(camera, height, distance_m / 2.0, &mut draw)?,
                    [0, i64::from(height)],
                )
            }
        };
        let [width, height] = self.size_px([camera.width(), height]);
        let mut both = RgbImage::new(width, height);
        replace(&mut both, &first, 0, 0);
        replace(&mut both, &second, at[0], at[1]);
        Ok(both)
    }
}

/// Renders all directions from an eye that is `aside_m` to the right of the centre as seen in the
/// direction of each column.
fn rotating_eye<E: From<CameraError>>(
    camera: &Camera,
    height: u32,
    aside_m: f64,
    draw: &mut impl FnMut(&Camera) -> Result<RgbImage, E>,
) -> Result<RgbImage, E> {
    let (width, level) = (2 * height, level_axes(camera));
    let column = TAU / f64::from(width);
    let in_strip = ((2.0 * MAX_EYE_ANGLE / column).floor() as u32).clamp(1, width);
    let mut picture = RgbImage::new(width, height);
    for first in (0..width).step_by(in_strip as usize) {
        let columns = first..(first + in_strip).min(width);
        let middle = (f64::from(columns.start + columns.end) / 2.0 - f64::from(height)) * column;
        let axes = level * DMat3::from_rotation_y(-middle);
        let eye = camera.eye() + axes.x_axis * aside_m;
        let strips = Strips::new(
            eye,
            axes,
            height,
            f64::from(columns.end - columns.start) * column / 2.0,
            draw,
        )?;
        for x in columns {
            let turn = (f64::from(x) + 0.5 - f64::from(height)) * column - middle;
            (0..height).for_each(|y| {
                let elevation = (0.5 - (f64::from(y) + 0.5) / f64::from(height)) * PI;
                picture.put_pixel(x, y, strips.color(turn, elevation));
            });
        }
    }
    Ok(picture)
}

/// Three narrow frames of one eye, from the nadir to the zenith.
struct Strips {
    focal_px: f64,
    /// Frames below, at and above the horizon.
    frames: [RgbImage; 3],
}

impl Strips {
    /// The middle frame covers 90 degrees of elevation, each of the others 45.
    const ELEVATIONS: [f64; 3] = [-3.0 * FRAC_PI_8, 0.0, 3.0 * FRAC_PI_8];
    const HALVES: [f64; 3] = [FRAC_PI_8, FRAC_PI_4, FRAC_PI_8];

    /// Renders columns up to `half` radians to either side of the direction of the axes (right, up,
    /// back).
    fn new<E: From<CameraError>>(
        eye: DVec3,
        axes: DMat3,
        height: u32,
        half: f64,
        draw: &mut impl FnMut(&Camera) -> Result<RgbImage, E>,
    ) -> Result<Self, E> {
        // Twice as many pixels per degree as the image.
        let focal_px = 2.0 * f64::from(height) / PI;
        let side = |half: f64| (2.0 * (focal_px * half.tan() + MARGIN_PX)).ceil() as u32;
        let mut frame = |i: usize| {
            let rotation = axes * DMat3::from_rotation_x(Self::ELEVATIONS[i]);
            draw(&Camera::from_parts(
                eye,
                rotation,
                focal_px,
                side(half),
                side(Self::HALVES[i]),
            )?)
        };
        Ok(Self {
            focal_px,
            frames: [frame(0)?, frame(1)?, frame(2)?],
        })
    }

    fn color(&self, turn: f64, elevation: f64) -> image::Rgb<u8> {
        let i = if elevation.abs() <= FRAC_PI_4 {
            1
        } else {
            2 * usize::from(elevation > 0.0)
        };
        let direction = DVec3::new(
            turn.sin() * elevation.cos(),
            elevation.sin(),
            -turn.cos() * elevation.cos(),
        );
        let seen = DMat3::from_rotation_x(-Self::ELEVATIONS[i]) * direction;
        let frame = &self.frames[i];
        let at = [(seen.x, frame.width()), (-seen.y, frame.height())].map(|(aside, side)| {
            (f64::from(side) / 2.0 - aside / seen.z * self.focal_px - 0.5) as f32
        });
        bilinear(frame, at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A world that is a colour for each direction at infinity, but for a pole: a vertical line,
    /// red, at a distance.
    fn draw(camera: &Camera, pole: DVec3) -> RgbImage {
        RgbImage::from_fn(camera.width(), camera.height(), |x, y| {
            let d = camera
                .direction(f64::from(x) + 0.5, f64::from(y) + 0.5)
                .normalize();
            let to = (pole - camera.eye()) * DVec3::new(1.0, 0.0, 1.0);
            let level = (d * DVec3::new(1.0, 0.0, 1.0)).normalize();
            let on_pole = level.cross(to).length() < 0.02 && level.dot(to) > 0.0;
            let color = (d * 100.0 + 128.0).to_array().map(|c| c as u8);
            image::Rgb(if on_pole { [255, 0, 0] } else { color })
        })
    }

    /// Finds the pole in a row, pixels; its middle.
    fn pole_at(picture: &RgbImage, y: u32) -> f64 {
        let red = (0..picture.width())
            .filter(|x| picture.get_pixel(*x, y).0[0] > 240 && picture.get_pixel(*x, y).0[1] < 40);
        let red: Vec<f64> = red.map(|x| f64::from(x) + 0.5).collect();
        red.iter().sum::<f64>() / red.len() as f64
    }

    #[test]
    fn stereo_columns_match_turned_head() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [64, 256]).unwrap();
        let (distance_m, height) = (0.3, 256u32);
        for azimuth in [0.0f64, 1.0, -2.2, 3.0] {
            let pole = DVec3::new(azimuth.sin(), 0.0, -azimuth.cos()) * 1.5;
            let both = View::StereoPanorama(distance_m)
                .draw(&camera, |camera| Ok::<_, CameraError>(draw(camera, pole)))
                .unwrap();
            assert_eq!(both.dimensions(), (512, 512));
            // A ray along the tangent of a circle of radius r meets what is R away at asin(r / R)
            // from its own azimuth.
            let aside = (distance_m / 2.0 / 1.5f64).asin();
            for (row, sign) in [
                (height / 2, 1.0),
                (height / 2 + 40, 1.0),
                (height + height / 2, -1.0),
            ] {
                let expected = (azimuth + sign * aside) / TAU * 512.0 + 256.0;
                let found = pole_at(&both, row);
                // Half a pixel for finding the pole, and 0.15 for eyes that columns share.
                assert!(
                    (found - expected).abs() < 0.65,
                    "{azimuth} {row}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn zero_eye_distance_gives_panorama() {
        let camera = Camera::look_at(
            DVec3::ONE,
            DVec3::new(2.0, 1.4, 0.5),
            DVec3::Y,
            60.0,
            [64, 64],
        )
        .unwrap();
        let far = DVec3::new(1e9, 0.0, 0.7e9);
        let both = View::StereoPanorama(0.0)
            .draw(&camera, |camera| Ok::<_, CameraError>(draw(camera, far)))
            .unwrap();
        let one = View::Panorama
            .draw(&camera, |camera| Ok::<_, CameraError>(draw(camera, far)))
            .unwrap();
        for (x, y, pixel) in one.enumerate_pixels() {
            for below in [0, 64] {
                let found = both.get_pixel(x, y + below).0;
                // Two pictures of 8 bits, looked up between pixels.
                assert!(
                    (0..3).all(|i| found[i].abs_diff(pixel.0[i]) <= 3),
                    "{x} {y}: {found:?} {pixel:?}"
                );
            }
        }
    }

    #[test]
    fn left_eye_is_on_the_left() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [4, 3]).unwrap();
        for (view, size, right) in [
            (View::SideBySide(0.5), (8, 3), 6),
            (View::HalfSpheres(0.5), (6, 3), 4),
        ] {
            let both = view.draw(&camera, |camera| {
                let level = if camera.eye().x < 0.0 { 10 } else { 200 };
                Ok::<_, CameraError>(RgbImage::from_pixel(
                    camera.width(),
                    camera.height(),
                    image::Rgb([level; 3]),
                ))
            });
            let both = both.unwrap();
            let levels = (both.get_pixel(1, 1).0[0], both.get_pixel(right, 1).0[0]);
            assert_eq!((both.dimensions(), levels), (size, (10, 200)));
        }
    }
}
