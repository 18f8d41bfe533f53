//! From the triangle that a pixel shows to its colour, once per pixel.
//!
//! Rows are cut into runs of pixels of one triangle: what holds for the whole triangle is fetched once, and along the run its
//! weights are linear, so that sixteen pixels are coloured at once; only texels and sRGB levels are looked up one by one.

use super::encode::SrgbTable;
use super::mesh::{RasterMesh, Surface, Vertex};
use super::mip::Level;
use super::scan::Target;
use super::view::{LANES, Lane, View, Weights};
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

    /// Plain code; inside the dispatch the compiler may use the instructions of the SIMD level. Loops here and in what is called
    /// are written out: the body of a `map` may stay in a function of the standard library, which is compiled for no level.
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
        let most = Vec3::splat(self.exposure);
        let (albedo, emission) = (surface.albedo * self.exposure, surface.emission.max(Vec3::ZERO) * self.exposure);
        let texels = self.texels(surface, corners, &weights);
        for (colors, first) in colors.chunks_mut(LANES).zip((0u32..).step_by(LANES)) {
            let weights = weights.lanes(first as f32);
            let [a, b, c] = corners;
            let mut lit = [[0.0; LANES]; 3];
            for (channel, lit) in lit.iter_mut().enumerate() {
                *lit = mixed(&weights, [a.color[channel], b.color[channel], c.color[channel]]);
                for lit in lit {
                    *lit *= albedo[channel];
                }
            }
            let mut glow = [[emission.x; LANES], [emission.y; LANES], [emission.z; LANES]];
            if let Some(texels) = &texels {
                let u = mixed(&weights, [a.texcoord.x, b.texcoord.x, c.texcoord.x]);
                let v = mixed(&weights, [a.texcoord.y, b.texcoord.y, c.texcoord.y]);
                for (level, channels) in [(texels.albedo, &mut lit), (texels.emission, &mut glow)] {
                    if let Some(level) = level {
                        level.multiply(&u, &v, colors.len(), channels);
                    }
                }
            }
            for (lit, (glow, most)) in lit.iter_mut().zip(glow.iter().zip(most.to_array())) {
                for (lit, glow) in lit.iter_mut().zip(glow) {
                    *lit = lit.max(0.0).min(most) + glow;
                }
            }
            let [r, g, b] = &lit;
            for (color, ((r, g), b)) in colors.iter_mut().zip(r.iter().zip(g).zip(b)) {
                *color = [table.encode(*r), table.encode(*g), table.encode(*b), 255];
            }
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
        Some(Texels { albedo: level(surface.albedo_texture), emission: level(surface.emission_texture) })
    }
}

/// What has the given values at the corners, at each lane.
#[inline(always)]
fn mixed([a, b, c]: &[Lane; 3], [at_a, at_b, at_c]: [f32; 3]) -> Lane {
    let mut mixed = [0.0; LANES];
    for (i, mixed) in mixed.iter_mut().enumerate() {
        *mixed = (at_a * a[i] + at_b * b[i]) + at_c * c[i];
    }
    mixed
}

/// The textures of a run.
struct Texels<'a> {
    albedo: Option<&'a Level>,
    emission: Option<&'a Level>,
}
