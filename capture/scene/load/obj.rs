//! OBJ files, with their MTL files.
//!
//! `tobj` parses positions (in `f64`, so that coordinates of 1e7 stay exact), joins corners and splits by material;
//! [`super::obj_prepare`] mends what it would trip over, [`super::mtl`] reads materials, [`super::polygon`] cuts polygons.
//!
//! Choices that the format leaves open: `Kd` is linear, vertex colours are sRGB (as their usual writers have it). A
//! `Kd` of 0 beside a `map_Kd` counts as not given, and what is not given is white under vertex colours or a texture, else grey. Where
//! a `map_Ke` cannot be read nothing is emitted. A component of `Ka` above 1 makes `Ka` the emitted radiance, as in
//! the widespread file of the Cornell box, unless there is a `Ke`. Opacity (`d`, `Tr`) below one half without a map of
//! opacity leaves the triangles out, as clear glass that a diffuse scene cannot show; at or above, it is opaque.

use super::builder::{Builder, GroupedScene, Vertex};
use super::lines::decode;
use super::mtl::{Map, MtlMaterial};
use super::notes::{Note, Notes};
use super::obj_prepare::{LineError, PreparedObj, prepare};
use super::orientation::{FrameHints, head_comments};
use super::polygon::triangulate;
use super::textures::{DecodedTextures, Handle, Role, TextureTable, find_file};
use super::{LoadError, LoadOptions, folder_of};
use crate::load::mtl;
use crate::material::{Cutout, Material};
use glam::{Affine2, DVec3, Vec2, Vec3};
use headbox_core::color::linear_from_srgb;
use headbox_core::file_frame::FileFrame;
use std::collections::HashMap;
use std::path::Path;

/// Alpha below this is a hole; OBJ has no statement for it.
const CUTOUT_THRESHOLD: f32 = 0.5;

pub(super) fn load(
    path: &Path,
    bytes: &[u8],
    options: &LoadOptions,
    groups: bool,
) -> Result<GroupedScene, LoadError> {
    let text = decode(bytes);
    let obj = prepare_file(path, &text, groups)?;
    let hints = FrameHints {
        options: *options,
        comments: head_comments(&text),
        floors: obj.floors,
    };
    let mut notes = Notes::default();
    let materials = read_libraries(&obj.libraries, folder_of(path), &mut notes);
    let builder = Builder::to_be_oriented(hints, notes);
    build(path, obj, &materials, &Pictures::new(), builder, groups)
}

/// Pictures at hand, by the names that maps have for them.
pub type Pictures = HashMap<String, Vec<u8>>;

/// As [`load`], from a text, materials and pictures at hand; `path` is for messages.
pub fn load_text(
    path: &Path,
    text: &str,
    materials: &[MtlMaterial],
    pictures: &Pictures,
    frame: FileFrame,
) -> Result<GroupedScene, LoadError> {
    let obj = prepare_file(path, text, true)?;
    let builder = Builder::new(frame, Notes::default());
    build(path, obj, materials, pictures, builder, true)
}

fn prepare_file(path: &Path, text: &str, groups: bool) -> Result<PreparedObj, LoadError> {
    prepare(text, groups).map_err(|LineError { line, cause }| LoadError::Line {
        path: path.to_path_buf(),
        line,
        cause,
    })
}

fn build(
    path: &Path,
    obj: PreparedObj,
    materials: &[MtlMaterial],
    pictures: &Pictures,
    mut builder: Builder,
    groups: bool,
) -> Result<GroupedScene, LoadError> {
    let malformed = |cause: String| LoadError::Malformed {
        path: path.to_path_buf(),
        cause,
    };
    let models = parse(&obj.text, materials).map_err(|cause| malformed(cause.to_string()))?;
    let notes = &mut builder.notes;
    notes.merge(obj.notes);
    let is_undefined = |name: &&String| materials.iter().all(|m| m.name != **name);
    for name in obj.used_materials.iter().filter(is_undefined) {
        notes.add_named(Note::MaterialUndefined, name);
    }

    let surfaces = ObjMaterials::new(materials, folder_of(path), pictures, &models, notes);
    for model in &models {
        if groups {
            builder.begin_group(&model.name);
        }
        surfaces
            .push_mesh(&model.mesh, &mut builder)
            .map_err(|TooManyVertices| malformed("it has more than 2^32 vertices".into()))?;
    }
    builder.finish(path, surfaces.materials, surfaces.textures.textures)
}

