//! The geometry of a home that comes without its OBJ export, made from the plan and from the models in its archive: walls with
//! their openings, floors and ceilings, furniture in its place. It is written as the OBJ that Sweet Home 3D exports, groups
//! and all, so that everything after it is the same.
//!
//! What differs from an export: joined walls run through each other instead of being mitred, curved ones are straight,
//! textures and normals are left out, and furniture whose model is no OBJ is a box of its size. Pitch and roll are not
//! applied.

use super::home::{Home, Opening, Piece, Room, Wall};
use crate::load::lines::{decode, keyword, lines};
use crate::load::mtl::MtlMaterial;
use glam::{DMat3, DVec2, DVec3};
use std::collections::HashMap;
use std::fmt::Write as _;
use std::io::{Cursor, Read};

/// Linear colours that models in archives refer to without saying what they are, as Sweet Home 3D exports them.
const KNOWN_COLORS: [(&str, [f32; 3]); 18] = [
    ("amber", [0.5755, 0.2678, 0.0]),
    ("black", [0.002; 3]),
    ("dkdkgrey", [0.0122; 3]),
    ("dkgrey", [0.049; 3]),
    ("flblonde", [0.5714, 0.3283, 0.0443]),
    ("fldkgrey", [0.0939; 3]),
    ("flgrey", [0.5; 3]),
    ("flltbrown", [0.2776, 0.1143, 0.0531]),
    ("flltgrey", [0.8245; 3]),
    ("grey", [0.1837; 3]),
    ("ltgrey", [0.3837; 3]),
    ("red", [0.7714, 0.0, 0.0]),
    ("sand_stone", [0.1256, 0.1138, 0.0965]),
    ("silver", [0.6163; 3]),
    ("white", [1.0; 3]),
    ("yellow", [1.0, 0.6667, 0.0]),
    ("yellow_green", [0.1875, 0.4082, 0.0017]),
    ("yellowbrt", [1.0, 0.7837, 0.0]),
];

/// Of surfaces of which nothing is known.
const NEUTRAL: [f32; 3] = [0.7; 3];

/// A model in an archive longer than this is taken for damage, bytes.
const LONGEST_MODEL: u64 = 1 << 28;

/// Walls and openings are parallel if the sine between them is less than this.
const PARALLEL: f64 = 0.1;

/// An opening belongs to a wall if its middle is no farther than this from the wall's faces, centimetres.
const BESIDE: f64 = 5.0;

/// A home as an OBJ.
pub(super) struct PlainHome {
    /// Its text, in centimetres, Y up.
    pub(super) text: String,
    /// Its materials.
    pub(super) materials: Vec<MtlMaterial>,
    /// How many pieces of furniture are boxes.
    pub(super) boxes: usize,
    vertices: usize,
    by_color: HashMap<[u32; 3], usize>,
}

impl PlainHome {
    /// Builds up a home; `archive` holds the models.
    pub(super) fn new(home: &Home, archive: &[u8]) -> Self {
        let mut plain =
            Self { text: String::new(), materials: Vec::new(), boxes: 0, vertices: 0, by_color: HashMap::new() };
        home.rooms.iter().enumerate().for_each(|(i, room)| plain.room(i, room));
        home.walls.iter().enumerate().for_each(|(i, wall)| plain.wall(i, wall, &home.openings));
        let mut models = Models { archive, known: HashMap::new() };
        home.pieces.iter().enumerate().for_each(|(i, piece)| plain.piece(i, piece, &mut models));
        plain
    }

