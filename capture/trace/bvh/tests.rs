//! Tests of what a ray meets: overlapping triangles in one plane, single-sided materials.

use super::{Hit, Ray, RayPacket, Tracer};
use glam::{DVec3, Vec3, dvec3};
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle};
use std::sync::Arc;

/// Returns the hit of a ray, which must be the same by itself and in a packet.
fn hit(tracer: &Tracer, origin: Vec3, target: Vec3) -> Option<Hit> {
    let ray = Ray::new(origin, target - origin);
    let hit = tracer.closest(&ray);
    let packet = RayPacket::from_rays(&[ray; 16]);
    let hits = tracer.closest_packet(&packet);
    assert!((0..16).all(|k| hits.hit(k) == hit), "{hit:?}");
    assert_eq!(tracer.occluded(&ray), hit.is_some());
    let blocked = if hit.is_some() { u16::MAX } else { 0 };
    assert_eq!(tracer.occluded_packet(&packet), blocked);
    hit
}

fn tracer(positions: Vec<DVec3>, triangles: &[([u32; 3], u32)], materials: &[bool]) -> Tracer {
    let material = |&single_sided: &bool| Material {
        single_sided,
        ..Material::default()
    };
    let scene = Scene {
        positions,
        triangles: triangles
            .iter()
            .map(|&(vertices, material)| Triangle { vertices, material })
            .collect(),
        materials: materials.iter().map(material).collect(),
        ..Scene::default()
    };
    Tracer::new(Arc::new(scene), DVec3::ZERO)
}

#[test]
fn ray_meets_last_facing_of_coincident_triangles() {
    let positions = vec![
        dvec3(-1.0, -1.0, -0.0),
        dvec3(2.0, -1.0, 0.0),
        dvec3(0.0, 3.0, 0.0),
    ];
    let orders = [[0, 2, 1], [1, 2, 0], [1, 0, 2], [2, 0, 1]].map(|corners| (corners, 0));
    let tracer = tracer(positions, &orders, &[false]);
    // From +Z the corners 0, 1, 2 run counter-clockwise: the front of triangles 1 and 3.
    for (z, expected) in [(5.0, 3), (-5.0, 2)] {
        for i in 0..20 {
            let target = Vec3::new(0.05 * i as f32 - 0.4, 0.3 * (i % 5) as f32 - 0.6, 0.0);
            let hit = hit(&tracer, Vec3::new(0.3, 0.1, z), target).expect("inside the triangle");
            assert_eq!(hit.primitive, expected);
            let [a, b, c] = tracer.triangle(expected);
            let point = a + (b - a) * hit.u + (c - a) * hit.v;
            assert!(
                (point - target).length() < 1e-5,
                "{point} {target}: rounding of f32"
            );
        }
    }
}

/// A slanted wall of two triangles with a poster of three triangles in its plane, far from the
/// origin; the poster's normal is that of the wall or the opposite.
fn poster(same_side: bool, poster_first: bool) -> Tracer {
    let at = dvec3(31.7, -4.3, 12.9);
    let (right, up) = (dvec3(0.6, 0.3, -0.74), dvec3(0.1, 0.9, 0.42));
    let place = |[x, y]: [f64; 2]| at + right * x + up * y;
    let wall = [[-2.0, -1.5], [2.3, -1.1], [1.9, 1.7], [-2.2, 1.4]];
    let sheet = [
        [-1.1, -0.7],
        [0.9, -0.8],
        [1.2, 0.3],
        [0.1, 0.9],
        [-0.8, 0.6],
    ];
    let positions: Vec<DVec3> = wall.into_iter().chain(sheet).map(place).collect();
    let turned = |[a, b, c]: [u32; 3]| if same_side { [a, b, c] } else { [a, c, b] };
    let wall = [[0, 1, 2], [0, 2, 3]].map(|corners| (corners, 0));
    let sheet = [[4, 5, 6], [4, 6, 7], [4, 7, 8]].map(|corners| (turned(corners), 1));
    let triangles = if poster_first {
        [&sheet[..], &wall].concat()
    } else {
        [&wall[..], &sheet].concat()
    };
    tracer(positions, &triangles, &[false, false])
}

