use super::*;
use crate::input::keymap::Command;
use crate::playback::camera_file;
use crate::thread::exchange::Location;
use crate::{Exit, ReplayMode};
use egui::Key;
use headbox_core::file_frame::FileFrame;
use headbox_scene::camera_path;
use std::path::{Path, PathBuf};

/// Rounding error of poses converted to JSON and degrees, metres.
const FILE_TOLERANCE_M: f64 = 1e-9;

fn window_saving_to(dir: &Path) -> Window {
    room_with(
        Kind::Headbox,
        ViewerOptions {
            output_dir: dir.into(),
            ..ViewerOptions::default()
        },
    )
}

/// A path of 5 poses to the right, as a file.
fn path_file(dir: &Path) -> PathBuf {
    let view = |i: u32| {
        let x = 0.05 * f64::from(i);
        format!(
            r#"{{"time_s":{},"eye":[{x},0,0],"look_at":[{x},0,-1],"up":[0,1,0],"fov":60}}"#,
            0.1 * f64::from(i)
        )
    };
    let views: Vec<_> = (0..5).map(view).collect();
    let file = dir.join("path.json");
    std::fs::write(
        &file,
        format!(r#"{{"size":[320,180],"poses":[{}]}}"#, views.join(",")),
    )
    .unwrap();
    file
}

#[test]
fn the_frame_is_saved_as_it_is_shown() {
    let dir = tempfile::tempdir().unwrap();
    let mut window = window_saving_to(dir.path());
    settle(&mut window);
    press(&mut window, Key::P);
    save(&mut window);
    wait(&mut window, "the file", |viewer| {
        viewer.messages.iter().len() == 1
    });
    let saved = image::open(dir.path().join("frame-0001.png"))
        .unwrap()
        .into_rgba8();
    let shown = &window.state().shown.as_ref().unwrap().pictures[0].image;
    assert_eq!(
        [saved.width() as usize, saved.height() as usize],
        shown.size
    );
    assert_eq!(
        saved.into_raw(),
        bytemuck::cast_slice::<_, u8>(&shown.pixels)
    );
}

#[test]
fn camera_is_saved_as_command_line_arguments() {
    let dir = tempfile::tempdir().unwrap();
    let mut window = window_saving_to(dir.path());
    settle(&mut window);
    press(&mut window, Key::K);
    save(&mut window);
    wait(&mut window, "the file", |viewer| {
        viewer.messages.iter().len() == 1
    });
    let cameras = camera_path::read(
        &dir.path().join("camera-0001.json"),
        &FileFrame::default(),
        glam::DVec3::Y,
        30.0,
    )
    .unwrap();
    assert_eq!([cameras[0].width(), cameras[0].height()], size_px(&window));
    assert!(
        cameras[0]
            .forward()
            .distance(window.state().eye.pose.forward())
            < FILE_TOLERANCE_M
    );
}

#[test]
fn saving_asks_before_it_replaces_a_file() {
    let dir = tempfile::tempdir().unwrap();
    let mut window = window_saving_to(dir.path());
    settle(&mut window);
    press(&mut window, Key::P);
    // Taken after the dialog has proposed it.
    let file = dir.path().join("frame-0001.png");
    std::fs::write(&file, "old").unwrap();
    save(&mut window);
    assert!(window.query_by_label("frame-0001.png exists.").is_some());
    assert_eq!(std::fs::read(&file).unwrap(), b"old");
    click(&mut window, "Replace");
    wait(&mut window, "the file", |viewer| {
        viewer.messages.iter().len() == 1
    });
    assert!(image::open(&file).is_ok(), "{:?}", texts(&window));
}

#[test]
fn keys_do_not_act_while_the_save_dialog_is_open() {
    let dir = tempfile::tempdir().unwrap();
    let mut window = window_saving_to(dir.path());
    settle(&mut window);
    press(&mut window, Key::P);
    window.run_steps(3);
    press(&mut window, Key::X);
    assert_eq!(window.state().display.stereo, crate::Stereo::Off);
    press(&mut window, Key::Escape);
    window.run_steps(3);
    assert!(!window.state().save_dialog.is_open());
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn recent_file_has_the_thumbnail_of_its_last_frame() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("ball.room");
    std::fs::write(&file, "ball").unwrap();
    let mut window = open(
        None,
        ViewerOptions {
            library: Some(Box::new(Rooms)),
            thumbnail_dir: Some(dir.path().join("cache")),
            ..ViewerOptions::default()
        },
    );
    let open_file = Command::Open(Location::File(file.clone()));
    window.state_mut().commands.push(open_file);
    wait(&mut window, "the ball", |viewer| viewer.shown.is_some());
    settle(&mut window);
    press(&mut window, Key::Backspace);
    let ctx = window.ctx.clone();
    let recent = window.state_mut().recent.with_thumbnails(&ctx);
    let [(path, Some(picture))] = recent.as_slice() else {
        panic!("{} files", recent.len())
    };
    assert!(path.ends_with("ball.room"));
    assert_eq!(picture.size(), [200, 150]);
}

#[test]
fn thumbnails_of_entries_are_rendered_once() {
    /// Rooms whose thumbnails cannot be rendered.
    struct Faceless;
    impl Library for Faceless {
        fn entries(&self) -> Vec<crate::Entry> {
            Rooms.entries()
        }
        fn extensions(&self) -> Vec<String> {
            Vec::new()
        }
        fn open_entry(&mut self, _: &str) -> Result<Box<dyn FrameSource>, String> {
            Err(String::new())
        }
        fn open_file(&mut self, _: &Path) -> Result<Box<dyn FrameSource>, String> {
            Err(String::new())
        }
    }
    let dir = tempfile::tempdir().unwrap();
    let libraries: [Box<dyn Library>; 2] = [Box::new(Rooms), Box::new(Faceless)];
    for library in libraries {
        let options = ViewerOptions {
            library: Some(library),
            thumbnail_dir: Some(dir.path().into()),
            ..ViewerOptions::default()
        };
        let mut window = open(None, options);
        wait(&mut window, "the thumbnails", |viewer| {
            viewer.start_page.has_all_thumbnails()
        });
    }
}

#[test]
fn unwritable_file_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("file");
    std::fs::write(&file, "").unwrap();
    let mut window = window_saving_to(&file);
    press(&mut window, Key::P);
    save(&mut window);
    wait(&mut window, "the message", |viewer| {
        viewer.messages.iter().len() == 1
    });
    assert!(
        texts(&window)[0].contains(" cannot be written: "),
        "{:?}",
        texts(&window)
    );
}

