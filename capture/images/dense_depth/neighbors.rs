//! Which other views help to find a view's depth, and between which depths to look.

use super::patch_match::{MOST_OTHERS, agreeing};
use super::relative::{CameraAt, Relative};
use glam::DVec3;

/// The angle between two lines of sight at which depth is found best, radians: less, and depth moves little; more, and pictures differ.
const BEST_ANGLE: f64 = 0.14;
/// How soon smaller and larger angles become useless.
const SMALLER: f64 = 0.07;
const LARGER: f64 = 0.3;

/// Pixels, to a side of a grid, whose lines of sight are followed.
const GRID: usize = 5;

/// Depths at which they are, where nothing is known yet.
const DEPTHS: usize = 14;

/// Views that are looked at more closely: of those that lie in order of distance, these ranks and then every so manieth.
const CLOSEST: usize = 8;
const CANDIDATES: usize = 48;

/// Eyes that are no farther apart than this share of the distance to others stand in one place.
const SAME_PLACE: f64 = 1e-3;

/// A view as seen from here.
pub(super) struct Candidate {
    pub(super) camera: CameraAt,
    pub(super) size: [f64; 2],
}

/// The views that are looked at more closely: near ones all, of the far ones some.
pub(super) fn candidates(eyes: &[DVec3], own: usize) -> Vec<usize> {
    let mut order: Vec<(f64, usize)> = (0..eyes.len())
        .filter(|&i| i != own)
        .map(|i| (eyes[i].distance_squared(eyes[own]), i))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    // From the same place nothing moves.
    let same = order
        .get(CLOSEST)
        .or(order.last())
        .map_or(0.0, |(distance, _)| distance * SAME_PLACE * SAME_PLACE);
    order.retain(|(distance, _)| *distance > same);
    let (near, far) = order.split_at(order.len().min(CLOSEST));
    let step = far.len().div_ceil(CANDIDATES - CLOSEST).max(1);
    near.iter()
        .chain(far.iter().step_by(step))
        .map(|&(_, i)| i)
        .collect()
}

/// Points of the world, in groups of one depth each, along lines of sight of a view: `DEPTHS` depths, evenly in their logarithm, from half the distance of the
/// nearest other eye to fifty times that of the farthest.
pub(super) fn anywhere(own: &Candidate, others: &[Candidate]) -> Vec<Vec<DVec3>> {
    let apart = |other: &Candidate| other.camera.pose.eye.distance(own.camera.pose.eye);
    let nearest = others.iter().map(apart).fold(f64::INFINITY, f64::min) * 0.5;
    let farthest = others.iter().map(apart).fold(0.0, f64::max) * 50.0;
    let depth = |k: usize| nearest * (farthest / nearest).powf(k as f64 / (DEPTHS - 1) as f64);
    (0..DEPTHS)
        .map(|k| {
            grid(own)
                .map(|ray| own.camera.pose.to_world(ray * depth(k)))
                .collect()
        })
        .collect()
}

/// Rays of eye space over a picture.
fn grid(own: &Candidate) -> impl Iterator<Item = DVec3> {
    let at = |k: usize, side: f64| (k as f64 + 0.5) / GRID as f64 * side;
    (0..GRID * GRID).map(move |i| {
        own.camera
            .ray(at(i % GRID, own.size[0]), at(i / GRID, own.size[1]))
    })
}

