//! The half planes through the baseline, from an LDI's centre to the eye: what epipolar lines are cut from (P4,
//! P5, C16).
//!
//! A depth pixel moves in the half plane in which its ray lies, whatever its depth, and so does what the frame shows of
//! it. One angle about the baseline therefore names an epipolar line of every face and of the frame at once, wherever the
//! epipoles are: in the image, on a corner, far away, at infinity (where the lines are parallel strips) or behind.

use crate::render::setup::transfer::Transfer;
use glam::{DVec2, DVec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use std::ops::Range;

/// Positions in a row of pixels, ascending and apart; some may be empty.
pub(crate) type Spans = [Range<u32>; 3];

/// The baseline.
#[derive(Clone, Copy, Debug)]
pub(super) struct Epipolar {
    /// Two directions at right angles to it and to each other.
    across: [DVec3; 2],
}

impl Epipolar {
    pub(super) fn new(eye_from_centre: DVec3) -> Self {
        // An eye at the centre sees no parallax, and any line through it will do.
        let (u, v) = eye_from_centre
            .try_normalize()
            .unwrap_or(DVec3::X)
            .any_orthonormal_pair();
        Self { across: [u, v] }
    }

    /// A vector, seen along the baseline.
    pub(super) fn project(&self, v: DVec3) -> DVec2 {
        DVec2::new(self.across[0].dot(v), self.across[1].dot(v))
    }

    /// The rays `start + x * step`.
    pub(super) fn row(&self, start: DVec3, step: DVec3) -> Rays {
        Rays {
            start: self.project(start),
            step: self.project(step),
        }
    }

    /// The rays through a row of a camera's frame.
    pub(super) fn frame_row(&self, camera: &Camera, row: u32) -> Rays {
        let start = camera.direction(0.0, f64::from(row) + 0.5);
        self.row(start, camera.direction(1.0, f64::from(row) + 0.5) - start)
    }
}

/// The rays through a row of pixels, seen along the baseline: `start + x * step`, x in pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rays {
    start: DVec2,
    step: DVec2,
}

impl Rays {
    pub(super) fn at(&self, x: f64) -> DVec2 {
        self.start + self.step * x
    }
}

/// The angle of a vector, as a number from 0 to 4 that grows with it: a quarter turn is 1. (Along the sides of a square
/// instead of a circle, which takes one division.)
pub(super) fn turn_of(v: DVec2) -> f64 {
    let sum = v.x.abs() + v.y.abs();
    if sum == 0.0 {
        return 0.0;
    }
    let along = v.y / sum;
    let turn = match (v.x >= 0.0, v.y >= 0.0) {
        (true, true) => along,
        (true, false) => 4.0 + along,
        (false, _) => 2.0 - along,
    };
    if turn < 4.0 { turn } else { 0.0 }
}

/// The unit vector of an angle.
fn direction_of(turn: f64) -> DVec2 {
    let (quarter, t) = (turn.floor(), turn - turn.floor());
    let (x, y) = if quarter % 2.0 == 0.0 {
        (1.0 - t, t)
    } else {
        (-t, 1.0 - t)
    };
    DVec2::new(x, y).normalize_or(DVec2::X) * if quarter < 2.0 { 1.0 } else { -1.0 }
}

/// How many depth pixels there are at each angle.
#[derive(Default)]
pub(super) struct Weights {
    bins: Vec<u64>,
}

impl Weights {
    /// At 1,024 px, an eighth of a turn is 512 px long.
    const BINS: usize = 4096;

    pub(super) fn clear(&mut self) {
        self.bins.clear();
        self.bins.resize(Self::BINS, 0);
    }

    pub(super) fn add(&mut self, ray: DVec2, count: u64) {
        let bin = (turn_of(ray) * (Self::BINS / 4) as f64) as usize;
        if let Some(bin) = self.bins.get_mut(bin) {
            *bin += count;
        }
    }

    /// Writes angles, ascending, between which there are `count` equal parts of the weight; none for a single part. The
    /// first cut is made where nothing is, if there is such a place.
    pub(super) fn cut(&self, count: usize, turns: &mut Vec<f64>) {
        turns.clear();
        let total: u64 = self.bins.iter().sum();
        if count < 2 || total == 0 {
            return;
        }
        let bins = self.bins.len();
        let start = self.middle_of_longest_gap();
        let turn = |bin: f64| (bin * 4.0 / bins as f64) % 4.0;
        turns.push(turn(start as f64));
        let (mut before, mut next) = (0, 1);
        for i in 0..bins {
            let weight = self.bins[(start + i) % bins];
            while next < count && (before + weight) * count as u64 > next as u64 * total {
                let into =
                    (next as f64 * total as f64 / count as f64 - before as f64) / weight as f64;
                turns.push(turn((start + i) as f64 + into));
                next += 1;
            }
            before += weight;
        }
        turns.sort_unstable_by(f64::total_cmp);
    }

