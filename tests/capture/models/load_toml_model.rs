//! TOML portal models that refer to groups of an OBJ or nodes of a glTF.

use super::homes::{Obj, cells, error_of, folder, load};
use headbox_model::load::LoadedModel;
use headbox_model::{Finding, Severity};
use tempfile::TempDir;

/// The two rooms as a TOML model, Z up and in centimetres.
const TOML: &str = r#"
name = "flat"
up = "z"
unit = 0.01
scene = "flat.obj"

[[cell]]
name = "left"
groups = ["left_*"]
[[cell.prism]]
outline = [[0, 0], [400, 0], [400, 300], [0, 300]]
floor = 0
ceiling = 250

[[cell]]
name = "right"
groups = ["right wall", "right_floor"]
[[cell.prism]]
outline = [[400, 0], [800, 0], [800, 300], [400, 300]]
floor = 0
ceiling = 250

[[portal]]
name = "door"
cells = ["left", "right"]
polygon = [[400, 100, 200], [400, 200, 200], [400, 200, 0], [400, 100, 0]]
"#;

fn toml_folder(text: &str) -> TempDir {
    let mut obj = Obj::default();
    for (side, x) in [("left", 0.0), ("right", 400.0)] {
        obj.group(&format!("{side}_floor")).quad([
            [x, 0.0, 0.0],
            [x + 400.0, 0.0, 0.0],
            [x + 400.0, 300.0, 0.0],
            [x, 300.0, 0.0],
        ]);
    }
    obj.group("right wall").quad([
        [800.0, 0.0, 0.0],
        [800.0, 300.0, 0.0],
        [800.0, 300.0, 250.0],
        [800.0, 0.0, 250.0],
    ]);
    obj.group("tree").quad([
        [2000.0, 0.0, 0.0],
        [2000.0, 30.0, 0.0],
        [2000.0, 30.0, 300.0],
        [2000.0, 0.0, 300.0],
    ]);
    folder(&[("flat.toml", text), ("flat.obj", &obj.text)])
}

#[test]
fn toml_model_refers_to_groups() {
    let LoadedModel { model, findings } = load(&toml_folder(TOML), "flat.toml");
    assert_eq!(model.scene.name, "flat");
    assert_eq!(cells(&model), [("left", 2), ("right", 4), ("Outside", 2)]);
    assert_eq!(
        model.cell_at(glam::DVec3::new(1.0, 1.0, -1.0)),
        Some(0),
        "Z up: y of the file is -z of the world"
    );
    // The room has a floor and a single wall.
    assert!(
        findings.iter().all(|f| matches!(f, Finding::NoWall { .. })),
        "{findings:?}"
    );
    assert_eq!(findings.len(), 5);
    let said: Vec<String> = findings
        .into_iter()
        .map(|f| f.in_file(&model.scene.frame).to_string())
        .collect();
    assert!(
        said.iter()
            .any(|said| said.contains("about 0.00, 150.00, 125.00 (in the file's axes")),
        "{said:?}"
    );
    assert!((model.portals[0].polygon[1] - glam::DVec3::new(4.0, 2.0, -2.0)).length() < 1e-12);
}

/// A triangle in each of two nodes.
const GLTF: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]}],
    "nodes":[{"name":"left floor","mesh":0},{"name":"right floor","mesh":0,"translation":[4,0,0]}],
    "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
    "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,-1],"max":[1,0,0]}],
    "bufferViews":[{"buffer":0,"byteLength":36}],
    "buffers":[{"byteLength":36,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAAAAAAAAAAAAAIC/AACAPwAAAAAAAAAA"}]}"#;

#[test]
fn toml_model_refers_to_gltf_nodes() {
    let text = r#"
        scene = "flat.gltf"
        cell = [{ name = "left", groups = ["left*"] }, { name = "right", groups = ["right floor"] }]
    "#;
    let LoadedModel { model, findings } = load(
        &folder(&[("flat.toml", text), ("flat.gltf", GLTF)]),
        "flat.toml",
    );
    assert_eq!(cells(&model), [("left", 1), ("right", 1), ("Outside", 0)]);
    let right = model.scene.corners(model.cells[1].triangles.start);
    assert!(right.iter().all(|p| p.x >= 4.0), "{right:?}");
    assert!(findings.contains(&Finding::NoPortals), "{findings:?}");
    assert!(
        findings.contains(&Finding::NoSpace {
            cell: 0,
            name: "left".into()
        }),
        "{findings:?}"
    );
}

#[test]
fn mistakes_in_a_toml_model_are_named() {
    let error = |from: &str, to: &str| error_of(&toml_folder(&TOML.replace(from, to)), "flat.toml");
    assert!(error("unit = 0.01", "unit = -1").contains("the unit is -1 m"));
    assert!(error("unit = 0.01", "units = 1").contains("unknown field `units`"));
    assert!(error("flat.obj", "none.obj").contains("No such file"));
    assert!(error("[[cell]]", "[[cell").contains("flat.toml"));
    assert!(error("name = \"right\"", "name = \"left\"").contains("two cells are called \"left\""));
    let model = load(
        &toml_folder(&TOML.replace(
            "cells = [\"left\", \"right\"]",
            "cells = [\"left\", \"attic\"]",
        )),
        "flat.toml",
    );
    assert!(
        model
            .findings
            .iter()
            .any(|f| matches!(f, Finding::MissingCell { .. }) && f.severity() == Severity::Error)
    );
    assert!(
        model
            .model
            .portals
            .iter()
            .all(|portal| portal.name != "door")
    );
    let notes = model.model.scene.summary.notes.join("\n");
    assert!(
        notes.contains("portal \"door\" leads to an unknown cell \"attic\""),
        "{notes}"
    );
    let unmatched = load(
        &toml_folder(&TOML.replace("right wall", "wrong wall")),
        "flat.toml",
    );
    assert!(
        unmatched
            .model
            .scene
            .summary
            .notes
            .iter()
            .any(|n| n.contains("\"wrong wall\""))
    );
}
