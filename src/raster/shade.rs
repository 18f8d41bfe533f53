//! Deferred shading: computes the colour of each pixel once, from its visible triangle.
//!
//! Triangles are shaded in the order in which they were drawn, so that the data of a triangle is
//! fetched once: the pixels of its bounding box that still show it are collected, and coloured
//! [`LANES`] at a time; only texels and sRGB levels are looked up one by one. A colour depends only
//! on triangle and pixel, not on bands or lanes.
//!
//! Shading each run of a row by itself would leave most lanes idle in rooms (docs/decisions/0025).

use super::mesh::{RasterMesh, Vertex};
use super::mip::MipTexture;
use super::scan::{DrawnRows, DrawnTriangle};
use super::view::LocalCamera;
use super::weights::{CornerWeights, Slopes, interpolate};
use super::{LANES, PixelContent, SurfaceId};
use fearless_simd::dispatch;
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, u32x16};
use glam::{Vec2, Vec3};
use headbox_core::camera::Camera;
use headbox_core::color::srgb_table::SrgbTable;
use headbox_core::environment::Environment;
use headbox_core::frame::Coverage;

/// Shading state of a frame.
pub(super) struct PixelShader<'a> {
    pub(super) mesh: &'a RasterMesh,
    pub(super) view: &'a LocalCamera,
    pub(super) camera: &'a Camera,
    pub(super) environment: &'a Environment,
    pub(super) exposure: f32,
    /// Table of the frame's tone curve.
    pub(super) table: &'static SrgbTable,
}

/// Pixels of a triangle that are shaded together.
struct Batch {
    count: usize,
    /// Column + 2^16 * row of each pixel; both sides of a frame are below 2^16. Arbitrary beyond
    /// `count`.
    pixels: [u32; LANES],
}

