//! Plane textures: the parts of a cube LDI whose depth is that of a plane within an error bound
//! (inventory S1 to S3; `docs/primitives.md`).
//!
//! A surface is planar if and only if its inverse depth is affine in a face's pixels: the points P
//! = d / q of a face, d the direction through a pixel at depth 1, satisfy n . P = 1 if and only if
//! q = n . d. So a plane that does not contain the centre is one vector n, the same for all faces;
//! n = 0 is the plane at infinity, with q = 0 everywhere.

use glam::{DVec3, Vec3};
use headbox_core::cube_face::Face;

/// A plane about the centre: the points P with `normal_per_distance . P = 1`.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Plane {
    /// World axes, 1/m: the unit normal over the plane's distance from the centre. Zero is the
    /// plane at infinity.
    pub normal_per_distance: Vec3,
}

impl Plane {
    /// Computes the inverse depth, 1/m, on a face of `size_px` pixels a side, as coefficients of
    /// (1, x, y) with x, y in face pixels.
    pub fn inverse_depth(&self, face: Face, size_px: u32) -> [f64; 3] {
        let n = self.normal_per_distance.as_dvec3();
        let q = n.dot(face.direction(0.0, 0.0, size_px));
        let step = 2.0 / f64::from(size_px);
        [q, n.dot(face.right()) * step, -n.dot(face.up()) * step]
    }

    /// Creates the plane whose inverse depth on a face has given coefficients of (1, x, y): the
    /// inverse of [`Self::inverse_depth`], but for rounding.
    pub fn from_inverse_depth(face: Face, size_px: u32, [q, along_x, along_y]: [f64; 3]) -> Self {
        let half = f64::from(size_px) / 2.0;
        let (right, up) = (along_x * half, -along_y * half);
        let forward = q + right - up;
        let n: DVec3 = face.right() * right + face.up() * up + face.normal() * forward;
        Self {
            normal_per_distance: n.as_vec3(),
        }
    }
}

/// Maximum side of a tile, texels: captures write about 130 at most, and the exporters' texture
/// atlases rely on the limit.
pub(crate) const MAX_TILE_PX: u16 = 1024;

/// A plane texture: a rectangle of face pixels, one texel each. It is drawn between the centres of
/// its outermost texels, so that adjacent tiles, which share a line of texels, meet without a gap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct PlaneTile {
    /// Index of the plane.
    pub plane: u32,
    /// Index of the first texel.
    pub first_texel: u32,
    /// Left column on the face, from -1: a tile may extend one pixel beyond each side of its face.
    pub x0: i16,
    /// Upper row on the face.
    pub y0: i16,
    /// Columns, at least 2.
    pub width: u16,
    /// Rows, at least 2.
    pub height: u16,
    /// [`Face::index`].
    pub face: u16,
    /// 1 if all texels are opaque, else 0.
    pub opaque: u16,
}

const _: () = assert!(size_of::<PlaneTile>() == 20, "no padding in files");

impl PlaneTile {
    /// Returns the range of the tile's texels in
    /// [`PlaneSet::texels`](crate::pack::PlaneSet::texels).
    pub fn texel_range(&self) -> std::ops::Range<usize> {
        let first = self.first_texel as usize;
        first..first.saturating_add(self.texel_count())
    }

    /// Returns the number of texels.
    pub fn texel_count(&self) -> usize {
        usize::from(self.width) * usize::from(self.height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plane_is_same_on_every_face() {
        let n = DVec3::new(0.3, -0.7, 0.21);
        let plane = Plane {
            normal_per_distance: n.as_vec3(),
        };
        for face in Face::ALL {
            let [q, qx, qy] = plane.inverse_depth(face, 64);
            for (x, y) in [(0.0, 0.0), (64.0, 3.5), (17.25, 60.0)] {
                let point = face.direction(x, y, 64) / (q + qx * x + qy * y);
                assert!((n.dot(point) - 1.0).abs() < 1e-6, "f32 normals");
            }
            let back = Plane::from_inverse_depth(face, 64, [q, qx, qy]);
            assert!((back.normal_per_distance - plane.normal_per_distance).length() < 1e-6);
        }
        assert_eq!(
            Plane::default().inverse_depth(Face::PosZ, 9),
            [0.0; 3],
            "at infinity"
        );
    }
}
