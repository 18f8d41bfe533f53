//! Occlusion-compatible drawing order: near splats after far ones (S19, P4, C3, C3b, C9).
//!
//! For any eye and any scene this order needs no depth comparison:
//!
//! 1. faces by ascending (eye - centre) . normal;
//! 2. in a face, first the segment across its split plane from the eye;
//! 3. in a segment, pixels from the anti-epipole to the epipole: rows toward the epipole's row,
//!    which comes last, and in each row columns toward the epipole's column, which comes last; all
//!    of it reversed if the eye is behind the face (where the image point is the anti-epipole);
//! 4. in a pixel, samples by descending distance from the foot of the perpendicular from the eye to
//!    the pixel's ray, which is farthest first unless the eye is beyond samples.

use crate::pack::blocks::BLOCK_COLUMNS;
use crate::pack::{PackedSegment, SegmentSide};
use glam::DVec3;
use headbox_core::cube_face::Face;
use std::ops::Range;

/// A run of rows or columns with a direction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Run {
    /// Row or column indices on the face.
    pub range: Range<u32>,
    /// True if they are visited from the last to the first.
    pub descending: bool,
}

impl Run {
    /// Calls `visit` for each index of the run, in its direction.
    pub fn for_each(&self, visit: impl FnMut(u32)) {
        if self.descending {
            self.range.clone().rev().for_each(visit);
        } else {
            self.range.clone().for_each(visit);
        }
    }

    /// Splits a run of columns at multiples of [`BLOCK_COLUMNS`] and calls `visit` for each part,
    /// in its direction.
    pub fn for_each_block(&self, mut visit: impl FnMut(Run)) {
        let Range { start, end } = self.range;
        if start >= end {
            return;
        }
        let blocks = Run {
            range: start / BLOCK_COLUMNS..end.div_ceil(BLOCK_COLUMNS),
            descending: self.descending,
        };
        blocks.for_each(|block| {
            let first = block * BLOCK_COLUMNS;
            visit(Run {
                range: start.max(first)..end.min(first + BLOCK_COLUMNS),
                descending: self.descending,
            });
        });
    }
}

/// The runs of one axis, in drawing order; some may be empty.
pub type Runs = [Run; 3];

/// Eye position relative to the cube's centre, in the frame of a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EyeInFace {
    /// Components along the face's right, up and outward normal, metres.
    in_face: DVec3,
    size_px: f64,
}

impl EyeInFace {
    pub(crate) fn new(eye_from_centre: DVec3, face: Face, size_px: u32) -> Self {
        let axes = [face.right(), face.up(), face.normal()];
        Self {
            in_face: DVec3::from(axes.map(|axis| axis.dot(eye_from_centre))),
            size_px: f64::from(size_px),
        }
    }

    /// Returns the rows of `range` in drawing order.
    pub fn row_runs(&self, range: Range<u32>) -> Runs {
        self.runs(-self.in_face.y, range)
    }

    /// Returns the columns of `range` in drawing order (inside a row).
    pub fn column_runs(&self, range: Range<u32>) -> Runs {
        self.runs(self.in_face.x, range)
    }

    /// Splits `range` at the epipole. `component` is the eye's coordinate along the axis in which
    /// indices grow, metres.
    fn runs(&self, component: f64, range: Range<u32>) -> Runs {
        let depth = self.in_face.z;
        // An eye in the plane through the centre (depth 0) has its epipole at infinity in the
        // direction of its displacement. The sign of a tiny depth does not matter: it moves the
        // epipole to the other end and reverses the order, which is the same sweep. An eye at the
        // centre sees no parallax, and any order is right.
        let epipole = if depth == 0.0 {
            f64::INFINITY.copysign(component)
        } else {
            self.size_px / 2.0 * (1.0 + component / depth)
        };
        // Saturating: it only matters if the epipole is left of the range, in it, or right of it.
        // NaN (0/0) cannot occur.
        let epipole = epipole.floor().clamp(-1.0, f64::from(u32::MAX)) as i64;
        let clamp = |i: i64| i.clamp(i64::from(range.start), i64::from(range.end)) as u32;
        let low = clamp(epipole);
        let high = clamp(epipole + 1);
        let toward = [
            (range.start..low, false),
            (high..range.end, true),
            (low..high, false),
        ];
        let runs = toward.map(|(range, descending)| Run { range, descending });
        if depth >= 0.0 {
            return runs;
        }
        let [a, b, c] = runs.map(|run| Run {
            descending: !run.descending,
            ..run
        });
        [c, b, a]
    }

