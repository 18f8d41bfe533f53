//! Clipping of triangles that reach behind the eye or far outside the frame.
//!
//! Each edge is clipped in `f64`, from the end inside toward the end outside: two triangles that
//! share an edge get the same new corners on it, to the bit, so that no crack opens between them.

use super::Marker;
use super::view::{GUARD_PX, NEAR_M, SnappedVertex, snap_f64};
use glam::DVec3;
use headbox_core::camera::Camera;

/// A corner: (x w, y w, w) in px, and its snapped position if it existed before clipping.
type Corner = (DVec3, Option<SnappedVertex>);

/// Clipping half spaces `plane . h >= least`: slightly larger than the bounds of the fast path, so
/// that a corner inside those is never moved.
fn planes() -> [(DVec3, f64); 5] {
    let guard = f64::from(GUARD_PX) + 0.5;
    [
        (DVec3::Z, f64::from(NEAR_M) * 0.999),
        (DVec3::new(1.0, 0.0, guard), 0.0),
        (DVec3::new(-1.0, 0.0, guard), 0.0),
        (DVec3::new(0.0, 1.0, guard), 0.0),
        (DVec3::new(0.0, -1.0, guard), 0.0),
    ]
}

/// Clips a triangle and passes the rest to `draw`, as triangles. `snapped`: the corners that need
/// not be moved.
pub(super) fn draw_clipped(
    corners: [DVec3; 3],
    snapped: [Option<SnappedVertex>; 3],
    draw: impl FnMut([SnappedVertex; 3]),
) {
    let polygon = (0..3).map(|i| (corners[i], snapped[i])).collect();
    draw_fan(clip_polygon(polygon), draw);
}

/// Projects and clips a marker into triangles.
pub(super) fn project_polygon(camera: &Camera, marker: &Marker) -> Vec<[SnappedVertex; 3]> {
    let matrix = camera.image_from_world();
    let project = |p: &DVec3| {
        let h = matrix * p.extend(1.0);
        (DVec3::new(h.x, h.y, h.w), None)
    };
    let mut triangles = Vec::new();
    let polygon = marker.polygon.iter().map(project).collect();
    draw_fan(clip_polygon(polygon), |corners| triangles.push(corners));
    triangles
}

/// Clips a convex polygon (Sutherland and Hodgman).
fn clip_polygon(mut polygon: Vec<Corner>) -> Vec<Corner> {
    for (plane, least) in planes() {
        let mut kept = Vec::with_capacity(polygon.len() + 1);
        for (i, &corner) in polygon.iter().enumerate() {
            let next = polygon[(i + 1) % polygon.len()];
            let [here, there] = [corner, next].map(|(h, _)| plane.dot(h) - least);
            if here >= 0.0 {
                kept.push(corner);
            }
            if (here >= 0.0) != (there >= 0.0) {
                let ([inside, outside], [in_by, out_by]) = if here >= 0.0 {
                    ([corner.0, next.0], [here, there])
                } else {
                    ([next.0, corner.0], [there, here])
                };
                let crossing = inside + (outside - inside) * (in_by / (in_by - out_by));
                kept.push((crossing, None));
            }
        }
        polygon = kept;
    }
    polygon
}

/// Splits a convex polygon into triangles about its first corner.
fn draw_fan(polygon: Vec<Corner>, mut draw: impl FnMut([SnappedVertex; 3])) {
    let snapped: Vec<SnappedVertex> = polygon
        .into_iter()
        .map(|(h, known)| {
            known.unwrap_or_else(|| SnappedVertex {
                x: snap_f64(h.x / h.z),
                y: snap_f64(h.y / h.z),
                inverse_depth: (1.0 / h.z) as f32,
            })
        })
        .collect();
    if let [first, rest @ ..] = snapped.as_slice() {
        rest.windows(2)
            .for_each(|pair| draw([*first, pair[0], pair[1]]));
    }
}
