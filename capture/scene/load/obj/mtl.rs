//! MTL files, as far as diffuse surfaces need them.
//!
//! `tobj` is not used: it rejects a whole material file (or panics) for one bad line, leaves the
//! options of a map in its file name, and ignores `Tr` and `map_Ke`.

use crate::load::lines::{has_decimal_comma, keyword, lines, words};
use crate::load::notes::{Note, Notes};
use glam::{Affine2, Vec2};
use headbox_core::color::linear_from_srgb;
use std::collections::HashSet;
use std::path::PathBuf;

/// A reference to an image, with the transform of its options.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// The name in the file.
    pub file: String,
    /// Maps the texture coordinate of a vertex to that of the image (`-s` and `-o`).
    pub image_from_vertex: Affine2,
    /// Options that change the image and are not supported.
    pub ignored_options: Vec<String>,
    /// True if the texels at the edge continue (`-clamp on`), false if the image repeats.
    pub clamp: bool,
}

/// A `newmtl` of a material file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MtlMaterial {
    /// Name in the file.
    pub name: String,
    /// Folder of the file, to which maps are relative.
    pub folder: PathBuf,
    /// `Ka`: ambient colour, linear RGB.
    pub ambient: Option<[f32; 3]>,
    /// `Kd`: diffuse colour, linear RGB.
    pub diffuse: Option<[f32; 3]>,
    /// `Ke`: emission, linear RGB.
    pub emissive: Option<[f32; 3]>,
    /// `d`: opacity.
    pub dissolve: Option<f32>,
    /// `Tr`: 1 - opacity, used without `d`.
    pub transparency: Option<f32>,
    /// `illum`.
    pub illumination_model: Option<u32>,
    /// `map_Kd`.
    pub diffuse_map: Option<Map>,
    /// `map_Ke`.
    pub emissive_map: Option<Map>,
    /// `map_d`, or `map_opacity`.
    pub dissolve_map: Option<Map>,
}

impl MtlMaterial {
    /// Converts a diffuse colour that a program wrote as it shows it, in sRGB, to linear RGB.
    /// Components outside 0..=1 are kept, for the note on them.
    pub fn decode_display_color(&mut self) {
        let decode = |c: f32| {
            if (0.0..=1.0).contains(&c) {
                linear_from_srgb(c)
            } else {
                c
            }
        };
        self.diffuse = self.diffuse.map(|color| color.map(decode));
    }

    /// Returns the opacity of the whole surface: 1 if it is not specified or
    /// [inverted](Self::is_tr_inverted).
    pub(crate) fn opacity(&self) -> f32 {
        let by_transparency = self
            .transparency
            .filter(|_| !self.is_tr_inverted())
            .map(|transparency| 1.0 - transparency);
        self.dissolve.or(by_transparency).unwrap_or(1.0)
    }

    /// Returns true if `Tr 1` is the only statement about opacity. MeshLab (until 2023), openMVS
    /// and other scanning programs write it for opaque surfaces, and nobody for invisible ones.
    pub(super) fn is_tr_inverted(&self) -> bool {
        self.dissolve.is_none() && self.transparency == Some(1.0)
    }

    /// Returns true if the material is transparent without a map, so that the alpha channel of its
    /// colour counts.
    pub(crate) fn is_transparent(&self) -> bool {
        self.opacity() < 1.0 || matches!(self.illumination_model, Some(4 | 6 | 7 | 9))
    }
}

/// Parses a material file and appends its materials. `name` is that of the file, for notes on
/// lines.
fn parse(
    text: &str,
    name: &str,
    folder: PathBuf,
    materials: &mut Vec<MtlMaterial>,
    notes: &mut Notes,
) {
    let mut current: Option<MtlMaterial> = None;
    for (number, line) in lines(text) {
        let (word, rest) = keyword(&line);
        if word.eq_ignore_ascii_case("newmtl") {
            materials.extend(current.replace(MtlMaterial {
                name: rest.to_owned(),
                folder: folder.clone(),
                ..MtlMaterial::default()
            }));
        } else if let Some(material) = &mut current
            && apply_statement(material, word, rest).is_none()
        {
            let cause = if has_decimal_comma(rest) {
                " (decimal comma)"
            } else {
                ""
            };
            notes.add_named(
                Note::MaterialLineUnread,
                format!("{name} line {number}{cause}"),
            );
        }
    }
    materials.extend(current);
}

/// Parses a material file and appends those of its materials whose names no earlier file defines:
/// of several files the first one counts (Wavefront's appendix B1), in a file the last definition.
pub fn add_library(
    text: &str,
    name: &str,
    folder: PathBuf,
    materials: &mut Vec<MtlMaterial>,
    notes: &mut Notes,
) {
    let mut added = Vec::new();
    parse(text, name, folder, &mut added, notes);
    let defined: HashSet<String> = materials.iter().map(|m| m.name.clone()).collect();
    materials.extend(added.into_iter().filter(|m| !defined.contains(&m.name)));
}

