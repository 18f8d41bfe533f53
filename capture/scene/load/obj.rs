//! OBJ files, with their MTL files.
//!
//! `tobj` parses positions (in `f64`, so that coordinates of 1e7 stay exact), merges corners and
//! splits by material; [`super::obj_prepare`] removes defects before, [`super::mtl`] reads
//! materials, [`super::polygon`] triangulates.
//!
//! The format leaves open:
//! * `Kd` is linear, vertex colours are sRGB, as most programs write them. In a file whose first
//!   comments name Sweet Home 3D, `Kd` is sRGB: that program writes colours as it shows them.
//! * A `Kd` of 0 with a `map_Kd` counts as absent. An absent `Kd` is white with vertex colours or a
//!   texture, else grey.
//! * Nothing is emitted if a `map_Ke` cannot be read.
//! * A `Ka` with a component above 1 is emitted radiance, as in the common file of the Cornell box,
//!   unless there is a `Ke`.
//! * Triangles with an opacity (`d`, `Tr`) of at most one half and no map of it are left out,
//!   because diffuse scenes have no clear glass; others are opaque. Panes of Sweet Home 3D have one
//!   half.

use super::builder::{Builder, GroupedScene, MeshError};
use super::encoding::decode_text;

use super::lines::{keyword, without_comment};
use super::material_names::MaterialNames;
use super::mtl::{Map, MtlMaterial};
use super::named_files::find_file;
use super::notes::{Note, Notes};
use super::obj_prepare::{LineError, PreparedObj, prepare};
use super::orientation::{FrameHints, head_comments};
use super::polygon::triangulate;
use super::textures::{DecodedTextures, Handle, Role, TextureTable, TextureUse};
use super::{LoadError, LoadOptions, folder_of};
use crate::load::mtl;
use crate::material::{Cutout, Material, Sampler, Wrap};
use crate::scene::Vertex;
use glam::{Affine2, DVec3, Vec2, Vec3};
use headbox_core::color::linear_from_srgb;
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

/// Number of words before a file name that may be unknown options and their values.
const MAX_UNKNOWN_WORDS: usize = 8;

/// Most words of the name of one of several material files in a line.
const MAX_NAME_WORDS: usize = 16;

/// Least alpha that is not a hole; OBJ and PLY have no statement for it.
pub(super) const CUTOUT_THRESHOLD: f32 = 0.5;

