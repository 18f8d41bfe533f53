//! From local positions to the frame: the transfer of a cluster's vertices, and what becomes of its triangles.

use super::cull::VisibleCluster;
use super::mesh::{CLUSTER_VERTICES, RasterMesh};
use super::scan::{CutoutTest, Snapped, Target};
use super::{SurfaceId, clip};
use crate::capture::Camera;
use fearless_simd::{Level, Simd, dispatch};
use glam::{DVec3, Vec3};

/// Nothing nearer than this is drawn, metres. Only keeps divisions finite: what it cuts off is smaller than a pixel.
pub(super) const NEAR_M: f32 = 1e-5;

/// Positions in the frame are kept as multiples of this part of a pixel.
pub(super) const SUBPIXELS: i32 = 256;

/// Triangles that reach farther from the frame's upper left corner than this are clipped, px: products of two edges stay
/// below 2^46, and the sum in `snap` below 2^24.
pub(super) const GUARD_PX: f32 = 16_383.0;

/// Bit of a vertex that lies where it cannot be drawn: its triangles are clipped.
const CLIPPED: u8 = 1;

/// A camera about a mesh's origin.
pub(super) struct View {
    eye: Vec3,
    /// Rows that take a position relative to the eye to (x w, y w, w), x and y in px from the upper left corner.
    rows: [Vec3; 3],
    eye_f64: DVec3,
    rows_f64: [DVec3; 3],
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) level: Level,
}

/// The vertices of a cluster in the frame.
struct Transferred {
    /// Position in 1/[`SUBPIXELS`] px.
    x: [i32; CLUSTER_VERTICES],
    y: [i32; CLUSTER_VERTICES],
    /// 1 / eye depth, 1/m.
    inverse_depth: [f32; CLUSTER_VERTICES],
    /// Whether the position is out of bounds ([`CLIPPED`]), and on which sides of the frame it lies.
    outside: [u8; CLUSTER_VERTICES],
}

impl View {
    pub(super) fn new(camera: &Camera, origin: DVec3, level: Level) -> Self {
        let matrix = camera.image_from_world();
        let rows_f64 = [0, 1, 3].map(|row| matrix.row(row).truncate());
        let eye_f64 = camera.eye() - origin;
        let (eye, rows) = (eye_f64.as_vec3(), rows_f64.map(|row| row.as_vec3()));
        Self { eye, rows, eye_f64, rows_f64, width: camera.width(), height: camera.height(), level }
    }

    /// (x w, y w, w) of a local position.
    #[inline(always)]
    pub(super) fn homogeneous(&self, position: Vec3) -> Vec3 {
        let d = position - self.eye;
        let [x, y, w] = self.rows;
        let along = |row: Vec3| (row.x * d.x + row.y * d.y) + row.z * d.z;
        Vec3::new(along(x), along(y), along(w))
    }

    /// As [`Self::homogeneous`]: a corner 2 km behind the eye decides where its edge passes a millimetre in front of it.
    #[inline(always)]
    pub(super) fn homogeneous_f64(&self, position: Vec3) -> DVec3 {
        let d = position.as_dvec3() - self.eye_f64;
        DVec3::from(self.rows_f64.map(|row| row.dot(d)))
    }

    /// Draws a triangle of a marker.
    pub(super) fn draw_marker(&self, corners: [Snapped; 3], number: u32, target: &mut Target) {
        dispatch!(self.level, simd => target.triangle(simd, corners, SurfaceId::marker(number), None));
    }

    /// Draws the triangles of a cluster.
    pub(super) fn draw_cluster(&self, mesh: &RasterMesh, cluster: &VisibleCluster, target: &mut Target) {
        dispatch!(self.level, simd => self.draw_cluster_at(simd, mesh, cluster, target));
    }

