//! Pilot rays, traced before lighting to measure exposure and fill light.

use super::LitPoint;
use crate::bvh::{Ray, Tracer};
use crate::sampler::{random4, unit_float};
use glam::{DVec3, Vec3};

/// Surface hit by a pilot ray.
pub(super) struct PilotPoint {
    pub(super) point: LitPoint,
    pub(super) albedo: [f32; 3],
    pub(super) emission: [f32; 3],
    pub(super) distance_m: f32,
}

/// Hits and misses of rays from one place, in directions evenly spread over the sphere.
pub(super) struct Pilot {
    pub(super) surfaces: Vec<PilotPoint>,
    pub(super) misses: Vec<Vec3>,
    /// Direction window (see [`Self::WINDOWS`]) of each surface, then of each miss.
    windows: Vec<usize>,
}

impl Pilot {
    /// Number of windows by height and by azimuth into which all directions are divided, with equal
    /// solid angles.
    const WINDOWS: usize = 8;

    /// Weight of the windows of one height, from the lowest to the highest: frames mostly look
    /// level, and one of 60 degrees shows the heights from -0.5 to 0.5 on the unit sphere.
    const HEIGHT_WEIGHTS: [f64; Self::WINDOWS] = [0.25, 0.5, 1.0, 1.0, 1.0, 1.0, 0.5, 0.25];

    /// Traces pilot rays from `place`, world metres.
    pub(super) fn new(tracer: &Tracer, place: DVec3) -> Self {
        const RAYS: usize = 4096;
        let origin = (place - tracer.origin()).as_vec3();
        let (mut surfaces, mut misses) = (Vec::new(), Vec::new());
        let (mut windows, mut miss_windows) = (Vec::new(), Vec::new());
        for i in 0..RAYS {
            let window = i % (Self::WINDOWS * Self::WINDOWS);
            let aim = random4([i as u32, 4, 5, 6]).map(unit_float);
            let in_window =
                |cell: usize, jitter: f32| (cell as f32 + jitter) / Self::WINDOWS as f32;
            let y = 2.0 * in_window(window / Self::WINDOWS, aim[0]) - 1.0;
            let (sin, cos) =
                (in_window(window % Self::WINDOWS, aim[1]) * std::f32::consts::TAU).sin_cos();
            let radius = (1.0 - y * y).max(0.0).sqrt();
            let direction = Vec3::new(radius * cos, y, radius * sin);
            let ray = Ray::new(origin, direction);
            let Some(hit) = tracer.closest(&ray) else {
                misses.push(direction);
                miss_windows.push(window);
                continue;
            };
            let (point, surface) = LitPoint::from_hit(tracer, &ray, &hit);
            surfaces.push(PilotPoint {
                point,
                albedo: surface.albedo,
                emission: surface.emission,
                distance_m: hit.t,
            });
            windows.push(window);
        }
        windows.append(&mut miss_windows);
        Self {
            surfaces,
            misses,
            windows,
        }
    }

    /// Returns the weighted geometric mean over the windows of the mean luminance in each; `levels`
    /// is in the order of `windows`. The mean inside a window reduces the noise of single samples,
    /// which would bias a logarithm toward black.
    pub(super) fn logarithmic_mean(&self, levels: &[f32]) -> f32 {
        let mut sums = [(0.0f64, 0u32); Self::WINDOWS * Self::WINDOWS];
        for (&window, &level) in self.windows.iter().zip(levels) {
            sums[window].0 += f64::from(level);
            sums[window].1 += 1;
        }
        let means = sums.map(|(sum, count)| sum / f64::from(count.max(1)));
        let floor = 1e-3 * means.iter().copied().fold(0.0, f64::max);
        let (mut logarithms, mut weights) = (0.0, 0.0);
        for (window, (mean, (_, count))) in means.iter().zip(sums).enumerate() {
            if count > 0 {
                let weight = Self::HEIGHT_WEIGHTS[window / Self::WINDOWS];
                logarithms += weight * mean.max(floor).ln();
                weights += weight;
            }
        }
        (logarithms / f64::max(weights, f64::MIN_POSITIVE)).exp() as f32
    }
}

/// Returns the value at a quantile; 0 for no values.
pub(super) fn percentile(values: &mut [f32], share: f64) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let at = ((values.len() - 1) as f64 * share) as usize;
    *values.select_nth_unstable_by(at, f32::total_cmp).1
}
