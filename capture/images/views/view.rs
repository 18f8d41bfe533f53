//! One view of a set: its camera, its files, and the loaded image.

use crate::ImagesError;
use crate::cameras::lens::{Lens, Pinhole};
use crate::cameras::pose::Pose;
use crate::cameras::rectify::SourceCamera;
use crate::depth::DepthSource;
use crate::register::Registration;
use crate::views::color_images::{ColorChannels, read_channels, read_color, read_size};
use glam::{DVec2, DVec3};
use headbox_core::camera::Camera;
use headbox_core::image::orientation;
use std::path::PathBuf;

/// Depth assigned to infinitely far points, metres: moving by one metre shifts them by a hundredth
/// of a pixel at a thousand pixels a radian.
pub const MAX_DEPTH_M: f32 = 1e5;

/// One image of a set: its camera in memory, its pixels on disk.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Name in the set's file.
    pub name: String,
    /// Width and height, pixels.
    pub size_px: [u32; 2],
    /// Mapping from pixels to rays.
    pub lens: Lens,
    /// Camera pose, world metres.
    pub pose: Pose,
    /// Image file.
    pub color: PathBuf,
    /// Depth file, if there is one.
    pub depth: Option<DepthSource>,
    /// Mask file, black at pixels to ignore.
    pub mask: Option<PathBuf>,
    /// Factor on the depth in metres: the unit of the set's frame.
    pub depth_scale: f32,
    /// Names of the colour channels, if not R, G, B and A.
    pub color_channels: Option<ColorChannels>,
    /// Camera of the colours, if it is not that of the depth. [`Self::load`] reprojects the depth
    /// into it.
    pub registration: Option<Registration>,
    /// Camera of the files, if they are resampled into this view.
    pub source: Option<SourceCamera>,
}

/// A view in memory, without lens distortion.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedView {
    /// Width and height, pixels.
    pub size_px: [u32; 2],
    /// Lens without distortion.
    pub lens: Lens,
    /// Camera pose, world metres.
    pub pose: Pose,
    /// sRGB with straight alpha; alpha is 0 where the view is masked out. Row-major, row 0 on top.
    pub color: Vec<[u8; 4]>,
    /// Depth as multiples of [`Lens::ray`] (eye depth for a pinhole, ray distance for a panorama),
    /// metres: infinite at background, NaN where unknown; empty without depth.
    pub depth: Vec<f32>,
}

impl View {
    /// Creates a view without mask, whose depth is in metres and whose colours are unregistered R,
    /// G, B and A.
    pub fn new(
        name: String,
        size_px: [u32; 2],
        lens: Lens,
        pose: Pose,
        color: PathBuf,
        depth: Option<DepthSource>,
    ) -> Self {
        Self {
            name,
            size_px,
            lens,
            pose,
            color,
            depth,
            mask: None,
            depth_scale: 1.0,
            color_channels: None,
            registration: None,
            source: None,
        }
    }

    /// Reads image, mask and depth, and undistorts them (colour bilinearly, depth by the nearest
    /// pixel).
    ///
    /// # Errors
    /// [`ImagesError`] that names the file, also if the sizes differ.
    pub fn load(&self) -> Result<LoadedView, ImagesError> {
        let (width, height, mut color) = match &self.color_channels {
            Some(channels) => read_channels(&self.color, channels)?,
            None => read_color(&self.color)?,
        };
        if let Some(turn) = self.upright_turn([width, height]) {
            color = orientation::turn([width, height], &color, turn).1;
        } else {
            self.check_size([width, height])?;
        }
        let [width, height] = self.file_size_px();
        if let Some(mask) = &self.mask {
            let (mask_width, mask_height, mask_pixels) = read_color(mask)?;
            if (mask_width, mask_height) != (width, height) {
                let cause = format!(
                    "is {mask_width}x{mask_height} pixels, but its image is {width}x{height}"
                );
                return Err(ImagesError::invalid_picture(mask, cause));
            }
            // Some programs write 0 and 1 in place of 0 and 255.
            let levels = mask_pixels.iter().flat_map(|pixel| &pixel[..3]);
            let threshold = if levels.max() == Some(&1) { 1 } else { 128 };
            for (pixel, masked) in color.iter_mut().zip(mask_pixels) {
                if masked[3] == 0 || masked[..3].iter().all(|&level| level < threshold) {
                    pixel[3] = 0;
                }
            }
        }
        let depth = self.load_depth()?;
        // Estimated depth belongs to the undistorted image.
        let (distorted, estimated) = if self.depth.is_some() && !self.has_own_depth() {
            (Vec::new(), Some(depth))
        } else {
            (depth, None)
        };
        let distorted_view = LoadedView {
            size_px: self.file_size_px(),
            lens: self.lens,
            pose: self.pose,
            color,
            depth: distorted,
        };
        let mut ideal = match &self.source {
            Some(source) => source.rectified(&distorted_view, self),
            None => distorted_view.undistorted(),
        };
        if let Some(depth) = estimated {
            ideal.depth = depth;
        }
        Ok(match &self.registration {
            Some(registration) => registration.apply(ideal),
            None => ideal,
        })
    }

