//! LAS files: points with colours, for programs that survey.

use super::ExportError;
use crate::surfels;
use headbox_cube::pack::PackedCube;
use glam::DVec3;
use las::{Builder, Color, Point, Transform, Vector, point::Format};
use std::io::{self, Write};

/// Metres of a step of a coordinate, at the least.
const STEP_M: f64 = 1e-4;
/// Points of a file of version 1.2, which every program reads, at most.
const MAX_POINTS: u64 = u32::MAX as u64;
/// Bytes of a point with colour.
const POINT_BYTES: u64 = 26;

/// Writes all samples as points with colour: metres, and Z up as surveys have it.
///
/// # Errors
/// [`ExportError::Empty`], [`ExportError::TooLarge`], [`ExportError::Io`].
pub fn write(cube: &PackedCube, to: &mut dyn Write) -> Result<(), ExportError> {
    let count = surfels::count(cube, false);
    if count == 0 {
        return Err(ExportError::Empty);
    }
    if count > MAX_POINTS {
        return Err(ExportError::TooLarge { bytes: count * POINT_BYTES, limit: MAX_POINTS * POINT_BYTES });
    }
    let mut farthest = 0.0f64;
    surfels::for_each(cube, false, &mut |surfel| {
        farthest = farthest.max(surfel.position.abs().max_element());
        Ok(())
    })?;
    let z_up = |p: DVec3| DVec3::new(p.x, -p.z, p.y);
    let offset = z_up(cube.info.centre).round();
    let scale = STEP_M.max((farthest + 1.0) / f64::from(i32::MAX));
    let mut builder = Builder::from((1, 2));
    builder.point_format = Format::new(2).map_err(io::Error::other)?;
    let [x, y, z] = offset.to_array().map(|offset| Transform { scale, offset });
    builder.transforms = Vector { x, y, z };
    builder.generating_software = "headbox".into();
    let header = builder.into_header().map_err(io::Error::other)?;
    let mut writer = las::Writer::new(io::Cursor::new(Vec::new()), header).map_err(io::Error::other)?;
    surfels::for_each(cube, false, &mut |surfel| {
        let [x, y, z] = z_up(cube.info.centre + surfel.position).to_array();
        let [red, green, blue, _] = surfel.color_srgb.map(|c| u16::from(c) * 257);
        let point = Point { x, y, z, color: Some(Color { red, green, blue }), ..Point::default() };
        writer.write_point(point).map_err(io::Error::other)
    })?;
    let file = writer.into_inner().map_err(io::Error::other)?;
    Ok(to.write_all(file.get_ref())?)
}
