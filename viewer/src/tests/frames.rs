use super::*;
use crate::{FrameReport, FrameRequest, Pose, Refinement, Setting, Stereo};
use egui::Key;
use glam::DVec3;

#[test]
fn the_frame_on_the_screen_is_the_newest_view_in_window_pixels() {
    let mut window = room();
    window.set_pixels_per_point(1.5);
    window.key_down(Key::A);
    window.run_steps(10);
    window.key_up(Key::A);
    settle(&mut window);
    let viewer = window.state();
    let shown = viewer.shown.as_ref().unwrap();
    let request = viewer.view_request.as_ref().unwrap();
    assert_eq!(
        shown.pictures[0].image.size.map(|s| s as u32),
        request.size_px
    );
    assert_eq!(
        shown.job.cameras[0],
        viewer
            .eye
            .pose
            .camera(request.size_px[0], request.size_px[1])
            .unwrap()
    );
    assert!(
        request.size_px[1] > 1300,
        "the scale of the display counts: {:?}",
        request.size_px
    );
    let middle = shown.pictures[0].image.pixels[shown.pictures[0].image.pixels.len() / 2];
    assert_eq!(middle.a(), 255);
}

#[test]
fn stereo_shows_two_eyes_side_by_side() {
    let mut window = room();
    settle(&mut window);
    let whole = size_px(&window);
    press(&mut window, Key::X);
    settle(&mut window);
    assert_eq!(window.state().display.stereo, Stereo::CrossEyed);
    let cameras = &window.state().shown.as_ref().unwrap().job.cameras;
    assert_eq!(cameras.len(), 2);
    assert_eq!(cameras[0].width(), whole[0] / 2);
    let right = cameras[0].world_from_eye().x_axis;
    let apart = (cameras[0].eye() - cameras[1].eye()).dot(right);
    assert!(
        (apart - window.state().display.separation_m).abs() < 1e-9,
        "the right eye's view is on the left: {apart}"
    );
    press(&mut window, Key::X);
    settle(&mut window);
    let cameras = &window.state().shown.as_ref().unwrap().job.cameras;
    assert!(
        (cameras[1].eye() - cameras[0].eye()).dot(right) > 0.0,
        "parallel: the left eye's view is on the left"
    );
}

#[test]
fn comparing_renders_both_sets_and_edits_one() {
    let mut window = room();
    click(&mut window, "Compare A with B");
    click(&mut window, "Lamp");
    settle(&mut window);
    let shown = window.state().shown.as_ref().unwrap();
    assert_eq!(shown.pictures.len(), 2);
    assert_eq!(
        shown
            .job
            .sets
            .iter()
            .map(|set| set.toggle("lamp"))
            .collect::<Vec<_>>(),
        [Ok(true), Ok(false)]
    );
    assert!(shown.pictures[0].image.pixels != shown.pictures[1].image.pixels);
    let size = shown.pictures[0].image.size;
    let (width, pixels) = window.state().frame_on_screen().unwrap()();
    let [a, b] = [0, 1].map(|i| &shown.pictures[i].image.pixels);
    assert_eq!(width, size[0]);
    assert_eq!(
        (pixels[0], pixels[width - 1]),
        (a[0].to_array(), b[width - 1].to_array()),
        "A left, B right"
    );
}

#[test]
fn the_divider_can_be_dragged() {
    let mut window = room();
    press(&mut window, Key::B);
    settle(&mut window);
    let pose = window.state().eye.pose;
    // Except for the margin of the harness.
    let frame_right = SIZE_POINTS[0] - 8.0;
    let frame_width = size_px(&window)[0] as f32;
    let middle = egui::pos2(frame_right - frame_width / 2.0, 500.0);
    window.drag_at(middle);
    window.step();
    window.hover_at(middle - egui::vec2(60.0, 0.0));
    window.run_steps(2);
    window.drop_at(middle - egui::vec2(60.0, 0.0));
    window.step();
    assert!(
        window.state().display.divider < 0.4,
        "{}",
        window.state().display.divider
    );
    assert_eq!(
        window.state().eye.pose,
        pose,
        "the head does not turn meanwhile"
    );
}