    /// Returns the face depth, m, of the foot of the perpendicular from the eye to the ray through
    /// (x, y).
    pub(crate) fn foot_depth(&self, x: f64, y: f64) -> f64 {
        let ray = self.ray(x, y);
        self.in_face.dot(ray) / ray.length_squared()
    }

    /// Returns the ray through a position in face pixels: right, up, outward; depth 1.
    fn ray(&self, x: f64, y: f64) -> DVec3 {
        DVec3::new(
            2.0 * x / self.size_px - 1.0,
            1.0 - 2.0 * y / self.size_px,
            1.0,
        )
    }

    /// Chooses the sample order of a segment's pixels: one rule for all if the depths of the
    /// farthest and the nearest sample prove it, else pixel by pixel.
    pub(crate) fn layer_order(&self, segment: &PackedSegment) -> LayerOrder {
        let columns = [segment.x0, segment.x0.saturating_add(segment.width)].map(f64::from);
        let rows = [segment.y0, segment.y0.saturating_add(segment.height)].map(f64::from);
        let rays = [0, 1, 2, 3].map(|i| self.ray(columns[i & 1], rows[i >> 1]));
        // The foot is eye . ray / |ray|^2: the numerator is linear in the ray, so extreme at a
        // corner of the rectangle;
        // |ray|^2 lies between 1 and 3.
        let along = rays.map(|ray| self.in_face.dot(ray));
        let (min, max) = along
            .iter()
            .fold((f64::MAX, f64::MIN), |(a, b), &v| (a.min(v), b.max(v)));
        let bound = |v: f64, sign: f64| if v * sign > 0.0 { v } else { v / 3.0 };
        let nearest = 1.0 / f64::from(segment.inverse_depth_max);
        let farthest = 1.0 / f64::from(segment.inverse_depth_min);
        // The midpoint of any two samples lies between the nearest and the farthest sample.
        if bound(max, 1.0) <= nearest {
            LayerOrder::FarthestFirst
        } else if bound(min, -1.0) >= farthest {
            LayerOrder::NearestFirst
        } else {
            LayerOrder::PerPixel
        }
    }
}

/// Drawing order of a pixel's samples; "far" is far from the LDI's centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LayerOrder {
    FarthestFirst,
    NearestFirst,
    PerPixel,
}

