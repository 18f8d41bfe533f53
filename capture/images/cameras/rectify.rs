//! Rectification: resamples an image of a [`CameraModel`] into perspective views.
//!
//! A narrow image becomes one view along its axis, of the image's size, whose focal length is as
//! long as its four sides allow. A wide image, of which that view would lose more than
//! [`MAX_LOSS`], becomes the faces of a cube that it covers: a view of 90 degrees each, at the eye
//! of the image, with as many pixels per radian as the image's centre.

use crate::cameras::camera_model::{CameraModel, Projection};
use crate::cameras::lens::{Distortion, Lens, Pinhole};
use crate::cameras::pose::Pose;
use crate::views::view::{LoadedView, View};
use glam::{DMat3, DVec3};
use headbox_core::depth_kind::DepthKind;
use headbox_core::read_note::ReadNote;
use rayon::prelude::*;

/// Largest share of an image outside the single view along its axis.
const MAX_LOSS: f64 = 0.2;

/// Largest angle between the axis and the side of a single view, radians.
const WIDEST: f64 = 1.1;

/// Number of samples along a side of an image that measure its field of view.
const GRID: u32 = 32;

/// Rows of pixels of a task.
const ROWS: usize = 16;

/// Names of the faces in the order in which a set lists them, and the directions of their right and
/// up axes in the eye space of the image.
const FACES: [(&str, DVec3, DVec3); 6] = [
    ("front", DVec3::X, DVec3::Y),
    ("left", DVec3::NEG_Z, DVec3::Y),
    ("right", DVec3::Z, DVec3::Y),
    ("top", DVec3::X, DVec3::Z),
    ("bottom", DVec3::X, DVec3::NEG_Z),
    ("back", DVec3::NEG_X, DVec3::Y),
];

/// Camera of an image file from which a perspective view is resampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourceCamera {
    /// Size of the image file, pixels.
    pub size_px: [u32; 2],
    /// Camera of the image file.
    pub model: CameraModel,
    /// Rotation from the eye space of the view to that of the image.
    pub source_from_view: DMat3,
}

/// One perspective view of a layout.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Face {
    /// Index into [`FACES`].
    index: usize,
    size_px: [u32; 2],
    lens: Lens,
    source_from_view: DMat3,
}

/// Views of a set, in the order of the faces: neighbouring photographs stay neighbours.
#[derive(Default)]
pub(crate) struct ViewList {
    faces: [Vec<View>; FACES.len()],
    layout: Option<(CameraModel, [u32; 2], Vec<Face>)>,
    wide: usize,
    wide_views: usize,
    narrow: usize,
    largest_loss: f64,
}

/// Camera of an image: a lens that [`LoadedView`] knows, or one that has to be resampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ImageLens {
    Direct(Lens),
    Resampled(CameraModel),
}

impl ViewList {
    /// Adds an image through a lens. The lens of `view` is replaced.
    pub(crate) fn push(&mut self, view: View, lens: ImageLens) {
        let model = match lens {
            ImageLens::Direct(lens) => return self.faces[0].push(View { lens, ..view }),
            ImageLens::Resampled(model) => model,
        };
        let size_px = view.size_px;
        if !matches!(&self.layout, Some((m, size, _)) if *m == model && *size == size_px) {
            self.layout = Some((model, size_px, self.create_layout(&model, size_px)));
        }
        let faces = self.layout.as_ref().map_or(&[][..], |layout| &layout.2);
        if faces.len() > 1 {
            self.wide += 1;
            self.wide_views += faces.len();
        } else {
            self.narrow += 1;
        }
        for face in faces {
            let name = if faces.len() > 1 && face.index > 0 {
                format!("{} ({})", view.name, FACES[face.index].0)
            } else {
                view.name.clone()
            };
            let mut depth = view.depth.clone();
            // Depth along the axis has no meaning beside and behind the eye.
            if let Some(depth) = depth.as_mut().filter(|_| faces.len() > 1)
                && depth.kind == DepthKind::EyeDepth
                && is_beyond_side(&model, size_px)
            {
                depth.kind = DepthKind::RayDistance;
            }
            self.faces[face.index].push(View {
                name,
                size_px: face.size_px,
                lens: face.lens,
                pose: Pose {
                    eye: view.pose.eye,
                    world_from_eye: view.pose.world_from_eye * face.source_from_view,
                },
                depth,
                source: Some(SourceCamera {
                    size_px,
                    model,
                    source_from_view: face.source_from_view,
                }),
                ..view.clone()
            });
        }
    }

