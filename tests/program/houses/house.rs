//! `headbox house`, plans, and baked light against truth.

use crate::run::{headbox, refused, succeeds};
use glam::dvec3;
use headbox_core::camera::Camera;
use headbox_core::metrics;
use headbox_core::progress::Silent;
use headbox_model::bake::{BakeOptions, bake};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

#[test]
fn the_built_in_house_is_sound() {
    let dir = tempfile::tempdir().unwrap();
    let arguments = [
        "house",
        "builtin:house",
        "--triangles",
        "20000",
        "--rays",
        "60",
        "--json",
        "--plan",
        "plan.svg",
    ];
    let output = headbox(dir.path(), &arguments);
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["cells"].as_array().unwrap().len(), 19);
    assert_eq!(json["portals"].as_array().unwrap().len(), 52);
    for empty in ["unreachable", "touching_no_cell", "findings", "notes"] {
        assert_eq!(json[empty].as_array().unwrap().len(), 0, "{empty}");
    }
    assert!(json["triangles"].as_u64().unwrap() <= 20_000);
    let svg = std::fs::read_to_string(dir.path().join("plan.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"));
    assert!((0..52).all(|portal| svg.contains(&format!(">{portal}</text>"))));
    assert!(
        ["Living room", "Kitchen", "Workshop"]
            .iter()
            .all(|room| svg.contains(room))
    );
}

#[test]
fn house_text_names_everything_and_plan_has_doors_and_windows() {
    let dir = tempfile::tempdir().unwrap();
    let output = headbox(
        dir.path(),
        &[
            "house",
            "builtin:house",
            "--triangles",
            "0",
            "--rays",
            "0",
            "--plan",
            "plan.svg",
        ],
    );
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with("19 cells, 52 portals"), "{text}");
    assert!(
        text.contains("unreachable cells: none")
            && text.contains("portals that touch no cell: none")
    );
    let plan = std::fs::read_to_string(dir.path().join("plan.svg")).unwrap();
    assert!(
        plan.contains("width='1600'") && plan.contains("#c8281e") && plan.contains("#145ac8"),
        "doors, windows"
    );
}

/// A bake of an hour, interrupted after a few seconds: between its first round and its end even on
/// a slow machine.
#[test]
#[cfg(unix)]
fn interrupted_bake_keeps_result() {
    let dir = tempfile::tempdir().unwrap();
    let arguments = [
        "house",
        "builtin:house",
        "--triangles",
        "4000",
        "--rays",
        "0",
        "--light-samples",
        "4096",
    ];
    for pause_s in [3, 12, 48, 192] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_headbox"))
            .args(arguments.iter().chain(&["--edge", "0.5", "-o", "h.house"]))
            .current_dir(dir.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_secs(pause_s));
        assert!(
            child.try_wait().unwrap().is_none(),
            "an hour's work does not end in {pause_s} s"
        );
        Command::new("kill")
            .args(["-INT", &child.id().to_string()])
            .status()
            .unwrap();
        let output = child.wait_with_output().unwrap();
        let [said, problems] =
            [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
        assert_eq!(output.status.code(), Some(130), "{problems}");
        if problems.contains("nothing to keep") {
            assert!(!dir.path().join("h.house").exists());
            continue;
        }
        assert!(
            said.contains("each vertex has at least 8 of 4096 samples"),
            "{said}"
        );
        assert!(said.contains("0 of 104 captures are in it"), "{said}");
        assert!(succeeds(dir.path(), &["info", "h.house", "--check"]).contains("every promise"));
        return;
    }
    panic!("no first round in three minutes");
}

