//! Mends the lines of an OBJ file before `tobj` parses them.
//!
//! `tobj` gives up on the whole file for things that real files contain: an index that is out of range or refers to a
//! vertex further down, a face with a texture coordinate that its neighbour lacks (the arrays then no longer run in
//! parallel), a vertex with a weight of 0, `nan(ind)`, a comment behind the numbers, a `usemtl` behind a tab. So it reads from [`MendedObj`], which
//! hands out, line by line and without a second copy of the text: one `mtllib`; then all `v`, `vt` and `vn` lines;
//! then a neutral `vt` and `vn`; then the faces with absolute indices, each corner complete, between their `usemtl`
//! lines. What cannot be mended goes through as it is, for `tobj` to reject: [`MendedObj::last_line`] is then the
//! line to blame.

use super::lines::{keyword, lines, words};
use super::notes::{Note, Notes};
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::io::{self, BufRead, Read};

/// The name under which faces below a `usemtl` without a name go: one that nobody gives to a material.
const NO_MATERIAL: &str = "\u{1}";

/// Statements of the format (Wavefront's appendix B1) that say nothing of triangles, or are read elsewhere.
const WITHOUT_SURFACE: [&str; 36] = [
    "v",
    "vt",
    "vn",
    "vp",
    "mtllib",
    "s",
    "deg",
    "bmat",
    "step",
    "cstype",
    "parm",
    "trim",
    "hole",
    "scrv",
    "sp",
    "end",
    "con",
    "mg",
    "bevel",
    "c_interp",
    "d_interp",
    "lod",
    "shadow_obj",
    "trace_obj",
    "ctech",
    "stech",
    "maplib",
    "usemap",
    "call",
    "csh",
    "res",
    "bsp",
    "bzp",
    "cdc",
    "cdp",
    "vs",
];

/// Numbers of `v`, `vt` and `vn` lines.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    positions: usize,
    texcoords: usize,
    normals: usize,
}

impl Counts {
    fn count(&mut self, keyword: &str) {
        match keyword {
            "v" => self.positions += 1,
            "vt" => self.texcoords += 1,
            "vn" => self.normals += 1,
            _ => {}
        }
    }
}

/// What must be known of the whole file before its first line can be mended.
#[derive(Debug, Default)]
pub(super) struct Survey {
    totals: Counts,
    has_colors: bool,
    /// What follows `mtllib`, as it is written.
    pub(super) libraries: Vec<String>,
    /// Names that follow `usemtl`.
    pub(super) used_materials: BTreeSet<String>,
}

impl Survey {
    pub(super) fn of(text: &str) -> Self {
        let mut survey = Self::default();
        for (_, line) in lines(text) {
            let (word, rest) = keyword(&line);
            survey.totals.count(word);
            match word {
                "v" => survey.has_colors |= words(rest).nth(5).is_some(),
                "mtllib" if !rest.is_empty() => survey.libraries.push(rest.to_owned()),
                "usemtl" if !rest.is_empty() => {
                    survey.used_materials.insert(rest.to_owned());
                }
                _ => {}
            }
        }
        survey
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Library,
    Vertices,
    Neutral,
    Faces,
    End,
}

type Lines<'a> = Box<dyn Iterator<Item = (usize, Cow<'a, str>)> + 'a>;

/// The mended text, as a reader.
pub(super) struct MendedObj<'a> {
    text: &'a str,
    survey: &'a Survey,
    phase: Phase,
    lines: Lines<'a>,
    line_number: usize,
    line: Cow<'a, str>,
    /// Vertices above the current line, for relative indices.
    so_far: Counts,
    /// `o` or `g` of a group that has no face yet.
    faceless_group: Option<char>,
    /// Whether `g` and `o` lines are handed on, each as a `g`.
    keep_groups: bool,
    out: Vec<u8>,
    read: usize,
    pub(super) notes: Notes,
}

impl<'a> MendedObj<'a> {
    pub(super) fn new(text: &'a str, survey: &'a Survey, keep_groups: bool) -> Self {
        Self {
            text,
            survey,
            phase: Phase::Library,
            lines: Box::new(lines(text)),
            line_number: 0,
            line: Cow::Borrowed(""),
            so_far: Counts::default(),
            faceless_group: None,
            keep_groups,
            out: Vec::new(),
            read: 0,
            notes: Notes::default(),
        }
    }

