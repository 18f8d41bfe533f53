//! Plan of a Sweet Home 3D home, read from its `Home.xml`: x to the right and y downward in plan (x
//! and z of the export), centimetres, angles clockwise in plan.

use super::finish::{Finish, color, finish};
use super::unsupported::Unsupported;
use super::walls::{Wall, wall};
use super::xml::{elements, number};
use glam::{DMat3, DVec2, DVec3};
use roxmltree::{Document, Node};
use std::collections::{HashMap, HashSet};

/// A storey.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Level {
    pub(crate) elevation: f64,
    pub(crate) height: f64,
    /// Thickness of the floor below it, zero for the lowest storey.
    pub(super) floor_thickness: f64,
    pub(crate) is_topmost: bool,
}

/// A room.
#[derive(Clone, Debug)]
pub(crate) struct Room {
    /// Empty if the home has none.
    pub(crate) name: String,
    pub(crate) outline: Vec<DVec2>,
    pub(crate) floor: f64,
    /// Height of the ceiling at each corner.
    pub(crate) ceilings: Vec<f64>,
    /// True if it has a ceiling: it is a room, not a terrace.
    pub(crate) covered: bool,
    /// True if its ceiling was switched off and is restored.
    pub(crate) ceiling_is_new: bool,
    /// True if there is no storey above its own.
    pub(crate) is_topmost: bool,
    /// True if its ceiling stays level below walls of other heights.
    pub(crate) ceiling_is_flat: bool,
    pub(crate) has_floor: bool,
    pub(crate) floor_finish: Finish,
    pub(crate) ceiling_finish: Finish,
}

impl Room {
    /// Returns the greatest height of the ceiling.
    pub(crate) fn ceiling(&self) -> f64 {
        self.ceilings.iter().copied().fold(self.floor, f64::max)
    }

    /// Returns the corners of the ceiling: x, height, y in plan.
    pub(crate) fn ceiling_corners(&self) -> Vec<DVec3> {
        self.outline
            .iter()
            .zip(&self.ceilings)
            .map(|(p, &height)| DVec3::new(p.x, height, p.y))
            .collect()
    }
}

/// Furniture, a lamp, a door or a window, as a model.
#[derive(Clone, Debug)]
pub(crate) struct FurniturePiece {
    /// Name of the model in the archive.
    pub(crate) model: Option<String>,
    pub(crate) is_opening: bool,
    /// Centre in plan.
    pub(crate) centre: DVec2,
    /// Height of the lower edge.
    pub(crate) elevation: f64,
    /// Width, height, depth.
    pub(crate) size: DVec3,
    /// Rotation clockwise in plan, radians.
    pub(crate) angle: f64,
    pub(crate) mirrored: bool,
    /// Rotation of the model before it is scaled to its size.
    pub(crate) rotation: Option<DMat3>,
    /// Rotation of the model, of its size, about horizontal axes.
    pub(crate) tilt: Option<DMat3>,
    /// Finish of the whole piece.
    pub(crate) finish: Finish,
    /// Finishes of single materials of the model.
    pub(crate) materials: Vec<(String, Finish)>,
}

/// A door or window.
#[derive(Clone, Debug)]
pub(crate) struct Opening {
    pub(crate) name: String,
    /// Middle of the piece in plan.
    pub(crate) centre: DVec2,
    /// Unit vector along its width.
    pub(crate) along: DVec2,
    pub(crate) width: f64,
    pub(crate) depth: f64,
    /// Heights of its lower and upper edge.
    pub(crate) heights: [f64; 2],
    /// Distance from `centre` to the middle of the wall, across, toward the piece's front.
    pub(super) wall_offset: f64,
    /// Thickness of its wall.
    pub(crate) wall_thickness: f64,
}

impl Opening {
    /// Returns the unit vector across, from back to front.
    pub(crate) fn across(&self) -> DVec2 {
        self.along.perp()
    }

    /// Returns the middle of the opening in the middle of the wall.
    pub(crate) fn in_wall(&self) -> DVec2 {
        self.centre + self.across() * self.wall_offset
    }
}

