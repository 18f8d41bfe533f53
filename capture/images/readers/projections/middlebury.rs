//! Reader of Middlebury's multi-view sets: photographs and `NAME_par.txt`, one line per photograph
//! with name, K, R and t.

use crate::cameras::lens::{Distortion, Lens, Pinhole};
use crate::cameras::pose::Pose;
use crate::readers::text;
use crate::views::color_images::read_size;
use crate::views::view::View;
use crate::{ImageSet, ImagesError, resolve};
use glam::{DMat3, DVec3};
use headbox_core::files::InputFolder;
use std::path::{Path, PathBuf};

/// Opens the set in a folder; `None` without a parameter file.
pub(crate) fn open(folder: &InputFolder) -> Result<Option<ImageSet>, ImagesError> {
    let files = text::list_folder(folder.path())?;
    let is_parameter_file = |path: &PathBuf| path.to_string_lossy().ends_with("_par.txt");
    let Some(file) = files.into_iter().find(is_parameter_file) else {
        return Ok(None);
    };
    let parameters = text::read_text(folder, &file)?;
    let mut views = Vec::new();
    for (line, number) in parameters
        .lines()
        .zip(1..)
        .skip(1)
        .filter(|(line, _)| !line.trim().is_empty())
    {
        views.push(read_line(folder, &file, line, number)?);
    }
    if views.is_empty() {
        return Err(ImagesError::field(&file, "the file", "names no image"));
    }
    let format = "Middlebury multi-view";
    Ok(Some(ImageSet::new(folder.path(), format, views)))
}

fn read_line(
    folder: &InputFolder,
    file: &Path,
    line: &str,
    number: usize,
) -> Result<View, ImagesError> {
    let field = format!("line {number}");
    let bad = |cause: &str| ImagesError::field(file, field.clone(), cause);
    let mut words = line.split_whitespace();
    let name = words.next().ok_or_else(|| bad("names no image"))?;
    let numbers: Option<Vec<f64>> = words
        .map(|word| word.parse().ok().filter(|n: &f64| n.is_finite()))
        .collect();
    let numbers: Option<[f64; 21]> = numbers.and_then(|numbers| numbers.try_into().ok());
    let p = numbers.ok_or_else(|| bad("expected a name and 21 finite numbers: K, R, t"))?;
    let rotation = DMat3::from_cols_array(&std::array::from_fn(|i| p[9 + i])).transpose();
    let pose = Pose::from_camera_from_world(rotation, DVec3::new(p[18], p[19], p[20]))
        .map_err(|cause| bad(&cause))?;
    let color = resolve(folder, file, &field, name)?;
    let size_px = read_size(&color)?;
    // These files have pixel centres at integers.
    let principal_px = [p[2] + 0.5, p[5] + 0.5];
    let lens = Pinhole {
        focal_px: [p[0], p[4]],
        principal_px,
        distortion: Distortion::default(),
    };
    let lens = lens.checked().map(Lens::Pinhole).map_err(bad)?;
    Ok(View::new(name.into(), size_px, lens, pose, color, None))
}
