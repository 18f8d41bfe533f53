//! From the triangle that a pixel shows to its colour, once per pixel.

use super::encode::SrgbTable;
use super::mesh::RasterMesh;
use super::scan::Target;
use super::view::View;
use super::{Seen, SurfaceId};
use crate::capture::{Camera, Material};
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
            let start = self.camera.direction(0.5, f64::from(y) + 0.5);
            let step = self.camera.direction(1.5, f64::from(y) + 0.5) - start;
            for (x, ((color, coverage), surface)) in colors.iter_mut().zip(coverages).zip(surfaces).enumerate() {
                match surface.seen() {
                    Seen::Marker(_) => {}
                    Seen::Triangle(_) => {
                        let linear = self.radiance(*surface, x as f32 + 0.5, y as f32 + 0.5) * self.exposure;
                        *color = [table.encode(linear.x), table.encode(linear.y), table.encode(linear.z), 255];
                        *coverage = Coverage::FULL;
                    }
                    Seen::Nothing => {
                        if let Some([r, g, b]) = self.environment.sample((start + step * x as f64).as_vec3()) {
                            (*color, *coverage) = ([r, g, b, 255], Coverage::ENVIRONMENT);
                        }
                    }
                }
            }
        }
    }

    /// Linear radiance of a triangle at a position of the frame.
    #[inline(always)]
    fn radiance(&self, SurfaceId(primitive): SurfaceId, x: f32, y: f32) -> Vec3 {
        let (mesh, scene) = (self.mesh, self.mesh.scene());
        let vertices = mesh.corners[primitive as usize];
        let [i, j, k] = vertices;
        let homogeneous = |vertex: u32| self.view.homogeneous(mesh.position(vertex));
        let corners = [homogeneous(i), homogeneous(j), homogeneous(k)];
        let weights = View::weights(corners, x, y);
        let [a, b, c] = [mesh.colors[i as usize], mesh.colors[j as usize], mesh.colors[k as usize]];
        let color = a * weights[0] + b * weights[1] + c * weights[2];
        let triangle = scene.triangles[primitive as usize];
        let material = &scene.materials[triangle.material as usize];
        let mut albedo = Vec3::from(material.albedo) * color;
        let mut emission = Vec3::from(material.emission);
        if material.albedo_texture.is_some() || material.emission_texture.is_some() {
            let [of_albedo, of_emission] = self.texels(material, triangle.vertices, corners, weights, [x, y]);
            (albedo, emission) = (albedo * of_albedo, emission * of_emission);
        }
        albedo.clamp(Vec3::ZERO, Vec3::ONE) + emission.max(Vec3::ZERO)
    }

    /// The factors of albedo and emission.
    #[inline(always)]
    fn texels(
        &self,
        material: &Material,
        vertices: [u32; 3],
        corners: [Vec3; 3],
        weights: [f32; 3],
        [x, y]: [f32; 2],
    ) -> [Vec3; 2] {
        let texcoord = |v: u32| self.mesh.scene().texcoords.get(v as usize).copied().unwrap_or(Vec2::ZERO);
        let texcoords = [texcoord(vertices[0]), texcoord(vertices[1]), texcoord(vertices[2])];
        let at =
            |weights: [f32; 3]| (texcoords[0] * weights[0] + texcoords[1] * weights[1]) + texcoords[2] * weights[2];
        let here = at(weights);
        let along_x = at(View::weights_around(corners, x + 1.0, y)) - here;
        let along_y = at(View::weights_around(corners, x, y + 1.0)) - here;
        let texel = |texture: Option<u32>| {
            let Some(texture) = texture.and_then(|texture| self.mesh.textures.get(texture as usize)) else {
                return Vec3::ONE;
            };
            let size = Vec2::from(texture.size());
            // Geometric mean of the footprint's sides: the longer one blurs what is seen at a grazing angle.
            let footprint = ((along_x * size).length_squared() * (along_y * size).length_squared()).sqrt().sqrt();
            Vec3::from(texture.sample(here.x, here.y, footprint))
        };
        [texel(material.albedo_texture), texel(material.emission_texture)]
    }
}
