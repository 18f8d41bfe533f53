//! Alpha cut-outs of textures.

use glam::Vec2;
use headbox_scene::material::Cutout;
use headbox_scene::scene::{Scene, opacity_at};

/// Cut-outs of a scene by material.
#[derive(Debug)]
pub(super) struct Cutouts {
    by_material: Vec<Option<Cutout>>,
}

impl Cutouts {
    /// Collects the usable cut-outs. A cut-out needs texture coordinates and its texture, or the
    /// opacities of vertices; without them the surface is opaque.
    pub(super) fn new(scene: &Scene) -> Self {
        let usable = |cutout: &Cutout| match cutout.texture {
            Some(texture) => {
                !scene.texcoords.is_empty() && (texture as usize) < scene.textures.len()
            }
            None => !scene.opacities.is_empty(),
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
            let weights = [1.0 - u - v, u, v];
            let mut alpha = 1.0;
            if let Some(texture) = cutout.texture {
                let texture = scene.textures.get(texture as usize)?;
                let [a, b, c] = triangle.vertices.map(|i| {
                    scene
                        .texcoords
                        .get(i as usize)
                        .copied()
                        .unwrap_or(Vec2::ZERO)
                });
                let texcoord = a * weights[0] + b * weights[1] + c * weights[2];
                alpha = texture.sample(texcoord.x, texcoord.y)[3];
            }
            if !scene.opacities.is_empty() {
                let corners = triangle.vertices;
                let opacities =
                    corners.map(|i| scene.opacities.get(i as usize).copied().unwrap_or(1.0));
                alpha *= opacity_at(opacities, weights);
            }
            Some(alpha >= cutout.threshold)
        };
        sample().unwrap_or(true)
    }

    fn get(&self, material: u32) -> Option<Cutout> {
        self.by_material.get(material as usize).copied().flatten()
    }
}
