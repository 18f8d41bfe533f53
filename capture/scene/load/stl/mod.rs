//! STL meshes, ASCII and binary.
//!
//! Many binary files begin with `solid`, the keyword of the ASCII form; the size of the file
//! decides, else the presence of control characters. Normals are those of the triangles. Axes and
//! unit are guessed as those of an OBJ.

#[cfg(test)]
mod tests;

use super::builder::{Builder, GroupedScene, MeshError};
use super::encoding::decode_text;
use super::lines::{has_decimal_comma, keyword, lines, number};
use super::notes::{Note, Notes};
use super::orientation::{AxisAreas, FrameHints, comment_words};
use super::polygon::triangulate;
use super::{LoadError, LoadOptions, file_stem};
use crate::material::Material;
use crate::scene::Vertex;
use glam::{DVec3, Vec2, Vec3};
use std::path::Path;

/// Size of the header of a binary file, bytes: a comment and the number of triangles.
const HEADER: usize = 84;
/// Size of a triangle of a binary file, bytes.
const RECORD: usize = 50;
/// Number of bytes in which a binary file is told from a text.
const SAMPLE: usize = 1024;

/// Loads an STL.
pub(super) fn load(
    path: &Path,
    bytes: &[u8],
    options: &LoadOptions,
    groups: bool,
) -> Result<GroupedScene, LoadError> {
    let is_text = bytes
        .get(80..HEADER)
        .and_then(|count| count.try_into().ok())
        .is_none_or(|count| binary_size(u32::from_le_bytes(count)) != bytes.len() as u64)
        && is_ascii_form(bytes);
    let comment = if is_text {
        let end = bytes.iter().position(|b| matches!(b, b'\n' | b'\r'));
        &bytes[..end.unwrap_or(bytes.len())]
    } else {
        &bytes[..bytes.len().min(80)]
    };
    let comment = String::from_utf8_lossy(comment);
    let hints = FrameHints {
        options: *options,
        comments: comment_words(comment.lines()),
        floors: AxisAreas::default(),
    };
    let mut builder = Builder::with_hints(hints, Notes::default());
    if is_text {
        read_text(path, bytes, groups, &mut builder)?;
    } else {
        if groups {
            builder.begin_group(&file_stem(path));
        }
        read_binary(path, bytes, &mut builder)?;
    }
    builder.finish(path, vec![Material::default()], Vec::new())
}

/// Returns the size of a binary file, bytes.
fn binary_size(triangles: u32) -> u64 {
    HEADER as u64 + u64::from(triangles) * RECORD as u64
}

fn is_ascii_form(bytes: &[u8]) -> bool {
    let is_control = |byte: &u8| byte.is_ascii_control() && !byte.is_ascii_whitespace();
    let start = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let start = start.trim_ascii_start();
    start
        .get(..5)
        .is_some_and(|word| word.eq_ignore_ascii_case(b"solid"))
        && !start.iter().take(SAMPLE).any(is_control)
}

fn read_binary(path: &Path, bytes: &[u8], builder: &mut Builder) -> Result<(), LoadError> {
    let malformed = |cause: String| LoadError::malformed(path, cause);
    let count = bytes
        .get(80..HEADER)
        .and_then(|count| count.try_into().ok())
        .map(u32::from_le_bytes)
        .ok_or_else(|| malformed("not an STL: neither \"solid\" nor a binary header".into()))?;
    let size = binary_size(count);
    if size > bytes.len() as u64 {
        return Err(malformed(format!(
            "its header declares {count} triangles, which need {size} bytes, but it has {}; it is \
             damaged, incomplete or not an STL",
            bytes.len()
        )));
    }
    builder
        .notes
        .add(Note::TrailingBytes, bytes.len() - size as usize);
    let has_default_color = bytes[..80].windows(6).any(|word| word == b"COLOR=");
    builder
        .notes
        .add(Note::StlColorIgnored, usize::from(has_default_color));
    let (records, _) = bytes[HEADER..size as usize].as_chunks::<RECORD>();
    for (index, record) in records.iter().enumerate() {
        // A normal, three corners, and an attribute, in which some programs write a colour.
        let (numbers, attribute) = record.as_chunks::<4>();
        builder
            .notes
            .add(Note::StlColorIgnored, usize::from(attribute != [0, 0]));
        let coordinate = |i: usize| f64::from(f32::from_le_bytes(numbers[i]));
        let corners = [3, 6, 9].map(|first| {
            DVec3::new(
                coordinate(first),
                coordinate(first + 1),
                coordinate(first + 2),
            )
        });
        if corners.iter().any(|corner| !corner.is_finite()) {
            builder
                .notes
                .add_numbered(Note::VertexNotFinite, "triangle", index);
        }
        push_polygon(&corners, builder).map_err(|error| error.in_file(path))?;
    }
    Ok(())
}

