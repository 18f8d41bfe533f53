//! Reprojection of a depth image into another camera: a mesh of its pixels, rasterised with a depth
//! test.

use super::{Lens, LoadedView, Pose};
use crate::SENSOR_NOISE;
use glam::{DVec2, DVec3};

/// Maximum slope of a continuous surface: relative change of inverse depth between neighbouring
/// pixels per radian of a pixel's width.
const MAX_SLOPE: f64 = 12.0;

/// A pixel of the depth image projected into the other image: a vertex of the mesh.
#[derive(Clone, Copy)]
struct MeshVertex {
    pixel: DVec2,
    inverse_depth: f32,
}

/// Reprojects depth into an image of the same size, seen through `lens` from `pose`; NaN where the
/// depth image has no surface. Four neighbouring pixels on one surface span it; inverse depth is
/// affine on a plane, and is interpolated between them.
pub(super) fn reproject_depth(view: &LoadedView, lens: Lens, pose: &Pose) -> Vec<f32> {
    let size = view.size_px;
    let [width, height] = size.map(|side| side as usize);
    let depth_at = |x: usize, y: usize| view.depth_at(x as u32, y as u32);
    let from_eye = pose.world_from_eye.transpose();
    let rotation = from_eye * view.pose.world_from_eye;
    let offset = from_eye * (view.pose.eye - pose.eye);
    let vertex = |x: usize, y: usize| {
        let ray = view.lens.ray([x as f64 + 0.5, y as f64 + 0.5], size);
        let point: DVec3 = rotation * (ray * f64::from(depth_at(x, y)?)) + offset;
        let [u, v, depth] = lens.project(point, size)?;
        Some(MeshVertex {
            pixel: DVec2::new(u, v),
            inverse_depth: (1.0 / depth) as f32,
        })
    };
    let max_change = MAX_SLOPE / view.lens.pixels_per_radian(size);
    let is_one_surface = |depths: [f32; 4]| {
        let (low, high) = depths
            .into_iter()
            .fold((f32::MAX, 0.0f32), |(low, high), d| {
                (low.min(1.0 / d), high.max(1.0 / d))
            });
        f64::from(high - low) <= max_change * f64::from(low) + 3.0 * f64::from(SENSOR_NOISE)
    };
    let mut nearest = vec![0.0f32; width * height];
    let row = |y: usize| {
        (0..width)
            .map(|x| vertex(x, y))
            .collect::<Vec<Option<MeshVertex>>>()
    };
    let mut above = row(0);
    for y in 1..height {
        let below = row(y);
        for x in 1..width {
            let depths = [
                depth_at(x - 1, y - 1),
                depth_at(x, y - 1),
                depth_at(x - 1, y),
                depth_at(x, y),
            ];
            let [Some(a), Some(b), Some(c), Some(d)] = depths else {
                continue;
            };
            if !is_one_surface([a, b, c, d]) {
                continue;
            }
            if let [Some(a), Some(b), Some(c), Some(d)] =
                [above[x - 1], above[x], below[x - 1], below[x]]
            {
                rasterize([a, b, c], size, &mut nearest);
                rasterize([d, c, b], size, &mut nearest);
            }
        }
        above = below;
    }
    nearest
        .into_iter()
        .map(|q| if q > 0.0 { 1.0 / q } else { f32::NAN })
        .collect()
}

/// Tolerance of the coverage test, pixels: no cracks between triangles.
const EDGE_PX: f64 = 1e-6;

/// Rasterises a triangle, keeping the nearest inverse depth.
fn rasterize([a, b, c]: [MeshVertex; 3], [width, height]: [u32; 2], nearest: &mut [f32]) {
    let low = a.pixel.min(b.pixel).min(c.pixel);
    let high = a.pixel.max(b.pixel).max(c.pixel);
    let columns = first_center(low.x, width)..first_center(high.x + EDGE_PX, width);
    let rows = first_center(low.y, height)..first_center(high.y + EDGE_PX, height);
    let ab = b.pixel - a.pixel;
    let ac = c.pixel - a.pixel;
    let area = ab.perp_dot(ac);
    // Back face.
    if area <= 1e-9 {
        return;
    }
    let slopes = [
        b.inverse_depth - a.inverse_depth,
        c.inverse_depth - a.inverse_depth,
    ];
    for y in rows {
        for x in columns.clone() {
            let offset = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - a.pixel;
            let s = offset.perp_dot(ac) / area;
            let t = ab.perp_dot(offset) / area;
            if s >= -EDGE_PX && t >= -EDGE_PX && s + t <= 1.0 + EDGE_PX {
                let inverse_depth = a.inverse_depth + s as f32 * slopes[0] + t as f32 * slopes[1];
                let stored = &mut nearest[y * width as usize + x];
                *stored = stored.max(inverse_depth);
            }
        }
    }
}