    fn group(&mut self, name: std::fmt::Arguments) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "g {name}");
    }

    fn paint(&mut self, color: [f32; 3]) {
        let next = self.materials.len();
        let number = *self.by_color.entry(color.map(f32::to_bits)).or_insert(next);
        if number == next {
            let name = format!("color_{number}");
            self.materials.push(MtlMaterial { name, diffuse: Some(color), ..MtlMaterial::default() });
        }
        let _ = writeln!(self.text, "usemtl color_{number}");
    }

    fn vertex(&mut self, p: DVec3) {
        self.vertices += 1;
        let _ = writeln!(self.text, "v {} {} {}", p.x, p.y, p.z);
    }

    /// A polygon of vertices by number, from 0.
    fn face(&mut self, corners: impl Iterator<Item = usize>) {
        self.text.push('f');
        corners.for_each(|corner| _ = write!(self.text, " {}", corner + 1));
        self.text.push('\n');
    }

    /// A polygon whose front is where `normal` points.
    fn polygon(&mut self, corners: &[DVec3], normal: DVec3) {
        let first = self.vertices;
        corners.iter().for_each(|&corner| self.vertex(corner));
        let next = corners.iter().cycle().skip(1);
        let found: DVec3 = corners.iter().zip(next).map(|(a, b)| (*a - corners[0]).cross(*b - corners[0])).sum();
        let numbers = first..self.vertices;
        if found.dot(normal) < 0.0 { self.face(numbers.rev()) } else { self.face(numbers) }
    }

    fn room(&mut self, index: usize, room: &Room) {
        let at = |y: f64| room.outline.iter().map(|p| DVec3::new(p.x, y, p.y)).collect::<Vec<_>>();
        let [floor, ceiling] = [at(room.floor), at(room.ceiling)];
        for (part, color, corners, up) in [(1, room.floor_color, floor, 1.0), (2, room.ceiling_color, ceiling, -1.0)] {
            let shown = if part == 1 { room.has_floor } else { room.covered };
            if shown {
                self.group(format_args!("room_{}_{part}", index + 1));
                self.paint(color.unwrap_or(NEUTRAL));
                self.polygon(&corners, DVec3::Y * up);
            }
        }
    }

    fn wall(&mut self, index: usize, wall: &Wall, openings: &[Opening]) {
        let Some(along) = (wall.end - wall.start).try_normalize() else { return };
        let length = wall.start.distance(wall.end);
        let half = wall.thickness / 2.0;
        let [from, to] = [-wall.extension[0], length + wall.extension[1]];
        let left = DVec2::new(along.y, -along.x);
        let top = |s: f64| wall.bottom + wall.heights[0] + (wall.heights[1] - wall.heights[0]) * (s / length);
        let at = |s: f64, aside: f64, y: f64| {
            let p = wall.start + along * s + left * aside;
            DVec3::new(p.x, y.min(top(s)), p.y)
        };
        let lift = |v: DVec2| DVec3::new(v.x, 0.0, v.y);
        // Along the wall and in height.
        let gaps: Vec<[[f64; 2]; 2]> = openings
            .iter()
            .filter_map(|opening| {
                let middle = opening.in_wall() - wall.start;
                let s = middle.dot(along);
                let span = [(s - opening.width / 2.0).max(from), (s + opening.width / 2.0).min(to)];
                let [low, high] = opening.heights;
                let low = if low <= wall.bottom + 0.1 { wall.bottom } else { low };
                let belongs = middle.dot(left).abs() <= half + BESIDE && opening.along.perp_dot(along).abs() < PARALLEL;
                (belongs && span[0] < span[1] && low < high).then_some([span, [low, high]])
            })
            .collect();
        self.group(format_args!("wall_{}_1", index + 1));
        let sides = [(half, wall.colors[0]), (-half, wall.colors[1])];
        let mut cuts: Vec<f64> = gaps.iter().flat_map(|[span, _]| *span).chain([from, to]).collect();
        cuts.sort_by(f64::total_cmp);
        for ends in cuts.windows(2).filter(|ends| ends[1] - ends[0] > 1e-6) {
            let [a, b] = [ends[0], ends[1]];
            let here = gaps.iter().filter(|[span, _]| span[0] <= a && b <= span[1]).map(|[_, heights]| *heights);
            let solid = solid_parts([wall.bottom, f64::INFINITY], here);
            let across = |y: f64| [at(a, half, y), at(b, half, y), at(b, -half, y), at(a, -half, y)];
            if solid.first().is_none_or(|[low, _]| *low > wall.bottom) {
                self.paint(wall.colors[0].unwrap_or(NEUTRAL));
                // The floor of a door, which is in no room.
                self.polygon(&across(wall.bottom), DVec3::Y);
            }
            for [low, high] in solid {
                if low >= top(a).max(top(b)) {
                    continue;
                }
                for (aside, color) in sides {
                    self.paint(color.unwrap_or(NEUTRAL));
                    let corners = [at(a, aside, low), at(b, aside, low), at(b, aside, high), at(a, aside, high)];
                    self.polygon(&corners, lift(left * aside));
                }
                self.paint(wall.colors[0].unwrap_or(NEUTRAL));
                self.polygon(&across(high), DVec3::Y);
                if low > wall.bottom {
                    self.polygon(&across(low), DVec3::NEG_Y);
                }
            }
        }
        self.paint(wall.colors[0].unwrap_or(NEUTRAL));
        let mut upright = |s: f64, [low, high]: [f64; 2], toward: f64| {
            let corners = [at(s, half, low), at(s, -half, low), at(s, -half, high), at(s, half, high)];
            self.polygon(&corners, lift(along * toward));
        };
        for [span, heights] in gaps {
            if span[0] > from {
                upright(span[0], heights, 1.0);
            }
            if span[1] < to {
                upright(span[1], heights, -1.0);
            }
        }
        for (s, extension, toward) in [(from, wall.extension[0], -1.0), (to, wall.extension[1], 1.0)] {
            if extension == 0.0 {
                upright(s, [wall.bottom, f64::INFINITY], toward);
            }
        }
    }

    fn piece(&mut self, index: usize, piece: &Piece, models: &mut Models) {
        let kind = if piece.is_opening { "door" } else { "piece" };
        let model = piece.model.as_deref().and_then(|name| models.get(name));
        let turn = DMat3::from_rotation_y(-piece.angle);
        let place =
            |p: DVec3| turn * p + DVec3::new(piece.centre.x, piece.elevation + piece.size.y / 2.0, piece.centre.y);
        let Some(model) = model else {
            // A door without a model is a hole in its wall.
            if !piece.is_opening {
                self.boxes += 1;
                self.group(format_args!("{kind}_{}_box_1", index + 1));
                self.paint(piece.color.unwrap_or(NEUTRAL));
                self.cuboid(piece.size / 2.0, place, turn);
            }
            return;
        };
        let rotation = piece.rotation.unwrap_or(DMat3::IDENTITY);
        let turned: Vec<DVec3> = model.positions.iter().map(|&p| rotation * p).collect();
        let low = turned.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = turned.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        let extent = (high - low).max(DVec3::splat(f64::MIN_POSITIVE));
        let mirror = if piece.mirrored { DVec3::new(-1.0, 1.0, 1.0) } else { DVec3::ONE };
        let first = self.vertices;
        for p in turned {
            self.vertex(place((p - (low + high) / 2.0) / extent * piece.size * mirror));
        }
        for (part, faces) in model.parts.iter().enumerate() {
            self.group(format_args!("{kind}_{}_{}_{}", index + 1, faces.group, part + 1));
            let said = piece.materials.iter().find(|(name, _)| *name == faces.material).map(|(_, color)| *color);
            let known = || KNOWN_COLORS.iter().find(|(name, _)| *name == faces.material).map(|(_, color)| *color);
            self.paint(said.or(piece.color).or_else(known).unwrap_or(NEUTRAL));
            for polygon in &faces.polygons {
                let corners = polygon.iter().map(|&corner| first + corner);
                if piece.mirrored { self.face(corners.rev()) } else { self.face(corners) }
            }
        }
    }

    fn cuboid(&mut self, half: DVec3, place: impl Fn(DVec3) -> DVec3, turn: DMat3) {
        for axis in 0..3 {
            let [u, v] = [DVec3::AXES[(axis + 1) % 3] * half, DVec3::AXES[(axis + 2) % 3] * half];
            for side in [-1.0, 1.0] {
                let middle = DVec3::AXES[axis] * half * side;
                let corners = [middle - u - v, middle + u - v, middle + u + v, middle - u + v].map(&place);
                self.polygon(&corners, turn * DVec3::AXES[axis] * side);
            }
        }
    }
}

