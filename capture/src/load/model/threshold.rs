//! What lies under doors.
//!
//! Rooms are drawn by hand, and between the floors of two of them a few millimetres may be left under their door, through which the
//! ground outside shines, as bright as day. So there is a threshold under each: dark unless one looks for it.

use crate::Material;
use crate::scene::{Scene, Triangle};
use glam::{DVec2, DVec3, Vec2, Vec3};

/// How far below the floors thresholds lie, metres: a depth buffer tells that apart at a room's distance.
const BELOW_M: f64 = 0.002;

/// The name of their material.
const NAME: &str = "threshold";

/// Adds a threshold: a quadrilateral under a floor, metres, corners of its outline in order.
pub(super) fn add(scene: &mut Scene, mut outline: [DVec2; 4], floor_y: f64) {
    let area: f64 = (0..4).map(|i| outline[i].perp_dot(outline[(i + 1) % 4])).sum();
    if area > 0.0 {
        outline.reverse(); // from x toward z it would face downward
    }
    let material = scene.materials.iter().position(|material| material.name == NAME).unwrap_or_else(|| {
        scene.materials.push(Material { name: NAME.into(), ..Material::default() });
        scene.materials.len() - 1
    });
    let first = scene.positions.len() as u32;
    scene.positions.extend(outline.map(|corner| DVec3::new(corner.x, floor_y - BELOW_M, corner.y)));
    let count = scene.positions.len();
    if !scene.normals.is_empty() {
        scene.normals.resize(count, Vec3::Y);
    }
    if !scene.texcoords.is_empty() {
        scene.texcoords.resize(count, Vec2::ZERO);
    }
    if !scene.colors.is_empty() {
        scene.colors.resize(count, Vec3::ONE);
    }
    for vertices in [[first, first + 1, first + 2], [first, first + 2, first + 3]] {
        scene.triangles.push(Triangle { vertices, material: material as u32 });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_face_upward_whichever_way_they_are_drawn() {
        let outline = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        let mut scene = Scene::default();
        add(&mut scene, outline, 3.0);
        add(&mut scene, [outline[3], outline[2], outline[1], outline[0]], 0.0);
        assert_eq!((scene.triangles.len(), scene.materials.len()), (4, 1));
        assert!((0..4).all(|triangle| scene.geometric_normal(triangle).y > 0.99));
        assert!(scene.positions[..4].iter().all(|p| p.y < 3.0 && p.y > 2.99));
    }
}
