//! Selection of the neighbours for a view's depth, and the range of depths to search.

use super::matching::patch_match::{MAX_NEIGHBORS, required_matches};
use super::matching::relative::{LevelCamera, Relative};
use glam::DVec3;

/// Best triangulation angle, radians: smaller angles give little parallax, larger ones different
/// images.
const BEST_ANGLE: f64 = 0.14;
/// Standard deviations of the weight for smaller and for larger angles, radians.
const SIGMA_BELOW: f64 = 0.07;
const SIGMA_ABOVE: f64 = 0.3;

/// Side of the grid of sampled pixels.
const GRID: usize = 5;

/// Number of depths sampled while depth is unknown.
const DEPTHS: usize = 14;

/// Number of nearest views that are all candidates, and the total number of candidates.
const CLOSEST: usize = 8;
const CANDIDATES: usize = 48;

/// Distance of eyes relative to that of other eyes up to which their positions count as equal.
const SAME_POSITION: f64 = 1e-3;

/// Camera of a view that may become a neighbour.
pub(super) struct Candidate {
    pub(super) camera: LevelCamera,
    pub(super) size: [f64; 2],
}

/// Returns the candidate neighbours of a view: all near ones, and some of the far ones.
pub(super) fn candidates(eyes: &[DVec3], own: usize) -> Vec<usize> {
    let mut order: Vec<(f64, usize)> = (0..eyes.len())
        .filter(|&i| i != own)
        .map(|i| (eyes[i].distance_squared(eyes[own]), i))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    // Views at the same position have no parallax.
    let same = order
        .get(CLOSEST)
        .or(order.last())
        .map_or(0.0, |(distance, _)| {
            distance * SAME_POSITION * SAME_POSITION
        });
    order.retain(|(distance, _)| *distance > same);
    let (near, far) = order.split_at(order.len().min(CLOSEST));
    let step = far.len().div_ceil(CANDIDATES - CLOSEST).max(1);
    near.iter()
        .chain(far.iter().step_by(step))
        .map(|&(_, i)| i)
        .collect()
}

/// Samples points along lines of sight of a view, in groups of equal depth: `DEPTHS` depths with
/// equal ratios, from half the distance of the nearest other eye to fifty times that of the
/// farthest.
pub(super) fn sample_frustum(own: &Candidate, others: &[Candidate]) -> Vec<Vec<DVec3>> {
    let distance = |other: &Candidate| other.camera.pose.eye.distance(own.camera.pose.eye);
    let nearest = others.iter().map(distance).fold(f64::INFINITY, f64::min) * 0.5;
    let farthest = others.iter().map(distance).fold(0.0, f64::max) * 50.0;
    let depth = |k: usize| nearest * (farthest / nearest).powf(k as f64 / (DEPTHS - 1) as f64);
    (0..DEPTHS)
        .map(|k| {
            grid(own)
                .map(|ray| own.camera.pose.to_world(ray * depth(k)))
                .collect()
        })
        .collect()
}

/// Returns rays in eye space through a grid of pixels.
fn grid(own: &Candidate) -> impl Iterator<Item = DVec3> {
    let position = |k: usize, side: f64| (k as f64 + 0.5) / GRID as f64 * side;
    (0..GRID * GRID).map(move |i| {
        own.camera.ray(
            position(i % GRID, own.size[0]),
            position(i / GRID, own.size[1]),
        )
    })
}

/// Chooses the best of some views, at most `most`, greedily: each by the points that it sees at
/// good angles and that the views chosen before do not.
pub(super) fn choose(
    own: &Candidate,
    others: &[Candidate],
    points: &[Vec<DVec3>],
    most: usize,
) -> Vec<usize> {
    let weight: Vec<Vec<f64>> = others
        .iter()
        .map(|other| {
            points
                .iter()
                .map(|group| mean_weight(own, other, group))
                .collect()
        })
        .collect();
    let mut sums = vec![0.0f64; points.len()];
    let mut chosen = Vec::new();
    while chosen.len() < most.min(MAX_NEIGHBORS) {
        let gain = |i: usize| {
            let gains = sums
                .iter()
                .zip(&weight[i])
                .map(|(sum, weight)| (sum + weight).sqrt() - sum.sqrt());
            gains.sum::<f64>()
        };
        let left = (0..others.len()).filter(|i| !chosen.contains(i));
        let best = left
            .map(|i| (gain(i), i))
            .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        let Some((_, best)) = best.filter(|(gain, _)| *gain > 1e-4) else {
            break;
        };
        sums.iter_mut()
            .zip(&weight[best])
            .for_each(|(sum, weight)| *sum += weight);
        chosen.push(best);
    }
    chosen
}