    /// Checks that the files exist and that the image's header has the size that the set specifies.
    ///
    /// # Errors
    /// [`ImagesError`] that names the file.
    pub(crate) fn check_files(&self) -> Result<(), ImagesError> {
        let stored = read_size(&self.color)?;
        if self.upright_turn(stored).is_none() {
            self.check_size(stored)?;
        }
        let depth = self.depth.as_ref().map(|depth| &depth.path);
        depth.into_iter().chain(&self.mask).try_for_each(|path| {
            std::fs::metadata(path)
                .map(|_| ())
                .map_err(|cause| ImagesError::io(path, cause))
        })
    }

    fn check_size(&self, [width, height]: [u32; 2]) -> Result<(), ImagesError> {
        let [w, h] = self.file_size_px();
        if [width, height] == [w, h] {
            return Ok(());
        }
        let cause = format!("is {width}x{height} pixels, but the set specifies {w}x{h}");
        Err(ImagesError::invalid_picture(&self.color, cause))
    }

    /// Size of the image file, pixels.
    pub(crate) fn file_size_px(&self) -> [u32; 2] {
        self.source.map_or(self.size_px, |source| source.size_px)
    }

    /// Returns true if `other` is another view of the same image file.
    pub(crate) fn is_same_photograph(&self, other: &Self) -> bool {
        self.source.is_some() && self.color == other.color && self.name != other.name
    }

    /// Returns true if the view has depth that was not estimated from the photographs.
    pub fn has_own_depth(&self) -> bool {
        self.depth
            .as_ref()
            .is_some_and(|depth| depth.estimated_deviation.is_none())
    }

    /// Returns the undistorted lens of the colours; `None` for a panorama.
    pub fn pinhole(&self) -> Option<Pinhole> {
        let lens = self
            .registration
            .map_or(self.lens, |registration| Lens::Pinhole(registration.lens));
        match lens.ideal() {
            Lens::Pinhole(pinhole) => Some(pinhole),
            Lens::Equirectangular => None,
        }
    }

    /// Returns a camera for frames at this view: its eye and direction, with square pixels and a
    /// centred principal point. `None` for a panorama.
    pub fn camera(&self) -> Option<Camera> {
        let Lens::Pinhole(pinhole) = self.lens else {
            return None;
        };
        let [width, height] = self.size_px;
        Camera::from_parts(
            self.pose.eye,
            self.pose.world_from_eye,
            pinhole.focal_px[1],
            width,
            height,
        )
        .ok()
    }
}

impl LoadedView {
    /// Returns a pixel's depth if it is known and the pixel is not masked out. Infinite depth is
    /// clamped to [`MAX_DEPTH_M`], so that the background is a surface like others, with its
    /// colour.
    #[inline]
    pub fn depth_at(&self, x: u32, y: u32) -> Option<f32> {
        let i = y as usize * self.size_px[0] as usize + x as usize;
        let depth = *self.depth.get(i)?;
        (depth > 0.0 && self.color[i][3] > 0).then_some(depth.min(MAX_DEPTH_M))
    }

    /// Returns the world point of a pixel with known depth.
    pub fn point_at(&self, x: u32, y: u32) -> Option<DVec3> {
        let depth = f64::from(self.depth_at(x, y)?);
        let ray = self
            .lens
            .ray([f64::from(x) + 0.5, f64::from(y) + 0.5], self.size_px);
        Some(self.pose.to_world(ray * depth))
    }

