//! Headboxes that are requested in bad places, and the same flags in the window; extensions in
//! help.

use crate::run::{headbox, json, succeeds};
use headbox_core::inputs::{HOMES, REPRESENTATIONS, SCENES, shown_extensions};
use std::path::Path;

const SMALL: [&str; 8] = [
    "--face-size",
    "16",
    "--strata",
    "3",
    "--rays",
    "2",
    "--light-samples",
    "1",
];

/// Captures the built-in room with more arguments; returns the exit code and the messages.
fn capture(dir: &Path, more: &[&str]) -> (Option<i32>, String) {
    let fixed = ["capture", "builtin:interior", "-o", "a.ldi"];
    let arguments = [&fixed, &SMALL[..], more].concat();
    let output = headbox(dir, &arguments);
    let messages = String::from_utf8(output.stderr).expect("UTF-8");
    (output.status.code(), messages)
}

/// Argument after a flag in a message.
fn argument_after<'t>(message: &'t str, flag: &str) -> &'t str {
    let (_, rest) = message.split_once(flag).expect(message);
    rest.split_whitespace().next().expect(message)
}

#[test]
fn bad_headbox_is_warned_about_with_one_to_paste() {
    let dir = tempfile::tempdir().unwrap();
    let (code, messages) = capture(dir.path(), &["--half-size", "2.5"]);
    assert_eq!(code, Some(0), "{messages}");
    let warning = "warning: surfaces reach into the headbox";
    assert_eq!(messages.matches(warning).count(), 1, "{messages}");
    let half_size = argument_after(&messages, "one that fits: --half-size ");
    let (_, messages) = capture(dir.path(), &["--half-size", half_size]);
    assert!(!messages.contains("warning: "), "{messages}");

    let (_, messages) = capture(dir.path(), &["--half-size", "0.001"]);
    assert!(messages.contains("much smaller"), "{messages}");

    let far = ["--center", "60,1.5,0", "--half-size", "0.3"];
    let (_, messages) = capture(dir.path(), &far);
    let place = argument_after(&messages, "the nearest good place: --center ");
    let near = ["--center", place, "--half-size", "0.3"];
    let (code, messages) = capture(dir.path(), &near);
    assert_eq!(code, Some(0), "{messages}");
    assert!(!messages.contains("hardly visible"), "{messages}");
}

#[test]
fn small_headbox_is_noted_unless_its_size_is_requested() {
    let dir = tempfile::tempdir().unwrap();
    let note = "note: surfaces near --center leave room for a half-size of only 0.15";
    let low = ["--center", "0.2,0.3,0.9"];
    let sized = [&low[..], &["--half-size", "0.1"]].concat();
    for (arguments, is_noted) in [(&low[..], true), (&sized, false), (&[], false)] {
        let (_, messages) = capture(dir.path(), arguments);
        assert_eq!(messages.contains(note), is_noted, "{messages}");
    }
}

#[test]
fn centre_in_metres_in_a_file_of_centimetres_is_recognised() {
    let dir = tempfile::tempdir().unwrap();
    let room = "v 0 0 0\nv 600 0 0\nv 600 0 400\nv 0 0 400\nv 0 300 0\nv 600 300 0\nv 600 300 400\nv 0 300 400\n\
                f 4 3 2 1\nf 5 6 7 8\nf 2 6 5 1\nf 3 7 6 2\nf 4 8 7 3\nf 1 5 8 4\n";
    std::fs::write(dir.path().join("room.obj"), room).unwrap();
    let fixed = ["capture", "room.obj", "-o", "a.ldi", "--unit", "cm"];
    let place = ["--half-size", "30", "--center", "3,1.6,2"];
    let output = headbox(dir.path(), &[&fixed, &SMALL[..], &place].concat());
    let messages = String::from_utf8(output.stderr).expect("UTF-8");
    let hint = "a unit of this file is 0.01 m: if 3,1.6,2 are metres, give --center 300,160,200";
    assert!(messages.contains(hint), "{messages}");
    let extent = |unit| {
        let info = json(dir.path(), &["info", "room.obj", "--unit", unit, "--json"]);
        info["headbox"]["half_size"].as_f64().unwrap()
    };
    assert!(
        extent("cm") > 10.0 && extent("in") > 5.0,
        "in units of the file"
    );
    let refused = headbox(dir.path(), &["info", "a.ldi", "--unit", "cm"]);
    assert_eq!(refused.status.code(), Some(2));
}

