//! User-specified light on the command line: `--sky`, `--sun`, `--exposure`.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use crate::run::{json, refused, succeeds};
use headbox_core::color::tone::ToneMap;
use std::path::Path;

/// Small and lit.
const CAPTURE: [&str; 10] = [
    "capture",
    "builtin:miniature",
    "--face-size",
    "32",
    "--strata",
    "4",
    "--rays",
    "4",
    "--light-samples",
    "2",
];

/// A sky of 8 x 4 texels: red in the east half, blue in the west, with a green texel in the
/// zenith's row.
fn write_sky(folder: &Path) {
    let mut file = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n".to_vec();
    for at in 0..32 {
        file.extend(match at % 8 {
            1 if at < 8 => [8, 200, 8, 129],
            0..4 => [8, 8, 128, 129],
            _ => [128, 8, 8, 129],
        });
    }
    std::fs::write(folder.join("sky.hdr"), file).unwrap();
}

fn capture(folder: &Path, more: &[&str]) -> String {
    succeeds(folder, &[CAPTURE.as_slice(), more].concat())
}

#[test]
fn shards_must_agree_on_light_and_file_records_it() {
    let dir = tempfile::tempdir().unwrap();
    write_sky(dir.path());
    let light = [
        "--sky",
        "sky.hdr",
        "--sky-turn",
        "30",
        "--sky-strength",
        "2",
        "--sun",
        "100,40",
        "--sun-strength",
        "2",
        "--exposure",
        "-1.5",
    ];
    capture(
        dir.path(),
        &[light.as_slice(), &["-o", "whole.ldi"]].concat(),
    );
    for part in ["1/2", "2/2"] {
        capture(
            dir.path(),
            &[
                light.as_slice(),
                &["--shard", part, "-o", &format!("{}.shard", &part[..1])],
            ]
            .concat(),
        );
    }
    succeeds(
        dir.path(),
        &["merge", "1.shard", "2.shard", "-o", "merged.ldi"],
    );
    let read = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    assert!(read("whole.ldi") == read("merged.ldi"));
    let info = &json(dir.path(), &["info", "whole.ldi", "--json"])["capture"];
    assert_eq!(
        (info["light"]["sky"].as_str(), info["light"]["sun"].as_str()),
        (Some("sky.hdr"), Some("100,40"))
    );
    assert_eq!(
        (info["tone"].as_str(), info["exposure"].as_f64()),
        (Some("neutral"), Some(f64::from(0.5f32.powf(1.5))))
    );
    let told = succeeds(dir.path(), &["info", "whole.ldi"]);
    assert!(
        told.contains(
            "sky sky.hdr, turned by 30 degrees, sky's strength 2, sun 100,40, sun's strength 2"
        ),
        "{told}"
    );
    assert!(
        told.contains("-1.50 stops (-1.5); sRGB, highlights compressed"),
        "{told}"
    );
    // A shard in another light belongs to another capture.
    capture(dir.path(), &["--shard", "2/2", "-o", "other.shard"]);
    let message = refused(
        dir.path(),
        1,
        &["merge", "1.shard", "other.shard", "-o", "merged.ldi"],
    );
    assert!(message.contains("parts of different captures"), "{message}");
    // Lighting after the merge needs the sky again; a missing sky is named.
    std::fs::rename(dir.path().join("sky.hdr"), dir.path().join("moved.hdr")).unwrap();
    let merge = ["merge", "1.shard", "2.shard", "-o", "merged.ldi"];
    let message = refused(dir.path(), 1, &merge);
    assert!(
        message.contains("sky.hdr") && message.contains("--sky"),
        "{message}"
    );
    succeeds(
        dir.path(),
        &[merge.as_slice(), &["--sky", "moved.hdr"]].concat(),
    );
    let info = &json(dir.path(), &["info", "merged.ldi", "--json"])["capture"];
    assert_eq!(info["light"]["sky"].as_str(), Some("moved.hdr"));
    capture(dir.path(), &["--shard", "1/1", "-o", "only.shard"]);
    let message = refused(
        dir.path(),
        2,
        &[
            "merge",
            "only.shard",
            "-o",
            "merged.ldi",
            "--sky",
            "moved.hdr",
        ],
    );
    assert!(message.contains("without one"), "{message}");
}

