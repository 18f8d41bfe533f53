//! File list for opening. Drawn by the window itself, so that it also works remotely and without a
//! desktop.

use crate::input::keymap::Command;
use crate::playback::recent::RecentFiles;
use crate::thread::exchange::Location;
use crate::window::system_dialog::SystemQuestion;
use egui::{
    Button, Context, Image, Key, Label, RichText, ScrollArea, TextEdit, TextureHandle, Ui, vec2,
};
use std::path::{Path, PathBuf};

/// Size of the thumbnail of a row, points.
const PICTURE_POINTS: egui::Vec2 = vec2(56.0, 42.0);

/// State of the list.
#[derive(Default)]
pub(crate) struct OpenList {
    pub is_open: bool,
    /// Extensions of the files that are listed (any case), without the dot.
    pub extensions: Vec<String>,
    dir: PathBuf,
    contents: Contents,
    /// Message if `dir` cannot be listed or the path does not exist.
    error: Option<String>,
    /// Text of the path field.
    path: String,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Contents {
    pub(super) folders: Vec<String>,
    files: Vec<String>,
}

impl OpenList {
    pub(crate) fn toggle(&mut self) {
        self.is_open = !self.is_open;
        if self.is_open {
            let dir = if self.dir.as_os_str().is_empty() {
                std::env::current_dir()
            } else {
                Ok(self.dir.clone())
            };
            self.go(dir.unwrap_or_else(|_| PathBuf::from("/")));
        }
    }

    /// Folder that is listed.
    pub(crate) fn dir(&self) -> &Path {
        &self.dir
    }

    fn go(&mut self, dir: PathBuf) {
        let listed = list(&dir, &self.extensions);
        self.error = listed
            .as_ref()
            .err()
            .map(|e| format!("Cannot list {}: {e}.", dir.display()));
        self.contents = listed.unwrap_or_default();
        self.path = dir.display().to_string();
        self.dir = dir;
    }

    /// Goes to `path` if it is a folder; returns it if it is a file.
    pub(crate) fn enter_path(&mut self, path: &str) -> Option<PathBuf> {
        let path = self.dir.join(path.trim());
        if path.is_dir() {
            self.go(path);
            return None;
        }
        if path.is_file() {
            return Some(path);
        }
        self.error = Some(format!("There is no {}.", path.display()));
        None
    }
}

/// Lists folders and files with one of the extensions in `dir`, by name, without hidden ones.
pub(super) fn list(dir: &Path, extensions: &[String]) -> std::io::Result<Contents> {
    let mut contents = Contents::default();
    for entry in std::fs::read_dir(dir)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with('.') {
            continue;
        }
        // Links are followed.
        if entry.path().is_dir() {
            contents.folders.push(name);
        } else if entry.path().extension().is_some_and(|e| {
            extensions
                .iter()
                .any(|wanted| e.eq_ignore_ascii_case(wanted))
        }) {
            contents.files.push(name);
        }
    }
    contents.folders.sort_unstable();
    contents.files.sort_unstable();
    Ok(contents)
}

/// Shows the list in its own window while it is open.
pub(crate) fn show(
    ctx: &Context,
    list: &mut OpenList,
    recent: &mut RecentFiles,
    commands: &mut Vec<Command>,
) {
    if !list.is_open {
        return;
    }
    let (mut is_open, mut next_dir, mut chosen) = (list.is_open, None, None);
    let room = ctx.content_rect().size() - vec2(40.0, 90.0);
    let size = vec2(420.0, 360.0).min(room).max(vec2(80.0, 60.0));
    crate::panels::dialog(ctx, "Open", &mut is_open)
        .default_size(size)
        .show(ctx, |ui| {
            ui.horizontal(|ui| {
                if ui
                    .button("Up")
                    .on_hover_text("Goes to the folder above.")
                    .clicked()
                {
                    next_dir = list.dir.parent().map(Path::to_owned);
                }
                let ask = Command::AskSystem(SystemQuestion::Open);
                crate::panels::button(
                    ui,
                    "Browse…",
                    "Opens the dialog of the desktop.",
                    ask,
                    commands,
                );
                let field = TextEdit::singleline(&mut list.path)
                    .desired_width(f32::INFINITY)
                    .hint_text("Path");
                let field = ui
                    .add(field)
                    .on_hover_text("A folder or file; Enter goes there or opens it.");
                if field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter)) {
                    chosen = list.enter_path(&list.path.clone());
                }
            });
            ui.add(
                Label::new(
                    RichText::new(format!("Files of type {}", list.extensions.join(", "))).weak(),
                )
                .wrap(),
            );
            ui.separator();
            ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
                if let Some(error) = &list.error {
                    ui.label(error);
                }
                for folder in &list.contents.folders {
                    if row(ui, None, &format!("{folder}/"), "Opens this folder.") {
                        next_dir = Some(list.dir.join(folder));
                    }
                }
                for file in &list.contents.files {
                    if row(ui, None, file, "Opens this file.") {
                        chosen = Some(list.dir.join(file));
                    }
                }
                let recent = recent.with_thumbnails(ctx);
                if !recent.is_empty() {
                    ui.separator();
                    ui.weak("Opened last");
                }
                for (path, picture) in recent {
                    let text = path.display().to_string();
                    if row(ui, picture.as_ref(), &text, "Opens this file again.") {
                        chosen = Some(path);
                    }
                }
            });
        });
    list.is_open = is_open && chosen.is_none();
    if let Some(dir) = next_dir {
        list.go(dir);
    }
    commands.extend(chosen.map(|path| Command::Open(Location::File(path))));
}

/// Shows a row of the list that is clickable over its whole width; returns true if it was clicked.
pub(in crate::panels) fn row(
    ui: &mut Ui,
    picture: Option<&TextureHandle>,
    text: &str,
    tooltip: &str,
) -> bool {
    let button = match picture {
        Some(picture) => {
            let picture = Image::new(picture).fit_to_exact_size(PICTURE_POINTS);
            Button::selectable(false, (picture, text))
        }
        None => Button::selectable(false, text),
    };
    let row = button.truncate().min_size(vec2(ui.available_width(), 0.0));
    ui.add(row).on_hover_text(tooltip).clicked()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_folders_and_matching_files() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["b.ldi", "a.LDI", "c.png", ".hidden.ldi", "noextension"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        std::fs::create_dir(dir.path().join("folder")).unwrap();
        let contents = list(dir.path(), &["ldi".into()]).unwrap();
        assert_eq!(contents.folders, ["folder"]);
        assert_eq!(contents.files, ["a.LDI", "b.ldi"]);
        assert!(list(&dir.path().join("none"), &[]).is_err());
    }
}
