//! Captures made in the window: saved, compared and captured again.

use super::{SIZE, figure, first_round, render};
use crate::open;
use glam::DVec3;
use headbox_cube::pack::CubeLdi;
use headbox_ldi::spec::CaptureSpec;
use headbox_viewer::{HeadboxRequest, Pose, Refinement};

#[test]
fn live_capture_saves_and_compares() {
    let dir = tempfile::tempdir().unwrap();
    let mut source = open("builtin:miniature").unwrap();
    let start = source.start_pose();
    assert!(source.bounds().unwrap().contains(start.eye));
    first_round(&mut *source);
    let file = dir.path().join("miniature.ldi");
    let said = source.save("save", &file).unwrap();
    assert!(
        said.contains("miniature.ldi")
            && said.contains(" px. It has fewer rays than headbox capture"),
        "{said}"
    );
    assert!(source.save("nonsense", &file).is_err());
    drop(source);

    let mut saved = open(file.to_str().unwrap()).unwrap();
    assert_eq!(saved.start_pose().eye, start.eye);
    let (plain, report) = render(&mut *saved, start, &[]);
    assert_eq!(report.refinement, Refinement::Done);
    let (other, _) = render(&mut *saved, start, &[("kernel", "paper")]);
    assert!(plain != other, "the kernel counts");
    assert!(
        plain.iter().all(|p| p[3] == 255),
        "no pixel keeps what was there"
    );

    for same in [("clip", "off"), ("threads", "1")] {
        assert!(render(&mut *saved, start, &[same]).0 == plain, "{same:?}");
    }
    let overlays = [
        "holes",
        "coverage",
        "depth",
        "layer",
        "face",
        "segment",
        "footprint",
        "overdraw",
        "clipping",
    ];
    for overlay in overlays {
        let (painted, report) = render(&mut *saved, start, &[("overlay", overlay)]);
        assert!(painted != plain && !report.legend.is_empty(), "{overlay}");
    }
    let (_, report) = render(&mut *saved, start, &[("overlay", "overdraw")]);
    let [mean, most] =
        ["draws a pixel, mean", "draws a pixel, most"].map(|name| figure(&report, name).unwrap());
    assert!(mean >= 1.0 && most >= mean, "{mean}, {most}");
    let parts =
        ["face+x", "face-x", "face+y", "face-y", "face+z", "face-z"].map(|face| (face, "off"));
    assert!(figure(&render(&mut *saved, start, &parts).1, "depth pixels") == Some(0.0));
    let aside = Pose {
        eye: start.eye - 0.5 * saved.bounds().unwrap().half_size.x * start.forward(),
        ..start
    };
    let marked = render(&mut *saved, aside, &[("epipole", "on")]).0;
    assert!(
        marked != render(&mut *saved, aside, &[]).0,
        "seen from behind, the centre is marked"
    );

    let (mut judged, mut report) = render(&mut *saved, start, &[("overlay", "error")]);
    while report.refinement != Refinement::Done {
        std::thread::yield_now();
        (judged, report) = render(&mut *saved, start, &[("overlay", "error")]);
    }
    let [flip, psnr_db] = ["FLIP", "PSNR"].map(|name| figure(&report, name).unwrap());
    // A coarse capture of a simple scene: far from perfect, but far from another image.
    assert!(
        flip > 0.0 && flip < 0.5 && psnr_db > 15.0,
        "FLIP {flip}, PSNR {psnr_db} dB"
    );
    assert!(judged != plain);
}

#[test]
fn captured_place_is_shown_and_not_captured_again() {
    let mut source = open("builtin:miniature").unwrap();
    first_round(&mut *source);
    let bounds = source.bounds().unwrap();
    let half_size_m = bounds.half_size.x;
    let mut capture = |centre: DVec3| {
        let request = HeadboxRequest::Capture {
            centre,
            half_size_m,
        };
        let said = source.request_headbox(request).unwrap();
        (said, source.headboxes().unwrap().bounds.len())
    };
    let (said, count) = capture(bounds.centre);
    assert!(said.contains("captured already") && count == 1, "{said}");
    let (said, count) = capture(bounds.centre + DVec3::X * half_size_m);
    assert!(said.starts_with("Capturing") && count == 2, "{said}");
}

