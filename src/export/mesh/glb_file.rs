//! GLB files under construction: meshes, textures on atlas pages, and the environment.

use crate::ExportError;
use crate::mesh::TexturedQuads;
use crate::mesh::atlas::{self, AtlasPicture, PAGE_PX};
use crate::points::surfels;
use glam::DVec3;
use headbox_core::cube_face::Face;
use headbox_core::headbox::Headbox;
use headbox_core::image::codec::PictureError;
use headbox_cube::pack::CubeLdi;
use headbox_scene::load::HEADBOX_HALF_SIZE;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::CompressionType;
use serde_json::{Value, json};
use std::borrow::Cow;

/// Alpha below which texels are not drawn. Where two surfaces meet, each has a half-transparent
/// rim; with 0.5 the background would show between them.
const ALPHA_CUTOFF: f64 = 0.35;
/// JPEG quality of opaque textures.
const JPEG_QUALITY: u8 = 92;
/// PNG effort of textures with holes; the highest takes twice as long for 2 % fewer bytes.
const PNG_EFFORT: CompressionType = CompressionType::Default;

/// GLB file under construction.
#[derive(Default)]
pub(super) struct File {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    images: Vec<Value>,
    materials: Vec<Value>,
    primitives: Vec<Value>,
}

/// Quadrilaterals of one material, four vertices each.
#[derive(Default)]
struct Mesh {
    positions: Vec<[f32; 3]>,
    /// Normalised to 16 bits.
    texcoords: Vec<[u16; 2]>,
}

/// Maximum number of vertices of a primitive: two-byte indices without the last one, which some
/// readers take for primitive restart.
const MAX_VERTICES: usize = 65_532;

impl Mesh {
    /// Adds a quadrilateral: corners in the order of [`mesh::Quad`], texture coordinates 0 to 1.
    fn add(&mut self, corners: [DVec3; 4], texels: [[f64; 2]; 4]) {
        self.positions
            .extend(corners.map(|corner| corner.as_vec3().to_array()));
        self.texcoords
            .extend(texels.map(|at| at.map(|c| (c.clamp(0.0, 1.0) * 65_535.0).round() as u16)));
    }
}

impl File {
    /// Returns true if nothing is in the file.
    pub(super) fn is_empty(&self) -> bool {
        self.primitives.is_empty()
    }

