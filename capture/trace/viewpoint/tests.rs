use super::*;
use glam::dvec3;
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_core::headbox::Headbox;
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle};
use std::sync::Arc;

/// Appends the twelve triangles of a box.
fn push_box(scene: &mut Scene, low: DVec3, high: DVec3, material: u32) {
    let first = scene.positions.len() as u32;
    for corner in 0..8 {
        let pick = |bit: u32, axis: usize| {
            if corner >> bit & 1 == 0 {
                low[axis]
            } else {
                high[axis]
            }
        };
        scene
            .positions
            .push(dvec3(pick(0, 0), pick(1, 1), pick(2, 2)));
    }
    for [a, b, c, d] in [
        [0, 1, 3, 2],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 3, 7, 6],
        [0, 2, 6, 4],
        [1, 3, 7, 5],
    ] {
        for corners in [[a, b, c], [a, c, d]] {
            scene.triangles.push(Triangle {
                vertices: corners.map(|corner: u32| first + corner),
                material,
            });
        }
    }
}

/// Appends a box whose triangles face outward.
fn push_facing_outward(scene: &mut Scene, low: DVec3, high: DVec3) {
    let first = scene.triangles.len();
    push_box(scene, low, high, 0);
    let middle = (low + high) / 2.0;
    for triangle in first..scene.triangles.len() {
        let [a, b, c] = scene.corners(triangle as u32);
        if (b - a).cross(c - a).dot(a - middle) < 0.0 {
            scene.triangles[triangle].vertices.swap(1, 2);
        }
    }
}

/// Returns a church: a nave 30 m high, 12 m wide and 40 m long, with pews along it and a shelf full
/// of objects at its far end (+X).
fn church() -> Tracer {
    let material = |albedo: f32| Material {
        albedo: [albedo; 3],
        ..Material::default()
    };
    let mut scene = Scene {
        materials: vec![material(0.5), material(0.1), material(0.9)],
        ..Scene::default()
    };
    push_box(&mut scene, DVec3::ZERO, dvec3(40.0, 30.0, 12.0), 0);
    for pew in 0..10 {
        let x = 6.0 + 2.0 * f64::from(pew);
        push_box(&mut scene, dvec3(x, 0.0, 1.0), dvec3(x + 0.4, 0.9, 4.5), 1);
    }
    for thing in 0..60 {
        let y = f64::from(thing / 10) * 0.8;
        let z = 1.0 + f64::from(thing % 10);
        push_box(
            &mut scene,
            dvec3(38.0, y, z),
            dvec3(39.5, y + 0.5, z + 0.6),
            1 + thing % 2,
        );
    }
    Tracer::new(Arc::new(scene), dvec3(20.0, 15.0, 6.0))
}

#[test]
fn church_view_is_at_eye_height_toward_detail() {
    let tracer = church();
    let headbox = suggest_headbox(&tracer);
    assert!(
        (headbox.centre.y - EYE_HEIGHT_M).abs() < 1e-3,
        "{headbox:?}"
    );
    assert!(
        headbox.half_size_m > 0.3 && headbox.half_size_m < 0.9,
        "{headbox:?}"
    );
    assert_eq!(headbox, suggest_headbox(&tracer), "not reproducible");
    let ahead = suggest_view(&tracer, dvec3(32.0, 1.6, 6.0));
    assert!(ahead.dot(DVec3::X) > 0.7, "{ahead}");
}

#[test]
fn low_box_places_headbox_in_free_space() {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    push_box(&mut scene, DVec3::ZERO, DVec3::ONE, 0); // too low to stand in
    let headbox = suggest_headbox(&Tracer::new(Arc::new(scene), DVec3::splat(0.5)));
    assert!(
        headbox.centre.cmpgt(DVec3::splat(0.15)).all()
            && headbox.centre.cmplt(DVec3::splat(0.85)).all(),
        "{headbox:?}"
    );
}

/// Returns a closed, empty ball: a solid. Its triangles face outward, unlike those of `push_box`.
fn ball(radius: f64, middle: DVec3) -> Scene {
    const RINGS: u32 = 24;
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    for ring in 0..=RINGS {
        for column in 0..2 * RINGS {
            let [polar, around] =
                [ring, column].map(|i| f64::from(i) / f64::from(RINGS) * std::f64::consts::PI);
            let direction = dvec3(
                polar.sin() * around.cos(),
                polar.cos(),
                -polar.sin() * around.sin(),
            );
            scene.positions.push(middle + direction * radius);
        }
    }
    for ring in 0..RINGS {
        for column in 0..2 * RINGS {
            let vertex = |ring: u32, column: u32| ring * 2 * RINGS + column % (2 * RINGS);
            let [a, b, c, d] = [
                vertex(ring, column),
                vertex(ring + 1, column),
                vertex(ring + 1, column + 1),
                vertex(ring, column + 1),
            ];
            for vertices in [[a, b, c], [a, c, d]] {
                scene.triangles.push(Triangle {
                    vertices,
                    material: 0,
                });
            }
        }
    }
    scene
}

