//! Sweet Home 3D homes: rooms become cells, doors and windows portals.

use super::additions;
use super::doors::{DoorGroups, assign_groups};
use super::export_file::{bounds_of, find_export};
use super::plain::PlainHome;
use super::plan::home::Home;
use super::plan::unsupported::Unsupported;
use super::rooms::{add_portal, room_cells};
use crate::load::assign::assign_triangles;
use crate::load::{LoadedModel, ModelOptions};
use crate::{Cell, PortalModel};
use glam::DVec3;
use headbox_core::color::linear_from_srgb8;
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_core::memory::{self, Reservation};
use headbox_core::read_note::ReadNote;
use headbox_scene::load::obj::load_text as load_obj_text;
use headbox_scene::load::{GroupedScene, LoadError, LoadOptions, file_stem, load_grouped, read};
use headbox_scene::scene::{Sky, SkyGradient};
use std::collections::BTreeSet;
use std::io::{Cursor, Read};
use std::path::Path;

/// Metres per unit of a home.
pub(super) const UNIT_M: f64 = 0.01;

/// Maximum size of a `Home.xml`, bytes; a longer one is damaged.
const MAX_XML_BYTES: u64 = 1 << 28;

/// Parses the home in a file: an archive, or a plan alone.
fn parse(path: &Path, bytes: &[u8]) -> Result<Home, LoadError> {
    let malformed = |cause: String| LoadError::malformed(path, cause);
    let unpacked = if bytes.starts_with(b"PK") {
        Some(unpack(bytes).map_err(malformed)?)
    } else {
        None
    };
    if unpacked.is_none()
        && !bytes.trim_ascii_start().starts_with(b"<")
        && !bytes.starts_with(b"\xef\xbb\xbf")
    {
        return Err(malformed(
            "neither a Sweet Home 3D archive (ZIP) nor the plan in one (XML)".into(),
        ));
    }
    Home::parse(&String::from_utf8_lossy(
        unpacked.as_ref().map_or(bytes, |(text, _)| text),
    ))
    .map_err(malformed)
}

pub(crate) fn load(path: &Path, options: &ModelOptions) -> Result<LoadedModel, LoadError> {
    let bytes = read(path)?;
    let is_archive = bytes.starts_with(b"PK");
    let mut home = parse(path, &bytes)?;
    let mut notes = Vec::new();
    home.raise_ceilings();
    match home.restore_ceilings() {
        0 => {}
        count => notes.push(format!(
            "no room has a ceiling: one is added to {count} with walls around (in Sweet Home 3D: \
             Plan > Modify rooms > Display ceiling)"
        )),
    }
    let outlines = home.rooms.iter().flat_map(|room| room.outline.iter());
    let walls = home.walls.iter().flat_map(|wall| [&wall.start, &wall.end]);
    let bounds = bounds_of(outlines.chain(walls).copied());
    let export = find_export(path, bounds, &mut notes);
    let has_export = matches!(export, Ok(Some(_)));
    let grouped = match export {
        Ok(Some(obj)) => load_grouped(
            &obj,
            &LoadOptions {
                up: Some(UpAxis::Y),
                unit_m: Some(UNIT_M),
            },
        )?,
        Ok(None) => build_from_plan(path, &home, &bytes, &mut notes)?,
        Err(_) if is_archive => build_from_plan(path, &home, &bytes, &mut notes)?,
        Err(cause) => return Err(LoadError::malformed(path, cause)),
    };

    let mut scene = grouped.scene;
    if has_export {
        for room in home.rooms.iter().filter(|room| room.ceiling_is_new) {
            let corners: Vec<DVec3> = room
                .ceiling_corners()
                .into_iter()
                .map(|corner| corner * UNIT_M)
                .collect();
            additions::ceiling(&mut scene, &corners);
        }
    }
    scene.sky = Some(sky(&home));
    note_light(&home, &mut notes);
    let mut cells = room_cells(&home, &mut notes);
    let outside = cells.len() as u32;
    cells.push(Cell::new("Outside", Vec::new()));
    let mut model = PortalModel {
        scene,
        cells,
        portals: Vec::new(),
        outside: Some(outside),
    };
    for opening in &home.openings {
        add_portal(&mut model, opening);
    }
    if home.unreadable > 0 {
        notes.push(format!(
            "{} rooms, walls, doors, windows or pieces of furniture with a missing number left out",
            home.unreadable
        ));
    }

    let findings = model.with_tracer(PortalModel::open_borders);
    let doors = DoorGroups::find(&model, &home, &grouped.groups);
    let portions = assign_groups(&model, &grouped.groups, &doors, options, &mut notes);
    let notes = notes.into_iter().map(ReadNote::from);
    model.scene.summary.notes.extend(notes);
    model.scene.name = file_stem(path);
    assign_triangles(&mut model, &grouped.groups, &portions);
    Ok(LoadedModel::new(model, findings))
}