/// Applies a statement to a material; `None` if it is supported and does not parse. The case of
/// keywords is ignored because it varies among programs.
fn apply_statement(material: &mut MtlMaterial, word: &str, rest: &str) -> Option<()> {
    match word.to_ascii_lowercase().as_str() {
        "ka" => material.ambient = Some(parse_color(rest)?),
        "kd" => material.diffuse = Some(parse_color(rest)?),
        "ke" => material.emissive = Some(parse_color(rest)?),
        "d" => {
            material.dissolve = Some(words(rest).find(|&word| word != "-halo").and_then(finite)?);
        }
        "tr" => material.transparency = Some(words(rest).next().and_then(finite)?),
        "illum" => material.illumination_model = Some(words(rest).next()?.parse().ok()?),
        "map_kd" => material.diffuse_map = Some(parse_map(rest)?),
        "map_ke" => material.emissive_map = Some(parse_map(rest)?),
        "map_d" | "map_opacity" => material.dissolve_map = Some(parse_map(rest)?),
        _ => {}
    }
    Some(())
}

fn finite(word: &str) -> Option<f32> {
    word.parse().ok().filter(|x: &f32| x.is_finite())
}

/// Parses red, green and blue, or one number for all three.
fn parse_color(rest: &str) -> Option<[f32; 3]> {
    let numbers: Option<Vec<f32>> = words(rest).take(3).map(finite).collect();
    match numbers?.as_slice() {
        &[all] => Some([all; 3]),
        numbers => numbers.try_into().ok(),
    }
}

/// Parses a file name, which may contain spaces, with options before or behind it.
fn parse_map(rest: &str) -> Option<Map> {
    let mut rest = rest;
    let mut options = MapOptions::default();
    while let Some(after) = options.take(rest) {
        rest = after;
    }
    let behind = rest
        .match_indices(" -")
        .take(MAX_OPTIONS)
        .find_map(|(at, _)| {
            let (mut options, mut tail) = (options.clone(), rest[at..].trim_start());
            while let Some(after) = options.take(tail) {
                tail = after;
            }
            (tail.is_empty() || tail.starts_with('#')).then_some((at, options))
        });
    if let Some((at, with_those_behind)) = behind {
        rest = rest[..at].trim_end();
        options = with_those_behind;
    }
    let MapOptions {
        scale,
        offset,
        clamp,
        ignored,
    } = options;
    let image_from_vertex = Affine2::from_scale_angle_translation(scale, 0.0, offset);
    (!rest.is_empty()).then(|| Map {
        file: rest.to_owned(),
        image_from_vertex,
        ignored_options: ignored,
        clamp,
    })
}

/// Number of places behind a file name where options may begin.
const MAX_OPTIONS: usize = 16;

/// Options of a map.
#[derive(Clone)]
struct MapOptions {
    scale: Vec2,
    offset: Vec2,
    clamp: bool,
    ignored: Vec<String>,
}

impl Default for MapOptions {
    fn default() -> Self {
        Self {
            scale: Vec2::ONE,
            offset: Vec2::ZERO,
            clamp: false,
            ignored: Vec::new(),
        }
    }
}

impl MapOptions {
    /// Applies an option at the front of `text`. Returns the rest; `None` if there is no known
    /// option.
    fn take<'a>(&mut self, text: &'a str) -> Option<&'a str> {
        let (option, mut after) = keyword(text);
        let option = option.to_ascii_lowercase();
        let is_neutral = match option.as_str() {
            "-s" => {
                self.scale = take_vector(&mut after, 1.0);
                true
            }
            "-o" => {
                self.offset = take_vector(&mut after, 0.0);
                true
            }
            "-t" => take_numbers(&mut after, [0.0; 3]) == [0.0; 3],
            "-mm" => take_numbers(&mut after, [0.0, 1.0]) == [0.0, 1.0],
            "-clamp" => {
                self.clamp = take_word(&mut after).eq_ignore_ascii_case("on");
                true
            }
            "-bm" | "-texres" | "-type" => {
                after = keyword(after).1;
                true
            }
            "-blendu" | "-blendv" => take_word(&mut after).eq_ignore_ascii_case("on"),
            "-boost" => take_word(&mut after).parse() == Ok(0.0),
            "-cc" => take_word(&mut after).eq_ignore_ascii_case("off"),
            "-colorspace" => take_word(&mut after).eq_ignore_ascii_case("srgb"),
            "-imfchan" => matches!(take_word(&mut after), "l" | "m"),
            _ => return None,
        };
        if !is_neutral {
            let written = text[..text.len() - after.len()].trim_end();
            self.ignored.push(written.to_owned());
        }
        Some(after)
    }
}