/// Loads an OBJ with the files that it refers to.
pub(super) fn load(
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

/// Contents of image files by the names in maps.
pub type EmbeddedImages = HashMap<String, Vec<u8>>;

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

/// Converted materials in use.
struct ObjMaterials {
    materials: Vec<Material>,
    textures: DecodedTextures,
    /// Entry of each MTL material that is used, and at the end of faces without a material.
    by_mtl: Vec<Option<ObjMaterial>>,
}

/// Material and texture mapping of triangles.
#[derive(Clone, Copy)]
struct ObjMaterial {
    /// Index into the scene's materials, or `None` for clear glass.
    material: Option<u32>,
    /// Maps the texture coordinate of a vertex to that of the image.
    image_from_vertex: Affine2,
    /// The same for the emission texture.
    emission_from_vertex: Affine2,
}

/// Textures that a material requests.
#[derive(Clone, Copy, Default)]
struct Maps {
    diffuse: Option<Handle>,
    emissive: Option<Handle>,
    dissolve: Option<Handle>,
    /// The diffuse map, if it is the opacity map, too.
    own_alpha: Option<Handle>,
}

impl ObjMaterials {
    /// Converts the materials that the models use and decodes their textures.
    fn new(
        mtl: &[MtlMaterial],
        path: &Path,
        images: &EmbeddedImages,
        models: &[tobj::Model],
        notes: &mut Notes,
    ) -> Self {
        let (mut used, mut coloured) = (vec![false; mtl.len() + 1], vec![false; mtl.len() + 1]);
        for model in models.iter().filter(|model| !model.mesh.indices.is_empty()) {
            let material = model.mesh.material_id.unwrap_or(mtl.len());
            used[material] = true;
            coloured[material] |= !model.mesh.vertex_color.is_empty();
        }
        let neutral = MtlMaterial {
            name: Material::default().name,
            ..MtlMaterial::default()
        };
        let all = || mtl.iter().chain([&neutral]).zip(&used);

        let scene = InputFolder::new(folder_of(path));
        let mut set = TextureTable::default();
        let maps: Vec<Maps> = all()
            .map(|(m, &used)| {
                if used {
                    request_maps(m, (&scene, images), &mut set, notes)
                } else {
                    Maps::default()
                }
            })
            .collect();
        let textures = set.decode(notes);

        let mut materials = Vec::new();
        let mut by_mtl = Vec::new();
        for (((m, &used), maps), coloured) in all().zip(maps).zip(coloured) {
            by_mtl.push(used.then(|| {
                let material = convert(m, coloured, maps, &textures, notes).map(|material| {
                    materials.push(material);
                    materials.len() as u32 - 1
                });
                let image_from_vertex = map_transform(m, notes);
                ObjMaterial {
                    material,
                    image_from_vertex,
                    emission_from_vertex: m
                        .emissive_map
                        .as_ref()
                        .map_or(image_from_vertex, |map| map.image_from_vertex),
                }
            }));
        }
        if materials.is_empty() {
            materials.push(Material::default());
        }
        Self {
            materials,
            textures,
            by_mtl,
        }
    }

    /// Adds the triangles of a mesh to the scene.
    fn push_mesh(&self, mesh: &tobj::Mesh, builder: &mut Builder) -> Result<(), MeshError> {
        let Some(surface) = self.by_mtl[mesh.material_id.unwrap_or(self.by_mtl.len() - 1)] else {
            return Ok(()); // no face uses it
        };
        let position = |i: u32| DVec3::from_slice(&mesh.positions[3 * i as usize..]);
        let polygons = || {
            let mut rest = mesh.indices.as_slice();
            let mut arities = mesh.face_arities.iter();
            // `tobj` has no arities if all faces are triangles.
            std::iter::from_fn(move || {
                let arity = arities.next().map_or(3, |&arity| arity as usize);
                let (polygon, after) = rest.split_at_checked(arity)?;
                rest = after;
                Some(polygon)
            })
        };
        let Some(material) = surface.material else {
            builder.notes.add(
                Note::SeeThrough,
                polygons()
                    .map(|polygon| polygon.len().saturating_sub(2))
                    .sum(),
            );
            return Ok(());
        };

        let first = builder.next_vertex(mesh.positions.len() / 3)?;
        let triples = |values: &[f64]| {
            values
                .chunks_exact(3)
                .map(DVec3::from_slice)
                .map(|v| v.as_vec3())
                .collect()
        };
        let normals: Vec<Vec3> = triples(&mesh.normals);
        let colors: Vec<Vec3> = triples(&mesh.vertex_color);
        for (i, p) in mesh.positions.chunks_exact(3).enumerate() {
            let texcoord = mesh
                .texcoords
                .get(2 * i..2 * i + 2)
                .map_or(Vec2::ZERO, |t| Vec2::new(t[0] as f32, t[1] as f32));
            builder.push_vertex(Vertex {
                position: DVec3::from_slice(p),
                normal: normals.get(i).copied().unwrap_or(Vec3::ZERO),
                texcoord: surface.image_from_vertex.transform_point2(texcoord),
                emission_texcoord: surface.emission_from_vertex.transform_point2(texcoord),
                color: colors.get(i).map_or(Vec3::ONE, |c| c.map(linear_from_srgb)),
                opacity: 1.0,
            });
        }
        for polygon in polygons() {
            let corners: Vec<DVec3> = polygon.iter().map(|&i| position(i)).collect();
            for triangle in triangulate(&corners) {
                builder.push_triangle(triangle.map(|corner| first + polygon[corner]), material);
            }
        }
        Ok(())
    }
}

/// Requests the textures of a material.
fn request_maps(
    m: &MtlMaterial,
    (scene, images): (&InputFolder, &EmbeddedImages),
    set: &mut TextureTable,
    notes: &mut Notes,
) -> Maps {
    let mut request = |map: &Option<Map>, role| {
        let map = map.as_ref()?;
        let wrap = if map.clamp { Wrap::Clamp } else { Wrap::Repeat };
        let sampler = Sampler {
            wrap: [wrap; 2],
            nearest: false,
        };
        let texture_use = TextureUse { role, sampler };
        let embedded = |name: &str| images.get(name);
        let bytes = embedded(&map.file).or_else(|| embedded(without_comment(&map.file)?));
        for option in &map.ignored_options {
            notes.add_named(Note::MapOptionIgnored, option);
        }
        Some(match bytes {
            Some(bytes) => set.embedded(&map.file, Ok(bytes), texture_use),
            None => {
                let name = behind_unknown_options(&map.file, &m.folder, scene, notes);
                set.file(name, &m.folder, scene, texture_use, notes)
            }
        })
    };
    let diffuse = request(&m.diffuse_map, Role::Color);
    let same_file = |a: &Map, b: &Map| a.file == b.file && a.clamp == b.clamp;
    let is_same =
        matches!((&m.dissolve_map, &m.diffuse_map), (Some(a), Some(b)) if same_file(a, b));
    let mask = if is_same { Role::GreyMask } else { Role::Mask };
    Maps {
        diffuse,
        dissolve: request(&m.dissolve_map, mask),
        emissive: request(&m.emissive_map, Role::Color),
        own_alpha: diffuse.filter(|_| is_same),
    }
}

/// Returns the part of `written` that names a file, if it is not the whole and follows options of
/// unknown length.
fn behind_unknown_options<'a>(
    written: &'a str,
    base: &Path,
    scene: &InputFolder,
    notes: &mut Notes,
) -> &'a str {
    let exists = |name: &str| find_file(name, base, scene).is_ok();
    if !written.starts_with('-') || exists(written) {
        return written;
    }
    let mut rest = written;
    for _ in 0..MAX_UNKNOWN_WORDS {
        rest = keyword(rest).1;
        if exists(rest) {
            let option = written[..written.len() - rest.len()].trim_end();
            notes.add_named(Note::MapOptionIgnored, option);
            return rest;
        }
    }
    written
}