    #[inline(always)]
    fn draw_cluster_at<S: Simd>(&self, simd: S, mesh: &RasterMesh, visible: &VisibleCluster, target: &mut Target) {
        let cluster = &mesh.clusters[visible.cluster as usize];
        let mut vertices = Transferred {
            x: [0; CLUSTER_VERTICES],
            y: [0; CLUSTER_VERTICES],
            inverse_depth: [0.0; CLUSTER_VERTICES],
            outside: [0; CLUSTER_VERTICES],
        };
        let run = cluster.vertices.start as usize..cluster.vertices.end as usize;
        self.transfer(simd, mesh.positions.each_ref().map(|axis| &axis[run.clone()]), &mut vertices);
        for primitive in cluster.triangles.clone() {
            let face = &mesh.faces[primitive as usize];
            let corners = face.corners;
            let local = |corner: u32| corner.wrapping_sub(cluster.vertices.start) as usize % CLUSTER_VERTICES;
            let (i, j, k) = (local(corners[0]), local(corners[1]), local(corners[2]));
            if vertices.outside[i] & vertices.outside[j] & vertices.outside[k] & !CLIPPED != 0 {
                continue;
            }
            let has_cutout = cluster.has_cutouts && mesh.surfaces[face.material as usize].has_cutout;
            let cutout = has_cutout.then_some(CutoutTest { mesh, view: self, primitive });
            if (vertices.outside[i] | vertices.outside[j] | vertices.outside[k]) & CLIPPED != 0 {
                let homogeneous = mesh.corners(face).map(|corner| self.homogeneous_f64(corner.position));
                let snapped = [i, j, k].map(|i| (vertices.outside[i] & CLIPPED == 0).then(|| vertices.snapped(i)));
                clip::clipped(homogeneous, snapped, |corners| {
                    target.triangle(simd, corners, SurfaceId(primitive), cutout);
                });
            } else {
                let corners = [vertices.snapped(i), vertices.snapped(j), vertices.snapped(k)];
                target.triangle(simd, corners, SurfaceId(primitive), cutout);
            }
        }
    }

    /// Plain loops over arrays, which the compiler turns into the instructions of the SIMD level.
    #[inline(always)]
    fn transfer<S: Simd>(&self, _: S, [x, y, z]: [&[f32]; 3], out: &mut Transferred) {
        let count = x.len().min(y.len()).min(z.len()).min(CLUSTER_VERTICES);
        let [rx, ry, rw] = self.rows;
        for i in 0..count {
            let (dx, dy, dz) = (x[i] - self.eye.x, y[i] - self.eye.y, z[i] - self.eye.z);
            let hx = (rx.x * dx + rx.y * dy) + rx.z * dz;
            let hy = (ry.x * dx + ry.y * dy) + ry.z * dz;
            let hw = (rw.x * dx + rw.y * dy) + rw.z * dz;
            let inverse = 1.0 / hw;
            let (px, py) = (hx * inverse, hy * inverse);
            // False for NaN.
            let inside = (hw >= NEAR_M) & (px.abs() < GUARD_PX) & (py.abs() < GUARD_PX);
            // On the frame's sides by a pixel more than rounding needs. All false for NaN.
            let (right, bottom) = ((self.width + 1) as f32 * hw, (self.height + 1) as f32 * hw);
            out.outside[i] = (u8::from(!inside) * CLIPPED)
                | (u8::from(hw < NEAR_M * 0.5) << 1)
                | (u8::from(hx < -hw) << 2)
                | (u8::from(hx > right) << 3)
                | (u8::from(hy < -hw) << 4)
                | (u8::from(hy > bottom) << 5);
            out.inverse_depth[i] = inverse;
            out.x[i] = snap(px);
            out.y[i] = snap(py);
        }
    }
}

impl Transferred {
    #[inline(always)]
    fn snapped(&self, i: usize) -> Snapped {
        Snapped { x: self.x[i], y: self.y[i], inverse_depth: self.inverse_depth[i] }
    }
}

/// The nearest multiple of 1/[`SUBPIXELS`] px, ties to even, of a position of at most [`GUARD_PX`]; anything for others.
#[inline(always)]
fn snap(px: f32) -> i32 {
    /// 1.5 * 2^23: the sum has steps of 1, so its low bits are the rounded number.
    const MAGIC: f32 = 12_582_912.0;
    ((px * SUBPIXELS as f32 + MAGIC).to_bits() as i32).wrapping_sub(MAGIC.to_bits() as i32)
}

/// As [`snap`], for the corners that clipping makes.
pub(super) fn snap_f64(px: f64) -> i32 {
    (px * f64::from(SUBPIXELS)).round_ties_even() as i32
}
