//! Defects that a loader tolerates, counted by kind.

use crate::scene::LoadSummary;
use headbox_core::read_note::ReadNote;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// A kind of defect or of a choice by the loader, in the order of the summary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Note {
    EncodingGuessed,
    MaterialFileUnreadable,
    MaterialFileGuessed,
    MaterialUndefined,
    MaterialLineUnread,
    MaterialColorLimited,
    MapOptionIgnored,
    TextureUnreadable,
    TextureDamaged,
    TextureRenamed,
    TextureTransformIgnored,
    AmbientTakenAsLight,
    TransparencyInverted,
    HolesByColor,
    Unlit,
    LineUnread,
    StlLineUnread,
    StlColorIgnored,
    ElementSkipped,
    TextureWithoutCoordinates,
    FaceTexcoordMissing,
    TrailingBytes,
    BytesBeyondEnd,
    UnknownExtension,
    BufferUnreadable,
    AccessorUnreadable,
    LightUnreadable,
    SkinUnreadable,
    Hidden,
    ColorNotNormalized,
    ColorAboveOne,
    NodeCycle,
    NonTriangles,
    Splats,
    EmptyGroup,
    FaceTooShort,
    FaceIndexOutOfRange,
    AttributeIndexOutOfRange,
    VertexNotFinite,
    VertexColorScaled,
    VertexColorUnread,
    VertexColorSurplus,
    VertexColorLimited,
    VertexAlphaIgnored,
    NotFinite,
    Degenerate,
    SeeThrough,
    Duplicate,
    Coplanar,
}