/// Parses a prepared text with `tobj`.
fn parse(text: &str, materials: &[MtlMaterial]) -> Result<Vec<tobj::Model>, tobj::LoadError> {
    let options = tobj::LoadOptions {
        single_index: true,
        ..Default::default()
    };
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, |_| {
        let by_name = |(index, m): (usize, &MtlMaterial)| (m.name.clone(), index);
        // Of two materials with the same name the later one is used.
        Ok((
            Vec::new(),
            materials.iter().enumerate().map(by_name).collect(),
        ))
    })?;
    Ok(models)
}

/// Reads all material files. A `mtllib` names one file, whose name may contain spaces, or several.
fn read_libraries(libraries: &[String], folder: &Path, notes: &mut Notes) -> Vec<MtlMaterial> {
    let mut materials = Vec::new();
    for written in libraries {
        let names: Vec<&str> = match find_file(written, &[folder]) {
            Some(_) => vec![written],
            None => written.split_whitespace().collect(),
        };
        for name in names {
            let found = find_file(name, &[folder]).ok_or_else(|| "no such file".to_owned());
            let read = found.and_then(|found| match std::fs::read(&found.path) {
                Ok(bytes) => Ok((found.path, bytes)),
                Err(cause) => Err(cause.to_string()),
            });
            match read {
                Ok((path, bytes)) => {
                    notes.add_file(&path);
                    mtl::parse(
                        &decode(&bytes),
                        name,
                        folder_of(&path).to_path_buf(),
                        &mut materials,
                        notes,
                    );
                }
                Err(cause) => {
                    notes.add_named(Note::MaterialFileUnreadable, format!("{name} ({cause})"));
                }
            }
        }
    }
    materials
}

struct TooManyVertices;

/// The materials in use, as the scene will have them.
struct ObjMaterials {
    materials: Vec<Material>,
    textures: DecodedTextures,
    /// For each material of the MTL files, and at the end for faces without one.
    by_mtl: Vec<Option<ObjMaterial>>,
}

/// How the triangles of a material enter the scene.
#[derive(Clone, Copy)]
struct ObjMaterial {
    /// Index into the scene's materials, or `None` for see-through glass.
    material: Option<u32>,
    image_from_vertex: Affine2,
}

/// Images asked for by a material.
#[derive(Clone, Copy, Default)]
struct Maps {
    diffuse: Option<Handle>,
    emissive: Option<Handle>,
    dissolve: Option<Handle>,
}

