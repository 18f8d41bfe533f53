//! Sweet Home 3D homes: rooms become cells, doors and windows portals.

use super::assign::{Portion, assign_triangles};
use super::export_file::{bounds_of, find_export};
use super::home::{Home, Opening, Room, Unsupported};
use super::leaves::closing_groups;
use super::plain::PlainHome;
use super::{LoadedModel, ModelOptions};
use crate::load::additions;
use crate::{Cell, Portal, PortalModel, Prism};
use glam::{DVec2, DVec3};
use headbox_core::color::linear_from_srgb8;
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_core::memory::{self, Reservation};
use headbox_core::read_note::ReadNote;
use headbox_scene::load::obj::load_text as load_obj_text;
use headbox_scene::load::{
    Group, GroupedScene, LoadError, LoadOptions, file_stem, load_grouped, read,
};
use headbox_scene::scene::{Sky, SkyGradient};
use std::collections::BTreeSet;
use std::io::{Cursor, Read};
use std::path::Path;

/// Metres per unit of a home.
const UNIT_M: f64 = 0.01;

/// Distance from the wall's faces within which a room is searched, centimetres: rooms are often
/// drawn slightly short of walls.
const REACH: f64 = 40.0;
/// Step of the search, centimetres.
const STEP: f64 = 1.0;

/// Greatest height of a door above its room's floor, metres; windows are higher.
const MAX_DOOR_SILL_M: f64 = 0.05;

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

pub(super) fn load(path: &Path, options: &ModelOptions) -> Result<LoadedModel, LoadError> {
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

/// Returns a cell for each room with a ceiling.
fn room_cells(home: &Home, notes: &mut Vec<String>) -> Vec<Cell> {
    let cell = |(index, room): (usize, &Room)| {
        if !room.covered {
            notes.push(format!(
                "{} has no ceiling and is part of the outside",
                room_name(index, room)
            ));
            return None;
        }
        let prism = Prism {
            outline: room.outline.iter().map(|&corner| corner * UNIT_M).collect(),
            floor_y: room.floor * UNIT_M,
            ceiling_y: room.ceiling() * UNIT_M,
        };
        Some(Cell::new(room_name(index, room), vec![prism]))
    };
    home.rooms.iter().enumerate().filter_map(cell).collect()
}

fn room_name(index: usize, room: &Room) -> String {
    if room.name.is_empty() {
        format!("Room {}", index + 1)
    } else {
        room.name.clone()
    }
}

/// Adds the portal of a door or window, and the space in the wall to the rooms on its two sides.
fn add_portal(model: &mut PortalModel, opening: &Opening) {
    let across = opening.across();
    let half = opening.along * (opening.width / 2.0);
    let [bottom, top] = opening.heights;
    let (middle, rooms) = RoomSearch { model, opening }.middle_and_rooms();
    for (found, side) in rooms.into_iter().zip([1.0, -1.0]) {
        if let Some((cell, distance)) = found {
            let far = across * (side * (distance + STEP));
            let outline = [
                middle - half,
                middle + half,
                middle + half + far,
                middle - half + far,
            ];
            let outline = outline.map(|corner| corner * UNIT_M);
            let prism = Prism {
                outline: outline.to_vec(),
                floor_y: bottom * UNIT_M,
                ceiling_y: top * UNIT_M,
            };
            let floor_y = model.cells[cell as usize].space[0].floor_y;
            if (prism.floor_y - floor_y).abs() < MAX_DOOR_SILL_M {
                additions::threshold(&mut model.scene, outline, floor_y);
            }
            model.cells[cell as usize].space.push(prism);
        }
    }
    let corner = |end: DVec2, y: f64| DVec3::new(end.x, y, end.y) * UNIT_M;
    let (left, right) = (middle - half, middle + half);
    // `across` is `along` rotated from x toward z, so that `along x up` is parallel to it, toward
    // the first cell.
    let polygon = vec![
        corner(left, bottom),
        corner(right, bottom),
        corner(right, top),
        corner(left, top),
    ];
    let outside = model.outside.unwrap_or_default();
    let cells = rooms.map(|found| found.map_or(outside, |(cell, _)| cell));
    model.portals.push(Portal {
        name: opening.name.clone(),
        cells,
        polygon,
    });
}

/// Search for the rooms on both sides of an opening.
struct RoomSearch<'a> {
    model: &'a PortalModel,
    opening: &'a Opening,
}

impl RoomSearch<'_> {
    /// Returns the room at a signed distance from the middle of the wall.
    fn room_at(&self, distance: f64) -> Option<u32> {
        let opening = self.opening;
        let at = (opening.in_wall() + opening.across() * distance) * UNIT_M;
        let y = (opening.heights[0] + opening.heights[1]) / 2.0 * UNIT_M;
        self.model
            .cell_at(DVec3::new(at.x, y, at.y))
            .filter(|&cell| self.model.outside != Some(cell))
    }

    /// Returns the nearest room on a side, other than `except`, and its distance from the middle of
    /// the wall.
    fn nearest_room(&self, side: f64, except: Option<u32>) -> Option<(u32, f64)> {
        let steps = ((self.opening.wall_thickness / 2.0 + REACH) / STEP) as usize;
        let mut distances = (1..=steps).map(|step| step as f64 * STEP);
        distances.find_map(|distance| {
            let room = self
                .room_at(side * distance)
                .filter(|&room| Some(room) != except)?;
            Some((room, distance))
        })
    }

    /// Returns the position of the portal, and the rooms in front of and behind it with their
    /// distances: the middle of the wall, or the end of a room that was drawn through the whole
    /// wall.
    fn middle_and_rooms(&self) -> (DVec2, [Option<(u32, f64)>; 2]) {
        let rooms = [1.0, -1.0].map(|side| self.nearest_room(side, None));
        let middle = self.opening.in_wall();
        let (Some((front, _)), Some((back, _))) = (rooms[0], rooms[1]) else {
            return (middle, rooms);
        };
        if front != back {
            return (middle, rooms);
        }
        let beyond = |side: f64| {
            self.nearest_room(side, Some(front))
                .map(|(room, distance)| (room, distance, side))
        };
        let nearer = [beyond(1.0), beyond(-1.0)]
            .into_iter()
            .flatten()
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((room, distance, side)) = nearer else {
            return (middle, rooms);
        };
        let end = (0..)
            .map(|step| f64::from(step) * STEP)
            .take_while(|d| *d < distance)
            .filter(|d| self.room_at(side * d) == Some(front))
            .last()
            .unwrap_or(0.0);
        let mut shifted = [Some((front, 0.0)), Some((room, distance - end))];
        if side > 0.0 {
            shifted.reverse();
        }
        (middle + self.opening.across() * (side * end), shifted)
    }
}

