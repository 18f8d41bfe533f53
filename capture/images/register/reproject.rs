//! The depth image of one camera as another camera would have recorded it: a mesh of its pixels, drawn by z-buffer.

use super::{Lens, LoadedView, Pose};
use crate::SENSOR_NOISE;
use glam::{DVec2, DVec3};

/// The steepest surface that counts as one: its inverse depth may change by this share from a pixel to the next for each
/// radian of a pixel's width.
const STEEPEST: f64 = 12.0;

/// A pixel of the depth image in the other picture.
#[derive(Clone, Copy)]
struct Corner {
    at: DVec2,
    inverse_depth: f32,
}

/// Depth in a picture of the same size, seen through `lens` from `pose`; NaN where the depth image has no surface. Four pixels
/// that are neighbours on one surface span it; inverse depth is affine on a plane, and so between them.
pub(super) fn depth(view: &LoadedView, lens: Lens, pose: &Pose) -> Vec<f32> {
    let size = view.size_px;
    let [width, height] = size.map(|side| side as usize);
    let own = |x: usize, y: usize| view.depth_at(x as u32, y as u32);
    let from_eye = pose.world_from_eye.transpose();
    let (rotation, offset) = (
        from_eye * view.pose.world_from_eye,
        from_eye * (view.pose.eye - pose.eye),
    );
    let corner = |x: usize, y: usize| {
        let ray = view.lens.ray([x as f64 + 0.5, y as f64 + 0.5], size);
        let there: DVec3 = rotation * (ray * f64::from(own(x, y)?)) + offset;
        let [u, v, depth] = lens.project(there, size)?;
        Some(Corner {
            at: DVec2::new(u, v),
            inverse_depth: (1.0 / depth) as f32,
        })
    };
    let pixel = STEEPEST / view.lens.pixels_per_radian(size);
    let one_surface = |around: [f32; 4]| {
        let (low, high) = around
            .into_iter()
            .fold((f32::MAX, 0.0f32), |(low, high), d| {
                (low.min(1.0 / d), high.max(1.0 / d))
            });
        f64::from(high - low) <= pixel * f64::from(low) + 3.0 * f64::from(SENSOR_NOISE)
    };
    let mut nearest = vec![0.0f32; width * height];
    let row = |y: usize| {
        (0..width)
            .map(|x| corner(x, y))
            .collect::<Vec<Option<Corner>>>()
    };
    let mut above = row(0);
    for y in 1..height {
        let below = row(y);
        for x in 1..width {
            let known = [own(x - 1, y - 1), own(x, y - 1), own(x - 1, y), own(x, y)];
            let [Some(a), Some(b), Some(c), Some(d)] = known else {
                continue;
            };
            if !one_surface([a, b, c, d]) {
                continue;
            }
            if let [Some(a), Some(b), Some(c), Some(d)] =
                [above[x - 1], above[x], below[x - 1], below[x]]
            {
                fill([a, b, c], size, &mut nearest);
                fill([d, c, b], size, &mut nearest);
            }
        }
        above = below;
    }
    nearest
        .into_iter()
        .map(|q| if q > 0.0 { 1.0 / q } else { f32::NAN })
        .collect()
}

/// Pixels whose middle is nearer to a triangle than this, pixels, are its own: no crack shows between two.
const EDGE_PX: f64 = 1e-6;

fn fill([a, b, c]: [Corner; 3], [width, height]: [u32; 2], nearest: &mut [f32]) {
    let low = a.at.min(b.at).min(c.at);
    let high = a.at.max(b.at).max(c.at);
    let columns = first(low.x, width)..first(high.x + EDGE_PX, width);
    let rows = first(low.y, height)..first(high.y + EDGE_PX, height);
    let (ab, ac) = (b.at - a.at, c.at - a.at);
    let area = ab.perp_dot(ac);
    // Turned away: the surface's back.
    if area <= 1e-9 {
        return;
    }
    let slopes = [
        b.inverse_depth - a.inverse_depth,
        c.inverse_depth - a.inverse_depth,
    ];
    for y in rows {
        for x in columns.clone() {
            let offset = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - a.at;
            let (s, t) = (offset.perp_dot(ac) / area, ab.perp_dot(offset) / area);
            if s >= -EDGE_PX && t >= -EDGE_PX && s + t <= 1.0 + EDGE_PX {
                let inverse_depth = a.inverse_depth + s as f32 * slopes[0] + t as f32 * slopes[1];
                let kept = &mut nearest[y * width as usize + x];
                *kept = kept.max(inverse_depth);
            }
        }
    }
}

/// The first pixel whose middle lies at or after a position.
fn first(position: f64, size: u32) -> usize {
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

    /// A tilted plane, n . p = 1 in eye space, seen by a camera beside: the depth of the plane, wherever it is known.
    #[test]
    fn a_plane_stays_a_plane() {
        let size_px = [64, 48];
        let plane = DVec3::new(0.1, 0.2, -0.5);
        let pose = Pose {
            eye: DVec3::ZERO,
            world_from_eye: DMat3::IDENTITY,
        };
        let depth_of = |lens: Lens, pose: &Pose, x: u32, y: u32| {
            let ray =
                pose.world_from_eye * lens.ray([f64::from(x) + 0.5, f64::from(y) + 0.5], size_px);
            (1.0 - plane.dot(pose.eye)) / plane.dot(ray)
        };
        let pixels = || (0..48u32).flat_map(|y| (0..64u32).map(move |x| (x, y)));
        let values = pixels()
            .map(|(x, y)| depth_of(lens(58.0), &pose, x, y) as f32)
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
        let found = depth(&view, lens(52.0), &other);
        let mut known = 0;
        for ((x, y), found) in pixels().zip(&found) {
            if found.is_finite() {
                known += 1;
                let expected = depth_of(lens(52.0), &other, x, y);
                // Depths and their inverses are rounded to f32, three times.
                assert!(
                    (f64::from(*found) / expected - 1.0).abs() < 1e-5,
                    "{x} {y}: {found} {expected}"
                );
            }
        }
        // 52 / 58 of each side, less what the step aside pushed out.
        assert!(known > 64 * 48 * 7 / 10, "{known}");
        let (x, y) = (30, 24);
        assert!(found[y * 64 + x].is_finite(), "no crack");
    }

    #[test]
    fn two_surfaces_are_not_joined() {
        let pose = Pose {
            eye: DVec3::ZERO,
            world_from_eye: DMat3::IDENTITY,
        };
        let depth_of = |i: usize| if i % 64 < 30 { 1.0 } else { 3.0 };
        let values = (0..64 * 48).map(depth_of).collect();
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
        let found = depth(&view, lens(58.0), &aside);
        for q in found.iter().filter(|depth| depth.is_finite()) {
            assert!((q - 1.0).abs() < 1e-5 || (q - 3.0).abs() < 1e-5, "{q}");
        }
        // The near one moved by 11.6 pixels, the far one by 3.9: what was behind is unknown.
        let row = &found[24 * 64..25 * 64];
        assert!(
            row[16].is_finite() && row[20].is_nan() && row[30].is_finite(),
            "{row:?}"
        );
    }
}
