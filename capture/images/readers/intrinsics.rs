//! Text files of camera matrices and camera trajectories.

use super::text;
use crate::ImagesError;
use crate::lens::{Distortion, Pinhole};
use crate::pose::Pose;
use glam::DMat4;
use headbox_core::files::InputFolder;
use std::path::Path;

/// Creates a pinhole from intrinsics with pixel centres at integers.
pub(super) fn create_pinhole(focal_px: [f64; 2], principal: [f64; 2]) -> Pinhole {
    Pinhole {
        focal_px,
        principal_px: principal.map(|c| c + 0.5),
        distortion: Distortion::default(),
    }
}

/// Reads intrinsics with pixel centres at integers: a matrix of 3x3, 3x4 or 4x4 numbers, or focal
/// lengths and principal point.
pub(super) fn read_intrinsics(folder: &InputFolder, file: &Path) -> Result<Pinhole, ImagesError> {
    const FIELD: &str = "the intrinsics";
    let numbers = text::read_number_list(folder, file)?;
    let bad = |cause: String| ImagesError::field(file, FIELD, cause);
    let columns = match numbers.len() {
        4 => {
            let lens = create_pinhole([numbers[0], numbers[1]], [numbers[2], numbers[3]]);
            return lens.checked().map_err(|cause| bad(cause.into()));
        }
        9 => 3,
        12 | 16 => 4,
        count => {
            let cause = format!("must hold 9 finite numbers (3x3), or 12, 16 or 4; holds {count}");
            return Err(bad(cause));
        }
    };
    let lens = create_pinhole(
        [numbers[0], numbers[columns + 1]],
        [numbers[2], numbers[columns + 2]],
    );
    lens.checked().map_err(|cause| bad(cause.into()))
}

/// Converts 12 or 16 numbers, row by row, to a pose whose camera has X right, Y down, Z forward.
pub(super) fn pose_from_rows(rows: &[f64]) -> Result<Pose, String> {
    let mut numbers = [0.0; 16];
    numbers[15] = 1.0;
    if !matches!(rows.len(), 12 | 16) {
        return Err(format!("holds {} numbers, not 16", rows.len()));
    }
    numbers[..rows.len()].copy_from_slice(rows);
    Pose::from_opencv(DMat4::from_cols_array(&numbers).transpose())
}
