//! Loading of OBJ files: text, material files and triangles.

use super::material_names::MaterialNames;
use super::mtl::{self, MtlMaterial};
use super::obj_materials::{EmbeddedImages, ObjMaterials};
use super::obj_prepare::{LineError, PreparedObj, prepare};
use crate::load::builder::{Builder, GroupedScene, MeshError};
use crate::load::encoding::decode_text;
use crate::load::lines::without_comment;
use crate::load::named_files::find_file;
use crate::load::notes::{Note, Notes};
use crate::load::orientation::{FrameHints, head_comments};
use crate::load::{LoadError, LoadOptions, folder_of};
use headbox_core::file_frame::FileFrame;
use headbox_core::files::InputFolder;
use headbox_core::memory;
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// Memory of `tobj` for a triangle, bytes: 104 as a face of up to four corners in 64 bits, 12 as
/// indices of the mesh, and what growing arrays leave unused.
const TRIANGLE_BYTES: usize = 140;

/// Memory of `tobj` for a slot of its hash map of vertices, bytes: three indices in 64 bits, one
/// in 32 and a byte of the map's own, and half as much for the map that it outgrew.
const SLOT_BYTES: usize = 33 * 3 / 2;

/// Most words of the name of one of several material files in a line.
const MAX_NAME_WORDS: usize = 16;

/// Loads an OBJ with the files that it refers to.
pub(crate) fn load(
    path: &Path,
    bytes: &[u8],
    options: &LoadOptions,
    groups: bool,
) -> Result<GroupedScene, LoadError> {
    let mut notes = Notes::default();
    let text = decode_text(bytes, &file_name(path), &mut notes);
    let obj = prepare_file(path, &text, groups)?;
    let hints = FrameHints {
        options: *options,
        comments: head_comments(&text),
        floors: obj.floors,
    };
    let scene = InputFolder::new(folder_of(path));
    let own = path.with_extension("mtl");
    let mut materials = read_libraries(&obj, &file_name(&own), &scene, &mut notes);
    if hints.comments.contains(" sweet home 3d ") {
        materials
            .iter_mut()
            .for_each(MtlMaterial::decode_display_color);
    }
    let builder = Builder::with_hints(hints, notes);
    let images = EmbeddedImages::new();
    build(path, obj, &materials, &images, builder, groups)
}

/// Loads an OBJ from a text, materials and images in memory; `path` is for messages.
///
/// # Errors
/// See [`LoadError`].
pub fn load_text(
    path: &Path,
    text: &str,
    materials: &[MtlMaterial],
    images: &EmbeddedImages,
    frame: FileFrame,
) -> Result<GroupedScene, LoadError> {
    let obj = prepare_file(path, text, true)?;
    let builder = Builder::new(frame, Notes::default());
    build(path, obj, materials, images, builder, true)
}

fn prepare_file(path: &Path, text: &str, groups: bool) -> Result<PreparedObj, LoadError> {
    // Positions, the prepared text, and the parts that it is put together from.
    let _memory = memory::reserve(4 * text.len() as u64)
        .map_err(|error| MeshError::from(error).in_file(path))?;
    prepare(text, groups).map_err(|LineError { line, cause }| LoadError::Line {
        path: path.to_path_buf(),
        line,
        cause,
    })
}

/// Returns the memory that `tobj` takes for a file.
fn parser_bytes(obj: &PreparedObj) -> usize {
    // Three numbers of 32 bits for positions and normals, two for texture coordinates.
    let [of_file, of_mesh] = [
        obj.totals,
        obj.totals.map(|total| total.min(1) * obj.vertices),
    ];
    let numbers: usize = [of_file, of_mesh]
        .iter()
        .map(|[positions, texcoords, normals]| 12 * positions + 8 * texcoords + 12 * normals)
        .sum();
    // The map doubles when seven eighths are full.
    let slots = (obj.vertices * 8 / 7 + 1).next_power_of_two();
    numbers + SLOT_BYTES * slots + TRIANGLE_BYTES * obj.triangles
}

