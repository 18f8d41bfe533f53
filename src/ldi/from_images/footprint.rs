//! One depth image, warped into a cube: every pixel covers the face pixels that its patch of surface covers (S12).
//!
//! The size of a pixel's footprint on a face follows from the ratio of resolutions there, tilt included: two steps on the
//! surface, to the next pixel to the right and to the one below, are two vectors on the face. If both are shorter than a
//! face pixel, the image is minified: the sample counts for the one pixel that it falls into, with the area that it covers
//! as its weight, and several are averaged. Otherwise the image is magnified: the parallelogram of the two vectors is filled,
//! so that neighbours leave no gap, and each face pixel gets the depth of the plane and the colour of the image at its own
//! position.

use super::layers::{RowSamples, Sample};
use super::surface::{Patch, Surfaces};
use crate::capture::images::LoadedView;
use crate::capture::linear_levels;
use crate::capture::rig::Face;
use crate::ldi::EncodedNormal;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

/// A cube that images are warped into.
#[derive(Clone, Copy, Debug)]
pub(super) struct WarpTarget {
    /// World metres.
    pub(super) centre: DVec3,
    pub(super) face_px: u32,
    /// The difference of inverse depths that counts as similar, 1/m: a sample is moved to the middle of its pixel by no more
    /// than half of it.
    pub(super) tolerance: f32,
    /// Standard deviation of the images' inverse depths, 1/m.
    pub(super) noise: f32,
}

/// Rows of an image that are warped together.
const ROWS: u32 = 32;

/// The widest footprint, face pixels: what is magnified more is seen from much nearer than it was recorded.
const MAX_REACH_PX: f32 = 24.0;

/// Parallelograms are this much larger than half of a step to every side: those of neighbours overlap by a hair.
const OVERLAP: f32 = 1.02;

/// Of a sensor's depth, surfaces that are seen at a cosine below this are left out: their depth is that of an edge.
const LEAST_COSINE: f32 = 0.03;

impl WarpTarget {
    /// Samples of an image, in piles of a few rows each.
    pub(super) fn warp(&self, view: &LoadedView, image: u32) -> Vec<RowSamples> {
        let [width, height] = view.size_px;
        let warp = Warp {
            target: self,
            view,
            eye: (view.pose.eye - self.centre).as_vec3(),
            image,
            linear: linear_levels(),
            axes: Face::ALL.map(|face| [face.right(), face.up(), face.normal()].map(|axis| axis.as_vec3())),
        };
        let starts = (0..height).into_par_iter().step_by(ROWS as usize);
        starts
            .map(|start| {
                let rows = start..(start + ROWS).min(height);
                let surfaces = Surfaces::new(view, rows.clone(), self.centre, self.noise);
                let mut samples = Vec::with_capacity((ROWS * width) as usize);
                for (y, x) in rows.flat_map(|y| (0..width).map(move |x| (y, x))) {
                    if let Some(patch) = surfaces.patch(x, y) {
                        warp.add(&patch, x, y, &mut samples);
                    }
                }
                RowSamples::new(&samples, self.face_px)
            })
            .collect()
    }
}

/// An image on its way.
struct Warp<'a> {
    target: &'a WarpTarget,
    view: &'a LoadedView,
    /// Relative to the cube's centre.
    eye: Vec3,
    image: u32,
    /// Linear light of every level.
    linear: &'static [f32; 256],
    /// Right, up and normal of each face.
    axes: [[Vec3; 3]; 6],
}

/// A patch on a face.
struct OnFace {
    face: Face,
    /// Position, face pixels.
    at: Vec2,
    /// What a step to the next pixel of the image, right and down, adds to it.
    steps: [Vec2; 2],
    inverse_depth: f32,
    /// What the two steps add to the inverse depth.
    slopes: Vec2,
}

