//! PLY files of points, and the header of all PLY files.

use super::{PointBudget, PointSummary, Points};
use crate::ExportError;
use headbox_core::progress::Progress;
use headbox_cube::pack::CubeLdi;
use std::io::Write;

/// Description of the positions.
const AXES: &str = "metres, X right, Y up";

/// Properties of a point.
const PROPERTIES: [&str; 10] = [
    "double x",
    "double y",
    "double z",
    "float nx",
    "float ny",
    "float nz",
    "uchar red",
    "uchar green",
    "uchar blue",
    "uchar alpha",
];

/// Writes all samples as points with normal and colour, world metres with Y up; within a budget,
/// neighbours on one surface are merged.
///
/// # Errors
/// [`ExportError::Empty`], [`ExportError::Budget`], [`ExportError::Io`].
pub fn write_points(
    cube: &CubeLdi,
    budget: PointBudget,
    progress: &dyn Progress,
    to: &mut dyn Write,
) -> Result<PointSummary, ExportError> {
    /// Bytes of a point.
    const POINT_BYTES: u64 = 3 * 8 + 3 * 4 + 4;
    let sizes = [
        header(cube, &PROPERTIES, AXES, u64::MAX).len() as u64,
        POINT_BYTES,
    ];
    let points = Points::new(cube, false, budget, sizes, progress)?;
    to.write_all(header(cube, &PROPERTIES, AXES, points.summary.points).as_bytes())?;
    points.for_each(progress, &mut |surfel| {
        let position = cube.info.centre + surfel.position;
        to.write_all(bytemuck::bytes_of(&position))?;
        to.write_all(bytemuck::bytes_of(&surfel.normal.as_vec3()))?;
        Ok(to.write_all(&surfel.color_srgb)?)
    })?;
    Ok(points.summary)
}

/// Returns the header of a file with `count` vertices; `axes` describes their positions.
pub(crate) fn header(cube: &CubeLdi, properties: &[&str], axes: &str, count: u64) -> String {
    let [x, y, z] = cube.info.centre.to_array();
    let properties: String = properties
        .iter()
        .map(|property| format!("property {property}\n"))
        .collect();
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment headbox: centre {x} {y} {z}, metres, Y up\n\
         comment vertices: {axes}\nelement vertex {count}\n{properties}end_header\n"
    )
}
