//! Reader of projection matrices: photographs with a text file `NAME.P` each, or one MATLAB file
//! with a variable `P` for all photographs of the folder by name (the layouts of Oxford's VGG).
//!
//! P = K [R | t], up to a factor: its left 3x3 part is decomposed by RQ (Hartley and Zisserman,
//! Multiple View Geometry, 6.2.4), with positive focal lengths. The factor's sign is the one with
//! which R is a rotation.

use super::mat5::{self, Array, Value};
use crate::cameras::lens::{Distortion, Lens, Pinhole};
use crate::cameras::pose::Pose;
use crate::readers::text;
use crate::views::color_images::read_size;
use crate::views::view::View;
use crate::{ImageSet, ImagesError};
use glam::{DMat3, DVec3};
use headbox_core::files::InputFolder;
use std::path::{Path, PathBuf};

/// Maximum displacement of a pixel by a skew that is ignored, pixels.
const IGNORED_SKEW_PX: f64 = 1.0;

/// Determinant of a matrix of rows of length 1 below which it counts as singular.
const SINGULAR: f64 = 1e-12;

/// A 3x4 matrix, by rows.
type Projection = [[f64; 4]; 3];

/// Opens the set in a folder; `None` without projection matrices.
pub(crate) fn open(folder: &InputFolder) -> Result<Option<ImageSet>, ImagesError> {
    let files = text::list_folder(folder.path())?;
    let has_extension = |path: &Path, wanted: &str| {
        path.extension()
            .is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
    };
    let matrices: Vec<&PathBuf> = files.iter().filter(|f| has_extension(f, "P")).collect();
    let images: Vec<&PathBuf> = files
        .iter()
        .filter(|path| path.is_file() && image::ImageFormat::from_path(path).is_ok())
        .collect();
    let mut skew_px = 0.0f64;
    let mut views = Vec::new();
    let mut without_image = Vec::new();
    if matrices.is_empty() {
        let Some((file, projections)) = read_matlab_file(folder, &files, &has_extension)? else {
            return Ok(None);
        };
        if projections.len() != images.len() {
            let cause = format!(
                "holds {} projection matrices, but the folder has {} images",
                projections.len(),
                images.len()
            );
            return Err(ImagesError::field(&file, "P", cause));
        }
        for ((projection, color), number) in projections.iter().zip(images).zip(1..) {
            let field = format!("P of image {number} ({})", text::file_name(color));
            views.push(create_view(color, projection, &mut skew_px, &file, &field)?);
        }
    } else {
        for file in matrices {
            let numbers = text::read_numbers(folder, file, 12, "the projection matrix")?;
            let stem = file.with_extension("");
            let is_own = |image: &&&PathBuf| image.with_extension("") == stem || ***image == stem;
            let Some(color) = images.iter().find(is_own) else {
                without_image.push(text::file_name(file));
                continue;
            };
            let projection =
                std::array::from_fn(|row| std::array::from_fn(|column| numbers[4 * row + column]));
            let field = "the projection matrix";
            views.push(create_view(color, &projection, &mut skew_px, file, field)?);
        }
        if views.is_empty() {
            return Err(ImagesError::field(
                folder.path(),
                "*.P",
                "no file has an image of its name next to it",
            ));
        }
    }
    let mut notes = Vec::new();
    if skew_px > 0.01 {
        notes.push(format!(
            "the skew of the projection matrices, which moves pixels by up to {skew_px:.2}, is ignored"
        ).into());
    }
    notes.extend(text::note_names("skipped, without image", &without_image));
    Ok(Some(ImageSet {
        notes,
        ..ImageSet::new(folder.path(), "projection matrices", views)
    }))
}

/// Reads the projection matrices of the first MATLAB file that has a variable `P`.
fn read_matlab_file(
    folder: &InputFolder,
    files: &[PathBuf],
    has_extension: &dyn Fn(&Path, &str) -> bool,
) -> Result<Option<(PathBuf, Vec<Projection>)>, ImagesError> {
    for file in files.iter().filter(|path| has_extension(path, "mat")) {
        let bytes = text::read_bytes(folder, file)?;
        let value = mat5::read_variable(&bytes, "P")
            .map_err(|cause| ImagesError::invalid_picture(file, cause))?;
        let Some(value) = value else { continue };
        let bad = |cause: String| ImagesError::field(file, "P", cause);
        let arrays = match value {
            Value::Cells(arrays) => arrays,
            Value::Numeric(array) => split_stack(array).map_err(bad)?,
        };
        let projections: Result<Vec<Projection>, String> = arrays.iter().map(to_rows).collect();
        return Ok(Some((file.clone(), projections.map_err(bad)?)));
    }
    Ok(None)
}