impl ObjMaterials {
    /// Converts the materials that the models use, and decodes their textures.
    fn new(
        mtl: &[MtlMaterial],
        folder: &Path,
        pictures: &Pictures,
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

        let mut set = TextureTable::default();
        let maps: Vec<Maps> = all()
            .map(|(m, &used)| {
                if used {
                    request_maps(m, (folder, pictures), &mut set, notes)
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
                ObjMaterial {
                    material,
                    image_from_vertex: placement(m, notes),
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
    fn push_mesh(&self, mesh: &tobj::Mesh, builder: &mut Builder) -> Result<(), TooManyVertices> {
        let Some(surface) = self.by_mtl[mesh.material_id.unwrap_or(self.by_mtl.len() - 1)] else {
            return Ok(()); // no face uses it
        };
        let position = |i: u32| DVec3::from_slice(&mesh.positions[3 * i as usize..]);
        let polygons = || {
            let mut rest = mesh.indices.as_slice();
            let mut arities = mesh.face_arities.iter();
            // `tobj` leaves out the arities where all faces are triangles.
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

        let first = builder
            .next_vertex(mesh.positions.len() / 3)
            .ok_or(TooManyVertices)?;
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
                color: colors.get(i).map_or(Vec3::ONE, |c| c.map(linear_from_srgb)),
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

fn request_maps(
    m: &MtlMaterial,
    (folder, pictures): (&Path, &Pictures),
    set: &mut TextureTable,
    notes: &mut Notes,
) -> Maps {
    let folders = [m.folder.as_path(), folder];
    let mut request = |map: &Option<Map>, role| {
        map.as_ref().map(|map| match pictures.get(&map.file) {
            Some(bytes) => set.embedded(&map.file, Ok(bytes), role),
            None => set.file(&map.file, &folders, role, notes),
        })
    };
    let diffuse = request(&m.diffuse_map, Role::Color);
    let same_file = |a: &Map, b: &Map| a.file == b.file;
    let dissolve = match (&m.dissolve_map, &m.diffuse_map) {
        (Some(a), Some(b)) if same_file(a, b) => diffuse,
        (map, _) => request(map, Role::Mask),
    };
    Maps {
        diffuse,
        emissive: request(&m.emissive_map, Role::Color),
        dissolve,
    }
}

/// The scene's material, or `None` for see-through glass. `coloured`: vertices bring colours.
fn convert(
    m: &MtlMaterial,
    coloured: bool,
    maps: Maps,
    textures: &DecodedTextures,
    notes: &mut Notes,
) -> Option<Material> {
    let slot = |handle: Option<Handle>| handle.and_then(|handle| textures.slot(handle));
    let (diffuse, emissive) = (slot(maps.diffuse), slot(maps.emissive));
    let opacity = slot(maps.dissolve).or(diffuse.filter(|_| m.claims_transparency()));
    let opacity = opacity.filter(|slot| slot.is_cut_at(CUTOUT_THRESHOLD));
    if opacity.is_none() && m.opacity() < 0.5 {
        return None;
    }

    if m.is_turned() {
        notes.add_named(Note::TransparencyTurned, &m.name);
    }
    let given = |color: Option<[f32; 3]>| color.filter(|color| *color != [0.0; 3]);
    let said = if m.diffuse_map.is_some() {
        given(m.diffuse)
    } else {
        m.diffuse
    };
    let unsaid = if diffuse.is_some() || coloured {
        [1.0; 3]
    } else {
        Material::default().albedo
    };
    let light_from_ambient = m
        .ambient
        .filter(|ka| ka.iter().any(|&c| c > 1.0) && given(m.emissive).is_none());
    if light_from_ambient.is_some() {
        notes.add_named(Note::AmbientTakenAsLight, &m.name);
    }
    let unsaid_emission = if emissive.is_some() {
        [1.0; 3]
    } else {
        [0.0; 3]
    };
    // A map that cannot be read is better dark than glowing all over.
    let is_dark = m.emissive_map.is_some() && emissive.is_none();
    let emission = given(m.emissive)
        .filter(|_| !is_dark)
        .or(light_from_ambient)
        .unwrap_or(unsaid_emission);
    Some(Material {
        name: m.name.clone(),
        albedo: said.unwrap_or(unsaid).map(|c| c.clamp(0.0, 1.0)),
        albedo_texture: diffuse.map(|slot| slot.index),
        emission: emission.map(|c| c.max(0.0)),
        emission_texture: emissive.map(|slot| slot.index),
        gloss: None,
        cutout: opacity.map(|slot| Cutout {
            texture: slot.index,
            threshold: CUTOUT_THRESHOLD,
        }),
    })
}

/// A vertex has one texture coordinate, so all maps of a material are placed like the first.
fn placement(m: &MtlMaterial, notes: &mut Notes) -> Affine2 {
    let mut maps = [&m.diffuse_map, &m.emissive_map, &m.dissolve_map]
        .into_iter()
        .flatten();
    let Some(first) = maps.next() else {
        return Affine2::IDENTITY;
    };
    for other in maps.filter(|other| other.image_from_vertex != first.image_from_vertex) {
        notes.add_named(Note::TextureTransformIgnored, &other.file);
    }
    first.image_from_vertex
}
