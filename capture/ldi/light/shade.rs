//! Surface samples, which receive light: one from each accumulator.
//!
//! Light is sampled `K` times per depth pixel, after tracing. The alternative is one light sample
//! per ray. A depth pixel is hit by one to hundreds of rays, so light per ray spends most samples
//! where they are least needed, and leaves depth pixels that few rays reach (the disoccluded ones,
//! and all of them once novelty stopping saves rays) with a single noisy sample. Light per depth
//! pixel gives each the same error, and can be pooled over a surface ([`super::pool`]).
//!
//! Albedo is averaged over all rays, and, where a triangle has a texture, over a grid of points in
//! its part of the pixel. Without the grid, an LDI with half of the rays aliases
//! (docs/decisions/0007).

use crate::accumulate::accumulator::{Accumulator, to_unorm16};
use crate::capture::SceneCapture;
use glam::{DVec3, Vec2, Vec3};
use headbox_core::cube_face::Face;
use headbox_scene::scene::Paint;
use headbox_trace::light::LitPoint;
use headbox_trace::sampler::RayKey;

/// Makes surface samples from the accumulators of a capture.
pub(crate) struct Shader<'a> {
    pub capture: SceneCapture<'a>,
    /// Leaves out light and albedo, for the geometry pass.
    pub geometry_only: bool,
}

/// A surface sample: one kind of surface in one depth bin of one pixel, with its light.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Zeroable)]
pub(crate) struct SurfaceSample {
    /// See [`Accumulator::key`].
    pub key: RayKey,
    /// See [`Accumulator::count`].
    pub count: u32,
    /// See [`Accumulator::area`].
    pub area: f32,
    /// See [`Accumulator::bin`].
    pub bin: u16,
    /// See [`Accumulator::class`].
    pub class: u16,
    /// Mean position in bins.
    pub position: f32,
    /// See [`Accumulator::primitive`].
    pub primitive: u32,
    /// See [`Accumulator::barycentric`].
    pub barycentric: [u16; 2],
    /// Mean albedo, linear, 16 bits a channel.
    pub albedo: [u16; 3],
    /// Radiance that the surface emits. Linear, exposed.
    pub emission: Vec3,
    /// Radiosity per albedo straight from the sun and from lamps without a surface, whose shadows
    /// have edges. Linear, exposed.
    pub sun: Vec3,
    /// Radiosity per albedo from everything else, which varies slowly over a surface. Linear,
    /// exposed.
    pub soft: Vec3,
    /// Unit normal of the triangle's plane, on the side that rays hit.
    pub plane_normal: Vec3,
    /// Distance of the triangle's plane from the centre, metres.
    pub plane_distance: f32,
}

impl SurfaceSample {
    /// Radiance toward any viewer, linear, exposed.
    pub(crate) fn color(&self) -> Vec3 {
        self.emission
            + Vec3::from_array(self.albedo.map(|c| f32::from(c) / 65_535.0))
                * (self.sun + self.soft)
    }
}

