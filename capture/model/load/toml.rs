//! TOML portal models; the format is described at [`super::load_model`].

use super::LoadedModel;
use super::assign::{Portion, assign_triangles};
use crate::{Cell, Portal, PortalModel, Prism};
use glam::{DVec2, DVec3};
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_core::files::InputFolder;
use headbox_scene::load::{LoadError, LoadOptions, file_stem, folder_of, load_grouped, read};
use serde::Deserialize;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileModel {
    name: Option<String>,
    #[serde(default)]
    up: Up,
    #[serde(default = "one")]
    unit: f64,
    scene: PathBuf,
    #[serde(default)]
    cell: Vec<FileCell>,
    #[serde(default)]
    portal: Vec<FilePortal>,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Up {
    #[default]
    Y,
    Z,
}

fn one() -> f64 {
    1.0
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "[[cell]] with a name")]
struct FileCell {
    name: String,
    #[serde(default)]
    groups: Vec<String>,
    #[serde(default)]
    outside: bool,
    #[serde(default)]
    prism: Vec<FilePrism>,
}

#[derive(Deserialize)]
#[serde(
    deny_unknown_fields,
    expecting = "[[cell.prism]] with outline, floor and ceiling"
)]
struct FilePrism {
    outline: Vec<[f64; 2]>,
    floor: f64,
    ceiling: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "[[portal]] with cells and polygon")]
struct FilePortal {
    #[serde(default)]
    name: String,
    cells: [String; 2],
    polygon: Vec<[f64; 3]>,
}

/// Parses a file.
fn parse(path: &Path) -> Result<FileModel, LoadError> {
    let text = String::from_utf8(read(path)?)
        .map_err(|_| LoadError::malformed(path, "it is not UTF-8 text"))?;
    toml::from_str(&text).map_err(|cause| match cause.span() {
        Some(span) => {
            let before = text.get(..span.start).unwrap_or_default();
            LoadError::Line {
                path: path.to_path_buf(),
                line: before.matches('\n').count() + 1,
                cause: cause.message().replace('\n', ", "),
            }
        }
        None => LoadError::malformed(path, cause.message().replace('\n', ", ")),
    })
}

/// Finds the scene file that a model names.
fn find_scene(path: &Path, scene: &Path) -> Result<PathBuf, LoadError> {
    let folder = InputFolder::new(folder_of(path));
    let same = |written: &str| {
        let written = OsString::from(written);
        move |name: &OsStr| name == written
    };
    match folder.find(&[folder.path()], &scene.to_string_lossy(), false, same) {
        Ok(Some(found)) => Ok(found.path),
        Ok(None) => Ok(folder.path().join(scene)),
        Err(refusal) => {
            let cause = format!("scene = \"{}\" {refusal}", scene.display());
            Err(LoadError::malformed(path, cause))
        }
    }
}

pub(super) fn load(path: &Path) -> Result<LoadedModel, LoadError> {
    let file = parse(path)?;
    let up = if matches!(file.up, Up::Z) {
        UpAxis::Z
    } else {
        UpAxis::Y
    };
    let options = LoadOptions {
        up: Some(up),
        unit_m: Some(file.unit),
    };
    let grouped = load_grouped(&find_scene(path, &file.scene)?, &options)?;
    let frame = grouped.scene.frame;

    if file.cell.iter().filter(|cell| cell.outside).count() > 1 {
        return Err(LoadError::malformed(
            path,
            "several cells are the outside; at most one may be",
        ));
    }
    if let Some(twice) = repeated_name(&file.cell) {
        let cause = format!("two cells are called \"{twice}\"; portals need unique names");
        return Err(LoadError::malformed(path, cause));
    }
    let mut cells: Vec<Cell> = file
        .cell
        .iter()
        .map(|cell| convert_cell(cell, &frame))
        .collect();
    let outside = file
        .cell
        .iter()
        .position(|cell| cell.outside)
        .unwrap_or_else(|| {
            cells.push(Cell::new("Outside", Vec::new()));
            cells.len() - 1
        });
    // An unknown name becomes an index after the last cell, which validation reports.
    let find = |name: &String| {
        cells
            .iter()
            .position(|cell| cell.name == *name)
            .unwrap_or(cells.len()) as u32
    };
    let portal = |portal: &FilePortal| Portal {
        name: if portal.name.is_empty() {
            portal.cells.join(" - ")
        } else {
            portal.name.clone()
        },
        cells: [find(&portal.cells[0]), find(&portal.cells[1])],
        polygon: portal
            .polygon
            .iter()
            .map(|&corner| frame.world_from_file(DVec3::from(corner)))
            .collect(),
    };
    let portals = file.portal.iter().map(portal).collect();
    let mut model = PortalModel {
        scene: grouped.scene,
        cells,
        portals,
        outside: Some(outside as u32),
    };
    model.scene.name = file.name.unwrap_or_else(|| file_stem(path));
    let findings = model.with_tracer(PortalModel::open_borders);
    let claimed = |name: &str| {
        file.cell
            .iter()
            .position(|cell| cell.groups.iter().any(|group| matches(group, name)))
    };
    let portions: Vec<Portion> = grouped
        .groups
        .iter()
        .map(|group| {
            claimed(&group.name).map_or(Portion::Facing, |cell| Portion::Cell(cell as u32))
        })
        .collect();
    for portal in &file.portal {
        for missing in portal
            .cells
            .iter()
            .filter(|name| model.cells.iter().all(|cell| cell.name != **name))
        {
            let note = format!(
                "portal \"{}\" leads to an unknown cell \"{missing}\"",
                portal.name
            );
            model.scene.summary.notes.push(note.into());
        }
    }
    for unmatched in file.cell.iter().flat_map(|cell| &cell.groups) {
        if !grouped
            .groups
            .iter()
            .any(|group| matches(unmatched, &group.name))
        {
            model
                .scene
                .summary
                .notes
                .push(format!("the scene file has no group \"{unmatched}\"").into());
        }
    }
    assign_triangles(&mut model, &grouped.groups, &portions);
    Ok(LoadedModel::new(model, findings))
}

