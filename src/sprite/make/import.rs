//! Import of a sprite with depth from a colour image and a depth image.

use crate::{Displacement, DisplacementFormat, Sprite, SpriteError, SpritePlane, SpriteWithDepth};
use headbox_core::camera::Camera;
use headbox_core::depth_kind::DepthKind;
use headbox_core::memory;
use image::RgbaImage;

/// Memory for each pixel, bytes: an inverse depth that may be unknown, the same with a position as
/// a sample of the plane, and what its median sorts.
const BYTES_PER_PIXEL: usize = 16 + 24 + 8;

/// A colour image with a depth per pixel, its camera, and the meaning of the depths.
#[derive(Clone, Debug)]
pub struct DepthImport<'a> {
    /// 8-bit sRGB, straight alpha.
    pub color: RgbaImage,
    /// The camera that took the image.
    pub camera: Camera,
    /// Depth per pixel, row-major. NaN, infinite, zero and negative depths are unknown.
    pub depth: &'a [f32],
    /// Meaning of the depth values.
    pub depth_kind: DepthKind,
    /// Near and far plane, metres, of [`DepthKind::WindowDepth`] (0 at near, 1 at far; far may be
    /// infinite) and [`DepthKind::ReversedWindowDepth`] (1 at near, 0 at far). Ignored otherwise.
    pub window_range_m: (f64, f64),
    /// The sprite's plane; fitted to the visible pixels if not given.
    pub plane: Option<SpritePlane>,
    /// Storage format of displacements.
    pub format: DisplacementFormat,
}

impl DepthImport<'_> {
    /// Builds the sprite. Transparent pixels and pixels of unknown depth take the displacement of
    /// the nearest known pixel, so that the neighbourhood of a silhouette moves with it. If all
    /// pixels are transparent and no depth is known, the sprite is flat, one metre away, and draws
    /// nothing.
    ///
    /// # Errors
    /// [`SpriteError::Count`] unless there is a depth per pixel; [`SpriteError::NoValidDepth`] if
    /// some pixels are visible but none of them has a depth; [`SpriteError::DepthRange`];
    /// [`SpriteError::Memory`]; those of [`Sprite::new`].
    pub fn build(self) -> Result<SpriteWithDepth, SpriteError> {
        let (width, height) = self.color.dimensions();
        let size = (self.camera.width(), self.camera.height());
        SpriteError::check_sizes("colour", (width, height), "camera", size)?;
        if self.depth.len() != width as usize * height as usize {
            return Err(SpriteError::Count {
                expected: width as usize * height as usize,
                found: self.depth.len(),
            });
        }
        let (near, far) = self.window_range_m;
        let is_window = matches!(
            self.depth_kind,
            DepthKind::WindowDepth | DepthKind::ReversedWindowDepth
        );
        if is_window && !(near > 0.0 && far > near && near.is_finite()) {
            return Err(SpriteError::DepthRange { near, far });
        }
        let _memory = memory::reserve((BYTES_PER_PIXEL * self.depth.len()) as u64)?;
        let inverse_depths = self.inverse_depths();
        let all_transparent = self.color.pixels().all(|p| p.0[3] == 0);
        let samples: Vec<[f64; 3]> = pixel_centers(width, height)
            .zip(&inverse_depths)
            .zip(self.color.pixels())
            .filter_map(|(([x, y], q), pixel)| q.filter(|_| pixel.0[3] > 0).map(|q| [x, y, q]))
            .collect();
        let plane = match self.plane {
            Some(plane) => plane,
            None if all_transparent => SpritePlane::parallel_to_image(&self.camera, 1.0),
            None => SpritePlane::fit(&self.camera, &samples)?,
        };
        if samples.is_empty() && !all_transparent {
            return Err(SpriteError::NoValidDepth);
        }
        drop(samples);
        let sprite = Sprite::new(self.color, self.camera, plane)?;
        let distance = sprite.plane().signed_distance(self.camera.eye());
        // d1 = signed distance / Z = distance (1/Z - 1/Z on the plane).
        let displacement = |([x, y], q): ([f64; 2], Option<f64>)| {
            q.map(|q| (distance * (q - sprite.plane().inverse_depth(&self.camera, x, y))) as f32)
        };
        let visible = sprite.color().pixels().map(|p| p.0[3] > 0);
        let known: Vec<Option<f32>> = pixel_centers(width, height)
            .zip(inverse_depths)
            .map(displacement)
            .zip(visible)
            .map(|(d, visible)| d.filter(|d| visible && d.is_finite()))
            .collect();
        let values = fill_unknown(known, width as usize);
        let displacement = Displacement::new(width, height, &values, self.format)?;
        SpriteWithDepth::new(sprite, displacement)
    }

    /// Returns the inverse eye depth of each pixel, 1/m; `None` if unknown.
    fn inverse_depths(&self) -> Vec<Option<f64>> {
        let (near, far) = self.window_range_m;
        let convert = |([x, y], &depth): ([f64; 2], &f32)| {
            let depth = f64::from(depth);
            let inverse_depth = match self.depth_kind {
                DepthKind::EyeDepth => 1.0 / depth,
                DepthKind::RayDistance => self.camera.direction(x, y).length() / depth,
                // depth = far / (far - near) * (1 - near / Z) (C1); the far plane itself is
                // background.
                DepthKind::WindowDepth if !(0.0..1.0).contains(&depth) => f64::NAN,
                DepthKind::WindowDepth => (1.0 - depth * (1.0 - near / far)) / near,
                DepthKind::ReversedWindowDepth if !(depth > 0.0 && depth <= 1.0) => f64::NAN,
                DepthKind::ReversedWindowDepth => (near / far + depth * (1.0 - near / far)) / near,
            };
            (inverse_depth.is_finite() && inverse_depth > 0.0).then_some(inverse_depth)
        };
        pixel_centers(self.camera.width(), self.camera.height())
            .zip(self.depth)
            .map(convert)
            .collect()
    }
}

