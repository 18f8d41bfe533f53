//! glTF materials as diffuse surfaces.

use super::super::folder_of;
use super::super::notes::{Note, Notes};
use super::super::textures::{DecodedTextures, Handle, Role, TextureTable};
use super::accessor::Buffers;
use super::second_reading::SecondReading;
use super::uri::Target;
use crate::load::gltf::uri;
use crate::material::{Cutout, Material};
use glam::{Affine2, Mat2, Vec2};
use gltf::json::material::AlphaMode;
use gltf::json::validation::Checked;
use gltf::json::{Root, texture};
use std::path::Path;

/// Opacity below this is seen through: clear glass, and the holes of blended textures.
const BLEND_THRESHOLD: f32 = 0.5;

/// How the triangles of a material enter the scene.
#[derive(Clone, Copy, Debug)]
pub(super) struct GltfMaterial {
    /// Index into the scene's materials, or `None` for what is seen through.
    pub(super) material: Option<u32>,
    /// Which of the vertices' sets of texture coordinates is used.
    pub(super) texcoord_set: u32,
    /// Takes the texture coordinate of a vertex to that of the image, both with v downward.
    pub(super) image_from_vertex: Affine2,
}

/// All materials of a file, ready for use.
pub(super) struct GltfMaterials {
    pub(super) materials: Vec<Material>,
    pub(super) textures: DecodedTextures,
    surfaces: Vec<GltfMaterial>,
}

impl GltfMaterials {
    /// Converts all materials that are in use and decodes their textures.
    pub(super) fn read(
        root: &Root,
        reread: &SecondReading,
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
                .map(|info| request_texture(root, reread, buffers, info, path, &mut set, notes))
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
                    materials.len() as u32 - 1 // at most as many as the file has
                });
            let is_unlit = m
                .extensions
                .as_ref()
                .is_some_and(|extensions| extensions.unlit.is_some());
            notes.add(Note::Unlit, usize::from(is_unlit && material.is_some()));
            surfaces.push(surface(m, material, notes));
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

    /// The surface for the material index of a primitive; one that is absent or out of range gets the neutral one.
    pub(super) fn of(&self, material: Option<usize>) -> Option<GltfMaterial> {
        material
            .and_then(|index| self.surfaces.get(index))
            .or(self.surfaces.last())
            .copied()
    }
}

/// Colour of a surface: texture and factor. That of the older model of specular colour and gloss where there is no other; what
/// has no diffuse colour at all, a metal, shows its specular one.
fn base_color(m: &gltf::json::Material) -> (Option<&texture::Info>, [f32; 4]) {
    let usual = &m.pbr_metallic_roughness;
    let has_usual = usual.base_color_texture.is_some() || usual.base_color_factor.0 != [1.0; 4];
    let older = m
        .extensions
        .as_ref()
        .and_then(|extensions| extensions.pbr_specular_glossiness.as_ref());
    match older.filter(|_| !has_usual) {
        None => (usual.base_color_texture.as_ref(), usual.base_color_factor.0),
        Some(older) => {
            let [r, g, b, alpha] = older.diffuse_factor.0;
            let is_metal = older.diffuse_texture.is_none() && [r, g, b] == [0.0; 3];
            let [r, g, b] = if is_metal {
                older.specular_factor.0
            } else {
                [r, g, b]
            };
            (older.diffuse_texture.as_ref(), [r, g, b, alpha])
        }
    }
}

/// The image of a texture: that of a format that an extension brings, else its own.
fn image_of_texture(root: &Root, reread: &SecondReading, texture: usize) -> Option<usize> {
    let own = root.textures.get(texture)?.source.value();
    Some(
        reread
            .image_of_texture(texture)
            .filter(|&image| image < root.images.len())
            .unwrap_or(own),
    )
}

fn request_texture(
    root: &Root,
    reread: &SecondReading,
    buffers: &Buffers,
    info: &texture::Info,
    path: &Path,
    set: &mut TextureTable,
    notes: &mut Notes,
) -> Handle {
    let texture = info.index.value();
    let index = image_of_texture(root, reread, texture);
    let Some((index, image)) = index.and_then(|index| Some((index, root.images.get(index)?)))
    else {
        let cause = if reread.is_ktx2(texture) {
            "it is KTX2, which is not read; export it as PNG, JPEG or WebP"
        } else {
            "it has no image of a known kind"
        };
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
    match (image.buffer_view, image.uri.as_deref().map(uri::resolve)) {
        (Some(view), _) => {
            let bytes = buffers.view(view).map(|(bytes, _)| bytes);
            set.embedded(
                &name,
                bytes.ok_or_else(|| "its bytes are missing".into()),
                Role::Color,
            )
        }
        (None, Some(Target::Data(bytes))) => {
            set.embedded(&name, bytes.as_deref().map_err(Clone::clone), Role::Color)
        }
        (None, Some(Target::File(file))) => set.file(&file, &[folder_of(path)], Role::Color, notes),
        (None, None) => set.embedded(
            &name,
            Err("it has neither bytes nor a name".into()),
            Role::Color,
        ),
    }
}

/// The scene's material, or `None` if it is seen through.
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
    // The factor multiplies the texture's alpha; dividing the threshold by it instead leaves the texture as it is.
    let threshold = if threshold > 0.0 {
        threshold / alpha.max(1e-6)
    } else {
        0.0
    };
    let greatest_alpha = base_slot.map_or(1.0, |slot| f32::from(slot.greatest_alpha) / 255.0);
    let extensions = m.extensions.as_ref();
    // Under a texture the factor says how much is let through at most: of some part, which may be the panes of a whole house.
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
    // An emissive texture that cannot be read is better dark than glowing all over.
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

/// A vertex has one texture coordinate in the scene: that of the base colour, or of the emission where there is no
/// base colour.
fn surface(m: &gltf::json::Material, material: Option<u32>, notes: &mut Notes) -> GltfMaterial {
    let mut infos = [base_color(m).0, m.emissive_texture.as_ref()]
        .into_iter()
        .flatten();
    let (texcoord_set, image_from_vertex) = infos.next().map_or((0, Affine2::IDENTITY), placement);
    for other in infos.filter(|other| placement(other) != (texcoord_set, image_from_vertex)) {
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

/// Set of texture coordinates and `KHR_texture_transform`: scale, then a turn that looks counter-clockwise with v
/// downward, then an offset.
fn placement(info: &texture::Info) -> (u32, Affine2) {
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
