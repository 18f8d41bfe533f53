//! Layers and times of merged frames over unmerged ones by distance, on three scenes like those of
//! the layered lumigraph's paper.
//!
//! `cargo bench --bench lumigraph`. Images of 256x256, frames of 400x400, as in the paper.
//! `HEADBOX_SIMD` sets the level. Compare figures of one run only: frames of one table are drawn in
//! turns.

use glam::DVec3;
use headbox_core::camera::{Camera, focal_px};
use headbox_core::headbox::Headbox;
use headbox_core::progress::Silent;
use headbox_core::statistics::median;
use headbox_lab::turns::run_in_turns;
use headbox_lumigraph::{
    CameraGrid, GridParts, Lumigraph, LumigraphCapture, LumigraphRenderer, LumigraphSettings,
    Placement, RawLumigraph, middle_disparity,
};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::sync::Arc;

const FRAME_PX: [u32; 2] = [400, 400];
const IMAGE_PX: u32 = 256;

/// Rounds of the sweep; frames of a point in each are three.
const ROUNDS: u32 = 25;

/// Focal lengths behind the plane at which the paper merges.
const DISTANCES: [f64; 5] = [0.0, 1.0, 2.0, 4.0, 8.0];

/// Scenes, their focal length over the edge of the cameras' square, and their field of view,
/// degrees (table 4).
const SCENES: [(&str, f64, f64); 3] = [
    ("net", 1.6, 64.0),
    ("statue", 1.5, 67.4),
    ("blocks", 1.5, 67.4),
];

struct Wall {
    focal_m: f64,
    fov_deg: f64,
    tracer: Tracer,
    lighting: Lighting,
    headbox: Headbox,
}

impl Wall {
    fn new((name, focal, fov_deg): (&str, f64, f64)) -> Self {
        let scene = Arc::new(headbox_scenes::build(name, 0).expect("built in"));
        let headbox = scene.headbox.expect("it has one");
        let tracer = Tracer::new(scene, headbox.centre);
        let lighting = Lighting::measure(&tracer, 0);
        Self {
            focal_m: focal * 2.0 * headbox.half_size_m,
            fov_deg,
            tracer,
            lighting,
            headbox,
        }
    }

    /// Captures `cameras` x `cameras` images across the headbox.
    fn raw(&self, cameras: usize) -> RawLumigraph {
        let places = CameraGrid::even_positions(cameras, 2.0 * self.headbox.half_size_m);
        let world_from_eye = CameraGrid::facing(DVec3::NEG_Z, DVec3::Y).expect("a direction");
        let mut parts = GridParts {
            origin: self.headbox.centre,
            world_from_eye,
            columns: places.clone(),
            rows: places,
            focal_px: focal_px(f64::from(IMAGE_PX), self.fov_deg),
            size_px: [IMAGE_PX; 2],
            convergence: 0.0,
        };
        parts.convergence = middle_disparity(&self.tracer, &parts);
        let grid = CameraGrid::new(parts).expect("valid");
        let capture = LumigraphCapture {
            tracer: &self.tracer,
            lighting: &self.lighting,
            lit: false,
            samples: 1,
        };
        capture.run(&grid, &Silent).expect("not given up")
    }

    /// A frame straight ahead from a place on the plane, in half-sizes of the headbox, so many
    /// metres back.
    fn frame(&self, [x, y]: [f64; 2], back_m: f64) -> Camera {
        let eye = self.headbox.centre
            + DVec3::new(x, y, 0.0) * self.headbox.half_size_m
            + DVec3::Z * back_m;
        Camera::look_at(eye, eye - DVec3::Z, DVec3::Y, self.fov_deg, FRAME_PX).expect("valid")
    }
}

/// Returns the median times of each lumigraph with its settings, ms, in turns.
fn medians(drawn: &[(&Lumigraph, LumigraphSettings)], frames: &[Camera]) -> Vec<f64> {
    let mut renderers: Vec<LumigraphRenderer> =
        drawn.iter().map(|_| LumigraphRenderer::new()).collect();
    let times = run_in_turns(&mut renderers, ROUNDS, |i, renderer| {
        let (lumigraph, settings) = &drawn[i];
        let times = frames
            .iter()
            .map(|camera| renderer.render(lumigraph, camera, settings).1.frame_ms);
        Some(times.collect::<Vec<f64>>())
    });
    times
        .iter()
        .map(|rounds| median(rounds.iter().flatten().copied()).expect("frames"))
        .collect()
}

/// Layers and times of merged frames over unmerged ones, by distance.
fn merging(wall: &Wall) {
    let lumigraph = wall
        .raw(4)
        .layered(255, Placement::Uniform)
        .expect("something is seen");
    let unmerged = LumigraphSettings {
        merge: false,
        ..LumigraphSettings::default()
    };
    for distance in DISTANCES {
        let frames = [[0.0, 0.0], [-0.3, 0.2]].map(|at| wall.frame(at, distance * wall.focal_m));
        let ms = medians(
            &[
                (&lumigraph, LumigraphSettings::default()),
                (&lumigraph, unmerged),
            ],
            &frames,
        );
        let layers = LumigraphRenderer::new()
            .render(&lumigraph, &frames[0], &LumigraphSettings::default())
            .1
            .layers;
        println!(
            "  {distance} f behind: {layers} layers, {:.2} over {:.2} ms, {:.2}",
            ms[0],
            ms[1],
            ms[0] / ms[1]
        );
    }
}

fn main() {
    // `cargo test` runs benches, too, to see that they run.
    if std::env::args().any(|argument| argument == "--test") {
        return;
    }
    for scene in SCENES {
        println!("{}", scene.0);
        let wall = Wall::new(scene);
        merging(&wall);
    }
}