impl Note {
    /// Singular and plural of the counted noun, and what happened to it.
    fn words(self) -> [&'static str; 3] {
        match self {
            Self::EncodingGuessed => [
                "text file",
                "text files",
                "not in valid UTF-8, read in the most likely encoding",
            ],
            Self::MaterialFileUnreadable => {
                ["material file", "material files", "could not be read"]
            }
            Self::MaterialFileGuessed => [
                "material file",
                "material files",
                "used because of its name, as the scene names no other that is there",
            ],
            Self::MaterialUndefined => [
                "material",
                "materials",
                "used but not defined, shown as plain grey",
            ],
            Self::MaterialLineUnread => {
                ["unrecognised MTL line", "unrecognised MTL lines", "skipped"]
            }
            Self::MaterialColorLimited => [
                "material",
                "materials",
                "with a diffuse colour outside 0 to 1, limited to that range",
            ],
            Self::MapOptionIgnored => [
                "option of a map",
                "options of maps",
                "not supported and ignored",
            ],
            Self::TextureUnreadable => ["texture", "textures", "could not be read"],
            Self::TextureDamaged => ["texture", "textures", "damaged"],
            Self::TextureRenamed => [
                "texture",
                "textures",
                "found in another folder or spelling than specified",
            ],
            Self::TextureTransformIgnored => [
                "texture",
                "textures",
                "mapped like the albedo texture of the same material",
            ],
            Self::AmbientTakenAsLight => [
                "material",
                "materials",
                "with an ambient colour above 1, used as emission",
            ],
            Self::TransparencyInverted => [
                "material",
                "materials",
                "with Tr 1 and no d, shown as opaque, as scanning programs mean it",
            ],
            Self::HolesByColor => [
                "material",
                "materials",
                "without map_d, with holes where the alpha of map_Kd is below one half",
            ],
            Self::Unlit => [
                "unlit material",
                "unlit materials",
                "lit like others unless --light-samples 0 (for truth, sprites and lumigraphs: --unlit) \
                 is given, though their colours may contain light",
            ],
            Self::LineUnread => ["unrecognised OBJ line", "unrecognised OBJ lines", "skipped"],
            Self::StlLineUnread => ["unrecognised STL line", "unrecognised STL lines", "skipped"],
            Self::StlColorIgnored => [
                "colour",
                "colours",
                "in the header or the attributes of an STL left out; save as PLY to keep colours",
            ],
            Self::ElementSkipped => ["PLY element", "PLY elements", "left out"],
            Self::TextureWithoutCoordinates => [
                "texture",
                "textures",
                "left out because the mesh has no texture coordinates",
            ],
            Self::FaceTexcoordMissing => [
                "face",
                "faces",
                "without a texture coordinate for each corner, shown with a single texel",
            ],
            Self::TrailingBytes => ["byte", "bytes", "after the last triangle skipped"],
            Self::BytesBeyondEnd => [
                "byte",
                "bytes",
                "after the end specified in the GLB header skipped",
            ],
            Self::UnknownExtension => {
                ["unsupported extension", "unsupported extensions", "ignored"]
            }
            Self::BufferUnreadable => ["buffer", "buffers", "could not be read"],
            Self::AccessorUnreadable => [
                "damaged mesh part or attribute",
                "damaged mesh parts or attributes",
                "left out",
            ],
            Self::LightUnreadable => ["damaged light", "damaged lights", "left out"],
            Self::SkinUnreadable => [
                "skinned mesh",
                "skinned meshes",
                "with damaged joints or weights shown undeformed",
            ],
            Self::Hidden => [
                "mesh or lamp",
                "meshes or lamps",
                "hidden by the file (KHR_node_visibility) left out",
            ],
            Self::ColorNotNormalized => [
                "mesh part",
                "mesh parts",
                "with vertex colours of 0 to 255 or 65535 that are not normalized, divided by that",
            ],
            Self::ColorAboveOne => [
                "vertex",
                "vertices",
                "with a colour above 1, which is reduced to 1",
            ],
            Self::NodeCycle => [
                "node",
                "nodes",
                "reached more than once and used only the first time",
            ],
            Self::NonTriangles => [
                "element",
                "elements",
                "without a surface (points, lines, curves) left out",
            ],
            Self::Splats => [
                "cloud of Gaussian splats",
                "clouds of Gaussian splats",
                "left out, because splats have no surface that rays could meet",
            ],
            Self::EmptyGroup => ["group", "groups", "without faces"],
            Self::FaceTooShort => ["face", "faces", "with fewer than three corners left out"],
            Self::FaceIndexOutOfRange => {
                ["face", "faces", "with a vertex index out of range left out"]
            }
            Self::AttributeIndexOutOfRange => [
                "face",
                "faces",
                "with a texture coordinate or normal index out of range, which is ignored",
            ],
            Self::VertexNotFinite => [
                "vertex",
                "vertices",
                "with a coordinate that is NaN or infinite",
            ],
            Self::VertexColorScaled => [
                "vertex colour",
                "vertex colours",
                "divided by the value that the file has for white",
            ],
            Self::VertexColorUnread => [
                "vertex colour",
                "vertex colours",
                "could not be read, shown as white",
            ],
            Self::VertexColorSurplus => [
                "vertex colour",
                "vertex colours",
                "without a vertex left out",
            ],
            Self::VertexColorLimited => [
                "vertex colour",
                "vertex colours",
                "outside 0 to 1, limited to that range",
            ],
            Self::VertexAlphaIgnored => [
                "vertex",
                "vertices",
                "with an alpha below 1, shown as opaque",
            ],
            Self::NotFinite => [
                "triangle",
                "triangles",
                "with a corner that is NaN or infinite left out",
            ],
            Self::Degenerate => ["degenerate triangle", "degenerate triangles", "left out"],
            Self::SeeThrough => [
                "triangle",
                "triangles",
                "with an opacity of one half or less left out",
            ],
            Self::Coplanar => [
                "triangle",
                "triangles",
                "in one plane with another of a different material, of which the one that faces \
                 the viewer is shown, or else the later one in the file",
            ],
            Self::Duplicate => ["duplicate triangle", "duplicate triangles", "kept"],
        }
    }

    fn sentence(self, entry: &Entry) -> ReadNote {
        let [one, many, what] = self.words();
        let noun = if entry.count == 1 { one } else { many };
        let sentence = format!("{} {noun} {what}", entry.count);
        let names: Vec<&str> = entry.names.iter().map(|(_, name)| name.as_str()).collect();
        ReadNote::with_names(&sentence, &names, Notes::NAMES_SHOWN)
    }
}

#[derive(Clone, Debug, Default)]
struct Entry {
    count: usize,
    /// Names, each behind its number in the file, or 0.
    names: BTreeSet<(usize, String)>,
}

