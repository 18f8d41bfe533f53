//! GLB: one node, one mesh, one primitive per material.
//!
//! Positions are `f32` relative to the middle of the scene, which is the node's translation, so
//! that they keep their precision far from the origin. The JSON is built without the types of the
//! `gltf` crate, which store a translation in `f32`.

use super::{SaveError, by_material, png, unique_names};
use crate::material::{Material, Sampler, Texture, Wrap};
use crate::scene::Scene;
use gltf::binary::{Glb, Header};
use headbox_core::color::srgb8_from_linear;
use serde_json::{Value, json};
use std::borrow::Cow;
use std::collections::HashMap;

const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;

pub(super) fn bytes(scene: &Scene) -> Result<Vec<u8>, SaveError> {
    let mut file = GlbBuilder::default();
    let [low, high] = scene.bounds();
    let middle = (low + high) / 2.0;
    let mut primitives = Vec::new();
    for (number, triangles) in by_material(scene)
        .into_iter()
        .enumerate()
        .filter(|(_, triangles)| !triangles.is_empty())
    {
        primitives.push(file.primitive(scene, middle, &triangles, number));
    }
    for (material, name) in scene.materials.iter().zip(unique_names(&scene.materials)) {
        let written = file.material(scene, material, &name)?;
        file.materials.push(written);
    }
    let extensions: &[&str] = if scene.materials.iter().any(is_bright) {
        &[STRENGTH]
    } else {
        &[]
    };
    let all = json!({
        "asset": {"version": "2.0", "generator": "headbox"},
        "extensionsUsed": extensions,
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": scene.name, "mesh": 0, "translation": middle.to_array()}],
        "meshes": [{"primitives": primitives}],
        "materials": file.materials, "textures": file.textures, "images": file.images,
        "samplers": file.samplers,
        "accessors": file.accessors, "bufferViews": file.views,
        "buffers": [{"byteLength": file.bytes.len()}],
    });
    // The format does not allow empty lists.
    let present = all
        .as_object()
        .into_iter()
        .flatten()
        .filter(|(_, v)| v.as_array().is_none_or(|list| !list.is_empty()));
    let present: serde_json::Map<String, Value> =
        present.map(|(k, v)| (k.clone(), v.clone())).collect();
    let json = Value::Object(present).to_string().into_bytes();
    let total = json.len() + file.bytes.len() + 40;
    let length = u32::try_from(total).map_err(|_| SaveError::TooLarge(total))?;
    let header = Header {
        magic: *b"glTF",
        version: 2,
        length,
    };
    let glb = Glb {
        header,
        json: Cow::Owned(json),
        bin: Some(Cow::Owned(file.bytes)),
    };
    glb.to_vec()
        .map_err(|cause| SaveError::Glb(cause.to_string()))
}

/// Attribute of the texture coordinates of emission textures.
const EMISSION_TEXCOORDS: &str = "TEXCOORD_1";

const STRENGTH: &str = "KHR_materials_emissive_strength";

/// Returns true if a material emits more than the format's own factor, at most 1, can express.
fn is_bright(material: &Material) -> bool {
    material.emission.iter().any(|&c| c > 1.0)
}

/// Content of a GLB under construction.
#[derive(Default)]
struct GlbBuilder {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    materials: Vec<Value>,
    textures: Vec<Value>,
    images: Vec<Value>,
    samplers: Vec<Value>,
    /// Indices of the written textures by the scene's textures for colour and for opacity.
    written: HashMap<[Option<u32>; 2], usize>,
}