/// Writes the indices of `segments` in drawing order to `order`.
pub(crate) fn sort_segments(
    segments: &[PackedSegment],
    eye_from_centre: DVec3,
    order: &mut Vec<usize>,
) {
    // Inside a face: the far segment in the middle, the near one after it if the eye is on the near
    // side of the plane between them (the plane of the near segment's farthest sample will do),
    // before it otherwise.
    let rank = |segment: &PackedSegment| {
        let eye_depth = eye_from_centre.dot(segment.face.normal());
        let rank = match segment.side {
            SegmentSide::Far => 1,
            SegmentSide::Near if eye_depth * f64::from(segment.inverse_depth_min) < 1.0 => 2,
            SegmentSide::Near => 0,
        };
        (eye_depth, segment.face, rank)
    };
    order.clear();
    order.extend(0..segments.len());
    order.sort_unstable_by(|&a, &b| {
        let a = rank(&segments[a]);
        let b = rank(&segments[b]);
        a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2)))
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pack::{BlockIndex, PackedDepthPixel};
    use crate::render::setup::clip::face_rectangle;
    use crate::render::traverse::batches::{Batch, SegmentPart, traverse};
    use glam::dvec3;
    use headbox_core::random::Rng;

    const SIZE: u32 = 12;

    /// A segment with one depth pixel in every pixel.
    fn full_segment(
        face: Face,
        side: SegmentSide,
        inverse_depth_min: f32,
        inverse_depth_max: f32,
    ) -> PackedSegment {
        PackedSegment {
            face,
            side,
            x0: 0,
            y0: 0,
            width: SIZE,
            height: SIZE,
            inverse_depth_min,
            inverse_depth_max,
            row_offsets: (0..=SIZE).map(|y| y * SIZE).collect(),
            row_counts: (0..SIZE).flat_map(|_| 0..=SIZE).collect(),
            depth_pixels: vec![
                PackedDepthPixel {
                    geometry: 0,
                    color_srgb: [0; 4]
                };
                (SIZE * SIZE) as usize
            ],
            blocks: BlockIndex::default(),
        }
    }

    /// Returns the position of every pixel of every segment in the drawing order.
    fn drawing_ranks(segments: &[PackedSegment], eye: DVec3) -> Vec<Vec<usize>> {
        let mut ranks = vec![vec![usize::MAX; (SIZE * SIZE) as usize]; segments.len()];
        let mut order = Vec::new();
        let mut next = 0;
        sort_segments(segments, eye, &mut order);
        for i in order {
            let eye = EyeInFace::new(eye, segments[i].face, SIZE);
            let [columns, rows] = face_rectangle(&segments[i], SIZE);
            let part = SegmentPart {
                segment: &segments[i],
                depth_pixels: &segments[i].depth_pixels,
                columns,
                rows,
                visible: &[true; 4],
            };
            traverse(
                &part,
                &eye,
                eye.layer_order(&segments[i]),
                &mut Batch::new(),
                &mut |batch| {
                    for k in 0..batch.len {
                        let x = batch.anchor_column + u32::from(batch.columns[k]);
                        let rank = &mut ranks[i][(batch.row * SIZE + x) as usize];
                        assert_eq!(*rank, usize::MAX, "drawn twice");
                        *rank = next;
                        next += 1;
                    }
                },
            );
        }
        assert_eq!(next, segments.len() * (SIZE * SIZE) as usize, "all drawn");
        ranks
    }

    /// Eyes of hard cases 1 and 3, and seeded ones inside the headbox, on its faces, beyond and far
    /// outside.
    fn eyes() -> Vec<DVec3> {
        let cell = 2.0 / f64::from(SIZE);
        let mut eyes = vec![DVec3::ZERO];
        // Epipole of +Z (mirrored: of -Z) at (x, y) * cell from the middle: corner, edges, inside,
        // border, beyond.
        for (x, y) in [
            (0.0, 0.0),
            (1.0, 0.5),
            (0.5, 2.0),
            (0.5, 0.5),
            (2.3, -1.7),
            (6.0, 1.2),
            (6.0, 6.0),
            (40.0, 3.0),
        ] {
            for depth in [0.4, -0.4, 3.0, -3.0] {
                eyes.push(dvec3(x * cell, y * cell, 1.0) * depth);
            }
        }
        // Epipole at infinity, and numerically at infinity, on both sides.
        for tiny in [0.0, -0.0, 1e-18, -1e-18, 1e-9, -1e-9] {
            eyes.extend([
                dvec3(0.3, 0.2, tiny),
                dvec3(0.3, tiny, tiny),
                dvec3(tiny, -0.4, tiny),
                dvec3(tiny, tiny, tiny),
            ]);
        }
        let mut random = Rng::keyed(1);
        for reach in [0.1, 0.5, 1.0, 1.5, 4.0, 30.0] {
            eyes.extend((0..12).map(|_| random.in_cube(1.0) * reach));
        }
        eyes.extend((0..12).map(|i| {
            let v = random.in_cube(1.0);
            let mut on_face = v;
            on_face[i % 3] = 0.5f64.copysign(v[i % 3]);
            on_face
        }));
        eyes
    }

    /// C3 and C3b, by lines of sight.
    #[test]
    fn farther_point_on_sight_line_comes_first() {
        let mut random = Rng::keyed(9);
        let segments: Vec<_> = Face::ALL
            .into_iter()
            .flat_map(|face| {
                let split = (0.4 + 0.3 * random.between(-1.0, 1.0)) as f32;
                let far = full_segment(face, SegmentSide::Far, 1e-3, split * (1.0 - f32::EPSILON));
                [far, full_segment(face, SegmentSide::Near, split, 100.0)]
            })
            .collect();
        let locate = |p: DVec3| {
            let face = Face::containing(p);
            let [x, y, eye_depth] = face.project(p, SIZE);
            let near =
                f64::from(segments[2 * face.index() + 1].inverse_depth_min) * eye_depth <= 1.0;
            let pixel = |v: f64| (v as u32).min(SIZE - 1);
            (
                2 * face.index() + usize::from(near),
                (pixel(y) * SIZE + pixel(x)) as usize,
            )
        };
        let mut compared = 0;
        for eye in eyes() {
            let ranks = drawing_ranks(&segments, eye);
            for _ in 0..3000 {
                let direction = random.in_cube(1.0);
                let near = (1.0 + random.between(-1.0, 1.0)).powi(3) * 2.0 + 1e-3;
                let far = near + (1.0 + random.between(-1.0, 1.0)).powi(3) * 3.0;
                let behind = locate(eye + direction * far);
                let front = locate(eye + direction * near);
                if behind != front {
                    compared += 1;
                    assert!(
                        ranks[behind.0][behind.1] < ranks[front.0][front.1],
                        "eye {eye}, direction {direction}, {near} to {far}"
                    );
                }
            }
        }
        assert!(compared > 200_000, "{compared}");
    }

    /// C9, with distances measured to points on the pixel's ray.
    #[test]
    fn layers_come_by_descending_distance() {
        let mut segment = full_segment(Face::NegZ, SegmentSide::Near, 0.2, 2.0);
        const LAYERS: u32 = 20;
        segment.row_offsets.iter_mut().for_each(|o| *o *= LAYERS);
        segment.row_counts.iter_mut().for_each(|c| *c *= LAYERS);
        let layer = |k: u32| PackedDepthPixel {
            geometry: k * ((1 << 20) - 1) / (LAYERS - 1),
            color_srgb: [0; 4],
        };
        segment.depth_pixels = (0..SIZE * SIZE)
            .flat_map(|_| (0..LAYERS).map(layer))
            .collect();
        let mut random = Rng::keyed(4);
        let mut tested_orders = Vec::new();
        for reach in [0.3, 1.0, 3.0, 40.0] {
            for i in 0..40 {
                // The first eye is in front of the face, beyond all samples if far away.
                let eye = if i == 0 {
                    dvec3(0.1, 0.2, -1.0) * reach
                } else {
                    random.in_cube(1.0) * reach
                };
                let in_face = EyeInFace::new(eye, Face::NegZ, SIZE);
                tested_orders.push(in_face.layer_order(&segment));
                let mut before: Option<(u32, u8, f64)> = None;
                let [columns, rows] = face_rectangle(&segment, SIZE);
                let part = SegmentPart {
                    segment: &segment,
                    depth_pixels: &segment.depth_pixels,
                    columns,
                    rows,
                    visible: &[true; 4],
                };
                traverse(
                    &part,
                    &in_face,
                    in_face.layer_order(&segment),
                    &mut Batch::new(),
                    &mut |batch| {
                        for k in 0..batch.len {
                            let x =
                                f64::from(batch.anchor_column) + f64::from(batch.columns[k]) + 0.5;
                            let depth = 1.0
                                / segment.inverse_depth(batch.depth_pixels[k].inverse_depth_code());
                            let point =
                                Face::NegZ.direction(x, f64::from(batch.row) + 0.5, SIZE) * depth;
                            let distance = (point - eye).length();
                            if let Some((row, column, last)) = before
                                && (row, column) == (batch.row, batch.columns[k])
                            {
                                assert!(
                                    distance <= last + 1e-9,
                                    "eye {eye}: {distance} after {last}"
                                );
                            }
                            before = Some((batch.row, batch.columns[k], distance));
                        }
                    },
                );
            }
        }
        for order in [
            LayerOrder::FarthestFirst,
            LayerOrder::NearestFirst,
            LayerOrder::PerPixel,
        ] {
            assert!(tested_orders.contains(&order), "{order:?} was not tested");
        }
    }
}