    /// Samples the colour at a position in pixels, bilinearly over the pixels that are not masked
    /// out; `None` outside.
    pub fn color_at(&self, [x, y]: [f64; 2]) -> Option<[f64; 3]> {
        let [width, height] = self.size_px.map(f64::from);
        if !(x >= 0.0 && y >= 0.0 && x <= width && y <= height) {
            return None;
        }
        let x = (x - 0.5).clamp(0.0, width - 1.0);
        let y = (y - 0.5).clamp(0.0, height - 1.0);
        let x0 = x as usize;
        let y0 = y as usize;
        let fx = x - x0 as f64;
        let fy = y - y0 as f64;
        let x1 = (x0 + 1).min(width as usize - 1);
        let y1 = (y0 + 1).min(height as usize - 1);
        let mut sum = [0.0; 3];
        let mut total = 0.0;
        for (px, py, weight) in [
            (x0, y0, (1.0 - fx) * (1.0 - fy)),
            (x1, y0, fx * (1.0 - fy)),
            (x0, y1, (1.0 - fx) * fy),
            (x1, y1, fx * fy),
        ] {
            let pixel = self.color[py * width as usize + px];
            if pixel[3] > 0 && weight > 0.0 {
                (0..3).for_each(|c| sum[c] += f64::from(pixel[c]) * weight);
                total += weight;
            }
        }
        (total > 0.0).then(|| sum.map(|c| c / total))
    }

    /// Samples the photograph projected onto the plane through `origin` that faces its camera,
    /// where a ray from `eye` hits that plane; `None` without a hit and outside the photograph.
    pub fn color_on_plane(&self, origin: DVec3, eye: DVec3, direction: DVec3) -> Option<[f64; 3]> {
        let normal = self.pose.world_from_eye.z_axis;
        let depth = (origin - eye).dot(normal) / direction.dot(normal);
        let point =
            self.pose.world_from_eye.transpose() * (eye + direction * depth - self.pose.eye);
        let [x, y, _] = self
            .lens
            .project(point, self.size_px)
            .filter(|_| depth > 0.0)?;
        self.color_at([x, y])
    }

    /// Downscales a perspective view by an integer factor: each pixel is the mean of the pixels of
    /// its block that are not masked out, depth is dropped, and pixels beyond whole blocks are left
    /// out. Panoramas, and views that would become smaller than a pixel, are returned unchanged.
    #[must_use]
    pub fn downscaled(self, factor: u32) -> Self {
        let size_px = self.size_px.map(|side| side / factor.max(1));
        let Lens::Pinhole(pinhole) = self.lens else {
            return self;
        };
        if factor <= 1 || size_px.contains(&0) {
            return self;
        }
        let mut color = Vec::with_capacity(size_px[0] as usize * size_px[1] as usize);
        for (x, y) in
            (0..size_px[1]).flat_map(|y| (0..size_px[0]).map(move |x| (x * factor, y * factor)))
        {
            let mut sum = [0; 3];
            let mut count = 0;
            for row in y..y + factor {
                let start = (row * self.size_px[0] + x) as usize;
                for pixel in self.color[start..start + factor as usize]
                    .iter()
                    .filter(|pixel| pixel[3] > 0)
                {
                    (0..3).for_each(|c| sum[c] += u32::from(pixel[c]));
                    count += 1;
                }
            }
            let [r, g, b] = sum.map(|sum| ((sum + count / 2) / count.max(1)) as u8);
            color.push([r, g, b, if count > 0 { 255 } else { 0 }]);
        }
        let scale = 1.0 / f64::from(factor);
        let [focal_px, principal_px] =
            [pinhole.focal_px, pinhole.principal_px].map(|px| px.map(|px| px * scale));
        let lens = Lens::Pinhole(Pinhole {
            focal_px,
            principal_px,
            ..pinhole
        });
        Self {
            size_px,
            lens,
            color,
            depth: Vec::new(),
            ..self
        }
    }