#[test]
fn headbox_is_captured_again_in_changed_light() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("miniature.ldi");
    let mut source = open("builtin:miniature").unwrap();
    first_round(&mut *source);
    let start = source.start_pose();
    let low_sun = [("sun-elevation", "10"), ("sun-strength", "1")];
    loop {
        let (_, report) = render(&mut *source, start, &low_sun);
        assert!(
            figure(&report, "depth pixels").is_some(),
            "no gap between lights"
        );
        assert!(report.refinement != Refinement::Done, "not captured again");
        let said = source.save("save", &file).unwrap();
        let saved = CubeLdi::read(&file).unwrap().info.light;
        if let Some(sun) = saved.sun {
            assert!(sun.to_string().ends_with(",10"), "{sun}");
            assert!(
                saved.sun_strength.is_some() && !said.contains("latest change"),
                "{said}"
            );
            break;
        }
        assert!(said.contains("before the latest change"), "{said}");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
}

#[test]
fn best_quality_replaces_the_shown_cube_by_a_finer_one_only() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("fast.ldi");
    let mut source = open("builtin:miniature").unwrap();
    first_round(&mut *source);
    let start = source.start_pose();
    loop {
        let (_, report) = render(&mut *source, start, &[("quality", "best")]);
        assert!(
            figure(&report, "depth pixels").is_some(),
            "the cube stays until there is a finer one"
        );
        let capturing = report.ongoing.expect("a capture").what;
        if capturing == "capturing, round 1 of 1" {
            break;
        }
        assert!(capturing.ends_with(" of 3"), "{capturing}");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    let said = source.save("save", &file).unwrap();
    assert!(said.contains("fewer rays"), "{said}");
    let fast = CubeLdi::read(&file).unwrap();
    assert!(fast.face_size_px < CaptureSpec::DEFAULT_FACE_SIZE_PX);
}

/// Renders frames of a path like the window and like the command line.
#[test]
fn path_frames_match_command_line() {
    let dir = tempfile::tempdir().unwrap();
    let mut source = open("builtin:miniature").unwrap();
    first_round(&mut *source);
    let (file, path) = (
        dir.path().join("miniature.ldi"),
        dir.path().join("path.json"),
    );
    source.save("save", &file).unwrap();
    let mut source = open(file.to_str().unwrap()).unwrap();
    let (start, frame) = (source.start_pose(), source.file_frame());
    let poses = [0.0, 0.1, 0.2].map(|turn| start.turned(turn, -turn));
    let record = |pose: &Pose| {
        headbox_scene::camera_path::CameraRecord::new(
            pose.eye,
            pose.forward(),
            DVec3::Y,
            pose.fov_y_deg,
            &frame,
        )
    };
    let record = headbox_scene::camera_path::PathRecord {
        size: Some([SIZE.0, SIZE.1]),
        poses: poses.iter().map(record).collect(),
    };
    std::fs::write(&path, serde_json::to_string(&record).unwrap()).unwrap();
    let cube = CubeLdi::read(&file).unwrap();
    let cameras = headbox_scene::camera_path::read(&path, &frame, DVec3::Y, 30.0).unwrap();
    let (mut renderer, settings) = (
        headbox_cube::render::Renderer::new(),
        headbox_cube::render::RenderSettings::default(),
    );
    for (i, pose) in poses.into_iter().enumerate() {
        let written = &renderer.render(&cube, &cameras[i], &settings).color;
        let shown: Vec<u8> = render(&mut *source, pose, &[])
            .0
            .into_iter()
            .flatten()
            .collect();
        let differing = shown
            .iter()
            .zip(written.iter().flatten())
            .filter(|(a, b)| a != b)
            .count();
        // A pose is converted to degrees and a look-at point: the last bit of a direction may
        // change a sample's rounding.
        assert!(
            differing < shown.len() / 1000,
            "pose {i}: {differing} of {} bytes",
            shown.len()
        );
    }
}