    /// The bin in the middle of the longest run of empty ones, or else the emptiest.
    fn middle_of_longest_gap(&self) -> usize {
        let bins = self.bins.len();
        let (mut longest, mut middle, mut length) = (0, None, 0);
        for i in 0..2 * bins {
            length = if self.bins[i % bins] == 0 {
                length + 1
            } else {
                0
            };
            if length > longest && length <= bins {
                (longest, middle) = (length, Some((i - length / 2) % bins));
            }
        }
        middle.unwrap_or_else(|| (0..bins).min_by_key(|i| self.bins[*i]).unwrap_or(0))
    }
}

/// A half plane in which two fragments meet, and the pixels near it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Boundary {
    turn: f64,
    /// Its direction from the baseline.
    toward: DVec2,
    /// Change of the distance across it and along it over a frame pixel in x and one in y together, at eye depth 1.
    per_px: DVec2,
    /// No footprint that meets it in the frame is larger, px.
    pub(super) radius_px: f64,
}

/// A box of face positions and inverse depths, as a boundary sees it.
pub(super) struct BoxAtBoundary {
    /// Across and along the boundary, of the four corners of the face rectangle.
    rays: [DVec2; 4],
    /// The ratio w of eye depths, of the same corners at both inverse depths.
    w: [[f64; 2]; 4],
}

impl Boundary {
    pub(super) fn new(turn: f64, epipolar: &Epipolar, camera: &Camera, radius_px: f64) -> Self {
        let toward = direction_of(turn);
        let origin = camera.direction(0.0, 0.0);
        let step = |x, y| epipolar.project(camera.direction(x, y) - origin);
        let boundary = Self {
            turn,
            toward,
            per_px: DVec2::ONE,
            radius_px,
        };
        Self {
            per_px: boundary.coordinates(step(1.0, 0.0)).abs()
                + boundary.coordinates(step(0.0, 1.0)).abs(),
            ..boundary
        }
    }

    /// Across the boundary and along it.
    fn coordinates(&self, v: DVec2) -> DVec2 {
        DVec2::new(self.toward.perp_dot(v), self.toward.dot(v))
    }

    /// Where in a row the boundary's whole line is, px, if the row meets it in one point.
    fn crossing(&self, rays: &Rays) -> Option<f64> {
        let x = -self.toward.perp_dot(rays.start) / self.toward.perp_dot(rays.step);
        x.is_finite().then_some(x)
    }