    /// Resamples the view as seen through an undistorted lens.
    pub(crate) fn undistorted(self) -> Self {
        let Lens::Pinhole(Pinhole {
            focal_px,
            principal_px,
            distortion,
        }) = self.lens
        else {
            return self;
        };
        if distortion.is_none() {
            return self;
        }
        let [width, height] = self.size_px;
        let lens = self.lens.ideal();
        let pixels = width as usize * height as usize;
        let mut color = vec![[0; 4]; pixels];
        let mut depth = vec![f32::NAN; self.depth.len()];
        for (i, color) in color.iter_mut().enumerate() {
            let x = (i % width as usize) as f64 + 0.5;
            let y = (i / width as usize) as f64 + 0.5;
            let ideal = DVec2::new(
                (x - principal_px[0]) / focal_px[0],
                (y - principal_px[1]) / focal_px[1],
            );
            let distorted = distortion.apply(ideal);
            let position = [0, 1].map(|axis| principal_px[axis] + focal_px[axis] * distorted[axis]);
            let Some(sampled) = self.color_at(position) else {
                continue;
            };
            let [r, g, b] = sampled.map(|c| (c + 0.5) as u8);
            let nearest = [position[0] as usize, position[1] as usize];
            let source = nearest[1].min(height as usize - 1) * width as usize
                + nearest[0].min(width as usize - 1);
            *color = [r, g, b, self.color[source][3]];
            if let (Some(depth), Some(&known)) = (depth.get_mut(i), self.depth.get(source)) {
                *depth = known;
            }
        }
        Self {
            lens,
            color,
            depth,
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cameras::lens::Distortion;
    use glam::DMat3;

    fn view() -> LoadedView {
        let size_px = [13, 9];
        let lens = Lens::Pinhole(Pinhole {
            focal_px: [12.0, 11.0],
            principal_px: [6.2, 4.1],
            distortion: Distortion::default(),
        });
        let pixel = |i: u32| {
            [
                (i % 13 * 19) as u8,
                (i / 13 * 28) as u8,
                (i * 7 % 256) as u8,
                if i % 13 < 11 { 255 } else { 0 },
            ]
        };
        let pose = Pose {
            eye: DVec3::new(0.3, -0.2, 0.5),
            world_from_eye: DMat3::from_rotation_y(0.3),
        };
        LoadedView {
            size_px,
            lens,
            pose,
            color: (0..13 * 9).map(pixel).collect(),
            depth: vec![1.0; 13 * 9],
        }
    }

    #[test]
    fn downscaled_view_averages_blocks() {
        let whole = view();
        let third = whole.clone().downscaled(3);
        assert_eq!((third.size_px, third.depth.len()), ([4, 3], 0));
        let point = DVec3::new(0.1, 0.2, -2.0);
        let [x, y, z] = whole.lens.project(point, whole.size_px).unwrap();
        let [u, v, w] = third.lens.project(point, third.size_px).unwrap();
        assert!((x / 3.0 - u).abs() < 1e-12 && (y / 3.0 - v).abs() < 1e-12 && z == w);
        for (i, color) in (0u32..).zip(&third.color) {
            let x = i % 4 * 3;
            let y = i / 4 * 3;
            let block = (0..9).map(|k| whole.color[((y + k / 3) * 13 + x + k % 3) as usize]);
            let known: Vec<[u8; 4]> = block.filter(|pixel| pixel[3] > 0).collect();
            for c in 0..3 {
                let mean =
                    known.iter().map(|pixel| f64::from(pixel[c])).sum::<f64>() / known.len() as f64;
                assert!(
                    (f64::from(color[c]) - mean).abs() <= 0.5,
                    "{i}: {color:?} {mean}"
                );
            }
        }
        assert_eq!(whole.clone().downscaled(1), whole);
        assert_eq!(whole.clone().downscaled(10), whole, "less than a pixel");
    }

    #[test]
    fn color_on_plane_same_from_any_eye() {
        let view = view();
        let origin = view.pose.eye - view.pose.world_from_eye.z_axis * 4.0;
        for (x, y) in (0..9).flat_map(|y| (0..10).map(move |x| (x, y))) {
            let position = [f64::from(x) + 0.5, f64::from(y) + 0.5];
            let direction = view.pose.world_from_eye * view.lens.ray(position, view.size_px);
            let expected = view.color_at(position).unwrap();
            // The same point of the plane, seen from two eyes.
            let point = view.pose.eye + direction * 4.0;
            for eye in [view.pose.eye, view.pose.eye + DVec3::new(0.4, 0.1, -0.3)] {
                let color = view.color_on_plane(origin, eye, point - eye).unwrap();
                assert!(
                    (0..3).all(|c| (color[c] - expected[c]).abs() < 1e-9),
                    "{color:?} {expected:?}"
                );
            }
            assert_eq!(
                view.color_on_plane(origin, view.pose.eye, -direction),
                None,
                "behind"
            );
        }
    }
}