#[test]
fn slow_frames_lose_pixels_only_while_moving() {
    let options = ViewerOptions {
        settings: vec![("delay".into(), "200".into())],
        ..ViewerOptions::default()
    };
    let mut window = room_with(Kind::Headbox, options);
    window.key_down(Key::W);
    wait(&mut window, "a frame of fewer pixels", |viewer| {
        let shown = viewer.shown.as_ref().unwrap();
        shown.job.moving && shown.job.scale < 1.0
    });
    window.key_up(Key::W);
    settle(&mut window);
    let viewer = window.state();
    let shown = viewer.shown.as_ref().unwrap();
    assert_eq!(shown.job.scale, 1.0);
    assert_eq!(
        shown.pictures[0].image.size.map(|s| s as u32),
        viewer.view_request.as_ref().unwrap().size_px
    );
}

#[test]
fn converging_source_is_rendered_until_done() {
    let options = ViewerOptions {
        settings: vec![("refine".into(), "on".into())],
        ..ViewerOptions::default()
    };
    let mut window = room_with(Kind::Headbox, options);
    wait(&mut window, "the finished picture", |viewer| {
        let shown = viewer.shown.as_ref().unwrap();
        shown.pictures[0].report.refinement == Refinement::Done && shown.job.round > 0
    });
    let round = window.state().shown.as_ref().unwrap().job.round;
    window.run_steps(20);
    assert_eq!(
        window.state().shown.as_ref().unwrap().job.round,
        round,
        "then it rests"
    );
}

#[test]
fn a_failing_source_leaves_the_last_frame_and_a_message() {
    let mut window = room();
    settle(&mut window);
    let number = window.state().shown.as_ref().unwrap().job.number;
    click(&mut window, "Fail");
    wait(&mut window, "the message", |viewer| {
        viewer.messages.iter().len() == 1
    });
    assert_eq!(texts(&window), ["The room was asked to fail."]);
    // A list needs a pass to measure its size.
    window.run_steps(2);
    assert_eq!(window.state().shown.as_ref().unwrap().job.number, number);
    click(&mut window, "Dismiss");
    assert!(texts(&window).is_empty());
    click(&mut window, "Fail");
    settle(&mut window);
    assert!(
        window.state().shown.as_ref().unwrap().job.number > number,
        "and it works again"
    );
}

#[test]
fn panic_of_source_is_reported() {
    struct Broken;
    impl FrameSource for Broken {
        fn title(&self) -> String {
            "Broken".into()
        }
        fn start_pose(&self) -> Pose {
            Pose::looking_at(DVec3::ZERO, DVec3::NEG_Z, 60.0)
        }
        fn render(&mut self, _: &FrameRequest, _: &mut [[u8; 4]]) -> Result<FrameReport, String> {
            panic!("index out of bounds")
        }
    }
    let mut window = open(Some(Box::new(Broken)), ViewerOptions::default());
    wait(&mut window, "the message", |viewer| {
        viewer.messages.iter().len() == 1
    });
    assert!(texts(&window)[0].contains("index out of bounds"));
    window.run_steps(5);
}

#[test]
fn drawn_settings_keep_their_values() {
    struct Tilted;
    impl FrameSource for Tilted {
        fn title(&self) -> String {
            "Tilted".into()
        }
        fn start_pose(&self) -> Pose {
            Pose::looking_at(DVec3::ZERO, -DVec3::Z, 60.0)
        }
        fn settings(&self) -> Vec<Setting> {
            let (value, tip) = (33.690_067_525, "With more digits than the slider shows.");
            vec![Setting::number(
                "tilt",
                "Tilt",
                tip,
                value,
                -180.0..=180.0,
                "",
            )]
        }
        fn render(
            &mut self,
            request: &FrameRequest,
            pixels: &mut [[u8; 4]],
        ) -> Result<FrameReport, String> {
            assert_eq!(request.settings.number("tilt"), Ok(33.690_067_525));
            pixels.fill([255; 4]);
            Ok(FrameReport::default())
        }
    }
    let mut window = open(Some(Box::new(Tilted)), ViewerOptions::default());
    wait(&mut window, "the frame", |viewer| viewer.shown.is_some());
    window.run_steps(5);
    assert_eq!(window.state().sets.a.number("tilt"), Ok(33.690_067_525));
}