/// Returns the first pixel whose centre lies at or after a position.
fn first_center(position: f64, size: u32) -> usize {
    ((position - 0.5).ceil().max(0.0) as usize).min(size as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Distortion, Pinhole};
    use glam::DMat3;

    fn lens(focal: f64) -> Lens {
        let distortion = Distortion::default();
        Lens::Pinhole(Pinhole {
            focal_px: [focal; 2],
            principal_px: [32.0, 24.0],
            distortion,
        })
    }

    /// A tilted plane, n . p = 1 in eye space, reprojected into a neighbouring camera.
    #[test]
    fn plane_depth_exact() {
        let size_px = [64, 48];
        let plane = DVec3::new(0.1, 0.2, -0.5);
        let pose = Pose {
            eye: DVec3::ZERO,
            world_from_eye: DMat3::IDENTITY,
        };
        let expected_depth = |lens: Lens, pose: &Pose, x: u32, y: u32| {
            let ray =
                pose.world_from_eye * lens.ray([f64::from(x) + 0.5, f64::from(y) + 0.5], size_px);
            (1.0 - plane.dot(pose.eye)) / plane.dot(ray)
        };
        let pixels = || (0..48u32).flat_map(|y| (0..64u32).map(move |x| (x, y)));
        let values = pixels()
            .map(|(x, y)| expected_depth(lens(58.0), &pose, x, y) as f32)
            .collect();
        let view = LoadedView {
            size_px,
            lens: lens(58.0),
            pose,
            color: vec![[9; 4]; 64 * 48],
            depth: values,
        };
        let other = Pose {
            eye: DVec3::new(0.05, -0.02, 0.1),
            world_from_eye: DMat3::from_rotation_y(0.03),
        };
        let reprojected = reproject_depth(&view, lens(52.0), &other);
        let mut known = 0;
        for ((x, y), depth) in pixels().zip(&reprojected) {
            if depth.is_finite() {
                known += 1;
                let expected = expected_depth(lens(52.0), &other, x, y);
                // Depths and their inverses are rounded to f32 three times.
                assert!(
                    (f64::from(*depth) / expected - 1.0).abs() < 1e-5,
                    "{x} {y}: {depth} {expected}"
                );
            }
        }
        // 52 / 58 of each side, less the part shifted out of the image.
        assert!(known > 64 * 48 * 7 / 10, "{known}");
        assert!(reprojected[24 * 64 + 30].is_finite(), "no crack");
    }

    #[test]
    fn surfaces_not_joined_across_step() {
        let pose = Pose {
            eye: DVec3::ZERO,
            world_from_eye: DMat3::IDENTITY,
        };
        let expected_depth = |i: usize| if i % 64 < 30 { 1.0 } else { 3.0 };
        let values = (0..64 * 48).map(expected_depth).collect();
        let view = LoadedView {
            size_px: [64, 48],
            lens: lens(58.0),
            pose,
            color: vec![[9; 4]; 64 * 48],
            depth: values,
        };
        let aside = Pose {
            eye: DVec3::new(0.2, 0.0, 0.0),
            world_from_eye: DMat3::IDENTITY,
        };
        let reprojected = reproject_depth(&view, lens(58.0), &aside);
        for q in reprojected.iter().filter(|depth| depth.is_finite()) {
            assert!((q - 1.0).abs() < 1e-5 || (q - 3.0).abs() < 1e-5, "{q}");
        }
        // The near surface moves by 11.6 pixels, the far one by 3.9: the gap is unknown.
        let row = &reprojected[24 * 64..25 * 64];
        assert!(
            row[16].is_finite() && row[20].is_nan() && row[30].is_finite(),
            "{row:?}"
        );
    }
}
