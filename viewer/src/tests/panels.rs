use super::*;
use egui::{Key, accesskit::Role};

/// Roles of controls.
const CONTROLS: [Role; 7] = [
    Role::Button,
    Role::CheckBox,
    Role::ComboBox,
    Role::RadioButton,
    Role::Slider,
    Role::SpinButton,
    Role::TextInput,
];

/// Controls of egui's own windows, which need no tooltip.
const OWN_NAMES: [&str; 1] = ["Close window"];

/// Labels of controls without a tooltip.
fn without_tooltip(window: &Window) -> Vec<String> {
    let nodes = window.root().children_recursive();
    let controls: Vec<_> = nodes
        .map(|node| node.accesskit_node())
        .filter(|node| CONTROLS.contains(&node.role()))
        .collect();
    // The number of a slider shares the slider's tooltip.
    let in_slider = |label: &Option<String>| {
        controls
            .iter()
            .any(|c| c.role() == Role::Slider && c.label() == *label)
    };
    let bare = controls.iter().filter(|node| {
        let label = node.label();
        let own = label
            .as_deref()
            .is_some_and(|label| OWN_NAMES.contains(&label));
        let part = node.role() == Role::SpinButton && in_slider(&label);
        node.description().is_none_or(|tip| tip.is_empty()) && !own && !part
    });
    bare.map(|node| format!("{:?} {:?}", node.role(), node.label()))
        .collect()
}

#[test]
fn every_control_has_a_tooltip() {
    let mut window = room_with(
        Kind::Walk,
        ViewerOptions {
            compare: Some(Vec::new()),
            ..ViewerOptions::default()
        },
    );
    // Section headers need no tooltip.
    let headers = [
        "Camera",
        "Picture",
        "Tests",
        "Bookmarks",
        "Record",
        "Position and speed",
        "Display",
        "Statistics",
    ];
    window.state_mut().add_bookmark("door", 0.0);
    for folded in &headers[3..] {
        click(&mut window, folded);
        window.run_steps(20);
    }
    let bare: Vec<_> = without_tooltip(&window);
    let bare: Vec<_> = bare
        .into_iter()
        .filter(|b| !headers.iter().any(|h| b.contains(&format!("{h:?}"))))
        .collect();
    assert!(bare.is_empty(), "{bare:#?}");
    let controls = window
        .root()
        .children_recursive()
        .filter(|n| CONTROLS.contains(&n.accesskit_node().role()))
        .count();
    assert!(controls > 30, "the panel is there: {controls} controls");
}

#[test]
fn f1_lists_the_keys_and_escape_closes_the_list() {
    let mut window = room();
    press(&mut window, Key::F1);
    window.run_steps(2);
    assert!(window.query_by_label("Look down").is_some());
    press(&mut window, Key::Escape);
    window.run_steps(20);
    assert!(window.query_by_label("Look down").is_none());
}

#[test]
fn panels_can_be_hidden_and_the_frame_takes_their_place() {
    let mut window = room();
    settle(&mut window);
    let narrow = size_px(&window);
    press(&mut window, Key::H);
    settle(&mut window);
    assert!(window.query_by_label("Lamp").is_none());
    assert!(size_px(&window)[0] > narrow[0] + 200);
    press(&mut window, Key::H);
    settle(&mut window);
    assert_eq!(size_px(&window), narrow);
}

#[test]
fn the_start_page_opens_scenes() {
    let mut window = start_page();
    window.run_steps(3);
    assert!(
        without_tooltip(&window).is_empty(),
        "{:?}",
        without_tooltip(&window)
    );
    click(&mut window, "Checker hall");
    wait(&mut window, "the hall", |viewer| viewer.shown.is_some());
    assert_eq!(window.state().info.as_ref().unwrap().title, "Checker hall");
    assert!(window.state().info.as_ref().unwrap().plan.is_some());
}

/// A file dropped by the desktop.
#[derive(Debug)]
struct Dropped(std::path::PathBuf);

impl egui::DroppedFile for Dropped {
    fn path(&self) -> &std::path::Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|e| e.to_string())
    }
}