/// Splits an array of 3x4xN numbers.
fn split_stack(array: Array) -> Result<Vec<Array>, String> {
    match array.dimensions[..] {
        [3, 4] | [3, 4, _] => Ok(array
            .values
            .chunks_exact(12)
            .map(|values| Array {
                dimensions: vec![3, 4],
                values: values.to_vec(),
            })
            .collect()),
        _ => Err(format!(
            "must be a cell array of 3x4 matrices or a 3x4xN array, not {:?}",
            array.dimensions
        )),
    }
}

/// Converts an array, stored by columns.
fn to_rows(array: &Array) -> Result<Projection, String> {
    if array.dimensions != [3, 4] || !array.values.iter().all(|value| value.is_finite()) {
        return Err(format!(
            "must have finite 3x4 matrices, not {:?}",
            array.dimensions
        ));
    }
    Ok(std::array::from_fn(|row| {
        std::array::from_fn(|column| array.values[3 * column + row])
    }))
}

/// Creates the view of an image; `skew_px` becomes the largest displacement by skew.
fn create_view(
    color: &Path,
    projection: &Projection,
    skew_px: &mut f64,
    file: &Path,
    field: &str,
) -> Result<View, ImagesError> {
    let bad = |cause: String| ImagesError::field(file, field, cause);
    let size_px = read_size(color)?;
    let Decomposition { k, rotation, eye } = decompose(projection).map_err(bad)?;
    // Rows farthest from the principal point.
    let farthest = k
        .z_axis
        .y
        .abs()
        .max((f64::from(size_px[1]) - k.z_axis.y).abs());
    let displacement = (k.y_axis.x * farthest / k.y_axis.y).abs();
    if displacement > IGNORED_SKEW_PX {
        return Err(bad(format!(
            "has a skew of {:.4} px, which moves pixels by up to {displacement:.1}; images need square axes: rectify them",
            k.y_axis.x
        )));
    }
    *skew_px = skew_px.max(displacement);
    let pose = Pose::from_camera_from_world(rotation, -(rotation * eye)).map_err(bad)?;
    // Pixel centres at integers.
    let lens = Pinhole {
        focal_px: [k.x_axis.x, k.y_axis.y],
        principal_px: [k.z_axis.x + 0.5, k.z_axis.y + 0.5],
        distortion: Distortion::default(),
    };
    let lens = lens.checked().map_err(|cause| bad(cause.into()))?;
    let name = text::file_name(color);
    Ok(View::new(
        name,
        size_px,
        Lens::Pinhole(lens),
        pose,
        color.into(),
        None,
    ))
}

/// Camera of a projection matrix.
#[derive(Clone, Copy, Debug)]
struct Decomposition {
    /// Upper triangular intrinsics with positive focal lengths and a last element of 1.
    k: DMat3,
    /// Rotation from the world to the camera (X right, Y down, Z forward).
    rotation: DMat3,
    /// Eye, in the file's unit.
    eye: DVec3,
}

/// Decomposes P = K [R | t].
///
/// # Errors
/// The problem, as the rest of a sentence.
fn decompose(projection: &Projection) -> Result<Decomposition, String> {
    let row = |i: usize| DVec3::new(projection[i][0], projection[i][1], projection[i][2]);
    let [a, b, c] = [0, 1, 2].map(row);
    let volume = a.dot(b.cross(c));
    let lengths = a.length() * b.length() * c.length();
    if !(lengths.is_finite() && volume.abs() > SINGULAR * lengths) {
        return Err(
            "its left 3x3 part is singular: an affine camera, or not a camera at all".into(),
        );
    }
    let sign = volume.signum();
    let [a, b, c] = [a, b, c].map(|row| row * sign);
    // Gram-Schmidt from the last row up.
    let ahead = c.normalize();
    let focal_y = (b - ahead * b.dot(ahead)).length();
    let down = (b - ahead * b.dot(ahead)) / focal_y;
    // A rotation, since the determinant is positive.
    let right = down.cross(ahead);
    let scale = c.length();
    let k = DMat3::from_cols(
        DVec3::new(a.dot(right), 0.0, 0.0) / scale,
        DVec3::new(a.dot(down), focal_y, 0.0) / scale,
        DVec3::new(a.dot(ahead), b.dot(ahead), scale) / scale,
    );
    let last = DVec3::from_array([0, 1, 2].map(|i| projection[i][3] * sign));
    let rows = DMat3::from_cols(a, b, c).transpose();
    Ok(Decomposition {
        k,
        rotation: DMat3::from_cols(right, down, ahead).transpose(),
        eye: -(rows.inverse() * last),
    })
}

#[cfg(test)]
mod tests {
    use super::mat5::tests::cells;
    use super::*;
    use crate::ImageSetOptions;
    use image::RgbImage;

    const FOCAL: [f64; 2] = [700.0, 710.0];
    const PRINCIPAL: [f64; 2] = [31.0, 25.0];

