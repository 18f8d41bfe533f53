//! Prepares the text of an OBJ for `tobj`, which rejects a whole file for defects of real files: a
//! face that refers to a later vertex or to none, a face without the texture coordinate that its
//! neighbour has, a weight of 0, `nan(ind)`, a comment after the numbers, a `usemtl` before a tab.
//!
//! The prepared text has one `mtllib`, all `v`, `vt` and `vn` lines, a neutral `vt` and `vn`, then
//! the faces and their `usemtl` and `g` lines. Each corner of a face has absolute indices of all
//! vertex attributes that the file has; missing ones are those of the neutral entries.

use crate::load::lines::{has_decimal_comma, keyword, lines, number, words};
use crate::load::notes::{Note, Notes};
use crate::load::orientation::AxisAreas;
use crate::load::vertex_colors::VertexColors;
use glam::DVec3;
use std::collections::BTreeSet;
use std::fmt::Write as _;

/// Name of the material of faces after a `usemtl` without a name, which no material has.
const NO_MATERIAL: &str = "\u{1}";

/// Parts of the names of groups and materials of floors, in lower case.
const FLOOR_NAMES: [&str; 7] = [
    "floor", "ground", "carpet", "parquet", "ceiling", "grass", "pavement",
];

/// Statements of the format (Wavefront's appendix B1) without triangles.
const IGNORED: &str = "mtllib vp s deg bmat step cstype parm trim hole scrv sp end con mg \
    bevel c_interp d_interp lod shadow_obj trace_obj ctech stech maplib usemap call csh res bsp \
    bzp cdc cdp vs";

/// A text that `tobj` reads without an error, and what else the file states.
#[derive(Default)]
pub(crate) struct PreparedObj {
    pub(crate) text: String,
    /// Numbers of `v`, `vt` and `vn` lines.
    pub(super) totals: Counts,
    /// Number of vertices of the mesh, or a few more: a position counts again if its texture
    /// coordinate or normal is not that of its last corner.
    pub(crate) vertices: usize,
    /// Number of triangles of all faces.
    pub(crate) triangles: usize,
    /// Arguments of the `mtllib` statements.
    pub(super) libraries: Vec<String>,
    /// Names of the `usemtl` statements.
    pub(super) used_materials: BTreeSet<String>,
    /// Faces in groups or with materials that have the name of a floor.
    pub(crate) floors: AxisAreas,
    pub(crate) notes: Notes,
}

/// A line that is not an OBJ statement.
#[derive(Debug)]
pub(crate) struct LineError {
    /// Line number, from 1.
    pub(crate) line: usize,
    pub(crate) cause: String,
}

/// Numbers of `v`, `vt` and `vn` lines.
pub(crate) type Counts = [usize; 3];

/// Prepares a text; `keep_groups` passes `g` and `o` lines on, each as a `g`.
pub(super) fn prepare(text: &str, keep_groups: bool) -> Result<PreparedObj, LineError> {
    let mut totals = Counts::default();
    for (_, line) in lines(text) {
        count(keyword(&line).0, &mut totals);
    }
    let mut preparation = Preparation {
        totals,
        keep_groups,
        last_corners: vec![None; totals[0]],
        ..Preparation::default()
    };
    for (number, line) in lines(text) {
        preparation.add_line(number, &line).map_err(|expected| {
            let shown: String = line.chars().take(80).collect();
            let hint = if has_decimal_comma(&line) {
                "; it has a decimal comma: write 0.5 for 0,5"
            } else {
                ""
            };
            LineError {
                line: number,
                cause: format!("\"{shown}\" is not {expected}{hint}"),
            }
        })?;
    }
    Ok(preparation.finish())
}

/// Counts a `v`, `vt` or `vn`.
fn count(keyword: &str, counts: &mut Counts) {
    match keyword {
        "v" => counts[0] += 1,
        "vt" => counts[1] += 1,
        "vn" => counts[2] += 1,
        _ => {}
    }
}

/// State of the preparation at a line.
#[derive(Default)]
struct Preparation {
    totals: Counts,
    keep_groups: bool,
    /// Vertex lines so far, for relative indices.
    counts: Counts,
    positions: Vec<DVec3>,
    /// For each position, the texture coordinate and normal of its last corner.
    last_corners: Vec<Option<[u32; 2]>>,
    /// `v` lines without colours.
    vertices: String,
    colors: VertexColors,
    /// `vt` and `vn` lines.
    attributes: String,
    faces: String,
    group_is_floor: bool,
    material_is_floor: bool,
    /// Keyword of a group without a face so far.
    empty_group: Option<char>,
    obj: PreparedObj,
}