#[test]
fn files_can_be_dropped_and_bad_ones_leave_the_view() {
    let dir = tempfile::tempdir().unwrap();
    let [good, bad] = ["ball", "nonsense"].map(|name| {
        let path = dir.path().join(format!("{name}.room"));
        std::fs::write(&path, name).unwrap();
        path
    });
    let mut window = start_page();
    window
        .input_mut()
        .dropped_files
        .push(Arc::new(Dropped(good)));
    window.step();
    wait(&mut window, "the ball", |viewer| viewer.shown.is_some());
    assert_eq!(window.state().info.as_ref().unwrap().title, "Checker ball");
    window
        .input_mut()
        .dropped_files
        .push(Arc::new(Dropped(bad)));
    window.step();
    wait(&mut window, "the message", |viewer| {
        viewer.messages.iter().len() == 1
    });
    assert_eq!(texts(&window), ["There is no room named \"nonsense\"."]);
    assert_eq!(window.state().info.as_ref().unwrap().title, "Checker ball");
}

#[test]
fn the_file_list_opens_on_o() {
    let mut window = start_page();
    press(&mut window, Key::O);
    window.run_steps(3);
    assert!(window.query_by_label("Up").is_some());
    assert!(
        without_tooltip(&window).is_empty(),
        "{:?}",
        without_tooltip(&window)
    );
    press(&mut window, Key::Escape);
    window.run_steps(20);
    assert!(window.query_by_label("Up").is_none());
}

#[test]
fn in_a_narrow_window_the_panel_folds_away_and_lies_over_the_frame() {
    let mut window = room();
    window.set_size([480.0, 360.0].into());
    settle(&mut window);
    // Except for the margin of the harness.
    let whole = [480 - 16, 360 - 16];
    assert_eq!(size_px(&window), whole, "the frame has all of the window");
    assert!(window.query_by_label("Lamp").is_none());
    click(&mut window, "Panel");
    window.run_steps(4);
    assert!(window.query_by_label("Lamp").is_some());
    assert_eq!(size_px(&window), whole, "the panel takes nothing from it");
    click(&mut window, "Fold");
    window.run_steps(4);
    assert!(window.query_by_label("Lamp").is_none());
    press(&mut window, Key::F1);
    window.run_steps(4);
    for words in [
        "Look down",
        "Save a picture of the window (PNG)",
        "Double click",
    ] {
        let rect = window.get_by_label(words).rect();
        assert!(
            rect.left() >= 0.0 && rect.right() <= 480.0,
            "{words}: {rect:?}"
        );
    }
}

#[test]
fn start_page_is_reachable_from_view() {
    let mut window = start_page();
    window.run_steps(3);
    click(&mut window, "Checker hall");
    wait(&mut window, "the hall", |viewer| viewer.shown.is_some());
    window.run_steps(2);
    click(&mut window, "Start page");
    window.run_steps(3);
    assert!(window.state().info.is_none() && window.query_by_label("Checker hall").is_some());
    click(&mut window, "Checker hall");
    wait(&mut window, "the hall again", |viewer| {
        viewer.shown.is_some()
    });
}

#[test]
fn the_path_field_goes_to_folders_and_opens_files() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("ball.room"), "ball").unwrap();
    let mut list = crate::panels::dialogs::open::OpenList::default();
    assert_eq!(list.enter_path(dir.path().to_str().unwrap()), None);
    assert_eq!(
        list.enter_path("ball.room"),
        Some(dir.path().join("ball.room"))
    );
    assert_eq!(list.enter_path("none.room"), None);
}