    /// The line of the file that was handed out last: its number, from 1, and its text.
    pub(super) fn last_line(&self) -> (usize, &str) {
        (self.line_number, &self.line)
    }

    /// Puts the next mended line or lines into `out`; leaves it empty at the end of the text.
    fn advance(&mut self) {
        self.out.clear();
        self.read = 0;
        while self.out.is_empty() && self.phase != Phase::End {
            match self.phase {
                Phase::Library => {
                    self.emit("mtllib all");
                    self.phase = Phase::Vertices;
                }
                Phase::Neutral => {
                    if self.survey.totals.texcoords > 0 {
                        self.emit("vt 0 0");
                    }
                    if self.survey.totals.normals > 0 {
                        self.emit("vn 0 0 0");
                    }
                    self.lines = Box::new(lines(self.text));
                    self.phase = Phase::Faces;
                }
                Phase::Vertices | Phase::Faces => self.advance_in_text(),
                Phase::End => {}
            }
        }
    }

    fn advance_in_text(&mut self) {
        let Some((number, line)) = self.lines.next() else {
            if self.phase == Phase::Faces {
                self.begin_group(None);
            }
            self.phase = if self.phase == Phase::Vertices {
                Phase::Neutral
            } else {
                Phase::End
            };
            return;
        };
        let (word, rest) = keyword(&line);
        if self.phase == Phase::Vertices {
            self.mend_vertex(number, word, rest);
        } else {
            self.mend_element(word, rest);
        }
        (self.line_number, self.line) = (number, line);
    }

    fn emit(&mut self, line: &str) {
        self.out.extend_from_slice(line.as_bytes());
        self.out.push(b'\n');
    }

    fn mend_vertex(&mut self, line: usize, word: &str, rest: &str) {
        let numbers: Vec<&str> = match word {
            "v" | "vn" => words(rest).take(3).map(number).collect(),
            // A texture coordinate may have one component only.
            "vt" => words(rest)
                .take(2)
                .map(number)
                .chain(["0"])
                .take(2)
                .collect(),
            _ => return,
        };
        if word == "v" && numbers.iter().any(|number| is_not_finite(number)) {
            self.notes.add_numbered(Note::VertexNotFinite, "line", line);
        }
        let mut mended = format!("{word} {}", numbers.join(" "));
        if word == "v" && self.survey.has_colors {
            let colors: Vec<&str> = words(rest).skip(3).take(3).collect();
            let given =
                colors.len() == 3 && colors.iter().all(|color| color.parse::<f64>().is_ok());
            mended += " ";
            mended += &if given {
                colors.join(" ")
            } else {
                "1 1 1".to_owned()
            };
        }
        self.emit(&mended);
    }

    fn mend_element(&mut self, word: &str, rest: &str) {
        self.so_far.count(word);
        match word {
            "f" | "fo" => self.mend_face(rest),
            "usemtl" => self.emit(&format!(
                "usemtl {}",
                if rest.is_empty() { NO_MATERIAL } else { rest }
            )),
            "o" => self.begin_named_group('o', rest),
            // Maya puts the vertices of every mesh into a group of this name, which is not a defect.
            "g" if rest == "default" => {}
            "g" => self.begin_named_group('g', rest),
            "l" | "p" | "curv" | "curv2" | "surf" => self.notes.add(Note::NonTriangles, 1),
            word if word.is_empty() || word.starts_with('#') || WITHOUT_SURFACE.contains(&word) => {
            }
            _ => self.notes.add(Note::LineUnread, 1),
        }
    }

    /// Counts the group that ends here, and hands on the name of the next where groups are wanted.
    fn begin_named_group(&mut self, keyword: char, name: &str) {
        self.begin_group(Some(keyword));
        if self.keep_groups {
            self.emit(&format!("g {name}"));
        }
    }

