//! Text files of camera matrices and camera trajectories.

use super::text;
use crate::ImagesError;
use crate::cameras::lens::{Distortion, Pinhole};
use crate::cameras::pose::Pose;
use crate::views::view::View;
use glam::DMat4;
use headbox_core::files::InputFolder;
use headbox_core::read_note::ReadNote;
use std::path::Path;

/// Creates a pinhole from intrinsics with pixel centres at integers.
pub(super) fn create_pinhole(focal_px: [f64; 2], principal: [f64; 2]) -> Pinhole {
    Pinhole {
        focal_px,
        principal_px: principal.map(|c| c + 0.5),
        distortion: Distortion::default(),
    }
}

/// Reads intrinsics with pixel centres at integers: a matrix of 3x3, 3x4 or 4x4 numbers, square
/// ones also column by column; or focal lengths and principal point, alone or with OpenCV's k1, k2,
/// p1, p2 and k3.
pub(super) fn read_intrinsics(folder: &InputFolder, file: &Path) -> Result<Pinhole, ImagesError> {
    let numbers = text::read_number_list(folder, file)?;
    parse_intrinsics(&numbers)
        .and_then(|lens| Ok(lens.checked()?))
        .map_err(|cause| ImagesError::field(file, "the intrinsics", cause))
}

fn parse_intrinsics(numbers: &[f64]) -> Result<Pinhole, String> {
    if let &[fx, fy, cx, cy] = numbers {
        return Ok(create_pinhole([fx, fy], [cx, cy]));
    }
    let columns = match numbers.len() {
        9 => 3,
        12 | 16 => 4,
        count => {
            return Err(format!(
                "must hold 9 finite numbers (3x3), or 12, 16 or 4; holds {count}"
            ));
        }
    };
    let row = |i: usize| [0, 1, 2].map(|j| numbers[i * columns + j]);
    let column = |j: usize| [0, 1, 2].map(|i| numbers[i * columns + j]);
    if row(2) == [0.0, 0.0, 1.0] {
        let ([fx, _, cx], [_, fy, cy]) = (row(0), row(1));
        return Ok(create_pinhole([fx, fy], [cx, cy]));
    }
    if columns * columns == numbers.len() && column(2) == [0.0, 0.0, 1.0] {
        let ([fx, _, cx], [_, fy, cy]) = (column(0), column(1));
        return Ok(create_pinhole([fx, fy], [cx, cy]));
    }
    match *numbers {
        // The second number of a matrix is its skew.
        [fx, fy, cx, cy, k1, k2, p1, p2, k3] if fy > 0.5 * fx && fy < 2.0 * fx => Ok(Pinhole {
            distortion: Distortion {
                radial: [k1, k2, k3, 0.0, 0.0, 0.0],
                tangential: [p1, p2],
            },
            ..create_pinhole([fx, fy], [cx, cy])
        }),
        _ => Err("are not a matrix, whose third row must be 0 0 1".into()),
    }
}

/// Returns a note on the views whose principal point lies outside the middle half of the image:
/// their intrinsics may be those of another size.
pub(super) fn note_principal(views: &[View]) -> Option<ReadNote> {
    let is_far = |view: &&View| {
        view.pinhole().is_some_and(|lens| {
            let share = |k: usize| lens.principal_px[k] / f64::from(view.size_px[k]);
            !(0..2).all(|k| (0.25..=0.75).contains(&share(k)))
        })
    };
    let far: Vec<String> = views
        .iter()
        .filter(is_far)
        .map(|view| view.name.clone())
        .collect();
    let sentence = "the principal point of the intrinsics is far from the middle of the image; are \
                    they for images of another size?";
    text::note_names(sentence, &far)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intrinsics_read_in_every_order() {
        let pinhole = create_pinhole([60.0, 61.0], [47.0, 48.0]);
        for numbers in [
            &[60.0, 61.0, 47.0, 48.0][..],
            &[60.0, 0.0, 47.0, 0.0, 61.0, 48.0, 0.0, 0.0, 1.0],
            &[60.0, 0.0, 0.0, 0.0, 61.0, 0.0, 47.0, 48.0, 1.0],
        ] {
            assert_eq!(parse_intrinsics(numbers), Ok(pinhole), "{numbers:?}");
        }
        let lens = parse_intrinsics(&[60.0, 61.0, 47.0, 48.0, 0.1, 0.2, 0.3, 0.4, 0.5]);
        let distortion = Distortion {
            radial: [0.1, 0.2, 0.5, 0.0, 0.0, 0.0],
            tangential: [0.3, 0.4],
        };
        let expected = Pinhole {
            distortion,
            ..pinhole
        };
        assert_eq!(lens, Ok(expected));
        let scaled = parse_intrinsics(&[60.0, 0.0, 47.0, 0.0, 61.0, 48.0, 0.0, 0.0, 2.0]);
        assert!(scaled.expect_err("refused").contains("0 0 1"));
    }
}
