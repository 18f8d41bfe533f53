//! Status line below the frame.

use crate::input::pose::Pose;
use crate::playback::path_recorder::PathRecorder;
use crate::thread::exchange::FinishedFrame;
use egui::{Align, Layout, Ui};

/// Shows the eye's position, the frame's size, and the frame rate.
pub(crate) fn show(
    ui: &mut Ui,
    pose: &Pose,
    shown: Option<&FinishedFrame>,
    recorder: &PathRecorder,
) {
    ui.horizontal(|ui| {
        let eye = pose.eye;
        ui.monospace(format!("eye {:8.3} {:8.3} {:8.3} m", eye.x, eye.y, eye.z))
            .on_hover_text("Position of the eye: right, up, back, in metres.");
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            ui.weak("F1: keys").on_hover_text("F1 lists the keys.");
            if let Some(shown) = shown {
                let (size, ms) = (shown.pictures[0].image.size, shown.render_ms);
                let share = if shown.job.scale < 1.0 { format!(" ({:.0} %)", shown.job.scale * 100.0) } else { String::new() };
                ui.monospace(format!("{}x{} px{share}  {ms:5.1} ms", size[0], size[1])).on_hover_text(
                    "Size of each rendered picture in pixels (share of the window's, in % of each side), and milliseconds \
                     for the frame.",
                );
            }
            if let Some(poses) = recorder.recorded() {
                ui.colored_label(super::theme::WARNING, format!("recording, {poses} poses"))
                    .on_hover_text("The eye's path is being recorded (R stops).");
            }
            if recorder.is_playing() {
                ui.colored_label(super::theme::ACCENT, "replaying").on_hover_text("A path is replayed (Space stops).");
            }
        });
    });
}
