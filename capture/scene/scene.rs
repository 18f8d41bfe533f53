//! A scene in memory: triangles in world metres, materials, textures, and how the file's axes map
//! to the world.

pub use crate::lights::{Lamp, Reach, Sky, SkyGradient, Sun};
pub use crate::sky_picture::{SkyError, SkyPicture};
pub use crate::surface::{Paint, Surface, opacity_at};
pub use headbox_core::color::exposure::Exposure;
pub use headbox_core::color::tone::ToneMap;
pub use headbox_core::file_frame::{FileFrame, UpAxis};
pub use headbox_core::headbox::Headbox;
use headbox_core::read_note::ReadNote;

use crate::material::{Material, Texture};
use glam::{DVec3, Vec2, Vec3};
use std::path::PathBuf;

/// A triangle: three vertex indices and a material index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Triangle {
    /// Vertex indices, counter-clockwise seen from the front.
    pub vertices: [u32; 3],
    /// Index into [`Scene::materials`].
    pub material: u32,
}

/// A vertex with its attributes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// Position.
    pub position: DVec3,
    /// Unit normal, or zero if there is none.
    pub normal: Vec3,
    /// Texture coordinate, (0, 0) at the bottom left.
    pub texcoord: Vec2,
    /// Texture coordinate of the emission texture, likewise.
    pub emission_texcoord: Vec2,
    /// Linear RGB that multiplies the albedo.
    pub color: Vec3,
    /// Opacity, 0 to 1, that multiplies the alpha of cut-outs.
    pub opacity: f32,
}

/// Problems that a loader worked around; empty for a clean file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LoadSummary {
    /// A note on each kind of defect, with its count.
    pub notes: Vec<ReadNote>,
    /// The files that were read: the scene's own, its materials, textures and buffers.
    pub files: Vec<PathBuf>,
}

/// A scene: every array in the world frame (metres, Y up), positions in `f64`.
///
/// Invariants, kept by every loader and generator (see [`Scene::validate`]): indices are in range;
/// positions are finite; there is at least one triangle; the other arrays of vertices are empty or
/// as long as `positions`.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Name in messages and reports.
    pub name: String,
    /// Vertex positions, world metres.
    pub positions: Vec<DVec3>,
    /// Unit vertex normals for smooth shading (zero where the file gives none), or empty.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, (0, 0) at the bottom left, or empty.
    pub texcoords: Vec<Vec2>,
    /// Texture coordinates of emission textures, or empty if they are `texcoords`.
    pub emission_texcoords: Vec<Vec2>,
    /// Linear RGB vertex colours that multiply the albedo, or empty.
    pub colors: Vec<Vec3>,
    /// Opacities, 0 to 1, that multiply the alpha of cut-outs, or empty.
    pub opacities: Vec<f32>,
    /// Triangles.
    pub triangles: Vec<Triangle>,
    /// Materials; never empty.
    pub materials: Vec<Material>,
    /// Textures.
    pub textures: Vec<Texture>,
    /// The sun, if there is one.
    pub sun: Option<Sun>,
    /// The sky, if there is one.
    pub sky: Option<Sky>,
    /// Lamps without a surface.
    pub lamps: Vec<Lamp>,
    /// Exposure of images of the scene.
    pub exposure: Exposure,
    /// Tone mapping of images of the scene.
    pub tone: ToneMap,
    /// Axes and unit of the file.
    pub frame: FileFrame,
    /// Default headbox, if the file or generator defines one.
    pub headbox: Option<Headbox>,
    /// Problems that the loader worked around.
    pub summary: LoadSummary,
}

/// Violated invariant of a [`Scene`], at its first occurrence.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// The scene has no triangle.
    #[error("there is no triangle")]
    NoTriangles,
    /// The scene has no material.
    #[error("there is no material")]
    NoMaterials,
    /// A vertex array is neither empty nor as long as the positions.
    #[error("{array} has {length} entries for {positions} positions")]
    ArrayLength {
        /// Name of the array.
        array: &'static str,
        /// Its length.
        length: usize,
        /// Number of positions.
        positions: usize,
    },
    /// A position is NaN or infinite.
    #[error("position {0} is not finite")]
    Position(usize),
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} refers to vertex {vertex} of {positions}")]
    VertexIndex {
        /// Index of the triangle.
        triangle: usize,
        /// Its vertex index.
        vertex: u32,
        /// Number of positions.
        positions: usize,
    },
    /// A triangle refers to a material that does not exist.
    #[error("triangle {triangle} refers to material {material} of {materials}")]
    MaterialIndex {
        /// Index of the triangle.
        triangle: usize,
        /// Its material index.
        material: u32,
        /// Number of materials.
        materials: usize,
    },
    /// A material refers to a texture that does not exist.
    #[error("material {material} refers to texture {texture} of {textures}")]
    TextureIndex {
        /// Index of the material.
        material: usize,
        /// Its texture index.
        texture: u32,
        /// Number of textures.
        textures: usize,
    },
}