#[test]
fn posters_show_without_speckles() {
    let at = Vec3::new(31.7, -4.3, 12.9);
    let (right, up) = (Vec3::new(0.6, 0.3, -0.74), Vec3::new(0.1, 0.9, 0.42));
    let normal = right.cross(up);
    // Same side or not, poster first or not, from the wall's front or back; is the poster shown?
    let cases = [
        (true, false, 1.0, true),
        (true, false, -1.0, true),
        (true, true, 1.0, false),
        (false, false, 1.0, false),
        (false, false, -1.0, true),
        (false, true, -1.0, true),
        (false, true, 1.0, false),
    ];
    for (same_side, poster_first, side, shows_poster) in cases {
        let tracer = poster(same_side, poster_first);
        for i in 0..400 {
            let (x, y) = ((i % 20) as f32 * 0.07 - 0.7, (i / 20) as f32 * 0.04 - 0.4);
            let target = at + right * x + up * y;
            let eye = at + normal * (5.0 * side) + right * 0.7;
            let hit = hit(&tracer, eye, target).expect("the wall");
            let material = tracer.scene().triangles[hit.primitive as usize].material;
            assert_eq!(
                material == 1,
                shows_poster,
                "{same_side} {poster_first} {side} {i}"
            );
        }
    }
}

#[test]
fn single_sided_triangles_are_absent_from_behind() {
    let positions = vec![
        dvec3(-1.0, -1.0, 0.0),
        dvec3(1.0, -1.0, 0.0),
        dvec3(0.0, 1.0, 0.0),
        dvec3(-1.0, -1.0, -1.0),
        dvec3(1.0, -1.0, -1.0),
        dvec3(0.0, 1.0, -1.0),
    ];
    // The front of the first is on the side of +Z; the second is two-sided.
    let tracer = tracer(positions, &[([0, 1, 2], 1), ([3, 4, 5], 0)], &[false, true]);
    for i in 0..50 {
        let target = Vec3::new(0.004 * i as f32 - 0.1, 0.003 * i as f32 - 0.2, -0.5);
        let eye = Vec3::new(0.05, 0.02 * (i % 3) as f32, 3.0);
        assert_eq!(hit(&tracer, eye, target).map(|hit| hit.primitive), Some(0));
        let behind = Vec3::new(eye.x, eye.y, -0.9);
        assert_eq!(hit(&tracer, behind, Vec3::new(0.0, 0.0, 1.0)), None);
        let from_back = Vec3::new(0.0, 0.0, -4.0);
        let hit = hit(&tracer, from_back, target * 0.3).map(|hit| hit.primitive);
        assert_eq!(hit, Some(1), "two-sided");
    }
    assert!(tracer.is_visible(-Vec3::Z, 0, 0.3, 0.3) && !tracer.is_visible(Vec3::Z, 0, 0.3, 0.3));
}

/// Among boxes that are equal or in a row, each round of clustering would join few.
#[test]
fn trees_over_equal_boxes_are_shallow() {
    const COUNT: u32 = 4096;
    /// A balanced tree has 4 levels.
    const MAX_LEVELS: usize = 12;
    for offset in [DVec3::ZERO, DVec3::X] {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let corners = |i: u32| triangle.map(|corner| corner + offset * f64::from(i));
        let positions = (0..COUNT).flat_map(corners).collect();
        let triangles: Vec<([u32; 3], u32)> = (0..COUNT)
            .map(|i| ([3 * i, 3 * i + 1, 3 * i + 2], 0))
            .collect();
        let tree = tracer(positions, &triangles, &[false]).tree;
        let levels = (tree.stack_len - 1) / (super::tree::WIDTH - 1);
        assert!(levels <= MAX_LEVELS, "{offset}: {levels} levels");
    }
}
