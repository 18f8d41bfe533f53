//! Search for the OBJ export of a home.

use headbox_core::files::InputFolder;
use headbox_scene::load::{extension_of, file_stem, folder_of, read};
use std::path::{Path, PathBuf};

/// Finds the OBJ export of a plan: with its name, `home.obj`, or the only OBJ in its folder with
/// the groups of a home.
pub(super) fn find_export(plan: &Path, notes: &mut Vec<String>) -> Result<Option<PathBuf>, String> {
    let folder = if folder_of(plan) == Path::new("") {
        Path::new(".")
    } else {
        folder_of(plan)
    };
    let entries =
        std::fs::read_dir(folder).map_err(|cause| format!("its folder cannot be read: {cause}"))?;
    let mut all: Vec<PathBuf> = entries
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .collect();
    all.retain(|path| extension_of(path) == "obj");
    all.sort();
    let home = InputFolder::new(folder);
    all.retain(|path| match home.check(path) {
        Ok(()) => true,
        Err(refusal) => {
            notes.push(format!("{} is not used: it {refusal}", path.display()));
            false
        }
    });
    let stem = |path: &Path| file_stem(path).to_lowercase();
    let file_name = |path: &Path| {
        let name = path.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    };
    let names = [stem(plan), "home".to_owned()];
    let named = names
        .iter()
        .find_map(|name| all.iter().find(|path| stem(path) == *name));
    if let Some(path) = named {
        if !is_export(path) {
            notes.push(format!(
                "{} is used as the export of the home because of its name, although it has no \
                 group of a room or wall (room_1_1, wall_1_1)",
                file_name(path)
            ));
        }
        return Ok(Some(path.clone()));
    }
    let (exports, others): (Vec<PathBuf>, Vec<PathBuf>) =
        all.into_iter().partition(|path| is_export(path));
    match exports.as_slice() {
        [only] => Ok(Some(only.clone())),
        [] => {
            if let Some(first) = others.first() {
                notes.push(format!(
                    "{} OBJ {} in its folder not used because no group of it is a room or wall of \
                     a home (room_1_1, wall_1_1): {}{}",
                    others.len(),
                    if others.len() == 1 { "file" } else { "files" },
                    file_name(first),
                    if others.len() == 1 { "" } else { ", ..." },
                ));
            }
            Ok(None)
        }
        several => Err(format!(
            "{} OBJ files are in its folder; rename its export to home.obj",
            several.len()
        )),
    }
}

/// Returns true if an OBJ has a group of a room or a wall, as exports of Sweet Home 3D have. A file
/// that cannot be read is one, so that loading it reports the error.
fn is_export(path: &Path) -> bool {
    let Ok(bytes) = read(path) else {
        return true;
    };
    bytes
        .split(|&byte| byte == b'\n' || byte == b'\r')
        .any(|line| {
            let line = line.trim_ascii_start();
            let name = line.strip_prefix(b"g ").or(line.strip_prefix(b"o "));
            name.map(<[u8]>::trim_ascii_start).is_some_and(|name| {
                [b"room_".as_slice(), b"wall_"].iter().any(|prefix| {
                    name.starts_with(prefix) && name.get(5).is_some_and(u8::is_ascii_digit)
                })
            })
        })
}