#[test]
fn solid_is_viewed_from_front() {
    for (radius, middle) in [
        (0.5, DVec3::ZERO),
        (3.0, dvec3(7.0, 3.0, -2.0)),
        (200.0, DVec3::ZERO),
    ] {
        let tracer = Tracer::new(Arc::new(ball(radius, middle)), middle);
        let headbox = suggest_headbox(&tracer);
        let offset = headbox.centre - middle;
        assert!(
            offset.z > 2.0 * radius && offset.x.abs() < 1e-9 && offset.length() < 5.0 * radius,
            "{radius} m: {headbox:?}"
        );
        assert!(
            offset.length() - 2.0 * headbox.half_size_m > radius,
            "{radius} m: {headbox:?}"
        );
        let ahead = suggest_view(&tracer, headbox.centre);
        assert!(ahead.dot(DVec3::NEG_Z) > 0.999, "{radius} m: {ahead}");
    }
}

#[test]
fn furnished_room_with_outward_walls_is_not_solid() {
    let mut scene = ball(3.0, DVec3::ZERO);
    push_box(
        &mut scene,
        dvec3(-0.4, -2.9, -1.4),
        dvec3(0.4, -1.0, -1.0),
        0,
    );
    let headbox = suggest_headbox(&Tracer::new(Arc::new(scene), DVec3::ZERO));
    assert!(headbox.centre.length() < 2.5, "{headbox:?}");
}

#[test]
fn nook_scores_zero() {
    let score = |clearance_m, median_m| {
        place::standing_score(Surroundings {
            clearance_m,
            median_m,
            enclosed: 0.9,
            backs: 0.0,
        })
    };
    // The balcony of a half-timbered house, among its beams; a cupboard.
    assert_eq!([score(0.3, 0.9), score(0.1, 2.0)], [0.0, 0.0]);
    // A small and a large room.
    assert!(0.0 < score(0.6, 1.5) && score(0.6, 1.5) < score(1.2, 3.0));
}

#[test]
fn furnished_room_is_preferred_to_empty() {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    push_box(&mut scene, DVec3::ZERO, dvec3(6.0, 3.0, 6.0), 0);
    push_box(&mut scene, dvec3(8.0, 0.0, 0.0), dvec3(14.0, 3.0, 6.0), 0);
    for thing in 0..40 {
        let y = f64::from(thing / 8) * 0.6;
        let z = 0.5 + 0.6 * f64::from(thing % 8);
        push_box(
            &mut scene,
            dvec3(8.1, y, z),
            dvec3(8.4, y + 0.3, z + 0.3),
            0,
        );
    }
    let headbox = suggest_headbox(&Tracer::new(Arc::new(scene), DVec3::ZERO));
    assert!(headbox.centre.x > 8.0, "{headbox:?}");
}

#[test]
fn half_size_shrinks_with_fewer_rays() {
    assert_eq!(fitting_half_size(0.8, 16.0), 0.8);
    assert_eq!(fitting_half_size(0.8, 4.0), 0.4);
    assert_eq!(fitting_half_size(0.8, 0.0), 0.2);
    assert_eq!(fitting_half_size(0.8, 1e9), 0.8);
}

/// Returns an office of two storeys, half of whose floors are under desks, with a mast on its empty
/// roof.
fn office(lawn_m: f64) -> Tracer {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    push_box(
        &mut scene,
        dvec3(-lawn_m, -0.5, -lawn_m),
        dvec3(20.0 + lawn_m, -0.4, 12.0 + lawn_m),
        0,
    );
    for storey in 0..2 {
        let floor = 3.5 * f64::from(storey);
        push_box(
            &mut scene,
            dvec3(0.0, floor, 0.0),
            dvec3(20.0, floor + 3.2, 12.0),
            0,
        );
        for row in 0..3 {
            for desk in 0..6 {
                let corner = dvec3(
                    1.5 + 3.0 * f64::from(desk),
                    floor + 0.7,
                    1.5 + 3.5 * f64::from(row),
                );
                push_box(&mut scene, corner, corner + dvec3(1.6, 0.05, 0.8), 0);
            }
        }
    }
    push_box(&mut scene, dvec3(9.9, 6.7, 5.9), dvec3(10.1, 20.0, 6.1), 0);
    Tracer::new(Arc::new(scene), dvec3(10.0, 3.0, 6.0))
}

