//! Triangles in the order in which they are drawn: groups (the cells of a house) of clusters of
//! neighbours.

use super::SurfaceId;
use super::mip::MipTexture;
use glam::{DVec3, Vec2, Vec3};
use headbox_scene::coplanar::CoplanarTriangles;
use headbox_scene::material::Material;
use headbox_scene::scene::Scene;
use headbox_trace::bvh::MAX_COORDINATE;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

/// Maximum number of triangles of a cluster. Its vertices fit the level 1 cache.
const CLUSTER_TRIANGLES: usize = 128;
/// Maximum number of vertices of a cluster.
pub(super) const CLUSTER_VERTICES: usize = 256;

/// A run of triangles that lie near each other.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cluster {
    /// Indices of the mesh's vertices.
    pub(super) vertices: Range<u32>,
    /// Indices of the scene's triangles.
    pub(super) triangles: Range<u32>,
    /// Lowest and highest corner of the bounding box, local metres.
    pub(super) bounds: [Vec3; 2],
    /// True if some of its triangles have a cut-out material.
    pub(super) has_cutouts: bool,
    /// True if some of its triangles have a single-sided material.
    pub(super) has_single_sided: bool,
}

/// Vertex attributes for shading: half a cache line.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub(super) struct Vertex {
    /// Local metres.
    pub(super) position: Vec3,
    /// Linear colour; white if the scene has none.
    pub(super) color: Vec3,
    /// Texture coordinate; (0, 0) if the scene has none.
    pub(super) texcoord: Vec2,
}

/// Material attributes for shading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MeshMaterial {
    pub(super) albedo: Vec3,
    pub(super) emission: Vec3,
    /// Index of the texture, as for emission.
    pub(super) albedo_texture: Option<u32>,
    pub(super) emission_texture: Option<u32>,
    pub(super) has_cutout: bool,
    pub(super) single_sided: bool,
}

/// A triangle of the mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MeshTriangle {
    /// Indices of the clusters' vertices.
    pub(super) corners: [u32; 3],
    /// Index of the scene's material.
    pub(super) material: u32,
}

/// A scene ready to be rasterised, in a local frame about an origin (world axes, metres), for the
/// precision of `f32`.
#[derive(Debug)]
pub struct RasterMesh {
    scene: Arc<Scene>,
    origin: DVec3,
    /// Positions of the clusters' vertices, one array per axis, local metres.
    pub(super) positions: [Vec<f32>; 3],
    /// The same vertices with their attributes.
    pub(super) vertices: Vec<Vertex>,
    /// For each triangle of the scene; one that is not drawn has three equal corners.
    pub(super) triangles: Vec<MeshTriangle>,
    pub(super) clusters: Vec<Cluster>,
    pub(super) groups: Vec<Range<u32>>,
    pub(super) coplanar: CoplanarTriangles,
    /// For each texture of the scene.
    pub(super) textures: Vec<MipTexture>,
    /// For each material of the scene.
    pub(super) materials: Vec<MeshMaterial>,
}

impl MeshMaterial {
    fn new(material: &Material) -> Self {
        Self {
            albedo: Vec3::from(material.albedo),
            emission: Vec3::from(material.emission),
            albedo_texture: material.albedo_texture,
            emission_texture: material.emission_texture,
            has_cutout: material.cutout.is_some(),
            single_sided: material.single_sided,
        }
    }
}