    fn rotation(i: usize) -> DMat3 {
        DMat3::from_rotation_y(0.4 * i as f64) * DMat3::from_rotation_x(0.3 - 0.2 * i as f64)
    }

    fn eye(i: usize) -> DVec3 {
        DVec3::new(0.5 * i as f64, -1.0, 2.0)
    }

    /// Projection matrix of view `i`, times `factor`, by rows.
    fn projection(i: usize, skew: f64, factor: f64) -> Projection {
        let k = DMat3::from_cols(
            DVec3::new(FOCAL[0], 0.0, 0.0),
            DVec3::new(skew, FOCAL[1], 0.0),
            DVec3::new(PRINCIPAL[0], PRINCIPAL[1], 1.0),
        );
        let left = k * rotation(i) * factor;
        let last = left * -eye(i);
        std::array::from_fn(|row| {
            std::array::from_fn(|column| {
                if column < 3 {
                    left.col(column)[row]
                } else {
                    last[row]
                }
            })
        })
    }

    fn write_images(folder: &Path, count: usize) {
        for i in 0..count {
            let image = RgbImage::new(64, 48);
            image
                .save(folder.join(format!("v.{i:03}.png")))
                .expect("written");
        }
    }

    fn write_text(folder: &Path, i: usize, projection: &Projection) {
        let rows = projection.map(|row| row.map(|value| value.to_string()).join(" "));
        std::fs::write(folder.join(format!("v.{i:03}.P")), rows.join("\n")).expect("written");
    }

    fn read(folder: &Path) -> Result<ImageSet, ImagesError> {
        ImageSet::open(folder, &ImageSetOptions::default())
    }

    /// Checks eyes, directions and lenses of two views.
    fn check(set: &ImageSet) {
        assert_eq!((set.views.len(), set.format), (2, "projection matrices"));
        for (i, view) in set.views.iter().enumerate() {
            // Sixteen digits, lost to products of up to 1e3.
            assert!(view.pose.eye.distance(eye(i)) < 1e-9, "{:?}", view.pose);
            let ahead = rotation(i).transpose() * DVec3::Z;
            assert!((view.pose.world_from_eye * -DVec3::Z).distance(ahead) < 1e-9);
            let lens = view.pinhole().expect("a pinhole");
            for axis in 0..2 {
                assert!((lens.focal_px[axis] - FOCAL[axis]).abs() < 1e-6);
                assert!((lens.principal_px[axis] - PRINCIPAL[axis] - 0.5).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn text_matrices_of_either_sign_are_decomposed() {
        for factor in [1.0, -1.0, 0.003, -20.0] {
            let folder = tempfile::tempdir().expect("a folder");
            write_images(folder.path(), 2);
            (0..2).for_each(|i| write_text(folder.path(), i, &projection(i, 0.0, factor)));
            check(&read(folder.path()).expect("opens"));
        }
    }

    #[test]
    fn matlab_cells_are_decomposed() {
        for is_compressed in [false, true] {
            let folder = tempfile::tempdir().expect("a folder");
            write_images(folder.path(), 2);
            let by_columns = [0, 1].map(|i| {
                let rows = projection(i, 0.0, -3.0);
                std::array::from_fn(|k| rows[k % 3][k / 3])
            });
            let bytes = cells(&by_columns, is_compressed);
            std::fs::write(folder.path().join("Ps.mat"), bytes).expect("written");
            check(&read(folder.path()).expect("opens"));
            write_images(folder.path(), 3);
            let error = read(folder.path()).expect_err("three images").to_string();
            assert!(error.contains("2 projection matrices") && error.contains("3 images"));
        }
    }

    #[test]
    fn skewed_and_affine_cameras_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        write_images(folder.path(), 1);
        // A tenth of a pixel is ignored, with a note.
        write_text(folder.path(), 0, &projection(0, 3.0, 1.0));
        let set = read(folder.path()).expect("opens");
        assert!(set.notes.iter().any(|note| note.contains("skew")));
        write_text(folder.path(), 0, &projection(0, 70.0, 1.0));
        let error = read(folder.path()).expect_err("skew").to_string();
        assert!(
            error.contains("v.000.P") && error.contains("skew of 70.0000"),
            "{error}"
        );
        let affine = [
            [1.0, 0.0, 0.0, 5.0],
            [0.0, 1.0, 0.0, 5.0],
            [0.0, 0.0, 0.0, 1.0],
        ];
        write_text(folder.path(), 0, &affine);
        let error = read(folder.path()).expect_err("affine").to_string();
        assert!(error.contains("singular"), "{error}");
        std::fs::remove_file(folder.path().join("v.000.png")).expect("removed");
        assert!(read(folder.path()).is_err(), "no image");
    }
}