#[test]
fn room_is_preferred_to_its_roof_and_lawn() {
    for lawn_m in [2.0, 10.0, 40.0] {
        let eye = suggest_headbox(&office(lawn_m)).centre;
        let is_inside = (0.0..20.0).contains(&eye.x) && (0.0..12.0).contains(&eye.z) && eye.y < 6.7;
        assert!(is_inside, "{lawn_m} m of lawn: {eye}");
    }
}

/// Returns a furnished room of 5 m by 4.5 m on a lawn of 45 m by 45 m, with a row of trees.
fn small_room_on_lawn() -> Tracer {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    let (lawn_low, lawn_high) = (dvec3(-20.0, -0.3, -20.0), dvec3(25.0, -0.2, 25.0));
    push_box(&mut scene, lawn_low, lawn_high, 0);
    push_box(&mut scene, DVec3::ZERO, dvec3(5.0, 2.6, 4.5), 0);
    for cupboard in 0..16 {
        let x = 0.3 * f64::from(cupboard);
        push_box(&mut scene, dvec3(x, 0.0, 0.0), dvec3(x + 0.28, 0.9, 0.6), 0);
    }
    for tree in 0..8 {
        let x = 2.0 * f64::from(tree) - 5.0;
        let (low, high) = (dvec3(x, -0.2, 9.0), dvec3(x + 0.6, 4.0, 9.6));
        push_box(&mut scene, low, high, 0);
    }
    Tracer::new(Arc::new(scene), DVec3::ZERO)
}

#[test]
fn small_house_on_large_grounds_has_rooms() {
    let has_rooms = |tracer: &Tracer| place::has_rooms(tracer, &place::floors_anywhere(tracer));
    assert!(has_rooms(&small_room_on_lawn()));
    assert!(has_rooms(&office(40.0)));
    assert!(!has_rooms(&street(true)));
}

/// Two rows of closed blocks that stand wall to wall, 12 m apart, with windows in the planes of
/// their walls, on a ground that continues below them: a street that is modelled from outside.
fn street(has_bottoms: bool) -> Tracer {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    push_facing_outward(
        &mut scene,
        dvec3(-40.0, -1.0, -60.0),
        dvec3(40.0, 0.0, 60.0),
    );
    for side in [-1.0, 1.0] {
        for i in 0..10 {
            let (start, end) = (f64::from(i) * 10.0 - 50.0, f64::from(i) * 10.0 - 40.0);
            let (low, high) = ((side * 13.0 - 7.0), (side * 13.0 + 7.0));
            let height = 10.0 + f64::from(i % 3);
            let low = dvec3(low, if has_bottoms { 0.0 } else { -0.5 }, start);
            push_facing_outward(&mut scene, low, dvec3(high, height, end));
        }
        push_box(
            &mut scene,
            dvec3(side * 5.0, 0.0, -3.0),
            dvec3(side * 4.8, 3.0, -2.8),
            0,
        );
    }
    Tracer::new(Arc::new(scene), DVec3::ZERO)
}

#[test]
fn street_is_preferred_to_the_inside_of_its_blocks() {
    for has_bottoms in [true, false] {
        let eye = suggest_headbox(&street(has_bottoms)).centre;
        assert!(
            eye.x.abs() < 6.0 && eye.y < 4.0,
            "bottoms {has_bottoms}: {eye}"
        );
    }
}

/// Returns a house of one room, 6 m by 4 m and 3 m high, with walls of 0.4 m whose surfaces face
/// outward.
fn house_with_walls() -> Tracer {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    let walls = [
        (dvec3(-0.4, -0.4, -0.4), dvec3(6.4, 0.0, 4.4)),
        (dvec3(-0.4, 3.0, -0.4), dvec3(6.4, 3.4, 4.4)),
        (dvec3(-0.4, 0.0, -0.4), dvec3(0.0, 3.0, 4.4)),
        (dvec3(6.0, 0.0, -0.4), dvec3(6.4, 3.0, 4.4)),
        (dvec3(0.0, 0.0, -0.4), dvec3(6.0, 3.0, 0.0)),
        (dvec3(0.0, 0.0, 4.0), dvec3(6.0, 3.0, 4.4)),
    ];
    for (low, high) in walls {
        push_facing_outward(&mut scene, low, high);
    }
    Tracer::new(Arc::new(scene), dvec3(3.0, 1.6, 2.0))
}

