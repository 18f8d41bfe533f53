//! All directions about an eye in one picture: equirectangular, as players of 360-degree films have
//! it.

use glam::{DMat3, DVec3};
use headbox_core::camera::{Camera, CameraError};
use headbox_core::cube_face::Face;
use headbox_core::texels;
use image::RgbImage;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// By how much a face is wider than 90 degrees, as a share: pixels between two faces have
/// neighbours on either.
const OVERLAP: f64 = 1.02;

/// A picture of all directions about the eye of a camera, which looks at its middle; level, twice
/// as wide as high. `draw` makes a frame of a camera.
///
/// # Errors
/// [`CameraError`], and what `draw` reports.
pub fn equirectangular<E: From<CameraError>>(
    camera: &Camera,
    height: u32,
    draw: impl FnMut(&Camera) -> Result<RgbImage, E>,
) -> Result<RgbImage, E> {
    columns(camera, height, 0..2 * height, draw)
}

/// Renders the half sphere before a camera, 180 by 180 degrees: the middle half of
/// [`equirectangular`].
///
/// # Errors
/// [`CameraError`], and what `draw` reports.
pub fn half_sphere<E: From<CameraError>>(
    camera: &Camera,
    height: u32,
    draw: impl FnMut(&Camera) -> Result<RgbImage, E>,
) -> Result<RgbImage, E> {
    let first = height / 2;
    columns(camera, height, first..first + height, draw)
}

/// Some columns of the picture of all directions; only faces of a cube that they look through are
/// drawn.
fn columns<E: From<CameraError>>(
    camera: &Camera,
    height: u32,
    columns: Range<u32>,
    mut draw: impl FnMut(&Camera) -> Result<RgbImage, E>,
) -> Result<RgbImage, E> {
    let world_from_level = level(camera);
    // A face has as many pixels a degree in its middle as the panorama at its horizon, twice.
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

/// The axes of a picture whose middle is where a camera looks, but level: right, up, back.
pub(super) fn level(camera: &Camera) -> DMat3 {
    let ahead = DVec3::new(camera.forward().x, 0.0, camera.forward().z)
        .try_normalize()
        .unwrap_or(DVec3::NEG_Z);
    DMat3::from_cols(ahead.cross(DVec3::Y), DVec3::Y, -ahead)
}

/// The direction of a position in pixels; the middle looks along -Z.
fn direction([x, y]: [f64; 2], height: f64) -> DVec3 {
    let (longitude, latitude) = ((x / (2.0 * height) - 0.5) * TAU, (0.5 - y / height) * PI);
    DVec3::new(
        longitude.sin() * latitude.cos(),
        latitude.sin(),
        -longitude.cos() * latitude.cos(),
    )
}

pub(super) fn bilinear(picture: &RgbImage, [x, y]: [f32; 2]) -> image::Rgb<u8> {
    let (left, top) = (x.floor(), y.floor());
    let at = |dx: f32, dy: f32| {
        let inside = |v: f32, size: u32| v.clamp(0.0, size as f32 - 1.0) as u32;
        picture
            .get_pixel(
                inside(left + dx, picture.width()),
                inside(top + dy, picture.height()),
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
    fn every_direction_is_where_it_belongs() {
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
    fn the_half_before_the_eye_is_the_middle_of_all() {
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
