//! The surface at a hit point.

use crate::material::{Gloss, Material, Texture};
use crate::scene::Scene;
use glam::{Vec2, Vec3};

/// Shading attributes of a point on a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Unit geometric normal, world axes, on the side from which the corners run counter-clockwise.
    pub normal: Vec3,
    /// Unit interpolated normal, in the same hemisphere as `normal`; equal to it where the file
    /// gives no normals.
    pub shading_normal: Vec3,
    /// Diffuse albedo, linear RGB in 0..=1: material times texture times vertex colour.
    pub albedo: [f32; 3],
    /// Emitted radiance, linear RGB.
    pub emission: [f32; 3],
    /// Specular reflection, if any.
    pub gloss: Option<Gloss>,
}

impl Scene {
    /// Surface at barycentric weights `u` and `v` (of vertices 1 and 2) of triangle `primitive`.
    /// The scene must be valid ([`Scene::validate`]) and `primitive` one of its triangles.
    pub fn surface(&self, primitive: u32, u: f32, v: f32) -> Surface {
        self.surface_facing(primitive, self.geometric_normal(primitive), u, v)
    }

    /// Same as [`Self::surface`], for a triangle with the given geometric normal.
    pub fn surface_facing(&self, primitive: u32, normal: Vec3, u: f32, v: f32) -> Surface {
        Surface {
            normal,
            shading_normal: self.shading_normal(primitive, normal, u, v),
            albedo: self.paint(primitive).albedo(u, v),
            emission: self.emission(primitive, u, v),
            gloss: self.material(primitive).gloss,
        }
    }

    fn material(&self, primitive: u32) -> &Material {
        &self.materials[self.triangles[primitive as usize].material as usize]
    }

    /// [`Surface::shading_normal`] of a triangle with the given geometric normal.
    pub fn shading_normal(&self, primitive: u32, normal: Vec3, u: f32, v: f32) -> Vec3 {
        if self.normals.is_empty() {
            return normal;
        }
        let corners = self.triangles[primitive as usize]
            .vertices
            .map(|vertex| self.normals[vertex as usize]);
        let smooth = blend(corners, [1.0 - u - v, u, v])
            .try_normalize()
            .unwrap_or(normal);
        if smooth.dot(normal) < 0.0 {
            -smooth
        } else {
            smooth
        }
    }

    /// [`Surface::emission`] at barycentric weights `u` and `v` of triangle `primitive`.
    pub fn emission(&self, primitive: u32, u: f32, v: f32) -> [f32; 3] {
        let material = self.material(primitive);
        if material.emission == [0.0; 3] {
            return [0.0; 3];
        }
        let texel = self
            .emission_texture(primitive)
            .map_or(Vec3::ONE, |texture| {
                let corners = self.emission_texcoords(primitive);
                texel(texture, at_weights(corners, [1.0 - u - v, u, v]))
            });
        (Vec3::from(material.emission) * texel)
            .max(Vec3::ZERO)
            .into()
    }

    /// Emission texture of triangle `primitive`, if it emits light and has one.
    pub fn emission_texture(&self, primitive: u32) -> Option<&Texture> {
        let material = self.material(primitive);
        let index = material
            .emission_texture
            .filter(|_| material.emission != [0.0; 3])?;
        self.textures.get(index as usize)
    }

    /// Texture coordinates of the emission texture at the corners of triangle `primitive`.
    fn emission_texcoords(&self, primitive: u32) -> [Vec2; 3] {
        let texcoords = if self.emission_texcoords.is_empty() {
            &self.texcoords
        } else {
            &self.emission_texcoords
        };
        let corners = self.triangles[primitive as usize].vertices;
        corners.map(|c| texcoords.get(c as usize).copied().unwrap_or(Vec2::ZERO))
    }

    /// Texture coordinate of the emission texture at barycentric weights `u` and `v` of triangle
    /// `primitive`, in texels of `texture`, not wrapped.
    pub fn emission_texel_at(&self, primitive: u32, texture: &Texture, [u, v]: [f32; 2]) -> Vec2 {
        let corners = self.emission_texcoords(primitive);
        at_weights(corners, [1.0 - u - v, u, v]) * texture_size(texture)
    }