    /// Counts the group that ends here if it has no face. A `g` directly below an `o` is a part of it.
    fn begin_group(&mut self, keyword: Option<char>) {
        let part_of_object = self.faceless_group == Some('o') && keyword == Some('g');
        if self.faceless_group.is_some() && !part_of_object {
            self.notes.add(Note::EmptyGroup, 1);
        }
        self.faceless_group = keyword;
    }

    fn mend_face(&mut self, rest: &str) {
        self.faceless_group = None;
        let corners: Option<Vec<Corner>> = words(rest).map(|word| self.corner(word)).collect();
        let Some(corners) = corners else {
            return self.emit(&format!("f {rest}")); // for `tobj` to reject
        };
        if corners.len() < 3 {
            return self.notes.add(Note::FaceTooShort, 1);
        }
        if corners
            .iter()
            .any(|corner| matches!(corner[0], Index::OutOfRange | Index::Absent))
        {
            return self.notes.add(Note::FaceIndexOutOfRange, 1);
        }
        if corners
            .iter()
            .flatten()
            .any(|&index| index == Index::OutOfRange)
        {
            self.notes.add(Note::AttributeIndexOutOfRange, 1);
        }
        let totals = self.survey.totals;
        let mut mended = "f".to_owned();
        for [position, texcoord, normal] in corners {
            let or_neutral = |index: Index, total: usize| match index {
                Index::At(index) => (index + 1).to_string(),
                _ if total > 0 => (total + 1).to_string(),
                _ => String::new(),
            };
            mended += &format!(
                " {}/{}/{}",
                or_neutral(position, 0),
                or_neutral(texcoord, totals.texcoords),
                or_neutral(normal, totals.normals)
            );
        }
        self.emit(&mended);
    }

    /// Position, texture coordinate and normal of a corner; `None` if it is not written as OBJ demands.
    fn corner(&self, word: &str) -> Option<Corner> {
        let (so_far, totals) = (self.so_far, self.survey.totals);
        let counts = [
            (so_far.positions, totals.positions),
            (so_far.texcoords, totals.texcoords),
            (so_far.normals, totals.normals),
        ];
        let mut corner = [Index::Absent; 3];
        for (place, part) in word.split('/').enumerate() {
            let index = corner.get_mut(place)?;
            if !part.is_empty() {
                *index = Index::resolve(part.parse().ok()?, counts[place]);
            }
        }
        Some(corner)
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Index {
    Absent,
    OutOfRange,
    /// From 0.
    At(usize),
}

type Corner = [Index; 3];

impl Index {
    /// An index as OBJ writes it: from 1, or from -1 backward from the current line.
    fn resolve(written: i64, (so_far, total): (usize, usize)) -> Self {
        let index = match usize::try_from(written.unsigned_abs()) {
            Ok(magnitude) if written > 0 => Some(magnitude - 1),
            Ok(magnitude) if written < 0 => so_far.checked_sub(magnitude),
            _ => None,
        };
        index
            .filter(|&index| index < total)
            .map_or(Self::OutOfRange, Self::At)
    }
}

/// A number as Rust reads it: the many spellings of "not a number" and infinity become `nan`.
fn number(word: &str) -> &str {
    let plain = word
        .bytes()
        .all(|b| b.is_ascii_digit() || b"+-.eE".contains(&b));
    let lower = if plain {
        String::new()
    } else {
        word.to_ascii_lowercase()
    };
    if ["nan", "inf", "ind", "#"]
        .iter()
        .any(|sign| lower.contains(sign))
    {
        "nan"
    } else {
        word
    }
}

/// Whether `tobj` will read a number as NaN or infinite: only such as have a letter in them.
fn is_not_finite(number: &str) -> bool {
    number.bytes().any(|byte| byte.is_ascii_alphabetic())
        && number.parse::<f64>().is_ok_and(|value| !value.is_finite())
}

impl Read for MendedObj<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(buffer)?;
        self.consume(count);
        Ok(count)
    }
}

impl BufRead for MendedObj<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.read == self.out.len() {
            self.advance();
        }
        Ok(&self.out[self.read..])
    }

    fn consume(&mut self, amount: usize) {
        self.read = (self.read + amount).min(self.out.len());
    }
}
