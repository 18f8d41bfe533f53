//! Conversion of glTF materials to diffuse ones.
//!
//! Alpha is the factor times that of the texture times that of the vertices: below the threshold
//! there is a hole.

use super::super::named_files::find_file;
use super::super::notes::{Note, Notes};
use super::super::textures::{DecodedTextures, Handle, Role, Slot, TextureTable, TextureUse};
use super::accessor::Buffers;
use super::raw_json::RawJson;
use super::uri::UriTarget;
use crate::load::gltf::uri;
use crate::material::{Cutout, Material, Sampler, Wrap};
use glam::{Affine2, Mat2, Vec2};
use gltf::json::material::AlphaMode;
use gltf::json::mesh::Semantic;
use gltf::json::validation::Checked;
use gltf::json::{Image, Root, texture};
use headbox_core::files::InputFolder;
use headbox_core::image::codec;
use std::borrow::Cow;

/// Least opacity of a visible surface: clear glass and holes of blended textures have less.
const BLEND_THRESHOLD: f32 = 0.5;

/// Material and texture mapping of triangles.
#[derive(Clone, Copy, Debug)]
pub(super) struct GltfMaterial {
    /// Index into the scene's materials, or `None` for a transparent material.
    pub(super) material: Option<u32>,
    /// Mapping of the base colour, else that of the emission.
    pub(super) mapping: Mapping,
    /// Mapping of the emission, else that of the base colour.
    pub(super) emission_mapping: Mapping,
    /// Opacity of vertices below which a triangle is invisible, whatever the texture; 0 if the
    /// opacity of vertices does not matter.
    pub(super) least_opacity: f32,
}

