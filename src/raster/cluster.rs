//! Projection of a cluster's vertices; culling and clipping of its triangles.

use super::SurfaceId;
use super::cull::VisibleCluster;
use super::mesh::{CLUSTER_VERTICES, RasterMesh, Vertex};
use super::scan::{CutoutTest, DrawnRows};
use super::view::{GUARD_PX, LocalCamera, NEAR_M, SnappedVertex, snap};
use crate::clip;
use fearless_simd::{Simd, dispatch};

/// Outcode bit of a vertex out of the bounds of fixed-point positions: its triangles are clipped.
const CLIPPED: u8 = 1;

/// The projected vertices of a cluster.
struct ProjectedVertices {
    /// Position in 1/256 px.
    x: [i32; CLUSTER_VERTICES],
    y: [i32; CLUSTER_VERTICES],
    /// 1 / eye depth, 1/m.
    inverse_depth: [f32; CLUSTER_VERTICES],
    /// Outcode: [`CLIPPED`], and a bit for the near plane and each side of the frame that the
    /// vertex is outside of.
    outcode: [u8; CLUSTER_VERTICES],
}

impl LocalCamera {
    /// Draws a triangle of a marker.
    pub(super) fn draw_marker(
        &self,
        corners: [SnappedVertex; 3],
        number: u32,
        target: &mut DrawnRows,
    ) {
        dispatch!(self.level, simd => target.triangle(simd, corners, SurfaceId::marker(number), None));
    }

    /// Draws the triangles of a cluster.
    pub(super) fn draw_cluster(
        &self,
        mesh: &RasterMesh,
        cluster: &VisibleCluster,
        target: &mut DrawnRows,
    ) {
        dispatch!(self.level, simd => self.draw_cluster_at(simd, mesh, cluster, target));
    }

    #[inline(always)]
    fn draw_cluster_at<S: Simd>(
        &self,
        simd: S,
        mesh: &RasterMesh,
        visible: &VisibleCluster,
        target: &mut DrawnRows,
    ) {
        let cluster = &mesh.clusters[visible.cluster as usize];
        let mut vertices = ProjectedVertices {
            x: [0; CLUSTER_VERTICES],
            y: [0; CLUSTER_VERTICES],
            inverse_depth: [0.0; CLUSTER_VERTICES],
            outcode: [0; CLUSTER_VERTICES],
        };
        let run = cluster.vertices.start as usize..cluster.vertices.end as usize;
        self.project_vertices(
            simd,
            mesh.positions.each_ref().map(|axis| &axis[run.clone()]),
            &mut vertices,
        );
        for primitive in cluster.triangles.clone() {
            let triangle = &mesh.triangles[primitive as usize];
            let corners = triangle.corners.map(|corner| {
                corner.wrapping_sub(cluster.vertices.start) as usize % CLUSTER_VERTICES
            });
            let [i, j, k] = corners.map(|i| vertices.outcode[i]);
            if i & j & k & !CLIPPED != 0 {
                continue;
            }
            if cluster.has_single_sided
                && mesh.materials[triangle.material as usize].single_sided
                && self.is_back(mesh.corners(triangle))
            {
                continue;
            }
            let has_cutout =
                cluster.has_cutouts && mesh.materials[triangle.material as usize].has_cutout;
            let cutout = has_cutout.then_some(CutoutTest {
                mesh,
                view: self,
                primitive,
            });
            if (i | j | k) & CLIPPED != 0 {
                let homogeneous = mesh
                    .corners(triangle)
                    .map(|corner| self.project_f64(corner.position));
                let snapped = corners
                    .map(|i| (vertices.outcode[i] & CLIPPED == 0).then(|| vertices.snapped(i)));
                clip::draw_clipped(homogeneous, snapped, |corners| {
                    target.triangle(simd, corners, SurfaceId(primitive), cutout);
                });
            } else {
                let corners = corners.map(|i| vertices.snapped(i));
                target.triangle(simd, corners, SurfaceId(primitive), cutout);
            }
        }
    }

    /// Returns true if the eye is behind a triangle.
    fn is_back(&self, corners: [&Vertex; 3]) -> bool {
        let [a, b, c] = corners.map(|corner| (corner.position - self.eye).as_dvec3());
        a.cross(b).dot(c) > 0.0
    }

    /// Projects and snaps vertices: a plain loop over arrays that the compiler vectorises at the
    /// SIMD level.
    #[inline(always)]
    fn project_vertices<S: Simd>(&self, _: S, [x, y, z]: [&[f32]; 3], out: &mut ProjectedVertices) {
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
            // A margin of one pixel covers rounding. All false for NaN.
            let (right, bottom) = ((self.width + 1) as f32 * hw, (self.height + 1) as f32 * hw);
            out.outcode[i] = (u8::from(!inside) * CLIPPED)
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

impl ProjectedVertices {
    #[inline]
    fn snapped(&self, i: usize) -> SnappedVertex {
        SnappedVertex {
            x: self.x[i],
            y: self.y[i],
            inverse_depth: self.inverse_depth[i],
        }
    }
}
