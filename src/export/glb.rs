//! GLB files for engines: quadrilaterals with unlit textures, and the environment as a box around
//! them.

use super::ExportError;
use super::atlas::{AtlasPicture, PAGE_PX};
use super::mesh::TexturedQuads;
use crate::atlas;
use crate::mesh;
use crate::{sheets, surfels};
use glam::DVec3;
use headbox_core::cube_face::Face;
use headbox_core::headbox::Headbox;
use headbox_core::image_file::PictureError;
use headbox_cube::model::samples::CubeSamples;
use headbox_cube::pack::{CubeLdi, Split};
use headbox_cube::planes as primitives;
use headbox_scene::load::HEADBOX_HALF_SIZE;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::CompressionType;
use serde_json::{Value, json};
use std::io::Write;

/// Error, face pixels, of quadrilaterals where the budget holds them; else the least of those
/// errors that it holds, each so many times the one before.
const FIRST_ERROR_PX: f64 = 0.1;
const GROWTH: f64 = 1.1;
/// The last is 60 face pixels.
const ERRORS: i32 = 68;
/// Error, px, of the pictures on planes that are made of a capture without.
const PLANES_ERROR_PX: f64 = 1.0;
/// The least alpha that is drawn. Where two surfaces meet each has a rim that is half open; with
/// 0.5 the background shows between them.
const ALPHA_CUTOFF: f64 = 0.35;
/// JPEG quality of opaque textures.
const JPEG_QUALITY: u8 = 92;
/// PNG effort of textures with holes; the highest takes twice as long for 2 % fewer bytes.
const PNG_EFFORT: CompressionType = CompressionType::Default;

/// Summary of an exported capture.
#[derive(Clone, Copy, Debug)]
pub struct GlbSummary {
    /// Triangles in the file.
    pub triangles: u64,
    /// By how much a sample may be elsewhere, face pixels.
    pub error_px: f64,
    /// Samples left out because the budget does not hold them.
    pub dropped_samples: u64,
}

/// Writes a cube LDI with at most `budget` triangles, the environment's apart.
///
/// # Errors
/// [`ExportError`].
pub fn write(cube: &CubeLdi, budget: u64, to: &mut dyn Write) -> Result<GlbSummary, ExportError> {
    super::check_held(cube)?;
    let with_planes;
    let cube = if cube.planes.tiles.is_empty() && cube.depth_pixel_count() > 0 {
        let mut ldi: CubeSamples = cube.unpack();
        let planes = primitives::choose(&mut ldi, PLANES_ERROR_PX);
        with_planes = CubeLdi {
            planes,
            ..CubeLdi::pack(&ldi, cube.layout, Split::None)?
        };
        &with_planes
    } else {
        cube
    };
    let (mut charts, sheets) = (mesh::of_planes(cube), sheets::sheets(cube));
    let left = budget.saturating_sub(triangles(&charts));
    let (error_px, cut) = least_error(left, |error_px| mesh::of_sheets(cube, &sheets, error_px));
    charts.extend(cut);
    let dropped_samples = drop_smallest(&mut charts, budget);
    let mut file = File::default();
    file.charts(&charts)?;
    file.environment(cube)?;
    if file.primitives.is_empty() {
        return Err(ExportError::Empty);
    }
    file.write(
        Headbox {
            centre: cube.info.centre,
            half_size_m: cube.info.half_size_m,
        },
        to,
    )?;
    Ok(GlbSummary {
        triangles: triangles(&charts),
        error_px,
        dropped_samples,
    })
}

fn triangles(charts: &[TexturedQuads]) -> u64 {
    charts
        .iter()
        .map(|chart| 2 * chart.quads.len() as u64)
        .sum()
}

/// The least error, face pixels, that makes no more than `budget` triangles, or the largest; and
/// its charts.
fn least_error(
    budget: u64,
    charts: impl Fn(f64) -> Vec<TexturedQuads>,
) -> (f64, Vec<TexturedQuads>) {
    let of = |i: i32| FIRST_ERROR_PX * GROWTH.powi(i);
    let first = charts(of(0));
    if triangles(&first) <= budget {
        return (of(0), first);
    }
    // The first is too fine, and the last is taken if none is not.
    let (mut fine, mut found) = (0, (ERRORS - 1, None));
    while found.0 - fine > 1 {
        let middle = (fine + found.0) / 2;
        let made = charts(of(middle));
        match triangles(&made) <= budget {
            true => found = (middle, Some(made)),
            false => fine = middle,
        }
    }
    let (i, made) = found;
    (of(i), made.unwrap_or_else(|| charts(of(i))))
}

/// Leaves out what shows least, until the rest is within the budget; the number of samples that are
/// gone.
fn drop_smallest(charts: &mut Vec<TexturedQuads>, budget: u64) -> u64 {
    charts.sort_by_key(|chart| std::cmp::Reverse(chart.samples));
    let (mut sum, mut kept) = (0, 0);
    for chart in charts.iter() {
        sum += 2 * chart.quads.len() as u64;
        if sum > budget {
            break;
        }
        kept += 1;
    }
    charts
        .drain(kept..)
        .map(|chart| u64::from(chart.samples))
        .sum()
}

