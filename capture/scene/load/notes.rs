//! What a loader met and survived, counted by kind.

use crate::scene::LoadSummary;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// A kind of defect, or of deliberate choice, that the summary tells the user about. The order is that of the summary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Note {
    MaterialFileUnreadable,
    MaterialUndefined,
    MaterialLineUnread,
    TextureUnreadable,
    TextureRenamed,
    TextureTransformIgnored,
    AmbientTakenAsLight,
    TransparencyTurned,
    Unlit,
    LineUnread,
    BytesBeyondEnd,
    UnknownExtension,
    BufferUnreadable,
    AccessorUnreadable,
    LightUnreadable,
    SkinUnreadable,
    NodeCycle,
    NonTriangles,
    EmptyGroup,
    FaceTooShort,
    FaceIndexOutOfRange,
    AttributeIndexOutOfRange,
    VertexNotFinite,
    NotFinite,
    Degenerate,
    SeeThrough,
    Duplicate,
}

impl Note {
    /// Singular and plural of what is counted, and what happened to it.
    fn words(self) -> [&'static str; 3] {
        match self {
            Self::MaterialFileUnreadable => {
                ["material file", "material files", "could not be read"]
            }
            Self::MaterialUndefined => [
                "material",
                "materials",
                "used but not defined anywhere, so plain grey",
            ],
            Self::MaterialLineUnread => [
                "line",
                "lines",
                "of a material file not understood and skipped",
            ],
            Self::TextureUnreadable => ["texture", "textures", "could not be read"],
            Self::TextureRenamed => [
                "texture",
                "textures",
                "found in another folder or spelling than the file says",
            ],
            Self::TextureTransformIgnored => [
                "texture",
                "textures",
                "placed like the albedo texture of the same material",
            ],
            Self::AmbientTakenAsLight => [
                "material",
                "materials",
                "with an ambient colour above 1, taken as emitted light",
            ],
            Self::TransparencyTurned => [
                "material",
                "materials",
                "with Tr 1 and no d, taken as opaque, as programs for scans write it",
            ],
            Self::Unlit => [
                "unlit material",
                "unlit materials",
                "lit all the same: its colours may hold their light already; --light-samples 0 (of truth, sprites and lumigraphs --unlit) \
                 shows them as they are",
            ],
            Self::LineUnread => ["line", "lines", "that no OBJ file has, skipped"],
            Self::BytesBeyondEnd => [
                "byte",
                "bytes",
                "after the end that the GLB header tells, skipped",
            ],
            Self::UnknownExtension => ["extension", "extensions", "not supported and ignored"],
            Self::BufferUnreadable => ["buffer", "buffers", "could not be read"],
            Self::AccessorUnreadable => [
                "mesh part or attribute",
                "mesh parts or attributes",
                "damaged and left out",
            ],
            Self::LightUnreadable => ["light", "lights", "damaged and left out"],
            Self::SkinUnreadable => [
                "skinned mesh",
                "skinned meshes",
                "shown unbent, as joints or weights are damaged",
            ],
            Self::NodeCycle => [
                "node",
                "nodes",
                "reached more than once and kept only the first time",
            ],
            Self::NonTriangles => [
                "element",
                "elements",
                "left out, as points, lines and curves have no surface",
            ],
            Self::EmptyGroup => ["group", "groups", "without faces"],
            Self::FaceTooShort => ["face", "faces", "with fewer than three corners left out"],
            Self::FaceIndexOutOfRange => [
                "face",
                "faces",
                "left out because a vertex index is out of range",
            ],
            Self::AttributeIndexOutOfRange => [
                "face",
                "faces",
                "with a texture coordinate or normal index out of range, taken as not given",
            ],
            Self::VertexNotFinite => [
                "vertex",
                "vertices",
                "with a number that is none or too large",
            ],
            Self::NotFinite => [
                "triangle",
                "triangles",
                "left out because a vertex is not finite",
            ],
            Self::Degenerate => ["triangle", "triangles", "left out for want of area"],
            Self::SeeThrough => [
                "triangle",
                "triangles",
                "of see-through glass (opacity below one half) left out",
            ],
            Self::Duplicate => [
                "triangle",
                "triangles",
                "in exactly the place of another one, kept",
            ],
        }
    }

    fn sentence(self, entry: &Entry) -> String {
        let [one, many, what] = self.words();
        let noun = if entry.count == 1 { one } else { many };
        let mut sentence = format!("{} {noun} {what}", entry.count);
        if !entry.names.is_empty() {
            let mut shown: Vec<&str> = entry
                .names
                .iter()
                .take(Notes::NAMES_SHOWN)
                .map(String::as_str)
                .collect();
            if entry.names.len() > Notes::NAMES_SHOWN {
                shown.push("...");
            }
            sentence += ": ";
            sentence += &shown.join(", ");
        }
        sentence
    }
}

#[derive(Clone, Debug, Default)]
struct Entry {
    count: usize,
    names: BTreeSet<String>,
}

/// Counts per kind, and the names that go with them.
#[derive(Clone, Debug, Default)]
pub struct Notes {
    entries: BTreeMap<Note, Entry>,
    files: BTreeSet<PathBuf>,
    /// Sentences of their own, which come first.
    pub(super) told: Vec<String>,
}

impl Notes {
    /// How many names a sentence lists before it stops.
    const NAMES_SHOWN: usize = 5;

    /// Counts `count` more of a kind.
    pub(super) fn add(&mut self, note: Note, count: usize) {
        if count > 0 {
            self.entries.entry(note).or_default().count += count;
        }
    }

    /// Counts a thing that has a name; the same name counts once.
    pub(super) fn add_named(&mut self, note: Note, name: impl Into<String>) {
        let entry = self.entries.entry(note).or_default();
        entry.count += usize::from(entry.names.insert(name.into()));
    }

    /// Counts a thing that has a number, which is told of the first few.
    pub(super) fn add_numbered(&mut self, note: Note, what: &str, number: usize) {
        let entry = self.entries.entry(note).or_default();
        if entry.names.len() < Self::NAMES_SHOWN {
            entry.names.insert(format!("{what} {number}"));
        }
        entry.count += 1;
    }

    /// Remembers a file that is read.
    pub(super) fn add_file(&mut self, path: &Path) {
        self.files.insert(path.to_path_buf());
    }

    /// Takes in the counts and names of another.
    pub(super) fn merge(&mut self, other: Self) {
        self.files.extend(other.files);
        for (note, entry) in other.entries {
            let own = self.entries.entry(note).or_default();
            own.count += entry.count;
            own.names.extend(entry.names);
        }
    }

    /// The readable summary.
    pub(super) fn summary(&self) -> LoadSummary {
        LoadSummary {
            notes: {
                let counted = self
                    .entries
                    .iter()
                    .map(|(note, entry)| note.sentence(entry));
                self.told.iter().cloned().chain(counted).collect()
            },
            files: self.files.iter().cloned().collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_is_one_sentence_with_a_handful_of_names() {
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
            sentences[0],
            "7 textures could not be read: 0.png, 1.png, 2.png, 3.png, 4.png, ..."
        );
        assert_eq!(sentences[1], "1 triangle left out for want of area");
    }
}
