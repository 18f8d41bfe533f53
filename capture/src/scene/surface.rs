//! What a ray finds where it hits a triangle.

use super::Scene;
use glam::Vec3;

/// A point on a triangle as the shading needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Unit geometric normal, world axes, on the side from which the corners run counter-clockwise.
    pub normal: Vec3,
    /// Unit interpolated normal, in the same hemisphere as `normal`; equal to it where the file gives no normals.
    pub shading_normal: Vec3,
    /// Diffuse albedo, linear RGB in 0..=1: material times texture times vertex colour.
    pub albedo: [f32; 3],
    /// Emitted radiance, linear RGB.
    pub emission: [f32; 3],
}

impl Scene {
    /// The surface at barycentric weights `u` and `v` (of vertices 1 and 2) of triangle `primitive`. The scene must be
    /// valid ([`Scene::validate`]) and `primitive` one of its triangles.
    pub fn surface(&self, primitive: u32, u: f32, v: f32) -> Surface {
        let triangle = self.triangles[primitive as usize];
        let material = &self.materials[triangle.material as usize];
        let corners = triangle.vertices.map(|vertex| vertex as usize);
        let weights = [1.0 - u - v, u, v];

        let normal = self.geometric_normal(primitive);
        let shading_normal = if self.normals.is_empty() {
            normal
        } else {
            let smooth = blend(corners.map(|c| self.normals[c]), weights).try_normalize().unwrap_or(normal);
            if smooth.dot(normal) < 0.0 { -smooth } else { smooth }
        };

        let emission = if material.emission == [0.0; 3] {
            Vec3::ZERO
        } else {
            Vec3::from(material.emission) * self.texel(material.emission_texture, corners, weights)
        };
        Surface {
            normal,
            shading_normal,
            albedo: self.albedo(primitive, u, v),
            emission: emission.max(Vec3::ZERO).into(),
        }
    }

    /// The albedo alone: [`Surface::albedo`], under the conditions of [`Scene::surface`].
    pub fn albedo(&self, primitive: u32, u: f32, v: f32) -> [f32; 3] {
        let triangle = self.triangles[primitive as usize];
        let material = &self.materials[triangle.material as usize];
        let (corners, weights) = (triangle.vertices.map(|vertex| vertex as usize), [1.0 - u - v, u, v]);
        let color = if self.colors.is_empty() { Vec3::ONE } else { blend(corners.map(|c| self.colors[c]), weights) };
        let albedo = Vec3::from(material.albedo) * self.texel(material.albedo_texture, corners, weights) * color;
        albedo.clamp(Vec3::ZERO, Vec3::ONE).into()
    }

    /// Whether the albedo of a triangle comes from a texture.
    pub fn is_textured(&self, primitive: u32) -> bool {
        self.materials[self.triangles[primitive as usize].material as usize].albedo_texture.is_some()
    }

    /// A texture's colour at the given weights of three corners; white without a texture.
    fn texel(&self, texture: Option<u32>, corners: [usize; 3], weights: [f32; 3]) -> Vec3 {
        let Some(index) = texture else { return Vec3::ONE };
        let [s, t] = self.texcoord(corners, weights);
        let [r, g, b, _alpha] = self.textures[index as usize].sample(s, t);
        Vec3::new(r, g, b)
    }

    /// Whether the surface is really there at barycentric weights `u`, `v` of triangle `primitive`: false in the
    /// holes of a cut-out (see [`crate::Cutout`]). Same conditions as [`Scene::surface`].
    pub fn is_solid(&self, primitive: u32, u: f32, v: f32) -> bool {
        let triangle = self.triangles[primitive as usize];
        let Some(cutout) = self.materials[triangle.material as usize].cutout else {
            return true;
        };
        let [s, t] = self.texcoord(triangle.vertices.map(|vertex| vertex as usize), [1.0 - u - v, u, v]);
        self.textures[cutout.texture as usize].sample(s, t)[3] >= cutout.threshold
    }

    /// Unit geometric normal of a triangle; straight up if it has no area. In `f64`, because edges of a millimetre in
    /// a scene at 1e5 m have no digits left in `f32`.
    pub fn geometric_normal(&self, primitive: u32) -> Vec3 {
        let [a, b, c] = self.corners(primitive);
        (b - a).cross(c - a).try_normalize().map_or(Vec3::Y, |normal| normal.as_vec3())
    }

    /// The texture coordinate at the given weights; (0, 0) if the scene has none.
    fn texcoord(&self, corners: [usize; 3], weights: [f32; 3]) -> [f32; 2] {
        if self.texcoords.is_empty() {
            return [0.0; 2];
        }
        let [a, b, c] = corners.map(|corner| self.texcoords[corner]);
        (a * weights[0] + b * weights[1] + c * weights[2]).into()
    }
}