#[test]
fn hdr_tone_curve_keeps_light_above_white() {
    let dir = tempfile::tempdir().unwrap();
    write_sky(dir.path());
    // The sky's east is as bright as white: at three stops eight times.
    let light = ["--sky", "sky.hdr", "--exposure", "3"];
    capture(
        dir.path(),
        &[light.as_slice(), &["-o", "clipped.ldi", "--tone", "linear"]].concat(),
    );
    capture(
        dir.path(),
        &[light.as_slice(), &["-o", "kept.ldi", "--tone", "hdr"]].concat(),
    );
    let eastward = [
        "--look-at",
        "100,50,0",
        "--eye",
        "0,30,0",
        "--size",
        "32x24",
    ];
    let run = |arguments: &[&[&str]]| succeeds(dir.path(), &arguments.concat());
    run(&[
        &[
            "truth",
            "builtin:miniature",
            "-o",
            "truth.exr",
            "--samples",
            "4",
        ],
        &light,
        &eastward,
    ]);
    for name in ["kept", "clipped"] {
        run(&[
            &[
                "render",
                &format!("{name}.ldi"),
                "-o",
                &format!("{name}.exr"),
            ],
            &eastward,
        ]);
    }
    let radiance = |name: &str| {
        let picture = exr::prelude::read_first_rgba_layer_from_file(
            dir.path().join(name),
            |size, _| {
                (
                    size.width(),
                    vec![[0.0f32; 3]; size.width() * size.height()],
                )
            },
            |(width, pixels): &mut (usize, Vec<[f32; 3]>),
             at,
             (r, g, b, _): (f32, f32, f32, f32)| {
                pixels[at.y() * *width + at.x()] = [r, g, b];
            },
        );
        picture.unwrap().layer_data.channel_data.pixels.1
    };
    let red = |name: &str| radiance(name)[12 * 32 + 16][0];
    let truth = red("truth.exr");
    assert!((truth - 1.0).abs() < 0.05, "{truth}");
    // A step is 6.2 % at eight times white, and rounding loses at most half of it.
    assert!(
        (red("kept.exr") / truth - 1.0).abs() < 0.032,
        "{} for {truth}",
        red("kept.exr")
    );
    assert!(
        (red("clipped.exr") - 0.125).abs() < 1e-3,
        "white is 1 at three stops: {}",
        red("clipped.exr")
    );
    // Three stops darker, the sky is as bright as white, which the neutral curve shows as 241.
    run(&[
        &["render", "kept.ldi", "-o", "darker.png", "--exposure", "-3"],
        &eastward,
    ]);
    let shown = image::open(dir.path().join("darker.png"))
        .unwrap()
        .to_rgb8()
        .get_pixel(16, 12)
        .0[0];
    assert!((237..=245).contains(&shown), "{shown}");
    let told = succeeds(dir.path(), &["info", "kept.ldi"]);
    assert!(told.contains("cut off 4 stops above white"), "{told}");
    // Surfaces without the noise of light: their albedo, eight times as bright as white.
    let unlit = [
        "capture",
        "builtin:miniature",
        "--face-size",
        "256",
        "--strata",
        "8",
        "--rays",
        "4",
        "--light-samples",
        "0",
    ];
    run(&[
        &unlit,
        &["--exposure", "3", "--tone", "hdr", "-o", "paint.ldi"],
    ]);
    run(&[&["render", "paint.ldi", "-o", "paint.exr", "--size", "128x96"]]);
    run(&[&[
        "truth",
        "builtin:miniature",
        "--unlit",
        "--exposure",
        "3",
        "-o",
        "white.exr",
        "--samples",
        "16",
        "--size",
        "128x96",
    ]]);
    let (paint, white) = (radiance("paint.exr"), radiance("white.exr"));
    let near = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).all(|c| (a[c] / b[c] - 1.0).abs() < 0.1);
    let bright = || {
        paint
            .iter()
            .zip(&white)
            .filter(|(_, truth)| truth.iter().all(|c| (0.15..1.9).contains(c)))
    };
    let right = bright().filter(|&pair| near(pair)).count();
    assert!(
        bright().count() > 5000 && right * 2 > bright().count(),
        "{right} of {}",
        bright().count()
    );
    for wrong in [
        &["render", "kept.ldi", "clipped.ldi", "-o", "a.exr"][..],
        &["render", "kept.ldi", "-o", "a.exr", "--exposure", "1"],
    ] {
        refused(dir.path(), 2, wrong);
    }
}

