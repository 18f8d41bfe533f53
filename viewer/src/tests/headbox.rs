use super::*;
use crate::source::{HeadboxRequest, Headboxes};
use crate::{EyeBounds, FrameReport, FrameRequest, Pose, Setting};
use egui::Key;
use glam::DVec3;

/// A room that can capture headboxes.
struct CapturableRoom {
    room: CheckerRoom,
    headboxes: Headboxes,
}

impl CapturableRoom {
    fn new() -> Self {
        let room = CheckerRoom::new(Kind::Headbox);
        let bounds = vec![room.bounds().unwrap()];
        Self {
            room,
            headboxes: Headboxes { bounds, shown: 0 },
        }
    }
}

impl FrameSource for CapturableRoom {
    fn title(&self) -> String {
        self.room.title()
    }

    fn start_pose(&self) -> Pose {
        Pose {
            eye: self.bounds().unwrap().centre,
            ..self.room.start_pose()
        }
    }

    fn bounds(&self) -> Option<EyeBounds> {
        Some(self.headboxes.bounds[self.headboxes.shown])
    }

    fn headboxes(&self) -> Option<Headboxes> {
        Some(self.headboxes.clone())
    }

    fn request_headbox(&mut self, request: HeadboxRequest) -> Result<String, String> {
        match request {
            HeadboxRequest::Capture {
                centre,
                half_size_m,
            } => {
                let half_size = DVec3::splat(half_size_m);
                self.headboxes.bounds.push(EyeBounds { centre, half_size });
                self.headboxes.shown = self.headboxes.bounds.len() - 1;
            }
            HeadboxRequest::Show(index) => self.headboxes.shown = index,
        }
        Ok("Another headbox is shown.".into())
    }

    fn settings(&self) -> Vec<Setting> {
        self.room.settings()
    }

    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String> {
        self.room.render(request, pixels)
    }
}

fn capturable_room() -> Window {
    let options = ViewerOptions {
        settings: vec![("block".into(), "8".into())],
        ..ViewerOptions::default()
    };
    let mut window = open(Some(Box::new(CapturableRoom::new())), options);
    wait(&mut window, "the first frame", |viewer| {
        viewer.shown.is_some()
    });
    window
}

/// Holds a key until the eye has left the headbox.
fn fly_out(window: &mut Window) {
    window.key_down(Key::D);
    wait(window, "the eye to leave", |viewer| {
        let bounds = viewer.info.as_ref().unwrap().bounds.unwrap();
        !bounds.contains(viewer.eye.pose.eye)
    });
    window.key_up(Key::D);
    settle(window);
}

#[test]
fn eye_leaves_headbox_and_captures_another() {
    let mut window = capturable_room();
    let start = window.state().eye.pose.eye;
    press(&mut window, Key::F);
    fly_out(&mut window);
    let eye = window.state().eye.pose.eye;
    let hint = "outside of the headbox: Enter captures here";
    assert!(window.query_by_label(hint).is_some());
    press(&mut window, Key::Enter);
    wait(&mut window, "the second headbox", |viewer| {
        let info = viewer.info.as_ref().unwrap();
        info.headboxes.as_ref().unwrap().bounds.len() == 2
    });
    let viewer = window.state();
    assert_eq!(viewer.info.as_ref().unwrap().bounds.unwrap().centre, eye);
    assert_eq!(viewer.eye.pose.eye, eye, "the eye stays where it is");
    assert!(!viewer.headbox.leaves, "and now stays inside");
    settle(&mut window);
    assert!(window.query_by_label(hint).is_none());

    let first = window
        .root()
        .children_recursive()
        .filter_map(|node| node.accesskit_node().label())
        .find(|label| label.starts_with("1: "))
        .expect("both are listed");
    click(&mut window, &first);
    wait(&mut window, "the first headbox", |viewer| {
        viewer.eye.pose.eye == start
    });
}

#[test]
fn placed_headbox_is_sized_and_moved_by_its_handles() {
    let mut window = capturable_room();
    press(&mut window, Key::N);
    let viewer = window.state();
    let (start, placed) = (viewer.eye.pose, viewer.headbox);
    assert!(viewer.headbox.leaves && placed.placed == Some(start.eye));
    // From behind, along an axis, so that the handles are in the frame.
    let size = placed.half_size_m;
    let behind = start.eye + DVec3::Z * size * 4.0;
    window.state_mut().eye.pose = Pose::looking_at(behind, start.eye, 90.0);
    window.run_steps(2);
    let frame = frame_rect(&window);
    let per_size = frame.height() / 2.0 / 4.0;
    let drag = |window: &mut Window, from: egui::Pos2, to: egui::Pos2| {
        window.drag_at(from);
        window.step();
        window.hover_at(to);
        window.run_steps(2);
        window.drop_at(to);
        window.run_steps(2);
    };
    let middle = frame.center();
    let face = middle + egui::vec2(per_size, 0.0);
    drag(&mut window, face, middle + egui::vec2(1.5 * per_size, 0.0));
    let viewer = window.state();
    let ratio = viewer.headbox.half_size_m / size;
    assert!((ratio - 1.5).abs() < 0.02, "{ratio}");
    assert_eq!(
        viewer.eye.pose.yaw_rad, 0.0,
        "the drag does not turn the eye"
    );

    drag(&mut window, middle, middle + egui::vec2(0.0, -per_size));
    let moved = window.state().headbox.placed.unwrap() - start.eye;
    assert!(moved.distance(start.up * size) < 0.02 * size, "{moved}");

    let hint = "Enter captures the placed headbox";
    assert!(window.query_by_label(hint).is_some());
    press(&mut window, Key::Enter);
    wait(&mut window, "the placed headbox", |viewer| {
        let info = viewer.info.as_ref().unwrap();
        info.headboxes.as_ref().unwrap().bounds.len() == 2
    });
    let viewer = window.state();
    let bounds = viewer.info.as_ref().unwrap().bounds.unwrap();
    assert!(bounds.centre.distance(start.eye + moved) < 1e-9);
    assert!((bounds.half_size.x - 1.5 * size).abs() < 0.02 * size);
    assert_eq!(viewer.headbox.placed, None, "it is captured");
}

/// The part of the window that shows the frame, points.
fn frame_rect(window: &Window) -> egui::Rect {
    let [width, height] = size_px(window).map(|side| side as f32);
    /// Margin of the test's window.
    const MARGIN: f32 = 8.0;
    // The side panel is on its left, the status line below.
    let left = SIZE_POINTS[0] - MARGIN - width;
    egui::Rect::from_min_size(egui::pos2(left, MARGIN), egui::vec2(width, height))
}

#[test]
fn eye_that_may_not_leave_returns_to_headbox() {
    let mut window = capturable_room();
    let start = window.state().eye.pose.eye;
    press(&mut window, Key::F);
    fly_out(&mut window);
    press(&mut window, Key::F);
    assert_eq!(window.state().eye.pose.eye, start);
}

#[test]
fn source_without_captures_keeps_eye_inside() {
    let mut window = room();
    press(&mut window, Key::F);
    press(&mut window, Key::Enter);
    assert!(!window.state().headbox.leaves);
    let counts: Vec<u32> = window.state().messages.iter().map(|m| m.count).collect();
    assert_eq!(counts, [2], "both keys say so: {:?}", texts(&window));
    assert!(window.query_by_label("Capture here").is_none());
}
