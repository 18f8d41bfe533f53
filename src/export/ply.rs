//! PLY files: plain points, and flat Gaussians in the layout of 3D Gaussian splatting (Kerbl et al. 2023).

use super::ExportError;
use super::surfels::{self, Ellipse, Surfel};
use crate::packed::PackedCube;
use glam::{Mat3, Quat, Vec3};
use std::io::Write;

/// Deviation of a Gaussian, in spacings of samples. Sorted Gaussians are laid over one another, not averaged: at half a spacing, as the
/// renderer has them, a surface would let a sixth of what is behind it through between four samples, here 4 %.
const SPACINGS: f64 = 0.65;
/// Thickness of a Gaussian over its smaller deviation.
const FLATNESS: f32 = 0.02;
/// Opacities are stored as logits, which must be finite.
const OPACITY: [f32; 2] = [0.004, 0.996];
/// Of the spherical harmonic of degree 0.
const HARMONIC_0: f32 = 0.282_094_8;

/// Writes all samples as points with normal and colour, world metres with Y up.
///
/// # Errors
/// [`ExportError::Empty`], [`ExportError::Io`].
pub fn write_points(cube: &PackedCube, to: &mut dyn Write) -> Result<(), ExportError> {
    let properties = ["double x", "double y", "double z", "float nx", "float ny", "float nz"].into_iter();
    let colors = ["uchar red", "uchar green", "uchar blue", "uchar alpha"];
    header(to, cube, surfels::count(cube, false), properties.chain(colors))?;
    surfels::for_each(cube, false, &mut |surfel| {
        let mut bytes = Vec::with_capacity(40);
        let position = cube.info.centre + surfel.position;
        bytes.extend(position.to_array().iter().flat_map(|c| c.to_le_bytes()));
        bytes.extend(surfel.normal.as_vec3().to_array().iter().flat_map(|c| c.to_le_bytes()));
        bytes.extend(surfel.color_srgb);
        to.write_all(&bytes)
    })?;
    Ok(())
}

/// Writes all samples, and the environment far away, as flat Gaussians. Positions are metres from the centre of the headbox, X right,
/// Y down, Z ahead, as trained splats have it.
///
/// # Errors
/// [`ExportError::Empty`], [`ExportError::Io`].
pub fn write_splats(cube: &PackedCube, to: &mut dyn Write) -> Result<(), ExportError> {
    let names = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let properties: Vec<String> = names.split(' ').map(|name| format!("float {name}")).collect();
    header(to, cube, surfels::count(cube, true), properties.iter().map(String::as_str))?;
    surfels::for_each(cube, true, &mut |surfel| {
        let values = gaussian(&surfel);
        to.write_all(&values.map(f32::to_le_bytes).concat())
    })?;
    Ok(())
}

fn header<'a>(
    to: &mut dyn Write,
    cube: &PackedCube,
    count: u64,
    properties: impl Iterator<Item = &'a str>,
) -> Result<(), ExportError> {
    if count == 0 {
        return Err(ExportError::Empty);
    }
    let [x, y, z] = cube.info.centre.to_array();
    write!(to, "ply\nformat binary_little_endian 1.0\ncomment headbox: centre {x} {y} {z}, metres, Y up\n")?;
    writeln!(to, "element vertex {count}")?;
    for property in properties {
        writeln!(to, "property {property}")?;
    }
    Ok(writeln!(to, "end_header")?)
}

/// The numbers of a Gaussian in their order.
fn gaussian(surfel: &Surfel) -> [f32; 17] {
    let turned = |v: Vec3| Vec3::new(v.x, -v.y, -v.z);
    let Ellipse { axes, deviations: [a, b] } = surfel.ellipse(SPACINGS);
    let [x, y, z] = turned(surfel.position.as_vec3()).to_array();
    let [nx, ny, nz] = turned(surfel.normal.as_vec3()).to_array();
    let [u, v, w] = axes.map(turned);
    let rotation = Quat::from_mat3(&Mat3::from_cols(u, v, w));
    let [red, green, blue, alpha] = surfel.color_srgb.map(|c| f32::from(c) / 255.0);
    let [r, g, b_] = [red, green, blue].map(|c| (c - 0.5) / HARMONIC_0);
    let opacity = alpha.clamp(OPACITY[0], OPACITY[1]);
    let [sa, sb, sc] = [a, b, b.min(a) * FLATNESS].map(|s| s.max(1e-9).ln());
    let [qx, qy, qz, qw] = rotation.to_array();
    [x, y, z, nx, ny, nz, r, g, b_, (opacity / (1.0 - opacity)).ln(), sa, sb, sc, qw, qx, qy, qz]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn gaussians_are_flat_along_the_normal() {
        let along = [DVec3::new(0.1, 0.0, 0.0), DVec3::new(0.0, 0.2, 0.0)];
        let surfel =
            Surfel { position: DVec3::new(1.0, 2.0, -3.0), normal: DVec3::Z, along, color_srgb: [255, 0, 128, 255] };
        let [x, y, z, .., sa, sb, sc, qw, qx, qy, qz] = gaussian(&surfel);
        assert_eq!([x, y, z], [1.0, -2.0, 3.0]);
        assert!((sa.exp() - 0.13).abs() < 1e-6 && (sb.exp() - 0.065).abs() < 1e-6 && sc < sb - 3.0);
        let rotation = Mat3::from_quat(Quat::from_xyzw(qx, qy, qz, qw));
        assert!(rotation.x_axis.y.abs() > 0.999, "the longer axis is that of the wider step");
        assert!(rotation.z_axis.z.abs() > 0.999);
    }
}