fn build(
    path: &Path,
    obj: PreparedObj,
    materials: &[MtlMaterial],
    images: &EmbeddedImages,
    mut builder: Builder,
    groups: bool,
) -> Result<GroupedScene, LoadError> {
    let parser_bytes = parser_bytes(&obj);
    let notes = &mut builder.notes;
    notes.merge(obj.notes);
    let names = MaterialNames::new(materials);
    let mut by_name = HashMap::new();
    for name in obj.used_materials {
        match names.find(&name) {
            Some(index) => _ = by_name.insert(name, index),
            None => notes.add_named(Note::MaterialUndefined, name),
        }
    }
    let memory = memory::reserve(parser_bytes as u64)
        .map_err(|error| MeshError::from(error).in_file(path))?;
    let models =
        parse(obj.text, by_name).map_err(|cause| LoadError::malformed(path, cause.to_string()))?;
    drop(memory);

    let surfaces = ObjMaterials::new(materials, path, images, &models, notes);
    for model in &models {
        if groups {
            builder.begin_group(&model.name);
        }
        surfaces
            .push_mesh(&model.mesh, &mut builder)
            .map_err(|error| error.in_file(path))?;
    }
    builder.finish(path, surfaces.materials, surfaces.textures.textures)
}

/// Parses a prepared text with `tobj`, and frees it. `by_name` has the indices of the used
/// materials.
fn parse(
    text: String,
    by_name: HashMap<String, usize>,
) -> Result<Vec<tobj::Model>, tobj::LoadError> {
    let options = tobj::LoadOptions {
        single_index: true,
        ..Default::default()
    };
    let materials = |_: &Path| Ok((Vec::new(), by_name.clone().into_iter().collect()));
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, materials)?;
    Ok(models)
}

/// Reads the material files, each once: those that the scene names, or if there is none the file
/// `own`, which has its name. Of files that define the same material the first one counts.
fn read_libraries(
    obj: &PreparedObj,
    own: &str,
    scene: &InputFolder,
    notes: &mut Notes,
) -> Vec<MtlMaterial> {
    let find = |name: &str| find_file(name, scene.path(), scene);
    let mut materials = Vec::new();
    let mut seen = HashSet::new();
    let libraries = obj.libraries.iter().filter(|it| seen.insert(*it));
    let mut names: Vec<String> = libraries
        .flat_map(|written| library_names(written, |name| find(name).is_ok()))
        .collect();
    let is_any_there = names.iter().any(|name| find(name).is_ok());
    if !is_any_there && !obj.used_materials.is_empty() && find(own).is_ok() {
        notes.add_named(Note::MaterialFileGuessed, own);
        names.push(own.to_owned());
    }
    for name in &names {
        let read = find(name).and_then(|found| match memory::read_file(&found.path) {
            Ok(bytes) => Ok((found.path, bytes)),
            Err(cause) => {
                notes.add_if_over_budget(name, &cause);
                Err(cause.to_string())
            }
        });
        match read {
            Ok((path, bytes)) => {
                notes.add_file(&path);
                let text = decode_text(&bytes, &file_name(&path), notes);
                let folder = folder_of(&path).to_path_buf();
                mtl::add_library(&text, name, folder, &mut materials, notes);
            }
            Err(cause) => {
                notes.add_named(Note::MaterialFileUnreadable, format!("{name} ({cause})"));
            }
        }
    }
    materials
}

/// Returns the file names in the argument of a `mtllib`: it is one name, which may contain spaces,
/// or several, of which each is as long as a file with that name is there.
fn library_names(written: &str, is_there: impl Fn(&str) -> bool) -> Vec<String> {
    if is_there(written) {
        return vec![written.to_owned()];
    }
    let written = without_comment(written).unwrap_or(written);
    let words: Vec<&str> = written.split_whitespace().collect();
    let mut names = Vec::new();
    let mut rest = &words[..];
    while !rest.is_empty() {
        let most = rest.len().min(MAX_NAME_WORDS);
        let longest = (2..=most).rev().find(|n| is_there(&rest[..*n].join(" ")));
        let (name, after) = rest.split_at(longest.unwrap_or(1));
        names.push(name.join(" "));
        rest = after;
    }
    names
}

/// Returns the name of a file without its folder.
fn file_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}
