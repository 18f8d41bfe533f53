//! Captures a layered lumigraph: images from a grid of cameras, whose pixels know their layer of
//! disparity. Draws it from between the cameras and from behind their plane.
//!
//! ```text
//! cargo run --release --example look_into_lumigraph -- [SCENE] [FOLDER]
//! ```

use headbox::{Camera, CameraGrid, DVec3, GridParts, LumigraphCapture, LumigraphRenderer, Scene};
use headbox_core::progress::Silent;
use headbox_lumigraph::{LumigraphSettings, Placement, middle_disparity};
use headbox_trace::light::Lighting;
use headbox_trace::viewpoint::suggest_view;
use std::path::PathBuf;

/// Size of the grid's images and of the frames, pixels.
const SIZE: [u32; 2] = [192, 192];

/// Number of layers of disparity.
const LAYERS: usize = 16;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let name = arguments.next().unwrap_or_else(|| "builtin:blocks".into());
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| ".".into()));
    std::fs::create_dir_all(&folder)?;

    // Cameras in 4 columns and 4 rows on a face of the headbox, converging on the scene's middle
    // depth.
    let scene = Scene::open(name)?;
    let headbox = scene.headbox()?;
    let tracer = scene.tracer(headbox.centre);
    let ahead = suggest_view(&tracer, headbox.centre);
    let extent_m = 2.0 * headbox.half_size_m;
    let mut parts = GridParts {
        origin: headbox.centre,
        world_from_eye: CameraGrid::facing(ahead, DVec3::Y).ok_or("the view has no direction")?,
        columns: CameraGrid::even_positions(4, extent_m),
        rows: CameraGrid::even_positions(4, extent_m),
        focal_px: f64::from(SIZE[1]),
        size_px: SIZE,
        convergence: 0.0,
    };
    parts.convergence = middle_disparity(&tracer, &parts);
    let grid = CameraGrid::new(parts)?;

    let lighting = Lighting::prepare(&tracer, headbox.centre, 1, true);
    let capture = LumigraphCapture {
        tracer: &tracer,
        lighting: &lighting,
        lit: true,
        samples: 4,
    };
    let lumigraph = capture
        .run(&grid, &Silent)?
        .layered(LAYERS, Placement::Histogram)?;
    lumigraph.write(&folder.join("scene.lumi"))?;

    let mut renderer = LumigraphRenderer::new();
    for (number, back) in [0.0, 0.5].into_iter().enumerate() {
        let eye = headbox.centre - ahead * back * extent_m;
        let camera = Camera::look_at(eye, eye + ahead, DVec3::Y, 50.0, SIZE)?;
        let settings = LumigraphSettings::default();
        let (frame, stats) = renderer.render(&lumigraph, &camera, &settings);
        let file = folder.join(format!("lumigraph_{number}.png"));
        frame.save(&file)?;
        println!(
            "{}: {:.2} ms, {} layers",
            file.display(),
            stats.frame_ms,
            stats.layers
        );
    }
    Ok(())
}