fn read_text(
    path: &Path,
    bytes: &[u8],
    groups: bool,
    builder: &mut Builder,
) -> Result<(), LoadError> {
    let text = decode_text(bytes, "the STL", &mut builder.notes);
    let error = |line: usize, cause: String| LoadError::Line {
        path: path.to_path_buf(),
        line,
        cause,
    };
    let mut corners = Vec::new();
    let mut last = 0;
    for (line_number, line) in lines(&text) {
        last = line_number;
        for statement in statements(&line) {
            let (word, rest) = keyword(statement);
            match word.to_ascii_lowercase().as_str() {
                "vertex" => {
                    let mut numbers = rest.split_whitespace().map(number);
                    let mut next = || numbers.next().flatten();
                    let (Some(x), Some(y), Some(z)) = (next(), next(), next()) else {
                        let shown: String = statement.chars().take(80).collect();
                        let hint = if has_decimal_comma(rest) {
                            "; it has a decimal comma: write 0.5 for 0,5"
                        } else {
                            ""
                        };
                        let cause = format!("\"{shown}\" is not a vertex: three numbers{hint}");
                        return Err(error(line_number, cause));
                    };
                    let corner = DVec3::new(x, y, z);
                    if !corner.is_finite() {
                        builder
                            .notes
                            .add_numbered(Note::VertexNotFinite, "line", line_number);
                    }
                    corners.push(corner);
                }
                "endloop" => {
                    if corners.len() < 3 {
                        builder.notes.add(Note::FaceTooShort, 1);
                    } else {
                        push_polygon(&corners, builder).map_err(|error| error.in_file(path))?;
                    }
                    corners.clear();
                }
                "solid" if groups => builder.begin_group(rest),
                "solid" | "facet" | "outer" | "endfacet" | "endsolid" | "" | "color" => {}
                _ => builder.notes.add(Note::StlLineUnread, 1),
            }
        }
    }
    if !corners.is_empty() {
        let cause = "it ends within a facet: the file is damaged or incomplete".into();
        return Err(error(last, cause));
    }
    Ok(())
}

/// Splits a line of the ASCII form before each keyword; the name of a solid ends before `facet
/// normal`. A line that does not begin with a keyword is not split.
fn statements(line: &str) -> impl Iterator<Item = &str> {
    let mut rest = line;
    std::iter::from_fn(move || {
        let end = next_keyword(rest).unwrap_or(rest.len());
        let (statement, after) = rest.split_at(end);
        rest = after;
        (!statement.is_empty()).then(|| statement.trim_end())
    })
}

/// Returns the place of the second keyword in a text that begins with one.
fn next_keyword(text: &str) -> Option<usize> {
    const KEYWORDS: [&str; 7] = [
        "vertex", "endloop", "endfacet", "facet", "outer", "solid", "endsolid",
    ];
    let is_any = |word: &str, of: &[&str]| of.iter().any(|it| word.eq_ignore_ascii_case(it));
    let first = keyword(text).0;
    if !is_any(first, &KEYWORDS) {
        return None;
    }
    let is_name = is_any(first, &["solid", "endsolid"]);
    let spaces = text.match_indices(char::is_whitespace);
    let mut words = spaces.map(|(at, space)| at + space.len());
    words.find(|&at| {
        let (word, after) = keyword(&text[at..]);
        if is_name {
            is_any(word, &["facet"]) && is_any(keyword(after).0, &["normal"])
        } else {
            is_any(word, &KEYWORDS)
        }
    })
}

fn push_polygon(corners: &[DVec3], builder: &mut Builder) -> Result<(), MeshError> {
    let first = builder.next_vertex(corners.len())?;
    for &position in corners {
        builder.push_vertex(Vertex {
            position,
            normal: Vec3::ZERO,
            texcoord: Vec2::ZERO,
            emission_texcoord: Vec2::ZERO,
            opacity: 1.0,
            color: Vec3::ONE,
        });
    }
    for triangle in triangulate(corners) {
        builder.push_triangle(triangle.map(|corner| first + corner as u32), 0);
    }
    Ok(())
}
