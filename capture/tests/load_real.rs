//! Files that nobody here wrote: triangle counts, and everything that the loader says about them.

use headbox_capture::load::{LoadOptions, load};
use headbox_capture::scene::{Scene, UpAxis};
use std::path::PathBuf;

/// Loads a file of the folder of real data, or says that it is absent.
fn real(relative: &str, options: LoadOptions) -> Option<Scene> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")).join(relative);
    if !path.is_file() {
        println!("skipped: {relative} is absent");
        return None;
    }
    let scene = load(&path, &options).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(scene.validate(), Ok(()));
    println!(
        "{relative}: {} triangles, {} textures, {:?}",
        scene.triangles.len(),
        scene.textures.len(),
        scene.bounds()
    );
    println!("  {}", scene.summary.notes.join("\n  "));
    Some(scene)
}

#[test]
fn print() {
    let z = LoadOptions { up: Some(UpAxis::Z), unit_m: None };
    real("small_house/small_house.obj", z);
    real("apartment/home.obj", LoadOptions { up: None, unit_m: Some(0.01) });
    real("willowgarage/willowgarage.obj", z);
    real("medieval_building/Medieval_building.obj", LoadOptions::default());
    real("cornell_box/cornell_box.obj", LoadOptions::default());
    for i in 1..=4 {
        real(&format!("trees/tree_{i}/tree_{i}.obj"), LoadOptions::default());
    }
}
