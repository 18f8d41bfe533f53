//! A small list of files to open. Drawn by the window itself, so that it also works remotely and without a desktop.

use crate::{keymap::Command, session::Location};
use egui::{Context, ScrollArea};
use std::path::{Path, PathBuf};

/// State of the list.
#[derive(Default)]
pub(crate) struct OpenList {
    is_open: bool,
    dir: PathBuf,
    contents: Contents,
    /// Why `dir` cannot be listed.
    error: Option<String>,
    extensions: Vec<String>,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Contents {
    folders: Vec<String>,
    files: Vec<String>,
}

impl OpenList {
    /// Only files with these extensions (any case) are listed.
    pub(crate) fn set_extensions(&mut self, extensions: Vec<String>) {
        self.extensions = extensions;
    }

    pub(crate) fn toggle(&mut self) {
        self.is_open = !self.is_open;
        if self.is_open {
            let dir = if self.dir.as_os_str().is_empty() { std::env::current_dir() } else { Ok(self.dir.clone()) };
            self.go(dir.unwrap_or_else(|_| PathBuf::from("/")));
        }
    }

    pub(crate) fn close(&mut self) {
        self.is_open = false;
    }

    fn go(&mut self, dir: PathBuf) {
        let listed = list(&dir, &self.extensions);
        self.error = listed.as_ref().err().map(|e| format!("Cannot list {}: {e}.", dir.display()));
        self.contents = listed.unwrap_or_default();
        self.dir = dir;
    }
}

/// Folders and fitting files of `dir`, by name; hidden ones left out.
fn list(dir: &Path, extensions: &[String]) -> std::io::Result<Contents> {
    let mut contents = Contents::default();
    for entry in std::fs::read_dir(dir)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with('.') {
            continue;
        }
        // Links count as what they lead to.
        if entry.path().is_dir() {
            contents.folders.push(name);
        } else if entry
            .path()
            .extension()
            .is_some_and(|e| extensions.iter().any(|wanted| e.eq_ignore_ascii_case(wanted)))
        {
            contents.files.push(name);
        }
    }
    contents.folders.sort_unstable();
    contents.files.sort_unstable();
    Ok(contents)
}

/// The list in a window of its own, while open.
pub(crate) fn show(ctx: &Context, list: &mut OpenList, commands: &mut Vec<Command>) {
    let (mut is_open, mut next_dir, mut chosen) = (list.is_open, None, None);
    super::dialog(ctx, "Open", &mut is_open).default_size([420.0, 360.0]).show(ctx, |ui| {
        ui.horizontal(|ui| {
            if ui.button("Up").on_hover_text("Goes to the folder above.").clicked() {
                next_dir = list.dir.parent().map(Path::to_owned);
            }
            ui.label(list.dir.display().to_string());
        });
        ui.weak(format!("Files of type {}", list.extensions.join(", ")));
        ui.separator();
        ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            if let Some(error) = &list.error {
                ui.label(error);
            }
            for folder in &list.contents.folders {
                let text = format!("{folder}/");
                if ui.selectable_label(false, text).on_hover_text("Opens this folder.").clicked() {
                    next_dir = Some(list.dir.join(folder));
                }
            }
            for file in &list.contents.files {
                if ui.selectable_label(false, file).on_hover_text("Opens this file.").clicked() {
                    chosen = Some(list.dir.join(file));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_folders_and_fitting_files() {
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
