//! From the triangle that a pixel shows to its colour, once per pixel.
//!
//! Rows are cut into runs of pixels of one triangle: what holds for the whole triangle is fetched once, and along the run its
//! weights are linear.

use super::encode::SrgbTable;
use super::mesh::{RasterMesh, Surface, Vertex};
use super::mip::Level;
use super::scan::Target;
use super::view::{View, Weights};
use super::{Seen, SurfaceId};
use crate::capture::Camera;
use crate::frame::Coverage;
use crate::ldi::Environment;
use fearless_simd::{Simd, dispatch};
use glam::{Vec2, Vec3};

/// What the colours of a frame need.
pub(super) struct Shader<'a> {
    pub(super) mesh: &'a RasterMesh,
    pub(super) view: &'a View,
    pub(super) camera: &'a Camera,
    pub(super) environment: &'a Environment,
    pub(super) exposure: f32,
}

impl Shader<'_> {
    /// Colours the rows of a target.
    pub(super) fn resolve(&self, target: &mut Target, colors: &mut [[u8; 4]], coverages: &mut [Coverage]) {
        target.count_markers();
        dispatch!(self.view.level, simd => self.resolve_at(simd, target, colors, coverages));
    }

    /// Plain code; inside the dispatch the compiler may use the instructions of the SIMD level.
    #[inline(always)]
    fn resolve_at<S: Simd>(&self, _: S, target: &Target, colors: &mut [[u8; 4]], coverages: &mut [Coverage]) {
        let width = target.width as usize;
        let table = SrgbTable::get();
        let rows = colors.chunks_mut(width).zip(coverages.chunks_mut(width)).zip(target.surface.chunks(width));
        for (y, ((colors, coverages), surfaces)) in target.rows.clone().zip(rows) {
            let mut start = 0;
            for run in surfaces.chunk_by(|a, b| a == b) {
                let pixels = start..start + run.len();
                let (colors, coverages) = (&mut colors[pixels.clone()], &mut coverages[pixels]);
                match run[0].seen() {
                    Seen::Marker(_) => {}
                    Seen::Triangle(_) => {
                        self.shade_run(run[0], start as u32, y, table, colors);
                        coverages.fill(Coverage::FULL);
                    }
                    Seen::Nothing => self.environment_run(start as u32, y, colors, coverages),
                }
                start += run.len();
            }
        }
    }

    fn environment_run(&self, x: u32, y: u32, colors: &mut [[u8; 4]], coverages: &mut [Coverage]) {
        let start = self.camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let step = self.camera.direction(f64::from(x) + 1.5, f64::from(y) + 0.5) - start;
        for (k, (color, coverage)) in (0u32..).zip(colors.iter_mut().zip(coverages)) {
            if let Some([r, g, b]) = self.environment.sample((start + step * f64::from(k)).as_vec3()) {
                (*color, *coverage) = ([r, g, b, 255], Coverage::ENVIRONMENT);
            }
        }
    }

    /// Colours a run of pixels of one triangle.
    #[inline(always)]
    fn shade_run(&self, SurfaceId(primitive): SurfaceId, x: u32, y: u32, table: &SrgbTable, colors: &mut [[u8; 4]]) {
        let face = &self.mesh.faces[primitive as usize];
        let corners = self.mesh.corners(face);
        let surface = &self.mesh.surfaces[face.material as usize];
        let weights = self.view.weights(corners, x as f32 + 0.5, y as f32 + 0.5);
        let of_corners = [corners[0].color, corners[1].color, corners[2].color];
        let (albedo, emission) = (surface.albedo * self.exposure, surface.emission.max(Vec3::ZERO) * self.exposure);
        let most = Vec3::splat(self.exposure);
        let encode = |c: Vec3| [table.encode(c.x), table.encode(c.y), table.encode(c.z), 255];
        let plain = |w: Vec3| of_corners[0] * w.x + of_corners[1] * w.y + of_corners[2] * w.z;
        let Some(texels) = self.texels(surface, corners, &weights) else {
            for (k, color) in (0u32..).zip(colors) {
                let lit = albedo * plain(weights.at(k as f32));
                *color = encode(lit.clamp(Vec3::ZERO, most) + emission);
            }
            return;
        };
        for (k, color) in (0u32..).zip(colors) {
            let w = weights.at(k as f32);
            let at = texels.texcoords[0] * w.x + texels.texcoords[1] * w.y + texels.texcoords[2] * w.z;
            let of = |level: Option<&Level>| level.map_or(Vec3::ONE, |level| Vec3::from(level.sample(at.x, at.y)));
            let lit = albedo * plain(w) * of(texels.albedo);
            *color = encode(lit.clamp(Vec3::ZERO, most) + emission * of(texels.emission));
        }
    }

    /// The textures of a triangle at the fineness that suits the start of a run; `None` if it has none.
    #[inline(always)]
    fn texels(&self, surface: &Surface, corners: [&Vertex; 3], weights: &Weights) -> Option<Texels<'_>> {
        if surface.albedo_texture.is_none() && surface.emission_texture.is_none() {
            return None;
        }
        let texcoords = [corners[0].texcoord, corners[1].texcoord, corners[2].texcoord];
        let [along_x, along_y] = weights.derivatives(texcoords);
        let level = |texture: Option<u32>| {
            let texture = self.mesh.textures.get(texture? as usize)?;
            let size = Vec2::from(texture.size());
            // Geometric mean of the footprint's sides: the longer one blurs what is seen at a grazing angle.
            let footprint = ((along_x * size).length_squared() * (along_y * size).length_squared()).sqrt().sqrt();
            Some(texture.level(footprint))
        };
        Some(Texels { texcoords, albedo: level(surface.albedo_texture), emission: level(surface.emission_texture) })
    }
}

/// The textures of a run.
struct Texels<'a> {
    /// Of the corners.
    texcoords: [Vec2; 3],
    albedo: Option<&'a Level>,
    emission: Option<&'a Level>,
}