/// The best of some views, at most `most`: each is chosen for what it sees at good angles and those before it do not.
pub(super) fn choose(
    own: &Candidate,
    others: &[Candidate],
    points: &[Vec<DVec3>],
    most: usize,
) -> Vec<usize> {
    let worth: Vec<Vec<f64>> = others
        .iter()
        .map(|other| {
            points
                .iter()
                .map(|group| mean_worth(own, other, group))
                .collect()
        })
        .collect();
    let mut sums = vec![0.0f64; points.len()];
    let mut chosen = Vec::new();
    while chosen.len() < most.min(MOST_OTHERS) {
        let gain = |i: usize| {
            let gains = sums
                .iter()
                .zip(&worth[i])
                .map(|(sum, worth)| (sum + worth).sqrt() - sum.sqrt());
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
            .zip(&worth[best])
            .for_each(|(sum, worth)| *sum += worth);
        chosen.push(best);
    }
    chosen
}

/// Views at all distances, at most `most`, of some that lie in order of distance: those that look the same way, evenly by their rank, or else all alike.
pub(super) fn spread(own: &Candidate, others: &[Candidate], most: usize) -> Vec<usize> {
    /// The cosine of the angle between two axes that look the same way.
    const SAME_WAY: f64 = 0.8;
    let axis = |candidate: &Candidate| candidate.camera.pose.world_from_eye.z_axis;
    let mut alike: Vec<usize> = (0..others.len())
        .filter(|i| axis(own).dot(axis(&others[*i])) > SAME_WAY)
        .collect();
    if alike.is_empty() {
        alike = (0..others.len()).collect();
    }
    let count = most.min(alike.len());
    (1..=count)
        .map(|k| alike[k * alike.len() / count - 1])
        .collect()
}

/// How well another view sees some points of this one, 0..=1.
fn mean_worth(own: &Candidate, other: &Candidate, points: &[DVec3]) -> f64 {
    let worth = |&point: &DVec3| {
        if !other.sees(point) {
            return 0.0;
        }
        let angle = (own.camera.pose.eye - point).angle_between(other.camera.pose.eye - point);
        let off = angle - BEST_ANGLE;
        let deviation = if off < 0.0 { SMALLER } else { LARGER };
        (-off * off / (2.0 * deviation * deviation)).exp()
    };
    points.iter().map(worth).sum::<f64>() / points.len().max(1) as f64
}

impl Candidate {
    fn sees(&self, point: DVec3) -> bool {
        let p = self.camera.pose.to_eye(point);
        let [fx, fy] = self.camera.focal_px;
        let [cx, cy] = self.camera.principal_px;
        let (x, y) = (cx - fx * p.x / p.z, cy + fy * p.y / p.z);
        p.z < 0.0 && x >= 0.0 && y >= 0.0 && x < self.size[0] && y < self.size[1]
    }
}

/// The least and the largest inverse depth at which enough of the others see some of what a view sees, 1/m; `None` if there are none.
pub(super) fn range(own: &Candidate, others: &[&Candidate]) -> Option<[f32; 2]> {
    /// Depths that are tried for each factor of two.
    const FINE: f64 = 8.0;
    let needed = agreeing(others.len()).max(1);
    let rays: Vec<DVec3> = grid(own).collect();
    let seen = |inverse_depth: f64| {
        let count = |ray: &&DVec3| {
            let point = own.camera.pose.to_world(**ray / inverse_depth);
            others.iter().filter(|other| other.sees(point)).count() >= needed
        };
        rays.iter().filter(count).count() > 0
    };
    let apart = others
        .iter()
        .map(|other| other.camera.pose.eye.distance(own.camera.pose.eye));
    let widest = apart.fold(0.0, f64::max);
    let at = |k: i32| (f64::from(k) / FINE).exp2() / widest;
    let [far, near] = [-12 * FINE as i32, 5 * FINE as i32];
    let (first, last) = (
        (far..=near).find(|&k| seen(at(k)))?,
        (far..=near).rev().find(|&k| seen(at(k)))?,
    );
    let low = if first == far { 0.0 } else { at(first - 1) };
    Some([low as f32, at(last + 1) as f32])
}

/// Pixels that a view's middle moves in the picture where it moves most, over a range of inverse depths.
pub(super) fn motion_px(own: &Candidate, others: &[&Candidate], [low, high]: [f32; 2]) -> f32 {
    let [x, y] = own.size.map(|side| side as f32 / 2.0);
    let motion = |other: &&Candidate| {
        let relative = Relative::new(&own.camera, &other.camera);
        let place = |q: f32| {
            let h = relative.at(x, y, q);
            (h.z > 0.0).then(|| h.truncate() / h.z)
        };
        match (place(low), place(high)) {
            (Some(a), Some(b)) => a.distance(b),
            // It passes the other eye.
            _ => other.size[0].max(other.size[1]) as f32,
        }
    };
    others.iter().map(motion).fold(0.0, f32::max)
}