    /// Mean [`Surface::emission`] of a triangle over points one texel apart, or a 32nd of its
    /// longest side if that is more.
    pub fn mean_emission(&self, primitive: u32) -> [f32; 3] {
        const MAX_STEPS: f32 = 32.0;
        let Some(texture) = self.emission_texture(primitive) else {
            return self.emission(primitive, 1.0 / 3.0, 1.0 / 3.0);
        };
        let [a, b, c] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
            .map(|weights| self.emission_texel_at(primitive, texture, weights));
        let longest = [b - a, c - a, c - b]
            .map(|edge| edge.abs().max_element())
            .into_iter()
            .fold(0.0, f32::max);
        let steps = longest.ceil().clamp(1.0, MAX_STEPS) as u32;
        let third = 1.0 / (3.0 * steps as f32);
        let (mut sum, mut count) = (Vec3::ZERO, 0);
        // Centroids of the `steps * steps` congruent triangles into which it is divided.
        for (i, j) in (0..steps).flat_map(|i| (0..steps - i).map(move |j| (i, j))) {
            let centroids = if i + j + 1 < steps { 1..=2 } else { 1..=1 };
            for thirds in centroids {
                let [u, v] = [i, j].map(|i| (3 * i + thirds) as f32 * third);
                sum += Vec3::from(self.emission(primitive, u, v));
                count += 1;
            }
        }
        (sum / count as f32).into()
    }

    /// Colours and cut-out of triangle `primitive`, for lookups at many points. Same conditions as
    /// [`Scene::surface`].
    #[inline]
    pub fn paint(&self, primitive: u32) -> Paint<'_> {
        let triangle = self.triangles[primitive as usize];
        let material = self.material(primitive);
        let corners = triangle.vertices.map(|vertex| vertex as usize);
        let texture = |index: u32| &self.textures[index as usize];
        Paint {
            albedo: Vec3::from(material.albedo),
            colors: (!self.colors.is_empty()).then(|| corners.map(|c| self.colors[c])),
            texcoords: if self.texcoords.is_empty() {
                [Vec2::ZERO; 3]
            } else {
                corners.map(|c| self.texcoords[c])
            },
            texture: material.albedo_texture.map(texture),
            cutout: material.cutout.map(|cutout| AlphaTest {
                texture: cutout.texture.map(texture),
                opacities: corners.map(|c| self.opacities.get(c).copied().unwrap_or(1.0)),
                threshold: cutout.threshold,
            }),
        }
    }

    /// Returns true if triangle `primitive` is opaque at barycentric weights `u` and `v`, false in
    /// the holes of a cut-out (see [`crate::material::Cutout`]). Same conditions as
    /// [`Scene::surface`].
    pub fn is_solid(&self, primitive: u32, u: f32, v: f32) -> bool {
        self.paint(primitive).is_solid(u, v)
    }

    /// Unit geometric normal of a triangle; straight up if its area is 0. Computed in `f64`,
    /// because edges of a millimetre at 1e5 m have no digits left in `f32`.
    pub fn geometric_normal(&self, primitive: u32) -> Vec3 {
        let [a, b, c] = self.corners(primitive);
        (b - a)
            .cross(c - a)
            .try_normalize()
            .map_or(Vec3::Y, |normal| normal.as_vec3())
    }
}

/// Colours and cut-out of one triangle, looked up by the barycentric weights of vertices 1 and 2.
pub struct Paint<'a> {
    albedo: Vec3,
    colors: Option<[Vec3; 3]>,
    texcoords: [Vec2; 3],
    texture: Option<&'a Texture>,
    cutout: Option<AlphaTest<'a>>,
}

/// Cut-out of a triangle.
struct AlphaTest<'a> {
    texture: Option<&'a Texture>,
    opacities: [f32; 3],
    threshold: f32,
}