    fn add_view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut view =
            json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.views.push(view);
        self.bytes.extend_from_slice(bytes);
        self.views.len() - 1
    }

    fn add_accessor(&mut self, bytes: &[u8], element_array: bool, more: Value) -> usize {
        let view = self.add_view(bytes, Some(if element_array { 34963 } else { 34962 }));
        let mut accessor = more;
        accessor["bufferView"] = view.into();
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Adds a texture, a material and the primitives of its mesh.
    fn add_textured(&mut self, mesh: &Mesh, image: &[u8], mime: &str, mask: bool) {
        if mesh.positions.is_empty() {
            return;
        }
        let view = self.add_view(image, None);
        self.images
            .push(json!({"bufferView": view, "mimeType": mime}));
        let mut material = json!({
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": self.images.len() - 1}, "metallicFactor": 0.0, "roughnessFactor": 1.0,
            },
            "doubleSided": true,
            "extensions": {"KHR_materials_unlit": {}},
        });
        if mask {
            (material["alphaMode"], material["alphaCutoff"]) = ("MASK".into(), ALPHA_CUTOFF.into());
        }
        self.materials.push(material);
        let runs = mesh
            .positions
            .chunks(MAX_VERTICES)
            .zip(mesh.texcoords.chunks(MAX_VERTICES));
        runs.for_each(|(positions, texcoords)| self.add_primitive(positions, texcoords));
    }

    /// Adds a primitive of quadrilaterals with the last material.
    fn add_primitive(&mut self, positions: &[[f32; 3]], texcoords: &[[u16; 2]]) {
        let bound = |pick: fn(f32, f32) -> f32| {
            positions
                .iter()
                .copied()
                .reduce(|a, b| [0, 1, 2].map(|i| pick(a[i], b[i])))
                .unwrap_or_default()
        };
        let count = positions.len();
        let position = json!({
            "componentType": 5126, "count": count, "type": "VEC3", "min": bound(f32::min), "max": bound(f32::max),
        });
        let position = self.add_accessor(bytemuck::cast_slice(positions), false, position);
        let texcoord =
            json!({"componentType": 5123, "normalized": true, "count": count, "type": "VEC2"});
        let texcoord = self.add_accessor(bytemuck::cast_slice(texcoords), false, texcoord);
        let corners: Vec<u16> = (0..count as u16)
            .step_by(4)
            .flat_map(|first| [0, 2, 1, 1, 2, 3].map(|i| first + i))
            .collect();
        let indices = json!({"componentType": 5123, "count": corners.len(), "type": "SCALAR"});
        let indices = self.add_accessor(bytemuck::cast_slice(&corners), true, indices);
        self.primitives.push(json!({
            "attributes": {"POSITION": position, "TEXCOORD_0": texcoord}, "indices": indices, "material": self.materials.len() - 1,
        }));
    }

    /// Adds charts on atlas pages: opaque ones as JPEG, the others as PNG with an alpha mask.
    pub(super) fn add_charts(&mut self, charts: &[TexturedQuads]) -> Result<(), ExportError> {
        for opaque in [true, false] {
            let group: Vec<&TexturedQuads> = charts
                .iter()
                .filter(|chart| chart.opaque == opaque)
                .collect();
            let pictures: Vec<&AtlasPicture> = group.iter().map(|chart| &chart.picture).collect();
            let (places, pages) = atlas::pack(&pictures);
            let mut meshes: Vec<Mesh> = pages.iter().map(|_| Mesh::default()).collect();
            for (chart, place) in group.iter().zip(&places) {
                let size = [PAGE_PX as f64, pages[place.page].height as f64];
                let corner = [place.x as f64, place.y as f64];
                for quad in &chart.quads {
                    let texels = quad
                        .texels
                        .map(|at| [0, 1].map(|i| (corner[i] + at[i]) / size[i]));
                    meshes[place.page].add(quad.corners, texels);
                }
            }
            for (page, mesh) in pages.iter().zip(&meshes) {
                let (width, height) = (PAGE_PX as u32, page.height as u32);
                if opaque {
                    let rgb: Vec<u8> = page
                        .texels
                        .iter()
                        .flat_map(|[r, g, b, _]| [*r, *g, *b])
                        .collect();
                    let mut jpeg = Vec::new();
                    let mut encoder = JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY);
                    encoder
                        .encode(&rgb, width, height, ExtendedColorType::Rgb8)
                        .map_err(PictureError::from)?;
                    self.add_textured(mesh, &jpeg, "image/jpeg", false);
                } else {
                    let png = crate::png(&page.texels, [width, height], PNG_EFFORT)?;
                    self.add_textured(mesh, &png, "image/png", true);
                }
            }
        }
        Ok(())
    }

    /// Adds a box around everything with the faces of the environment.
    pub(super) fn add_environment(
        &mut self,
        cube: &CubeLdi,
        texel_px: f64,
    ) -> Result<(), ExportError> {
        let size = cube.environment.size_px;
        let per_face = size as usize * size as usize;
        let distance = surfels::environment_distance(cube);
        for (face, texels) in Face::ALL
            .into_iter()
            .zip(cube.environment.texels.chunks_exact(per_face.max(1)))
        {
            if texels.iter().all(|texel| texel[3] == 0) {
                continue;
            }
            let side = f64::from(size);
            let corners = [[0.0, 0.0], [side, 0.0], [0.0, side], [side, side]];
            let mut mesh = Mesh::default();
            let (texels, size_px) = coarser(texels, size, texel_px);
            // Texture coordinates end at the centres of the outermost texels, else the texture
            // would wrap.
            let half = 0.5 / f64::from(size_px);
            let inset = |c: f64| (c / side).clamp(half, 1.0 - half);
            mesh.add(
                corners.map(|[x, y]| face.direction(x, y, size) * distance),
                corners.map(|[x, y]| [inset(x), inset(y)]),
            );
            let png = crate::png(&texels, [size_px, size_px], PNG_EFFORT)?;
            self.add_textured(
                &mesh,
                &png,
                "image/png",
                texels.iter().any(|texel| texel[3] == 0),
            );
        }
        Ok(())
    }

    pub(super) fn into_bytes(mut self, headbox: Headbox) -> Result<Vec<u8>, ExportError> {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let textures: Vec<Value> = (0..self.images.len())
            .map(|i| json!({"source": i, "sampler": 0}))
            .collect();
        let all = json!({
            "asset": {"version": "2.0", "generator": "headbox"},
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{
                "name": "headbox", "mesh": 0, "translation": headbox.centre.to_array(),
                "extras": {HEADBOX_HALF_SIZE: headbox.half_size_m},
            }],
            "meshes": [{"primitives": self.primitives}],
            "materials": self.materials, "textures": textures, "images": self.images,
            "samplers": [{"magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071}],
            "accessors": self.accessors, "bufferViews": self.views,
            "buffers": [{"byteLength": self.bytes.len()}],
        });
        let mut file = glb_header(&all, self.bytes.len() as u64)?;
        file.extend_from_slice(&self.bytes);
        Ok(file)
    }
}