impl RasterMesh {
    /// Prepares groups of the scene's triangles, relative to `origin` (world metres). The scene
    /// must be valid ([`Scene::validate`]). Triangles in no group, with a coordinate beyond
    /// [`MAX_COORDINATE`], or with an index of 2^31 or more are never drawn; ranges are clamped to
    /// the number of triangles.
    pub fn new(scene: Arc<Scene>, groups: &[Range<u32>], origin: DVec3) -> Self {
        let count = scene.triangles.len().min(SurfaceId::MAX_TRIANGLES as usize);
        let mut mesh = Self {
            textures: scene.textures.iter().map(MipTexture::new).collect(),
            materials: scene.materials.iter().map(MeshMaterial::new).collect(),
            origin,
            coplanar: CoplanarTriangles::find(&scene),
            positions: Default::default(),
            vertices: Vec::new(),
            triangles: scene
                .triangles
                .iter()
                .map(|t| MeshTriangle {
                    corners: [0; 3],
                    material: t.material,
                })
                .collect(),
            clusters: Vec::new(),
            groups: Vec::with_capacity(groups.len()),
            scene: Arc::clone(&scene),
        };
        for group in groups {
            let first = mesh.clusters.len() as u32;
            let end = group.end.min(count as u32);
            let mut next = group.start.min(end);
            while next < end {
                next = mesh.append_cluster(&scene, next..end);
            }
            mesh.groups.push(first..mesh.clusters.len() as u32);
        }
        mesh
    }

    /// Returns the scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Returns the world position of the local frame's origin, metres.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Returns the number of groups.
    pub fn group_count(&self) -> usize {
        self.groups.len()
    }

    /// Returns the corners of a triangle.
    #[inline]
    pub(super) fn corners(&self, triangle: &MeshTriangle) -> [&Vertex; 3] {
        let [a, b, c] = triangle.corners;
        [
            &self.vertices[a as usize],
            &self.vertices[b as usize],
            &self.vertices[c as usize],
        ]
    }

    /// Returns the texture coordinates of a triangle's emission texture, if they are not those of
    /// its corners.
    pub(super) fn emission_texcoords(&self, primitive: u32) -> Option<[Vec2; 3]> {
        let texcoords = &self.scene.emission_texcoords;
        let corners = self.scene.triangles[primitive as usize].vertices;
        (!texcoords.is_empty()).then(|| corners.map(|corner| texcoords[corner as usize]))
    }

    /// Builds a cluster from the first triangles of a run, until it is full; returns the index of
    /// the next triangle.
    fn append_cluster(&mut self, scene: &Scene, run: Range<u32>) -> u32 {
        let first_vertex = self.vertices.len() as u32;
        let mut known: HashMap<u32, u32> = HashMap::with_capacity(CLUSTER_VERTICES);
        let mut bounds = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        let mut end = run.start;
        for primitive in run.clone().take(CLUSTER_TRIANGLES) {
            let vertices = scene.triangles[primitive as usize].vertices;
            if known.len() + 3 > CLUSTER_VERTICES {
                break;
            }
            end = primitive + 1;
            let local =
                vertices.map(|vertex| (scene.positions[vertex as usize] - self.origin).as_vec3());
            if local
                .iter()
                .any(|p| p.is_nan() || p.abs().max_element() > MAX_COORDINATE)
            {
                continue;
            }
            self.triangles[primitive as usize].corners = std::array::from_fn(|i| {
                bounds = [bounds[0].min(local[i]), bounds[1].max(local[i])];
                *known.entry(vertices[i]).or_insert_with(|| {
                    for axis in 0..3 {
                        self.positions[axis].push(local[i][axis]);
                    }
                    let source = vertices[i] as usize;
                    self.vertices.push(Vertex {
                        position: local[i],
                        color: scene.colors.get(source).copied().unwrap_or(Vec3::ONE),
                        texcoord: scene.texcoords.get(source).copied().unwrap_or(Vec2::ZERO),
                    });
                    self.vertices.len() as u32 - 1
                })
            });
        }
        if bounds[0].x <= bounds[1].x {
            let any = |test: fn(&MeshMaterial) -> bool| {
                self.triangles[run.start as usize..end as usize]
                    .iter()
                    .any(|triangle| test(&self.materials[triangle.material as usize]))
            };
            let has_cutouts = any(|material| material.has_cutout);
            let has_single_sided = any(|material| material.single_sided);
            self.clusters.push(Cluster {
                vertices: first_vertex..self.vertices.len() as u32,
                triangles: run.start..end,
                bounds,
                has_cutouts,
                has_single_sided,
            });
        }
        end
    }
}
