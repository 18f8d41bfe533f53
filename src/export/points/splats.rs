//! Flat Gaussians for splat viewers: `.ply` in the layout of 3D Gaussian splatting (Kerbl et al.
//! 2023).
//!
//! Positions are metres from the centre of the headbox, X right, Y down, Z ahead, like those of
//! trained splats.

use super::{PointBudget, PointSummary, Points, ply};
use crate::ExportError;
use crate::points::surfels::{Ellipse, Surfel};
use glam::{Mat3, Quat, Vec3};
use headbox_core::progress::Progress;
use headbox_cube::pack::CubeLdi;
use std::io::Write;

/// Standard deviation of a Gaussian, in sample spacings. Viewers composite sorted Gaussians instead
/// of averaging them: at half a spacing, which the renderer uses, a sixth of the background would
/// show through between four samples, here 4 %.
const SPACINGS: f64 = 0.65;
/// Thickness of a Gaussian relative to its smaller deviation.
const FLATNESS: f32 = 0.02;
/// Range of opacities: they are stored as logits, which must be finite.
const OPACITY: [f32; 2] = [0.004, 0.996];
/// Value of the spherical harmonic of degree 0.
const HARMONIC_0: f32 = 0.282_094_8;

/// Description of the positions.
const AXES: &str = "metres from the centre of the headbox, X right, Y down, Z ahead";

/// Properties of a Gaussian.
const PROPERTIES: [&str; 17] = [
    "float x",
    "float y",
    "float z",
    "float nx",
    "float ny",
    "float nz",
    "float f_dc_0",
    "float f_dc_1",
    "float f_dc_2",
    "float opacity",
    "float scale_0",
    "float scale_1",
    "float scale_2",
    "float rot_0",
    "float rot_1",
    "float rot_2",
    "float rot_3",
];

/// Writes all samples, and the environment at a large distance; within a budget, neighbours on one
/// surface are merged.
///
/// # Errors
/// [`ExportError::Empty`], [`ExportError::Budget`], [`ExportError::Io`].
pub fn write_ply(
    cube: &CubeLdi,
    budget: PointBudget,
    progress: &dyn Progress,
    to: &mut dyn Write,
) -> Result<PointSummary, ExportError> {
    let header_bytes = ply::header(cube, &PROPERTIES, AXES, u64::MAX).len() as u64;
    let sizes = [header_bytes, 4 * PROPERTIES.len() as u64];
    let points = Points::new(cube, true, budget, sizes, progress)?;
    to.write_all(ply::header(cube, &PROPERTIES, AXES, points.summary.points).as_bytes())?;
    points.for_each(progress, &mut |surfel| {
        let values = Gaussian::new(surfel, flip).values();
        Ok(to.write_all(&values.map(f32::to_le_bytes).concat())?)
    })?;
    Ok(points.summary)
}

/// Flat Gaussian.
pub(super) struct Gaussian {
    pub(super) position: Vec3,
    normal: Vec3,
    /// Standard deviations along its axes, metres; the third axis is the normal.
    pub(super) deviations: [f32; 3],
    pub(super) rotation: Quat,
    /// sRGB, straight alpha.
    pub(super) color_srgb: [u8; 4],
}

/// Turns a vector into the axes of trained splats: X right, Y down, Z ahead.
fn flip(v: Vec3) -> Vec3 {
    Vec3::new(v.x, -v.y, -v.z)
}

/// Returns the coefficients of the spherical harmonic of degree 0 that give a colour.
pub(super) fn harmonics([r, g, b, _]: [u8; 4]) -> [f32; 3] {
    [r, g, b].map(|c| (f32::from(c) / 255.0 - 0.5) / HARMONIC_0)
}

impl Gaussian {
    /// Creates the Gaussian of a surfel in the axes of a file, to which `turn` rotates those of the
    /// world.
    pub(super) fn new(surfel: &Surfel, turn: fn(Vec3) -> Vec3) -> Self {
        let Ellipse {
            axes,
            deviations: [a, b],
        } = surfel.ellipse(SPACINGS);
        let [u, v, w] = axes.map(turn);
        Self {
            position: turn(surfel.position.as_vec3()),
            normal: turn(surfel.normal.as_vec3()),
            deviations: [a, b, b.min(a) * FLATNESS].map(|s| s.max(1e-9)),
            rotation: Quat::from_mat3(&Mat3::from_cols(u, v, w)),
            color_srgb: surfel.color_srgb,
        }
    }

    /// Returns the values of a vertex in the order of the file.
    fn values(&self) -> [f32; 17] {
        let ([x, y, z], [nx, ny, nz]) = (self.position.to_array(), self.normal.to_array());
        let [r, g, b] = harmonics(self.color_srgb);
        let alpha = f32::from(self.color_srgb[3]) / 255.0;
        let opacity = alpha.clamp(OPACITY[0], OPACITY[1]);
        let [sa, sb, sc] = self.deviations.map(f32::ln);
        let [qx, qy, qz, qw] = self.rotation.to_array();
        [
            x,
            y,
            z,
            nx,
            ny,
            nz,
            r,
            g,
            b,
            (opacity / (1.0 - opacity)).ln(),
            sa,
            sb,
            sc,
            qw,
            qx,
            qy,
            qz,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn gaussian() -> Gaussian {
        let along = [DVec3::new(0.1, 0.0, 0.0), DVec3::new(0.0, 0.2, 0.0)];
        let position = DVec3::new(1.0, 2.0, -3.0);
        let surfel = Surfel {
            position,
            normal: DVec3::Z,
            along,
            color_srgb: [255, 0, 128, 255],
        };
        Gaussian::new(&surfel, flip)
    }

    #[test]
    fn gaussians_are_flat_along_the_normal() {
        let [x, y, z, .., sa, sb, sc, qw, qx, qy, qz] = gaussian().values();
        assert_eq!([x, y, z], [1.0, -2.0, 3.0]);
        assert!((sa.exp() - 0.13).abs() < 1e-6 && (sb.exp() - 0.065).abs() < 1e-6 && sc < sb - 3.0);
        let rotation = Mat3::from_quat(Quat::from_xyzw(qx, qy, qz, qw));
        assert!(
            rotation.x_axis.y.abs() > 0.999,
            "the longer axis is that of the wider step"
        );
        assert!(rotation.z_axis.z.abs() > 0.999);
    }
}