#[test]
fn recorded_path_is_replayed_and_saved() {
    let dir = tempfile::tempdir().unwrap();
    let mut window = window_saving_to(dir.path());
    press(&mut window, Key::R);
    window.key_down(Key::W);
    window.run_steps(30);
    window.key_up(Key::W);
    settle(&mut window);
    let end = window.state().eye.pose;
    press(&mut window, Key::R);
    assert!(window.state().path_recorder.path.is_some());
    press(&mut window, Key::Home);
    press(&mut window, Key::Space);
    window.run_steps(2);
    assert!(window.state().path_recorder.is_playing());
    wait(&mut window, "the end of the replay", |viewer| {
        viewer.replay_ended
    });
    assert_eq!(window.state().eye.pose, end);
    click(&mut window, "Record");
    click(&mut window, "Save path…");
    save(&mut window);
    wait(&mut window, "the file", |viewer| {
        viewer
            .messages
            .iter()
            .any(|m| m.text.contains("path-0001.json"))
    });
    let path = camera_file::read_path(
        &dir.path().join("path-0001.json"),
        &FileFrame::default(),
        glam::DVec3::Y,
    )
    .unwrap();
    assert_eq!(
        path.poses().len(),
        window
            .state()
            .path_recorder
            .path
            .as_ref()
            .unwrap()
            .poses()
            .len()
    );
}

