//! Camera panel: position, direction and field of view of the eye.

use super::button;
use crate::input::bounds::EyeBounds;
use crate::input::keymap::Command;
use crate::input::pose::Pose;
use crate::input::steering::Eye;
use egui::{Checkbox, DragValue, Slider, Ui};
use glam::DVec3;

/// Shows the controls; the eye stays inside `bounds`.
pub(crate) fn show(
    ui: &mut Ui,
    eye: &mut Eye,
    bounds: Option<&EyeBounds>,
    now_s: f64,
    commands: &mut Vec<Command>,
) {
    // A control may round the value that it shows, so only changed values are applied.
    let mut moved = false;
    ui.horizontal(|ui| {
        let names = ["X (right)", "Y (up)", "Z (back)"];
        let before = eye.pose.eye;
        let mut wanted = before;
        for (i, name) in names.into_iter().enumerate() {
            let value = DragValue::new(&mut wanted[i])
                .speed(0.005)
                .fixed_decimals(3)
                .suffix(" m");
            let response = ui
                .add(value)
                .on_hover_text(format!("{name} of the eye in the world, in metres."));
            if response.changed() {
                let by = DVec3::AXES[i] * (wanted[i] - before[i]);
                eye.pose.eye = bounds.map_or(before + by, |bounds| bounds.soft_move(before, by));
                moved = true;
            }
        }
    });
    ui.horizontal(|ui| {
        let (mut yaw, mut pitch) = (
            eye.pose.yaw_rad.to_degrees(),
            eye.pose.pitch_rad.to_degrees(),
        );
        let tip = "Heading of the eye in degrees, 0 along -Z, positive to the left.";
        if ui.add(angle(&mut yaw)).on_hover_text(tip).changed() {
            eye.pose = eye.pose.turned(yaw.to_radians() - eye.pose.yaw_rad, 0.0);
            moved = true;
        }
        if ui
            .add(angle(&mut pitch))
            .on_hover_text("Tilt in degrees, positive up.")
            .changed()
        {
            eye.pose = eye
                .pose
                .turned(0.0, pitch.to_radians() - eye.pose.pitch_rad);
            moved = true;
        }
        button(
            ui,
            "Centre",
            "Back to where the view started (Home, C, or a double click).",
            Command::Centre,
            commands,
        );
    });
    let mut fov = eye.pose.fov_y_deg;
    let slider = Slider::new(&mut fov, Pose::FOV_Y_DEG)
        .suffix("°")
        .max_decimals(1)
        .text("View");
    if ui
        .add(slider)
        .on_hover_text("Vertical field of view in degrees (mouse wheel).")
        .changed()
    {
        eye.pose.fov_y_deg = fov;
        moved = true;
    }
    ui.add(Slider::new(&mut eye.speed_m_per_s, 0.001..=100.0).logarithmic(true).suffix(" m/s").text("Speed"))
        .on_hover_text(
            "Speed of the eye with a key held, in metres per second; shift is 4 times as fast, alt as slow.",
        );
    ui.add(Checkbox::new(&mut eye.grab_scene, "Drag moves the scene"))
        .on_hover_text(
            "On: what is under the pointer follows it. Off: the head turns with the pointer.",
        );
    if moved {
        eye.motion.stop();
        eye.moved_s = now_s;
    }
}

fn angle(degrees: &mut f64) -> DragValue<'_> {
    DragValue::new(degrees)
        .speed(0.25)
        .fixed_decimals(1)
        .suffix("°")
}
