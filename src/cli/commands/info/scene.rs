//! `headbox info` of a scene.

use crate::commands::capture::place::place_headbox;
use crate::messages::format_count;
use crate::output::{print_json, print_notes};
use headbox_core::file_frame::{figure, triple};
use headbox_core::headbox::Headbox;
use headbox_core::inputs::{HOMES, SCENES};
use headbox_ldi::scene_source::SceneSource;
use headbox_scene::scene::Scene;
use serde_json::json;
use std::path::Path;
use std::sync::Arc;

/// Returns true if an input is a scene: `builtin:NAME` or a file with an extension of scenes or
/// homes.
pub(super) fn is_scene(name: &str) -> bool {
    name.starts_with("builtin:") || has_extension(name, &SCENES) || has_extension(name, &HOMES)
}

fn has_extension(name: &str, extensions: &[&str]) -> bool {
    let extension = Path::new(name).extension().unwrap_or_default();
    extensions.contains(&extension.to_string_lossy().to_lowercase().as_str())
}

/// Describes a scene: size, extent and lights, and where a capture would put the headbox.
pub(super) fn describe(
    source: &SceneSource,
    is_checked: bool,
    is_json: bool,
) -> anyhow::Result<()> {
    let name = source.name.as_str();
    let scene = Arc::new(source.open()?);
    print_notes(&scene.summary.notes);
    if is_checked {
        scene.validate()?;
    }
    // A scene that is too small or too large for a headbox is described nevertheless.
    let headbox = place_headbox(&scene, None, None);
    if is_json {
        print_json(&as_json(name, &scene, headbox.as_ref().ok()));
        return Ok(());
    }
    let frame = scene.frame;
    let [low, high] = extent(&scene);
    let count = |number: usize, thing| format_count(number as u64, thing);
    println!("{name}: scene");
    println!(
        "  triangles   {}, in {} with {}",
        scene.triangles.len(),
        count(scene.materials.len(), "material"),
        count(scene.textures.len(), "texture")
    );
    println!(
        "  world       1 file unit = {} m, {} up in the file",
        frame.unit_m, frame.up
    );
    println!(
        "  extent      from {} to {} (in the file's axes and unit)",
        triple(low),
        triple(high)
    );
    println!("  lights      {}", lights(&scene));
    match headbox {
        Ok(Headbox {
            centre,
            half_size_m,
        }) => println!(
            "  headbox     centre {}, half-size {}: the default of a capture",
            triple(frame.file_from_world(centre)),
            figure(half_size_m / frame.unit_m)
        ),
        Err(error) => println!("  headbox     {error}"),
    }
    if has_extension(name, &HOMES) {
        println!("  rooms       listed by headbox house {name}");
    }
    if is_checked {
        println!("ok: every promise of the layout holds");
    }
    Ok(())
}

fn as_json(name: &str, scene: &Scene, headbox: Option<&Headbox>) -> serde_json::Value {
    let frame = scene.frame;
    let headbox = headbox.map(|headbox| {
        json!({
            "center": frame.file_from_world(headbox.centre),
            "half_size": headbox.half_size_m / frame.unit_m,
        })
    });
    json!({
        "kind": "scene", "scene": name, "triangles": scene.triangles.len(),
        "materials": scene.materials.len(), "textures": scene.textures.len(),
        "unit_m": frame.unit_m, "z_up": bool::from(frame.up), "extent": extent(scene),
        "sun": scene.sun.is_some(), "sky": scene.sky.is_some(), "lamps": scene.lamps.len(),
        "emissive_triangles": emissive_triangles(scene), "headbox": headbox,
        "notes": scene.summary.notes, "ok": true,
    })
}

/// Corners of the bounding box, in the file's axes and unit.
fn extent(scene: &Scene) -> [glam::DVec3; 2] {
    let [a, b] = scene
        .bounds()
        .map(|corner| scene.frame.file_from_world(corner));
    [a.min(b), a.max(b)]
}

fn lights(scene: &Scene) -> String {
    let named = [("sun", scene.sun.is_some()), ("sky", scene.sky.is_some())];
    let named = named.iter().filter(|(_, is_there)| *is_there);
    let counted = [
        (scene.lamps.len(), "lamp"),
        (emissive_triangles(scene), "emissive triangle"),
    ];
    let counted = counted.iter().filter(|(count, _)| *count > 0);
    let all: Vec<String> = named
        .map(|(name, _)| (*name).to_owned())
        .chain(counted.map(|&(count, thing)| format_count(count as u64, thing)))
        .collect();
    if all.is_empty() {
        "none".into()
    } else {
        all.join(", ")
    }
}

fn emissive_triangles(scene: &Scene) -> usize {
    let emits = |material: u32| scene.materials[material as usize].emission != [0.0; 3];
    let triangles = scene.triangles.iter();
    triangles
        .filter(|triangle| emits(triangle.material))
        .count()
}