#[test]
fn bad_headbox_is_flagged_with_a_good_one() {
    let tracer = house_with_walls();
    let check = |centre: DVec3, half_size_m: f64| {
        check_headbox(
            &tracer,
            &Headbox {
                centre,
                half_size_m,
            },
        )
    };
    let middle = dvec3(3.0, 1.6, 2.0);
    assert_eq!(check(middle, 0.5), None);

    let in_wall = check(dvec3(-0.2, 1.6, 2.0), 0.3).unwrap();
    assert_eq!(in_wall.flaw, HeadboxFlaw::InsideSolid);
    assert_eq!(check(in_wall.better.centre, 0.3), None);
    assert!(in_wall.better.centre.distance(middle) < 3.0, "{in_wall:?}");
    assert!(in_wall.better.centre.x < 2.0, "nearest: {in_wall:?}");
    let eye_height_m = in_wall.better.centre.y;
    assert!((eye_height_m - 1.6).abs() < 1e-6, "{eye_height_m}");

    let cramped = check(dvec3(0.02, 1.6, 2.0), 0.01).unwrap();
    assert_eq!(cramped.flaw, HeadboxFlaw::Cramped);
    assert_eq!(check(cramped.better.centre, 0.3), None);

    let away = check(dvec3(500.0, 1.6, 2.0), 0.3).unwrap();
    assert_eq!(away.flaw, HeadboxFlaw::NothingVisible);
    assert_eq!(check(away.better.centre, 0.3), None);

    let large = check(middle, 2.5).unwrap();
    assert_eq!(large.flaw, HeadboxFlaw::SurfacesInside);
    assert_eq!(check(middle, large.better.half_size_m), None);

    let small = check(middle, 0.02).unwrap();
    assert_eq!(small.flaw, HeadboxFlaw::TooSmall);
    assert_eq!(check(middle, small.better.half_size_m), None);
}

#[test]
fn warning_is_in_units_of_file() {
    let warning = HeadboxWarning {
        flaw: HeadboxFlaw::InsideSolid,
        requested: Headbox {
            centre: DVec3::ZERO,
            half_size_m: 0.5,
        },
        better: Headbox {
            centre: dvec3(1.0, 2.0, -3.0),
            half_size_m: 0.5,
        },
    };
    let frame = FileFrame {
        up: UpAxis::Z,
        unit_m: 0.01,
    };
    let sentence = warning.sentence(&frame);
    assert!(sentence.ends_with("--center 100,300,200"), "{sentence}");
}

/// Two long walls 3 m apart with a shelf full of objects at one end: the long view is more
/// interesting than the shelf at arm's length.
#[test]
fn long_view_is_preferred_to_near_detail() {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    push_box(&mut scene, DVec3::ZERO, dvec3(14.0, 3.0, 4.0), 0);
    for thing in 0..40 {
        let y = 0.5 + f64::from(thing / 8) * 0.4;
        let z = 0.5 + 0.4 * f64::from(thing % 8);
        push_box(
            &mut scene,
            dvec3(0.0, y, z),
            dvec3(0.3, y + 0.2, z + 0.2),
            0,
        );
    }
    for table in 0..5 {
        let x = 4.0 + 2.0 * f64::from(table);
        push_box(&mut scene, dvec3(x, 0.0, 0.5), dvec3(x + 0.8, 0.8, 1.5), 0);
        push_box(&mut scene, dvec3(x, 0.0, 2.6), dvec3(x + 0.8, 0.8, 3.6), 0);
    }
    let eye = dvec3(1.6, 1.6, 2.0);
    let ahead = suggest_view(&Tracer::new(Arc::new(scene), eye), eye);
    assert!(ahead.dot(DVec3::X) > 0.8, "{ahead}");
}

#[test]
fn object_in_front_fills_the_frame() {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    push_box(&mut scene, dvec3(-2.0, 0.0, -2.0), dvec3(2.0, 12.0, 2.0), 0);
    let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
    let eye = place::place_in_front(&tracer);
    let top = ((12.0 - eye.y) / (eye.z - 2.0)).atan().to_degrees();
    assert!((29.0..30.1).contains(&top), "{eye}: {top} degrees");
    assert!((eye.y - 6.0).abs() < 1e-9 && eye.x == 0.0, "{eye}");
}