impl Shader<'_> {
    /// Light samples per depth pixel (K); 0 leaves surfaces unlit: their colour is albedo plus
    /// emission.
    pub(crate) fn light_samples(&self) -> u32 {
        if self.geometry_only {
            0
        } else {
            self.capture.spec.parameters.light_samples
        }
    }

    /// The surface sample of an accumulator in pixel (x, y) of a face: unlit, or evenly lit in a
    /// capture without light samples.
    pub(crate) fn surface_sample(
        &self,
        acc: &Accumulator,
        face: Face,
        x: u32,
        y: u32,
    ) -> SurfaceSample {
        let tracer = self.capture.tracer;
        let side = if acc.is_back() { -1.0 } else { 1.0 };
        let plane_normal = tracer.geometric_normal(acc.primitive) * side;
        let triangle = tracer.triangle(acc.primitive);
        let exposure = self.capture.lighting.exposure;
        SurfaceSample {
            key: acc.key,
            count: acc.count,
            area: acc.area,
            bin: acc.bin,
            class: acc.class,
            position: (f64::from(acc.bin) + acc.offset_sum as f64 / 65_536.0 / f64::from(acc.count))
                as f32,
            primitive: acc.primitive,
            barycentric: acc.barycentric,
            albedo: if self.geometry_only {
                [0; 3]
            } else {
                self.filtered_albedo(acc, face, x, y, triangle)
            },
            emission: self.filtered_emission(acc, face, x, y, triangle) * exposure,
            sun: Vec3::ZERO,
            soft: if self.light_samples() == 0 {
                Vec3::splat(exposure)
            } else {
                Vec3::ZERO
            },
            plane_normal,
            plane_distance: plane_normal.dot(triangle[0]),
        }
    }

    /// The point of a sample that a ray has met.
    pub(super) fn representative(&self, sample: &SurfaceSample) -> LitPoint {
        let tracer = self.capture.tracer;
        let [u, v] = sample.barycentric.map(|c| f32::from(c) / 65_535.0);
        let [a, b, c] = tracer.triangle(sample.primitive);
        LitPoint {
            position: a + (b - a) * u + (c - a) * v,
            normal: sample.plane_normal,
            shading_normal: self.shading_normal(sample),
            extent: tracer.extent(sample.primitive),
        }
    }

    /// Unit shading normal of a sample, on the side that rays hit.
    pub(crate) fn shading_normal(&self, sample: &SurfaceSample) -> Vec3 {
        let [u, v] = sample.barycentric.map(|c| f32::from(c) / 65_535.0);
        let scene = self.capture.tracer.scene();
        scene.shading_normal(sample.primitive, sample.plane_normal, u, v)
    }

    /// Albedo over a pixel: the mean over the rays, and, where they are few and the triangle has a
    /// texture, over a grid of points of the pixel. Points outside the triangle or in one of its
    /// holes have the mean of the rays.
    fn filtered_albedo(
        &self,
        acc: &Accumulator,
        face: Face,
        x: u32,
        y: u32,
        triangle: [Vec3; 3],
    ) -> [u16; 3] {
        /// Number of random rays whose mean has about the error of the grid.
        const EQUIVALENT_RAYS: u32 = 8;
        let mean = acc
            .albedo_sum
            .map(|sum| (sum / u64::from(acc.count.max(1))) as u16);
        let paint = self.capture.tracer.scene().paint(acc.primitive);
        let Some(texture) = paint.texture().filter(|_| acc.count < 2 * EQUIVALENT_RAYS) else {
            return mean;
        };
        let pixel = PixelOnTriangle::new(face, [x, y], self.capture.spec.face_size_px, triangle);
        let points = pixel.points(&paint, |weights| paint.texel_at(texture, weights));
        let count = points.len() as u32;
        let mut sum = mean.map(|c| acc.count * count * u32::from(c));
        for point in points {
            let albedo = point.map_or(mean, |[u, v]| paint.albedo(u, v).map(to_unorm16));
            sum.iter_mut()
                .zip(albedo)
                .for_each(|(sum, c)| *sum += EQUIVALENT_RAYS * u32::from(c));
        }
        sum.map(|sum| (sum / (count * (acc.count + EQUIVALENT_RAYS))) as u16)
    }

    /// Emission over a pixel: with a texture of emission, the mean over a grid of points of the
    /// pixel. Points outside the triangle or in one of its holes have the emission of the
    /// representative.
    fn filtered_emission(
        &self,
        acc: &Accumulator,
        face: Face,
        x: u32,
        y: u32,
        triangle: [Vec3; 3],
    ) -> Vec3 {
        let scene = self.capture.tracer.scene();
        let emission = |[u, v]: [f32; 2]| Vec3::from_array(scene.emission(acc.primitive, u, v));
        let here = emission(acc.barycentric.map(|c| f32::from(c) / 65_535.0));
        let Some(texture) = scene.emission_texture(acc.primitive) else {
            return here;
        };
        let paint = scene.paint(acc.primitive);
        let pixel = PixelOnTriangle::new(face, [x, y], self.capture.spec.face_size_px, triangle);
        let points = pixel.points(&paint, |weights| {
            scene.emission_texel_at(acc.primitive, texture, weights)
        });
        let count = points.len() as f32;
        points
            .map(|point| point.map_or(here, emission))
            .sum::<Vec3>()
            / count
    }
}

/// A pixel projected from the centre onto a triangle's plane. Homogeneous barycentric weights are
/// linear in the pixel; they are f64 for small triangles far away.
struct PixelOnTriangle {
    /// Weights of the three corners at the pixel's upper left corner.
    first: DVec3,
    /// Their change over the pixel to the right, and downward.
    steps: [DVec3; 2],
}