/// Clicks at a position.
fn click_at(window: &mut Window, at: egui::Pos2) {
    for pressed in [true, false] {
        window.hover_at(at);
        window.step();
        let (button, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
        window.event(egui::Event::PointerButton {
            pos: at,
            button,
            pressed,
            modifiers,
        });
        window.step();
    }
}

#[test]
fn a_row_is_clicked_anywhere_along_it() {
    let mut window = start_page();
    window.run_steps(3);
    // Below the name, beside the text.
    let name = window.get_by_label("Checker hall").rect();
    click_at(
        &mut window,
        egui::pos2(name.left() + 180.0, name.bottom() + 12.0),
    );
    wait(&mut window, "the hall", |viewer| viewer.shown.is_some());
    window.run_steps(3);
    // A heading folds by a click at its far end.
    assert!(window.query_by_label("Compare A with B").is_some());
    let heading = window.get_by_label("Picture").rect();
    assert!(heading.width() > 200.0, "{heading:?}");
    click_at(
        &mut window,
        egui::pos2(heading.right() - 5.0, heading.center().y),
    );
    window.run_steps(30);
    assert!(window.query_by_label("Compare A with B").is_none());

    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("ball.room"), "ball").unwrap();
    press(&mut window, Key::O);
    window.run_steps(3);
    window
        .state_mut()
        .open_list
        .enter_path(dir.path().to_str().unwrap());
    window.run_steps(3);
    let row = window.get_by_label("ball.room").rect();
    assert!(row.width() > 300.0, "{row:?}");
    click_at(&mut window, egui::pos2(row.right() - 5.0, row.center().y));
    wait(&mut window, "the ball", |viewer| {
        viewer
            .info
            .as_ref()
            .is_some_and(|info| info.title == "Checker ball")
    });
}

#[test]
fn expert_controls_are_folded() {
    let mut window = room();
    for label in ["Orbit", "Exposure", "Fewer pixels while moving"] {
        let mut found = window.query_all_by_label_contains(label);
        assert!(found.next().is_some(), "{label}");
    }
    assert!(window.query_by_label("Drag moves the scene").is_none());
    click(&mut window, "Position and speed");
    window.run_steps(20);
    assert!(window.query_by_label("Drag moves the scene").is_some());
}

/// Rooms that are opened when a message arrives.
struct Gated(std::sync::mpsc::Receiver<()>);

impl Library for Gated {
    fn entries(&self) -> Vec<crate::Entry> {
        Rooms.entries()
    }

    fn extensions(&self) -> Vec<String> {
        Rooms.extensions()
    }

    fn open_entry(&mut self, id: &str) -> Result<Box<dyn FrameSource>, String> {
        self.0.recv().map_err(|error| error.to_string())?;
        Rooms.open_entry(id)
    }

    fn open_file(&mut self, path: &std::path::Path) -> Result<Box<dyn FrameSource>, String> {
        Rooms.open_file(path)
    }
}

#[test]
fn backspace_while_opening_leads_to_the_start_page() {
    let (gate, gated) = std::sync::mpsc::channel();
    let options = ViewerOptions {
        library: Some(Box::new(Gated(gated))),
        ..ViewerOptions::default()
    };
    let mut window = open(None, options);
    step_until(&mut window, "the entries", |window| {
        window.query_by_label("Checker hall").is_some()
    });
    click(&mut window, "Checker hall");
    assert!(window.state().opening.is_some());
    press(&mut window, Key::Backspace);
    window.run_steps(2);
    assert!(window.query_by_label("Checker ball").is_some());
    click(&mut window, "Checker ball");
    // The hall arrives, though nobody waits for it.
    gate.send(()).unwrap();
    std::thread::sleep(Duration::from_millis(50));
    window.run_steps(5);
    assert!(window.state().info.is_none() && window.state().opening.is_some());
    gate.send(()).unwrap();
    wait(&mut window, "the ball", |viewer| viewer.shown.is_some());
    assert_eq!(window.state().info.as_ref().unwrap().title, "Checker ball");
}

#[test]
fn backspace_gives_up_a_source_that_another_thread_opens() {
    let (sender, source) = std::sync::mpsc::channel();
    let options = ViewerOptions {
        library: Some(Box::new(Rooms)),
        coming: Some(crate::PendingSource {
            name: "room".into(),
            source,
        }),
        ..ViewerOptions::default()
    };
    let mut window = open(None, options);
    window.state_mut().set_opening("room".into());
    window.run_steps(3);
    assert!(window.query_by_label("Checker hall").is_none());
    press(&mut window, Key::Backspace);
    window.run_steps(3);
    // Fails if the window no longer waits, which is as well.
    let _ = sender.send(Ok(Box::new(CheckerRoom::new(Kind::Walk))));
    click(&mut window, "Checker ball");
    wait(&mut window, "the ball", |viewer| viewer.shown.is_some());
    assert_eq!(window.state().info.as_ref().unwrap().title, "Checker ball");
}
