//! The cell that contains an eye, in difficult cases.

use glam::dvec3;
use headbox_house::house::House;
use headbox_house::walk_path::WalkPath;

/// Eyes where walls of the built-in house meet, in and very close to planes of portals; and every
/// eye of a walk.
#[test]
fn eye_at_wall_junction_is_in_wall() {
    let house = House::new(headbox_scenes::house(0, 5_000)).expect("a valid model");
    let in_walls = [
        dvec3(10.4823, 1.025, 0.400001),
        dvec3(-13.499999, 1.55, -1.51201),
        dvec3(5.35658, 1.4, -6.98),
        dvec3(10.500001, 1.025, -4.293937),
        dvec3(0.91861, 1.4, -6.999999999),
    ];
    for eye in in_walls {
        assert_eq!(house.find_cell(eye), None, "{eye}");
    }
    let path = WalkPath {
        poses: 200,
        size: [64, 48],
        ..WalkPath::default()
    };
    for camera in path.cameras(&house).expect("valid cameras") {
        assert!(house.find_cell(camera.eye()).is_some(), "{}", camera.eye());
    }
}

/// Files often have inverted surfaces, which must not turn rooms into walls.
#[test]
fn inverted_rooms_are_rooms() {
    let model = headbox_scenes::house(0, 5_000);
    let mut turned = model.clone();
    turned
        .scene
        .triangles
        .iter_mut()
        .for_each(|triangle| triangle.vertices.swap(1, 2));
    let (house, turned) = (
        House::new(model).expect("a valid model"),
        House::new(turned).expect("a valid model"),
    );
    let path = WalkPath {
        poses: 200,
        size: [64, 48],
        ..WalkPath::default()
    };
    for camera in path.cameras(&house).expect("valid cameras") {
        assert_eq!(
            turned.find_cell(camera.eye()),
            house.find_cell(camera.eye()),
            "{}",
            camera.eye()
        );
    }
}
