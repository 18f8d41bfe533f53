//! Projection of a camera's samples into a frame (the first step of E7), sixteen at a time.

use crate::view_geometry::cameras::lattice::Lattice;
use crate::view_geometry::cameras::samples::Points;
use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x16, i32x16, u32x16};
use glam::{DVec3, Vec3};
use headbox_core::camera::Camera;
use headbox_core::image::texels::LANES;
use headbox_core::image::triangle_scan::SUBPIXELS;

/// Near plane, metres.
const NEAR_M: f32 = 1e-3;

/// Projected sample inside a frame's lattice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hit {
    /// Node whose cell contains the sample.
    pub(super) node: u32,
    /// Position in the frame, subpixels, within that cell.
    pub(super) at: [i32; 2],
    /// Inverse eye depth, 1/m.
    pub(super) inverse_depth: f32,
    /// Squared distance from the eye, m^2.
    pub(super) distance_squared: f32,
}

/// Projection of samples into a frame's camera.
pub(super) struct Projection {
    level: Level,
    /// Size of the frame, pixels.
    pub(super) size: [u32; 2],
    /// Eye relative to the samples' origin, metres.
    eye: Vec3,
    /// Right and down axes in pixels at eye depth 1, and the forward axis.
    axes: [Vec3; 3],
    principal: [f32; 2],
}

/// Returns the right and down axes of a frame's camera in pixels at eye depth 1, and its forward
/// axis.
pub(super) fn pixel_axes(frame: &Camera) -> [Vec3; 3] {
    let (axes, focal) = (frame.world_from_eye(), frame.focal_px());
    [axes.x_axis * focal, -axes.y_axis * focal, -axes.z_axis].map(|axis| axis.as_vec3())
}

impl Projection {
    pub(super) fn new(frame: &Camera, origin: DVec3, level: Level) -> Self {
        Self {
            level,
            size: [frame.width(), frame.height()],
            eye: (frame.eye() - origin).as_vec3(),
            axes: pixel_axes(frame),
            principal: frame.principal_px().map(|px| px as f32),
        }
    }

    /// Replaces the content of `to` by the projected samples inside a lattice, in the samples'
    /// order.
    pub(super) fn project(&self, points: Points, lattice: &Lattice, to: &mut Vec<Hit>) {
        to.clear();
        dispatch!(self.level, simd => self.project_all(simd, points, lattice, to));
    }

    #[inline(always)]
    fn project_all<S: Simd>(&self, simd: S, points: Points, lattice: &Lattice, to: &mut Vec<Hit>) {
        let [(x, last_x), (y, last_y), (z, last_z)] = points.map(|axis| axis.as_chunks::<LANES>());
        for ((x, y), z) in x.iter().zip(y).zip(z) {
            self.project_sixteen(simd, [x, y, z], lattice, to);
        }
        if !last_x.is_empty() {
            // NaN is outside of every frame.
            let mut last = [[f32::NAN; LANES]; 3];
            for (padded, axis) in last.iter_mut().zip([last_x, last_y, last_z]) {
                padded
                    .iter_mut()
                    .zip(axis)
                    .for_each(|(to, from)| *to = *from);
            }
            let [x, y, z] = &last;
            self.project_sixteen(simd, [x, y, z], lattice, to);
        }
    }

    #[inline(always)]
    fn project_sixteen<S: Simd>(
        &self,
        simd: S,
        [x, y, z]: [&[f32; LANES]; 3],
        lattice: &Lattice,
        to: &mut Vec<Hit>,
    ) {
        let d = [
            f32x16::load_array_ref(simd, x) - self.eye.x,
            f32x16::load_array_ref(simd, y) - self.eye.y,
            f32x16::load_array_ref(simd, z) - self.eye.z,
        ];
        let depth = dot(self.axes[2], d);
        let inverse = 1.0 / depth;
        let (x, column, in_columns) = locate(
            dot(self.axes[0], d) * inverse + self.principal[0],
            lattice,
            lattice.columns,
        );
        let (y, row, in_rows) = locate(
            dot(self.axes[1], d) * inverse + self.principal[1],
            lattice,
            lattice.rows,
        );
        // False for NaN.
        let mut inside = depth.simd_gt(NEAR_M).to_bitmask() & in_columns & in_rows;
        if inside == 0 {
            return;
        }
        let node = (row * lattice.columns + column).to_array();
        let (x, y, inverse) = (x.to_array(), y.to_array(), inverse.to_array());
        let distance = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).to_array();
        while inside != 0 {
            let i = inside.trailing_zeros() as usize % LANES;
            inside &= inside - 1;
            to.push(Hit {
                node: node[i],
                at: [x[i], y[i]],
                inverse_depth: inverse[i],
                distance_squared: distance[i],
            });
        }
    }
}