/// Mapping of a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mapping {
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
        scene: &InputFolder,
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
                .map(|info| request_texture(root, raw, buffers, info, scene, &mut set, notes))
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
        let translucent = materials_with_vertex_opacity(root, buffers);

        let mut materials = Vec::new();
        let mut surfaces = Vec::new();
        for ((index, (m, &used)), handles) in all().enumerate().zip(handles) {
            let name = m
                .name
                .clone()
                .unwrap_or_else(|| format!("material {index}"));
            let has_opacities = translucent.get(index).copied().unwrap_or(false);
            let converted = convert(m, name, handles, has_opacities, &textures);
            let (material, least_opacity) = match converted.filter(|_| used) {
                Some((material, least_opacity)) => {
                    materials.push(material);
                    (Some(materials.len() as u32 - 1), least_opacity)
                }
                None => (None, 0.0),
            };
            let is_unlit = m
                .extensions
                .as_ref()
                .is_some_and(|extensions| extensions.unlit.is_some());
            notes.add(Note::Unlit, usize::from(is_unlit && material.is_some()));
            let [mapping, emission_mapping] = map_textures(m);
            surfaces.push(GltfMaterial {
                material,
                mapping,
                emission_mapping,
                least_opacity,
            });
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

/// Returns the texture and the factor of the base colour: those of the specular-glossiness model, to
/// which the metallic-roughness model beside it is a fallback. Metals have no diffuse colour: theirs
/// is the base colour, or without one the specular colour.
fn base_color(m: &gltf::json::Material) -> (Option<&texture::Info>, [f32; 4]) {
    let base = &m.pbr_metallic_roughness;
    let has_base = base.base_color_texture.is_some() || base.base_color_factor.0 != [1.0; 4];
    let specular_glossiness = m
        .extensions
        .as_ref()
        .and_then(|extensions| extensions.pbr_specular_glossiness.as_ref());
    let Some(m) = specular_glossiness else {
        return (base.base_color_texture.as_ref(), base.base_color_factor.0);
    };
    let [r, g, b, alpha] = m.diffuse_factor.0;
    let is_metal = m.diffuse_texture.is_none() && [r, g, b] == [0.0; 3];
    match (is_metal, has_base) {
        (true, true) => (base.base_color_texture.as_ref(), base.base_color_factor.0),
        (true, false) => {
            let [r, g, b] = m.specular_factor.0;
            (None, [r, g, b, alpha])
        }
        (false, _) => (m.diffuse_texture.as_ref(), [r, g, b, alpha]),
    }
}

/// Returns for each material whether its opacity varies and a primitive with it has vertices that
/// are not opaque.
fn materials_with_vertex_opacity(root: &Root, buffers: &Buffers) -> Vec<bool> {
    let mut found = vec![false; root.materials.len()];
    for primitive in root.meshes.iter().flat_map(|mesh| &mesh.primitives) {
        let material = primitive.material.map_or(usize::MAX, |m| m.value());
        let colors = primitive
            .attributes
            .get(&Checked::Valid(Semantic::Colors(0)));
        let (Some(found), Some(&colors)) = (found.get_mut(material), colors) else {
            continue;
        };
        let is_opaque = threshold(&root.materials[material]) == 0.0;
        if !*found && !is_opaque {
            let (colors, _) = buffers.colors(colors).unwrap_or_default();
            *found = colors.iter().any(|&[.., opacity]| opacity < 1.0);
        }
    }
    found
}

/// Returns the least alpha of the visible part of a material; 0 if it is opaque.
fn threshold(m: &gltf::json::Material) -> f32 {
    match m.alpha_mode {
        Checked::Valid(AlphaMode::Mask) => m.alpha_cutoff.unwrap_or_default().0,
        Checked::Valid(AlphaMode::Blend) => BLEND_THRESHOLD,
        _ => 0.0,
    }
}

/// Returns the sampler of a texture. Of the filters only the magnification counts: rays average
/// over a pixel, and the rasteriser always uses mip levels.
fn sampler_of_texture(root: &Root, texture: usize) -> Sampler {
    let index = root.textures.get(texture).and_then(|t| t.sampler);
    let Some(sampler) = index.and_then(|index| root.samplers.get(index.value())) else {
        return Sampler::default();
    };
    let wrap = |mode: Checked<texture::WrappingMode>| match mode {
        Checked::Valid(texture::WrappingMode::ClampToEdge) => Wrap::Clamp,
        Checked::Valid(texture::WrappingMode::MirroredRepeat) => Wrap::Mirror,
        _ => Wrap::Repeat,
    };
    Sampler {
        wrap: [wrap(sampler.wrap_s), wrap(sampler.wrap_t)],
        nearest: sampler.mag_filter == Some(Checked::Valid(texture::MagFilter::Nearest)),
    }
}

/// Returns the image of a texture: its WebP image, else its own, else its KTX2 image. A damaged
/// WebP image counts only if there is no other.
fn image_of_texture(
    root: &Root,
    raw: &RawJson,
    texture: usize,
    is_damaged: impl Fn(usize) -> bool,
) -> Option<usize> {
    let own = root.textures.get(texture)?.source.value();
    let is_there = |image: &usize| *image < root.images.len();
    let webp = raw.image_of_texture(texture).filter(is_there);
    let ktx2 = raw.ktx2_image_of_texture(texture);
    let other = [Some(own), ktx2].into_iter().flatten().find(is_there);
    if other.is_none() {
        return webp;
    }
    webp.filter(|&image| !is_damaged(image)).or(other)
}

/// Source of an image.
enum ImageSource<'a> {
    File(String),
    Bytes(Result<Cow<'a, [u8]>, String>),
}

fn find_image<'a>(image: &Image, buffers: &'a Buffers, scene: &InputFolder) -> ImageSource<'a> {
    if let Some(view) = image.buffer_view {
        let bytes = buffers.view(view).map(|(bytes, _)| bytes.into());
        return ImageSource::Bytes(bytes.ok_or_else(|| "its bytes are missing".into()));
    }
    match image.uri.as_deref().map(|it| uri::resolve(it, scene)) {
        Some(UriTarget::Data(bytes)) => ImageSource::Bytes(bytes.map(Cow::Owned)),
        Some(UriTarget::File(file)) => ImageSource::File(file),
        None => ImageSource::Bytes(Err("it has neither bytes nor a name".into())),
    }
}

/// Returns true if an image cannot be decoded.
fn is_damaged(image: &Image, buffers: &Buffers, scene: &InputFolder) -> bool {
    let decoded = match find_image(image, buffers, scene) {
        ImageSource::Bytes(Ok(bytes)) => codec::decode(&bytes, None, codec::MAX_BYTES),
        ImageSource::Bytes(Err(_)) => return true,
        ImageSource::File(file) => match find_file(&file, scene.path(), scene) {
            Ok(found) => codec::read(&found.path, codec::MAX_BYTES),
            Err(_) => return true,
        },
    };
    decoded.is_err_and(|error| !error.is_over_budget())
}

