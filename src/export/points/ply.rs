//! PLY files of points, and the header of all PLY files.

use crate::ExportError;
use crate::points::surfels::surfels;
use headbox_cube::pack::CubeLdi;
use std::io::Write;

/// Writes all samples as points with normal and colour, world metres with Y up.
///
/// # Errors
/// [`ExportError::Empty`], [`ExportError::Io`].
pub fn write_points(cube: &CubeLdi, to: &mut dyn Write) -> Result<(), ExportError> {
    let properties = [
        "double x", "double y", "double z", "float nx", "float ny", "float nz",
    ]
    .into_iter();
    let colors = ["uchar red", "uchar green", "uchar blue", "uchar alpha"];
    write_header(to, cube, false, properties.chain(colors))?;
    for surfel in surfels(cube, false) {
        let position = cube.info.centre + surfel.position;
        to.write_all(bytemuck::bytes_of(&position))?;
        to.write_all(bytemuck::bytes_of(&surfel.normal.as_vec3()))?;
        to.write_all(&surfel.color_srgb)?;
    }
    Ok(())
}

/// Writes the header of a file with a vertex for each of [`surfels`].
pub(crate) fn write_header<'a>(
    to: &mut dyn Write,
    cube: &CubeLdi,
    sky: bool,
    properties: impl Iterator<Item = &'a str>,
) -> Result<(), ExportError> {
    let count = surfels(cube, sky).count();
    if count == 0 {
        return Err(ExportError::Empty);
    }
    let [x, y, z] = cube.info.centre.to_array();
    write!(
        to,
        "ply\nformat binary_little_endian 1.0\ncomment headbox: centre {x} {y} {z}, metres, Y up\n"
    )?;
    writeln!(to, "element vertex {count}")?;
    for property in properties {
        writeln!(to, "property {property}")?;
    }
    Ok(writeln!(to, "end_header")?)
}