impl Paint<'_> {
    /// Albedo texture, if any.
    pub fn texture(&self) -> Option<&Texture> {
        self.texture
    }

    /// Texture coordinate at the given weights in texels of `texture`, not wrapped.
    pub fn texel_at(&self, texture: &Texture, [u, v]: [f32; 2]) -> Vec2 {
        at_weights(self.texcoords, [1.0 - u - v, u, v]) * texture_size(texture)
    }

    /// Same as [`Surface::albedo`].
    #[inline]
    pub fn albedo(&self, u: f32, v: f32) -> [f32; 3] {
        self.albedo_up_to(1.0, u, v)
    }

    /// Same as [`Self::albedo`], but limited to `limit` instead of 1: vertex colours with baked
    /// light make it a radiance.
    #[inline]
    pub fn albedo_up_to(&self, limit: f32, u: f32, v: f32) -> [f32; 3] {
        let weights = [1.0 - u - v, u, v];
        let color = self
            .colors
            .map_or(Vec3::ONE, |colors| blend(colors, weights));
        let texel = self.texture.map_or(Vec3::ONE, |texture| {
            texel(texture, at_weights(self.texcoords, weights))
        });
        (self.albedo * texel * color)
            .clamp(Vec3::ZERO, Vec3::splat(limit))
            .into()
    }

    /// Same as [`Scene::is_solid`].
    #[inline]
    pub fn is_solid(&self, u: f32, v: f32) -> bool {
        self.cutout.as_ref().is_none_or(|cutout| {
            let weights = [1.0 - u - v, u, v];
            let alpha = cutout.texture.map_or(1.0, |texture| {
                let at = at_weights(self.texcoords, weights);
                texture.sample(at.x, at.y)[3]
            });
            alpha * opacity_at(cutout.opacities, weights) >= cutout.threshold
        })
    }
}

/// Opacity of a surface at the given weights of its corners; exactly 1 if it is 1 at all corners.
pub fn opacity_at([a, b, c]: [f32; 3], weights: [f32; 3]) -> f32 {
    // The weights do not add up to exactly 1.
    if [a, b, c] == [1.0; 3] {
        return 1.0;
    }
    a * weights[0] + b * weights[1] + c * weights[2]
}

/// Colour of a texture at a texture coordinate.
fn texel(texture: &Texture, at: Vec2) -> Vec3 {
    let [r, g, b, _alpha] = texture.sample(at.x, at.y);
    Vec3::new(r, g, b)
}

fn at_weights([a, b, c]: [Vec2; 3], weights: [f32; 3]) -> Vec2 {
    a * weights[0] + b * weights[1] + c * weights[2]
}

fn texture_size(texture: &Texture) -> Vec2 {
    Vec2::new(texture.width() as f32, texture.height() as f32)
}

fn blend([a, b, c]: [Vec3; 3], weights: [f32; 3]) -> Vec3 {
    a * weights[0] + b * weights[1] + c * weights[2]
}

#[cfg(test)]
mod tests {
    use crate::material::{Cutout, Material, Texture};
    use crate::scene::{Scene, SceneError, Triangle};
    use glam::{Vec2, Vec3, dvec3};

    /// One triangle in the plane y = 0, front side up, with a 2x1 texture: red and opaque, green
    /// and transparent.
    fn scene() -> Scene {
        let texture = Texture::new(2, 1, vec![[255, 0, 0, 255], [0, 255, 0, 0]]).expect("2x1");
        Scene {
            positions: vec![
                dvec3(0.0, 0.0, 0.0),
                dvec3(0.0, 0.0, 1.0),
                dvec3(1.0, 0.0, 0.0),
            ],
            texcoords: vec![
                Vec2::new(0.25, 0.5),
                Vec2::new(0.25, 0.5),
                Vec2::new(0.75, 0.5),
            ],
            triangles: vec![Triangle {
                vertices: [0, 1, 2],
                material: 0,
            }],
            materials: vec![Material {
                albedo: [0.5; 3],
                albedo_texture: Some(0),
                emission: [2.0, 3.0, 4.0],
                emission_texture: Some(0),
                gloss: None,
                cutout: Some(Cutout {
                    texture: Some(0),
                    threshold: 0.5,
                }),
                ..Material::default()
            }],
            textures: vec![texture],
            ..Scene::default()
        }
    }