    fn create_layout(&mut self, model: &CameraModel, size_px: [u32; 2]) -> Vec<Face> {
        let samples: Vec<DVec3> = grid(size_px).filter_map(|at| model.ray(at)).collect();
        if let Some(face) = single_face(model, size_px) {
            let is_lost = |ray: &&DVec3| {
                let position = face.lens.project(**ray, size_px);
                !position.is_some_and(|[x, y, _]| is_inside([x, y], size_px))
            };
            let lost = samples.iter().filter(is_lost).count();
            let loss = lost as f64 / samples.len().max(1) as f64;
            if loss <= MAX_LOSS || matches!(model.projection, Projection::Plane(_)) {
                self.largest_loss = self.largest_loss.max(loss);
                return vec![face];
            }
        }
        cube_faces(model, &samples)
    }

    /// Returns the views and notes on how wide images were split.
    pub(crate) fn finish(self) -> (Vec<View>, Vec<ReadNote>) {
        let mut notes = Vec::new();
        if self.wide > 0 {
            notes.push(format!(
                "{} images through wide lenses are read as {} perspective views of 90 degrees each",
                self.wide, self.wide_views
            ).into());
        }
        if self.largest_loss > 0.005 {
            notes.push(format!(
                "{} images are rectified to perspective views; up to {:.0} % of an image, at its \
                 corners, is outside them",
                self.narrow,
                self.largest_loss * 100.0
            ).into());
        }
        (self.faces.into_iter().flatten().collect(), notes)
    }
}

/// Returns true if an image shows directions at 90 degrees and more from its axis.
fn is_beyond_side(model: &CameraModel, size_px: [u32; 2]) -> bool {
    grid(size_px).any(|at| model.ray(at).is_some_and(|ray| ray.z >= 0.0))
}

/// Returns the positions of a grid over an image, its border included, pixels.
fn grid([width, height]: [u32; 2]) -> impl Iterator<Item = [f64; 2]> {
    let at = |i: u32, side: u32| f64::from(side) * f64::from(i) / f64::from(GRID);
    (0..=GRID).flat_map(move |y| (0..=GRID).map(move |x| [at(x, width), at(y, height)]))
}

fn is_inside([x, y]: [f64; 2], [width, height]: [u32; 2]) -> bool {
    x >= 0.0 && y >= 0.0 && x <= f64::from(width) && y <= f64::from(height)
}

/// Returns the view along the axis, whose focal length is at most the image's; `None` if a side of
/// the image is too far from the axis.
fn single_face(model: &CameraModel, size_px: [u32; 2]) -> Option<Face> {
    let [width, height] = size_px.map(f64::from);
    let [cx, cy] = model.principal_px;
    let mut factor: f64 = 1.0;
    if !matches!(model.projection, Projection::Plane(_)) {
        if !(cx > 0.0 && cy > 0.0 && cx < width && cy < height) {
            return None;
        }
        for (side, axis) in [
            ([0.0, cy], 0),
            ([width, cy], 0),
            ([cx, 0.0], 1),
            ([cx, height], 1),
        ] {
            let ray = model.ray(side)?;
            let distance = (side[axis] - model.principal_px[axis]).abs() / model.focal_px[axis];
            if ray.angle_between(DVec3::NEG_Z) > WIDEST {
                return None;
            }
            factor = factor.min(distance / (ray[axis] / ray.z).abs());
        }
    }
    let lens = Pinhole {
        focal_px: model.focal_px.map(|focal| focal * factor),
        principal_px: model.principal_px,
        distortion: Distortion::default(),
    };
    Some(Face {
        index: 0,
        size_px,
        lens: Lens::Pinhole(lens.checked().ok()?),
        source_from_view: DMat3::IDENTITY,
    })
}