/// Converts a material; `None` for clear glass. `has_vertex_colors` makes an absent `Kd` white.
fn convert(
    m: &MtlMaterial,
    has_vertex_colors: bool,
    maps: Maps,
    textures: &DecodedTextures,
    notes: &mut Notes,
) -> Option<Material> {
    let slot = |handle: Option<Handle>| handle.and_then(|handle| textures.slot(handle));
    let (diffuse, emissive) = (slot(maps.diffuse), slot(maps.emissive));
    let by_color = || diffuse.filter(|_| m.dissolve_map.is_none() || m.is_transparent());
    let opacity = slot(maps.dissolve)
        .or_else(|| slot(maps.own_alpha))
        .or_else(by_color);
    let opacity = opacity.filter(|slot| slot.is_cut_at(CUTOUT_THRESHOLD));
    if opacity.is_none() && m.opacity() <= 0.5 {
        return None;
    }

    if opacity.is_some() && m.dissolve_map.is_none() && !m.is_transparent() {
        notes.add_named(Note::HolesByColor, &m.name);
    }
    if m.is_tr_inverted() {
        notes.add_named(Note::TransparencyInverted, &m.name);
    }
    let given = |color: Option<[f32; 3]>| color.filter(|color| *color != [0.0; 3]);
    let specified = if m.diffuse_map.is_some() {
        given(m.diffuse)
    } else {
        m.diffuse
    };
    let default = if diffuse.is_some() || has_vertex_colors {
        [1.0; 3]
    } else {
        Material::default().albedo
    };
    let albedo = specified.unwrap_or(default);
    if albedo.iter().any(|c| !(0.0..=1.0).contains(c)) {
        notes.add_named(Note::MaterialColorLimited, &m.name);
    }
    let light_from_ambient = m
        .ambient
        .filter(|ka| ka.iter().any(|&c| c > 1.0) && given(m.emissive).is_none());
    if light_from_ambient.is_some() {
        notes.add_named(Note::AmbientTakenAsLight, &m.name);
    }
    let default_emission = if emissive.is_some() {
        [1.0; 3]
    } else {
        [0.0; 3]
    };
    // Without its map the whole surface would emit light.
    let is_dark = m.emissive_map.is_some() && emissive.is_none();
    let emission = given(m.emissive)
        .filter(|_| !is_dark)
        .or(light_from_ambient)
        .unwrap_or(default_emission);
    Some(Material {
        name: m.name.clone(),
        albedo: albedo.map(|c| c.clamp(0.0, 1.0)),
        albedo_texture: diffuse.map(|slot| slot.index),
        emission: emission.map(|c| c.max(0.0)),
        emission_texture: emissive.map(|slot| slot.index),
        gloss: None,
        cutout: opacity.map(|slot| Cutout {
            texture: Some(slot.index),
            threshold: CUTOUT_THRESHOLD,
        }),
        single_sided: false,
    })
}

/// Returns the transform of a material's diffuse map, or of its opacity map, which cannot have
/// another one, or of its emission map.
fn map_transform(m: &MtlMaterial, notes: &mut Notes) -> Affine2 {
    let mut maps = [&m.diffuse_map, &m.dissolve_map].into_iter().flatten();
    let Some(first) = maps.next() else {
        let emission = m.emissive_map.as_ref();
        return emission.map_or(Affine2::IDENTITY, |map| map.image_from_vertex);
    };
    for other in maps.filter(|other| other.image_from_vertex != first.image_from_vertex) {
        notes.add_named(Note::TextureTransformIgnored, &other.file);
    }
    first.image_from_vertex
}