impl GlbBuilder {
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views
            .push(json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()}));
        self.bytes.extend_from_slice(bytes);
        self.views.len() - 1
    }

    fn accessor(&mut self, bytes: &[u8], count: usize, kind: &str, component: u32) -> usize {
        let view = self.view(bytes);
        self.accessors.push(
            json!({"bufferView": view, "componentType": component, "count": count, "type": kind}),
        );
        self.accessors.len() - 1
    }

    fn vectors<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values
            .as_flattened()
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        self.accessor(
            &bytes,
            values.len(),
            ["SCALAR", "VEC2", "VEC3", "VEC4"][N - 1],
            FLOAT,
        )
    }

    /// Adds the triangles of a material with the vertices that they use. Returns the primitive.
    fn primitive(
        &mut self,
        scene: &Scene,
        middle: glam::DVec3,
        triangles: &[[u32; 3]],
        material: usize,
    ) -> Value {
        let mut own = HashMap::new();
        let mut used = Vec::new();
        let mut indices = Vec::with_capacity(4 * 3 * triangles.len());
        for &vertex in triangles.as_flattened() {
            let number = *own.entry(vertex).or_insert_with(|| {
                used.push(vertex as usize);
                used.len() as u32 - 1
            });
            indices.extend(number.to_le_bytes());
        }
        let positions: Vec<[f32; 3]> = used
            .iter()
            .map(|&v| (scene.positions[v] - middle).as_vec3().to_array())
            .collect();
        let bound = |pick: fn(f32, f32) -> f32| {
            positions
                .iter()
                .copied()
                .reduce(|a, b| [0, 1, 2].map(|c| pick(a[c], b[c])))
        };
        let bounds = [bound(f32::min), bound(f32::max)];
        let position = self.vectors(&positions);
        (
            self.accessors[position]["min"],
            self.accessors[position]["max"],
        ) = (json!(bounds[0]), json!(bounds[1]));
        let mut attributes = json!({"POSITION": position});
        if !scene.normals.is_empty() {
            let normals: Vec<[f32; 3]> =
                used.iter().map(|&v| scene.normals[v].to_array()).collect();
            attributes["NORMAL"] = json!(self.vectors(&normals));
        }
        let sets = [
            ("TEXCOORD_0", &scene.texcoords),
            (EMISSION_TEXCOORDS, &scene.emission_texcoords),
        ];
        for (name, texcoords) in sets.into_iter().filter(|(_, set)| !set.is_empty()) {
            // The format's v points down.
            let texcoords: Vec<[f32; 2]> = used
                .iter()
                .map(|&v| [texcoords[v].x, 1.0 - texcoords[v].y])
                .collect();
            attributes[name] = json!(self.vectors(&texcoords));
        }
        if !scene.opacities.is_empty() {
            let color = |v: usize| scene.colors.get(v).copied().unwrap_or(glam::Vec3::ONE);
            let colors: Vec<[f32; 4]> = used
                .iter()
                .map(|&v| color(v).extend(scene.opacities[v]).to_array())
                .collect();
            attributes["COLOR_0"] = json!(self.vectors(&colors));
        } else if !scene.colors.is_empty() {
            let colors: Vec<[f32; 3]> = used.iter().map(|&v| scene.colors[v].to_array()).collect();
            attributes["COLOR_0"] = json!(self.vectors(&colors));
        }
        let indices = self.accessor(&indices, 3 * triangles.len(), "SCALAR", UNSIGNED_INT);
        json!({"attributes": attributes, "indices": indices, "material": material})
    }

    fn material(
        &mut self,
        scene: &Scene,
        material: &Material,
        name: &str,
    ) -> Result<Value, SaveError> {
        let [r, g, b] = material.albedo;
        let mut base = json!({"baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0});
        let cutout = material.cutout.and_then(|cutout| cutout.texture);
        if material.albedo_texture.is_some() || cutout.is_some() {
            base["baseColorTexture"] =
                json!({"index": self.texture(scene, [material.albedo_texture, cutout])?});
        }
        let strength = material.emission.iter().copied().fold(1.0, f32::max);
        let mut written = json!({
            "name": name, "pbrMetallicRoughness": base, "doubleSided": !material.single_sided,
            "emissiveFactor": material.emission.map(|c| c / strength),
        });
        if is_bright(material) {
            written["extensions"] = json!({STRENGTH: {"emissiveStrength": strength}});
        }
        if let Some(texture) = material.emission_texture {
            written["emissiveTexture"] =
                json!({"index": self.texture(scene, [Some(texture), None])?});
            if !scene.emission_texcoords.is_empty() {
                written["emissiveTexture"]["texCoord"] = json!(1);
            }
        }
        if let Some(cutout) = material.cutout {
            (written["alphaMode"], written["alphaCutoff"]) =
                (json!("MASK"), json!(cutout.threshold));
        }
        Ok(written)
    }

    /// Returns the index of a sampler; `None` for the default one, which textures without a sampler
    /// have.
    fn sampler(&mut self, sampler: Sampler) -> Option<usize> {
        if sampler == Sampler::default() {
            return None;
        }
        let [s, t] = sampler.wrap.map(|wrap| match wrap {
            Wrap::Repeat => 10_497,
            Wrap::Mirror => 33_648,
            Wrap::Clamp => 33_071,
        });
        let mag_filter = if sampler.nearest { 9728 } else { 9729 };
        let written = json!({"wrapS": s, "wrapT": t, "magFilter": mag_filter});
        let known = self.samplers.iter().position(|known| *known == written);
        Some(known.unwrap_or_else(|| {
            self.samplers.push(written);
            self.samplers.len() - 1
        }))
    }

    /// Returns the index of a texture that combines the colour of one of the scene's textures with
    /// the alpha of another. Without the former it is white; without the latter it keeps its own
    /// alpha.
    fn texture(
        &mut self,
        scene: &Scene,
        [color, opacity]: [Option<u32>; 2],
    ) -> Result<usize, SaveError> {
        let key = [color, opacity.filter(|_| color != opacity)];
        if let Some(&known) = self.written.get(&key) {
            return Ok(known);
        }
        let texture = |index: u32| &scene.textures[index as usize];
        let combined = match key {
            [Some(color), None] => texture(color).clone(),
            [None, opacity] => {
                let opacity = texture(opacity.unwrap_or(0));
                Texture::from_fn(opacity.width(), opacity.height(), |x, y| {
                    let texel = opacity.texels()[(y * opacity.width() + x) as usize];
                    [255, 255, 255, texel[3]]
                })
                .with_sampler(opacity.sampler())
            }
            [Some(color), Some(opacity)] => with_opacity(texture(color), texture(opacity)),
        };
        let bytes = png(color.or(opacity).unwrap_or(0) as usize, &combined)?;
        let view = self.view(&bytes);
        self.images
            .push(json!({"bufferView": view, "mimeType": "image/png"}));
        let mut written = json!({"source": self.images.len() - 1});
        if let Some(sampler) = self.sampler(combined.sampler()) {
            written["sampler"] = json!(sampler);
        }
        self.textures.push(written);
        self.written.insert(key, self.textures.len() - 1);
        Ok(self.textures.len() - 1)
    }
}

/// Combines the colour and the sampler of a texture with the alpha of another at the larger
/// resolution of the two. Texels are unchanged if the sizes are equal.
fn with_opacity(color: &Texture, opacity: &Texture) -> Texture {
    let (width, height) = (
        color.width().max(opacity.width()),
        color.height().max(opacity.height()),
    );
    Texture::from_fn(width, height, |x, y| {
        let [u, v] = [
            (x as f32 + 0.5) / width as f32,
            1.0 - (y as f32 + 0.5) / height as f32,
        ];
        let [r, g, b, _] = color.sample(u, v);
        let [r, g, b] = [r, g, b].map(srgb8_from_linear);
        [r, g, b, (opacity.sample(u, v)[3] * 255.0 + 0.5) as u8]
    })
    .with_sampler(color.sampler())
}