/// Chooses at most `most` views evenly from `others`, sorted by distance, among those with a
/// similar direction, or among all if there is none.
pub(super) fn choose_spread(own: &Candidate, others: &[Candidate], most: usize) -> Vec<usize> {
    /// Minimum cosine between similar directions.
    const MIN_COSINE: f64 = 0.8;
    let axis = |candidate: &Candidate| candidate.camera.pose.world_from_eye.z_axis;
    let mut alike: Vec<usize> = (0..others.len())
        .filter(|i| axis(own).dot(axis(&others[*i])) > MIN_COSINE)
        .collect();
    if alike.is_empty() {
        alike = (0..others.len()).collect();
    }
    let count = most.min(alike.len());
    (1..=count)
        .map(|k| alike[k * alike.len() / count - 1])
        .collect()
}

/// Returns the mean weight of points in another view by visibility and triangulation angle, 0..=1.
fn mean_weight(own: &Candidate, other: &Candidate, points: &[DVec3]) -> f64 {
    let weight = |&point: &DVec3| {
        if !other.sees(point) {
            return 0.0;
        }
        let angle = (own.camera.pose.eye - point).angle_between(other.camera.pose.eye - point);
        let offset = angle - BEST_ANGLE;
        let deviation = if offset < 0.0 {
            SIGMA_BELOW
        } else {
            SIGMA_ABOVE
        };
        (-offset * offset / (2.0 * deviation * deviation)).exp()
    };
    points.iter().map(weight).sum::<f64>() / points.len().max(1) as f64
}

impl Candidate {
    /// Returns true if a point of the world projects into the image.
    fn sees(&self, point: DVec3) -> bool {
        let p = self.camera.pose.to_eye(point);
        let [fx, fy] = self.camera.focal_px;
        let [cx, cy] = self.camera.principal_px;
        let x = cx - fx * p.x / p.z;
        let y = cy + fy * p.y / p.z;
        p.z < 0.0 && x >= 0.0 && y >= 0.0 && x < self.size[0] && y < self.size[1]
    }
}

/// Returns the smallest and the largest inverse depth, 1/m, at which enough other views overlap a
/// view; `None` without overlap.
pub(super) fn depth_range(own: &Candidate, others: &[&Candidate]) -> Option<[f32; 2]> {
    /// Number of tested depths per factor of two.
    const STEPS: f64 = 8.0;
    let needed = required_matches(others.len()).max(1);
    let rays: Vec<DVec3> = grid(own).collect();
    let overlaps = |inverse_depth: f64| {
        let is_visible = |ray: &DVec3| {
            let point = own.camera.pose.to_world(*ray / inverse_depth);
            others.iter().filter(|other| other.sees(point)).count() >= needed
        };
        rays.iter().any(is_visible)
    };
    let distances = others
        .iter()
        .map(|other| other.camera.pose.eye.distance(own.camera.pose.eye));
    let widest = distances.fold(0.0, f64::max);
    let inverse_depth = |k: i32| (f64::from(k) / STEPS).exp2() / widest;
    let [far, near] = [-12 * STEPS as i32, 5 * STEPS as i32];
    let first = (far..=near).find(|&k| overlaps(inverse_depth(k)))?;
    let last = (far..=near).rev().find(|&k| overlaps(inverse_depth(k)))?;
    let low = if first == far {
        0.0
    } else {
        inverse_depth(first - 1)
    };
    Some([low as f32, inverse_depth(last + 1) as f32])
}

/// Returns the largest motion of a view's central pixel in the other images over a range of inverse
/// depths, pixels.
pub(super) fn motion_px(own: &Candidate, others: &[&Candidate], [low, high]: [f32; 2]) -> f32 {
    let [x, y] = own.size.map(|side| side as f32 / 2.0);
    let motion = |other: &&Candidate| {
        let relative = Relative::new(&own.camera, &other.camera);
        let project = |q: f32| {
            let h = relative.warp(x, y, q);
            (h.z > 0.0).then(|| h.truncate() / h.z)
        };
        match (project(low), project(high)) {
            (Some(a), Some(b)) => a.distance(b),
            // The point passes the other eye.
            _ => other.size[0].max(other.size[1]) as f32,
        }
    };
    others.iter().map(motion).fold(0.0, f32::max)
}