impl Preparation {
    /// Adds a line; fails with a description of what it should have been.
    fn add_line(&mut self, number: usize, line: &str) -> Result<(), &'static str> {
        let (word, rest) = keyword(line);
        count(word, &mut self.counts);
        match word {
            "v" => self.add_position(number, rest)?,
            "vt" => {
                // The second coordinate may be absent.
                copy_numbers::<2>("vt", words(rest).chain(["0"]), &mut self.attributes)
                    .ok_or("a texture coordinate: two numbers")?;
            }
            "vn" => {
                copy_numbers::<3>("vn", words(rest), &mut self.attributes)
                    .ok_or("a normal: three numbers")?;
            }
            "f" | "fo" => self.add_face(rest)?,
            "usemtl" => self.use_material(rest),
            "mtllib" if !rest.is_empty() => self.obj.libraries.push(rest.to_owned()),
            "o" => self.begin_group('o', rest),
            // Maya puts the vertices of every mesh into a group of this name.
            "g" if rest == "default" => {}
            "g" => self.begin_group('g', rest),
            "l" | "p" | "curv" | "curv2" | "surf" => self.obj.notes.add(Note::NonTriangles, 1),
            "#MRGB" => self.colors.add_polypaint(rest),
            word if word.is_empty() || word.starts_with('#') => {}
            word if IGNORED.split_whitespace().any(|known| known == word) => {}
            _ => self.obj.notes.add(Note::LineUnread, 1),
        }
        Ok(())
    }

    fn add_position(&mut self, line: usize, rest: &str) -> Result<(), &'static str> {
        let position = copy_numbers("v", words(rest), &mut self.vertices)
            .map(DVec3::from_array)
            .ok_or("a position: three numbers")?;
        if !position.is_finite() {
            self.obj
                .notes
                .add_numbered(Note::VertexNotFinite, "line", line);
        }
        // Fewer than three more numbers are a weight.
        let color = words(rest).nth(5).map(|_| numbers(words(rest).skip(3)));
        self.colors.add_vertex(color);
        self.positions.push(position);
        Ok(())
    }

    fn use_material(&mut self, name: &str) {
        self.material_is_floor = is_floor(name);
        if name.is_empty() {
            write_line(&mut self.faces, format_args!("usemtl {NO_MATERIAL}"));
        } else {
            write_line(&mut self.faces, format_args!("usemtl {name}"));
            self.obj.used_materials.insert(name.to_owned());
        }
    }

    fn begin_group(&mut self, keyword: char, name: &str) {
        self.group_is_floor = is_floor(name);
        self.count_empty_group(Some(keyword));
        if self.keep_groups {
            write_line(&mut self.faces, format_args!("g {name}"));
        }
    }

    /// Counts the group that ends if it has no face. A `g` directly after an `o` is a part of it.
    fn count_empty_group(&mut self, next: Option<char>) {
        let is_part = self.empty_group == Some('o') && next == Some('g');
        if self.empty_group.is_some() && !is_part {
            self.obj.notes.add(Note::EmptyGroup, 1);
        }
        self.empty_group = next;
    }

    fn add_face(&mut self, rest: &str) -> Result<(), &'static str> {
        self.empty_group = None;
        let corners: Option<Vec<Corner>> = words(rest).map(|word| self.corner(word)).collect();
        let corners = corners.ok_or("a face: three or more corners V, V/T, V//N or V/T/N")?;
        let notes = &mut self.obj.notes;
        if corners.len() < 3 {
            notes.add(Note::FaceTooShort, 1);
            return Ok(());
        }
        if corners.iter().any(|[p, ..]| !matches!(p, Index::Valid(_))) {
            notes.add(Note::FaceIndexOutOfRange, 1);
            return Ok(());
        }
        if corners.as_flattened().contains(&Index::OutOfRange) {
            notes.add(Note::AttributeIndexOutOfRange, 1);
        }
        self.obj.triangles += corners.len() - 2;
        self.faces.push('f');
        for corner in &corners {
            self.count_vertex(corner);
            let mut separator = ' ';
            for (index, total) in corner.iter().zip(self.totals) {
                self.faces.push(separator);
                // Writing to a string cannot fail.
                let _ = match index {
                    Index::Valid(index) => write!(self.faces, "{}", index + 1),
                    _ if total > 0 => write!(self.faces, "{}", total + 1),
                    _ => Ok(()),
                };
                separator = '/';
            }
        }
        self.faces.push('\n');
        if self.group_is_floor || self.material_is_floor {
            self.obj.floors.add(self.area(&corners));
        }
        Ok(())
    }

    fn count_vertex(&mut self, corner: &Corner) {
        let [texcoord, normal] = [corner[1], corner[2]].map(|index| match index {
            Index::Valid(index) => index as u32,
            Index::Missing | Index::OutOfRange => u32::MAX,
        });
        let Index::Valid(position) = corner[0] else {
            return;
        };
        let last = &mut self.last_corners[position];
        if last.replace([texcoord, normal]) != Some([texcoord, normal]) {
            self.obj.vertices += 1;
        }
    }

    /// Parses a corner of a face; `None` if it is not one.
    fn corner(&self, word: &str) -> Option<Corner> {
        let mut corner = [Index::Missing; 3];
        for (attribute, part) in word.split('/').enumerate() {
            let index = corner.get_mut(attribute)?;
            if !part.is_empty() {
                let written = part.parse().ok()?;
                *index = Index::resolve(written, self.counts[attribute], self.totals[attribute]);
            }
        }
        Some(corner)
    }

    /// Returns the area of a face times its normal; NaN if a corner is further down in the file.
    fn area(&self, corners: &[Corner]) -> DVec3 {
        let position = |[index, ..]: &Corner| match index {
            Index::Valid(index) => self.positions.get(*index).copied().unwrap_or(DVec3::NAN),
            _ => DVec3::NAN,
        };
        let positions: Vec<DVec3> = corners.iter().map(position).collect();
        let fan = positions[1..].windows(2);
        fan.map(|edge| (edge[0] - positions[0]).cross(edge[1] - positions[0]) / 2.0)
            .sum()
    }

    fn finish(mut self) -> PreparedObj {
        self.count_empty_group(None);
        let colors = self.colors.finish(&mut self.obj.notes);
        let mut text = "mtllib all\n".to_owned();
        if colors.is_empty() {
            text += &self.vertices;
        }
        // `tobj` needs a colour for each vertex or none.
        for (vertex, [r, g, b]) in self.vertices.lines().zip(colors) {
            write_line(&mut text, format_args!("{vertex} {r} {g} {b}"));
        }
        text += &self.attributes;
        if self.totals[1] > 0 {
            text += "vt 0 0\n";
        }
        if self.totals[2] > 0 {
            text += "vn 0 0 0\n";
        }
        text += &self.faces;
        PreparedObj {
            text,
            totals: self.totals,
            ..self.obj
        }
    }
}

