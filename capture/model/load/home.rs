//! Plan of a Sweet Home 3D home, read from its `Home.xml`: x to the right and y downward in plan (x
//! and z of the export), centimetres, angles clockwise in plan.

use super::finish::{Finish, color, finish};
use super::xml::{elements, number};
use glam::{DMat3, DVec2, DVec3};
use roxmltree::{Document, Node};
use std::collections::{HashMap, HashSet};
use std::f64::consts::{PI, TAU};

/// A storey.
#[derive(Clone, Copy, Debug)]
struct Level {
    elevation: f64,
    height: f64,
    /// Thickness of the floor below it, zero for the lowest storey.
    floor_thickness: f64,
    is_topmost: bool,
}

/// A room.
#[derive(Clone, Debug)]
pub(super) struct Room {
    /// Empty if the home has none.
    pub(super) name: String,
    pub(super) outline: Vec<DVec2>,
    pub(super) floor: f64,
    /// Height of the ceiling at each corner.
    pub(super) ceilings: Vec<f64>,
    /// True if it has a ceiling: it is a room, not a terrace.
    pub(super) covered: bool,
    /// True if its ceiling was switched off and is restored.
    pub(super) ceiling_is_new: bool,
    /// True if there is no storey above its own.
    pub(super) is_topmost: bool,
    /// True if its ceiling stays level below walls of other heights.
    pub(super) ceiling_is_flat: bool,
    pub(super) has_floor: bool,
    pub(super) floor_finish: Finish,
    pub(super) ceiling_finish: Finish,
}

impl Room {
    /// Returns the greatest height of the ceiling.
    pub(super) fn ceiling(&self) -> f64 {
        self.ceilings.iter().copied().fold(self.floor, f64::max)
    }

    /// Returns the corners of the ceiling: x, height, y in plan.
    pub(super) fn ceiling_corners(&self) -> Vec<DVec3> {
        self.outline
            .iter()
            .zip(&self.ceilings)
            .map(|(p, &height)| DVec3::new(p.x, height, p.y))
            .collect()
    }
}

/// A wall, upright on its level.
#[derive(Clone, Debug)]
pub(super) struct Wall {
    /// Ends of its middle line in plan.
    pub(super) start: DVec2,
    pub(super) end: DVec2,
    pub(super) thickness: f64,
    /// Height of the floor that it stands on.
    pub(super) bottom: f64,
    /// Height of its lower edge: a wall of an upper storey reaches through the floor.
    pub(super) lower_edge: f64,
    /// Heights above its bottom, at its start and end.
    pub(super) heights: [f64; 2],
    /// Finishes of its left and right side, seen from start to end in a plan with y downward.
    pub(super) finishes: [Finish; 2],
    /// Finish of its upper face, if it has its own.
    pub(super) top_finish: Option<Finish>,
    /// Extension beyond its start and end, into joined walls; `None` for a free end.
    pub(super) extension: [Option<f64>; 2],
    /// True for a piece of an arc wall.
    pub(super) is_arc: bool,
}

/// Furniture, a lamp, a door or a window, as a model.
#[derive(Clone, Debug)]
pub(super) struct FurniturePiece {
    /// Name of the model in the archive.
    pub(super) model: Option<String>,
    pub(super) is_opening: bool,
    /// Centre in plan.
    pub(super) centre: DVec2,
    /// Height of the lower edge.
    pub(super) elevation: f64,
    /// Width, height, depth.
    pub(super) size: DVec3,
    /// Rotation clockwise in plan, radians.
    pub(super) angle: f64,
    pub(super) mirrored: bool,
    /// Rotation of the model before it is scaled to its size.
    pub(super) rotation: Option<DMat3>,
    /// Rotation of the model, of its size, about horizontal axes.
    pub(super) tilt: Option<DMat3>,
    /// Finish of the whole piece.
    pub(super) finish: Finish,
    /// Finishes of single materials of the model.
    pub(super) materials: Vec<(String, Finish)>,
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
    /// Thickness of its wall.
    pub(super) wall_thickness: f64,
}

impl Opening {
    /// Returns the unit vector across, from back to front.
    pub(super) fn across(&self) -> DVec2 {
        self.along.perp()
    }

    /// Returns the middle of the opening in the middle of the wall.
    pub(super) fn in_wall(&self) -> DVec2 {
        self.centre + self.across() * self.wall_offset
    }
}

/// A home.
#[derive(Clone, Debug, Default)]
pub(super) struct Home {
    pub(super) rooms: Vec<Room>,
    pub(super) openings: Vec<Opening>,
    pub(super) walls: Vec<Wall>,
    pub(super) pieces: Vec<FurniturePiece>,
    /// Colour of the sky, linear RGB.
    pub(super) sky_color: Option<[f32; 3]>,
    /// Colour of the ground around the home, likewise.
    pub(super) ground_color: Option<[f32; 3]>,
    /// Number of rooms, walls, doors, windows and pieces of furniture left out because a number is
    /// missing or invalid.
    pub(super) unreadable: usize,
    /// Properties of the plan that are missing in geometry built from it.
    pub(super) unsupported: Unsupported,
}