    #[test]
    fn albedo_is_material_times_texture_times_vertex() {
        let mut scene = scene();
        assert_eq!(scene.validate(), Ok(()));
        let s = scene.surface(0, 0.5, 0.0);
        assert_eq!((s.normal, s.shading_normal), (Vec3::Y, Vec3::Y));
        assert_eq!((s.albedo, s.emission), ([0.5, 0.0, 0.0], [2.0, 0.0, 0.0]));
        assert_eq!(
            scene.surface(0, 0.0, 1.0).albedo,
            [0.0, 0.5, 0.0],
            "the weight v belongs to vertex 2"
        );
        assert!(scene.is_solid(0, 0.5, 0.0) && !scene.is_solid(0, 0.0, 1.0));

        scene.opacities = vec![1.0, 0.4, 1.0];
        assert!(scene.is_solid(0, 0.4, 0.0) && !scene.is_solid(0, 0.9, 0.0));
        scene.materials[0].cutout = Some(Cutout {
            texture: None,
            threshold: 0.5,
        });
        assert!(
            scene.is_solid(0, 0.0, 1.0),
            "the texture's alpha is not tested"
        );
        assert!(!scene.is_solid(0, 0.9, 0.0));

        scene.emission_texcoords = vec![Vec2::new(0.75, 0.5); 3];
        assert_eq!(
            scene.surface(0, 0.5, 0.0).emission,
            [0.0, 3.0, 0.0],
            "the emission texture has its own coordinates"
        );

        scene.colors = vec![Vec3::splat(0.5), Vec3::splat(9.0), Vec3::ONE];
        assert_eq!(scene.surface(0, 0.0, 0.0).albedo, [0.25, 0.0, 0.0]);
        assert_eq!(
            scene.surface(0, 1.0, 0.0).albedo,
            [1.0, 0.0, 0.0],
            "clamped"
        );

        scene.normals = vec![Vec3::NEG_Y, Vec3::X, Vec3::ZERO];
        assert_eq!(
            scene.surface(0, 0.0, 0.0).shading_normal,
            Vec3::Y,
            "turned to the geometric side"
        );
        assert_eq!(scene.surface(0, 1.0, 0.0).shading_normal, Vec3::X);
        assert_eq!(
            scene.surface(0, 0.0, 1.0).shading_normal,
            Vec3::Y,
            "no normal given there"
        );
    }

    #[test]
    fn validate_reports_each_violated_invariant() {
        type Case = (fn(&mut Scene), SceneError);
        let cases: [Case; 6] = [
            (|s| s.triangles.clear(), SceneError::NoTriangles),
            (|s| s.positions[2].y = f64::NAN, SceneError::Position(2)),
            (
                |s| s.normals.push(Vec3::Y),
                SceneError::ArrayLength {
                    array: "normals",
                    length: 1,
                    positions: 3,
                },
            ),
            (
                |s| s.triangles[0].vertices[1] = 3,
                SceneError::VertexIndex {
                    triangle: 0,
                    vertex: 3,
                    positions: 3,
                },
            ),
            (
                |s| s.triangles[0].material = 1,
                SceneError::MaterialIndex {
                    triangle: 0,
                    material: 1,
                    materials: 1,
                },
            ),
            (
                |s| s.materials[0].albedo_texture = Some(7),
                SceneError::TextureIndex {
                    material: 0,
                    texture: 7,
                    textures: 1,
                },
            ),
        ];
        for (violate, error) in cases {
            let mut scene = scene();
            violate(&mut scene);
            assert_eq!(scene.validate(), Err(error));
        }
    }

    #[test]
    fn bounds_ignore_vertices_that_no_triangle_uses() {
        let mut scene = scene();
        scene.positions.push(dvec3(1e9, 0.0, 0.0));
        assert_eq!(scene.bounds(), [dvec3(0.0, 0.0, 0.0), dvec3(1.0, 0.0, 1.0)]);
    }
}