fn is_floor(name: &str) -> bool {
    let name = name.to_lowercase();
    FLOOR_NAMES.iter().any(|floor| name.contains(floor))
}

fn write_line(text: &mut String, line: std::fmt::Arguments) {
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{line}");
}

/// Parses the first N words and adds a line of them that `tobj` reads; `None` if one of them is
/// missing or not a number.
fn copy_numbers<'a, const N: usize>(
    keyword: &str,
    mut words: impl Iterator<Item = &'a str>,
    text: &mut String,
) -> Option<[f64; N]> {
    text.push_str(keyword);
    let mut numbers = [0.0; N];
    for value in &mut numbers {
        let word = words.next()?;
        *value = number(word)?;
        text.push(' ');
        text.push_str(if value.is_nan() { "NaN" } else { word });
    }
    text.push('\n');
    Some(numbers)
}

/// Parses the first N words; `None` if one of them is missing or not a number.
fn numbers<'a, const N: usize>(mut words: impl Iterator<Item = &'a str>) -> Option<[f64; N]> {
    let mut numbers = [0.0; N];
    for value in &mut numbers {
        *value = number(words.next()?)?;
    }
    Some(numbers)
}

/// Index of a vertex attribute, from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Index {
    Missing,
    OutOfRange,
    Valid(usize),
}

/// Indices of the position, the texture coordinate and the normal of a corner.
type Corner = [Index; 3];

impl Index {
    /// Resolves an index of a file: from 1, or from -1 backwards from the `count` so far.
    fn resolve(written: i64, count: usize, total: usize) -> Self {
        let index = match usize::try_from(written.unsigned_abs()) {
            Ok(magnitude) if written > 0 => Some(magnitude - 1),
            Ok(magnitude) if written < 0 => count.checked_sub(magnitude),
            _ => None,
        };
        let index = index.filter(|&index| index < total);
        index.map_or(Self::OutOfRange, Self::Valid)
    }
}