    /// The interval of x for which a square of `radius_px` about a position `w * (rays + x)` of the frame, w = w[0] + x *
    /// w[1], touches the boundary, or a little less.
    fn touching(&self, rays: &Rays, w: [f64; 2], radius_px: f64) -> [f64; 2] {
        let (start, step) = (self.coordinates(rays.start), self.coordinates(rays.step));
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

    /// The pixels of a row of the frame whose centres are so near that splats from both sides may touch them.
    pub(super) fn mask(&self, rays: &Rays, width: u32) -> Range<u32> {
        let [low, high] = self.touching(rays, [1.0, 0.0], self.radius_px);
        let first = (low - 0.5).ceil().clamp(0.0, f64::from(width)) as u32;
        let end = ((high - 0.5).floor() + 1.0).clamp(0.0, f64::from(width)) as u32;
        first..end.max(first)
    }

    /// The pixels of `range` in a row of a face whose splats, of at most `reach_px`, may touch the mask. `w`: of x, the
    /// largest ratio of eye depths there, as `w[0] + x * w[1]`.
    pub(super) fn extended(
        &self,
        rays: &Rays,
        w: [f64; 2],
        reach_px: f64,
        range: &Range<u32>,
    ) -> Range<u32> {
        let [low, high] = self.touching(rays, w, reach_px + self.radius_px);
        let first = ((low - 0.5).floor().max(0.0) as u32).clamp(range.start, range.end);
        let end = (((high - 0.5).ceil() + 1.0).max(0.0) as u32).clamp(range.start, range.end);
        first..end.max(first)
    }

    /// A box `[columns, rows, inverse depths]`, px and 1/m.
    pub(super) fn see(
        &self,
        epipolar: &Epipolar,
        face: Face,
        size_px: u32,
        transfer: &Transfer,
        bounds: &[[f64; 2]; 3],
    ) -> BoxAtBoundary {
        let corners = [0, 1, 2, 3].map(|i| [bounds[0][i & 1], bounds[1][i >> 1]]);
        BoxAtBoundary {
            rays: corners
                .map(|[x, y]| self.coordinates(epipolar.project(face.direction(x, y, size_px)))),
            w: corners.map(|[x, y]| {
                bounds[2].map(|q| transfer.at(x, y).z + transfer.inverse_depth.z * q)
            }),
        }
    }

    /// False if no square of `radius_px` about a point of the box touches the boundary in the frame: if all of the box lies
    /// on one side of it, farther away (C17's test: what is linear is extreme at corners).
    pub(super) fn is_near(&self, seen: &BoxAtBoundary, radius_px: f64) -> bool {
        let reach = self.per_px * radius_px;
        let any = |inside: &dyn Fn(DVec2, f64) -> bool| {
            seen.rays
                .iter()
                .zip(&seen.w)
                .any(|(ray, w)| w.iter().any(|w| inside(*ray, *w)))
        };
        any(&|ray, w| ray.x <= reach.x * w)
            && any(&|ray, w| -ray.x <= reach.x * w)
            && any(&|ray, w| -ray.y <= reach.y * w)
    }
}

/// The part of `rays` that lies between boundary `k` and the next one (around the circle), all of it if there is none.
pub(super) fn spans(boundaries: &[Boundary], k: usize, rays: &Rays, range: &Range<u32>) -> Spans {
    let Some(first) = boundaries.get(k) else {
        return [range.clone(), range.end..range.end, range.end..range.end];
    };
    let (is_last, next) = match boundaries.get(k + 1) {
        Some(next) => (false, next),
        None => (true, &boundaries[0]),
    };
    let inside = |turn: f64| match is_last {
        false => first.turn <= turn && turn < next.turn,
        true => first.turn <= turn || turn < next.turn,
    };
    let cut = |boundary: &Boundary| match boundary.crossing(rays) {
        Some(x) => ((x - 0.5).ceil().max(0.0) as u32).clamp(range.start, range.end),
        None => range.start,
    };
    let (a, b) = (cut(first), cut(next));
    // Whoever lies within rounding of a boundary lies in its mask, so that either side will do for it.
    [
        range.start..a.min(b),
        a.min(b)..a.max(b),
        a.max(b)..range.end,
    ]
    .map(|span| {
        // Between pixels if need be: one that lies on the baseline itself has no angle.
        let middle = f64::from(span.start) + f64::from(span.end - span.start) / 2.0;
        if !span.is_empty() && inside(turn_of(rays.at(middle))) {
            span
        } else {
            span.end..span.end
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::random::Rng;

    #[test]
    fn turns_grow_with_the_angle_and_lead_back() {
        let mut last = -1.0;
        for i in 0..400 {
            let angle = f64::from(i) * std::f64::consts::TAU / 400.0;
            let turn = turn_of(DVec2::from_angle(angle));
            assert!(turn > last && (0.0..4.0).contains(&turn), "{angle}");
            // Rounding of a few operations on numbers up to 4.
            assert!((direction_of(turn) - DVec2::from_angle(angle)).length() < 1e-14);
            last = turn;
        }
        assert_eq!(turn_of(DVec2::new(1.0, -1e-300)), 0.0);
    }

    #[test]
    fn cuts_halve_the_weight_and_start_where_nothing_is() {
        let mut weights = Weights::default();
        weights.clear();
        let mut turns = vec![1.0];
        weights.cut(3, &mut turns);
        assert!(turns.is_empty(), "nothing to cut");
        for i in 0..1000 {
            weights.add(direction_of(0.5 + f64::from(i) / 1000.0), 7);
        }
        weights.cut(4, &mut turns);
        // A bin is 4 / BINS wide.
        let wanted = [0.75, 1.0, 1.25, 3.0];
        assert!(
            turns.len() == 4 && turns.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 0.002),
            "{turns:?}"
        );
        weights.cut(1, &mut turns);
        assert!(turns.is_empty());
    }

    /// A camera in some place and direction, and a half plane through its baseline.
    fn some_boundary(random: &mut Rng) -> (Camera, DVec3, Epipolar, Boundary) {
        let (eye, toward) = (random.in_cube(0.5), random.in_cube(1.0));
        let camera = Camera::look_at(
            eye,
            eye + toward,
            DVec3::Y,
            random.between(40.0, 100.0),
            [64, 48],
        )
        .expect("valid");
        let epipolar = Epipolar::new(eye);
        let boundary = Boundary::new(
            random.between(0.0, 4.0),
            &epipolar,
            &camera,
            random.between(0.5, 6.0),
        );
        (camera, eye, epipolar, boundary)
    }

    /// Rounding, in units of a direction's coordinates.
    const ROUNDING: f64 = 1e-9;

    /// By the corners of the square about each pixel's centre: it touches the boundary's line if some lie on both sides of it, and its
    /// half if they are not all behind the baseline.
    #[test]
    fn masks_are_the_pixels_whose_squares_touch_the_boundary() {
        let (mut random, mut inside, mut outside) = (Rng::keyed(21), 0, 0);
        for _ in 0..400 {
            let (camera, _, epipolar, boundary) = some_boundary(&mut random);
            let row = random.below(48) as u32;
            let mask = boundary.mask(&epipolar.frame_row(&camera, row), 64);
            for x in 0..64 {
                let corners =
                    [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(|(right, down)| {
                        let [x, y] = [(x, right), (row, down)]
                            .map(|(at, to)| f64::from(at) + 0.5 + to * boundary.radius_px);
                        boundary.coordinates(epipolar.project(camera.direction(x, y)))
                    });
                let across = corners.map(|corner| corner.x);
                let (least, most) = (
                    across.into_iter().fold(f64::MAX, f64::min),
                    across.into_iter().fold(f64::MIN, f64::max),
                );
                let along = corners
                    .map(|corner| corner.y)
                    .into_iter()
                    .fold(f64::MIN, f64::max);
                if [least, most, along]
                    .iter()
                    .any(|border| border.abs() < ROUNDING)
                {
                    continue;
                }
                let touches = least < 0.0 && most > 0.0 && along > 0.0;
                assert_eq!(
                    mask.contains(&x),
                    touches,
                    "{x} of row {row}, {mask:?}, {boundary:?}"
                );
                *(if touches { &mut inside } else { &mut outside }) += 1;
            }
        }
        assert!(inside > 500 && outside > 5000, "{inside} {outside}");
    }

    /// True if a square of `radius_px` about a point, `w` times a ray, may touch a boundary.
    fn may_touch(boundary: &Boundary, ray: DVec2, w: f64, radius_px: f64) -> bool {
        let (seen, reach) = (boundary.coordinates(ray), boundary.per_px * radius_px * w);
        seen.x.abs() <= reach.x && seen.y >= -reach.y
    }

    #[test]
    fn extended_zones_hold_all_that_may_touch_a_mask_and_a_pixel_more_at_most() {
        let (mut random, mut near, mut far) = (Rng::keyed(22), 0, 0);
        for _ in 0..400 {
            let (_, _, epipolar, boundary) = some_boundary(&mut random);
            let (size, face) = (64, Face::ALL[random.below(6) as usize]);
            let start = face.direction(0.0, random.between(0.0, 64.0), size);
            let rays = epipolar.row(
                start,
                face.direction(1.0, 0.0, size) - face.direction(0.0, 0.0, size),
            );
            let (w, reach_px) = (
                [random.between(0.1, 2.0), random.between(-0.01, 0.01)],
                random.between(0.0, 3.0),
            );
            let range = 5..60;
            let extended = boundary.extended(&rays, w, reach_px, &range);
            let touches = |x: u32| {
                let x = f64::from(x) + 0.5;
                may_touch(
                    &boundary,
                    rays.at(x),
                    w[0] + w[1] * x,
                    reach_px + boundary.radius_px,
                )
            };
            for x in range.clone() {
                assert!(
                    extended.contains(&x) || !touches(x),
                    "{x} of {extended:?}, {boundary:?}"
                );
                near += u32::from(touches(x));
            }
            assert!(extended.start >= range.start && extended.end <= range.end);
            let inner = extended.start + 2..extended.end.saturating_sub(2);
            assert!(
                inner.clone().all(touches),
                "{inner:?} of {extended:?}, {boundary:?}"
            );
            far += range.len() - extended.len();
        }
        assert!(near > 1000 && far > 5000, "{near} {far}");
    }

    #[test]
    fn boxes_that_hold_a_point_near_a_boundary_are_near_it() {
        let (mut random, mut near, mut far) = (Rng::keyed(23), 0, 0);
        for _ in 0..2000 {
            let (camera, eye, epipolar, boundary) = some_boundary(&mut random);
            let (size, face) = (64, Face::ALL[random.below(6) as usize]);
            let transfer = Transfer::new(&camera, eye, face, size);
            let bounds =
                [(0.0, 64.0, 16.0), (0.0, 64.0, 16.0), (0.0, 1.0, 0.5)].map(|(from, to, most)| {
                    let start = random.between(from, to);
                    [start, start + random.between(0.0, most)]
                });
            let radius_px = random.between(0.5, 4.0);
            let found = boundary.is_near(
                &boundary.see(&epipolar, face, size, &transfer, &bounds),
                radius_px,
            );
            for _ in 0..60 {
                let [x, y, q] = bounds.map(|[from, to]| random.between(from, to));
                let (ray, w) = (
                    epipolar.project(face.direction(x, y, size)),
                    transfer.at(x, y).z + transfer.inverse_depth.z * q,
                );
                assert!(
                    found || !may_touch(&boundary, ray, w, radius_px),
                    "({x}, {y}) at {q} of {bounds:?}"
                );
            }
            *(if found { &mut near } else { &mut far }) += 1;
        }
        assert!(near > 50 && far > 500, "{near} {far}");
    }
}