/// A home.
#[derive(Clone, Debug, Default)]
pub(crate) struct Home {
    pub(crate) rooms: Vec<Room>,
    pub(crate) openings: Vec<Opening>,
    pub(crate) walls: Vec<Wall>,
    pub(crate) pieces: Vec<FurniturePiece>,
    /// Colour of the sky, linear RGB.
    pub(crate) sky_color: Option<[f32; 3]>,
    /// Colour of the ground around the home, likewise.
    pub(crate) ground_color: Option<[f32; 3]>,
    /// Number of rooms, walls, doors, windows and pieces of furniture left out because a number is
    /// missing or invalid.
    pub(crate) unreadable: usize,
    /// Properties of the plan that are missing in geometry built from it.
    pub(crate) unsupported: Unsupported,
}

/// Maximum thickness of a wall, centimetres.
const MAX_WALL_THICKNESS: f64 = 2_000.0;

/// Default height of walls, centimetres, as in Sweet Home 3D.
const WALL_HEIGHT: f64 = 250.0;

impl Home {
    /// Parses the text of a `Home.xml`.
    ///
    /// # Errors
    /// A message if it is not XML, or not a home.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let document = Document::parse(text)
            .map_err(|cause| format!("not XML, or damaged in line {}", cause.pos().row))?;
        let root = document.root_element();
        if !root.has_tag_name("home") {
            let found = root.tag_name().name().to_owned();
            return Err(format!(
                "not a Sweet Home 3D home: the root element is <{found}>, not <home>"
            ));
        }
        let wall_height = number(root, "wallHeight").unwrap_or(WALL_HEIGHT);
        let ground = Level {
            elevation: 0.0,
            height: wall_height,
            floor_thickness: 0.0,
            is_topmost: true,
        };
        let elevation = |node: Node| number(node, "elevation").unwrap_or(0.0);
        let topmost = elements(root, "level")
            .filter(is_viewable)
            .map(elevation)
            .fold(f64::NEG_INFINITY, f64::max);
        let lowest = elements(root, "level")
            .map(elevation)
            .fold(f64::INFINITY, f64::min);
        let levels: HashMap<&str, Level> = elements(root, "level")
            .filter_map(|node| {
                let elevation = elevation(node);
                let level = Level {
                    elevation,
                    height: number(node, "height").unwrap_or(wall_height),
                    floor_thickness: number(node, "floorThickness")
                        .filter(|_| elevation > lowest)
                        .map_or(0.0, |thickness| thickness.max(0.0)),
                    is_topmost: elevation >= topmost,
                };
                Some((node.attribute("id")?, level))
            })
            .collect();
        let hidden: HashSet<&str> = elements(root, "level")
            .filter(|node| !is_viewable(node))
            .filter_map(|node| node.attribute("id"))
            .collect();
        let level_of = |node: Node| {
            node.attribute("level")
                .and_then(|id| levels.get(id))
                .copied()
                .unwrap_or(ground)
        };
        let elements = |name| {
            elements(root, name).filter(|node| {
                node.attribute("level")
                    .is_none_or(|id| !hidden.contains(id))
            })
        };
        let environment_color =
            |attribute| elements("environment").find_map(|node| color(node, attribute));
        let mut home = Self {
            sky_color: environment_color("skyColor"),
            ground_color: environment_color("groundColor"),
            ..Self::default()
        };
        for node in elements("room") {
            match room(node, level_of(node)) {
                Some(room) => home.rooms.push(room),
                None => home.unreadable += 1,
            }
        }
        let by_id: HashMap<&str, Node> = elements("wall")
            .filter_map(|node| Some((node.attribute("id")?, node)))
            .collect();
        for node in elements("wall") {
            match wall(node, level_of(node), wall_height, &by_id) {
                Some(wall) => home
                    .walls
                    .extend(wall.split_arc(number(node, "arcExtent").unwrap_or(0.0))),
                None => home.unreadable += 1,
            }
        }
        let count = |name, attribute: &str| {
            let is_it = |node: &Node| number(*node, attribute).is_some();
            elements(name).filter(is_it).count()
        };
        home.unsupported = Unsupported {
            baseboards: elements("baseboard").count(),
            polylines: count("polyline", "elevation"),
            labels: count("label", "pitch"),
            compasses: elements("compass")
                .filter(|node| number(*node, "northDirection").is_some_and(|angle| angle != 0.0))
                .count(),
            ..Unsupported::default()
        };
        // A hidden door is not cut out of its wall.
        let is_shown = |node: &Node| node.attribute("visible") != Some("false");
        for kind in ["doorOrWindow", "pieceOfFurniture", "light", "shelfUnit"] {
            for node in elements(kind).filter(is_shown) {
                let level = level_of(node);
                home.unsupported.add_piece(node, kind == "doorOrWindow");
                let opening = (kind == "doorOrWindow").then(|| opening(node, level));
                match (piece(node, level, opening.is_some()), opening) {
                    (_, Some(None)) | (None, _) => home.unreadable += 1,
                    (Some(piece), opening) => {
                        home.openings.extend(opening.flatten());
                        home.pieces.push(piece);
                    }
                }
            }
        }
        Ok(home)
    }
}

