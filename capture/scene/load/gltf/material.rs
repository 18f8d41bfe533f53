//! Conversion of glTF materials to diffuse ones.

use super::super::folder_of;
use super::super::notes::{Note, Notes};
use super::super::textures::{DecodedTextures, Handle, Role, TextureTable};
use super::accessor::Buffers;
use super::raw_json::RawJson;
use super::uri::UriTarget;
use crate::load::gltf::uri;
use crate::material::{Cutout, Material};
use glam::{Affine2, Mat2, Vec2};
use gltf::json::material::AlphaMode;
use gltf::json::validation::Checked;
use gltf::json::{Root, texture};
use std::path::Path;

/// Least opacity of a visible surface: clear glass and holes of blended textures have less.
const BLEND_THRESHOLD: f32 = 0.5;

/// Material and texture mapping of triangles.
#[derive(Clone, Copy, Debug)]
pub(super) struct GltfMaterial {
    /// Index into the scene's materials, or `None` for a transparent material.
    pub(super) material: Option<u32>,
    /// Set of texture coordinates that is used.
    pub(super) texcoord_set: u32,
    /// Maps the texture coordinate of a vertex to that of the image, both with v downward.
    pub(super) image_from_vertex: Affine2,
}

/// Converted materials of a file.
pub(super) struct GltfMaterials {
    pub(super) materials: Vec<Material>,
    pub(super) textures: DecodedTextures,
    surfaces: Vec<GltfMaterial>,
}

impl GltfMaterials {
    /// Converts the materials in use and decodes their textures.
    pub(super) fn read(
        root: &Root,
        raw: &RawJson,
        buffers: &Buffers,
        path: &Path,
        notes: &mut Notes,
    ) -> Self {
        let mut used = vec![false; root.materials.len() + 1];
        for primitive in root.meshes.iter().flat_map(|mesh| &mesh.primitives) {
            used[primitive.material.map_or(root.materials.len(), |m| {
                m.value().min(root.materials.len())
            })] = true;
        }
        let neutral = gltf::json::Material::default();
        let all = || root.materials.iter().chain([&neutral]).zip(&used);

        let mut set = TextureTable::default();
        let mut request = |info: Option<&texture::Info>, used: bool| {
            info.filter(|_| used)
                .map(|info| request_texture(root, raw, buffers, info, path, &mut set, notes))
        };
        let handles: Vec<_> = all()
            .map(|(m, &used)| {
                [
                    request(base_color(m).0, used),
                    request(m.emissive_texture.as_ref(), used),
                ]
            })
            .collect();
        let textures = set.decode(notes);

        let mut materials = Vec::new();
        let mut surfaces = Vec::new();
        for ((index, (m, &used)), handles) in all().enumerate().zip(handles) {
            let name = m
                .name
                .clone()
                .unwrap_or_else(|| format!("material {index}"));
            let material = convert(m, name, handles, &textures)
                .filter(|_| used)
                .map(|material| {
                    materials.push(material);
                    materials.len() as u32 - 1
                });
            let is_unlit = m
                .extensions
                .as_ref()
                .is_some_and(|extensions| extensions.unlit.is_some());
            notes.add(Note::Unlit, usize::from(is_unlit && material.is_some()));
            surfaces.push(map_textures(m, material, notes));
        }
        if materials.is_empty() {
            materials.push(Material::default());
        }
        Self {
            materials,
            textures,
            surfaces,
        }
    }

    /// Returns the material for the index of a primitive: the neutral one if that is absent or out
    /// of range.
    pub(super) fn find(&self, material: Option<usize>) -> Option<GltfMaterial> {
        material
            .and_then(|index| self.surfaces.get(index))
            .or(self.surfaces.last())
            .copied()
    }
}

/// Returns the texture and the factor of the base colour; if there is none, the diffuse colour of
/// the specular-glossiness model, or the specular colour of metals, which have no diffuse one.
fn base_color(m: &gltf::json::Material) -> (Option<&texture::Info>, [f32; 4]) {
    let base = &m.pbr_metallic_roughness;
    let has_base = base.base_color_texture.is_some() || base.base_color_factor.0 != [1.0; 4];
    let specular_glossiness = m
        .extensions
        .as_ref()
        .and_then(|extensions| extensions.pbr_specular_glossiness.as_ref());
    match specular_glossiness.filter(|_| !has_base) {
        None => (base.base_color_texture.as_ref(), base.base_color_factor.0),
        Some(m) => {
            let [r, g, b, alpha] = m.diffuse_factor.0;
            let is_metal = m.diffuse_texture.is_none() && [r, g, b] == [0.0; 3];
            let [r, g, b] = if is_metal {
                m.specular_factor.0
            } else {
                [r, g, b]
            };
            (m.diffuse_texture.as_ref(), [r, g, b, alpha])
        }
    }
}

/// Returns the image of a texture: its WebP image, else its own, else its KTX2 image.
fn image_of_texture(root: &Root, raw: &RawJson, texture: usize) -> Option<usize> {
    let own = root.textures.get(texture)?.source.value();
    let candidates = [
        raw.image_of_texture(texture),
        Some(own),
        raw.ktx2_image_of_texture(texture),
    ];
    candidates
        .into_iter()
        .flatten()
        .find(|&image| image < root.images.len())
}

