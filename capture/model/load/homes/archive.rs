//! Models and images in the archive of a Sweet Home 3D home.

use glam::{DVec2, DVec3};
use headbox_core::files::fold_name;
use headbox_core::memory::{self, Reservation};
use headbox_scene::load::encoding::decode_text;
use headbox_scene::load::lines::{keyword, lines, without_comment, words};
use headbox_scene::load::material_names::MaterialNames;
use headbox_scene::load::mtl::{self, Map, MtlMaterial};
use headbox_scene::load::notes::Notes;
use std::collections::HashMap;
use std::io::{Cursor, Read};
use std::path::PathBuf;
use std::rc::Rc;

/// Maximum size of a file in an archive, bytes; a longer one is damaged.
const MAX_FILE_BYTES: u64 = 1 << 28;

/// Memory that a model takes while it is parsed, for each byte of its text: the text again, and 24
/// bytes for a vertex of eight characters in a vector of up to twice that.
const MEMORY_PER_BYTE: u64 = 8;

/// An archive with a cache of its models.
pub(crate) struct Archive<'a> {
    /// `None` for a plan without an archive.
    files: Option<zip::ZipArchive<Cursor<&'a [u8]>>>,
    models: HashMap<String, Option<Rc<Model>>>,
    /// Why a file was not read although it is there: the memory budget.
    pub(super) over_budget: Option<String>,
}

impl<'a> Archive<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self {
            files: zip::ZipArchive::new(Cursor::new(bytes)).ok(),
            models: HashMap::new(),
            over_budget: None,
        }
    }

    /// Returns true if there is an archive, not a plan alone.
    pub(super) fn is_present(&self) -> bool {
        self.files.is_some()
    }

    /// Reads a file by its name, else by [another spelling](Self::stored_name); `None` if it is
    /// missing or damaged, or has more bytes than the archive declares.
    pub(crate) fn file(&mut self, name: &str) -> Option<Vec<u8>> {
        self.file_and_memory(name, 1).map(|(bytes, _)| bytes)
    }

    /// Returns the name of a file in the archive: `name`, or one that differs in case or Unicode
    /// normalization.
    fn stored_name(&self, name: &str) -> Option<String> {
        let files = self.files.as_ref()?;
        if files.index_for_name(name).is_some() {
            return Some(name.to_owned());
        }
        let wanted = fold_name(name);
        let mut stored = files.file_names().filter_map(Result::ok);
        let found = stored.find(|it| fold_name(it) == wanted)?;
        Some(found.into_owned())
    }

    /// Reads a file and reserves memory for each of its bytes.
    fn file_and_memory(&mut self, name: &str, per_byte: u64) -> Option<(Vec<u8>, Reservation)> {
        let stored = self.stored_name(name)?;
        let entry = self.files.as_mut()?.by_name(&stored).ok()?;
        let size = entry.size();
        if size > MAX_FILE_BYTES {
            return None;
        }
        let memory = match memory::reserve(size * per_byte) {
            Ok(memory) => memory,
            Err(cause) => {
                self.over_budget
                    .get_or_insert_with(|| format!("{name} in the archive {cause}"));
                return None;
            }
        };
        let mut bytes = Vec::new();
        entry.take(size + 1).read_to_end(&mut bytes).ok()?;
        (bytes.len() as u64 == size).then_some((bytes, memory))
    }

    /// Reads a model by its name, once; `None` if it is missing or not an OBJ.
    pub(crate) fn model(&mut self, name: &str) -> Option<Rc<Model>> {
        if !self.models.contains_key(name) {
            let model = self
                .file_and_memory(name, MEMORY_PER_BYTE)
                .and_then(|(bytes, _memory)| {
                    Model::parse(&decode_text(&bytes, name, &mut Notes::default()))
                });
            let model = model.map(|model| Rc::new(self.with_materials(model, name)));
            self.models.insert(name.to_owned(), model);
        }
        self.models.get(name)?.clone()
    }

    /// Reads the material files of a model, in its folder, with colours as Sweet Home 3D shows them,
    /// and renames their maps to names in the archive.
    fn with_materials(&mut self, mut model: Model, name: &str) -> Model {
        let folder = name
            .rsplit_once('/')
            .map_or(String::new(), |(folder, _)| format!("{folder}/"));
        let in_archive = |file: &str| {
            format!(
                "{folder}{}",
                file.trim_matches('"')
                    .replace('\\', "/")
                    .trim_start_matches("./")
            )
        };
        // Defects of materials only change colours.
        let mut notes = Notes::default();
        for written in &model.libraries {
            let names: Vec<&str> = match self.stored_name(&in_archive(written)) {
                Some(_) => vec![written],
                // A number sign within a word belongs to the name.
                None => without_comment(written)
                    .unwrap_or(written)
                    .split_whitespace()
                    .collect(),
            };
            for library in names {
                if let Some(bytes) = self.file(&in_archive(library)) {
                    let text = decode_text(&bytes, library, &mut notes);
                    let materials = &mut model.materials;
                    mtl::add_library(&text, library, PathBuf::new(), materials, &mut notes);
                }
            }
        }
        model.names = MaterialNames::new(&model.materials);
        let rename = |map: &mut Map| map.file = in_archive(&map.file);
        for material in &mut model.materials {
            material.decode_display_color();
            [
                &mut material.diffuse_map,
                &mut material.emissive_map,
                &mut material.dissolve_map,
            ]
            .into_iter()
            .flatten()
            .for_each(rename);
        }
        model
    }
}

