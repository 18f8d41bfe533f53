//! Estimate of the colour cameras: one lens, and extrinsics for each view.

use super::super::cameras::pose::mean_difference;
use super::solve::{SHARED_UNKNOWNS, VIEW_UNKNOWNS};
use super::{Exposure, Pinhole, Pose, Registration};
use crate::Distortion;
use glam::{DMat3, DVec2, DVec3};

/// Lens and extrinsics of the colour cameras. Axes X right, Y down, Z forward.
#[derive(Clone)]
pub(super) struct Calibration {
    /// Focal length, pixels.
    pub(super) focal_px: f64,
    pub(super) principal_px: DVec2,
    /// First radial distortion coefficient.
    pub(super) radial: f64,
    /// Rotation and translation from the world to the camera of each view.
    pub(super) cameras: Vec<(DMat3, DVec3)>,
    /// Sum of all steps of the shared unknowns.
    pub(super) shared: [f64; SHARED_UNKNOWNS],
    /// Sum of all steps of each view's own turn and translation.
    pub(super) own: Vec<[f64; VIEW_UNKNOWNS]>,
}

/// Projection of a point into a full-size image.
pub(super) struct ProjectedPoint {
    /// Position, pixels.
    pub(super) pixel: DVec2,
    /// Normalised position.
    pub(super) n: DVec2,
    /// Point in the camera's axes.
    pub(super) point: DVec3,
}

impl Calibration {
    /// Creates an estimate from the lens and the poses of the set's file.
    pub(super) fn as_given(given: &Pinhole, poses: impl Iterator<Item = Pose>) -> Self {
        let cameras: Vec<(DMat3, DVec3)> = poses.map(|pose| camera_from_world(&pose)).collect();
        Self {
            focal_px: (given.focal_px[0] * given.focal_px[1]).sqrt(),
            principal_px: DVec2::from_array(given.principal_px),
            radial: 0.0,
            own: vec![[0.0; VIEW_UNKNOWNS]; cameras.len()],
            cameras,
            shared: [0.0; SHARED_UNKNOWNS],
        }
    }

    /// Transfers this estimate, whose cameras have a common offset from `given`, to other views:
    /// the same lens and offset.
    pub(super) fn transfer(&self, given: &Self, poses: impl Iterator<Item = Pose>) -> Self {
        let (turned, translation) = self.cameras[0];
        let (rotation, offset) = given.cameras[0];
        let turn = turned * rotation.transpose();
        let step = translation - turn * offset;
        let transfer = |(rotation, offset)| (turn * rotation, turn * offset + step);
        let cameras: Vec<_> = poses
            .map(|pose| transfer(camera_from_world(&pose)))
            .collect();
        Self {
            own: vec![[0.0; VIEW_UNKNOWNS]; cameras.len()],
            cameras,
            ..self.clone()
        }
    }

    /// Applies a step of all unknowns.
    pub(super) fn apply_step(&self, step: &[f64]) -> Self {
        let mut next = self.clone();
        next.focal_px += step[0];
        next.principal_px += DVec2::new(step[1], step[2]);
        next.radial += step[3];
        (0..SHARED_UNKNOWNS).for_each(|k| next.shared[k] += step[k]);
        for (i, (rotation, offset)) in next.cameras.iter_mut().enumerate() {
            let own = &step[SHARED_UNKNOWNS + i * VIEW_UNKNOWNS..][..VIEW_UNKNOWNS];
            for change in [&step[4..SHARED_UNKNOWNS], own] {
                let turn = DVec3::from_slice(&change[..3]);
                let turn =
                    DMat3::from_axis_angle(turn.try_normalize().unwrap_or(DVec3::X), turn.length());
                *rotation = turn * *rotation;
                *offset = turn * *offset + DVec3::from_slice(&change[3..6]);
            }
            (0..VIEW_UNKNOWNS).for_each(|k| next.own[i][k] += own[k]);
        }
        next
    }

    /// Projects a point of the world into a view; `None` behind its camera.
    pub(super) fn project(&self, view: usize, point: DVec3) -> Option<ProjectedPoint> {
        let (rotation, offset) = self.cameras[view];
        let point = rotation * point + offset;
        if point.z < 1e-3 {
            return None;
        }
        let n = point.truncate() / point.z;
        let pixel =
            self.principal_px + n * (self.focal_px * (1.0 + self.radial * n.length_squared()));
        Some(ProjectedPoint { pixel, n, point })
    }

    fn poses(&self) -> impl ExactSizeIterator<Item = Pose> {
        self.cameras.iter().map(|(rotation, offset)| Pose {
            eye: -(rotation.transpose() * *offset),
            world_from_eye: rotation.transpose() * FLIP,
        })
    }

    /// Returns the mean angle between these cameras and others, degrees, and the mean distance,
    /// metres.
    pub(super) fn mean_offset(&self, others: impl ExactSizeIterator<Item = Pose>) -> [f64; 2] {
        mean_difference(self.poses().zip(others))
    }

    /// Converts the estimate and gains to registrations of the views.
    pub(super) fn to_registrations(&self, exposures: &[Exposure]) -> Vec<Registration> {
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
            .zip(exposures)
            .map(|(pose, &exposure)| Registration {
                lens,
                pose,
                exposure,
            })
            .collect()
    }
}

/// Converts between eye space and axes X right, Y down, Z forward.
const FLIP: DMat3 = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));

fn camera_from_world(pose: &Pose) -> (DMat3, DVec3) {
    let rotation = FLIP * pose.world_from_eye.transpose();
    (rotation, -(rotation * pose.eye))
}
