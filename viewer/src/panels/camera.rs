//! The eye in numbers.

use super::button;
use crate::{app::Eye, bounds::EyeBounds, keymap::Command, pose::Pose};
use egui::{Checkbox, DragValue, Slider, Ui};
use glam::DVec3;

/// The controls; the eye stays inside `bounds`.
pub(crate) fn show(ui: &mut Ui, eye: &mut Eye, bounds: Option<&EyeBounds>, now_s: f64, commands: &mut Vec<Command>) {
    let before = eye.pose;
    let mut wanted = before.eye;
    ui.horizontal(|ui| {
        let names = ["X (right)", "Y (up)", "Z (back)"];
        for (i, name) in names.into_iter().enumerate() {
            let value = DragValue::new(&mut wanted[i]).speed(0.005).fixed_decimals(3).suffix(" m");
            ui.add(value).on_hover_text(format!("{name} of the eye in the world, in metres."));
        }
    });
    if wanted != before.eye {
        let by = wanted - before.eye;
        eye.pose.eye = bounds.map_or(wanted, |bounds| bounds.soft_move(before.eye, by));
    }
    ui.horizontal(|ui| {
        let mut angles = [before.yaw_rad.to_degrees(), before.pitch_rad.to_degrees()];
        let names =
            ["Heading of the eye in degrees, 0 along -Z, positive to the left.", "Tilt in degrees, positive up."];
        for (angle, name) in angles.iter_mut().zip(names) {
            ui.add(DragValue::new(angle).speed(0.25).fixed_decimals(1).suffix("°")).on_hover_text(name);
        }
        let turn = [angles[0].to_radians() - before.yaw_rad, angles[1].to_radians() - before.pitch_rad];
        // A conversion to degrees and back is no turn.
        if turn.iter().any(|t| t.abs() > 1e-9) {
            eye.pose = eye.pose.turned(turn[0], turn[1]);
        }
        button(ui, "Centre", "Back to where the view started (Home, C, or a double click).", Command::Centre, commands);
    });
    ui.add(Slider::new(&mut eye.pose.fov_y_deg, Pose::FOV_Y_DEG).suffix("°").max_decimals(1).text("View"))
        .on_hover_text("Vertical field of view in degrees (mouse wheel).");
    ui.add(Slider::new(&mut eye.speed_m_per_s, 0.001..=100.0).logarithmic(true).suffix(" m/s").text("Speed"))
        .on_hover_text(
            "Speed of the eye with a key held, in metres per second; shift is 4 times as fast, alt as slow.",
        );
    ui.add(Checkbox::new(&mut eye.grab_scene, "Drag moves the scene"))
        .on_hover_text("On: what is under the pointer follows it. Off: the head turns with the pointer.");
    let forward = eye.pose.forward();
    ui.weak(format!("looks along {}", vector(forward)))
        .on_hover_text("Unit vector of the viewing direction in world axes (no unit).");
    if eye.pose != before {
        eye.motion.stop();
        eye.moved_s = now_s;
    }
}

fn vector(v: DVec3) -> String {
    format!("{:.2}, {:.2}, {:.2}", v.x, v.y, v.z)
}
