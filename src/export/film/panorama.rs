//! Equirectangular panoramas, as players of 360-degree films expect them.

use glam::{DMat3, DVec3};
use headbox_core::camera::{Camera, CameraError};
use headbox_core::cube_face::Face;
use headbox_core::image::texels;
use image::RgbImage;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// Width of a face relative to 90 degrees: pixels between two faces have neighbours on either.
const OVERLAP: f64 = 1.02;

/// Renders all directions about a camera's eye, centred on its heading; level, twice as wide as
/// high. `draw` renders the frame of a camera.
///
/// # Errors
/// [`CameraError`], and errors of `draw`.
pub fn equirectangular<E: From<CameraError>>(
    camera: &Camera,
    height: u32,
    draw: impl FnMut(&Camera) -> Result<RgbImage, E>,
) -> Result<RgbImage, E> {
    columns(camera, height, 0..2 * height, draw)
}

/// Renders the half sphere in front of a camera, 180 by 180 degrees: the middle half of
/// [`equirectangular`].
///
/// # Errors
/// [`CameraError`], and errors of `draw`.
pub fn half_sphere<E: From<CameraError>>(
    camera: &Camera,
    height: u32,
    draw: impl FnMut(&Camera) -> Result<RgbImage, E>,
) -> Result<RgbImage, E> {
    let first = height / 2;
    columns(camera, height, first..first + height, draw)
}

/// Renders some columns of the panorama; only draws the cube faces that these columns sample.
fn columns<E: From<CameraError>>(
    camera: &Camera,
    height: u32,
    columns: Range<u32>,
    mut draw: impl FnMut(&Camera) -> Result<RgbImage, E>,
) -> Result<RgbImage, E> {
    let world_from_level = level_axes(camera);
    // A face has twice as many pixels per degree at its centre as the panorama at its horizon.
    let size = (f64::from(height) * 4.0 / PI).ceil().max(16.0) as u32;
    let focal_px = f64::from(size) / 2.0 / OVERLAP;
    let located = |x: u32, y: u32| {
        let at = [f64::from(columns.start + x) + 0.5, f64::from(y) + 0.5];
        Face::locate(direction(at, f64::from(height)).as_vec3())
    };
    let width = columns.end - columns.start;
    let mut seen = [false; 6];
    (0..height).for_each(|y| (0..width).for_each(|x| seen[located(x, y).0.index()] = true));
    let mut faces = Vec::with_capacity(6);
    for (face, seen) in Face::ALL.into_iter().zip(seen) {
        let rotation = world_from_level * face.world_from_eye();
        let camera = Camera::from_parts(camera.eye(), rotation, focal_px, size, size)?;
        faces.push(if seen {
            draw(&camera)?
        } else {
            RgbImage::default()
        });
    }
    Ok(RgbImage::from_fn(width, height, |x, y| {
        let (face, [right, up, depth]) = located(x, y);
        let middle = size as f32 / 2.0;
        let at = [right, -up].map(|c| middle + c / depth * focal_px as f32 - 0.5);
        bilinear(&faces[face.index()], at)
    }))
}

/// Returns the axes of a panorama centred on a camera's heading, but level: right, up, back.
pub(crate) fn level_axes(camera: &Camera) -> DMat3 {
    let ahead = DVec3::new(camera.forward().x, 0.0, camera.forward().z)
        .try_normalize()
        .unwrap_or(DVec3::NEG_Z);
    DMat3::from_cols(ahead.cross(DVec3::Y), DVec3::Y, -ahead)
}

/// Returns the direction of a position in pixels; the centre looks along -Z.
fn direction([x, y]: [f64; 2], height: f64) -> DVec3 {
    let (longitude, latitude) = ((x / (2.0 * height) - 0.5) * TAU, (0.5 - y / height) * PI);
    DVec3::new(
        longitude.sin() * latitude.cos(),
        latitude.sin(),
        -longitude.cos() * latitude.cos(),
    )
}

pub(crate) fn bilinear(picture: &RgbImage, [x, y]: [f32; 2]) -> image::Rgb<u8> {
    let (left, top) = (x.floor(), y.floor());
    let at = |dx: f32, dy: f32| {
        let clamp = |v: f32, size: u32| v.clamp(0.0, size as f32 - 1.0) as u32;
        picture
            .get_pixel(
                clamp(left + dx, picture.width()),
                clamp(top + dy, picture.height()),
            )
            .0
            .map(f32::from)
    };
    let (u, v) = (x - left, y - top);
    let [a, b, c, d] = [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)];
    image::Rgb(std::array::from_fn(|i| {
        (texels::bilinear([a[i], b[i], c[i], d[i]], [u, v]) + 0.5) as u8
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bilinear look-up of a colour that is smooth in the direction: 8 bits, rounded twice.
    const LEVELS: u8 = 3;

    #[test]
    fn panorama_shows_every_direction() {
        let color = |d: DVec3| (d.normalize() * 100.0 + 128.0).to_array().map(|c| c as u8);
        let camera = Camera::look_at(
            DVec3::ONE,
            DVec3::new(2.0, 1.4, 0.5),
            DVec3::Y,
            60.0,
            [10, 10],
        )
        .unwrap();
        let picture = equirectangular(&camera, 64, |camera| {
            Ok::<_, CameraError>(RgbImage::from_fn(
                camera.width(),
                camera.height(),
                |x, y| {
                    image::Rgb(color(
                        camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5),
                    ))
                },
            ))
        });
        let picture = picture.unwrap();
        let level = DVec3::new(1.0, 0.0, -0.5).normalize();
        let world = DMat3::from_cols(level.cross(DVec3::Y), DVec3::Y, -level);
        for (x, y, pixel) in picture.enumerate_pixels() {
            let expected = color(world * direction([f64::from(x) + 0.5, f64::from(y) + 0.5], 64.0));
            let off = (0..3).map(|i| pixel.0[i].abs_diff(expected[i])).max();
            assert!(off <= Some(LEVELS), "{x} {y}: {:?} {expected:?}", pixel.0);
        }
    }

    #[test]
    fn half_sphere_is_middle_of_panorama() {
        let camera = Camera::look_at(
            DVec3::ONE,
            DVec3::new(2.0, 1.4, 0.5),
            DVec3::Y,
            60.0,
            [10, 10],
        )
        .unwrap();
        let mut drawn = 0;
        let mut draw = |camera: &Camera| {
            drawn += 1;
            let color = |x, y| {
                (camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5) * 30.0 + 128.0).to_array()
            };
            Ok::<_, CameraError>(RgbImage::from_fn(
                camera.width(),
                camera.height(),
                |x, y| image::Rgb(color(x, y).map(|c| c as u8)),
            ))
        };
        let half = half_sphere(&camera, 32, &mut draw).unwrap();
        let all = equirectangular(&camera, 32, &mut draw).unwrap();
        assert_eq!((half.dimensions(), drawn), ((32, 32), 5 + 6));
        assert_eq!(
            half,
            image::imageops::crop_imm(&all, 16, 0, 32, 32).to_image()
        );
    }
}