#[test]
fn exposure_of_frames_follows_the_stored_tone_curve() {
    let dir = tempfile::tempdir().unwrap();
    let run = |command: &str| succeeds(dir.path(), &command.split(' ').collect::<Vec<_>>());
    run("sprite builtin:sprites -o a.sprite --size 96x72 --samples 4 --exposure auto+2");
    run(
        "lumigraph builtin:bump -o a.lumi --cameras 2x2 --size 80x60 --samples 2 --plane 0,0,3 --normal 0,0,-1 --extent 1 --exposure auto+2",
    );
    run(
        "house builtin:house --triangles 6000 --rays 0 -o a.house --edge 4 --light-samples 2 --backdrops texture --exposure auto+2",
    );
    let darker = ToneMap::Neutral.brighter_levels(-1.0);
    for file in ["a.sprite", "a.lumi", "a.house"] {
        run(&format!("render {file} -o plain.png --size 64x48"));
        run(&format!(
            "render {file} -o darker.png --size 64x48 --exposure -1"
        ));
        let levels = |name: &str| {
            let image = image::open(dir.path().join(name)).unwrap();
            image.to_rgb8().into_raw()
        };
        let plain = levels("plain.png");
        // The shoulder compresses these; a clipped curve would make them darker.
        let highlights = plain.iter().filter(|level| **level > 230).count();
        assert!(highlights > 100, "{file}: {highlights}");
        let expected: Vec<u8> = plain
            .iter()
            .map(|&level| darker[usize::from(level)])
            .collect();
        assert!(levels("darker.png") == expected, "{file}");
    }
}

#[test]
fn frames_truth_and_sprites_show_the_same_sky() {
    let dir = tempfile::tempdir().unwrap();
    write_sky(dir.path());
    let light = ["--sky", "sky.hdr", "--sky-turn", "0", "--exposure", "0"];
    capture(dir.path(), &[light.as_slice(), &["-o", "a.ldi"]].concat());
    let eastward = [
        "--look-at",
        "100,50,0",
        "--eye",
        "0,30,0",
        "--size",
        "32x24",
    ];
    let run = |arguments: &[&[&str]]| succeeds(dir.path(), &arguments.concat());
    run(&[&["render", "a.ldi", "-o", "frame.png"], &eastward]);
    run(&[
        &[
            "truth",
            "builtin:miniature",
            "-o",
            "truth.png",
            "--samples",
            "4",
        ],
        &light,
        &eastward,
    ]);
    let middle = |name: &str| {
        image::open(dir.path().join(name))
            .unwrap()
            .to_rgb8()
            .get_pixel(16, 12)
            .0
    };
    let (frame, truth) = (middle("frame.png"), middle("truth.png"));
    assert!(
        truth[0] > 200 && truth[2] < 120,
        "the east is red: {truth:?}"
    );
    assert!(
        (0..3).all(|c| frame[c].abs_diff(truth[c]) <= 2),
        "{frame:?} for {truth:?}"
    );
    run(&[
        &[
            "sprite",
            "builtin:miniature",
            "-o",
            "a.sprite",
            "--samples",
            "1",
        ],
        &light,
    ]);
    let info = json(dir.path(), &["info", "a.sprite", "--json"]);
    assert_eq!(info["capture"]["light"]["sky"].as_str(), Some("sky.hdr"));
}