/// Returns true if a storey and everything on it is visible in 3D. (`visible` records which storeys
/// the user's window showed last.)
fn is_viewable(level: &Node) -> bool {
    level.attribute("viewable") != Some("false")
}

fn room(node: Node, level: Level) -> Option<Room> {
    let corner = |point: Node| Some(DVec2::new(number(point, "x")?, number(point, "y")?));
    let outline: Vec<DVec2> = elements(node, "point").map(corner).collect::<Option<_>>()?;
    (outline.len() >= 3).then(|| Room {
        name: node.attribute("name").unwrap_or_default().trim().to_owned(),
        floor: level.elevation,
        ceilings: vec![level.elevation + level.height; outline.len()],
        outline,
        covered: node.attribute("ceilingVisible") != Some("false"),
        ceiling_is_new: false,
        is_topmost: level.is_topmost,
        ceiling_is_flat: node.attribute("ceilingFlat") == Some("true"),
        has_floor: node.attribute("floorVisible") != Some("false"),
        floor_finish: finish(node, "floorColor", Some("floorTexture")),
        ceiling_finish: finish(node, "ceilingColor", Some("ceilingTexture")),
    })
}

pub(crate) fn piece(node: Node, level: Level, is_opening: bool) -> Option<FurniturePiece> {
    let positive = |attribute: &str| number(node, attribute).filter(|&value| value > 0.0);
    let rotation = node.attribute("modelRotation").and_then(|text| {
        let numbers: Vec<f64> = text
            .split_whitespace()
            .map(|word| word.parse().ok())
            .collect::<Option<_>>()?;
        // Row-major.
        Some(DMat3::from_cols_array(numbers.as_slice().try_into().ok()?).transpose())
    });
    let angle = |attribute| number(node, attribute).filter(|&angle| angle != 0.0);
    // Sweet Home 3D applies one of the two.
    let tilt = angle("pitch")
        .map(|pitch| DMat3::from_rotation_x(-pitch))
        .or_else(|| Some(DMat3::from_rotation_z(-angle("roll")?)));
    let materials = elements(node, "material");
    let material = |m: Node| Some((m.attribute("name")?.to_owned(), finish(m, "color", None)));
    Some(FurniturePiece {
        model: node.attribute("model").map(str::to_owned),
        is_opening,
        centre: DVec2::new(number(node, "x")?, number(node, "y")?),
        elevation: level.elevation + number(node, "elevation").unwrap_or(0.0),
        size: DVec3::new(positive("width")?, positive("height")?, positive("depth")?),
        angle: number(node, "angle").unwrap_or(0.0),
        mirrored: node.attribute("modelMirrored") == Some("true"),
        rotation,
        tilt,
        finish: finish(node, "color", None),
        materials: materials
            .filter_map(material)
            .filter(|(_, finish)| finish.is_specified())
            .collect(),
    })
}

fn opening(node: Node, level: Level) -> Option<Opening> {
    let positive = |attribute: &str| number(node, attribute).filter(|&value| value > 0.0);
    let (width, depth, height) = (positive("width")?, positive("depth")?, positive("height")?);
    let bottom = level.elevation + number(node, "elevation").unwrap_or(0.0);
    // Shares of the piece's depth from its back.
    let thickness = number(node, "wallThickness").unwrap_or(1.0) * depth;
    // Rooms are searched in steps through the wall, whose number must be limited.
    if !(0.0..=MAX_WALL_THICKNESS).contains(&thickness) {
        return None;
    }
    let distance = number(node, "wallDistance").unwrap_or(0.0) * depth;
    Some(Opening {
        name: node
            .attribute("name")
            .unwrap_or("opening")
            .trim()
            .to_owned(),
        centre: DVec2::new(number(node, "x")?, number(node, "y")?),
        along: DVec2::from_angle(number(node, "angle").unwrap_or(0.0)),
        width,
        depth,
        heights: [bottom, bottom + height],
        wall_offset: distance + thickness / 2.0 - depth / 2.0,
        wall_thickness: thickness,
    })
}
