//! Key bindings: one table for the program and for the list on F1.

use crate::input::motion::Steering;
use crate::thread::exchange::Location;
use crate::window::system_dialog::SystemQuestion;
use egui::{InputState, Key};
use glam::DVec3;
use std::path::PathBuf;

/// Command of a key, a button or a script.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Command {
    Centre,
    ToggleKeys,
    TogglePanels,
    ToggleCompare,
    NextStereo,
    SaveFrame,
    SaveCamera,
    SaveWindow,
    ToggleRecording,
    TogglePlayback,
    SavePath,
    LoadPath(PathBuf),
    ExportPath,
    /// Writes what the dialog is about to a file or folder; may replace a file.
    Save {
        path: PathBuf,
        replace: bool,
    },
    CancelExport,
    ShowOpen,
    AskSystem(SystemQuestion),
    Start,
    Open(Location),
    /// Asks where to save the file of a button of the source's panel.
    AskSave(&'static str),
    /// Changes the exposure by a number of stops.
    Expose(f64),
    ToggleOrbit,
    Approach,
    AddBookmark(String),
    RemoveBookmark(usize),
    GoToBookmark(usize),
    ToggleLeave,
    PlaceHeadbox,
    CaptureHere,
    ShowHeadbox(usize),
    FullScreen,
    Dismiss,
}

/// Effect of a key.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Effect {
    /// Moves the eye while held: right, up, forward.
    Drive([i8; 3]),
    /// Turns the head while held: left, up.
    Turn([i8; 2]),
    /// Executes a command once per press.
    Command(Command),
    /// Goes to the bookmark of the key's number.
    Bookmark,
}

/// A row of the table: alternative keys for one effect.
pub(crate) struct Binding {
    pub keys: &'static [Key],
    pub effect: Effect,
    pub help: &'static str,
}

const fn drive(keys: &'static [Key], axes: [i8; 3], help: &'static str) -> Binding {
    Binding {
        keys,
        effect: Effect::Drive(axes),
        help,
    }
}

const fn turn(keys: &'static [Key], axes: [i8; 2], help: &'static str) -> Binding {
    Binding {
        keys,
        effect: Effect::Turn(axes),
        help,
    }
}

const fn press(keys: &'static [Key], command: Command, help: &'static str) -> Binding {
    Binding {
        keys,
        effect: Effect::Command(command),
        help,
    }
}

/// Change of exposure by one press, stops.
pub(crate) const EXPOSURE_STEP: f64 = 1.0 / 3.0;

/// Keys of the bookmarks, in order.
const NUMBERS: &[Key] = &[
    Key::Num1,
    Key::Num2,
    Key::Num3,
    Key::Num4,
    Key::Num5,
    Key::Num6,
    Key::Num7,
    Key::Num8,
    Key::Num9,
];

impl Binding {
    /// Names of the keys: "Home or C", "1 to 9".
    pub(crate) fn names(&self) -> String {
        let names: Vec<_> = self.keys.iter().map(|key| key.name()).collect();
        match names.as_slice() {
            [first, _, .., last] if self.effect == Effect::Bookmark => {
                format!("{first} to {last}")
            }
            _ => names.join(" or "),
        }
    }
}

/// The keys, in the order of the list on F1.
pub(crate) const BINDINGS: &[Binding] = &[
    drive(&[Key::W], [0, 0, 1], "Forward"),
    drive(&[Key::S], [0, 0, -1], "Back"),
    drive(&[Key::A], [-1, 0, 0], "Left"),
    drive(&[Key::D], [1, 0, 0], "Right"),
    drive(&[Key::E], [0, 1, 0], "Up"),
    drive(&[Key::Q], [0, -1, 0], "Down"),
    turn(&[Key::ArrowLeft], [1, 0], "Turn left"),
    turn(&[Key::ArrowRight], [-1, 0], "Turn right"),
    turn(&[Key::ArrowUp], [0, 1], "Look up"),
    turn(&[Key::ArrowDown], [0, -1], "Look down"),
    press(&[Key::Home, Key::C], Command::Centre, "Back to the centre"),
    press(
        &[Key::G],
        Command::Approach,
        "Go to what is under the pointer",
    ),
    press(
        &[Key::V],
        Command::ToggleOrbit,
        "Orbit what is in the middle, or stop",
    ),
    press(
        &[Key::Plus, Key::Equals],
        Command::Expose(EXPOSURE_STEP),
        "Brighter by a third of a stop",
    ),
    press(
        &[Key::Minus],
        Command::Expose(-EXPOSURE_STEP),
        "Darker by a third of a stop",
    ),
    press(
        &[Key::M],
        Command::AddBookmark(String::new()),
        "Bookmark this view",
    ),
    Binding {
        keys: NUMBERS,
        effect: Effect::Bookmark,
        help: "Go to a bookmark",
    },
    press(&[Key::B], Command::ToggleCompare, "Compare A with B"),
    press(
        &[Key::X],
        Command::NextStereo,
        "Stereo: off, cross-eyed, parallel",
    ),
    press(&[Key::P], Command::SaveFrame, "Save the frame (PNG)…"),
    press(&[Key::K], Command::SaveCamera, "Save the camera (JSON)…"),
    press(
        &[Key::R],
        Command::ToggleRecording,
        "Record a path, or stop",
    ),
    press(
        &[Key::Space],
        Command::TogglePlayback,
        "Replay the path, or stop",
    ),
    press(
        &[Key::F],
        Command::ToggleLeave,
        "Leave the headbox, or go back (live)",
    ),
    press(
        &[Key::N],
        Command::PlaceHeadbox,
        "Place the next headbox, or take it back (live)",
    ),
    press(
        &[Key::Enter],
        Command::CaptureHere,
        "Capture the placed headbox, or one here (live)",
    ),
    press(&[Key::O], Command::ShowOpen, "Open a file"),
    press(&[Key::Backspace], Command::Start, "Back to the start page"),
    press(
        &[Key::H, Key::F2],
        Command::TogglePanels,
        "Hide or show the panels",
    ),
    press(&[Key::F11], Command::FullScreen, "Full screen"),
    press(
        &[Key::F12],
        Command::SaveWindow,
        "Save a picture of the window (PNG)",
    ),
    press(&[Key::Escape], Command::Dismiss, "Close messages and lists"),
    press(&[Key::F1], Command::ToggleKeys, "This list"),
];

