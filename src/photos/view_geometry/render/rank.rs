//! Camera ranking (E6) by distance to the view's line of sight, viewing direction, and visible
//! surfaces.
//!
//! Each is a penalty from 0 to 1, and their weighted sum orders the cameras (C26: the paper's text
//! lost the operators; visibility enters as the share that is *not* seen). Distances are divided by
//! the largest one of a valid camera, so that a long sequence does not flatten them.
//!
//! The paper excludes cameras whose directions differ by more than the field of view: from one
//! position, two such images share nothing. Cameras around an object share surfaces at any angle,
//! and long lenses have fields of view narrower than the steps between them. So directions may
//! differ by the field of view or by [`SAME_SURFACES_RAD`], whichever is larger; the probes then
//! decide if surfaces are shared.

use super::project::pixel_axes;
use crate::view_geometry::RealCamera;
use crate::view_geometry::cameras::samples::{MAX_PROBES, Probes};
use glam::{DVec3, Vec3};
use headbox_core::camera::Camera;

/// Weights of the penalties; only their ratios matter.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct RankWeights {
    /// Weight of the distance to the line of sight.
    pub distance: f64,
    /// Weight of the angle between viewing directions.
    pub angle: f64,
    /// Weight of the share of the frame that the camera's samples miss.
    pub visibility: f64,
}

impl Default for RankWeights {
    fn default() -> Self {
        Self {
            distance: 1.0,
            angle: 1.0,
            visibility: 1.0,
        }
    }
}

/// A valid camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ranked {
    /// Index of the camera.
    pub camera: u32,
    /// Penalty; less is better.
    pub penalty: f64,
}

/// Largest angle between viewing directions even if the frame's field of view is narrower, radians:
/// a surface seen head-on by one camera is seen at a cosine of a half by the other.
const SAME_SURFACES_RAD: f64 = std::f64::consts::FRAC_PI_3;

/// Ranks the cameras that are valid for a frame, the best first; of equals the one with the lower
/// index. A camera is invalid if its direction differs from the frame's by more than the frame's
/// field of view and [`SAME_SURFACES_RAD`], if none of its probes falls into the frame, or if it is
/// left out.
pub(super) fn rank(
    cameras: &[RealCamera],
    frame: &Camera,
    origin: DVec3,
    weights: &RankWeights,
    to: &mut Vec<Ranked>,
) {
    to.clear();
    let view = ProbeTest::new(frame, origin);
    let (forward, widest) = (frame.forward(), view.widest_rad);
    let mut terms = Vec::with_capacity(cameras.len());
    for (camera, index) in cameras.iter().zip(0..) {
        let cosine = camera.forward().dot(forward).clamp(-1.0, 1.0);
        if camera.left_out || cosine < view.min_cosine {
            continue;
        }
        let probes = camera.samples.probes();
        let seen = view.count(probes);
        if seen == 0 {
            continue;
        }
        let distance = (camera.pose.eye - frame.eye()).cross(forward).length();
        terms.push((
            index,
            distance,
            cosine.acos() / widest,
            1.0 - f64::from(seen) / f64::from(probes.count),
        ));
    }
    let farthest = terms
        .iter()
        .map(|(_, distance, ..)| *distance)
        .fold(0.0, f64::max);
    // If all cameras are on the line of sight, their distance penalties are 0.
    let per = if farthest > 0.0 { 1.0 / farthest } else { 0.0 };
    to.extend(
        terms
            .into_iter()
            .map(|(camera, distance, angle, missed)| Ranked {
                camera,
                penalty: weights.distance * distance * per
                    + weights.angle * angle
                    + weights.visibility * missed,
            }),
    );
    to.sort_by(|a, b| {
        a.penalty
            .total_cmp(&b.penalty)
            .then(a.camera.cmp(&b.camera))
    });
}

/// Test of probes against a frame.
struct ProbeTest {
    eye: Vec3,
    /// Right, down and forward axes, in pixels at eye depth 1.
    axes: [Vec3; 3],
    /// Edges of the frame relative to the principal point, pixels: left, right, top, bottom.
    edges: [f32; 4],
    /// Largest angle between the directions of the frame and a valid camera, and its cosine.
    widest_rad: f64,
    min_cosine: f64,
}

impl ProbeTest {
    fn new(frame: &Camera, origin: DVec3) -> Self {
        let [x, y] = frame.principal_px();
        let [width, height] = [frame.width(), frame.height()].map(f64::from);
        // Between opposite corners.
        let field_rad = 2.0 * (width.hypot(height) / 2.0 / frame.focal_px()).atan();
        let widest_rad = field_rad.max(SAME_SURFACES_RAD);
        Self {
            eye: (frame.eye() - origin).as_vec3(),
            axes: pixel_axes(frame),
            edges: [-x, width - x, -y, height - y].map(|edge| edge as f32),
            widest_rad,
            min_cosine: widest_rad.cos(),
        }
    }

