//! Makes sprites with depth of what a camera sees, and tilts them: each sprite is a picture on a
//! plane that shows parallax inside itself.
//!
//! ```text
//! cargo run --release --example tilt_sprite -- [SCENE] [FOLDER]
//! ```

use headbox::{DVec3, Scene, SpriteCapture};
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_sprite::compose::{ComposeSettings, Composer, Composition};
use std::path::PathBuf;

/// Frame size, px.
const SIZE: [u32; 2] = [320, 240];

/// Distance of the eye to each side, as a share of the distance to the scene.
const TILT: f64 = 0.15;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let name = arguments.next().unwrap_or_else(|| "builtin:tree".into());
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| ".".into()));
    std::fs::create_dir_all(&folder)?;

    // One picture with a depth for each pixel, cut into slabs where there is nothing between near
    // and far.
    let scene = Scene::open(name)?;
    let eye = scene.headbox()?.centre;
    let [low, high] = scene.bounds();
    let pivot = (low + high) / 2.0;
    let camera = Camera::look_at(eye, pivot, DVec3::Y, 60.0, SIZE)?;
    let sprites = SpriteCapture::new(&scene, &camera)
        .slabs(2)
        .samples(4)
        .run()?;
    println!("{} sprites with depth", sprites.sprites().len());
    sprites.write(&folder.join("scene.sprite"))?;

    // The eye goes around what it looks at; the sprites follow, with the sky behind them.
    let right = camera.world_from_eye().x_axis * (pivot - eye).length();
    let layers = Composition::new(sprites, Vec::new());
    let (mut composer, mut frame) = (Composer::default(), Frame::default());
    for (number, tilt) in [-TILT, 0.0, TILT].into_iter().enumerate() {
        let tilted = Camera::look_at(eye + right * tilt, pivot, DVec3::Y, 60.0, SIZE)?;
        let stats = layers.render(
            &mut composer,
            &tilted,
            &ComposeSettings::default(),
            &mut frame,
        );
        let file = folder.join(format!("tilt_{number}.png"));
        frame.save(&file)?;
        println!(
            "{}: {:.2} ms",
            file.display(),
            stats.sprites_ms + stats.compose_ms
        );
    }
    Ok(())
}
