//! From local positions to the frame: the transfer of a cluster's vertices, and what becomes of its triangles.

use super::cull::VisibleCluster;
use super::mesh::{CLUSTER_VERTICES, RasterMesh, Vertex};
use super::scan::{CutoutTest, Snapped, Target};
use super::{SurfaceId, clip};
use crate::capture::Camera;
use fearless_simd::{Level, Simd, dispatch};
use glam::{DVec3, Vec2, Vec3};

/// Nothing nearer than this is drawn, metres. Only keeps divisions finite: what it cuts off is smaller than a pixel.
pub(super) const NEAR_M: f32 = 1e-5;

/// Positions in the frame are kept as multiples of this part of a pixel.
pub(super) const SUBPIXELS: i32 = 256;

/// Triangles that reach farther from the frame's upper left corner than this are clipped, px: products of two edges stay
/// below 2^46, and the sum in `snap` below 2^24.
pub(super) const GUARD_PX: f32 = 16_383.0;

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
    /// Whether the position is out of bounds.
    outside: [bool; CLUSTER_VERTICES],
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
    fn homogeneous_f64(&self, position: Vec3) -> DVec3 {
        let d = position.as_dvec3() - self.eye_f64;
        DVec3::from(self.rows_f64.map(|row| row.dot(d)))
    }

    /// A triangle near a position of the frame, px.
    #[inline(always)]
    pub(super) fn weights(&self, [a, b, c]: [&Vertex; 3], x: f32, y: f32) -> Weights {
        let (a, b, c) = (self.homogeneous(a.position), self.homogeneous(b.position), self.homogeneous(c.position));
        let about = |h: Vec3| Vec3::new(h.x - x * h.z, h.y - y * h.z, h.z);
        let (a, b, c) = (about(a), about(b), about(c));
        let cross = |p: Vec3, q: Vec3| p.x * q.y - p.y * q.x;
        let along_x = |p: Vec3, q: Vec3| p.y * q.z - p.z * q.y;
        let along_y = |p: Vec3, q: Vec3| p.z * q.x - p.x * q.z;
        let here = Vec3::new(cross(b, c), cross(c, a), cross(a, b));
        // Seen from its back, all three are negative.
        let sign = if here.x + here.y + here.z < 0.0 { -1.0 } else { 1.0 };
        Weights {
            here: here * sign,
            along_x: Vec3::new(along_x(b, c), along_x(c, a), along_x(a, b)) * sign,
            along_y: Vec3::new(along_y(b, c), along_y(c, a), along_y(a, b)) * sign,
        }
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
            outside: [false; CLUSTER_VERTICES],
        };
        let run = cluster.vertices.start as usize..cluster.vertices.end as usize;
        self.transfer(simd, mesh.positions.each_ref().map(|axis| &axis[run.clone()]), &mut vertices);
        for primitive in cluster.triangles.clone() {
            let face = &mesh.faces[primitive as usize];
            let corners = face.corners;
            let local = |corner: u32| corner.wrapping_sub(cluster.vertices.start) as usize % CLUSTER_VERTICES;
            let (i, j, k) = (local(corners[0]), local(corners[1]), local(corners[2]));
            let has_cutout = cluster.has_cutouts && mesh.surfaces[face.material as usize].has_cutout;
            let cutout = has_cutout.then_some(CutoutTest { mesh, view: self, primitive });
            if vertices.outside[i] | vertices.outside[j] | vertices.outside[k] {
                let homogeneous = mesh.corners(face).map(|corner| self.homogeneous_f64(corner.position));
                let snapped = [i, j, k].map(|i| (!vertices.outside[i]).then(|| vertices.snapped(i)));
                clip::clipped(homogeneous, snapped, |corners| target.triangle(corners, SurfaceId(primitive), cutout));
            } else {
                let corners = [vertices.snapped(i), vertices.snapped(j), vertices.snapped(k)];
                target.triangle(corners, SurfaceId(primitive), cutout);
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
            out.outside[i] = !inside;
            out.inverse_depth[i] = inverse;
            out.x[i] = snap(px);
            out.y[i] = snap(py);
        }
    }
}

/// Pixels that are coloured at once.
pub(super) const LANES: usize = 16;

/// A number for each of these.
pub(super) type Lane = [f32; LANES];

/// Perspective-correct weights of a triangle's corners, up to their sum, as linear functions about a position of the frame:
/// the edge functions of the corners in homogeneous coordinates. They are taken relative to the position so that `f32` keeps
/// its digits.
#[derive(Clone, Copy)]
pub(super) struct Weights {
    here: Vec3,
    along_x: Vec3,
    along_y: Vec3,
}

impl Weights {
    /// The weights so many px to the right. Positions are snapped: where the centre of a pixel lies a hair outside the
    /// triangle that covers it, the nearest point of the triangle counts. All are 0 for a triangle that is seen edge-on.
    #[inline(always)]
    pub(super) fn at(&self, columns: f32) -> Vec3 {
        let w = (self.here + self.along_x * columns).max(Vec3::ZERO);
        let sum = w.x + w.y + w.z;
        w * if sum > 0.0 { 1.0 / sum } else { 0.0 }
    }

    /// As [`Self::at`] for [`LANES`] pixels from so many px to the right on, corner by corner.
    #[inline(always)]
    pub(super) fn lanes(&self, first: f32) -> [Lane; 3] {
        let mut weights = [[0.0; LANES]; 3];
        for (corner, weights) in weights.iter_mut().enumerate() {
            let (here, along_x) = (self.here[corner], self.along_x[corner]);
            for (i, weight) in weights.iter_mut().enumerate() {
                *weight = (here + along_x * (first + i as f32)).max(0.0);
            }
        }
        let [a, b, c] = &mut weights;
        for i in 0..LANES {
            let sum = (a[i] + b[i]) + c[i];
            let per = if sum > 0.0 { 1.0 / sum } else { 0.0 };
            (a[i], b[i], c[i]) = (a[i] * per, b[i] * per, c[i] * per);
        }
        weights
    }

    /// The derivatives of something that has the given values at the corners, along x and along y, at the position.
    #[inline(always)]
    pub(super) fn derivatives(&self, [a, b, c]: [Vec2; 3]) -> [Vec2; 2] {
        let sum = |w: Vec3| w.x + w.y + w.z;
        let mix = |w: Vec3| a * w.x + b * w.y + c * w.z;
        let per = 1.0 / sum(self.here).max(f32::MIN_POSITIVE);
        let here = mix(self.here) * per;
        let along = |w: Vec3| (mix(w) - here * sum(w)) * per;
        [along(self.along_x), along(self.along_y)]
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
