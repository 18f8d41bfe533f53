//! An estimate of where colours were taken from: one lens, and a camera for each view.

use super::super::pose::mean_apart;
use super::evidence::camera_axes;
use super::solve::{OF_VIEW, SHARED};
use super::{Pinhole, Pose, Registration};
use crate::Distortion;
use glam::{DMat3, DVec2, DVec3};

/// An estimate. Axes X right, Y down, Z forward.
#[derive(Clone)]
pub(super) struct State {
    pub(super) focal_px: f64,
    pub(super) principal_px: DVec2,
    /// First radial coefficient.
    pub(super) radial: f64,
    /// Camera from world, of each view.
    pub(super) cameras: Vec<(DMat3, DVec3)>,
    /// What has been added to what all views share, and to each view's own turn and step.
    pub(super) shared: [f64; SHARED],
    pub(super) moved: Vec<[f64; OF_VIEW]>,
}

/// A point in a picture of full size.
pub(super) struct Projected {
    pub(super) at: DVec2,
    /// Normalised position.
    pub(super) n: DVec2,
    /// In the camera's axes.
    pub(super) point: DVec3,
}

impl State {
    /// A set's own lens, and its views where it says.
    pub(super) fn as_given(given: &Pinhole, poses: impl Iterator<Item = Pose>) -> Self {
        let cameras: Vec<(DMat3, DVec3)> = poses.map(|pose| camera_from_world(&pose)).collect();
        Self {
            focal_px: (given.focal_px[0] * given.focal_px[1]).sqrt(),
            principal_px: DVec2::from_array(given.principal_px),
            radial: 0.0,
            moved: vec![[0.0; OF_VIEW]; cameras.len()],
            cameras,
            shared: [0.0; SHARED],
        }
    }

    /// What this state, in which all views stand alike beside where `given` has them, says of other views: the same lens, and
    /// the same place beside each.
    pub(super) fn of_others(&self, given: &Self, poses: impl Iterator<Item = Pose>) -> Self {
        let (Some((turned, moved)), Some((rotation, offset))) =
            (self.cameras.first(), given.cameras.first())
        else {
            return self.clone();
        };
        let turn = *turned * rotation.transpose();
        let step = *moved - turn * *offset;
        let beside = |(rotation, offset)| (turn * rotation, turn * offset + step);
        let cameras: Vec<_> = poses.map(|pose| beside(camera_from_world(&pose))).collect();
        Self {
            moved: vec![[0.0; OF_VIEW]; cameras.len()],
            cameras,
            ..self.clone()
        }
    }

    /// The state after a step of all unknowns.
    pub(super) fn stepped(&self, step: &[f64]) -> Self {
        let mut next = self.clone();
        next.focal_px += step[0];
        next.principal_px += DVec2::new(step[1], step[2]);
        next.radial += step[3];
        (0..SHARED).for_each(|k| next.shared[k] += step[k]);
        for (i, (rotation, offset)) in next.cameras.iter_mut().enumerate() {
            let own = &step[SHARED + i * OF_VIEW..][..OF_VIEW];
            for change in [&step[4..SHARED], own] {
                let turn = DVec3::from_slice(&change[..3]);
                let turn =
                    DMat3::from_axis_angle(turn.try_normalize().unwrap_or(DVec3::X), turn.length());
                *rotation = turn * *rotation;
                *offset = turn * *offset + DVec3::from_slice(&change[3..6]);
            }
            (0..OF_VIEW).for_each(|k| next.moved[i][k] += own[k]);
        }
        next
    }

    /// Where a view sees a point of the world; `None` behind its camera.
    pub(super) fn project(&self, view: usize, point: DVec3) -> Option<Projected> {
        let (rotation, offset) = self.cameras[view];
        let point = rotation * point + offset;
        if point.z < 1e-3 {
            return None;
        }
        let n = point.truncate() / point.z;
        let at = self.principal_px + n * (self.focal_px * (1.0 + self.radial * n.length_squared()));
        Some(Projected { at, n, point })
    }

    fn poses(&self) -> impl ExactSizeIterator<Item = Pose> {
        let flip = DMat3::from_diagonal(camera_axes(DVec3::ONE));
        self.cameras.iter().map(move |(rotation, offset)| Pose {
            eye: -(rotation.transpose() * *offset),
            world_from_eye: rotation.transpose() * flip,
        })
    }

    /// Mean angle between these cameras and others, degrees, and mean distance, metres.
    pub(super) fn moved_from(&self, others: impl ExactSizeIterator<Item = Pose>) -> [f64; 2] {
        mean_apart(self.poses().zip(others))
    }

    /// What views are registered by, with their gains.
    pub(super) fn registrations(&self, gains: &[[f32; 3]]) -> Vec<Registration> {
        let radial = [self.radial, 0.0, 0.0, 0.0, 0.0, 0.0];
        let lens = Pinhole {
            focal_px: [self.focal_px; 2],
            principal_px: self.principal_px.to_array(),
            distortion: Distortion {
                radial,
                tangential: [0.0; 2],
            },
        };
        self.poses()
            .zip(gains)
            .map(|(pose, &gain)| Registration { lens, pose, gain })
            .collect()
    }
}

fn camera_from_world(pose: &Pose) -> (DMat3, DVec3) {
    let flip = DMat3::from_diagonal(camera_axes(DVec3::ONE));
    let rotation = flip * pose.world_from_eye.transpose();
    (rotation, -(rotation * pose.eye))
}
