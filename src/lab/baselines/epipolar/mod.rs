//! Epipolar half planes through the baseline from an LDI's centre to the eye (P4, P5, C16).
//!
//! A depth pixel moves in the half plane that contains its ray, whatever its depth, and so does its
//! image in the frame. One angle about the baseline therefore names an epipolar line of every face
//! and of the frame at once, wherever the epipoles are: in the image, on a corner, far away, at
//! infinity (where the lines are parallel) or behind.

#[cfg(test)]
mod tests;

use glam::{DVec2, DVec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_cube::render::setup::transfer::Transfer;
use std::ops::Range;

/// The baseline from an LDI's centre to the eye.
#[derive(Clone, Copy, Debug)]
pub(super) struct Baseline {
    /// Two unit vectors perpendicular to the baseline and to each other.
    across: [DVec3; 2],
}

impl Default for Baseline {
    fn default() -> Self {
        Self::new(DVec3::ZERO)
    }
}

impl Baseline {
    pub(super) fn new(eye_from_centre: DVec3) -> Self {
        // An eye at the centre sees no parallax: any line through it is valid.
        let (u, v) = eye_from_centre
            .try_normalize()
            .unwrap_or(DVec3::X)
            .any_orthonormal_pair();
        Self { across: [u, v] }
    }

    /// Projects a vector along the baseline.
    pub(super) fn project(&self, v: DVec3) -> DVec2 {
        DVec2::new(self.across[0].dot(v), self.across[1].dot(v))
    }

    /// Projects the rays `start + x * step` of a row.
    pub(super) fn project_row(&self, start: DVec3, step: DVec3) -> Rays {
        Rays {
            start: self.project(start),
            step: self.project(step),
        }
    }

    /// Projects the rays through a row of a camera's frame.
    pub(super) fn project_frame_row(&self, camera: &Camera, row: u32) -> Rays {
        let start = camera.direction(0.0, f64::from(row) + 0.5);
        self.project_row(start, camera.direction(1.0, f64::from(row) + 0.5) - start)
    }
}

/// Rays through a row of pixels, projected along the baseline: `start + x * step`, x in pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rays {
    start: DVec2,
    step: DVec2,
}

impl Rays {
    pub(super) fn evaluate(&self, x: f64) -> DVec2 {
        self.start + self.step * x
    }
}

/// Returns the diamond angle of a vector, 0 to 4: monotonic in the angle, with 1 for a quarter
/// turn. It measures the perimeter of a square instead of a circle, which needs only one division.
pub(super) fn diamond_angle(v: DVec2) -> f64 {
    let sum = v.x.abs() + v.y.abs();
    if sum == 0.0 {
        return 0.0;
    }
    let along = v.y / sum;
    let angle = match (v.x >= 0.0, v.y >= 0.0) {
        (true, true) => along,
        (true, false) => 4.0 + along,
        (false, _) => 2.0 - along,
    };
    if angle < 4.0 { angle } else { 0.0 }
}

/// Returns the unit vector of a diamond angle.
fn unit_vector(angle: f64) -> DVec2 {
    let quarter = angle.floor();
    let t = angle - quarter;
    let (x, y) = if quarter % 2.0 == 0.0 {
        (1.0 - t, t)
    } else {
        (-t, 1.0 - t)
    };
    DVec2::new(x, y).normalize_or(DVec2::X) * if quarter < 2.0 { 1.0 } else { -1.0 }
}

/// Histogram of depth pixels over diamond angles.
#[derive(Default)]
pub(super) struct AngleHistogram {
    bins: Vec<u64>,
}

impl AngleHistogram {
    /// Number of bins: 512 for an eighth of a turn, half of a face of 1,024 px.
    const BINS: usize = 4096;

    pub(super) fn clear(&mut self) {
        self.bins.clear();
        self.bins.resize(Self::BINS, 0);
    }

    pub(super) fn add(&mut self, ray: DVec2, count: u64) {
        let bin = (diamond_angle(ray) * (Self::BINS / 4) as f64) as usize;
        if let Some(bin) = self.bins.get_mut(bin) {
            *bin += count;
        }
    }

    /// Computes ascending angles that divide the weight into `count` equal parts, none for a single
    /// part. One of them is in the longest empty gap, if there is one.
    pub(super) fn divide(&self, count: usize, angles: &mut Vec<f64>) {
        angles.clear();
        let total: u64 = self.bins.iter().sum();
        if count < 2 || total == 0 {
            return;
        }
        let bins = self.bins.len();
        let start = self.middle_of_longest_gap();
        let angle = |bin: f64| (bin * 4.0 / bins as f64) % 4.0;
        angles.push(angle(start as f64));
        let mut before = 0;
        let mut next = 1;
        for i in 0..bins {
            let weight = self.bins[(start + i) % bins];
            while next < count && (before + weight) * count as u64 > next as u64 * total {
                let into =
                    (next as f64 * total as f64 / count as f64 - before as f64) / weight as f64;
                angles.push(angle((start + i) as f64 + into));
                next += 1;
            }
            before += weight;
        }
        angles.sort_unstable_by(f64::total_cmp);
    }