/// Returns the faces of a cube that some of the rays meet.
fn cube_faces(model: &CameraModel, rays: &[DVec3]) -> Vec<Face> {
    let [focal_x, focal_y] = model.focal_px;
    let most = f64::from(headbox_core::camera::Camera::MAX_SIDE_PX / 4);
    let side = (2.0 * (focal_x * focal_y).sqrt()).round().clamp(16.0, most);
    let lens = Lens::Pinhole(Pinhole {
        focal_px: [side / 2.0; 2],
        principal_px: [side / 2.0; 2],
        distortion: Distortion::default(),
    });
    let size_px = [side as u32; 2];
    let face = |(index, (_, right, up)): (usize, (&str, DVec3, DVec3))| {
        let source_from_view = DMat3::from_cols(right, up, right.cross(up));
        let is_met = |ray: &DVec3| {
            let position = lens.project(source_from_view.transpose() * *ray, size_px);
            index == 0 || position.is_some_and(|[x, y, _]| is_inside([x, y], size_px))
        };
        let is_covered = rays.iter().any(is_met);
        (is_covered || index == 0).then_some(Face {
            index,
            size_px,
            lens,
            source_from_view,
        })
    };
    FACES.into_iter().enumerate().filter_map(face).collect()
}

impl SourceCamera {
    /// Resamples an image into a view: colour bilinearly, depth by the nearest pixel. The depth of
    /// `image` is of the kind of the view's depth, in metres.
    pub(crate) fn rectified(&self, image: &LoadedView, view: &View) -> LoadedView {
        let (size_px, lens) = (view.size_px, view.lens);
        let kind = view.depth.as_ref().map(|depth| depth.kind);
        let [width, height] = size_px.map(|side| side as usize);
        let source_width = self.size_px[0] as usize;
        let pixel = |i: usize| {
            let at = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
            let ray = lens.ray(at, size_px);
            let direction = self.source_from_view * ray;
            let position = self.model.project(direction)?;
            let sampled = image.color_at(position)?;
            let [x, y] =
                [0, 1].map(|axis| (position[axis] as usize).min(self.size_px[axis] as usize - 1));
            let source = y * source_width + x;
            let [r, g, b] = sampled.map(|c| (c + 0.5) as u8);
            let depth = image.depth.get(source).map_or(f32::NAN, |&depth| {
                let along = match kind {
                    Some(DepthKind::RayDistance) => ray.length(),
                    _ if direction.z < 0.0 => -direction.z,
                    _ => f64::NAN,
                };
                (f64::from(depth) / along) as f32
            });
            Some(([r, g, b, image.color[source][3]], depth))
        };
        let mut color = vec![[0; 4]; width * height];
        let has_depth = !image.depth.is_empty();
        let mut depth = vec![f32::NAN; if has_depth { width * height } else { 0 }];
        type Known = Option<([u8; 4], f32)>;
        let known: Vec<Vec<Known>> = (0..height.div_ceil(ROWS))
            .into_par_iter()
            .map(|task| {
                let first = task * ROWS * width;
                let end = (first + ROWS * width).min(width * height);
                (first..end).map(pixel).collect()
            })
            .collect();
        for (i, known) in known.into_iter().flatten().enumerate() {
            if let Some((pixel, pixel_depth)) = known {
                color[i] = pixel;
                if has_depth {
                    depth[i] = pixel_depth;
                }
            }
        }
        LoadedView {
            size_px,
            lens,
            pose: image.pose,
            color,
            depth,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cameras::camera_model::Polynomial;
    use crate::depth::{DepthPicture, DepthSource, write_depth_exr};
    use image::RgbaImage;
    use std::path::PathBuf;

    /// Colour of a direction in the eye space of the image: smooth and different everywhere.
    fn color_of(direction: DVec3) -> [f64; 3] {
        (direction * 100.0 + 128.0).to_array()
    }

    fn fisheye(focal: f64, size_px: [u32; 2]) -> CameraModel {
        let none = Polynomial::of_angles(&[], [0.0; 2], [0.0; 4], false);
        CameraModel {
            focal_px: [focal; 2],
            principal_px: size_px.map(|side| f64::from(side) / 2.0),
            projection: Projection::Fisheye(none),
        }
    }

    /// Writes an image of [`color_of`] with a depth of `distance` and returns its view.
    fn write_view(folder: &std::path::Path, model: &CameraModel, size_px: [u32; 2]) -> View {
        let [width, height] = size_px;
        let mut picture = RgbaImage::new(width, height);
        let mut values = Vec::new();
        for (x, y, pixel) in picture.enumerate_pixels_mut() {
            let ray = model.ray([f64::from(x) + 0.5, f64::from(y) + 0.5]);
            let [r, g, b] = ray.map_or([0.0; 3], color_of).map(|c| c.round() as u8);
            pixel.0 = [r, g, b, if ray.is_some() { 255 } else { 0 }];
            values.push(if ray.is_some() { 3.0 } else { 0.0 });
        }
        let color = folder.join("0.png");
        picture.save(&color).expect("written");
        let path = folder.join("0.exr");
        let depth = DepthPicture {
            width,
            height,
            values,
        };
        write_depth_exr(&depth, &path).expect("written");
        let pose = Pose {
            eye: DVec3::new(1.0, 2.0, 3.0),
            world_from_eye: DMat3::from_rotation_y(0.4),
        };
        let depth = DepthSource::metres(path, DepthKind::EyeDepth, 1.0);
        let lens = Lens::Equirectangular;
        View::new("0.png".into(), size_px, lens, pose, color, Some(depth))
    }

    fn rectified(focal: f64, size_px: [u32; 2]) -> (Vec<View>, Vec<ReadNote>, CameraModel) {
        let folder = tempfile::tempdir().expect("a folder");
        let model = fisheye(focal, size_px);
        let mut list = ViewList::default();
        let view = write_view(folder.path(), &model, size_px);
        let pose = view.pose;
        list.push(view, ImageLens::Resampled(model));
        let (views, notes) = list.finish();
        let mut pixels = 0;
        for view in &views {
            let loaded = view.load().expect("loads");
            assert_eq!(loaded.size_px, view.size_px);
            for (i, color) in loaded.color.iter().enumerate() {
                if color[3] == 0 {
                    continue;
                }
                pixels += 1;
                let at = [i as u32 % view.size_px[0], i as u32 / view.size_px[0]];
                let ray = view.lens.ray(at.map(|c| f64::from(c) + 0.5), view.size_px);
                let world = view.pose.world_from_eye * ray.normalize();
                let expected = color_of(pose.world_from_eye.transpose() * world);
                for c in 0..3 {
                    let error = (f64::from(color[c]) - expected[c]).abs();
                    assert!(error < 4.0, "{} {at:?}: {color:?} {expected:?}", view.name);
                }
                if views.len() > 1 && loaded.depth[i].is_finite() {
                    // The depth of an image that sees behind the eye is a distance.
                    let distance = f64::from(loaded.depth[i]) * ray.length();
                    assert!((distance - 3.0).abs() < 1e-5, "{distance}");
                } else if loaded.depth[i].is_finite() {
                    assert_eq!(loaded.depth[i], 3.0, "depth along the axis");
                }
            }
        }
        assert!(pixels > 1000, "{pixels}");
        let paths: Vec<PathBuf> = views.iter().map(|view| view.color.clone()).collect();
        assert!(paths.windows(2).all(|pair| pair[0] == pair[1]));
        (views, notes, model)
    }

    #[test]
    fn narrow_fisheye_becomes_one_view() {
        let (views, _, model) = rectified(60.0, [96, 80]);
        assert_eq!((views.len(), views[0].size_px), (1, [96, 80]));
        // The middle of the left side stays the middle of the left side.
        let ray = model.ray([0.0, 40.0]).expect("seen");
        let [x, y, _] = views[0].lens.project(ray, [96, 80]).expect("in front");
        assert!(x.abs() < 1e-9 && (y - 40.0).abs() < 1e-9, "{x} {y}");
    }

    #[test]
    fn fisheye_of_200_degrees_becomes_cube_faces() {
        // 48 px at 27.5 px a radian: 100 degrees to either side.
        let (views, notes, _) = rectified(27.5, [96, 96]);
        let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
        assert_eq!(names[..2], ["0.png", "0.png (left)"], "{names:?}");
        assert!(
            views.len() >= 5 && notes[0].contains("1 images"),
            "{notes:?}"
        );
    }
}
