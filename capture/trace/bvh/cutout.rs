//! Alpha cut-outs of textures.

use glam::Vec2;
use headbox_scene::material::Cutout;
use headbox_scene::scene::Scene;

/// Cut-outs of a scene by material.
#[derive(Debug)]
pub(super) struct Cutouts {
    by_material: Vec<Option<Cutout>>,
}

impl Cutouts {
    /// Collects the usable cut-outs. A cut-out needs texture coordinates and its texture; without
    /// them the surface is opaque.
    pub(super) fn new(scene: &Scene) -> Self {
        let usable = |cutout: &Cutout| {
            !scene.texcoords.is_empty() && (cutout.texture as usize) < scene.textures.len()
        };
        Self {
            by_material: scene
                .materials
                .iter()
                .map(|material| material.cutout.filter(usable))
                .collect(),
        }
    }

    /// Returns true if a material has a cut-out.
    pub(super) fn has(&self, material: u32) -> bool {
        self.get(material).is_some()
    }

    /// Returns true if a triangle has no cut-out, or is opaque at the barycentric weights `u` and
    /// `v` of its second and third vertex.
    #[cold]
    #[inline(never)]
    pub(super) fn is_opaque(&self, scene: &Scene, primitive: u32, [u, v]: [f32; 2]) -> bool {
        let sample = || {
            let triangle = scene.triangles.get(primitive as usize)?;
            let cutout = self.get(triangle.material)?;
            let texture = scene.textures.get(cutout.texture as usize)?;
            let [a, b, c] = triangle.vertices.map(|i| {
                scene
                    .texcoords
                    .get(i as usize)
                    .copied()
                    .unwrap_or(Vec2::ZERO)
            });
            let texcoord = a * (1.0 - u - v) + b * u + c * v;
            let [.., alpha] = texture.sample(texcoord.x, texcoord.y);
            Some(alpha >= cutout.threshold)
        };
        sample().unwrap_or(true)
    }

    fn get(&self, material: u32) -> Option<Cutout> {
        self.by_material.get(material as usize).copied().flatten()
    }
}
