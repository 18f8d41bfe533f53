//! Exposure metered by a few thousand light samples against that of path-traced truth.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use headbox_core::bounces::Bounces;
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::progress::Silent;
use headbox_ldi::scene_source::SceneSource;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth;
use headbox_trace::viewpoint::place_headbox;
use std::sync::Arc;

/// Number of windows of equal solid angle by height and by azimuth.
const WINDOWS: usize = 8;

/// Weight of a window by height, from the lowest.
const WEIGHTS: [f64; WINDOWS] = [0.25, 0.5, 1.0, 1.0, 1.0, 1.0, 0.5, 0.25];

/// Linear value of middle grey, 125 of 255 in sRGB.
const MIDDLE_GREY: f64 = 0.21;

/// Returns by how many stops the metered exposure of a scene exceeds that of truth around the
/// default headbox: middle grey by the geometric mean over windows of mean luminances.
fn stops_above_truth(name: &str) -> f64 {
    const SIDE: u32 = 48;
    const SAMPLES: u32 = 32;
    let scene = Arc::new(SceneSource::new(name).open().unwrap());
    let centre = place_headbox(&scene, None, None).unwrap().centre;
    let tracer = Tracer::new(scene, centre);
    let lighting = Lighting::prepare_paths(&tracer, centre, Bounces::Full, true);
    let mut windows = [[(0.0, 0.0); WINDOWS]; WINDOWS];
    for face in Face::ALL {
        let target = centre + face.normal();
        let camera = Camera::look_at(centre, target, face.up(), 90.0, [SIDE; 2]).unwrap();
        let truth = truth::render(&tracer, &lighting, true, &camera, SAMPLES, &Silent);
        for (i, [r, g, b]) in (0..).zip(truth.radiance) {
            let [x, y] = [i % SIDE, i / SIDE].map(|at| f64::from(at) + 0.5);
            let ray = camera.direction(x, y).normalize();
            let solid_angle = ray.dot(face.normal()).powi(3);
            let [height, azimuth] = [
                (ray.y + 1.0) / 2.0,
                ray.z.atan2(ray.x).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU,
            ]
            .map(|at| ((at * WINDOWS as f64) as usize).min(WINDOWS - 1));
            let luminance = 0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b);
            let (sum, weight) = &mut windows[height][azimuth];
            *sum += luminance * solid_angle;
            *weight += solid_angle;
        }
    }
    let means = windows.map(|row| row.map(|(sum, weight)| sum / weight));
    let floor = 1e-3 * means.as_flattened().iter().copied().fold(0.0, f64::max);
    let logarithms = means.iter().zip(WEIGHTS).map(|(row, weight)| {
        let logarithms = row.iter().map(|mean| mean.max(floor).ln());
        weight * logarithms.sum::<f64>()
    });
    let mean = logarithms.sum::<f64>() / (WINDOWS as f64 * WEIGHTS.iter().sum::<f64>());
    (f64::from(lighting.exposure) * mean.exp() / MIDDLE_GREY).log2()
}

/// Largest difference, stops: four times the noise of the few light samples, and far below a third
/// of a stop, which a viewer notices.
const TOLERANCE: f64 = 0.1;

#[test]
fn metered_exposure_is_that_of_truth() {
    for scene in ["interior", "tree", "ward", "castle"] {
        let stops = stops_above_truth(&format!("builtin:{scene}"));
        assert!(stops.abs() < TOLERANCE, "{scene}: {stops:.3} stops");
    }
}