impl Scene {
    /// Size in memory of vertices, triangles and texels, bytes.
    pub fn bytes(&self) -> u64 {
        let arrays = [
            size_of_val(&self.positions[..]),
            size_of_val(&self.normals[..]),
            size_of_val(&self.texcoords[..]),
            size_of_val(&self.emission_texcoords[..]),
            size_of_val(&self.colors[..]),
            size_of_val(&self.opacities[..]),
            size_of_val(&self.triangles[..]),
        ];
        // Copies with another sampler share the texels of an earlier texture.
        let is_first = |i: usize| {
            let mut earlier = self.textures[..i].iter();
            !earlier.any(|texture| texture.shares_texels(&self.textures[i]))
        };
        let textures = (0..self.textures.len()).filter(|&i| is_first(i));
        let texels: usize = textures
            .map(|i| size_of_val(self.textures[i].texels()))
            .sum();
        (arrays.iter().sum::<usize>() + texels) as u64
    }

    /// Checks all invariants (see [`Scene`]).
    ///
    /// # Errors
    /// The first violated invariant.
    pub fn validate(&self) -> Result<(), SceneError> {
        let positions = self.positions.len();
        let arrays = [
            ("normals", self.normals.len()),
            ("texcoords", self.texcoords.len()),
            ("emission texcoords", self.emission_texcoords.len()),
            ("colors", self.colors.len()),
            ("opacities", self.opacities.len()),
        ];
        for (array, length) in arrays {
            if length != 0 && length != positions {
                return Err(SceneError::ArrayLength {
                    array,
                    length,
                    positions,
                });
            }
        }
        if let Some(bad) = self.positions.iter().position(|p| !p.is_finite()) {
            return Err(SceneError::Position(bad));
        }
        if self.materials.is_empty() {
            return Err(SceneError::NoMaterials);
        }
        if self.triangles.is_empty() {
            return Err(SceneError::NoTriangles);
        }
        self.validate_materials()?;
        self.validate_triangles()
    }

    fn validate_materials(&self) -> Result<(), SceneError> {
        let textures = self.textures.len();
        for (material, m) in self.materials.iter().enumerate() {
            let used = [
                m.albedo_texture,
                m.emission_texture,
                m.cutout.and_then(|cutout| cutout.texture),
            ];
            if let Some(texture) = used
                .into_iter()
                .flatten()
                .find(|&texture| texture as usize >= textures)
            {
                return Err(SceneError::TextureIndex {
                    material,
                    texture,
                    textures,
                });
            }
        }
        Ok(())
    }

    fn validate_triangles(&self) -> Result<(), SceneError> {
        let (positions, materials) = (self.positions.len(), self.materials.len());
        for (triangle, t) in self.triangles.iter().enumerate() {
            if let Some(vertex) = t
                .vertices
                .into_iter()
                .find(|&vertex| vertex as usize >= positions)
            {
                return Err(SceneError::VertexIndex {
                    triangle,
                    vertex,
                    positions,
                });
            }
            if t.material as usize >= materials {
                return Err(SceneError::MaterialIndex {
                    triangle,
                    material: t.material,
                    materials,
                });
            }
        }
        Ok(())
    }

    /// Returns a vertex, with neutral values of the attributes that the scene does not have.
    pub fn vertex(&self, index: u32) -> Vertex {
        let index = index as usize;
        let texcoord = self.texcoords.get(index).copied().unwrap_or(Vec2::ZERO);
        Vertex {
            position: self.positions[index],
            normal: self.normals.get(index).copied().unwrap_or(Vec3::ZERO),
            texcoord,
            emission_texcoord: self
                .emission_texcoords
                .get(index)
                .copied()
                .unwrap_or(texcoord),
            color: self.colors.get(index).copied().unwrap_or(Vec3::ONE),
            opacity: self.opacities.get(index).copied().unwrap_or(1.0),
        }
    }

    /// Adds a vertex, with the attributes that the scene has. Returns its index.
    pub fn add_vertex(&mut self, vertex: Vertex) -> u32 {
        self.positions.push(vertex.position);
        if !self.normals.is_empty() {
            self.normals.push(vertex.normal);
        }
        if !self.texcoords.is_empty() {
            self.texcoords.push(vertex.texcoord);
        }
        if !self.emission_texcoords.is_empty() {
            self.emission_texcoords.push(vertex.emission_texcoord);
        }
        if !self.colors.is_empty() {
            self.colors.push(vertex.color);
        }
        if !self.opacities.is_empty() {
            self.opacities.push(vertex.opacity);
        }
        self.positions.len() as u32 - 1
    }

    /// Bounding box of all triangles: lowest and highest corner, world metres. (+infinity,
    /// -infinity) without triangles.
    pub fn bounds(&self) -> [DVec3; 2] {
        let corners = self
            .triangles
            .iter()
            .flat_map(|t| t.vertices)
            .map(|v| self.positions[v as usize]);
        corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| {
            [low.min(p), high.max(p)]
        })
    }

    /// Corners of triangle `primitive`, world metres.
    pub fn corners(&self, primitive: u32) -> [DVec3; 3] {
        self.triangles[primitive as usize]
            .vertices
            .map(|vertex| self.positions[vertex as usize])
    }
}
