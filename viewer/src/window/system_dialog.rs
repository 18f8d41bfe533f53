//! File dialogs of the desktop, beside the window's own lists, which also work remotely and without
//! a desktop.

use crate::input::keymap::Command;
use crate::thread::exchange::{Event, Location};
use crate::window::app::Viewer;
use crate::window::messages::Kind;
use rfd::{AsyncFileDialog, FileHandle};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Question of a dialog.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SystemQuestion {
    /// File to open.
    Open,
    /// File or folder to save.
    Save,
}

/// Time within which nobody closes a dialog: then there was none.
const FASTEST_ANSWER: Duration = Duration::from_millis(300);

impl Viewer {
    /// Asks the question in a dialog of the desktop, which is answered by [`Event::Chosen`].
    pub(crate) fn ask_system(&self, question: SystemQuestion) {
        // Created on the thread of the window, as macOS requires, and awaited on another.
        match question {
            SystemQuestion::Open => {
                let dialog = AsyncFileDialog::new()
                    .set_title("Open")
                    .set_directory(self.open_list.dir())
                    .add_filter("Files that headbox shows", &self.open_list.extensions)
                    .pick_file();
                self.await_answer(question, dialog);
            }
            SystemQuestion::Save => {
                let Some((dir, name, title)) = self.save_dialog.proposal() else {
                    return;
                };
                let dialog = AsyncFileDialog::new()
                    .set_title(title)
                    .set_directory(std::path::absolute(dir).unwrap_or_else(|_| dir.into()))
                    .set_file_name(name)
                    .save_file();
                self.await_answer(question, dialog);
            }
        }
    }

    fn await_answer(
        &self,
        question: SystemQuestion,
        dialog: impl Future<Output = Option<FileHandle>> + Send + 'static,
    ) {
        let asked = Instant::now();
        self.session.send_later(move || {
            let path = pollster::block_on(dialog).map(|file| file.path().to_owned());
            let is_shown = path.is_some() || asked.elapsed() > FASTEST_ANSWER;
            Event::Chosen {
                question,
                path,
                is_shown,
            }
        });
    }

    /// Handles the answer of a dialog.
    pub(crate) fn handle_chosen(
        &mut self,
        question: SystemQuestion,
        path: Option<PathBuf>,
        is_shown: bool,
        now_s: f64,
    ) {
        match (question, path) {
            (SystemQuestion::Open, Some(path)) => {
                self.open_list.is_open = false;
                self.commands.push(Command::Open(Location::File(path)));
            }
            (SystemQuestion::Save, Some(path)) => {
                self.commands.extend(self.save_dialog.choose(&path));
            }
            (_, None) if !is_shown => {
                let text = "The desktop has no file dialog to offer; this list has all files, too.";
                self.messages.add(Kind::Done, text, now_s);
            }
            (_, None) => {}
        }
    }
}