/// Groups of the export that belong to each door or window.
struct DoorGroups {
    /// Opening of each group.
    opening: Vec<Option<usize>>,
    /// True for each group that closes its opening.
    closes: Vec<bool>,
}

impl DoorGroups {
    /// Finds the openings of groups. The names of the groups of one piece have the same prefix,
    /// `door_7_`; the piece is the nearest opening.
    fn find(model: &PortalModel, home: &Home, groups: &[Group]) -> Self {
        /// Greatest distance of a door from its opening in the plan, metres.
        const NEAR: f64 = 0.5;
        let mut doors = Self {
            opening: vec![None; groups.len()],
            closes: vec![false; groups.len()],
        };
        let keys: Vec<Option<&str>> = groups.iter().map(|group| door_key(&group.name)).collect();
        let mut sorted: Vec<usize> = (0..groups.len())
            .filter(|&group| keys[group].is_some())
            .collect();
        sorted.sort_by_key(|&group| (keys[group], group));
        for members in sorted.chunk_by(|&a, &b| keys[a] == keys[b]) {
            let boxes = members.iter().map(|&group| bounds(model, &groups[group]));
            let [low, high] = boxes
                .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
                .unwrap_or_default();
            let middle = (low + high) / 2.0;
            let distance = |opening: &Opening| {
                let from = DVec2::new(middle.x, middle.z) - opening.centre * UNIT_M;
                let half = DVec2::new(opening.width, opening.depth) * (UNIT_M / 2.0);
                let beyond =
                    DVec2::new(from.dot(opening.along), from.dot(opening.across())).abs() - half;
                let height =
                    (middle.y - (opening.heights[0] + opening.heights[1]) / 2.0 * UNIT_M).abs();
                beyond.max(DVec2::ZERO).length() + height
            };
            let nearest = home
                .openings
                .iter()
                .map(distance)
                .enumerate()
                .min_by(|a, b| a.1.total_cmp(&b.1));
            let Some((opening, _)) = nearest.filter(|&(_, distance)| distance < NEAR) else {
                continue;
            };
            let member_groups: Vec<&Group> = members.iter().map(|&group| &groups[group]).collect();
            let closing = closing_groups(
                &model.scene,
                &model.portals[opening],
                home.openings[opening].wall_thickness * UNIT_M,
                &member_groups,
            );
            for (&group, closes) in members.iter().zip(closing) {
                doors.opening[group] = Some(opening);
                doors.closes[group] = closes;
            }
        }
        doors
    }
}

/// Returns the common prefix of the groups of a door or window from the name of one.
fn door_key(name: &str) -> Option<&str> {
    piece_key(name, "door_")
}

/// Returns `piece_12` of `piece_12_Chair_leg_4`.
fn piece_key<'a>(name: &'a str, prefix: &str) -> Option<&'a str> {
    let digits = name
        .strip_prefix(prefix)?
        .bytes()
        .take_while(u8::is_ascii_digit)
        .count();
    (digits > 0).then(|| &name[..prefix.len() + digits])
}

/// Returns the assignment of each group to cells.
fn assign_groups(
    model: &PortalModel,
    groups: &[Group],
    doors: &DoorGroups,
    options: &ModelOptions,
    notes: &mut Vec<String>,
) -> Vec<Portion> {
    let mut left_out = 0;
    let portions = groups.iter().enumerate().map(|(index, group)| {
        match (doors.opening[index], doors.closes[index]) {
            (Some(_), true) if !options.keep_doors => {
                left_out += 1;
                Portion::LeftOut
            }
            (Some(opening), _) => Portion::BySide(opening),
            (None, _) => match piece_key(&group.name, "piece_").or_else(|| door_key(&group.name)) {
                Some(key) => Portion::Whole(key.to_owned()),
                None => Portion::Facing,
            },
        }
    });
    let portions = portions.collect();
    if left_out > 0 {
        notes.push(format!(
            "{left_out} groups that close {} doors and windows left out",
            model.portals.len().min(closed_openings(doors))
        ));
    }
    portions
}

/// Returns the number of openings that some group closes.
fn closed_openings(doors: &DoorGroups) -> usize {
    let groups = doors.opening.iter().zip(&doors.closes);
    groups
        .filter_map(|(&opening, &closes)| opening.filter(|_| closes))
        .collect::<BTreeSet<usize>>()
        .len()
}

/// Returns the bounding box of a group.
fn bounds(model: &PortalModel, group: &Group) -> [DVec3; 2] {
    let corners = group
        .triangles
        .clone()
        .flat_map(|triangle| model.scene.corners(triangle));
    corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| {
        [low.min(p), high.max(p)]
    })
}
