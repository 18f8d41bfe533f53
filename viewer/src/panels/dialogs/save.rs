//! Dialog that asks where to save. A file that exists is replaced only after a second click.

use crate::input::keymap::Command;
use crate::panels::dialogs::open::{list, row};
use crate::playback::export;
use crate::thread::exchange::ExportOrder;
use crate::window::system_dialog::SystemQuestion;
use egui::{Button, Context, Key, Label, RichText, ScrollArea, TextEdit, Ui, vec2};
use std::io;
use std::path::{Path, PathBuf};

/// File that waits for its name.
pub(crate) struct PendingSave {
    pub title: &'static str,
    /// Start of the proposed name.
    pub stem: String,
    /// Extension of the file or folder, without the dot.
    pub extension: &'static str,
    pub content: SaveContent,
}

/// Function that writes a file.
pub(crate) type WriteFile = Box<dyn FnOnce(&Path) -> io::Result<()> + Send>;

/// Content of a file or folder.
pub(crate) enum SaveContent {
    /// A file.
    File(WriteFile),
    /// The file of a button of the source's panel, by the button's id.
    Source(&'static str),
    /// A path, rendered to files in a new folder.
    Frames(ExportOrder),
}

/// State of the dialog.
#[derive(Default)]
pub(crate) struct SaveDialog {
    /// `None` if the dialog is closed.
    pending: Option<PendingSave>,
    /// Folder to save in; the last one that was used.
    dir: PathBuf,
    name: String,
    folders: Vec<String>,
    error: Option<String>,
    /// Existing file that the user may replace.
    existing: Option<PathBuf>,
    /// True until the field has the focus.
    wants_focus: bool,
}

impl SaveDialog {
    pub(crate) fn new(dir: PathBuf) -> Self {
        Self {
            dir,
            ..Self::default()
        }
    }

    pub(crate) fn is_open(&self) -> bool {
        self.pending.is_some()
    }

    /// Asks where to save, and proposes a name that does not exist.
    pub(crate) fn ask(&mut self, pending: PendingSave) {
        let proposed = export::free_name(&self.dir, &pending.stem, pending.extension);
        let name = proposed.file_name().unwrap_or_default();
        self.name = name.to_string_lossy().into_owned();
        self.wants_focus = true;
        self.pending = Some(pending);
        self.go(self.dir.clone());
    }

    pub(crate) fn close(&mut self) {
        self.pending = None;
    }

    /// Closes the dialog and returns what is to be saved.
    pub(crate) fn take(&mut self) -> Option<PendingSave> {
        self.pending.take()
    }

    /// Folder, name and title while the dialog is open.
    pub(crate) fn proposal(&self) -> Option<(&Path, &str, &'static str)> {
        let pending = self.pending.as_ref()?;
        Some((&self.dir, &self.name, pending.title))
    }

    /// Returns the command that saves at the path that the desktop's dialog has returned; that
    /// dialog has asked whether a file is to be replaced.
    pub(crate) fn choose(&mut self, path: &Path) -> Option<Command> {
        self.name = path.to_string_lossy().into_owned();
        // With another extension it would be another file.
        let extension = self.pending.as_ref()?.extension;
        let is_same = path.extension().is_some_and(|own| own == extension);
        self.confirm(is_same)
    }

    fn go(&mut self, dir: PathBuf) {
        self.existing = None;
        // A folder that does not exist yet is created by saving.
        self.error = None;
        self.folders = list(&dir, &[]).map_or_else(|_| Vec::new(), |contents| contents.folders);
        self.dir = dir;
    }