/// Mouse buttons and modifiers, for the same list.
pub(crate) const MOUSE_HELP: &[(&str, &str)] = &[
    ("Drag", "Look around; circle a sprite"),
    ("Wheel", "Field of view"),
    ("Shift", "4 times as fast"),
    ("Alt", "4 times as slow"),
    ("Double click", "Back to the centre"),
];

const SHIFT_FACTOR: f64 = 4.0;

/// Steering by the held keys. None is held if `listening` is false (a text field has the focus).
pub(crate) fn steering(input: &InputState, listening: bool) -> Steering {
    let (mut drive, mut turn) = (DVec3::ZERO, [0.0; 2]);
    // Command shortcuts (Ctrl+C and the like) are not movement.
    if listening && !input.modifiers.command && !input.modifiers.ctrl {
        for binding in BINDINGS
            .iter()
            .filter(|b| b.keys.iter().any(|key| input.key_down(*key)))
        {
            match binding.effect {
                Effect::Drive(axes) => drive += DVec3::from(axes.map(f64::from)),
                Effect::Turn(axes) => (0..2).for_each(|i| turn[i] += f64::from(axes[i])),
                Effect::Command(_) | Effect::Bookmark => {}
            }
        }
    }
    let factor = |held: bool, factor: f64| if held { factor } else { 1.0 };
    let speed_factor =
        factor(input.modifiers.shift, SHIFT_FACTOR) / factor(input.modifiers.alt, SHIFT_FACTOR);
    Steering {
        drive,
        turn,
        speed_factor,
        ..Steering::default()
    }
}

/// Commands whose keys were pressed since the last frame (held keys do not repeat).
pub(crate) fn commands(input: &InputState) -> Vec<Command> {
    let pressed = |key: &Key| {
        let wanted = *key;
        input.events.iter().any(|event| {
            matches!(event, egui::Event::Key { key, pressed: true, repeat: false, modifiers, .. }
                if *key == wanted && !modifiers.command && !modifiers.ctrl)
        })
    };
    let command = |binding: &Binding| {
        let index = binding.keys.iter().position(pressed)?;
        match &binding.effect {
            Effect::Command(command) => Some(command.clone()),
            Effect::Bookmark => Some(Command::GoToBookmark(index)),
            Effect::Drive(_) | Effect::Turn(_) => None,
        }
    };
    BINDINGS.iter().filter_map(command).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn every_key_has_one_meaning() {
        let mut seen = HashSet::new();
        for binding in BINDINGS {
            assert!(!binding.help.is_empty() && !binding.keys.is_empty());
            for key in binding.keys {
                assert!(seen.insert(key), "{key:?} is bound twice");
            }
        }
    }

    #[test]
    fn opposite_keys_cancel() {
        let sum = |pick: fn(&Effect) -> Option<[i8; 3]>| {
            BINDINGS
                .iter()
                .filter_map(|b| pick(&b.effect))
                .fold([0; 3], |s, a| [s[0] + a[0], s[1] + a[1], s[2] + a[2]])
        };
        assert_eq!(
            sum(|e| if let Effect::Drive(a) = e {
                Some(*a)
            } else {
                None
            }),
            [0; 3]
        );
        assert_eq!(
            sum(|e| if let Effect::Turn([a, b]) = e {
                Some([*a, *b, 0])
            } else {
                None
            }),
            [0; 3]
        );
    }
}
