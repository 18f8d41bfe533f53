//! Search for the OBJ export of a home.

use glam::DVec2;
use headbox_core::files::InputFolder;
use headbox_scene::load::{extension_of, file_stem, folder_of, read};
use std::path::{Path, PathBuf};

/// Finds the OBJ export of a plan: with its name, `home.obj`, or the only OBJ in its folder with
/// the groups of a home. One with the name of another home, or away from the plan, is not its
/// export; `bounds` are those of the plan, centimetres.
pub(super) fn find_export(
    plan: &Path,
    bounds: Option<[DVec2; 2]>,
    notes: &mut Vec<String>,
) -> Result<Option<PathBuf>, String> {
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
    let stem = |path: &Path| file_stem(path).to_lowercase();
    let other_homes: Vec<String> = all
        .iter()
        .filter(|path| extension_of(path) == "sh3d")
        .map(|path| stem(path))
        .filter(|name| *name != stem(plan))
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
    let file_name = |path: &Path| {
        let name = path.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    };
    all.retain(|path| {
        let cause = if other_homes.contains(&stem(path)) {
            "it has the name of another home"
        } else if is_export(path) && bounds.is_some_and(|it| is_away(path, it)) {
            "it lies away from the plan"
        } else {
            return true;
        };
        let name = file_name(path);
        notes.push(format!(
            "{name} is not used as the export of the home: {cause}"
        ));
        false
    });
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

/// Returns true if no part of an OBJ is above or below the bounds of a plan.
fn is_away(path: &Path, [low, high]: [DVec2; 2]) -> bool {
    let bytes = read(path).unwrap_or_default();
    let position = |line: &[u8]| {
        let line = std::str::from_utf8(line.trim_ascii()).ok()?;
        let mut numbers = line.strip_prefix("v ")?.split_whitespace();
        let mut next = || numbers.next()?.parse::<f64>().ok();
        let (x, _, z) = (next()?, next()?, next()?);
        Some(DVec2::new(x, z))
    };
    let positions = bytes
        .split(|&byte| byte == b'\n' || byte == b'\r')
        .filter_map(position);
    bounds_of(positions).is_some_and(|[from, to]| from.cmpgt(high).any() || to.cmplt(low).any())
}

/// Returns the bounding box of points; `None` if there is none.
pub(crate) fn bounds_of(points: impl Iterator<Item = DVec2>) -> Option<[DVec2; 2]> {
    points
        .map(|p| [p, p])
        .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
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