    /// Returns the bin in the middle of the longest run of empty bins, or the bin of least weight
    /// if none is empty.
    fn middle_of_longest_gap(&self) -> usize {
        let bins = self.bins.len();
        let mut longest = 0;
        let mut middle = None;
        let mut length = 0;
        for i in 0..2 * bins {
            length = if self.bins[i % bins] == 0 {
                length + 1
            } else {
                0
            };
            if length > longest && length <= bins {
                longest = length;
                middle = Some((i - length / 2) % bins);
            }
        }
        middle.unwrap_or_else(|| (0..bins).min_by_key(|i| self.bins[*i]).unwrap_or(0))
    }
}

/// Epipolar half plane between two fragments.
#[derive(Clone, Copy, Debug)]
pub(super) struct Boundary {
    /// Diamond angle.
    angle: f64,
    /// Unit vector away from the baseline.
    direction: DVec2,
    /// Largest change of the coordinates across and along the boundary over one frame pixel in x
    /// and in y, at eye depth 1.
    per_px: DVec2,
    /// Upper bound of the radii of footprints that touch the boundary in the frame, px.
    pub(super) radius_px: f64,
}

/// A box of face positions and inverse depths in the coordinates of a boundary.
pub(super) struct BoundaryBox {
    /// Rays of the four corners of the face rectangle: across and along the boundary.
    rays: [DVec2; 4],
    /// Ratio w of eye depths at the same corners, at both inverse depths.
    w: [[f64; 2]; 4],
}

impl Boundary {
    pub(super) fn new(angle: f64, baseline: &Baseline, camera: &Camera, radius_px: f64) -> Self {
        let origin = camera.direction(0.0, 0.0);
        let step = |x, y| baseline.project(camera.direction(x, y) - origin);
        let boundary = Self {
            angle,
            direction: unit_vector(angle),
            per_px: DVec2::ONE,
            radius_px,
        };
        Self {
            per_px: boundary.coordinates(step(1.0, 0.0)).abs()
                + boundary.coordinates(step(0.0, 1.0)).abs(),
            ..boundary
        }
    }

    /// Returns the coordinates across the boundary and along it.
    fn coordinates(&self, v: DVec2) -> DVec2 {
        DVec2::new(self.direction.perp_dot(v), self.direction.dot(v))
    }

    /// Returns the x at which a row crosses the line of the boundary, px; `None` if they are
    /// parallel.
    fn crossing(&self, rays: &Rays) -> Option<f64> {
        let x = -self.direction.perp_dot(rays.start) / self.direction.perp_dot(rays.step);
        x.is_finite().then_some(x)
    }

    /// Returns the interval of x in which a square of `radius_px` about the frame position of the
    /// ray x, at the depth ratio `w[0] + x * w[1]`, touches the boundary.
    fn touching_interval(&self, rays: &Rays, w: [f64; 2], radius_px: f64) -> [f64; 2] {
        let start = self.coordinates(rays.start);
        let step = self.coordinates(rays.step);
        let reach = self.per_px * radius_px;
        let mut interval = [f64::NEG_INFINITY, f64::INFINITY];
        let conditions = [
            [reach.x * w[0] - start.x, reach.x * w[1] - step.x],
            [reach.x * w[0] + start.x, reach.x * w[1] + step.x],
            [reach.y * w[0] + start.y, reach.y * w[1] + step.y],
        ];
        for [constant, slope] in conditions {
            if slope > 0.0 {
                interval[0] = f64::max(interval[0], -constant / slope);
            } else if slope < 0.0 {
                interval[1] = f64::min(interval[1], -constant / slope);
            } else if constant < 0.0 {
                return [f64::INFINITY, f64::NEG_INFINITY];
            }
        }
        interval
    }

    /// Returns the pixels of a row of the frame that splats from both sides may touch.
    pub(super) fn mask(&self, rays: &Rays, width: u32) -> Range<u32> {
        let [low, high] = self.touching_interval(rays, [1.0, 0.0], self.radius_px);
        let first = (low - 0.5).ceil().clamp(0.0, f64::from(width)) as u32;
        let end = ((high - 0.5).floor() + 1.0).clamp(0.0, f64::from(width)) as u32;
        first..end.max(first)
    }

