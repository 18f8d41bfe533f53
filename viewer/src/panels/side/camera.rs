//! Camera panels: how the eye moves, and its numbers.

use crate::input::bounds::EyeBounds;
use crate::input::keymap::Command;
use crate::input::pose::Pose;
use crate::input::steering::Eye;
use crate::panels::button;
use crate::thread::exchange::SourceInfo;
use egui::{Button, Checkbox, DragValue, Slider, Ui};
use headbox_core::file_frame::FileFrame;
use headbox_core::view::Navigation;

/// Shows the navigation mode, the way back to the start, and the field of view.
pub(crate) fn show(
    ui: &mut Ui,
    eye: &mut Eye,
    info: &SourceInfo,
    navigation: Navigation,
    now_s: f64,
    commands: &mut Vec<Command>,
) {
    ui.horizontal(|ui| {
        if !matches!(info.navigation, Navigation::Orbit { .. }) {
            let (name, tip) = if info.navigation == Navigation::Walk {
                ("Walk", "The keys move the eye on one level (V switches).")
            } else {
                ("Fly", "The keys move the eye where it looks (V switches).")
            };
            let orbits = matches!(navigation, Navigation::Orbit { .. });
            let mut mode = |name: &str, tip: &str, is_on: bool| {
                let clicked = ui.add(Button::selectable(is_on, name)).on_hover_text(tip).clicked();
                if clicked && !is_on {
                    commands.push(Command::ToggleOrbit);
                }
            };
            mode(name, tip, !orbits);
            let tip = "A drag circles the point in the middle of the frame (V switches).";
            mode("Orbit", tip, orbits);
        }
        let tip = "Back to where the view started (Home, C, or a double click). G looks at what is under the \
                   pointer, and approaches it.";
        button(ui, "Centre", tip, Command::Centre, commands);
    });
    let mut fov = eye.pose.fov_y_deg;
    let slider = Slider::new(&mut fov, Pose::FOV_Y_DEG)
        .suffix("°")
        .max_decimals(1)
        .text("View");
    let slider = ui
        .add(slider)
        .on_hover_text("Vertical field of view in degrees (mouse wheel).");
    // The slider rounds the values of a flight, too: that is no change by the user.
    if slider.changed() && eye.flight.is_none() {
        eye.pose.fov_y_deg = fov;
        stop(eye, now_s);
    }
}

/// Shows position, direction and speed. Positions are in the axes and unit of the scene's file,
/// like those of the command line; the eye stays inside `bounds`.
pub(crate) fn show_numbers(
    ui: &mut Ui,
    eye: &mut Eye,
    bounds: Option<&EyeBounds>,
    frame: &FileFrame,
    now_s: f64,
) {
    // A control may round the value that it shows, so only changed values are applied.
    let mut moved = false;
    ui.horizontal(|ui| {
        let before = eye.pose.eye;
        let unit = frame.unit_name().map_or(String::new(), |unit| format!(" {unit}"));
        let decimals = frame.millimetre_decimals();
        for (i, name) in ["X", "Y", "Z"].into_iter().enumerate() {
            let mut wanted = frame.file_from_world(before);
            let value = DragValue::new(&mut wanted[i])
                .speed(0.005 / frame.unit_m)
                .fixed_decimals(decimals)
                .suffix(&unit);
            let tip = format!(
                "{name} of the eye, in the axes and unit of the scene's file ({} points up), as in --eye.",
                frame.up
            );
            if ui.add(value).on_hover_text(tip).changed() {
                let by = frame.world_from_file(wanted) - before;
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
    });
    ui.add(Slider::new(&mut eye.speed_m_per_s, 0.001..=100.0).logarithmic(true).suffix(" m/s").text("Speed"))
        .on_hover_text(
            "Speed of the eye with a key held, in metres per second; shift is 4 times as fast, alt as slow.",
        );
    ui.add(Checkbox::new(&mut eye.grab_scene, "Drag moves the scene"))
        .on_hover_text(
            "On: what is under the pointer follows it. Off: the head turns with the pointer.",
        );
    if moved {
        stop(eye, now_s);
    }
}

/// Ends all motion, since the user has set the pose.
fn stop(eye: &mut Eye, now_s: f64) {
    eye.motion.stop();
    eye.flight = None;
    eye.moved_s = now_s;
}

fn angle(degrees: &mut f64) -> DragValue<'_> {
    DragValue::new(degrees)
        .speed(0.25)
        .fixed_decimals(1)
        .suffix("°")
}