/// What gaps leave of a range, from below.
fn solid_parts(whole: [f64; 2], gaps: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    gaps.fold(vec![whole], |parts, [low, high]| {
        let cut = |[from, to]: [f64; 2]| [[from, to.min(low)], [from.max(high), to]];
        parts.into_iter().flat_map(cut).filter(|[from, to]| from < to).collect()
    })
}

/// The faces of one group and material.
struct FaceGroup {
    group: String,
    material: String,
    /// Corners by number, from 0.
    polygons: Vec<Vec<usize>>,
}

/// A model from an archive.
struct Model {
    positions: Vec<DVec3>,
    parts: Vec<FaceGroup>,
}

/// The models of an archive, each read once.
struct Models<'a> {
    archive: &'a [u8],
    known: HashMap<String, Option<Model>>,
}

impl Models<'_> {
    /// A model by its name in the archive, if it is there and an OBJ.
    fn get(&mut self, name: &str) -> Option<&Model> {
        let archive = self.archive;
        let read = || {
            let mut archive = zip::ZipArchive::new(Cursor::new(archive)).ok()?;
            let mut bytes = Vec::new();
            archive.by_name(name).ok()?.take(LONGEST_MODEL).read_to_end(&mut bytes).ok()?;
            Model::parse(&decode(&bytes))
        };
        self.known.entry(name.to_owned()).or_insert_with(read).as_ref()
    }
}

