//! Geometry added to homes.
//!
//! Rooms are drawn by hand. Between the floors of two rooms, under their door, a few millimetres
//! may be missing, through which the bright ground outside is visible. A threshold below hides it.
//! Rooms whose ceilings were switched off get them back.

use crate::polygon::area_normal;
use glam::{DVec2, DVec3, Vec2, Vec3};
use headbox_scene::load::polygon::triangulate;
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle, Vertex};

/// Distance of thresholds below the floors, metres: a depth buffer resolves it across a room.
const BELOW_M: f64 = 0.002;

/// Adds a threshold: a quadrilateral under a floor, metres, with its corners in order.
pub(super) fn threshold(scene: &mut Scene, outline: [DVec2; 4], floor_y: f64) {
    let corners = outline.map(|corner| DVec3::new(corner.x, floor_y - BELOW_M, corner.y));
    add(scene, "threshold", &corners, Vec3::Y);
}

/// Adds a ceiling, metres, with its corners in order.
pub(crate) fn ceiling(scene: &mut Scene, corners: &[DVec3]) {
    add(scene, "ceiling", corners, Vec3::NEG_Y);
}

/// Adds a polygon that faces up or down, in a neutral material of its own.
fn add(scene: &mut Scene, name: &str, corners: &[DVec3], normal: Vec3) {
    let material = scene
        .materials
        .iter()
        .position(|material| material.name == name)
        .unwrap_or_else(|| {
            scene.materials.push(Material {
                name: name.into(),
                ..Material::default()
            });
            scene.materials.len() - 1
        });
    let first = scene.positions.len() as u32;
    for &position in corners {
        scene.add_vertex(Vertex {
            position,
            normal,
            texcoord: Vec2::ZERO,
            emission_texcoord: Vec2::ZERO,
            color: Vec3::ONE,
            opacity: 1.0,
        });
    }
    let is_reversed = area_normal(corners).dot(normal.as_dvec3()) < 0.0;
    for mut triangle in triangulate(corners) {
        if is_reversed {
            triangle.reverse();
        }
        let vertices = triangle.map(|corner| first + corner as u32);
        scene.triangles.push(Triangle {
            vertices,
            material: material as u32,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_face_upward() {
        let outline = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        let mut scene = Scene::default();
        threshold(&mut scene, outline, 3.0);
        threshold(
            &mut scene,
            [outline[3], outline[2], outline[1], outline[0]],
            0.0,
        );
        assert_eq!((scene.triangles.len(), scene.materials.len()), (4, 1));
        assert!((0..4).all(|triangle| scene.geometric_normal(triangle).y > 0.99));
        assert!(scene.positions[..4].iter().all(|p| p.y < 3.0 && p.y > 2.99));
    }

    #[test]
    fn ceilings_face_down_and_cover_concave_rooms() {
        let outline = [
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 2.0],
            [2.0, 2.0],
            [2.0, 4.0],
            [0.0, 4.0],
        ];
        let mut corners: Vec<DVec3> = outline
            .iter()
            .map(|[x, z]| DVec3::new(*x, 2.5, *z))
            .collect();
        for _ in 0..2 {
            let mut scene = Scene::default();
            ceiling(&mut scene, &corners);
            let areas = (0..scene.triangles.len() as u32).map(|triangle| {
                let [a, b, c] = scene.corners(triangle);
                -(b - a).cross(c - a).y / 2.0
            });
            assert!((areas.sum::<f64>() - 12.0).abs() < 1e-12);
            corners.reverse();
        }
    }
}
