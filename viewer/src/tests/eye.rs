use super::*;
use egui::{Event, Key, Modifiers, MouseWheelUnit, Pos2, vec2};
use glam::DVec3;

const IN_FRAME: Pos2 = Pos2::new(450.0, 300.0);

#[test]
fn keys_move_the_eye_and_home_brings_it_back() {
    let mut window = room();
    let start = window.state().eye.pose;
    window.key_down(Key::W);
    window.run_steps(15);
    window.key_up(Key::W);
    settle(&mut window);
    let moved = window.state().eye.pose;
    let way = moved.eye - start.eye;
    assert!(
        way.normalize().distance(start.forward()) < 1e-6,
        "W follows the view: {way}"
    );
    assert!(way.length() > 0.05, "{way}");
    press(&mut window, Key::Home);
    assert_eq!(window.state().eye.pose, start);
}

#[test]
fn headbox_edge_stops_eye() {
    let mut window = room();
    window.key_down(Key::D);
    window.event(Event::ModifiersChanged(Modifiers::SHIFT));
    window.run_steps(300);
    let eye = window.state().eye.pose.eye;
    let bounds = window.state().info.as_ref().unwrap().bounds.unwrap();
    assert!(
        bounds.contains(eye) && bounds.edge_share(eye) > 0.99,
        "{eye}"
    );
}

#[test]
fn dragging_looks_around_and_the_wheel_changes_the_field_of_view() {
    let mut window = room();
    let start = window.state().eye.pose;
    window.drag_at(IN_FRAME);
    window.step();
    window.hover_at(IN_FRAME + vec2(100.0, 0.0));
    window.step();
    window.drop_at(IN_FRAME + vec2(100.0, 0.0));
    window.step();
    let turned = window.state().eye.pose;
    assert!(
        turned.yaw_rad < start.yaw_rad,
        "the head follows the pointer to the right"
    );
    assert_eq!((turned.eye, turned.pitch_rad), (start.eye, start.pitch_rad));
    window.hover_at(IN_FRAME);
    window.step();
    let (unit, delta, phase) = (MouseWheelUnit::Line, vec2(0.0, 3.0), egui::TouchPhase::Move);
    window.event(Event::MouseWheel {
        unit,
        delta,
        phase,
        modifiers: Modifiers::NONE,
        source: egui::MouseWheelSource::Wheel,
    });
    window.run_steps(30);
    assert!(window.state().eye.pose.fov_y_deg < start.fov_y_deg);
}

#[test]
fn an_orbiting_eye_keeps_looking_at_its_pivot() {
    let mut window = room_with(Kind::Orbit, ViewerOptions::default());
    let crate::Navigation::Orbit { pivot, .. } = window.state().info.as_ref().unwrap().navigation
    else {
        unreachable!()
    };
    let distance = window.state().eye.pose.eye.distance(pivot);
    window.drag_at(IN_FRAME);
    window.step();
    window.hover_at(IN_FRAME + vec2(60.0, 30.0));
    window.step();
    let pose = window.state().eye.pose;
    assert!(pose.eye != DVec3::ZERO && (pose.eye.distance(pivot) - distance).abs() < 1e-9);
    assert!(pose.forward().distance((pivot - pose.eye).normalize()) < 1e-9);
}

#[test]
fn typing_does_not_move_eye() {
    let mut window = room();
    click(&mut window, "Record");
    let start = window.state().eye.pose;
    window
        .get_by(|node| node.role() == egui::accesskit::Role::TextInput)
        .focus();
    window.run_steps(2);
    assert!(window.ctx.text_edit_focused());
    window.key_down(Key::W);
    press(&mut window, Key::X);
    window.run_steps(10);
    assert_eq!(window.state().eye.pose, start);
    assert_eq!(window.state().display.stereo, crate::Stereo::Off);
}

#[test]
fn resting_eye_requests_no_frames() {
    let mut window = room();
    settle(&mut window);
    let jobs = window.state().jobs_issued;
    window.run_steps(50);
    assert_eq!(window.state().jobs_issued, jobs);
    assert!(
        window
            .output()
            .viewport_output
            .values()
            .all(|v| v.repaint_delay > Duration::from_secs(1)),
        "nor for passes"
    );
}