fn request_texture(
    root: &Root,
    raw: &RawJson,
    buffers: &Buffers,
    info: &texture::Info,
    path: &Path,
    set: &mut TextureTable,
    notes: &mut Notes,
) -> Handle {
    let texture = info.index.value();
    let index = image_of_texture(root, raw, texture);
    let Some((index, image)) = index.and_then(|index| Some((index, root.images.get(index)?)))
    else {
        let cause = "it has no image in a known format";
        return set.embedded(
            &format!("texture {texture}"),
            Err(cause.into()),
            Role::Color,
        );
    };
    let name = image.name.clone().unwrap_or_default();
    let name = format!(
        "image {index}{}{name}",
        if name.is_empty() { "" } else { " " }
    );
    let target = image.uri.as_deref().map(uri::resolve);
    let bytes = match (image.buffer_view, &target) {
        (Some(view), _) => match buffers.view(view) {
            Some((bytes, _)) => Ok(bytes),
            None => Err("its bytes are missing".into()),
        },
        (None, Some(UriTarget::Data(bytes))) => bytes.as_deref().map_err(Clone::clone),
        (None, Some(UriTarget::File(file))) => {
            return set.file(file, &[folder_of(path)], Role::Color, notes);
        }
        (None, None) => Err("it has neither bytes nor a name".into()),
    };
    set.embedded(&name, bytes, Role::Color)
}

/// Converts a material; `None` if it is transparent.
fn convert(
    m: &gltf::json::Material,
    name: String,
    [base, emissive]: [Option<Handle>; 2],
    textures: &DecodedTextures,
) -> Option<Material> {
    let slot = |handle: Option<Handle>| handle.and_then(|handle| textures.slot(handle));
    let (_, [r, g, b, alpha]) = base_color(m);
    let base_slot = slot(base);
    let threshold = match m.alpha_mode {
        Checked::Valid(AlphaMode::Mask) => m.alpha_cutoff.unwrap_or_default().0,
        Checked::Valid(AlphaMode::Blend) => BLEND_THRESHOLD,
        _ => 0.0,
    };
    // The factor multiplies the texture's alpha. The threshold is divided instead, so that the
    // texture stays unchanged.
    let threshold = if threshold > 0.0 {
        threshold / alpha.max(1e-6)
    } else {
        0.0
    };
    let greatest_alpha = base_slot.map_or(1.0, |slot| f32::from(slot.greatest_alpha) / 255.0);
    let extensions = m.extensions.as_ref();
    // With a texture the factor is only a maximum, as for the panes of a house.
    let transmission = extensions
        .and_then(|e| e.transmission.as_ref())
        .filter(|t| t.transmission_texture.is_none());
    let transmission = transmission.map_or(0.0, |t| t.transmission_factor.0);
    if greatest_alpha < threshold || transmission > 1.0 - BLEND_THRESHOLD {
        return None;
    }

    let strength = extensions
        .and_then(|e| e.emissive_strength.as_ref())
        .map_or(1.0, |e| e.emissive_strength.0);
    let emission_slot = slot(emissive);
    // Without its texture the whole surface would emit light.
    let is_dark = emissive.is_some() && emission_slot.is_none();
    let emission = if is_dark {
        [0.0; 3]
    } else {
        m.emissive_factor.0.map(|c| c * strength)
    };
    let finite = |c: f32| if c.is_finite() { c.max(0.0) } else { 0.0 };
    Some(Material {
        name,
        albedo: [r, g, b].map(|c| finite(c).min(1.0)),
        albedo_texture: base_slot.map(|slot| slot.index),
        emission: emission.map(finite),
        emission_texture: emission_slot.map(|slot| slot.index),
        gloss: None,
        cutout: base_slot
            .filter(|slot| slot.is_cut_at(threshold))
            .map(|slot| Cutout {
                texture: slot.index,
                threshold,
            }),
    })
}

/// Describes the texture mapping of a material. A vertex of a scene has one texture coordinate:
/// that of the base colour, else of the emission.
fn map_textures(
    m: &gltf::json::Material,
    material: Option<u32>,
    notes: &mut Notes,
) -> GltfMaterial {
    let mut infos = [base_color(m).0, m.emissive_texture.as_ref()]
        .into_iter()
        .flatten();
    let (texcoord_set, image_from_vertex) = infos
        .next()
        .map_or((0, Affine2::IDENTITY), texture_transform);
    for other in infos.filter(|other| texture_transform(other) != (texcoord_set, image_from_vertex))
    {
        notes.add_named(
            Note::TextureTransformIgnored,
            format!("texture {}", other.index.value()),
        );
    }
    GltfMaterial {
        material,
        texcoord_set,
        image_from_vertex,
    }
}

/// Returns the set of texture coordinates and the `KHR_texture_transform` of a texture: a scale, a
/// rotation (counter-clockwise with v downward), an offset.
fn texture_transform(info: &texture::Info) -> (u32, Affine2) {
    match info
        .extensions
        .as_ref()
        .and_then(|extensions| extensions.texture_transform.as_ref())
    {
        None => (info.tex_coord, Affine2::IDENTITY),
        Some(t) => {
            let turn = Mat2::from_angle(-t.rotation.0) * Mat2::from_diagonal(Vec2::from(t.scale.0));
            (
                t.tex_coord.unwrap_or(info.tex_coord),
                Affine2::from_mat2_translation(turn, t.offset.0.into()),
            )
        }
    }
}
