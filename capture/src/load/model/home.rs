//! The plan of a Sweet Home 3D home, as its `Home.xml` says: x to the right and y down in plan (x and z of the export),
//! centimetres, angles clockwise in plan.

use glam::DVec2;
use roxmltree::{Document, Node};
use std::collections::HashMap;

/// A storey.
#[derive(Clone, Copy, Debug)]
struct Level {
    elevation: f64,
    height: f64,
}

/// A room.
#[derive(Clone, Debug)]
pub(super) struct Room {
    /// Empty if the home gives none.
    pub(super) name: String,
    pub(super) outline: Vec<DVec2>,
    pub(super) floor: f64,
    pub(super) ceiling: f64,
    /// Whether it has a ceiling, and so is a room and not a terrace.
    pub(super) covered: bool,
}

/// A door or window.
#[derive(Clone, Debug)]
pub(super) struct Opening {
    pub(super) name: String,
    /// Middle of the piece in plan.
    pub(super) centre: DVec2,
    /// Unit vector along its width.
    pub(super) along: DVec2,
    pub(super) width: f64,
    pub(super) depth: f64,
    /// Heights of its lower and upper edge.
    pub(super) heights: [f64; 2],
    /// Distance from `centre` to the middle of the wall, across, toward the piece's front.
    pub(super) wall_offset: f64,
    /// Thickness of the wall that it says it stands in.
    pub(super) wall_thickness: f64,
}

impl Opening {
    /// Unit vector across, from back to front.
    pub(super) fn across(&self) -> DVec2 {
        self.along.perp()
    }

    /// Middle of the opening in the middle of the wall.
    pub(super) fn in_wall(&self) -> DVec2 {
        self.centre + self.across() * self.wall_offset
    }
}

/// A home.
#[derive(Clone, Debug, Default)]
pub(super) struct Home {
    pub(super) rooms: Vec<Room>,
    pub(super) openings: Vec<Opening>,
    /// Rooms, doors and windows left out because a number is missing or no number.
    pub(super) unreadable: usize,
}

/// A wall thicker than this is no wall, centimetres.
const THICKEST_WALL: f64 = 2_000.0;

/// Height of walls where the home does not say, centimetres: Sweet Home 3D's own.
const WALL_HEIGHT: f64 = 250.0;

impl Home {
    /// Reads the text of a `Home.xml`.
    ///
    /// # Errors
    /// A sentence for people if it is not XML, or not a home.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let document = Document::parse(text).map_err(|cause| cause.to_string())?;
        let root = document.root_element();
        if !root.has_tag_name("home") {
            let found = root.tag_name().name().to_owned();
            return Err(format!("it is XML, but no Sweet Home 3D home: its root is <{found}>, not <home>"));
        }
        let wall_height = number(root, "wallHeight").unwrap_or(WALL_HEIGHT);
        let ground = Level { elevation: 0.0, height: wall_height };
        let levels: HashMap<&str, Level> = elements(root, "level")
            .filter_map(|node| {
                let height = number(node, "height").unwrap_or(wall_height);
                Some((node.attribute("id")?, Level { elevation: number(node, "elevation").unwrap_or(0.0), height }))
            })
            .collect();
        let level_of = |node: Node| node.attribute("level").and_then(|id| levels.get(id)).copied().unwrap_or(ground);
        let mut home = Self::default();
        for node in elements(root, "room") {
            match room(node, level_of(node)) {
                Some(room) => home.rooms.push(room),
                None => home.unreadable += 1,
            }
        }
        // A door that is not shown is not cut out of its wall.
        for node in elements(root, "doorOrWindow").filter(|node| node.attribute("visible") != Some("false")) {
            match opening(node, level_of(node)) {
                Some(opening) => home.openings.push(opening),
                None => home.unreadable += 1,
            }
        }
        Ok(home)
    }
}

/// All elements of a name below a node, in the order of the file (doors may stand in groups of furniture).
fn elements<'a>(root: Node<'a, 'a>, name: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    root.descendants().filter(move |node| node.has_tag_name(name))
}

/// A finite number in an attribute.
fn number(node: Node, attribute: &str) -> Option<f64> {
    node.attribute(attribute)?.parse().ok().filter(|value: &f64| value.is_finite())
}

fn room(node: Node, level: Level) -> Option<Room> {
    let corner = |point: Node| Some(DVec2::new(number(point, "x")?, number(point, "y")?));
    let outline: Vec<DVec2> = elements(node, "point").map(corner).collect::<Option<_>>()?;
    (outline.len() >= 3).then(|| Room {
        name: node.attribute("name").unwrap_or_default().trim().to_owned(),
        outline,
        floor: level.elevation,
        ceiling: level.elevation + level.height,
        covered: node.attribute("ceilingVisible") != Some("false"),
    })
}

fn opening(node: Node, level: Level) -> Option<Opening> {
    let positive = |attribute: &str| number(node, attribute).filter(|&value| value > 0.0);
    let (width, depth, height) = (positive("width")?, positive("depth")?, positive("height")?);
    let bottom = level.elevation + number(node, "elevation").unwrap_or(0.0);
    // Shares of the piece's depth, from its back.
    let thickness = number(node, "wallThickness").unwrap_or(1.0) * depth;
    // Rooms are looked for step by step through the wall: a wild number would never come to an end.
    if !(0.0..=THICKEST_WALL).contains(&thickness) {
        return None;
    }
    let distance = number(node, "wallDistance").unwrap_or(0.0) * depth;
    Some(Opening {
        name: node.attribute("name").unwrap_or("opening").trim().to_owned(),
        centre: DVec2::new(number(node, "x")?, number(node, "y")?),
        along: DVec2::from_angle(number(node, "angle").unwrap_or(0.0)),
        width,
        depth,
        heights: [bottom, bottom + height],
        wall_offset: distance + thickness / 2.0 - depth / 2.0,
        wall_thickness: thickness,
    })
}