#[test]
fn a_scripted_path_shows_every_pose_and_ends_the_run() {
    let dir = tempfile::tempdir().unwrap();
    let options = ViewerOptions {
        replay: ReplayMode::EveryPose,
        exit: Exit::AfterPath,
        ..ViewerOptions::default()
    };
    let mut window = room_with(Kind::Headbox, options);
    settle(&mut window);
    // Building a window already runs passes, so the path starts only now.
    let commands = [
        Command::LoadPath(path_file(dir.path())),
        Command::TogglePlayback,
    ];
    window.state_mut().commands.extend(commands);
    let mut shown = Vec::new();
    step_until(&mut window, "the end", |window| {
        let job = &window.state().shown.as_ref().unwrap().job;
        let pose = (job.replayed, job.cameras[0].eye().x);
        if job.replayed.is_some() && shown.last() != Some(&pose) {
            shown.push(pose);
        }
        window.state().automation.is_closing()
    });
    let poses: Vec<_> = (0..5).map(|i| (Some(i), 0.05 * i as f64)).collect();
    assert_eq!(shown, poses);
}

#[test]
fn a_path_is_rendered_to_frames() {
    let dir = tempfile::tempdir().unwrap();
    let path = Some(path_file(dir.path()));
    let options = ViewerOptions {
        path,
        output_dir: dir.path().into(),
        ..ViewerOptions::default()
    };
    let mut window = room_with(Kind::Headbox, options);
    wait(&mut window, "the end of the replay", |viewer| {
        viewer.replay_ended
    });
    click(&mut window, "Record");
    click(&mut window, "Render path…");
    save(&mut window);
    wait(&mut window, "the frames", |viewer| {
        viewer.exporting.is_none()
    });
    let frames = dir.path().join("path-0001.frames");
    assert_eq!(std::fs::read_dir(&frames).unwrap().count(), 5);
    let last = image::open(frames.join("frame-00004.png")).unwrap();
    assert_eq!([last.width(), last.height()], size_px(&window));
}

#[test]
fn damaged_path_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("bad.json");
    std::fs::write(&file, "[]").unwrap();
    let window = room_with(
        Kind::Headbox,
        ViewerOptions {
            path: Some(file),
            ..ViewerOptions::default()
        },
    );
    assert!(
        texts(&window)[0].contains("bad.json"),
        "{:?}",
        texts(&window)
    );
}

#[test]
fn path_outside_headbox_is_replayed_and_reported() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("far.json");
    let pose =
        |x: f64| format!(r#"{{"eye":[{x},0,0],"look_at":[{x},0,-1],"up":[0,1,0],"fov":60}}"#);
    std::fs::write(
        &file,
        format!("[{},{},{}]", pose(0.0), pose(7.0), pose(1e30)),
    )
    .unwrap();
    let mut window = room_with(
        Kind::Headbox,
        ViewerOptions {
            path: Some(file),
            ..ViewerOptions::default()
        },
    );
    wait(&mut window, "the end of the replay", |viewer| {
        viewer.replay_ended
    });
    assert!(
        texts(&window)[0].starts_with("2 poses of the path are outside"),
        "{:?}",
        texts(&window)
    );
    settle(&mut window);
    press(&mut window, Key::Home);
    assert_eq!(
        window.state().eye.pose,
        window.state().info.as_ref().unwrap().start_pose
    );
}

#[test]
fn source_saves_where_the_dialog_says() {
    let dir = tempfile::tempdir().unwrap();
    let mut window = room_with(
        Kind::Walk,
        ViewerOptions {
            output_dir: dir.path().into(),
            ..ViewerOptions::default()
        },
    );
    settle(&mut window);
    click(&mut window, "Save plan");
    window.run_steps(3);
    save(&mut window);
    wait(&mut window, "the report", |viewer| {
        viewer.messages.iter().len() == 1
    });
    let file = dir.path().join("rooms-0001.txt");
    assert_eq!(std::fs::read_to_string(file).unwrap(), "front\nback");
}