/// Number and names of the defects of each kind.
#[derive(Clone, Debug, Default)]
pub struct Notes {
    entries: BTreeMap<Note, Entry>,
    files: BTreeSet<PathBuf>,
    /// Complete sentences, which come first in the summary.
    pub(super) messages: Vec<String>,
    /// Why the file cannot be loaded: what it needs is beyond the memory budget.
    over_budget: Option<String>,
}

impl Notes {
    /// Number of names that are displayed.
    const NAMES_SHOWN: usize = 5;
    /// Number of numbered names that are kept: a file may have a defect in each of its lines.
    const NUMBERS_KEPT: usize = 1000;

    /// Adds `count` defects of a kind.
    pub(super) fn add(&mut self, note: Note, count: usize) {
        if count > 0 {
            self.entries.entry(note).or_default().count += count;
        }
    }

    /// Adds a defect with a name; each name counts once.
    pub(super) fn add_named(&mut self, note: Note, name: impl Into<String>) {
        let entry = self.entries.entry(note).or_default();
        entry.count += usize::from(entry.names.insert((0, name.into())));
    }

    /// Adds `count` defects with a common name.
    pub(super) fn add_to(&mut self, note: Note, count: usize, name: String) {
        self.add(note, count);
        self.entries
            .entry(note)
            .or_default()
            .names
            .insert((0, name));
    }

    /// Adds a defect with a number, such as that of its line; the first thousand are listed.
    pub(super) fn add_numbered(&mut self, note: Note, what: &str, number: usize) {
        let entry = self.entries.entry(note).or_default();
        if entry.names.len() < Self::NUMBERS_KEPT {
            entry.names.insert((number, format!("{what} {number}")));
        }
        entry.count += 1;
    }

    /// Adds a part of the file that is beyond the memory budget: an error, because what is left out
    /// would depend on the machine.
    pub(super) fn add_over_budget(&mut self, name: &str, cause: &dyn std::fmt::Display) {
        self.over_budget
            .get_or_insert_with(|| format!("{name} {cause}"));
    }

    /// Adds a file that could not be read, if that is because of the memory budget.
    pub(super) fn add_if_over_budget(&mut self, name: &str, cause: &std::io::Error) {
        if cause.kind() == std::io::ErrorKind::OutOfMemory {
            self.add_over_budget(name, cause);
        }
    }

    /// Takes the error of [`Self::add_over_budget`].
    pub(super) fn take_over_budget(&mut self) -> Option<String> {
        self.over_budget.take()
    }

    /// Adds a file that was read.
    pub(super) fn add_file(&mut self, path: &Path) {
        self.files.insert(path.to_path_buf());
    }

    /// Adds the counts, names and files of `other`.
    pub(super) fn merge(&mut self, other: Self) {
        self.over_budget = self.over_budget.take().or(other.over_budget);
        self.files.extend(other.files);
        for (note, entry) in other.entries {
            let own = self.entries.entry(note).or_default();
            own.count += entry.count;
            own.names.extend(entry.names);
        }
    }

    /// Returns a sentence per kind, and the files.
    pub(super) fn summary(&self) -> LoadSummary {
        LoadSummary {
            notes: {
                let counted = self
                    .entries
                    .iter()
                    .map(|(note, entry)| note.sentence(entry));
                let messages = self.messages.iter().map(|message| message.as_str().into());
                messages.chain(counted).collect()
            },
            files: self.files.iter().cloned().collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_of_a_kind_become_one_sentence() {
        let mut notes = Notes::default();
        notes.add(Note::Degenerate, 0);
        assert!(notes.summary().notes.is_empty());
        notes.add(Note::Degenerate, 1);
        for i in 0..7 {
            notes.add_named(Note::TextureUnreadable, format!("{i}.png"));
            notes.add_named(Note::TextureUnreadable, format!("{i}.png"));
        }
        let sentences = notes.summary().notes;
        assert_eq!(
            sentences[0].to_string(),
            "7 textures could not be read: 0.png, 1.png, 2.png, 3.png, 4.png and 2 more"
        );
        assert!(
            sentences[0].ends_with("4.png, 5.png, 6.png"),
            "{}",
            &*sentences[0]
        );
        assert_eq!(sentences[1], "1 degenerate triangle left out");
    }
}
