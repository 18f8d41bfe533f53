//! Materials of OBJ files with their textures.

use super::mtl::{Map, MtlMaterial};
use crate::load::builder::{Builder, MeshError};
use crate::load::folder_of;
use crate::load::lines::{keyword, without_comment};
use crate::load::named_files::find_file;
use crate::load::notes::{Note, Notes};
use crate::load::polygon::triangulate;
use crate::load::textures::{DecodedTextures, Handle, Role, TextureTable, TextureUse};
use crate::material::{Cutout, Material, Sampler, Wrap};
use crate::scene::Vertex;
use glam::{Affine2, DVec3, Vec2, Vec3};
use headbox_core::color::linear_from_srgb;
use headbox_core::files::InputFolder;
use std::collections::HashMap;
use std::path::Path;

/// Number of words before a file name that may be unknown options and their values.
const MAX_UNKNOWN_WORDS: usize = 8;

/// Least alpha that is not a hole; OBJ and PLY have no statement for it.
pub(crate) const CUTOUT_THRESHOLD: f32 = 0.5;

/// Contents of image files by the names in maps.
pub type EmbeddedImages = HashMap<String, Vec<u8>>;

/// Converted materials in use.
pub(super) struct ObjMaterials {
    pub(super) materials: Vec<Material>,
    pub(super) textures: DecodedTextures,
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
    pub(super) fn new(
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
    pub(super) fn push_mesh(
        &self,
        mesh: &tobj::Mesh,
        builder: &mut Builder,
    ) -> Result<(), MeshError> {
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