impl Warp<'_> {
    fn add(&self, patch: &Patch, x: u32, y: u32, samples: &mut Vec<Sample>) {
        let toward = patch.point - self.eye;
        let cosine = -patch.normal.dot(toward.normalize());
        if self.target.noise > 0.0 && cosine < LEAST_COSINE {
            return;
        }
        // Z^3 / |n . p|: the area of the patch up to the focal length of the image (C10).
        let area = patch.across.cross(patch.down).length();
        let normal = EncodedNormal::new(patch.normal);
        let [r, g, b, _] = self.pixel_color(x, y);
        let mut sample = Sample {
            pixel: 0,
            inverse_depth: 0.0,
            normal,
            color: Vec3::from_array([r, g, b].map(|level| self.linear[usize::from(level)])),
            weight: cosine / toward.length_squared(),
            area,
            image: self.image,
        };
        let (home, _) = Face::locate(patch.point);
        let Some(on_face) = self.on_face(patch, home) else { return };
        let reach = |steps: &[Vec2; 2]| (steps[0].abs() + steps[1].abs()) * (0.5 * OVERLAP);
        let extent = reach(&on_face.steps);
        if extent.max_element() <= 0.75 {
            self.add_point(&on_face, &mut sample, samples);
            return;
        }
        self.fill(&on_face, x, y, sample, samples);
        // What reaches over the edge of its face is drawn on the neighbours as well.
        let size = self.target.face_px as f32;
        if (on_face.at - extent).min_element() < 0.0 || (on_face.at + extent).max_element() > size {
            for face in Face::ALL {
                if face != home
                    && face.normal() != -home.normal()
                    && let Some(on_face) = self.on_face(patch, face)
                {
                    self.fill(&on_face, x, y, sample, samples);
                }
            }
        }
    }

    fn on_face(&self, patch: &Patch, face: Face) -> Option<OnFace> {
        let [right, up, normal] = self.axes[face.index()];
        let depth = patch.point.dot(normal);
        if depth <= 1e-6 {
            return None;
        }
        let half = self.target.face_px as f32 / 2.0;
        let q = 1.0 / depth;
        let (u, v) = (patch.point.dot(right) * q, patch.point.dot(up) * q);
        let at = Vec2::new(half * (1.0 + u), half * (1.0 - v));
        let step = |change: Vec3| {
            let deeper = change.dot(normal);
            Vec2::new(change.dot(right) - u * deeper, v * deeper - change.dot(up)) * (half * q)
        };
        let slope = |change: Vec3| -change.dot(normal) * q * q;
        let steps = [step(patch.across), step(patch.down)];
        Some(OnFace { face, at, steps, inverse_depth: q, slopes: Vec2::new(slope(patch.across), slope(patch.down)) })
    }

    /// The number of a pixel of a face.
    fn pixel(&self, face: Face, x: i32, y: i32) -> u32 {
        (face.index() as u32 * self.target.face_px + y as u32) * self.target.face_px + x as u32
    }

    /// A minified sample, in the one pixel that it falls into.
    fn add_point(&self, on_face: &OnFace, sample: &mut Sample, samples: &mut Vec<Sample>) {
        let last = self.target.face_px as i32 - 1;
        let (x, y) = ((on_face.at.x as i32).clamp(0, last), (on_face.at.y as i32).clamp(0, last));
        let [a, b] = on_face.steps;
        let offset = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - on_face.at;
        let most = (self.target.tolerance / 2.0).min(on_face.inverse_depth / 2.0);
        // `max` and `min` also turn the NaN of a patch without area into a number.
        let shift = Steps::of([a, b]).map_or(0.0, |steps| on_face.slopes.dot(steps.to(offset)));
        sample.pixel = self.pixel(on_face.face, x, y);
        sample.inverse_depth = on_face.inverse_depth + shift.max(-most).min(most);
        sample.weight *= a.perp_dot(b).abs().clamp(1e-3, 1.0);
        samples.push(*sample);
    }

    /// A magnified sample, in every pixel whose middle its parallelogram holds.
    fn fill(&self, on_face: &OnFace, x: u32, y: u32, sample: Sample, samples: &mut Vec<Sample>) {
        let [a, b] = on_face.steps;
        let Some(steps) = Steps::of([a, b]) else { return };
        let extent = ((a.abs() + b.abs()) * (0.5 * OVERLAP)).min(Vec2::splat(MAX_REACH_PX));
        let size = self.target.face_px as i32;
        let first = |c: f32| ((c - 0.5).ceil() as i32).clamp(0, size);
        let [columns, rows] = [0, 1].map(|i| first(on_face.at[i] - extent[i])..first(on_face.at[i] + extent[i]));
        for row in rows {
            for column in columns.clone() {
                let within = steps.to(Vec2::new(column as f32 + 0.5, row as f32 + 0.5) - on_face.at);
                let inverse_depth = on_face.inverse_depth + on_face.slopes.dot(within);
                if within.abs().max_element() > 0.5 * OVERLAP || inverse_depth <= 0.0 {
                    continue;
                }
                let pixel = self.pixel(on_face.face, column, row);
                let color = self.color_beside(x, y, within).unwrap_or(sample.color);
                samples.push(Sample { pixel, inverse_depth, color, ..sample });
            }
        }
    }

    #[inline]
    fn pixel_color(&self, x: u32, y: u32) -> [u8; 4] {
        self.view.color[(y * self.view.size_px[0] + x) as usize]
    }

    /// Linear light of the picture's bilinear colour at up to a pixel beside the middle of one, if anything there is not masked out.
    fn color_beside(&self, x: u32, y: u32, offset: Vec2) -> Option<Vec3> {
        let linear = |level: f32| self.linear[usize::from((level + 0.5) as u8)];
        // Over the four pixels about the position, the first to the left of it and above.
        let first =
            [(x, offset.x, self.view.size_px[0]), (y, offset.y, self.view.size_px[1])].map(|(at, off, side)| {
                let first = if off < 0.0 { at.checked_sub(1)? } else { at };
                (first + 1 < side).then_some((first, if off < 0.0 { off + 1.0 } else { off }))
            });
        if let [Some((left, fx)), Some((top, fy))] = first {
            let four = [(left, top), (left + 1, top), (left, top + 1), (left + 1, top + 1)];
            let [a, b, c, d] = four.map(|(x, y)| self.pixel_color(x, y));
            if [a, b, c, d].iter().all(|color| color[3] > 0) {
                let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
                let mix = |i: usize| [a, b, c, d].iter().zip(weights).map(|(color, w)| f32::from(color[i]) * w).sum();
                return Some(Vec3::new(linear(mix(0)), linear(mix(1)), linear(mix(2))));
            }
        }
        let position = [f64::from(x) + 0.5 + f64::from(offset.x), f64::from(y) + 0.5 + f64::from(offset.y)];
        Some(Vec3::from_array(self.view.color_at(position)?.map(|level| linear(level as f32))))
    }
}

/// From offsets on a face to multiples of the two steps that an image's pixels are apart there.
struct Steps {
    steps: [Vec2; 2],
    reciprocal: f32,
}

impl Steps {
    /// `None` if they are parallel.
    #[inline]
    fn of(steps: [Vec2; 2]) -> Option<Self> {
        let determinant = steps[0].perp_dot(steps[1]);
        (determinant.abs() > 1e-9).then(|| Self { steps, reciprocal: 1.0 / determinant })
    }

    /// How many of each make up an offset.
    #[inline]
    fn to(&self, offset: Vec2) -> Vec2 {
        let [a, b] = self.steps;
        Vec2::new(offset.perp_dot(b), a.perp_dot(offset)) * self.reciprocal
    }
}