fn blend([a, b, c]: [Vec3; 3], weights: [f32; 3]) -> Vec3 {
    a * weights[0] + b * weights[1] + c * weights[2]
}

#[cfg(test)]
mod tests {
    use crate::material::{Cutout, Material, Texture};
    use crate::scene::{Scene, SceneError, Triangle};
    use glam::{Vec2, Vec3, dvec3};

    /// One triangle in the plane y = 0, front side up, with a 2x1 texture: red and opaque, green and transparent.
    fn scene() -> Scene {
        let texture = Texture::new(2, 1, vec![[255, 0, 0, 255], [0, 255, 0, 0]]).expect("2x1");
        Scene {
            positions: vec![dvec3(0.0, 0.0, 0.0), dvec3(0.0, 0.0, 1.0), dvec3(1.0, 0.0, 0.0)],
            texcoords: vec![Vec2::new(0.25, 0.5), Vec2::new(0.25, 0.5), Vec2::new(0.75, 0.5)],
            triangles: vec![Triangle { vertices: [0, 1, 2], material: 0 }],
            materials: vec![Material {
                albedo: [0.5; 3],
                albedo_texture: Some(0),
                emission: [2.0, 3.0, 4.0],
                emission_texture: Some(0),
                cutout: Some(Cutout { texture: 0, threshold: 0.5 }),
                ..Material::default()
            }],
            textures: vec![texture],
            ..Scene::default()
        }
    }

    #[test]
    fn a_surface_is_material_times_texture_times_vertex_colour() {
        let mut scene = scene();
        assert_eq!(scene.validate(), Ok(()));
        let s = scene.surface(0, 0.5, 0.0);
        assert_eq!((s.normal, s.shading_normal), (Vec3::Y, Vec3::Y));
        assert_eq!((s.albedo, s.emission), ([0.5, 0.0, 0.0], [2.0, 0.0, 0.0]));
        assert_eq!(scene.surface(0, 0.0, 1.0).albedo, [0.0, 0.5, 0.0], "the weight v belongs to vertex 2");
        assert!(scene.is_solid(0, 0.5, 0.0) && !scene.is_solid(0, 0.0, 1.0));

        scene.colors = vec![Vec3::splat(0.5), Vec3::splat(9.0), Vec3::ONE];
        assert_eq!(scene.surface(0, 0.0, 0.0).albedo, [0.25, 0.0, 0.0]);
        assert_eq!(scene.surface(0, 1.0, 0.0).albedo, [1.0, 0.0, 0.0], "clamped");

        scene.normals = vec![Vec3::NEG_Y, Vec3::X, Vec3::ZERO];
        assert_eq!(scene.surface(0, 0.0, 0.0).shading_normal, Vec3::Y, "turned to the geometric side");
        assert_eq!(scene.surface(0, 1.0, 0.0).shading_normal, Vec3::X);
        assert_eq!(scene.surface(0, 0.0, 1.0).shading_normal, Vec3::Y, "no normal given there");
    }

    #[test]
    fn validate_finds_every_broken_promise() {
        let broken = |change: fn(&mut Scene)| {
            let mut scene = scene();
            change(&mut scene);
            scene.validate().expect_err("broken on purpose")
        };
        assert_eq!(broken(|s| s.triangles.clear()), SceneError::NoTriangles);
        assert_eq!(broken(|s| s.materials.clear()), SceneError::NoMaterials);
        assert_eq!(broken(|s| s.positions[2].y = f64::NAN), SceneError::Position(2));
        let error = broken(|s| s.normals.push(Vec3::Y));
        assert_eq!(error, SceneError::ArrayLength { array: "normals", length: 1, positions: 3 });
        let error = broken(|s| s.triangles[0].vertices[1] = 3);
        assert_eq!(error, SceneError::VertexIndex { triangle: 0, vertex: 3, positions: 3 });
        let error = broken(|s| s.triangles[0].material = 1);
        assert_eq!(error, SceneError::MaterialIndex { triangle: 0, material: 1, materials: 1 });
        let error = broken(|s| s.materials[0].cutout = Some(Cutout { texture: 7, threshold: 0.5 }));
        assert_eq!(error, SceneError::TextureIndex { material: 0, texture: 7, textures: 1 });
    }

    #[test]
    fn bounds_ignore_vertices_that_no_triangle_uses() {
        let mut scene = scene();
        scene.positions.push(dvec3(1e9, 0.0, 0.0));
        assert_eq!(scene.bounds(), [dvec3(0.0, 0.0, 0.0), dvec3(1.0, 0.0, 1.0)]);
    }
}