fn take_word<'a>(rest: &mut &'a str) -> &'a str {
    let (word, after) = keyword(rest);
    *rest = after;
    word
}

/// Removes one to three numbers from the front of `rest`. Returns the first two; `default` replaces
/// missing ones.
fn take_vector(rest: &mut &str, default: f32) -> Vec2 {
    let [x, y, _] = take_numbers(rest, [default; 3]);
    Vec2::new(x, y)
}

/// Removes up to N numbers from the front of `rest`; those of `numbers` replace missing ones.
fn take_numbers<const N: usize>(rest: &mut &str, mut numbers: [f32; N]) -> [f32; N] {
    for number in &mut numbers {
        let (word, after) = keyword(rest);
        let Some(value) = finite(word) else { break };
        (*number, *rest) = (value, after);
    }
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::read_note::ReadNote;

    fn parsed(text: &str) -> (Vec<MtlMaterial>, Vec<ReadNote>) {
        let (mut materials, mut notes) = (Vec::new(), Notes::default());
        parse(
            text,
            "a.mtl",
            PathBuf::from("folder"),
            &mut materials,
            &mut notes,
        );
        (materials, notes.summary().notes)
    }

    #[test]
    fn mtl_with_defects_is_parsed() {
        let (materials, notes) = parsed(
            "Kd 1 1 1\nnewmtl a b #2\n\tkd 0.5\nKd x y z\nTr 0.25 # comment\nd -halo 0.5\nKe 1 2\n\
             map_Kd -s 2 3 1 -clamp on -o 0.5 my wood.png\nmap_d -imfchan m C:\\a\\b.png\nNs\n\nnewmtl second\nTr 1",
        );
        assert_eq!(
            notes,
            ["2 unrecognised MTL lines skipped: a.mtl line 4, a.mtl line 7"]
        );
        assert_eq!(materials.len(), 2);
        let first = &materials[0];
        assert_eq!(
            (first.name.as_str(), first.diffuse, first.opacity()),
            ("a b #2", Some([0.5; 3]), 0.5)
        );
        let map = first.diffuse_map.as_ref().expect("given");
        assert_eq!(map.file, "my wood.png");
        assert!(map.clamp);
        assert!(first.dissolve_map.as_ref().is_some_and(|map| !map.clamp));
        assert_eq!(
            map.image_from_vertex.transform_point2(Vec2::ONE),
            Vec2::new(2.5, 3.0)
        );
        assert_eq!(
            first.dissolve_map.as_ref().map(|map| map.file.as_str()),
            Some("C:\\a\\b.png")
        );
        assert!(materials[1].opacity() == 1.0 && materials[1].is_tr_inverted());
        assert_eq!(parsed("newmtl a\nTr 0.75").0[0].opacity(), 0.25);
        assert_eq!(parsed("newmtl a\nTr 1\nd 0").0[0].opacity(), 0.0);
    }
    #[test]
    fn map_options_are_read_in_any_order() {
        for (line, file, transform, ignored) in [
            ("-o 0.5 0 -s 2 3 a b.png", "a b.png", [2.5, 3.0], ""),
            ("a b.png -s 2 3 -clamp on", "a b.png", [2.0, 3.0], ""),
            ("-s 2 a.png -o 0 0.5 # c", "a.png", [2.0, 1.5], ""),
            ("-colorspace sRGB a.png", "a.png", [1.0; 2], ""),
            (
                "-colorspace linear a.png",
                "a.png",
                [1.0; 2],
                "-colorspace linear",
            ),
            ("-bm 1 -mm 0 0.5 -t 0 a.png", "a.png", [1.0; 2], "-mm 0 0.5"),
            ("my -s wood.png", "my -s wood.png", [1.0; 2], ""),
            ("-unknown 3 a.png", "-unknown 3 a.png", [1.0; 2], ""),
        ] {
            let map = parse_map(line).expect("a file name");
            let one = map.image_from_vertex.transform_point2(Vec2::ONE);
            assert_eq!(
                (map.file.as_str(), one.to_array()),
                (file, transform),
                "{line}"
            );
            assert_eq!(map.ignored_options.join(" "), ignored, "{line}");
        }
    }

    #[test]
    fn decimal_comma_is_named() {
        let notes = parsed("newmtl a\nKd 0,5 0 0").1;
        assert_eq!(
            notes,
            ["1 unrecognised MTL line skipped: a.mtl line 2 (decimal comma)"]
        );
    }
}
