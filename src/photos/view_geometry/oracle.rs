//! Reference implementation from a mesh to a pixel, in `f64`: a pixel's ray meets a triangle in
//! space, its weights are shares of the triangle's area, and each corner's camera projects the
//! point into its image.

use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_images::LoadedView;

/// A corner in space, and the view that its sample comes from.
pub(super) type Corner<'a> = (DVec3, &'a LoadedView);

/// Returns the linear colour of a pixel from three blended textures; `None` where the ray misses
/// the triangle by more than rounding, or one of the views does not show the point.
pub(super) fn blended(camera: &Camera, corners: [Corner; 3], [x, y]: [f64; 2]) -> Option<[f64; 3]> {
    let [a, b, c] = corners.map(|(point, _)| point);
    let normal = (b - a).cross(c - a);
    let direction = camera.direction(x, y);
    let point = camera.eye() + direction * (normal.dot(a - camera.eye()) / normal.dot(direction));
    let share =
        |p: DVec3, q: DVec3| (p - point).cross(q - point).dot(normal) / normal.length_squared();
    let weights = [share(b, c), share(c, a), share(a, b)];
    if weights.iter().any(|weight| *weight < -1e-3) {
        return None;
    }
    let mut sum = [0.0; 3];
    for ((_, view), weight) in corners.into_iter().zip(weights) {
        let [u, v, _] = view.lens.project(view.pose.to_eye(point), view.size_px)?;
        let [width, height] = view.size_px.map(f64::from);
        if !((0.01..width - 0.01).contains(&u) && (0.01..height - 0.01).contains(&v)) {
            return None;
        }
        let color = linear_at(view, u, v);
        (0..3).for_each(|k| sum[k] += color[k] * weight);
    }
    Some(sum)
}

/// Samples a view bilinearly in linear light.
fn linear_at(view: &LoadedView, u: f64, v: f64) -> [f64; 3] {
    let [width, height] = view.size_px;
    let (u, v) = (u - 0.5, v - 0.5);
    let texel = |x: f64, y: f64| {
        let x = x.clamp(0.0, f64::from(width - 1)) as usize;
        let y = y.clamp(0.0, f64::from(height - 1)) as usize;
        let [r, g, b, _] = view.color[y * width as usize + x];
        [r, g, b].map(|c| {
            let c = f64::from(c) / 255.0;
            if c <= 0.040_45 {
                c / 12.92
            } else {
                ((c + 0.055) / 1.055).powf(2.4)
            }
        })
    };
    let (x, y) = (u.floor(), v.floor());
    let mut sum = [0.0; 3];
    for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        let weight = (1.0 - (u - x - dx).abs()) * (1.0 - (v - y - dy).abs());
        let color = texel(x + dx, y + dy);
        (0..3).for_each(|k| sum[k] += color[k] * weight);
    }
    sum
}
