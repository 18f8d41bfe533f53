//! Floor plan of a portal model as SVG: rooms, walls and numbered portals.

use super::portal_opening::polygon_edges;
use glam::{DVec2, DVec3};
use headbox_core::drawing::svg::{Svg, TextStyle, text_width};
use headbox_model::{Cell, Portal, PortalModel, Prism};

/// Width of a drawing, pixels; its height follows from the plan.
const WIDTH_PX: f64 = 1600.0;
/// Margin around the plan, pixels.
const MARGIN_PX: f64 = 40.0;
/// Maximum height of a drawing, pixels.
const HIGHEST_PX: f64 = 2400.0;

/// Half side of the box around a portal's number, pixels.
const LABEL_PX: f64 = 9.0;

/// Font size of a room's name, pixels.
const NAME_PX: f64 = 19.0;
/// Line spacing of a room's name, pixels.
const LINE_PX: f64 = 22.0;
/// Font size of a portal's number, pixels.
const NUMBER_PX: f64 = 13.0;

/// Steepness of walls and furniture: surfaces whose normal has a cosine with the vertical above 1
/// minus this are floors or ceilings.
const STEEP: f64 = 0.3;

/// Distance of the lower cut, through low furniture, below the main cut, metres.
const LOWER_M: f64 = 0.75;
/// Largest height of a portal's lower edge above the cut, metres: a high window still belongs to
/// the storey.
const HIGH_M: f64 = 0.9;
/// Height below which a portal is a hatch in a ceiling or floor, metres.
const LEVEL_M: f64 = 0.1;
/// Largest distance of a hatch of the storey above and below the cut, metres.
const HATCH_M: [f64; 2] = [2.0, 1.2];
/// Colours of the lower cut and of the main cut.
const CUT_COLORS: [[u8; 3]; 2] = [[165; 3], [40; 3]];

/// Drawing of a portal model; positions are pixels from the upper left corner.
#[derive(Clone, Debug, PartialEq)]
pub struct FloorPlan {
    size: DVec2,
    rooms: Vec<Room>,
    /// Line segments of the lower cut, through low furniture, and of the main cut.
    cuts: [Vec<[DVec2; 2]>; 2],
    openings: Vec<PlanOpening>,
}

#[derive(Clone, Debug, PartialEq)]
struct Room {
    /// Name, broken into lines that fit into the room.
    name: Vec<String>,
    outlines: Vec<Vec<DVec2>>,
    label: DVec2,
    color: [u8; 3],
}

#[derive(Clone, Debug, PartialEq)]
struct PlanOpening {
    number: String,
    ends: [DVec2; 2],
    label: DVec2,
    to_outside: bool,
}

/// Height difference below which floors belong to one storey, metres.
const STOREY_M: f64 = 1.5;

/// Returns the floor heights of a model's storeys, world metres, ascending; 0 alone if it has no
/// rooms.
pub fn storeys(model: &PortalModel) -> Vec<f64> {
    // The lowest part of each room: others are window niches.
    let floor = |cell: &Cell| {
        cell.space
            .iter()
            .map(|prism| prism.floor_y)
            .filter(|y| y.is_finite())
            .reduce(f64::min)
    };
    let mut floors: Vec<f64> = model.cells.iter().filter_map(floor).collect();
    floors.sort_by(f64::total_cmp);
    let mut storeys: Vec<f64> = Vec::new();
    for floor in floors {
        if storeys.last().is_none_or(|last| floor - last > STOREY_M) {
            storeys.push(floor);
        }
    }
    if storeys.is_empty() {
        vec![0.0]
    } else {
        storeys
    }
}