/// Returns the bytes of a GLB before its binary data of `binary_bytes`, a multiple of four.
///
/// # Errors
/// [`ExportError::TooLarge`] if the file would have more than 4 GiB.
pub(crate) fn glb_header(json: &Value, binary_bytes: u64) -> Result<Vec<u8>, ExportError> {
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() as u64 + 8 + binary_bytes;
    let length = u32::try_from(total).map_err(|_| ExportError::TooLarge {
        bytes: total,
        limit: u64::from(u32::MAX),
    })?;
    let mut file = Vec::with_capacity(json.len() + 28);
    file.extend_from_slice(b"glTF");
    for word in [2, length, json.len() as u32] {
        file.extend_from_slice(&word.to_le_bytes());
    }
    file.extend_from_slice(b"JSON");
    file.extend_from_slice(&json);
    file.extend_from_slice(&(binary_bytes as u32).to_le_bytes());
    file.extend_from_slice(b"BIN\0");
    Ok(file)
}

/// Returns the texels of a face of the environment with about 1 / `scale` of the width, and their
/// width.
fn coarser(texels: &[[u8; 4]], size_px: u32, scale: f64) -> (Cow<'_, [[u8; 4]]>, u32) {
    let coarse_px = ((f64::from(size_px) / scale).ceil() as u32).max(1);
    if coarse_px >= size_px {
        return (Cow::Borrowed(texels), size_px);
    }
    let sums = (0..coarse_px * coarse_px).map(|i| {
        let range = |at: u32| at * size_px / coarse_px..((at + 1) * size_px).div_ceil(coarse_px);
        let (columns, rows) = (range(i % coarse_px), range(i / coarse_px));
        let inside = rows.flat_map(|y| columns.clone().map(move |x| (y * size_px + x) as usize));
        let known: Vec<[u8; 4]> = inside
            .map(|at| texels[at])
            .filter(|texel| texel[3] > 0)
            .collect();
        let mean = |channel: usize| {
            let sum: usize = known.iter().map(|texel| usize::from(texel[channel])).sum();
            (sum / known.len().max(1)) as u8
        };
        [0, 1, 2, 3].map(mean)
    });
    (Cow::Owned(sums.collect()), coarse_px)
}