    /// Returns the command that saves under the name in the field, or goes to the folder of that
    /// name, or shows why it cannot be saved there.
    fn confirm(&mut self, replace: bool) -> Option<Command> {
        let pending = self.pending.as_ref()?;
        let mut path = self.dir.join(self.name.trim());
        let is_file = !matches!(pending.content, SaveContent::Frames(_));
        self.error = None;
        if is_file && path.is_dir() {
            self.name.clear();
            self.go(path);
            return None;
        }
        match path.extension() {
            None => drop(path.set_extension(pending.extension)),
            Some(other) if is_file && !other.eq_ignore_ascii_case(pending.extension) => {
                self.error = Some(format!("This is saved as .{}.", pending.extension));
                return None;
            }
            Some(_) => {}
        }
        // The link counts, not its target: what is there stays.
        if path.symlink_metadata().is_ok() && !replace {
            if is_file {
                self.existing = Some(path);
            } else {
                self.error = Some(format!("{} exists; choose another name.", path.display()));
            }
            return None;
        }
        if let Some(parent) = path.parent() {
            self.dir = parent.into();
        }
        Some(Command::Save { path, replace })
    }
}

/// Shows the dialog while something is to be saved.
pub(crate) fn show(ctx: &Context, dialog: &mut SaveDialog, commands: &mut Vec<Command>) {
    let Some(pending) = &dialog.pending else {
        return;
    };
    let (title, mut is_open) = (pending.title, true);
    let room = ctx.content_rect().size() - vec2(40.0, 90.0);
    let size = vec2(420.0, 260.0).min(room).max(vec2(80.0, 60.0));
    crate::panels::dialog(ctx, title, &mut is_open)
        .default_size(size)
        .show(ctx, |ui| commands.extend(contents(ui, dialog)));
    if !is_open || ctx.input(|i| i.key_pressed(Key::Escape)) {
        dialog.close();
    }
}

fn contents(ui: &mut Ui, dialog: &mut SaveDialog) -> Option<Command> {
    let (mut command, mut next_dir) = (None, None);
    ui.horizontal(|ui| {
        if ui
            .button("Up")
            .on_hover_text("Goes to the folder above.")
            .clicked()
        {
            let dir = std::path::absolute(&dialog.dir);
            next_dir = dir.ok().and_then(|dir| Some(dir.parent()?.to_owned()));
        }
        let dir = RichText::new(dialog.dir.display().to_string()).weak();
        ui.add(Label::new(dir).truncate());
    });
    ui.horizontal(|ui| {
        let field = TextEdit::singleline(&mut dialog.name).desired_width(250.0);
        let field = ui
            .add(field)
            .on_hover_text("Name of the file, or a path; Enter saves.");
        // A new window refuses the focus until it knows its size.
        if dialog.wants_focus && !field.has_focus() {
            field.request_focus();
        } else {
            dialog.wants_focus = false;
        }
        if field.changed() {
            dialog.existing = None;
        }
        let enter = field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
        let has_name = !dialog.name.trim().is_empty();
        let tip = "Saves under this name (Enter).";
        let save = ui
            .add_enabled(has_name, Button::new("Save"))
            .on_hover_text(tip)
            .on_disabled_hover_text(tip);
        if save.clicked() || enter && has_name {
            command = dialog.confirm(false);
        }
        let browse = ui
            .button("Browse…")
            .on_hover_text("Opens the dialog of the desktop.");
        if browse.clicked() {
            command = Some(Command::AskSystem(SystemQuestion::Save));
        }
    });
    if let Some(existing) = &dialog.existing {
        let name = existing
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        ui.horizontal_wrapped(|ui| {
            ui.colored_label(crate::panels::theme::WARNING, format!("{name} exists."));
            let replace = ui.button("Replace").on_hover_text("Overwrites the file.");
            if replace.clicked() {
                command = dialog.confirm(true);
            }
        });
    }
    if let Some(error) = &dialog.error {
        ui.colored_label(crate::panels::theme::WARNING, error);
    }
    ui.separator();
    ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        for folder in &dialog.folders {
            if row(ui, None, &format!("{folder}/"), "Opens this folder.") {
                next_dir = Some(dialog.dir.join(folder));
            }
        }
    });
    if let Some(dir) = next_dir {
        dialog.go(dir);
    }
    command
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dialog(dir: &Path) -> SaveDialog {
        let mut dialog = SaveDialog::new(dir.into());
        dialog.ask(PendingSave {
            title: "Save frame",
            stem: "frame".into(),
            extension: "png",
            content: SaveContent::File(Box::new(|_| Ok(()))),
        });
        dialog
    }

    fn saved(path: PathBuf, replace: bool) -> Option<Command> {
        Some(Command::Save { path, replace })
    }

    #[test]
    fn free_name_is_proposed() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("frame-0001.png"), "").unwrap();
        let mut dialog = dialog(dir.path());
        assert_eq!(dialog.name, "frame-0002.png");
        let path = dir.path().join("frame-0002.png");
        assert_eq!(dialog.confirm(false), saved(path, false));
    }

    #[test]
    fn existing_file_needs_second_click() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        std::fs::write(&path, "").unwrap();
        let mut dialog = dialog(dir.path());
        dialog.name = "a".into();
        assert_eq!(dialog.confirm(false), None);
        assert_eq!(dialog.existing.as_ref(), Some(&path));
        assert_eq!(dialog.confirm(true), saved(path, true));
    }

    #[test]
    fn chosen_path_is_replaced_only_under_its_name() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        std::fs::write(&path, "").unwrap();
        let mut dialog = dialog(Path::new("elsewhere"));
        assert_eq!(dialog.choose(&dir.path().join("a")), None);
        assert_eq!(dialog.existing.as_ref(), Some(&path));
        assert_eq!(dialog.choose(&path), saved(path, true));
    }

    #[test]
    fn other_formats_are_refused_and_folders_entered() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(dir.path().join("out/deep")).unwrap();
        let mut dialog = dialog(dir.path());
        dialog.name = "a.jpg".into();
        assert_eq!(dialog.confirm(false), None);
        assert_eq!(dialog.error.as_deref(), Some("This is saved as .png."));
        dialog.name = "out".into();
        assert_eq!(dialog.confirm(false), None);
        assert_eq!(dialog.folders, ["deep"]);
        dialog.name = "new/b".into();
        let path = dir.path().join("out/new/b.png");
        assert_eq!(dialog.confirm(false), saved(path, false));
    }
}