impl FloorPlan {
    /// Creates the plan of the storey at a horizontal cut `cut_y` metres above the world's origin:
    /// the rooms and portals that the cut passes through. A cut a metre above the floor shows
    /// walls, windows and high furniture; low furniture is paler. Portals are labelled with their
    /// index. All plans of a model have the same scale and position.
    pub fn new(model: &PortalModel, cut_y: f64) -> Self {
        let prisms = model.cells.iter().flat_map(|cell| &cell.space);
        let spaces = prisms.flat_map(|prism| &prism.outline);
        let openings = model
            .portals
            .iter()
            .flat_map(|portal| portal.polygon.iter().map(in_plan));
        let corners = spaces.copied().chain(openings).filter(|p| p.is_finite());
        let [mut low, mut high] = corners
            .fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], p| {
                [low.min(p), high.max(p)]
            });
        if !(low.is_finite() && high.is_finite()) {
            [low, high] = model.scene.bounds().map(|p| in_plan(&p));
        }
        let size = (high - low).max(DVec2::splat(0.1));
        let scale =
            ((WIDTH_PX - 2.0 * MARGIN_PX) / size.x).min((HIGHEST_PX - 2.0 * MARGIN_PX) / size.y);
        let to_px = |p: DVec2| (p - low) * scale + MARGIN_PX;
        let whole = |extent: f64| {
            (extent * scale + 2.0 * MARGIN_PX)
                .ceil()
                .clamp(1.0, WIDTH_PX.max(HIGHEST_PX))
        };
        let [least, most] = [low - 0.5, high + 0.5];
        let cut = |y: f64| {
            (0..model.scene.triangles.len() as u32)
                .filter_map(|triangle| cut_triangle(model.scene.corners(triangle), y))
                .filter(|ends| {
                    ends.iter()
                        .all(|p| p.cmpge(least).all() && p.cmple(most).all())
                })
                .map(|ends| ends.map(to_px))
                .collect()
        };
        Self {
            size: DVec2::new(whole(size.x), whole(size.y)),
            rooms: model
                .cells
                .iter()
                .enumerate()
                .filter(|(_, cell)| {
                    cell.space
                        .iter()
                        .any(|p| p.floor_y <= cut_y && cut_y < p.ceiling_y)
                })
                .filter_map(|(i, cell)| room(i, &cell.name, &cell.space, to_px))
                .collect(),
            cuts: [cut(cut_y - LOWER_M), cut(cut_y)],
            openings: model
                .portals
                .iter()
                .enumerate()
                .filter(|(_, portal)| is_on_storey(portal, cut_y))
                .map(|(i, portal)| opening(model, i, portal, to_px))
                .collect(),
        }
    }

    /// Draws the plan as an SVG file: rooms, cuts, portals, and on top of them names and numbers.
    pub fn to_svg(&self) -> String {
        let mut svg = Svg::new(self.size, "floor plan");
        for room in &self.rooms {
            for outline in &room.outlines {
                svg.polygon(outline, room.color);
            }
        }
        for (cut, color) in self.cuts.iter().zip(CUT_COLORS) {
            svg.lines(cut, color, 0.8);
        }
        for opening in &self.openings {
            svg.lines([opening.ends], opening.color(), 5.0);
        }
        for (name, at) in self.rooms.iter().flat_map(Room::lines) {
            text(&mut svg, name, at, NAME_PX, [20; 3], true);
        }
        for opening in &self.openings {
            let half = DVec2::new(
                (text_width(&opening.number, NUMBER_PX) / 2.0 + 4.0).max(LABEL_PX),
                LABEL_PX,
            );
            svg.white_box(opening.label - half, 2.0 * half, opening.color());
            text(
                &mut svg,
                &opening.number,
                opening.label,
                NUMBER_PX,
                opening.color(),
                false,
            );
        }
        svg.finish()
    }
}

/// Writes a line of text centred at a point.
fn text(svg: &mut Svg, text: &str, center: DVec2, size: f64, color: [u8; 3], halo: bool) {
    // Capitals and digits are 0.69 em high.
    let baseline = center + DVec2::Y * 0.345 * size;
    svg.text(
        baseline,
        text,
        TextStyle {
            size,
            color,
            anchor: "middle",
            upwards: false,
            halo,
        },
    );
}

impl Room {
    /// Returns the lines of the name, each with its centre.
    fn lines(&self) -> impl Iterator<Item = (&str, DVec2)> {
        let middle = (self.name.len() as f64 - 1.0) / 2.0;
        let place = move |line: usize| self.label + DVec2::Y * (line as f64 - middle) * LINE_PX;
        self.name
            .iter()
            .enumerate()
            .map(move |(line, name)| (name.as_str(), place(line)))
    }
}

impl PlanOpening {
    fn color(&self) -> [u8; 3] {
        if self.to_outside {
            [20, 90, 200]
        } else {
            [200, 40, 30]
        }
    }
}

/// Returns true if a portal belongs to the storey of a cut.
fn is_on_storey(portal: &Portal, cut_y: f64) -> bool {
    let heights = || portal.polygon.iter().map(|p| p.y);
    let low = heights().fold(f64::INFINITY, f64::min);
    let high = heights().fold(f64::NEG_INFINITY, f64::max);
    let [above, below] = if high - low < LEVEL_M {
        HATCH_M
    } else {
        [HIGH_M, LOWER_M]
    };
    low <= cut_y + above && high >= cut_y - below
}

/// Projects a point to the plan: (x, z).
fn in_plan(p: &DVec3) -> DVec2 {
    DVec2::new(p.x, p.z)
}