/// Returns a sky and ground in the home's colours, as bright as with the default sun.
fn sky(home: &Home) -> Sky {
    /// Default colours of sky and ground in Sweet Home 3D, sRGB.
    const SKY: [u8; 3] = [204, 228, 252];
    const GROUND: [u8; 3] = [168; 3];
    /// Radiance of white level ground under sun and sky.
    const GROUND_RADIANCE: f32 = 1.2;
    let horizon = home.sky_color.unwrap_or(SKY.map(linear_from_srgb8));
    let ground = home.ground_color.unwrap_or(GROUND.map(linear_from_srgb8));
    Sky::Gradient(SkyGradient {
        // A clear sky is darker at the zenith.
        zenith: horizon.map(|c| c * c),
        horizon,
        ground: ground.map(|c| c * GROUND_RADIANCE),
    })
}

/// Builds the geometry of a home without an export.
fn build_from_plan(
    path: &Path,
    home: &Home,
    archive: &[u8],
    notes: &mut Vec<String>,
) -> Result<GroupedScene, LoadError> {
    let mut plain = PlainHome::new(home, archive);
    if let Some(cause) = plain.archive.over_budget.take() {
        return Err(LoadError::malformed(path, cause));
    }
    notes.push(
        "no OBJ export in its folder: the geometry is built from the plan (for all details, choose \
         3D view > Export to OBJ format in Sweet Home 3D and save to the same folder)"
            .into(),
    );
    if !plain.boxes.is_empty() {
        notes.push(boxes_note(&plain));
    }
    note_unsupported(home, notes);
    load_obj_text(
        path,
        &plain.text,
        &plain.materials,
        &plain.pictures,
        FileFrame {
            unit_m: UNIT_M,
            ..FileFrame::default()
        },
    )
}

/// Returns the note on furniture shown as boxes.
fn boxes_note(plain: &PlainHome) -> String {
    let cause = if plain.archive.is_present() {
        "the archive has no OBJ that can be read"
    } else {
        "models are read from an archive (.sh3d) only"
    };
    let what = match plain.boxes.len() {
        1 => "1 piece of furniture is shown as a box".into(),
        count => format!("{count} pieces of furniture are shown as boxes"),
    };
    let names: BTreeSet<&str> = plain.boxes.iter().map(String::as_str).collect();
    let names: Vec<&str> = names.into_iter().filter(|name| !name.is_empty()).collect();
    ReadNote::with_names(&format!("{what}, because {cause}"), &names, 5).to_string()
}

/// Adds the note that a number of things is not built, if there are any.
fn report(count: usize, one: &str, many: &str, what: &str, notes: &mut Vec<String>) {
    if count > 0 {
        let noun = if count == 1 { one } else { many };
        notes.push(format!("{count} {noun} {what}"));
    }
}

/// Reports what of a home's light neither a plan nor an export has.
fn note_light(home: &Home, notes: &mut Vec<String>) {
    let Unsupported {
        lights, compasses, ..
    } = home.unsupported;
    report(lights, "lamp", "lamps", "whose light is left out", notes);
    report(
        compasses,
        "compass",
        "compasses",
        "whose north is ignored: suns are placed as if it were upward in the plan",
        notes,
    );
}

/// Reports what of a plan is not built.
fn note_unsupported(home: &Home, notes: &mut Vec<String>) {
    let mut report = |count, one, many, what| report(count, one, many, what, notes);
    let Unsupported {
        staircases,
        shaped_openings,
        moved_parts,
        baseboards,
        polylines,
        labels,
        lights: _,
        compasses: _,
    } = home.unsupported;
    report(
        staircases,
        "staircase",
        "staircases",
        "whose opening in floors and ceilings is not cut",
    );
    report(
        shaped_openings,
        "door or window",
        "doors or windows",
        "with a hole of another shape or size, cut as the whole rectangle",
    );
    report(
        moved_parts,
        "piece of furniture",
        "pieces of furniture",
        "with moved parts, shown in the pose of the model",
    );
    report(baseboards, "baseboard", "baseboards", "left out");
    report(polylines, "polyline", "polylines", "in 3D left out");
    report(labels, "label", "labels", "in 3D left out");
    report(
        home.rooms_under_slopes(),
        "room",
        "rooms",
        "below the topmost storey with sloping walls, built with a level ceiling",
    );
}

/// Reads the `Home.xml` of an archive, and reserves the memory of its tree.
fn unpack(bytes: &[u8]) -> Result<(Vec<u8>, Reservation), String> {
    /// Memory of the tree for each byte of the text: an element of four characters has 64 bytes.
    const MEMORY_PER_BYTE: u64 = 16;
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes))
        .map_err(|cause| format!("damaged archive: {cause}"))?;
    let entry = archive.by_name("Home.xml").map_err(|_| {
        "it has no Home.xml; save the home with Sweet Home 3D 5.3 or later, which writes one"
            .to_owned()
    })?;
    let size = entry.size();
    if size > MAX_XML_BYTES {
        return Err(format!(
            "its Home.xml has {size} bytes, more than {MAX_XML_BYTES}"
        ));
    }
    let memory =
        memory::reserve(size * MEMORY_PER_BYTE).map_err(|cause| format!("its Home.xml {cause}"))?;
    let mut text = Vec::new();
    entry
        .take(size)
        .read_to_end(&mut text)
        .map_err(|cause| format!("its Home.xml cannot be read: {cause}"))?;
    Ok((text, memory))
}