/// Angle of half a pixel in the windows of these tests, and the noise of `f32`, radians.
const POINTING_TOLERANCE_RAD: f64 = 4e-3;

#[test]
fn the_eye_orbits_the_point_in_the_middle() {
    let mut window = room();
    settle(&mut window);
    let start = window.state().eye.pose;
    press(&mut window, Key::V);
    wait(&mut window, "the pivot", |viewer| {
        viewer.eye.orbit.is_some()
    });
    let pivot = window.state().eye.orbit.unwrap();
    let to_pivot = pivot - start.eye;
    assert!(to_pivot.normalize().distance(start.forward()) < POINTING_TOLERANCE_RAD);
    // The front wall is 4 m away; the ball stands before it.
    assert!((1.0..4.2).contains(&to_pivot.length()), "{pivot}");
    window.drag_at(IN_FRAME);
    window.step();
    window.hover_at(IN_FRAME + vec2(100.0, 0.0));
    window.step();
    window.drop_at(IN_FRAME + vec2(100.0, 0.0));
    window.step();
    let pose = window.state().eye.pose;
    assert!(pose.eye.distance(start.eye) > 0.05, "{}", pose.eye);
    assert!(pose.forward().distance((pivot - pose.eye).normalize()) < 1e-6);
    press(&mut window, Key::V);
    window.run_steps(5);
    assert_eq!(window.state().eye.orbit, None);
}

#[test]
fn g_approaches_what_is_under_the_pointer() {
    let mut window = room();
    settle(&mut window);
    let start = window.state().eye.pose;
    let at = Pos2::new(600.0, 900.0);
    window.hover_at(at);
    window.run_steps(2);
    let [x, y] = window.state().pointed.unwrap();
    let [width, height] = size_px(&window);
    let camera = start.camera(width, height).unwrap();
    let ray = camera
        .direction(x * f64::from(width), y * f64::from(height))
        .normalize();
    press(&mut window, Key::G);
    wait(&mut window, "the flight", |viewer| {
        viewer.eye.flight.is_some()
    });
    wait(&mut window, "its end", |viewer| viewer.eye.flight.is_none());
    let pose = window.state().eye.pose;
    assert!(pose.forward().distance(ray) < POINTING_TOLERANCE_RAD);
    let way = pose.eye - start.eye;
    assert!(way.normalize().distance(ray) < POINTING_TOLERANCE_RAD);
    let bounds = window.state().info.as_ref().unwrap().bounds.unwrap();
    assert!(way.length() > 0.2 && bounds.contains(pose.eye), "{way}");
}

#[test]
fn a_bookmark_brings_the_eye_back() {
    let mut window = room();
    window.key_down(Key::W);
    window.run_steps(10);
    window.key_up(Key::W);
    settle(&mut window);
    let marked = window.state().eye.pose;
    press(&mut window, Key::M);
    press(&mut window, Key::Home);
    press(&mut window, Key::Num2);
    assert_eq!(texts(&window)[1], "There is no bookmark 2: M adds one.");
    press(&mut window, Key::Num1);
    wait(&mut window, "the flight", |viewer| {
        viewer.eye.flight.is_none()
    });
    settle(&mut window);
    let pose = window.state().eye.pose;
    assert!(pose.eye.distance(marked.eye) < 1e-9, "{}", pose.eye);
    assert!(pose.forward().distance(marked.forward()) < 1e-9);
}

#[test]
fn plus_and_minus_change_the_exposure() {
    let mut window = room();
    settle(&mut window);
    let stops = |window: &Window| window.state().sets.a.number("exposure").unwrap();
    let middle = |window: &Window| {
        let image = &window.state().shown.as_ref().unwrap().pictures[0].image;
        image.pixels[image.pixels.len() / 2].g()
    };
    let before = middle(&window);
    for _ in 0..3 {
        press(&mut window, Key::Minus);
    }
    settle(&mut window);
    assert!((stops(&window) + 1.0).abs() < 1e-9);
    assert_eq!(middle(&window), before / 2);
    for _ in 0..100 {
        press(&mut window, Key::Plus);
    }
    assert_eq!(stops(&window), 16.0, "the end of the range");
}