fn room(index: usize, name: &str, space: &[Prism], to_px: impl Fn(DVec2) -> DVec2) -> Option<Room> {
    let outlines: Vec<Vec<DVec2>> = space
        .iter()
        .map(|prism| prism.outline.iter().map(|&p| to_px(p)).collect())
        .collect();
    let label = label_position(outlines.first()?);
    let [left, right] = [f64::min, f64::max]
        .map(|pick| outlines[0].iter().map(|p| p.x).reduce(pick).unwrap_or(0.0));
    // Pale colours that differ between adjacent indices: hues in steps of the golden angle.
    let hue = index as f64 * 2.399_963;
    let channel = |shift: f64| (228.0 + 24.0 * (hue + shift).cos()) as u8;
    Some(Room {
        name: break_lines(name, right - left),
        outlines,
        label,
        color: [channel(0.0), channel(2.1), channel(4.2)],
    })
}

/// Breaks a name at spaces into lines that fit into a width, pixels.
fn break_lines(name: &str, width: f64) -> Vec<String> {
    let fits = |line: &str| text_width(line, NAME_PX) <= width - NAME_PX / 2.0;
    let mut lines: Vec<String> = Vec::new();
    for word in name.split_whitespace() {
        match lines.last_mut() {
            Some(line) if fits(&format!("{line} {word}")) => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Returns the position of a name: the lattice point in an outline that is farthest from its
/// border.
fn label_position(outline: &[DVec2]) -> DVec2 {
    const LATTICE: usize = 24;
    let low = outline.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let high = outline
        .iter()
        .copied()
        .fold(DVec2::NEG_INFINITY, DVec2::max);
    let prism = Prism {
        outline: outline.to_vec(),
        floor_y: 0.0,
        ceiling_y: 1.0,
    };
    let points = (0..LATTICE * LATTICE).map(|i| {
        let share = (DVec2::new((i % LATTICE) as f64, (i / LATTICE) as f64) + 0.5) / LATTICE as f64;
        low + (high - low) * share
    });
    let inside = points.filter(|p| prism.contains(DVec3::new(p.x, 0.5, p.y)));
    // Names are wide, so that distances along x count less. Among equal positions the most central
    // wins.
    let middle = (low + high) / 2.0;
    let clearance = |p: &DVec2| {
        polygon_edges(outline)
            .map(|(a, b)| distance_to_edge(*p, a, b))
            .fold(f64::INFINITY, f64::min)
            - 0.05 * p.distance(middle)
    };
    inside
        .max_by(|a, b| clearance(a).total_cmp(&clearance(b)))
        .unwrap_or(middle)
}

/// Returns the distance of a point from an edge, with distances along x weighted less.
fn distance_to_edge(p: DVec2, a: DVec2, b: DVec2) -> f64 {
    const WEIGHTS: DVec2 = DVec2::new(0.4, 1.0);
    let [p, a, b] = [p, a, b].map(|p| p * WEIGHTS);
    let along =
        ((p - a).dot(b - a) / (b - a).length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    p.distance(a.lerp(b, along))
}

fn opening(
    model: &PortalModel,
    index: usize,
    portal: &Portal,
    to_px: impl Fn(DVec2) -> DVec2,
) -> PlanOpening {
    let corners: Vec<DVec2> = portal.polygon.iter().map(in_plan).collect();
    // The two corners that are farthest apart: a horizontal portal is drawn as its diagonal.
    let pairs = corners
        .iter()
        .flat_map(|a| corners.iter().map(move |b| [*a, *b]));
    let ends = pairs
        .max_by(|a, b| a[0].distance(a[1]).total_cmp(&b[0].distance(b[1])))
        .unwrap_or_default()
        .map(to_px);
    PlanOpening {
        number: index.to_string(),
        ends,
        label: (ends[0] + ends[1]) / 2.0,
        to_outside: portal.cells.iter().any(|&cell| model.outside == Some(cell)),
    }
}

/// Intersects a steep triangle with the plane at height `y`.
fn cut_triangle(corners: [DVec3; 3], y: f64) -> Option<[DVec2; 2]> {
    let [a, b, c] = corners;
    let normal = (b - a).cross(c - a).normalize_or_zero();
    if normal.y.abs() > 1.0 - STEEP {
        return None;
    }
    let mut ends = [[a, b], [b, c], [c, a]].into_iter().filter_map(|[p, q]| {
        let crosses = (p.y > y) != (q.y > y);
        crosses.then(|| in_plan(&p.lerp(q, (y - p.y) / (q.y - p.y))))
    });
    Some([ends.next()?, ends.next()?])
}