/// Two rooms one above the other, each with a window, and a hatch between them, as a TOML model.
const STOREYS: &str = r#"
scene = "hut.obj"
[[cell]]
name = "below"
[[cell.prism]]
outline = [[0, 0], [4, 0], [4, 3], [0, 3]]
floor = 0
ceiling = 2.6
[[cell]]
name = "above"
[[cell.prism]]
outline = [[0, 0], [4, 0], [4, 3], [0, 3]]
floor = 2.6
ceiling = 5
[[cell]]
name = "garden"
outside = true
[[portal]]
name = "hatch"
cells = ["below", "above"]
polygon = [[1, 2.6, 1], [2, 2.6, 1], [2, 2.6, 2], [1, 2.6, 2]]
[[portal]]
name = "lower window"
cells = ["below", "garden"]
polygon = [[1, 1, 0], [2, 1, 0], [2, 2, 0], [1, 2, 0]]
[[portal]]
name = "upper window"
cells = ["above", "garden"]
polygon = [[1, 3.6, 3], [2, 3.6, 3], [2, 4.6, 3], [1, 4.6, 3]]
"#;

/// Geometry of [`STOREYS`]: a box with a floor between its storeys.
const HUT: &str = "v 0 0 0\nv 4 0 0\nv 4 0 3\nv 0 0 3\nv 0 2.6 0\nv 4 2.6 0\nv 4 2.6 3\nv 0 2.6 3\n\
                   v 0 5 0\nv 4 5 0\nv 4 5 3\nv 0 5 3\n\
                   f 1 2 3 4\nf 5 6 7 8\nf 9 10 11 12\nf 1 2 10 9\nf 2 3 11 10\nf 3 4 12 11\nf 4 1 9 12\n";

#[test]
fn each_storey_has_a_plan() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("hut.toml"), STOREYS).unwrap();
    std::fs::write(dir.path().join("hut.obj"), HUT).unwrap();
    let output = headbox(
        dir.path(),
        &[
            "house", "hut.toml", "--rays", "0", "--json", "--plan", "plan.svg",
        ],
    );
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["plans"], serde_json::json!(["plan.svg", "plan_2.svg"]));
    let plans = ["plan.svg", "plan_2.svg"]
        .map(|name| std::fs::read_to_string(dir.path().join(name)).unwrap());
    for (plan, shown) in plans.iter().zip([["below", "0", "1"], ["above", "0", "2"]]) {
        for name in ["below", "above", "0", "1", "2"] {
            assert_eq!(
                plan.contains(&format!(">{name}</text>")),
                shown.contains(&name),
                "{name} in {plan}"
            );
        }
    }
}

#[test]
fn model_defects_and_repairs_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("hut.obj"), HUT).unwrap();
    let says = |name: &str, model: &str| {
        std::fs::write(dir.path().join("hut.toml"), model).unwrap();
        let output = headbox(dir.path(), &["house", "hut.toml", "--rays", "100"]);
        assert!(
            output.status.success(),
            "{name}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        [output.stdout, output.stderr]
            .map(|text| String::from_utf8(text).unwrap())
            .concat()
    };
    let changes = [
        (
            "[2, 2.6, 1]",
            "[2, 2.9, 1]",
            "portal 2 (hatch) is not planar: a corner lies 0.0",
        ),
        (
            "[2, 2.6, 1], [2, 2.6, 2]",
            "[2, 2.6, 2], [2, 2.6, 1]",
            "portal 2 (hatch) crosses itself; it is left out",
        ),
        (
            "[2, 2.6, 2]",
            "[1.1, 2.6, 1.1]",
            "portal 2 (hatch) is not convex; it is left out",
        ),
        (
            "\"below\", \"above\"",
            "\"below\", \"attic\"",
            "leads to an unknown cell \"attic\"",
        ),
        (
            "\"below\", \"above\"",
            "\"below\", \"below\"",
            "has below on both of its sides; it is left out",
        ),
    ];
    for (from, to, sentence) in changes {
        assert!(STOREYS.contains(from));
        let said = says(to, &STOREYS.replacen(from, to, 1));
        assert!(said.contains(sentence), "{to}: {said}");
    }
    let doorless = &STOREYS[..STOREYS.find("[[portal]]").unwrap()];
    let said = says("no doors", doorless);
    assert!(
        said.contains(
            "there is no portal, so no cell is seen from another; each is shown by itself"
        ),
        "{said}"
    );
    let said = says("no cells", "scene = \"hut.obj\"\n");
    assert!(
        said.contains("there is no cell besides the outside; all geometry is shown as one cell"),
        "{said}"
    );
    let walk = headbox(
        dir.path(),
        &[
            "house",
            "hut.toml",
            "--rays",
            "0",
            "--backdrops",
            "none",
            "-o",
            "hut.house",
        ],
    );
    assert!(
        walk.status.success(),
        "{}",
        String::from_utf8_lossy(&walk.stderr)
    );
    let said = refused(dir.path(), 1, &["walk", "hut.house", "-o", "out"]);
    assert!(said.contains("there is no room to walk in"), "{said}");
}