#[test]
fn a_house_keeps_the_sky_that_lights_it() {
    let dir = tempfile::tempdir().unwrap();
    write_sky(dir.path());
    let small = [
        "--triangles",
        "300",
        "--rays",
        "0",
        "--backdrops",
        "none",
        "--edge",
        "5",
        "--light-samples",
        "1",
        "--exposure",
        "-4", // no sky is white
    ];
    for (name, sky) in [
        ("a.house", ["--sky", "sky.hdr"].as_slice()),
        ("b.house", &[]),
    ] {
        succeeds(
            dir.path(),
            &[
                ["house", "builtin:house", "-o", name].as_slice(),
                &small,
                sky,
            ]
            .concat(),
        );
        assert_eq!(json(dir.path(), &["info", name, "--json"])["ok"], true);
    }
    let bytes = |name: &str| std::fs::metadata(dir.path().join(name)).unwrap().len();
    assert!(
        bytes("a.house") >= bytes("b.house") + 8 * 4 * 12,
        "the picture of the sky is in it"
    );
    let render = |house: &str, to: &str| {
        let eye = [
            "--eye",
            "0,40,0",
            "--look-at",
            "100,60,0",
            "--size",
            "32x24",
        ];
        succeeds(
            dir.path(),
            &[["render", house, "-o", to].as_slice(), &eye].concat(),
        );
        image::open(dir.path().join(to))
            .unwrap()
            .to_rgb8()
            .get_pixel(16, 4)
            .0
            .map(u32::from)
    };
    let [red, _, blue] = render("a.house", "a.png");
    assert!(red > 2 * blue, "the east is red: {red}, {blue}");
    let [red, _, blue] = render("b.house", "b.png");
    assert!(red < blue, "the builtin sky is blue: {red}, {blue}");
}

#[test]
fn truth_of_ldi_has_its_light_exposure_and_camera() {
    let dir = tempfile::tempdir().unwrap();
    let light = ["--sun", "100,40", "--exposure", "auto+1"];
    capture(dir.path(), &[&["-o", "a.ldi"], light.as_slice()].concat());
    let size = ["--size", "64x48"];
    let truth = |more: &[&str]| {
        let usual = ["truth", "a.ldi", "-o", "truth.png", "--json"];
        json(dir.path(), &[&usual, size.as_slice(), more].concat())
    };
    assert_eq!(truth(&["--samples", "16"])["samples"], 16);
    // The same frame as that of the scene in the same light.
    let scene = [
        "truth",
        "builtin:miniature",
        "-o",
        "scene.png",
        "--samples",
        "16",
    ];
    succeeds(dir.path(), &[&scene, light.as_slice(), &size].concat());
    let read = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    assert!(read("truth.png") == read("scene.png"));
    let noisy = truth(&["--noise", "25"]);
    assert!(
        noisy["standard_error_psnr_db"].as_f64().unwrap() >= 25.0,
        "{noisy}"
    );
    assert!(noisy["samples"].as_u64().unwrap() < 4096, "{noisy}");
    assert!(truth(&["--time", "1"])["samples"].as_u64().unwrap() >= 2);
    let message = refused(
        dir.path(),
        2,
        &["truth", "a.ldi", "-o", "x.png", "--sun", "off"],
    );
    assert!(
        message.contains("--sun has no meaning for a cube LDI"),
        "{message}"
    );
}

#[test]
fn unlit_frames_have_the_colors_of_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    write("red.mtl", "newmtl red\nKd 1 0 0\n");
    write(
        "red.obj",
        "mtllib red.mtl\nusemtl red\nv -2 -2 0\nv 2 -2 0\nv 2 2 0\nv -2 2 0\nf 1 2 3 4\n",
    );
    let run = |command: &str| succeeds(dir.path(), &command.split(' ').collect::<Vec<_>>());
    run(
        "capture red.obj -o red.ldi --up y --unit m --light-samples 0 --face-size 32 --center 0,0,1 --half-size 0.1",
    );
    let camera = "--size 32x24 --eye 0,0,1 --look-at 0,0,0";
    run(&format!(
        "truth red.obj -o scene.png --up y --unit m --unlit --samples 4 {camera}"
    ));
    run(&format!("truth red.ldi -o truth.png --samples 4 {camera}"));
    run(&format!("render red.ldi -o frame.png {camera}"));
    for name in ["scene.png", "truth.png", "frame.png"] {
        let image = image::open(dir.path().join(name)).unwrap().to_rgb8();
        assert_eq!(image.get_pixel(16, 12).0, [255, 0, 0], "{name}");
    }
}