impl PixelOnTriangle {
    fn new(face: Face, [x, y]: [u32; 2], size_px: u32, triangle: [Vec3; 3]) -> Self {
        let [a, b, c] = triangle.map(|corner| corner.as_dvec3());
        let planes = [b.cross(c), c.cross(a), a.cross(b)];
        let side = a.dot(planes[0]).signum(); // the side of the plane on which the centre lies
        let weights =
            |direction: DVec3| DVec3::from(planes.map(|plane| plane.dot(direction))) * side;
        let corner = |dx: u32, dy: u32| {
            weights(face.direction(f64::from(x + dx), f64::from(y + dy), size_px))
        };
        let first = corner(0, 0);
        Self {
            first,
            steps: [corner(1, 0) - first, corner(0, 1) - first],
        }
    }

    /// Barycentric weights of the second and third corner at a position in the pixel, 0..1; `None`
    /// outside the triangle.
    fn weights(&self, [x, y]: [f64; 2]) -> Option<[f32; 2]> {
        let weights = self.first + self.steps[0] * x + self.steps[1] * y;
        (weights.min_element() >= 0.0 && weights.element_sum() > 0.0)
            .then(|| corner_weights(weights))
    }

    /// Barycentric weights of the grid points at which a texture of the triangle is sampled in the
    /// pixel, as by [`Self::weights`]; `None` also in holes. `texel_at` returns the texture
    /// coordinate at weights, texels.
    fn points<'a>(
        &'a self,
        paint: &'a Paint,
        texel_at: impl Fn([f32; 2]) -> Vec2,
    ) -> impl ExactSizeIterator<Item = Option<[f32; 2]>> + 'a {
        let [columns, rows] = self.grid(texel_at);
        (0..columns * rows).map(move |i| {
            let position = [(i % columns, columns), (i / columns, rows)]
                .map(|(i, side)| (f64::from(i) + 0.5) / f64::from(side));
            self.weights(position)
                .filter(|&[u, v]| paint.is_solid(u, v))
        })
    }

    /// Columns and rows of the grid: one for each texel that the pixel spans, at most `MAX_SIDE`.
    /// Within a texel, a texture is so smooth that one sample is enough.
    fn grid(&self, texel_at: impl Fn([f32; 2]) -> Vec2) -> [u32; 2] {
        const MAX_SIDE: f32 = 3.0;
        let [here, right, below] = [
            self.first,
            self.first + self.steps[0],
            self.first + self.steps[1],
        ]
        .map(|weights| texel_at(corner_weights(weights)));
        // NaN gives 1.
        [right, below].map(|there| {
            (there - here)
                .abs()
                .max_element()
                .ceil()
                .clamp(1.0, MAX_SIDE)
                .max(1.0) as u32
        })
    }
}