/// A corner of a face: the indices of its position and, if it has one, of its texture coordinate.
pub(crate) type Corner = (usize, Option<usize>);

/// Faces of one group and material.
pub(crate) struct FaceGroup {
    pub(crate) group: String,
    pub(crate) material: String,
    pub(crate) polygons: Vec<Vec<Corner>>,
}

/// A model from an archive.
pub(crate) struct Model {
    pub(crate) positions: Vec<DVec3>,
    pub(super) texcoords: Vec<DVec2>,
    pub(crate) parts: Vec<FaceGroup>,
    pub(crate) materials: Vec<MtlMaterial>,
    /// Indices of the materials by their names.
    pub(super) names: MaterialNames,
    /// Material files.
    libraries: Vec<String>,
}

impl Model {
    /// Parses an OBJ; `None` if it has no faces, or if a vertex is missing.
    fn parse(text: &str) -> Option<Self> {
        let mut model = Self {
            positions: Vec::new(),
            texcoords: Vec::new(),
            parts: Vec::new(),
            materials: Vec::new(),
            names: MaterialNames::new(&[]),
            libraries: Vec::new(),
        };
        let (mut group, mut material) = (String::new(), String::new());
        for (_, line) in lines(text) {
            let (word, rest) = keyword(&line);
            let mut numbers =
                words(rest).map(|word| word.parse().ok().filter(|v: &f64| v.is_finite()));
            let mut next = || numbers.next().flatten();
            match word {
                "v" => model.positions.push(DVec3::new(next()?, next()?, next()?)),
                "vt" => model
                    .texcoords
                    .push(DVec2::new(next()?, next().unwrap_or(0.0))),
                "g" | "o" => group = rest.replace(char::is_whitespace, "_"),
                "usemtl" => material = rest.to_owned(),
                "mtllib" => model.libraries.push(rest.to_owned()),
                "f" => {
                    let polygon: Vec<Corner> = words(rest)
                        .map(|word| model.corner(word))
                        .collect::<Option<_>>()?;
                    if polygon.len() < 3 {
                        continue;
                    }
                    match model
                        .parts
                        .iter_mut()
                        .find(|part| part.group == group && part.material == material)
                    {
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

    /// Parses `position/texcoord/normal`, of which only the first is required.
    fn corner(&self, word: &str) -> Option<Corner> {
        let mut numbers = word.split('/');
        let position = index(numbers.next()?, self.positions.len())?;
        let texcoord = numbers.next();
        Some((
            position,
            texcoord.and_then(|number| index(number, self.texcoords.len())),
        ))
    }
}

/// Converts an index of an OBJ into a list of `count` entries to one from 0.
fn index(number: &str, count: usize) -> Option<usize> {
    let number: i64 = number.parse().ok()?;
    let index = if number < 0 {
        count as i64 + number
    } else {
        number - 1
    };
    usize::try_from(index).ok().filter(|&index| index < count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn model_read_by_group_and_material() {
        let model = Model::parse(
            "v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 1\ng a b\nusemtl red\nf 1/1/5 2//7 3 # 9\nusemtl blue\nf -3/-1 -2/9 -1\n",
        );
        let model = model.expect("two faces");
        let parts: Vec<_> = model
            .parts
            .iter()
            .map(|p| (p.group.as_str(), p.material.as_str(), &p.polygons[0][..]))
            .collect();
        let corners = [[(0, Some(0)), (1, None), (2, None)]; 2];
        assert_eq!(
            parts,
            [
                ("a_b", "red", &corners[0][..]),
                ("a_b", "blue", &corners[1][..])
            ]
        );
        for bad in [
            "",
            "v 0 0 0\n",
            "v 0 0\nf 1 1 1\n",
            "v 0 0 0\nf 1 1 2\n",
            "v 0 0 0\nf 0 1 1\n",
            "f 1 2 x",
        ] {
            assert!(Model::parse(bad).is_none(), "{bad}");
        }
    }
}
