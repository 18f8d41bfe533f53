//! Captures a room into plane textures and depth pixels within an error bound, puts a model of
//! triangles among them, lit by the room, and draws both in one frame.
//!
//! ```text
//! cargo run --release --example place_model -- [SCENE] [MODEL] [FOLDER]
//! ```
//!
//! SCENE and MODEL are .obj, .gltf or .glb files or builtin:NAME.

use headbox::{Camera, Capture, ComposeSettings, Composer, Composition, DVec3, Frame};
use headbox::{Polygons, Scene, SpriteSet};
use headbox_core::progress::Silent;
use headbox_ldi::scene_source::SceneSource;
use headbox_sprite::compose::place;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let mut next = |default: &str| arguments.next().unwrap_or_else(|| default.into());
    let scene = Scene::open(next("builtin:interior"))?;
    let mut model = SceneSource::new(next("builtin:statue")).open()?;
    let folder = PathBuf::from(next("."));
    std::fs::create_dir_all(&folder)?;

    // Where depth is affine within one frame pixel, a plane texture replaces the depth pixels.
    let capture = Capture::new(&scene).face_size(256).strata(12).rays(8);
    let ldi = capture.error_px(1.0).run()?;
    println!(
        "{} tiles of plane textures, {} depth pixels",
        ldi.planes.tiles.len(),
        ldi.depth_pixel_count()
    );

    // The model, scaled to 1.2 m, stands 2 m before the eye; its light is the room's.
    let eye = ldi.center();
    let [low, high] = model.bounds();
    let scale = 1.2 / (high - low).max_element();
    let middle = scale * (low + high) / 2.0;
    place(&mut model, scale, 0.0, eye + DVec3::NEG_Z * 2.0 - middle);
    let polygons = Polygons::lit_by(model, &ldi, &Silent)?;

    let composition = Composition::new(SpriteSet::new(Vec::new()), vec![ldi]);
    let composition = composition.with_polygons(vec![polygons]);
    let camera = Camera::look_at(eye, eye + DVec3::NEG_Z, DVec3::Y, 60.0, [640, 480])?;
    let (mut composer, mut frame) = (Composer::default(), Frame::default());
    let settings = ComposeSettings::default();
    composition.render(&mut composer, &camera, &settings, &mut frame);
    let file = folder.join("model.png");
    frame.save(&file)?;
    println!("{}", file.display());
    Ok(())
}
