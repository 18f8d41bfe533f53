//! Per-triangle cache of values for shading: computing them from positions in `f64` takes longer
//! than a ray's test of the triangle.

use super::build::local_triangle;
use glam::{DVec3, Vec3};
use headbox_scene::scene::Scene;
use rayon::prelude::*;

/// Cached values of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CachedTriangle {
    /// [`Scene::geometric_normal`].
    pub(super) normal: Vec3,
    /// Largest absolute coordinate in the local frame, metres.
    pub(super) extent: f32,
}

/// Returns the largest absolute coordinate of a triangle.
pub fn triangle_extent(triangle: [Vec3; 3]) -> f32 {
    triangle
        .iter()
        .map(|corner| corner.abs().max_element())
        .fold(0.0, f32::max)
}

/// Caches all triangles of a scene; triangles with missing vertices get +Y and 0.
pub(super) fn cache_triangles(scene: &Scene, origin: DVec3) -> Vec<CachedTriangle> {
    let cache = |primitive: u32| match local_triangle(scene, origin, primitive) {
        Some(triangle) => CachedTriangle {
            normal: scene.geometric_normal(primitive),
            extent: triangle_extent(triangle),
        },
        None => CachedTriangle {
            normal: Vec3::Y,
            extent: 0.0,
        },
    };
    (0..scene.triangles.len() as u32)
        .into_par_iter()
        .map(cache)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::Tracer;
    use glam::dvec3;
    use headbox_scene::scene::Triangle;
    use std::sync::Arc;

    #[test]
    fn cached_values_match_scene() {
        let positions = vec![
            dvec3(1e5, 0.0, 0.0),
            dvec3(1e5 + 1e-3, 2.0, 0.0),
            dvec3(1e5, 0.0, 3.0),
            dvec3(-9.0, 4.0, 1.0),
        ];
        let triangles = [[0, 1, 2], [2, 1, 3], [0, 0, 1], [3, 1, 0]].map(|vertices| Triangle {
            vertices,
            material: 0,
        });
        let scene = Scene {
            positions,
            triangles: triangles.into(),
            ..Scene::default()
        };
        let tracer = Tracer::new(Arc::new(scene), dvec3(1e5, 1.0, 0.0));
        for primitive in 0..4 {
            assert_eq!(
                tracer.geometric_normal(primitive),
                tracer.scene().geometric_normal(primitive),
                "{primitive}"
            );
            assert_eq!(
                tracer.extent(primitive),
                triangle_extent(tracer.triangle(primitive)),
                "{primitive}"
            );
        }
        assert_eq!(tracer.extent(0), 3.0, "relative to the tracer's origin");
        assert_eq!(
            (tracer.geometric_normal(4), tracer.extent(4)),
            (Vec3::Y, 0.0),
            "no such triangle"
        );
    }
}