/// Barycentric weights of the second and third corner.
fn corner_weights(homogeneous: DVec3) -> [f32; 2] {
    let sum = homogeneous.element_sum();
    [(homogeneous.y / sum) as f32, (homogeneous.z / sum) as f32]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::sampling_area::intersect_triangle;
    use crate::scene_source::SceneSource;
    use crate::spec::{CaptureSpec, RunOptions};
    use headbox_trace::bvh::Tracer;
    use headbox_trace::light::Lighting;

    #[test]
    fn pixel_points_lie_on_the_triangle() {
        let triangle = [
            Vec3::new(-1.0, -1.0, -2.0),
            Vec3::new(1.0, -1.0, -2.0),
            Vec3::new(0.0, 2.0, -2.0),
        ];
        for triangle in [triangle, [triangle[0], triangle[2], triangle[1]]] {
            let mut inside = 0;
            let size_px = 64;
            for i in 0..size_px * size_px {
                let pixel = [i % size_px, i / size_px];
                let position = [0.3, 0.8];
                let weights =
                    PixelOnTriangle::new(Face::NegZ, pixel, size_px, triangle).weights(position);
                let [x, y] = [0, 1].map(|axis| f64::from(pixel[axis]) + position[axis]);
                let expected =
                    intersect_triangle(Face::NegZ.direction(x, y, size_px).as_vec3(), triangle);
                assert_eq!(weights.is_some(), expected.is_some());
                let difference = weights
                    .zip(expected)
                    .map_or(0.0, |(w, e)| (w[0] - e[0]).abs().max((w[1] - e[1]).abs()));
                assert!(
                    difference < 1e-6,
                    "{weights:?} {expected:?}: rounding of f32"
                );
                inside += u32::from(weights.is_some());
            }
            assert!(
                (inside.cast_signed() - 768).abs() < 32,
                "{inside}: 3 of 16 square metres at depth 2"
            );
        }
    }

    #[test]
    fn grid_has_a_point_for_each_texel() {
        use glam::Vec2;
        use headbox_scene::material::{Material, Texture};
        use headbox_scene::scene::{Scene, Triangle};
        // Two metres at 2 m: 64 pixels of the face; the texture runs along them, across more
        // slowly.
        let grid = |texels: u32| {
            let material = Material {
                albedo_texture: Some(0),
                ..Material::default()
            };
            let scene = Scene {
                texcoords: vec![Vec2::ZERO, Vec2::X, Vec2::Y],
                triangles: vec![Triangle {
                    vertices: [0, 1, 2],
                    material: 0,
                }],
                materials: vec![material],
                textures: vec![Texture::from_fn(texels, texels / 2, |_, _| [255; 4])],
                ..Scene::default()
            };
            let triangle = [
                Vec3::new(-1.0, 1.0, -2.0),
                Vec3::new(1.0, 1.0, -2.0),
                Vec3::new(-1.0, -1.0, -2.0),
            ];
            PixelOnTriangle::new(Face::NegZ, [40, 40], 128, triangle)
                .grid(|weights| scene.paint(0).texel_at(&scene.textures[0], weights))
        };
        assert_eq!(
            [48, 96, 150, 400].map(grid),
            [[1, 1], [2, 1], [3, 2], [3, 3]]
        );
        let edge_on = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let flat = Scene {
            triangles: vec![Triangle {
                vertices: [0; 3],
                material: 0,
            }],
            materials: vec![Material::default()],
            ..Scene::default()
        };
        let texture = Texture::from_fn(4, 4, |_, _| [255; 4]);
        assert_eq!(
            PixelOnTriangle::new(Face::NegZ, [0, 0], 8, edge_on)
                .grid(|weights| flat.paint(0).texel_at(&texture, weights)),
            [1, 1],
            "NaN"
        );
    }

    #[test]
    fn emission_is_the_mean_of_its_texture() {
        use glam::{Vec2, dvec3};
        use headbox_scene::material::{Material, Texture};
        use headbox_scene::scene::{Scene, Triangle};
        use headbox_trace::sampler::random4;
        // A wall of four metres at 2 m whose texels emit or not, at random, some thirty to a pixel.
        let scene = Scene {
            positions: vec![
                dvec3(-6.0, -2.0, -2.0),
                dvec3(6.0, -2.0, -2.0),
                dvec3(0.0, 6.0, -2.0),
            ],
            texcoords: vec![Vec2::ZERO, Vec2::X, Vec2::Y],
            triangles: vec![Triangle {
                vertices: [0, 1, 2],
                material: 0,
            }],
            materials: vec![Material {
                emission: [1.0; 3],
                emission_texture: Some(0),
                ..Material::default()
            }],
            textures: vec![Texture::from_fn(4096, 4096, |x, y| {
                [if random4([x, y, 1, 2])[0] & 1 == 0 {
                    255
                } else {
                    0
                }; 4]
            })],
            ..Scene::default()
        };
        let tracer = Tracer::new(std::sync::Arc::new(scene), DVec3::ZERO);
        let lighting = Lighting::unmetered(&tracer, 0);
        let mut spec = CaptureSpec::new(SceneSource::new("lamps"), DVec3::ZERO, 0.5);
        spec.face_size_px = 32;
        spec.parameters.light_samples = 0;
        let options = RunOptions::default();
        let shader = Shader {
            capture: SceneCapture::new(&spec, &tracer, &lighting, &options),
            geometry_only: false,
        };
        let emitted = |p: u32| {
            let [u, v, ..] = random4([p, 3, 4, 5]).map(|bits| (bits >> 17) as u16);
            let acc = Accumulator {
                barycentric: [u, v],
                count: 1,
                ..bytemuck::Zeroable::zeroed()
            };
            let sample = shader.surface_sample(&acc, Face::NegZ, p % 32, p / 32);
            sample.emission.x
        };
        let pixels =
            (0..32 * 32).filter(|p| (8..24).contains(&(p % 32)) && (4..20).contains(&(p / 32)));
        let squares: Vec<f32> = pixels.map(|p| (emitted(p) - 0.5).powi(2)).collect();
        let error = (squares.iter().sum::<f32>() / squares.len() as f32).sqrt();
        // Nine bilinear points have a mean of one half and a ninth of the variance; a single point
        // would be off by three times that.
        assert!(error < 0.17, "{error}");
    }
}
