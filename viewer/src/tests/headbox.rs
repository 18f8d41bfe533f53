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