/// A file that grows.
#[derive(Default)]
struct File {
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
    /// 16 bits for 0 to 1.
    texcoords: Vec<[u16; 2]>,
}

/// Vertices of a primitive at most: as many as indices of two bytes tell apart, without the last,
/// which some take for a restart.
const MOST_VERTICES: usize = 65_532;

impl Mesh {
    /// Corners as of [`mesh::Quad`]; `texels` over the size of the texture.
    fn add(&mut self, corners: [DVec3; 4], texels: [[f64; 2]; 4]) {
        self.positions
            .extend(corners.map(|corner| corner.as_vec3().to_array()));
        self.texcoords
            .extend(texels.map(|at| at.map(|c| (c.clamp(0.0, 1.0) * 65_535.0).round() as u16)));
    }
}

impl File {
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
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

    fn accessor(&mut self, bytes: &[u8], element_array: bool, more: Value) -> usize {
        let view = self.view(bytes, Some(if element_array { 34963 } else { 34962 }));
        let mut accessor = more;
        accessor["bufferView"] = view.into();
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// A texture of a page or of a face, and a mesh with it.
    fn textured(&mut self, mesh: &Mesh, image: &[u8], mime: &str, mask: bool) {
        if mesh.positions.is_empty() {
            return;
        }
        let view = self.view(image, None);
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
            .chunks(MOST_VERTICES)
            .zip(mesh.texcoords.chunks(MOST_VERTICES));
        runs.for_each(|(positions, texcoords)| self.primitive(positions, texcoords));
    }

    /// Quadrilaterals of the last material.
    fn primitive(&mut self, positions: &[[f32; 3]], texcoords: &[[u16; 2]]) {
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
        let position = self.accessor(bytemuck::cast_slice(positions), false, position);
        let texcoord =
            json!({"componentType": 5123, "normalized": true, "count": count, "type": "VEC2"});
        let texcoord = self.accessor(bytemuck::cast_slice(texcoords), false, texcoord);
        let corners: Vec<u16> = (0..count as u16)
            .step_by(4)
            .flat_map(|first| [0, 2, 1, 1, 2, 3].map(|i| first + i))
            .collect();
        let indices = json!({"componentType": 5123, "count": corners.len(), "type": "SCALAR"});
        let indices = self.accessor(bytemuck::cast_slice(&corners), true, indices);
        self.primitives.push(json!({
            "attributes": {"POSITION": position, "TEXCOORD_0": texcoord}, "indices": indices, "material": self.materials.len() - 1,
        }));
    }

    /// Charts on pages: those that hide all behind them as JPEG, the others as PNG with a mask.
    fn charts(&mut self, charts: &[TexturedQuads]) -> Result<(), ExportError> {
        for opaque in [true, false] {
            let of_kind: Vec<&TexturedQuads> = charts
                .iter()
                .filter(|chart| chart.opaque == opaque)
                .collect();
            let pictures: Vec<&AtlasPicture> = of_kind.iter().map(|chart| &chart.picture).collect();
            let (places, pages) = atlas::pack(&pictures);
            let mut meshes: Vec<Mesh> = pages.iter().map(|_| Mesh::default()).collect();
            for (chart, place) in of_kind.iter().zip(&places) {
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
                    self.textured(mesh, &jpeg, "image/jpeg", false);
                } else {
                    let png = super::png(&page.texels, [width, height], PNG_EFFORT)?;
                    self.textured(mesh, &png, "image/png", true);
                }
            }
        }
        Ok(())
    }

    /// A box around everything, whose sides are the faces of the environment.
    fn environment(&mut self, cube: &CubeLdi) -> Result<(), ExportError> {
        let size = cube.environment.size_px;
        let per_face = size as usize * size as usize;
        let distance = surfels::sky(cube);
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
            // The middles of the outermost texels are the rim of the picture, or it would wrap
            // round.
            let inset = |c: f64| c.clamp(0.5, side - 0.5) / side;
            mesh.add(
                corners.map(|[x, y]| face.direction(x, y, size) * distance),
                corners.map(|[x, y]| [inset(x), inset(y)]),
            );
            let png = super::png(texels, [size, size], PNG_EFFORT)?;
            self.textured(
                &mesh,
                &png,
                "image/png",
                texels.iter().any(|texel| texel[3] == 0),
            );
        }
        Ok(())
    }

    fn write(mut self, headbox: Headbox, to: &mut dyn Write) -> Result<(), ExportError> {
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
        let mut json = all.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + json.len() as u64 + 8 + self.bytes.len() as u64;
        let length = u32::try_from(total).map_err(|_| ExportError::TooLarge {
            bytes: total,
            limit: u64::from(u32::MAX),
        })?;
        to.write_all(b"glTF")?;
        for word in [2, length, json.len() as u32] {
            to.write_all(&word.to_le_bytes())?;
        }
        to.write_all(b"JSON")?;
        to.write_all(&json)?;
        to.write_all(&(self.bytes.len() as u32).to_le_bytes())?;
        to.write_all(b"BIN\0")?;
        Ok(to.write_all(&self.bytes)?)
    }
}
