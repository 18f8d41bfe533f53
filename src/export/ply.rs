//! PLY files of points, and the header of all PLY files.

use super::ExportError;
use crate::surfels;
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
    write_header(
        to,
        cube,
        surfels::count(cube, false),
        properties.chain(colors),
    )?;
    surfels::for_each(cube, false, &mut |surfel| {
        let mut bytes = Vec::with_capacity(40);
        let position = cube.info.centre + surfel.position;
        bytes.extend(position.to_array().iter().flat_map(|c| c.to_le_bytes()));
        bytes.extend(
            surfel
                .normal
                .as_vec3()
                .to_array()
                .iter()
                .flat_map(|c| c.to_le_bytes()),
        );
        bytes.extend(surfel.color_srgb);
        to.write_all(&bytes)
    })?;
    Ok(())
}

pub(super) fn write_header<'a>(
    to: &mut dyn Write,
    cube: &CubeLdi,
    count: u64,
    properties: impl Iterator<Item = &'a str>,
) -> Result<(), ExportError> {
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