fn repeated_name(cells: &[FileCell]) -> Option<&str> {
    cells
        .iter()
        .enumerate()
        .find(|(i, cell)| cells[..*i].iter().any(|other| other.name == cell.name))
        .map(|(_, cell)| cell.name.as_str())
}

fn convert_cell(cell: &FileCell, frame: &FileFrame) -> Cell {
    let corner = |&[x, y]: &[f64; 2]| {
        let in_plan = match frame.up {
            UpAxis::Y => DVec3::new(x, 0.0, y),
            UpAxis::Z => DVec3::new(x, y, 0.0),
        };
        let p = frame.world_from_file(in_plan);
        DVec2::new(p.x, p.z)
    };
    let prism = |prism: &FilePrism| Prism {
        outline: prism.outline.iter().map(corner).collect(),
        floor_y: prism.floor * frame.unit_m,
        ceiling_y: prism.ceiling * frame.unit_m,
    };
    Cell::new(&cell.name, cell.prism.iter().map(prism).collect())
}

/// Returns true if a name matches a pattern in which `*` stands for any text.
fn matches(pattern: &str, name: &str) -> bool {
    let mut parts = pattern.split('*');
    let first = parts.next().unwrap_or_default();
    let Some(mut rest) = name.strip_prefix(first) else {
        return false;
    };
    let parts: Vec<&str> = parts.collect();
    let Some((last, middle)) = parts.split_last() else {
        return rest.is_empty();
    };
    for part in middle {
        match rest.find(part) {
            Some(at) => rest = &rest[at + part.len()..],
            None => return false,
        }
    }
    rest.ends_with(last)
}

#[cfg(test)]
mod tests {
    use super::{FileModel, matches};

    #[test]
    fn wrong_types_are_named_as_in_the_file() {
        let message = |text: &str| {
            let parsed: Result<FileModel, _> = toml::from_str(text);
            parsed.err().unwrap().message().to_owned()
        };
        let prism = message("scene = 'a.obj'\n[[cell]]\nname = 'a'\nprism = [1]");
        assert!(prism.contains("[[cell.prism]] with outline"), "{prism}");
        let cell = message("scene = 'a.obj'\ncell = [1]");
        assert!(cell.contains("[[cell]] with a name"), "{cell}");
        let portal = message("scene = 'a.obj'\nportal = [1]");
        assert!(portal.contains("[[portal]] with cells"), "{portal}");
    }

    #[test]
    fn star_matches_anything() {
        for (pattern, name, fits) in [
            ("hall", "hall", true),
            ("hall", "hallway", false),
            ("hall*", "hallway", true),
            ("*", "", true),
            ("*_wall", "hall_wall", true),
            ("*_wall", "hall_walls", false),
            ("h*l*y", "hallway", true),
            ("h*z*y", "hallway", false),
            ("ab*ba", "aba", false),
        ] {
            assert_eq!(matches(pattern, name), fits, "{pattern} {name}");
        }
    }
}