fn request_texture(
    root: &Root,
    raw: &RawJson,
    buffers: &Buffers,
    info: &texture::Info,
    scene: &InputFolder,
    set: &mut TextureTable,
    notes: &mut Notes,
) -> Handle {
    let texture = info.index.value();
    let texture_use = TextureUse {
        role: Role::Color,
        sampler: sampler_of_texture(root, texture),
    };
    let index = image_of_texture(root, raw, texture, |image| {
        is_damaged(&root.images[image], buffers, scene)
    });
    let Some((index, image)) = index.and_then(|index| Some((index, root.images.get(index)?)))
    else {
        let cause = "it has no image in a known format";
        return set.embedded(
            &format!("texture {texture}"),
            Err(cause.into()),
            texture_use,
        );
    };
    let name = image.name.clone().unwrap_or_default();
    let name = format!(
        "image {index}{}{name}",
        if name.is_empty() { "" } else { " " }
    );
    match find_image(image, buffers, scene) {
        ImageSource::File(file) => set.file(&file, scene.path(), scene, texture_use, notes),
        ImageSource::Bytes(bytes) => {
            let bytes = bytes.as_deref().map_err(Clone::clone);
            set.embedded(&name, bytes, texture_use)
        }
    }
}

/// Converts a material; `None` if it is transparent. Also returns the opacity of vertices below
/// which it is invisible; `has_opacities` is true if some vertices are not opaque.
fn convert(
    m: &gltf::json::Material,
    name: String,
    [base, emissive]: [Option<Handle>; 2],
    has_opacities: bool,
    textures: &DecodedTextures,
) -> Option<(Material, f32)> {
    let slot = |handle: Option<Handle>| handle.and_then(|handle| textures.slot(handle));
    let (_, [r, g, b, alpha]) = base_color(m);
    let base_slot = slot(base);
    let threshold = threshold(m);
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
    let is_cut = |slot: &Slot| slot.is_cut_at(threshold) || has_opacities && slot.least_alpha < 255;
    let alpha_texture = base_slot.filter(is_cut).map(|slot| slot.index);
    let material = Material {
        name,
        albedo: [r, g, b].map(|c| finite(c).min(1.0)),
        albedo_texture: base_slot.map(|slot| slot.index),
        emission: emission.map(finite),
        emission_texture: emission_slot.map(|slot| slot.index),
        gloss: None,
        cutout: (alpha_texture.is_some() || has_opacities).then_some(Cutout {
            texture: alpha_texture,
            threshold,
        }),
        single_sided: !m.double_sided,
    };
    let least_opacity = if has_opacities {
        threshold / greatest_alpha
    } else {
        0.0
    };
    Some((material, least_opacity))
}

/// Returns the mappings of the base colour and of the emission; one without a texture has that of
/// the other.
fn map_textures(m: &gltf::json::Material) -> [Mapping; 2] {
    let base = base_color(m).0.map(texture_transform);
    let emission = m.emissive_texture.as_ref().map(texture_transform);
    let neutral = Mapping {
        texcoord_set: 0,
        image_from_vertex: Affine2::IDENTITY,
    };
    let base = base.or(emission).unwrap_or(neutral);
    [base, emission.unwrap_or(base)]
}

/// Returns the set of texture coordinates and the `KHR_texture_transform` of a texture: a scale, a
/// rotation (counter-clockwise with v downward), an offset.
fn texture_transform(info: &texture::Info) -> Mapping {
    match info
        .extensions
        .as_ref()
        .and_then(|extensions| extensions.texture_transform.as_ref())
    {
        None => Mapping {
            texcoord_set: info.tex_coord,
            image_from_vertex: Affine2::IDENTITY,
        },
        Some(t) => {
            let turn = Mat2::from_angle(-t.rotation.0) * Mat2::from_diagonal(Vec2::from(t.scale.0));
            Mapping {
                texcoord_set: t.tex_coord.unwrap_or(info.tex_coord),
                image_from_vertex: Affine2::from_mat2_translation(turn, t.offset.0.into()),
            }
        }
    }
}