#[test]
fn headbox_of_scene_is_captured_without_warning() {
    let dir = tempfile::tempdir().unwrap();
    let (code, messages) = capture(dir.path(), &[]);
    assert_eq!(code, Some(0), "{messages}");
    assert!(!messages.contains("warning: "), "{messages}");
}

#[test]
fn scene_is_described_with_the_headbox_of_a_capture() {
    let dir = tempfile::tempdir().unwrap();
    let scene = json(dir.path(), &["info", "builtin:interior", "--json"]);
    let (code, messages) = capture(dir.path(), &[]);
    assert_eq!(code, Some(0), "{messages}");
    let captured = json(dir.path(), &["info", "a.ldi", "--json"]);
    for key in ["center", "half_size"] {
        assert_eq!(scene["headbox"][key], captured[key], "{key}");
    }
    for axis in 0..3 {
        let at = |place: &serde_json::Value| place[axis].as_f64().expect("a number");
        let [low, high] = [0, 1].map(|end| at(&scene["extent"][end]));
        let centre = at(&captured["center"]);
        assert!(low < centre && centre < high, "{scene}");
    }
    let home = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/corpus/Home.xml");
    let text = succeeds(dir.path(), &["info", home]);
    assert!(text.contains("listed by headbox house"), "{text}");
    let text = succeeds(dir.path(), &["info", "builtin:interior", "--check"]);
    assert!(text.contains("extent") && text.contains("\nok: "), "{text}");
}

#[test]
fn eye_far_from_the_scene_is_warned_about() {
    let dir = tempfile::tempdir().unwrap();
    for (eye, is_far) in [("0,160,0", true), ("0,1.6,0", false)] {
        let fixed = "truth builtin:interior -o t.png --size 8x6 --samples 1 --unlit --eye";
        let arguments: Vec<&str> = fixed.split(' ').chain([eye]).collect();
        let output = headbox(dir.path(), &arguments);
        let messages = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(0), "{messages}");
        let warning = "the eye is farther from the scene than the scene is large";
        assert_eq!(messages.contains(warning), is_far, "{messages}");
    }
}

#[cfg(feature = "viewer")]
#[test]
fn window_has_flags_of_capture_for_scenes_only() {
    let dir = tempfile::tempdir().unwrap();
    let help = headbox(dir.path(), &["view", "--help"]).stdout;
    let help = String::from_utf8(help).unwrap();
    for flag in [
        "--center",
        "--half-size",
        "--quality",
        "--exposure",
        "--tone",
    ] {
        assert!(help.contains(flag), "{flag}");
        let inputs: &[&str] = match flag {
            "--center" | "--half-size" | "--quality" => &["a.ldi", "Home.xml"],
            _ => continue,
        };
        let value = match flag {
            "--center" => "0,0,0",
            "--half-size" => "1",
            _ => "draft",
        };
        for input in inputs {
            let output = headbox(dir.path(), &["view", input, flag, value]);
            let message = String::from_utf8(output.stderr).expect("UTF-8");
            assert_eq!(output.status.code(), Some(2), "{input}: {message}");
            assert!(message.contains(flag), "{input}: {message}");
        }
    }
}

#[cfg(feature = "viewer")]
#[test]
fn help_names_every_extension_of_inputs() {
    let dir = tempfile::tempdir().unwrap();
    let scenes = [&SCENES[..], &HOMES[1..]].concat();
    let commands = [
        ("view", shown_extensions()),
        ("capture", scenes.clone()),
        ("truth", scenes.clone()),
        ("lumigraph", scenes),
        ("info", REPRESENTATIONS.to_vec()),
    ];
    for (command, extensions) in commands {
        let help = succeeds(dir.path(), &[command, "--help"]);
        for extension in extensions {
            let named = [format!(".{extension}"), format!("Home.{extension}")];
            assert!(
                named.iter().any(|name| help.contains(name)),
                "{command}: {extension}"
            );
        }
    }
}