/// Numbers of properties of a plan that are not built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Unsupported {
    /// Staircases that cut the floors above them.
    pub(super) staircases: usize,
    /// Doors and windows whose hole in the wall is not their whole rectangle.
    pub(super) shaped_openings: usize,
    /// Pieces of furniture with moved parts, such as an open door.
    pub(super) moved_parts: usize,
    /// Baseboards of walls.
    pub(super) baseboards: usize,
    /// Polylines in 3D.
    pub(super) polylines: usize,
    /// Labels in 3D.
    pub(super) labels: usize,
    /// Lamps with light sources.
    pub(super) lights: usize,
    /// Compasses whose north is not upward in plan.
    pub(super) compasses: usize,
}

/// Maximum thickness of a wall, centimetres.
const MAX_WALL_THICKNESS: f64 = 2_000.0;

/// Maximum angle between the straight pieces of an arc wall, radians.
const ARC_STEP: f64 = PI / 18.0;

/// Default height of walls, centimetres, as in Sweet Home 3D.
const WALL_HEIGHT: f64 = 250.0;

impl Home {
    /// Parses the text of a `Home.xml`.
    ///
    /// # Errors
    /// A message if it is not XML, or not a home.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
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

impl Unsupported {
    /// Counts the properties of a piece of furniture, a lamp, a door or a window.
    fn add_piece(&mut self, node: Node, is_opening: bool) {
        let cuts_floor = node
            .attribute("staircaseCutOutShape")
            .is_some_and(|shape| !matches!(shape, "" | "false"));
        self.staircases += usize::from(cuts_floor);
        self.lights += usize::from(elements(node, "lightSource").next().is_some());
        self.moved_parts += usize::from(elements(node, "transformation").next().is_some());
        let is_whole = |(attribute, whole): (&str, f64)| {
            number(node, attribute).is_none_or(|value| (value - whole).abs() < SHAPE_ROUNDING)
        };
        let is_shaped = node
            .attribute("cutOutShape")
            .is_some_and(|path| !path.is_empty() && !is_unit_square(path));
        let parts = [
            ("wallWidth", 1.0),
            ("wallLeft", 0.0),
            ("wallHeight", 1.0),
            ("wallTop", 0.0),
        ];
        let is_partial = is_shaped || !parts.into_iter().all(is_whole);
        self.shaped_openings += usize::from(is_opening && is_partial);
    }
}

/// Error of numbers in shapes, as a share of the piece.
const SHAPE_ROUNDING: f64 = 1e-3;

/// Returns true if an SVG path consists of lines between corners of the unit square.
fn is_unit_square(path: &str) -> bool {
    let mut at = DVec2::ZERO;
    let mut rest = path.trim();
    while let Some(command) = rest.chars().next() {
        let after = &rest[command.len_utf8()..];
        let end = after
            .find(|c: char| c.is_ascii_alphabetic() && !matches!(c, 'e' | 'E'))
            .unwrap_or(after.len());
        let numbers: Option<Vec<f64>> = after[..end]
            .split(|c: char| c == ',' || c.is_whitespace())
            .filter(|word| !word.is_empty())
            .map(|word| word.parse().ok())
            .collect();
        let Some(numbers) = numbers else {
            return false;
        };
        let from = if command.is_ascii_lowercase() {
            at
        } else {
            DVec2::ZERO
        };
        at = match (command.to_ascii_lowercase(), numbers.as_slice()) {
            ('m' | 'l', &[x, y]) => from + DVec2::new(x, y),
            ('h', &[x]) => DVec2::new(from.x + x, at.y),
            ('v', &[y]) => DVec2::new(at.x, from.y + y),
            ('z', []) => at,
            _ => return false,
        };
        let off_corner = (at - at.round().clamp(DVec2::ZERO, DVec2::ONE)).abs();
        // Also true for NaN.
        let is_at_corner = off_corner.max_element() < SHAPE_ROUNDING;
        if !is_at_corner {
            return false;
        }
        rest = &after[end..];
    }
    true
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

fn wall(node: Node, level: Level, wall_height: f64, by_id: &HashMap<&str, Node>) -> Option<Wall> {
    let thickness = number(node, "thickness").filter(|&thickness| thickness > 0.0)?;
    let height = number(node, "height").unwrap_or(wall_height);
    let into = |joined: &str| extension(node, *by_id.get(node.attribute(joined)?)?, wall_height);
    let top_finish = finish(node, "topColor", None);
    Some(Wall {
        start: DVec2::new(number(node, "xStart")?, number(node, "yStart")?),
        end: DVec2::new(number(node, "xEnd")?, number(node, "yEnd")?),
        thickness,
        bottom: level.elevation,
        lower_edge: level.elevation - level.floor_thickness,
        heights: [height, number(node, "heightAtEnd").unwrap_or(height)],
        finishes: ["left", "right"].map(|side| {
            finish(
                node,
                &format!("{side}SideColor"),
                Some(&format!("{side}SideTexture")),
            )
        }),
        top_finish: Some(top_finish).filter(Finish::is_specified),
        extension: ["wallAtStart", "wallAtEnd"].map(into),
        is_arc: false,
    })
}

/// Returns the extension of a wall into one that it is joined to: half its thickness, or, if the
/// other continues it, as far as their outer faces meet. `None` if the end of the wall remains
/// visible there.
fn extension(node: Node, joined: Node, wall_height: f64) -> Option<f64> {
    let other = number(joined, "thickness")?;
    let Some(sine) = continuation(node, joined) else {
        return Some(other / 2.0);
    };
    let heights = |wall: Node| {
        let height = number(wall, "height").unwrap_or(wall_height);
        [height, number(wall, "heightAtEnd").unwrap_or(height)]
    };
    let [low, high] = heights(joined);
    let is_covered = heights(node).iter().all(|&height| height <= low.min(high));
    let thickness = number(node, "thickness")?;
    // The tangent of half a small angle is half its sine.
    (is_covered && thickness <= other).then_some(thickness / 2.0 * sine / 2.0)
}

/// Returns the sine of the angle between two straight walls if one nearly continues the other from
/// a common end.
fn continuation(wall: Node, other: Node) -> Option<f64> {
    const MAX_SINE: f64 = 0.1;
    let ends = |wall: Node| {
        let point = |[x, y]: [&str; 2]| Some(DVec2::new(number(wall, x)?, number(wall, y)?));
        let is_straight = number(wall, "arcExtent").is_none_or(|extent| extent == 0.0);
        let ends = [point(["xStart", "yStart"])?, point(["xEnd", "yEnd"])?];
        is_straight.then_some(ends)
    };
    let [[a, b], [c, d]] = [ends(wall)?, ends(other)?];
    // From the far end of each wall to the common one and on.
    let distance = |[_, p, q, _]: &[DVec2; 4]| p.distance(*q);
    let [far, near, next, last] = [[a, b, c, d], [a, b, d, c], [b, a, c, d], [b, a, d, c]]
        .into_iter()
        .min_by(|p, q| distance(p).total_cmp(&distance(q)))?;
    let along = (near - far).try_normalize()?;
    let onward = (last - next).try_normalize()?;
    let sine = along.perp_dot(onward).abs();
    (sine < MAX_SINE && along.dot(onward) > 0.0).then_some(sine)
}

impl Wall {
    /// Splits an arc wall into straight pieces of at most [`ARC_STEP`]. `extent` is the angle of
    /// the arc from start to end, radians, positive clockwise in plan.
    fn split_arc(self, extent: f64) -> Vec<Self> {
        let chord = self.end - self.start;
        if extent == 0.0 || extent.abs() >= TAU || chord == DVec2::ZERO {
            return vec![self];
        }
        let offset = chord.perp() * (((PI - extent) / 2.0).tan() / 2.0);
        let centre = (self.start + self.end) / 2.0 + offset;
        let count = (extent.abs() / ARC_STEP).ceil().max(1.0);
        // Outer faces of adjacent pieces meet; inner ones intersect.
        let joint = self.thickness / 2.0 * (extent / count / 2.0).abs().tan();
        let at =
            |share: f64| centre + DVec2::from_angle(extent * share).rotate(self.start - centre);
        let height = |share: f64| self.heights[0] + (self.heights[1] - self.heights[0]) * share;
        let count = count as usize;
        let piece = |i: usize| {
            let [from, to] = [i, i + 1].map(|end| end as f64 / count as f64);
            Self {
                start: at(from),
                end: at(to),
                heights: [height(from), height(to)],
                extension: [
                    if i == 0 {
                        self.extension[0]
                    } else {
                        Some(joint)
                    },
                    if i + 1 == count {
                        self.extension[1]
                    } else {
                        Some(joint)
                    },
                ],
                is_arc: true,
                ..self.clone()
            }
        };
        (0..count).map(piece).collect()
    }
}

fn piece(node: Node, level: Level, is_opening: bool) -> Option<FurniturePiece> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unit_square_is_told_from_other_shapes() {
        for path in [
            "M0,0 v1 h1 v-1 z",
            "M 0 0 L 1 0 L 1 1 L 0 1 Z",
            "M0,0V1H1V0Z",
        ] {
            assert!(is_unit_square(path), "{path}");
        }
        for path in [
            "M0.5,0 L 1,1 L 0,1 z",
            "M0,0.5 C 0,0 1,0 1,0.5 z",
            "M0,0 a1 1 0 0 1 1 1",
            "M0,0 v2",
            "?",
        ] {
            assert!(!is_unit_square(path), "{path}");
        }
    }
}