/// Returns the centres of all pixels, row by row.
fn pixel_centers(width: u32, height: u32) -> impl Iterator<Item = [f64; 2]> {
    (0..height).flat_map(move |y| (0..width).map(move |x| [f64::from(x) + 0.5, f64::from(y) + 0.5]))
}

/// Fills unknown pixels with the value of the nearest known one, by two sweeps of a distance
/// transform (8SSEDT; its error of a fraction of a pixel does not matter for invisible pixels). All
/// zero if no pixel is known.
fn fill_unknown(known: Vec<Option<f32>>, width: usize) -> Vec<f32> {
    let height = known.len() / width.max(1);
    // Offset to the nearest known pixel found so far.
    let mut nearest: Vec<Option<[i32; 2]>> =
        known.iter().map(|known| known.map(|_| [0, 0])).collect();
    let squared = |[x, y]: [i32; 2]| i64::from(x) * i64::from(x) + i64::from(y) * i64::from(y);
    let mut sweep = |x: usize, y: usize, neighbors: &[(isize, isize)]| {
        for &(dx, dy) in neighbors {
            let (Some(nx), Some(ny)) = (x.checked_add_signed(dx), y.checked_add_signed(dy)) else {
                continue;
            };
            if nx >= width || ny >= height {
                continue;
            }
            let Some([ox, oy]) = nearest[ny * width + nx] else {
                continue;
            };
            let candidate = [ox + dx as i32, oy + dy as i32];
            let best = &mut nearest[y * width + x];
            if best.is_none_or(|best| squared(candidate) < squared(best)) {
                *best = Some(candidate);
            }
        }
    };
    for y in 0..height {
        (0..width).for_each(|x| sweep(x, y, &[(-1, 0), (0, -1), (-1, -1), (1, -1)]));
        (0..width).rev().for_each(|x| sweep(x, y, &[(1, 0)]));
    }
    for y in (0..height).rev() {
        (0..width)
            .rev()
            .for_each(|x| sweep(x, y, &[(1, 0), (0, 1), (-1, 1), (1, 1)]));
        (0..width).for_each(|x| sweep(x, y, &[(-1, 0)]));
    }
    let value = |(i, offset): (usize, &Option<[i32; 2]>)| {
        let [dx, dy] = (*offset)?.map(|o| o as isize);
        let (x, y) = (
            (i % width).checked_add_signed(dx)?,
            (i / width).checked_add_signed(dy)?,
        );
        known.get(y * width + x).copied().flatten()
    };
    nearest
        .iter()
        .enumerate()
        .map(|pixel| value(pixel).unwrap_or(0.0))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use image::Rgba;

    fn import(
        depth: &[f32],
        depth_kind: DepthKind,
        alpha: u8,
    ) -> Result<SpriteWithDepth, SpriteError> {
        let camera =
            Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [4, 3]).expect("valid");
        let color = RgbaImage::from_pixel(4, 3, Rgba([10, 20, 30, alpha]));
        let window_range_m = (0.5, 10.0);
        let format = DisplacementFormat::F32;
        DepthImport {
            color,
            camera,
            depth,
            depth_kind,
            window_range_m,
            plane: None,
            format,
        }
        .build()
    }

    #[test]
    fn every_depth_kind_gives_the_same_sprite() {
        let camera =
            Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [4, 3]).expect("valid");
        let eye_depth: Vec<f32> = (0..12).map(|i| 2.0 + 0.1 * (i % 5) as f32).collect();
        let ray: Vec<f32> = pixel_centers(4, 3)
            .zip(&eye_depth)
            .map(|([x, y], &z)| (f64::from(z) * camera.direction(x, y).length()) as f32)
            .collect();
        let window: Vec<f32> = eye_depth
            .iter()
            .map(|&z| 10.0 / 9.5 * (1.0 - 0.5 / z))
            .collect();
        for (depth, kind) in [
            (&eye_depth, DepthKind::EyeDepth),
            (&ray, DepthKind::RayDistance),
            (&window, DepthKind::WindowDepth),
        ] {
            let sprite = import(depth, kind, 255).expect("valid");
            for (i, &want) in eye_depth.iter().enumerate() {
                let found = sprite
                    .eye_depth(i as u32 % 4, i as u32 / 4)
                    .expect("in front");
                // f32 rounding of the input, amplified by the window depth's slope at Z = 2 (Z^2 /
                // near = 8).
                assert!(
                    (found - f64::from(want)).abs() < 1e-5,
                    "{kind:?}: {found} for {want}"
                );
            }
        }
    }

    #[test]
    fn bad_depth_is_an_error_or_transparent() {
        assert_eq!(
            import(&[1.0; 11], DepthKind::EyeDepth, 255),
            Err(SpriteError::Count {
                expected: 12,
                found: 11
            })
        );
        for bad in [f32::NAN, f32::INFINITY, 0.0, -1.0] {
            assert_eq!(
                import(&[bad; 12], DepthKind::EyeDepth, 255),
                Err(SpriteError::NoValidDepth),
                "{bad}"
            );
        }
        let mut mostly_bad = [f32::NAN; 12];
        mostly_bad[5] = 2.0;
        let sprite = import(&mostly_bad, DepthKind::EyeDepth, 255).expect("one valid depth");
        assert!(
            (sprite.eye_depth(3, 2).expect("in front") - 2.0).abs() < 1e-5,
            "the only depth spreads"
        );
        assert!(
            import(&[f32::NAN; 12], DepthKind::EyeDepth, 0).is_ok(),
            "nothing visible needs no depth"
        );
    }

    #[test]
    fn unknown_values_take_the_nearest_known() {
        let mut known = vec![None; 35];
        (known[8], known[33]) = (Some(1.0), Some(2.0)); // (1, 1) and (5, 4) of 7 x 5
        let spread = fill_unknown(known, 7);
        assert_eq!(
            [spread[0], spread[14], spread[34], spread[27], spread[6 + 7]],
            [1.0, 1.0, 2.0, 2.0, 2.0]
        );
    }
}
