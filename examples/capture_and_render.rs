//! Captures a scene once, then draws it from several places inside the headbox.
//!
//! ```text
//! cargo run --release --example capture_and_render -- [SCENE] [FOLDER]
//! ```
//!
//! SCENE is an .obj, .gltf or .glb file or builtin:NAME; FOLDER takes the pictures.

use headbox::{Capture, DVec3, Scene};
use headbox_core::camera::Camera;
use headbox_cube::pack::layout::CubeLdi;
use headbox_cube::render::{RenderSettings, Renderer};
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let name = arguments
        .next()
        .unwrap_or_else(|| "builtin:interior".into());
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| ".".into()));
    std::fs::create_dir_all(&folder)?;

    // Rays are traced once, from a headbox that the library places in free space. Small faces and
    // few rays are for looking at the result within seconds; leave both out for the papers'
    // quality.
    let scene = Scene::open(name)?;
    scene
        .notes()
        .iter()
        .for_each(|note| eprintln!("note: {note}"));
    let ldi = Capture::new(&scene)
        .face_size(256)
        .strata(12)
        .rays(8)
        .run()?;
    println!(
        "{} depth pixels about {}",
        ldi.depth_pixel_count(),
        ldi.center()
    );

    // The file is the capture: whoever has it needs neither the scene nor a ray tracer.
    let file = folder.join("scene.ldi");
    ldi.write(&file)?;
    let ldi = CubeLdi::read(&file)?;

    // An eye that moves from one side of the headbox to the other, looking straight ahead.
    let mut renderer = Renderer::new();
    let settings = RenderSettings::default();
    for (number, side) in [-0.8, 0.0, 0.8].into_iter().enumerate() {
        let eye = ldi.center() + DVec3::X * side * ldi.half_size();
        let camera = Camera::look_at(eye, eye + DVec3::NEG_Z, DVec3::Y, 60.0, [640, 480])?;
        let (frame, stats) = renderer.render_with_stats(&ldi, &camera, &settings);
        let file = folder.join(format!("frame_{number}.png"));
        frame.save(&file)?;
        println!(
            "{}: {:.2} ms, {} pixels of which nothing is known",
            file.display(),
            stats.frame_ms,
            frame.hole_count()
        );
    }
    Ok(())
}
