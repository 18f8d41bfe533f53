//! MTL files: the part of them that a diffuse, view-independent surface needs.
//!
//! Parsed here and not by `tobj`, which rejects a whole material file (or panics) for one bad line, keeps the options of
//! a map in its file name, and does not know `Tr` or `map_Ke`.

use super::lines::{keyword, lines, words};
use super::notes::{Note, Notes};
use glam::{Affine2, Vec2};
use std::path::PathBuf;

/// A reference to an image, with the placement that its options ask for.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// As it is written.
    pub file: String,
    /// Takes the texture coordinate of a vertex to that of the image (`-s` and `-o`).
    pub image_from_vertex: Affine2,
}

/// One `newmtl`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MtlMaterial {
    /// Name in the file.
    pub name: String,
    /// Where the file lies: maps are relative to it.
    pub folder: PathBuf,
    /// `Ka`: ambient colour, linear RGB.
    pub ambient: Option<[f32; 3]>,
    /// `Kd`: diffuse colour, linear RGB.
    pub diffuse: Option<[f32; 3]>,
    /// `Ke`: emission, linear RGB.
    pub emissive: Option<[f32; 3]>,
    /// `d`: opacity.
    pub dissolve: Option<f32>,
    /// `Tr`: 1 - opacity, where there is no `d`.
    pub transparency: Option<f32>,
    /// `illum`.
    pub illumination_model: Option<u32>,
    /// `map_Kd`.
    pub diffuse_map: Option<Map>,
    /// `map_Ke`.
    pub emissive_map: Option<Map>,
    /// `map_d`.
    pub dissolve_map: Option<Map>,
}

impl MtlMaterial {
    /// Opacity of the whole surface, 1 where nothing is said, and where `Tr` is told [the other way round](Self::is_turned).
    pub(super) fn opacity(&self) -> f32 {
        let by_transparency = self
            .transparency
            .filter(|_| !self.is_turned())
            .map(|transparency| 1.0 - transparency);
        self.dissolve.or(by_transparency).unwrap_or(1.0)
    }

    /// Whether nothing is said of opacity but `Tr 1`: so MeshLab (until 2023), openMVS and other programs for scans write of surfaces that
    /// are opaque, and nobody writes it of what cannot be seen at all.
    pub(super) fn is_turned(&self) -> bool {
        self.dissolve.is_none() && self.transparency == Some(1.0)
    }

    /// Whether the material claims transparency in any way but a map: then an alpha channel of its colour is meant.
    pub(super) fn claims_transparency(&self) -> bool {
        self.opacity() < 1.0 || matches!(self.illumination_model, Some(4 | 6 | 7 | 9))
    }
}

/// Appends the materials of a file to `materials`. `name` is the file's, for the notes on lines that say nothing.
pub fn parse(
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
            && statement(material, word, rest).is_none()
        {
            notes.add_named(Note::MaterialLineUnread, format!("{name} line {number}"));
        }
    }
    materials.extend(current);
}

/// Takes in one statement; `None` if it is one of those read here and does not parse. Keywords are matched in any case,
/// as writers spell them in all.
fn statement(material: &mut MtlMaterial, word: &str, rest: &str) -> Option<()> {
    match word.to_ascii_lowercase().as_str() {
        "ka" => material.ambient = Some(color(rest)?),
        "kd" => material.diffuse = Some(color(rest)?),
        "ke" => material.emissive = Some(color(rest)?),
        "d" => {
            material.dissolve = Some(words(rest).find(|&word| word != "-halo").and_then(finite)?);
        }
        "tr" => material.transparency = Some(words(rest).next().and_then(finite)?),
        "illum" => material.illumination_model = Some(words(rest).next()?.parse().ok()?),
        "map_kd" => material.diffuse_map = Some(map(rest)?),
        "map_ke" => material.emissive_map = Some(map(rest)?),
        "map_d" => material.dissolve_map = Some(map(rest)?),
        _ => {}
    }
    Some(())
}

fn finite(word: &str) -> Option<f32> {
    word.parse().ok().filter(|x: &f32| x.is_finite())
}

/// Red, green, blue, or one number for all three.
fn color(rest: &str) -> Option<[f32; 3]> {
    let numbers: Option<Vec<f32>> = words(rest).take(3).map(finite).collect();
    match numbers?.as_slice() {
        &[all] => Some([all; 3]),
        numbers => numbers.try_into().ok(),
    }
}

/// Options and a file name, which may contain spaces.
fn map(rest: &str) -> Option<Map> {
    let mut rest = rest;
    let (mut scale, mut offset) = (Vec2::ONE, Vec2::ZERO);
    while rest.starts_with('-') {
        let (option, mut after) = keyword(rest);
        match option.to_ascii_lowercase().as_str() {
            "-s" => scale = vector(&mut after, 1.0),
            "-o" => offset = vector(&mut after, 0.0),
            "-t" => _ = vector(&mut after, 0.0),
            "-mm" => after = keyword(keyword(after).1).1,
            "-blendu" | "-blendv" | "-bm" | "-boost" | "-cc" | "-clamp" | "-imfchan"
            | "-texres" | "-type" => {
                after = keyword(after).1;
            }
            _ => break, // a file name that begins with a dash
        }
        rest = after;
    }
    let image_from_vertex = Affine2::from_scale_angle_translation(scale, 0.0, offset);
    (!rest.is_empty()).then(|| Map {
        file: rest.to_owned(),
        image_from_vertex,
    })
}

/// Takes one to three numbers off the front of `rest`; the first two, where given, else `default`.
fn vector(rest: &mut &str, default: f32) -> Vec2 {
    let mut numbers = [default; 3];
    for number in &mut numbers {
        let (word, after) = keyword(rest);
        let Some(value) = finite(word) else { break };
        (*number, *rest) = (value, after);
    }
    Vec2::new(numbers[0], numbers[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> (Vec<MtlMaterial>, Vec<String>) {
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
    fn a_material_file_as_written_by_many_hands() {
        let (materials, notes) = parsed(
            "Kd 1 1 1\nnewmtl a b #2\n\tkd 0.5\nKd x y z\nTr 0.25 # comment\nd -halo 0.5\nKe 1 2\n\
             map_Kd -s 2 3 1 -clamp on -o 0.5 my wood.png\nmap_d -imfchan m C:\\a\\b.png\nNs\n\nnewmtl second\nTr 1",
        );
        assert_eq!(
            notes,
            ["2 lines of a material file not understood and skipped: a.mtl line 4, a.mtl line 7"]
        );
        assert_eq!(materials.len(), 2);
        let first = &materials[0];
        assert_eq!(
            (first.name.as_str(), first.diffuse, first.opacity()),
            ("a b #2", Some([0.5; 3]), 0.5)
        );
        let map = first.diffuse_map.as_ref().expect("given");
        assert_eq!(map.file, "my wood.png");
        assert_eq!(
            map.image_from_vertex.transform_point2(Vec2::ONE),
            Vec2::new(2.5, 3.0)
        );
        assert_eq!(
            first.dissolve_map.as_ref().map(|map| map.file.as_str()),
            Some("C:\\a\\b.png")
        );
        assert!(materials[1].opacity() == 1.0 && materials[1].is_turned());
        assert_eq!(parsed("newmtl a\nTr 0.75").0[0].opacity(), 0.25);
        assert_eq!(parsed("newmtl a\nTr 1\nd 0").0[0].opacity(), 0.0);
    }
}