    fn count(&self, probes: &Probes) -> u32 {
        let [left, right, up, down] = self.edges;
        let [across, below, ahead] = self.axes;
        let [px, py, pz] = &probes.axes;
        let mut count = 0;
        for i in 0..MAX_PROBES {
            let (dx, dy, dz) = (px[i] - self.eye.x, py[i] - self.eye.y, pz[i] - self.eye.z);
            let along = |axis: Vec3| (axis.x * dx + axis.y * dy) + axis.z * dz;
            let (x, y, depth) = (along(across), along(below), along(ahead));
            // All false for NaN.
            let inside = (depth > 0.0)
                & (x >= left * depth)
                & (x < right * depth)
                & (y >= up * depth)
                & (y < down * depth);
            count += u32::from(inside);
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    pub(crate) use crate::view_geometry::tests::{frame_at, plane_view};
    use crate::view_geometry::{RealCamera, SampleGrid};

    fn ranked(eyes: &[DVec3], frame: &Camera) -> Vec<Ranked> {
        let cameras: Vec<RealCamera> = eyes
            .iter()
            .map(|eye| {
                RealCamera::from_loaded(
                    &plane_view(*eye, 2.0, [64, 48]),
                    &SampleGrid::default(),
                    DVec3::ZERO,
                )
            })
            .map(|camera| camera.expect("a pinhole"))
            .collect();
        let mut ranked = Vec::new();
        rank(
            &cameras,
            frame,
            DVec3::ZERO,
            &RankWeights::default(),
            &mut ranked,
        );
        ranked
    }

    /// The formulas once more, as the paper and its corrections have them.
    fn oracle(camera: &RealCamera, frame: &Camera, farthest: f64) -> Option<f64> {
        let ahead = frame.forward();
        let distance = (camera.pose.eye - frame.eye()).cross(ahead).length() / ahead.length();
        let half = f64::from(frame.width()).hypot(f64::from(frame.height())) / 2.0;
        let widest = (2.0 * (half / frame.focal_px()).atan()).max(60f64.to_radians());
        let angle = camera.forward().dot(ahead).clamp(-1.0, 1.0).acos() / widest;
        let probes = camera.samples.probes();
        let probe = |i: usize| Vec3::from_array([0, 1, 2].map(|axis| probes.axes[axis][i]));
        let inside = |p: &Vec3| {
            frame.project(p.as_dvec3()).is_some_and(|[x, y, _]| {
                (0.0..f64::from(frame.width())).contains(&x)
                    && (0.0..f64::from(frame.height())).contains(&y)
            })
        };
        let seen = (0..probes.count as usize).map(probe).filter(inside).count();
        let missed = 1.0 - seen as f64 / f64::from(probes.count);
        (angle <= 1.0 && seen > 0).then(|| if farthest > 0.0 { distance / farthest } else { 0.0 } + angle + missed)
    }

    /// Penalties are made of positions in f32: a probe on the frame's edge may fall to either side,
    /// none does here.
    const TOLERANCE: f64 = 1e-9;

    #[test]
    fn ranking_matches_formulas() {
        let eyes: Vec<DVec3> = (0..40u32)
            .map(|i| {
                let [a, b] = [i * 7 % 13, i * 5 % 11].map(|n| f64::from(n) / 10.0 - 0.6);
                DVec3::new(a, b * 0.7, 0.03 * f64::from(i % 3))
            })
            .collect();
        let frame = frame_at(DVec3::new(0.11, 0.07, 0.2), [80, 60]);
        let cameras: Vec<RealCamera> = eyes
            .iter()
            .filter_map(|eye| {
                RealCamera::from_loaded(
                    &plane_view(*eye, 2.0, [64, 48]),
                    &SampleGrid::default(),
                    DVec3::ZERO,
                )
            })
            .collect();
        let distance = |camera: &RealCamera| {
            (camera.pose.eye - frame.eye())
                .cross(frame.forward())
                .length()
        };
        let valid = |camera: &&RealCamera| oracle(camera, &frame, 1.0).is_some();
        let farthest = cameras
            .iter()
            .filter(valid)
            .map(distance)
            .fold(0.0, f64::max);
        let found = ranked(&eyes, &frame);
        assert_eq!(found.len(), cameras.iter().filter(valid).count());
        assert!(
            found
                .windows(2)
                .all(|pair| pair[0].penalty <= pair[1].penalty)
        );
        for Ranked { camera, penalty } in found {
            let expected = oracle(&cameras[camera as usize], &frame, farthest).expect("valid");
            assert!(
                (penalty - expected).abs() < TOLERANCE,
                "{camera}: {penalty} {expected}"
            );
        }
    }

    #[test]
    fn blind_cameras_are_invalid() {
        let frame = frame_at(DVec3::ZERO, [64, 48]);
        assert!(
            ranked(&[DVec3::new(100.0, 0.0, 0.0)], &frame).is_empty(),
            "far to the side"
        );
        let back =
            Camera::look_at(DVec3::ZERO, DVec3::Z, DVec3::Y, 60.0, [64, 48]).expect("a camera");
        assert!(ranked(&[DVec3::ZERO], &back).is_empty(), "looking away");
        assert!(
            ranked(
                &[DVec3::new(0.0, 0.0, 50.0)],
                &frame_at(DVec3::new(0.0, 0.0, 1e3), [64, 48])
            )
            .len()
                == 1
        );
        assert!(ranked(&[], &frame).is_empty());
    }

    #[test]
    fn identical_poses_keep_order_without_nan() {
        let found = ranked(&[DVec3::ZERO; 3], &frame_at(DVec3::ZERO, [64, 48]));
        assert_eq!(
            found.iter().map(|ranked| ranked.camera).collect::<Vec<_>>(),
            [0, 1, 2]
        );
        assert!(
            found.iter().all(|ranked| ranked.penalty.abs() < 1e-6),
            "{found:?}"
        );
    }
}
