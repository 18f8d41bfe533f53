//! `headbox house -o`, `render` and `info` on a `.house` file, as a user runs them.

use crate::run;
use glam::DVec3;
use serde_json::{Value, json};
use std::path::Path;
use std::process::Output;

fn words(arguments: &str) -> Vec<&str> {
    arguments.split(' ').collect()
}

fn headbox(folder: &Path, arguments: &str) -> Output {
    run::headbox(folder, &words(arguments))
}

fn json(folder: &Path, arguments: &str) -> Value {
    run::json(folder, &words(arguments))
}

fn refused(folder: &Path, arguments: &str, code: i32, expected: &str) {
    run::fails(folder, code, &words(arguments), expected);
}

#[test]
fn a_house_is_written_described_and_walked() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let made = json(
        at,
        "house builtin:house --triangles 6000 --rays 0 -o a.house --edge 4 --light-samples 2 --backdrops texture --walk walk.json --poses 3 --json",
    );
    let portals = made["portals"].as_array().expect("a list").len() as u64;
    assert_eq!(made["file"]["captures"], 2 * portals);

    let vector = |point: &Value| {
        let numbers = point.as_array().expect("a point").iter();
        DVec3::from_slice(&numbers.filter_map(Value::as_f64).collect::<Vec<_>>())
    };
    // The rooms are convex: all of a room is on the side of the point beside its portal.
    for portal in made["portals"].as_array().expect("a list") {
        let centre = vector(&portal["centre"]);
        for side in 0..2 {
            let cell = portal["cells"][side].as_u64().expect("a cell");
            let room = &made["cells"][cell as usize];
            let step = vector(&portal["beside"][side]) - centre;
            assert!((step.length() - 0.5).abs() < 1e-6, "{portal}");
            assert!(
                room["outside"] == true || step.dot(vector(&room["point"]) - centre) > 0.0,
                "{portal} {room}"
            );
        }
    }

    let info = json(at, "info a.house --check --json");
    let rooms = info["rooms"].as_array().expect("rooms");
    assert!(rooms.iter().all(|room| {
        room["point"]
            .as_array()
            .is_some_and(|point| point.len() == 3)
    }));
    assert_eq!(
        rooms.len() as u64,
        info["cells"].as_u64().expect("a number") - 1,
        "all but outside"
    );
    assert_eq!(
        (&info["kind"], &info["ok"]),
        (&Value::from("house"), &Value::from(true))
    );
    assert_eq!(info["backdrops"][0]["captures"], 2 * portals);
    assert!(headbox(at, "info a.house --check").status.success());

    let walked = json(at, "render a.house --path walk.json -o frames --json");
    assert_eq!(
        (&walked["frames"], &walked["variant"]),
        (&Value::from(3), &Value::from("texture"))
    );
    assert!(at.join("frames/frame_0002.png").exists() && at.join("frames/times.csv").exists());
    // Backdrops that the file lacks are captured during the walk.
    let one = json(
        at,
        "render a.house -o one.png --size 64x48 --variant image --repeat 2 --json",
    );
    assert_eq!(
        (&one["variant"], one["ms"].as_array().map(Vec::len)),
        (&Value::from("image"), Some(2))
    );
    assert!(one["statistics"]["cell"].is_number() && one["stages"]["geometry_ms"].is_number());
    #[cfg(feature = "viewer")]
    run::overlays_are_painted(at, "a.house", &["holes", "backdrops"], &[]);
    let geometry = json(
        at,
        "render a.house -o two.png --size 64x48 --variant geometry --json",
    );
    assert_eq!(geometry["statistics"]["portals"], 0);

    // In the wall beside a door, and far outside.
    let corner = |i: usize| {
        let numbers = made["portals"][0]["polygon"][i]
            .as_array()
            .expect("a corner")
            .iter()
            .map(|v| v.as_f64());
        numbers.collect::<Option<Vec<f64>>>().expect("numbers")
    };
    let (left, right) = (corner(0), corner(1));
    let beside = |i: usize| right[i] + (right[i] - left[i]) * 0.1;
    let eye = format!("--eye {:.3},1.2,{:.3}", beside(0), beside(2));
    let poses = [500.0, beside(0), beside(0), 500.0]
        .map(|x| json!({"eye": [x, 1.2, beside(2)], "look_at": [x, 1.2, 0]}));
    std::fs::write(at.join("wall.json"), json!(poses).to_string()).expect("written");
    let says = |cameras: &str| {
        let output = headbox(at, &format!("render a.house --size 64x48 {cameras}"));
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(
        says(&format!("-o wall.png {eye}"))
            .contains("the eye is in no cell (inside a wall?); all cells are drawn as geometry"),
        "{eye}"
    );
    assert!(
        !says("-o wall.png --eye 500,2,500").contains("in no cell"),
        "that is in the outside cell"
    );
    let path = says("-o wall-frames --path wall.json");
    assert!(
        path.contains("drawn as geometry (frames 1 to 2 of 0 to 3)"),
        "{path}"
    );

    refused(
        at,
        "render a.house -o x.png --variant holograms",
        2,
        "window-ldi",
    );
    refused(
        at,
        "render a.house a.house -o x.png",
        2,
        "without other files",
    );
    refused(
        at,
        "house builtin:house --rays 0 --triangles 6000 -o b.house --backdrops mirrors",
        2,
        "there are: texture",
    );
    refused(
        at,
        "house builtin:house --rays 0 --triangles 6000 --edge 0 -o b.house",
        2,
        "--edge 0",
    );
    refused(
        at,
        "house builtin:house --rays 0 --triangles 6000 --poses 0 --walk w.json",
        2,
        "poses",
    );
    let report = json(
        at,
        "walk a.house -o measured --poses 2 --size 64x48 --truth-every 1 --pictures 1 --repeat 1 --variants texture,image --json",
    );
    let rows = report["rows"].as_array().expect("a list");
    assert_eq!(
        (rows.len(), &rows[0]["name"], &rows[2]["name"]),
        (3, &"geometry".into(), &"image".into())
    );
    assert!(
        rows.iter()
            .all(|row| row["frame_ms"]["median"].as_f64() > Some(0.0)),
        "{report}"
    );
    assert!(
        report["exposure"].as_array().map(Vec::len) == Some(1) && report["poses"] == 2,
        "{report}"
    );
    let page = std::fs::read_to_string(at.join("measured/walk.md")).expect("a page");
    assert!(page.contains("| image |"), "{page}");
    let chart = std::fs::read_to_string(at.join("measured/along_path.svg")).expect("a chart");
    assert!(
        chart.contains(">geometry</text>") && chart.contains(">primary rays</text>"),
        "{chart}"
    );
    let sheet = std::fs::read_to_string(at.join("measured/frames.html")).expect("a contact sheet");
    for name in ["truth", "geometry", "texture", "image"] {
        let file = format!("frames/pose_000_{name}.png");
        assert!(
            sheet.contains(&file) && at.join("measured").join(&file).exists(),
            "{file}: {sheet}"
        );
    }
    refused(
        at,
        "walk a.house -o measured --variants mirrors",
        2,
        "there are: geometry",
    );

    let mut bytes = std::fs::read(at.join("a.house")).expect("bytes");
    bytes.truncate(bytes.len() / 2);
    std::fs::write(at.join("a.house"), bytes).expect("written");
    refused(at, "info a.house", 1, "a.house");
}
