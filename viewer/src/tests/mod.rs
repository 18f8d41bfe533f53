//! The whole window without a display: events in, state out, and images by a software painter. No
//! graphics driver is needed; the frames come from the real render thread.

mod eye;
mod files;
mod frames;
mod headbox;
mod painter;
mod panels;
mod script;
mod snapshots;

#[path = "../../examples/checker_room/room.rs"]
mod room;

use crate::playback::automation::Outcome;
use crate::playback::thumbnails::ThumbnailCache;
use crate::source::{FrameSource, Library};
use crate::thread::session::Session;
use crate::window::app::Viewer;
use crate::window::options::ViewerOptions;
use egui_kittest::{
    Harness,
    kittest::{NodeT, Queryable},
};
use room::{CheckerRoom, Kind, Rooms};
use std::{
    sync::{Arc, Mutex},
    time::{Duration, Instant},
};

/// A window under test.
type Window = Harness<'static, Viewer>;

/// Simulated time of one pass, seconds.
const PASS_S: f32 = 1.0 / 60.0;
/// Timeout of the render thread on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// Size of most windows, points: small for fast tests even without optimisation, but large enough
/// for the whole side panel beside the frame.
const SIZE_POINTS: [f32; 2] = [700.0, 1400.0];

fn open(source: Option<Box<dyn FrameSource>>, options: ViewerOptions) -> Window {
    open_on(source, options, SIZE_POINTS, painter::Painter::default())
}

/// Opens a window of `size` points, whose textures go to `painter`.
fn open_on(
    source: Option<Box<dyn FrameSource>>,
    mut options: ViewerOptions,
    size: [f32; 2],
    painter: painter::Painter,
) -> Window {
    let (library, can_open) = (options.library.take(), source.is_none());
    let session = Session::start(
        source,
        options.coming.take(),
        library,
        ThumbnailCache::new(options.thumbnail_dir.clone()),
        Arc::new(|| ()),
    )
    .unwrap();
    let viewer = Viewer::new(
        session,
        options,
        can_open,
        Arc::new(Mutex::new(Outcome::default())),
    );
    let harness = Harness::builder()
        .with_size(size)
        .with_step_dt(PASS_S)
        .renderer(painter);
    let harness = harness.with_context_setup(crate::panels::theme::install);
    harness.build_ui_state(|ui, viewer: &mut Viewer| viewer.pass(ui, None), viewer)
}

/// Opens a window on the room and waits for the first frame. One ray serves 8 x 8 pixels.
fn room_with(kind: Kind, mut options: ViewerOptions) -> Window {
    options.settings.insert(0, ("block".into(), "8".into()));
    let mut window = open(Some(Box::new(CheckerRoom::new(kind))), options);
    wait(&mut window, "the first frame", |viewer| {
        viewer.shown.is_some()
    });
    window
}

fn room() -> Window {
    room_with(Kind::Headbox, ViewerOptions::default())
}

/// Opens a window on the start page.
fn start_page() -> Window {
    let library: Box<dyn Library> = Box::new(Rooms);
    let mut window = open(
        None,
        ViewerOptions {
            library: Some(library),
            ..ViewerOptions::default()
        },
    );
    step_until(&mut window, "the entries", |window| {
        window.query_by_label("Checker hall").is_some()
    });
    window
}

/// Runs passes until `done`.
fn wait(window: &mut Window, what: &str, done: impl Fn(&Viewer) -> bool) {
    step_until(window, what, |window| done(window.state()));
}

fn step_until(window: &mut Window, what: &str, mut done: impl FnMut(&Window) -> bool) {
    let started = Instant::now();
    while !done(window) {
        assert!(started.elapsed() < PATIENCE, "waited in vain for {what}");
        window.step();
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Waits until the newest view is on the screen and the eye rests.
fn settle(window: &mut Window) {
    window.run_steps(2);
    wait(window, "the newest frame at rest", |viewer| {
        let shown = viewer.shown.as_ref();
        shown.is_some_and(|s| s.job.number == viewer.jobs_issued && !s.job.moving)
            && !viewer.eye.motion.is_moving()
    });
}

/// Presses and releases a key.
fn press(window: &mut Window, key: egui::Key) {
    window.key_press(key);
    window.step();
}

/// Saves under the name that the dialog proposes.
fn save(window: &mut Window) {
    window.run_steps(5);
    press(window, egui::Key::Enter);
    window.run_steps(2);
}

/// Clicks the control with this label; waits for it, as entries of the start page come from a
/// thread.
fn click(window: &mut Window, label: &str) {
    step_until(window, label, |window| {
        window.query_by_label(label).is_some()
    });
    window.get_by_label(label).click();
    window.run_steps(2);
}

fn texts(window: &Window) -> Vec<String> {
    window
        .state()
        .messages
        .iter()
        .map(|message| message.text.clone())
        .collect()
}

/// Size of the requested frame, pixels.
fn size_px(window: &Window) -> [u32; 2] {
    window.state().view_request.as_ref().unwrap().size_px
}
