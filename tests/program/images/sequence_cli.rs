//! Promises of the command line about sprites of a sequence of photographs (S10).

use crate::run::{fails, json, outputs, succeeds};
use image::{GrayImage, Luma};

#[test]
fn a_folder_of_photographs_becomes_sprites() {
    let dir = tempfile::tempdir().unwrap();
    let size = ["--size", "120x90", "--samples", "2", "--unlit"];
    let truth = ["truth", "builtin:castle", "--images", "4x1", "-o", "set"];
    succeeds(dir.path(), &[truth.as_slice(), &size].concat());
    let sprite = |more: &[&str]| {
        let arguments = [
            "sprite",
            "set",
            "-o",
            "a.sprite",
            "--own-depth",
            "--no-registration",
        ];
        [arguments.as_slice(), more]
            .concat()
            .into_iter()
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    let run = |more: &[&str]| {
        let arguments = sprite(more);
        succeeds(
            dir.path(),
            &arguments.iter().map(String::as_str).collect::<Vec<_>>(),
        )
    };
    let refused = |code: i32, more: &[&str], expected: &str| {
        let arguments = sprite(more);
        fails(
            dir.path(),
            code,
            &arguments.iter().map(String::as_str).collect::<Vec<_>>(),
            expected,
        );
    };
    assert!(run(&["--layers", "4"]).contains("sprites with depth"));
    let info = json(dir.path(), &["info", "a.sprite", "--json"]);
    assert_eq!(
        (info["kind"].as_str(), info["ok"].as_bool()),
        (Some("sprite"), Some(true))
    );
    let count = info["sprites"].as_array().unwrap().len();
    assert!((2..=4).contains(&count), "{count}");
    let first = std::fs::read(dir.path().join("a.sprite")).unwrap();
    run(&["--layers", "4", "--view", "3"]);
    assert_eq!(
        first,
        std::fs::read(dir.path().join("a.sprite")).unwrap(),
        "the third of four is in the middle"
    );
    let told = succeeds(dir.path(), &["info", "a.sprite"]);
    assert!(told.contains("  camera      at "), "{told}");
    // Sprites have no headbox, whose borders could be named.
    let away = ["render", "a.sprite", "-o", "away.png", "--eye", "0,500,0"];
    let (_, warned) = outputs(dir.path(), &away);
    assert!(
        warned.contains("% of this frame shows nothing") && warned.contains("is --eye "),
        "{warned}"
    );
    for variant in ["homography", "two-pass"] {
        let frame = json(
            dir.path(),
            &[
                "render",
                "a.sprite",
                "-o",
                "r.png",
                "--variant",
                variant,
                "--json",
            ],
        );
        assert!(frame["hole_fraction"].as_f64().unwrap() < 0.2, "{frame}");
    }

    std::fs::create_dir(dir.path().join("masks")).unwrap();
    refused(1, &["--masks", "masks"], "no PNG files");
    let half = GrayImage::from_fn(120, 90, |x, _| Luma([if x < 60 { 255 } else { 0 }]));
    half.save(dir.path().join("masks/left.png")).unwrap();
    assert!(run(&["--masks", "masks"]).contains("1 sprite with depth"));
    GrayImage::new(9, 9)
        .save(dir.path().join("masks/small.png"))
        .unwrap();
    refused(1, &["--masks", "masks"], "is 9x9 pixels");
    refused(1, &["--masks", "nowhere"], "nowhere");
    refused(1, &["--view", "5"], "choose one of the 4 views");
    refused(2, &["--eye", "0,0,0"], "--eye has no meaning for images");
    for flag in ["--slabs", "--samples", "--bounces"] {
        refused(2, &[flag, "2"], &format!("{flag} is for sprites of scenes"));
    }
    fails(
        dir.path(),
        2,
        &["sprite", "builtin:bump", "-o", "b.sprite", "--layers", "2"],
        "--layers is for folders",
    );

    let judged = run(&["--range", "range"]);
    assert!(
        judged.contains("layers-with-depth") && judged.contains("median error"),
        "{judged}"
    );
    let report = std::fs::read(dir.path().join("range/report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    let psnr = |variant: &str| {
        let rows = report["rows"]
            .as_array()
            .unwrap()
            .iter()
            .filter(|row| row["variant"] == variant);
        rows.map(|row| row["psnr_db"].as_f64().unwrap())
            .fold(f64::INFINITY, f64::min)
    };
    assert!(
        psnr("layers-with-depth") > psnr("plane") + 2.0,
        "{} {}",
        psnr("layers-with-depth"),
        psnr("plane")
    );
}