impl Model {
    /// The faces of an OBJ; `None` if there are none, or one refers to a vertex that is not there.
    fn parse(text: &str) -> Option<Self> {
        let mut model = Self { positions: Vec::new(), parts: Vec::new() };
        let (mut group, mut material) = (String::new(), String::new());
        for (_, line) in lines(text) {
            let (word, rest) = keyword(&line);
            match word {
                "v" => {
                    let mut numbers =
                        rest.split_whitespace().map(|word| word.parse().ok().filter(|v: &f64| v.is_finite()));
                    let mut next = || numbers.next().flatten();
                    model.positions.push(DVec3::new(next()?, next()?, next()?));
                }
                "g" | "o" => group = rest.replace(char::is_whitespace, "_"),
                "usemtl" => material = rest.to_owned(),
                "f" => {
                    let count = model.positions.len() as i64;
                    let corner = |word: &str| {
                        let number: i64 = word.split('/').next()?.parse().ok()?;
                        let index = if number < 0 { count + number } else { number - 1 };
                        usize::try_from(index).ok().filter(|&index| (index as i64) < count)
                    };
                    let polygon: Vec<usize> = rest.split_whitespace().map(corner).collect::<Option<_>>()?;
                    if polygon.len() < 3 {
                        continue;
                    }
                    match model.parts.iter_mut().find(|part| part.group == group && part.material == material) {
                        Some(part) => part.polygons.push(polygon),
                        None => model.parts.push(FaceGroup {
                            group: group.clone(),
                            material: material.clone(),
                            polygons: vec![polygon],
                        }),
                    }
                }
                _ => {}
            }
        }
        (!model.parts.is_empty()).then_some(model)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_leave_what_is_below_above_and_between() {
        let parts = |gaps: &[[f64; 2]]| solid_parts([0.0, 9.0], gaps.iter().copied());
        assert_eq!(parts(&[]), [[0.0, 9.0]]);
        assert_eq!(parts(&[[0.0, 2.0]]), [[2.0, 9.0]]);
        assert_eq!(parts(&[[1.0, 2.0], [5.0, 6.0]]), [[0.0, 1.0], [2.0, 5.0], [6.0, 9.0]]);
        assert_eq!(parts(&[[1.0, 5.0], [3.0, 6.0]]), [[0.0, 1.0], [6.0, 9.0]]);
        assert!(parts(&[[-1.0, 10.0]]).is_empty());
    }

    #[test]
    fn a_model_is_read_by_group_and_material() {
        let model =
            Model::parse("v 0 0 0\nv 1 0 0\nv 1 1 0\ng a b\nusemtl red\nf 1/4/5 2//7 3\nusemtl blue\nf -3 -2 -1\n");
        let model = model.expect("two faces");
        let parts: Vec<_> =
            model.parts.iter().map(|p| (p.group.as_str(), p.material.as_str(), &p.polygons[0][..])).collect();
        assert_eq!(parts, [("a_b", "red", &[0, 1, 2][..]), ("a_b", "blue", &[0, 1, 2][..])]);
        for bad in ["", "v 0 0 0\n", "v 0 0\nf 1 1 1\n", "v 0 0 0\nf 1 1 2\n", "v 0 0 0\nf 0 1 1\n", "f 1 2 x"] {
            assert!(Model::parse(bad).is_none(), "{bad}");
        }
    }
}
