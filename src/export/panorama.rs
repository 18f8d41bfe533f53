//! All directions about an eye in one picture: equirectangular, as players of 360-degree films have it.

use crate::capture::rig::Face;
use crate::capture::{Camera, CameraError};
use glam::{DMat3, DVec3};
use image::RgbImage;
use std::f64::consts::{PI, TAU};

/// By how much a face is wider than 90 degrees, as a share: pixels between two faces have neighbours on either.
const OVERLAP: f64 = 1.02;

/// A picture of all directions about the eye of a camera, which looks at its middle; level, twice as wide as high. `draw`
/// makes a frame of a camera.
///
/// # Errors
/// [`CameraError`], and what `draw` reports.
pub fn equirectangular<E: From<CameraError>>(
    camera: &Camera,
    height: u32,
    mut draw: impl FnMut(&Camera) -> Result<RgbImage, E>,
) -> Result<RgbImage, E> {
    let level = DVec3::new(camera.forward().x, 0.0, camera.forward().z).try_normalize().unwrap_or(DVec3::NEG_Z);
    let world_from_level = DMat3::from_cols(level.cross(DVec3::Y), DVec3::Y, -level);
    // A face has as many pixels a degree in its middle as the panorama at its horizon, twice.
    let size = (f64::from(height) * 4.0 / PI).ceil().max(16.0) as u32;
    let focal_px = f64::from(size) / 2.0 / OVERLAP;
    let mut faces = Vec::with_capacity(6);
    for face in Face::ALL {
        let rotation = world_from_level * face.world_from_eye();
        faces.push(draw(&Camera::from_parts(camera.eye(), rotation, focal_px, size, size)?)?);
    }
    Ok(RgbImage::from_fn(2 * height, height, |x, y| {
        let direction = direction([f64::from(x) + 0.5, f64::from(y) + 0.5], f64::from(height));
        let (face, [right, up, depth]) = Face::locate(direction.as_vec3());
        let middle = size as f32 / 2.0;
        let at = [right, -up].map(|c| middle + c / depth * focal_px as f32 - 0.5);
        bilinear(&faces[face.index()], at)
    }))
}

/// The direction of a position in pixels; the middle looks along -Z.
fn direction([x, y]: [f64; 2], height: f64) -> DVec3 {
    let (longitude, latitude) = ((x / (2.0 * height) - 0.5) * TAU, (0.5 - y / height) * PI);
    DVec3::new(longitude.sin() * latitude.cos(), latitude.sin(), -longitude.cos() * latitude.cos())
}

fn bilinear(picture: &RgbImage, [x, y]: [f32; 2]) -> image::Rgb<u8> {
    let (left, top) = (x.floor(), y.floor());
    let at = |dx: f32, dy: f32| {
        let inside = |v: f32, size: u32| v.clamp(0.0, size as f32 - 1.0) as u32;
        picture.get_pixel(inside(left + dx, picture.width()), inside(top + dy, picture.height())).0.map(f32::from)
    };
    let (u, v) = (x - left, y - top);
    let [a, b, c, d] = [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)];
    image::Rgb(std::array::from_fn(|i| {
        let (upper, lower) = (a[i] + (b[i] - a[i]) * u, c[i] + (d[i] - c[i]) * u);
        (upper + (lower - upper) * v + 0.5) as u8
    }))
}

/// Two frames side by side, the left eye's on the left; the eyes are `distance_m` apart.
///
/// # Errors
/// What `draw` reports.
pub fn side_by_side<E>(
    camera: &Camera,
    distance_m: f64,
    mut draw: impl FnMut(&Camera) -> Result<RgbImage, E>,
) -> Result<RgbImage, E> {
    let aside = camera.world_from_eye().x_axis * (distance_m / 2.0);
    let left = draw(&camera.with_eye(camera.eye() - aside))?;
    let right = draw(&camera.with_eye(camera.eye() + aside))?;
    let mut both = RgbImage::new(left.width() + right.width(), left.height().max(right.height()));
    image::imageops::replace(&mut both, &left, 0, 0);
    image::imageops::replace(&mut both, &right, i64::from(left.width()), 0);
    Ok(both)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bilinear look-up of a colour that is smooth in the direction: 8 bits, rounded twice.
    const LEVELS: u8 = 3;

    #[test]
    fn every_direction_is_where_it_belongs() {
        let color = |d: DVec3| (d.normalize() * 100.0 + 128.0).to_array().map(|c| c as u8);
        let camera = Camera::look_at(DVec3::ONE, DVec3::new(2.0, 1.4, 0.5), DVec3::Y, 60.0, [10, 10]).unwrap();
        let picture = equirectangular(&camera, 64, |camera| {
            Ok::<_, CameraError>(RgbImage::from_fn(camera.width(), camera.height(), |x, y| {
                image::Rgb(color(camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5)))
            }))
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
    fn the_left_eye_is_on_the_left() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [4, 3]).unwrap();
        let both = side_by_side(&camera, 0.5, |camera| {
            let level = if camera.eye().x < 0.0 { 10 } else { 200 };
            Ok::<_, CameraError>(RgbImage::from_pixel(4, 3, image::Rgb([level; 3])))
        });
        let both = both.unwrap();
        assert_eq!((both.dimensions(), both.get_pixel(1, 1).0[0], both.get_pixel(6, 1).0[0]), ((8, 3), 10, 200));
    }
}