    /// Returns the pixels of `range` in a row of a face whose splats, of at most `reach_px`, may
    /// touch the mask. The largest ratio of eye depths at x is `w[0] + x * w[1]`.
    pub(super) fn extended_zone(
        &self,
        rays: &Rays,
        w: [f64; 2],
        reach_px: f64,
        range: &Range<u32>,
    ) -> Range<u32> {
        let [low, high] = self.touching_interval(rays, w, reach_px + self.radius_px);
        let first = ((low - 0.5).floor().max(0.0) as u32).clamp(range.start, range.end);
        let end = (((high - 0.5).ceil() + 1.0).max(0.0) as u32).clamp(range.start, range.end);
        first..end.max(first)
    }

    /// Transforms a box `[columns, rows, inverse depths]` of a face, px and 1/m.
    pub(super) fn transform_box(
        &self,
        baseline: &Baseline,
        face: Face,
        size_px: u32,
        transfer: &Transfer,
        bounds: &[[f64; 2]; 3],
    ) -> BoundaryBox {
        let corners = [0, 1, 2, 3].map(|i| [bounds[0][i & 1], bounds[1][i >> 1]]);
        BoundaryBox {
            rays: corners
                .map(|[x, y]| self.coordinates(baseline.project(face.direction(x, y, size_px)))),
            w: corners.map(|[x, y]| {
                bounds[2].map(|q| transfer.map_infinite(x, y).z + transfer.inverse_depth.z * q)
            }),
        }
    }

    /// Returns false if no square of `radius_px` about a point of the box touches the boundary in
    /// the frame, because the box lies on one side of it, farther away (as in C17: linear functions
    /// are extreme at corners).
    pub(super) fn is_near(&self, bounds: &BoundaryBox, radius_px: f64) -> bool {
        let reach = self.per_px * radius_px;
        let any = |inside: &dyn Fn(DVec2, f64) -> bool| {
            bounds
                .rays
                .iter()
                .zip(&bounds.w)
                .any(|(ray, w)| w.iter().any(|w| inside(*ray, *w)))
        };
        any(&|ray, w| ray.x <= reach.x * w)
            && any(&|ray, w| -ray.x <= reach.x * w)
            && any(&|ray, w| -ray.y <= reach.y * w)
    }
}

/// Columns of a row of pixels that belong to one fragment.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RowPart {
    pub(super) columns: Range<u32>,
    pub(super) fragment: usize,
}

/// Division of a row of pixels into fragments. Reused from row to row.
#[derive(Default)]
pub(super) struct RowDivision {
    cuts: Vec<u32>,
    parts: Vec<RowPart>,
}

impl RowDivision {
    /// Returns the parts of `range` from left to right: fragment k lies between boundary k and the
    /// next one (around the circle), and contains everything if there are no boundaries.
    ///
    /// Every pixel lies in exactly one part, also within rounding of a boundary and on the baseline
    /// itself, where any fragment is valid since the pixel lies in the mask. The parts therefore
    /// depend on the cuts of all boundaries, not only on those of one fragment.
    pub(super) fn divide(
        &mut self,
        boundaries: &[Boundary],
        rays: &Rays,
        range: &Range<u32>,
    ) -> &[RowPart] {
        self.cuts.clear();
        self.parts.clear();
        let crossings = boundaries
            .iter()
            .filter_map(|boundary| boundary.crossing(rays));
        let columns = crossings.map(|x| (x - 0.5).ceil().max(0.0) as u32);
        self.cuts
            .extend(columns.map(|column| column.clamp(range.start, range.end)));
        self.cuts.push(range.end);
        self.cuts.sort_unstable();
        let mut start = range.start;
        for &end in &self.cuts {
            if start >= end {
                continue;
            }
            // Between pixels if necessary: a pixel on the baseline has no angle.
            let middle = f64::from(start) + f64::from(end - start) / 2.0;
            let fragment = fragment_at(boundaries, diamond_angle(rays.evaluate(middle)));
            match self.parts.last_mut() {
                Some(last) if last.fragment == fragment => last.columns.end = end,
                _ => self.parts.push(RowPart {
                    columns: start..end,
                    fragment,
                }),
            }
            start = end;
        }
        &self.parts
    }
}

/// Returns the fragment that contains a diamond angle. The boundaries' angles ascend.
fn fragment_at(boundaries: &[Boundary], angle: f64) -> usize {
    let next = boundaries.partition_point(|boundary| boundary.angle <= angle);
    next.checked_sub(1)
        .unwrap_or_else(|| boundaries.len().saturating_sub(1))
}