#[test]
fn mistakes_are_named() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("Home.xml"), "<home><room>").unwrap();
    let says = |code: i32, arguments: &[&str], expected: &str| {
        let said = refused(dir.path(), code, &[&["house"], arguments].concat());
        assert!(said.contains(expected), "{arguments:?}: {said}");
    };
    says(2, &["builtin:castle"], "there is builtin:house");
    says(
        2,
        &["builtin:house", "--plan", "plan.jpg"],
        "the ending of a plan is .svg",
    );
    says(
        2,
        &["builtin:house", "--tone", "hdr"],
        "give --tone neutral or linear",
    );
    says(
        2,
        &["builtin:house", "--unlit", "--exposure", "1"],
        "--exposure is for baked light",
    );
    says(
        2,
        &["builtin:house", "--unlit", "--bounces", "2"],
        "--bounces is for baked light",
    );
    says(1, &["nowhere.toml"], "nowhere.toml: No such file");
    says(1, &["other/plan.obj"], "unknown home format");
    says(1, &["Home.xml"], "Home.xml: ");
    let model = "scene = \"home.obj\"\n[[cell]]\nname = \"hall\"\n";
    std::fs::write(dir.path().join("spaceless.toml"), model).unwrap();
    std::fs::write(
        dir.path().join("home.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n",
    )
    .unwrap();
    says(
        1,
        &["spaceless.toml", "--unlit", "-o", "spaceless.house"],
        "no room has space; a .toml model gives it",
    );
    std::fs::write(dir.path().join("home.obj"), "").unwrap();
    says(
        1,
        &["home.obj"],
        "home.obj: not a home; use Home.xml, which lies beside it",
    );
}

/// An unlit frame of baked light equals lit truth, except for shadows finer than the vertices.
#[test]
fn baked_light_looks_like_truth() {
    /// Between vertices 6 cm apart light is interpolated; edges of shadows are softer by that. At
    /// 40 pixels a metre this scene loses less than 26 dB; a bake without shadows, or with the
    /// wrong exposure, is below 18.
    const LEAST_PSNR_DB: f64 = 26.0;
    let source = Arc::new(headbox_scenes::build("bump", 1).unwrap());
    let eye = source.headbox.unwrap().centre;
    let camera = Camera::look_at(
        eye,
        eye + dvec3(0.1, -0.2, -1.0),
        glam::DVec3::Y,
        60.0,
        [120, 90],
    )
    .unwrap();
    let tracer = Tracer::new(Arc::clone(&source), eye);
    let lit = truth::render(
        &tracer,
        &Lighting::measure(&tracer, BakeOptions::default().bounces),
        true,
        &camera,
        64,
        &Silent,
    )
    .rgb();

    let options = BakeOptions {
        edge_m: 0.06,
        samples: 16,
        smoothing: 2,
        max_triangles: 300_000,
        ..BakeOptions::default()
    };
    let baked = Arc::new(bake(&source, &options, &|_, _| ControlFlow::Continue(())).scene);
    let tracer = Tracer::new(baked, eye);
    let unlit = truth::render(
        &tracer,
        &Lighting::unmetered(&tracer, 0),
        false,
        &camera,
        16,
        &Silent,
    )
    .rgb();
    let (comparison, _) = metrics::compare_with_map(&lit, &unlit).unwrap();
    if let Some(folder) = std::env::var_os("HEADBOX_KEEP") {
        lit.save(Path::new(&folder).join("lit.png")).unwrap();
        unlit.save(Path::new(&folder).join("baked.png")).unwrap();
    }
    assert!(
        comparison.psnr_db > LEAST_PSNR_DB,
        "{:.1} dB",
        comparison.psnr_db
    );
}