/// Converts positions along one axis from pixels to subpixels and nodes, for a lattice of `count`
/// nodes along it. Returns subpixel positions clamped to their node's cell, nodes, and a mask of
/// lanes inside the lattice.
#[inline(always)]
fn locate<S: Simd>(px: f32x16<S>, lattice: &Lattice, count: u32) -> (i32x16<S>, u32x16<S>, u64) {
    let node = px * lattice.nodes_per_px() + 1.5;
    let inside = node.simd_ge(0.0) & node.simd_lt(count as f32);
    let node = i32x16::truncate_from(inside.select(node, f32x16::splat(px.token(), 0.0)));
    let middle = (node - 1) * lattice.spacing;
    let part = i32x16::truncate_from(
        (inside.select(px, f32x16::splat(px.token(), 0.0)) * SUBPIXELS as f32).round_ties_even(),
    );
    let part = part
        .max(middle - lattice.spacing / 2)
        .min(middle + (lattice.spacing - 1) / 2);
    (part, node.bitcast(), inside.to_bitmask())
}

/// Dot product, summed in a fixed order.
#[inline(always)]
fn dot<S: Simd>(axis: Vec3, d: [f32x16<S>; 3]) -> f32x16<S> {
    (d[0] * axis.x + d[1] * axis.y) + d[2] * axis.z
}

#[cfg(test)]
mod tests {
    use super::*;
    pub(crate) use crate::view_geometry::tests::frame_at;
    use headbox_core::simd;

    /// A position in f32 differs from one in f64 by less than this, px, beyond half a part.
    const POSITION: f64 = 0.01;

    #[test]
    fn hits_equal_scalar_at_every_level() {
        let frame = frame_at(DVec3::new(0.1, -0.2, 0.5), [64, 48]);
        let lattice = Lattice::new(frame.width(), frame.height(), 4.0);
        // An odd count, with points behind, at the eye and nowhere.
        let mut points: Vec<Vec3> = (0..901u32)
            .map(|i| {
                let [a, b, c] =
                    [i * 37 % 101, i * 53 % 97, i * 71 % 89].map(|n| n as f32 / 45.0 - 1.0);
                Vec3::new(2.0 * a, 2.0 * b, -2.0 + 3.0 * c)
            })
            .collect();
        points.extend([
            Vec3::NAN,
            frame.eye().as_vec3(),
            Vec3::splat(f32::INFINITY),
            Vec3::ZERO,
        ]);
        let [x, y, z] = [0, 1, 2].map(|axis| points.iter().map(|p| p[axis]).collect::<Vec<_>>());
        let mut at_levels = Vec::new();
        for level in simd::levels() {
            let mut hits = Vec::new();
            Projection::new(&frame, DVec3::ZERO, level).project([&x, &y, &z], &lattice, &mut hits);
            at_levels.push(hits);
        }
        assert!(
            at_levels.windows(2).all(|pair| pair[0] == pair[1]),
            "all levels alike"
        );
        let mut hits = at_levels[0].iter();
        for point in &points {
            let Some([x, y, depth]) = frame.project(point.as_dvec3()) else {
                continue;
            };
            let cell = |px: f64, count: u32| {
                Some((px / 4.0 + 1.5).floor()).filter(|n| (0.0..f64::from(count)).contains(n))
            };
            let (Some(column), Some(row)) = (cell(x, lattice.columns), cell(y, lattice.rows))
            else {
                continue;
            };
            let hit = hits.next().expect("a hit");
            assert_eq!(hit.node, row as u32 * lattice.columns + column as u32);
            for (found, expected) in hit.at.into_iter().zip([x, y]) {
                let part = 0.5 / f64::from(SUBPIXELS);
                assert!(
                    (f64::from(found) / f64::from(SUBPIXELS) - expected).abs() < POSITION + part,
                    "{point}: {found}"
                );
            }
            assert!((f64::from(hit.inverse_depth) * depth - 1.0).abs() < 1e-5);
            let squared = (point.as_dvec3() - frame.eye()).length_squared();
            assert!((f64::from(hit.distance_squared) / squared - 1.0).abs() < 1e-5);
        }
        assert_eq!((hits.next(), at_levels[0].len() > 300), (None, true));
    }
}
