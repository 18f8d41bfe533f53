//! Leaves: parts of a door or window that close its opening.

use crate::Portal;
use glam::{DVec2, DVec3};
use headbox_scene::load::Group;
use headbox_scene::scene::Scene;

/// Least share of the opening that a leaf covers within the wall: half a double door covers 45 %, a
/// pane of a double window 32 %, the frame of a sash about 20 %.
const MIN_COVERAGE: f64 = 0.28;

/// Resolution of the raster on the opening.
const CELLS: usize = 48;

/// Distance of handles and hinges from their leaf, metres: along the opening, and across. They are
/// less than half as high as the leaf; a frame is not.
const FITTINGS_M: [f64; 2] = [0.03, 0.12];

/// Maximum distance of a closed leaf from the wall's faces, metres.
const BESIDE_WALL_M: f64 = 0.04;

/// Returns, for each group of a door or window, true if it closes the opening `portal` or is a
/// fitting of a part that does, such as a handle. `wall_m` is the thickness of the wall. Open
/// leaves are not in the wall.
pub(super) fn closing_groups(
    scene: &Scene,
    portal: &Portal,
    wall_m: f64,
    groups: &[&Group],
) -> Vec<bool> {
    let &[a, b, c, ..] = portal.polygon.as_slice() else {
        return vec![false; groups.len()];
    };
    let (right, up) = (b - a, c - b);
    let axes = [right.normalize_or_zero(), up.normalize_or_zero()];
    let size = DVec2::new(right.length(), up.length());
    let normal = axes[0].cross(axes[1]);
    // Coordinates of the opening: along, up, across.
    let local = |p: DVec3| {
        DVec3::new(
            (p - a).dot(axes[0]),
            (p - a).dot(axes[1]),
            (p - a).dot(normal),
        )
    };
    let corners = |triangle: u32| scene.corners(triangle).map(local);
    let reach = wall_m / 2.0 + BESIDE_WALL_M;
    let boxes: Vec<[DVec3; 2]> = groups
        .iter()
        .map(|group| {
            let all = group.triangles.clone().flat_map(corners);
            all.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| {
                [low.min(p), high.max(p)]
            })
        })
        .collect();
    let closes: Vec<bool> = groups
        .iter()
        .map(|group| coverage(group.triangles.clone().map(corners), size, reach) > MIN_COVERAGE)
        .collect();
    let grow = DVec3::new(FITTINGS_M[0], FITTINGS_M[0], FITTINGS_M[1]);
    let is_fitting = |index: usize| {
        let [low, high] = boxes[index];
        boxes.iter().zip(&closes).any(|(leaf, closes)| {
            let is_small = 2.0 * (high.y - low.y) < leaf[1].y - leaf[0].y;
            *closes
                && is_small
                && low.cmpge(leaf[0] - grow).all()
                && high.cmple(leaf[1] + grow).all()
        })
    };
    (0..groups.len())
        .map(|index| closes[index] || is_fitting(index))
        .collect()
}

/// Returns the share of an opening of `size` that triangles within `reach` of its plane cover.
fn coverage(triangles: impl Iterator<Item = [DVec3; 3]>, size: DVec2, reach: f64) -> f64 {
    let mut covered = vec![false; CELLS * CELLS];
    let cell = size / CELLS as f64;
    for [a, b, c] in triangles {
        let low = a.min(b).min(c);
        let high = a.max(b).max(c);
        let first = (DVec2::new(low.x, low.y) / cell - 0.5)
            .ceil()
            .max(DVec2::ZERO);
        let last = (DVec2::new(high.x, high.y) / cell - 0.5)
            .floor()
            .min(DVec2::splat(CELLS as f64 - 1.0));
        if first.cmpgt(last).any() || !(first + last).is_finite() {
            continue;
        }
        for row in first.y as usize..=last.y as usize {
            for column in first.x as usize..=last.x as usize {
                let p = (DVec2::new(column as f64, row as f64) + 0.5) * cell;
                if depth_at([a, b, c], p).is_some_and(|depth| depth.abs() <= reach) {
                    covered[row * CELLS + column] = true;
                }
            }
        }
    }
    covered.iter().filter(|&&covered| covered).count() as f64 / covered.len() as f64
}

/// Returns the third coordinate of a triangle at a point in the plane of the other two, if the
/// triangle covers the point.
fn depth_at([a, b, c]: [DVec3; 3], p: DVec2) -> Option<f64> {
    let area = |a: DVec3, b: DVec3, p: DVec2| (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x);
    let weights = [area(b, c, p), area(c, a, p), area(a, b, p)];
    let total: f64 = weights.iter().sum();
    let inside = weights.iter().all(|&w| w >= 0.0) || weights.iter().all(|&w| w <= 0.0);
    (inside && total != 0.0)
        .then(|| (a.z * weights[0] + b.z * weights[1] + c.z * weights[2]) / total)
}
