//! Walks through a house of cells and portals: rooms near the eye are drawn as geometry, what lies
//! behind a farther door as an image that was captured through it.
//!
//! ```text
//! cargo run --release --example walk_house -- [MODEL] [FOLDER]
//! ```
//!
//! MODEL is a portal model (.toml), a Sweet Home 3D home (.sh3d, Home.xml), or builtin:house.

use headbox_house::backdrop::{BackdropKind, BackdropQuality};
use headbox_house::house::House;
use headbox_house::settings::WalkSettings;
use headbox_house::store::Store as Backdrops;
use headbox_house::walk::Walker;
use headbox_house::walk_path::WalkPath;
use std::path::PathBuf;

/// Memory for what is captured behind portals, bytes.
const BUDGET: u64 = 256 << 20;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let name = arguments.next().unwrap_or_else(|| "builtin:house".into());
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| ".".into()));
    std::fs::create_dir_all(&folder)?;

    let house = House::open(&name)?;
    println!(
        "{} cells, {} portals",
        house.plan().cells.len(),
        house.plan().portals.len()
    );

    // Coarse backdrops: leave the numbers out for those that the papers' frame needs.
    let quality = BackdropQuality {
        window_face_px: 128,
        strata: 8,
        rays: 8,
        ..BackdropQuality::default()
    };
    let settings = WalkSettings {
        backdrops: Some(BackdropKind::WindowLdi),
        ..WalkSettings::default()
    };
    let (backdrops, mut walker) = (Backdrops::new(BUDGET), Walker::new());

    // A seeded walk through every room.
    let path = WalkPath {
        poses: 6,
        size: [320, 256],
        ..WalkPath::default()
    };
    for (number, camera) in path.cameras(&house)?.iter().enumerate() {
        let captured = Walker::prepare(&house, &backdrops, camera, &settings, &quality)?;
        let (frame, stats) = walker.frame(&house, &backdrops, camera, &settings);
        let file = folder.join(format!("walk_{number}.png"));
        frame.save(&file)?;
        println!(
            "{}: {:.2} ms, {} cells as geometry, {} portals as images ({captured} just captured)",
            file.display(),
            stats.frame_ms,
            stats.geometry_cells,
            stats.portals
        );
    }
    Ok(())
}