/// Shading state of a triangle.
struct Shading<'a> {
    corners: [&'a Vertex; 3],
    weights: CornerWeights,
    /// Exposed albedo, which vertex colours are multiplied by.
    albedo: Vec3,
    /// Exposed emission.
    emission: Vec3,
    albedo_texture: Option<(&'a MipTexture, Slopes)>,
    emission_texture: Option<(&'a MipTexture, Slopes)>,
    /// Texture coordinates of the emission texture if they differ from those of the corners.
    emission_texcoords: Option<[Vec2; 3]>,
}

impl PixelShader<'_> {
    /// Writes the colours and the coverage of all pixels of a target.
    pub(super) fn resolve(
        &self,
        target: &mut DrawnRows,
        colors: &mut [[u8; 4]],
        coverages: &mut [Coverage],
    ) {
        self.resolve_coplanar(target);
        dispatch!(self.view.level, simd => {
            self.fill_background(simd, target, colors, coverages);
            self.shade_triangles(simd, target, colors);
        });
    }

    /// Writes the coverage of all pixels, and the colours of those that show the environment.
    #[inline(always)]
    fn fill_background<S: Simd>(
        &self,
        simd: S,
        target: &mut DrawnRows,
        colors: &mut [[u8; 4]],
        coverages: &mut [Coverage],
    ) {
        let width = target.width as usize;
        let rows = colors
            .chunks_mut(width)
            .zip(coverages.chunks_mut(width))
            .zip(target.surface.chunks(width));
        for (y, ((colors, coverages), surfaces)) in target.rows.clone().zip(rows) {
            let chunks = colors
                .chunks_mut(LANES)
                .zip(coverages.chunks_mut(LANES))
                .zip(surfaces.chunks(LANES));
            for (x, ((colors, coverages), surfaces)) in (0u32..).step_by(LANES).zip(chunks) {
                if SurfaceId::are_triangles(simd, surfaces) {
                    coverages.fill(Coverage::FULL);
                    continue;
                }
                for (i, surface) in surfaces.iter().enumerate() {
                    match surface.content() {
                        PixelContent::Marker(_) => target.stats.marker_pixels += 1,
                        PixelContent::Triangle(_) => coverages[i] = Coverage::FULL,
                        PixelContent::Nothing => {
                            if let Some([r, g, b]) = self.sample_environment(x + i as u32, y) {
                                colors[i] = [r, g, b, 255];
                                coverages[i] = Coverage::ENVIRONMENT;
                            }
                        }
                    }
                }
            }
        }
    }

    fn sample_environment(&self, x: u32, y: u32) -> Option<[u8; 3]> {
        let [x, y] = [x, y].map(|pixel| f64::from(pixel) + 0.5);
        self.environment
            .sample(self.camera.direction(x, y).as_vec3())
    }

    /// Colours the pixels that show a triangle.
    #[inline(always)]
    fn shade_triangles<S: Simd>(&self, simd: S, target: &DrawnRows, colors: &mut [[u8; 4]]) {
        let mut batch = Batch {
            count: 0,
            pixels: [0; LANES],
        };
        for DrawnTriangle { id, columns, rows } in target.drawn.iter() {
            let PixelContent::Triangle(primitive) = id.content() else {
                continue;
            };
            let mut shading = None;
            for y in rows.clone() {
                let row = (y - target.rows.start) as usize * target.width as usize;
                for x in columns.clone().step_by(LANES) {
                    let mut shown =
                        id.shown_in(simd, target.surface, row + x as usize, columns.end - x);
                    while shown != 0 {
                        let x = x + shown.trailing_zeros();
                        shown &= shown - 1;
                        if batch.push(x | y << 16) {
                            let shading = shading.get_or_insert_with(|| self.shading(primitive));
                            self.shade(simd, shading, &mut batch, target, colors);
                        }
                    }
                }
            }
            if batch.count > 0 {
                let shading = shading.get_or_insert_with(|| self.shading(primitive));
                self.shade(simd, shading, &mut batch, target, colors);
            }
        }
    }

    #[inline(always)]
    fn shading(&self, primitive: u32) -> Shading<'_> {
        let triangle = &self.mesh.triangles[primitive as usize];
        let corners = self.mesh.corners(triangle);
        let surface = &self.mesh.materials[triangle.material as usize];
        let weights = CornerWeights::new(self.view, corners);
        let texcoords = corners.map(|corner| corner.texcoord);
        let emission_texcoords = self.mesh.emission_texcoords(primitive);
        let texture = |number: Option<u32>, texcoords: [Vec2; 3]| {
            let texture = self.mesh.textures.get(number? as usize)?;
            let size = Vec2::from(texture.size());
            Some((texture, weights.slopes(texcoords, size)))
        };
        Shading {
            corners,
            albedo: surface.albedo * self.exposure,
            emission: surface.emission.max(Vec3::ZERO) * self.exposure,
            albedo_texture: texture(surface.albedo_texture, texcoords),
            emission_texture: texture(
                surface.emission_texture,
                emission_texcoords.unwrap_or(texcoords),
            ),
            emission_texcoords,
            weights,
        }
    }

    /// Colours the pixels of a batch, and empties it.
    fn shade<S: Simd>(
        &self,
        simd: S,
        shading: &Shading,
        batch: &mut Batch,
        target: &DrawnRows,
        colors: &mut [[u8; 4]],
    ) {
        simd.vectorize(
            #[inline(always)]
            || self.shade_at(simd, shading, batch, target, colors),
        );
    }

    #[inline(always)]
    fn shade_at<S: Simd>(
        &self,
        simd: S,
        shading: &Shading,
        batch: &mut Batch,
        target: &DrawnRows,
        colors: &mut [[u8; 4]],
    ) {
        let [a, b, c] = shading.corners;
        let pixels = u32x16::load_array_ref(simd, &batch.pixels);
        let (x, y) = (pixels & 0xffff, pixels >> 16);
        let (weights, per) = shading
            .weights
            .evaluate_lanes(simd, &x.to_array(), &y.to_array());
        let white = [f32x16::splat(simd, 1.0); 3];
        let u = interpolate(weights, [a.texcoord.x, b.texcoord.x, c.texcoord.x]);
        let v = interpolate(weights, [a.texcoord.y, b.texcoord.y, c.texcoord.y]);
        let albedo = match &shading.albedo_texture {
            Some((texture, slopes)) => {
                texture.sample(simd, [u, v], slopes.footprint(u, v, per), batch.count)
            }
            None => white,
        };
        let (u, v) = match shading.emission_texcoords {
            Some(texcoords) => (
                interpolate(weights, texcoords.map(|t| t.x)),
                interpolate(weights, texcoords.map(|t| t.y)),
            ),
            None => (u, v),
        };
        let emission = match &shading.emission_texture {
            Some((texture, slopes)) => {
                texture.sample(simd, [u, v], slopes.footprint(u, v, per), batch.count)
            }
            None => white,
        };
        let mut color = u32x16::splat(simd, 0xff00_0000);
        for channel in 0..3 {
            let at_corners = [a.color[channel], b.color[channel], c.color[channel]];
            let lit = interpolate(weights, at_corners) * shading.albedo[channel] * albedo[channel];
            let exposed = lit.max(0.0) + emission[channel] * shading.emission[channel];
            let level = self.table.encode_sixteen(simd, exposed, batch.count);
            color |= level << (8 * channel as u32);
        }
        let (color, index) = (
            color.to_array(),
            ((y - target.rows.start) * target.width + x).to_array(),
        );
        for i in 0..batch.count.min(LANES) {
            colors[index[i] as usize] = color[i].to_le_bytes();
        }
        batch.count = 0;
    }
}

impl Batch {
    /// Adds a pixel; returns true if the batch is full.
    #[inline(always)]
    fn push(&mut self, pixel: u32) -> bool {
        self.pixels[self.count % LANES] = pixel;
        self.count = self.count % LANES + 1;
        self.count == LANES
    }
}
