//! Status line below the frame.

use crate::input::pose::Pose;
use crate::playback::path_recorder::PathRecorder;
use crate::thread::exchange::FinishedFrame;
use egui::{Align, Layout, Ui};
use headbox_core::file_frame::FileFrame;

/// Shows the eye's position in the axes and unit of the scene's file, the frame's size, the frame
/// rate, and what Enter would capture.
pub(crate) fn show(
    ui: &mut Ui,
    pose: &Pose,
    frame: &FileFrame,
    shown: Option<&FinishedFrame>,
    recorder: &PathRecorder,
    capture_hint: Option<&str>,
) {
    ui.horizontal(|ui| {
        let [x, y, z] = frame.file_from_world(pose.eye).to_array();
        let decimals = frame.millimetre_decimals();
        let unit = frame.unit_name().unwrap_or_default();
        ui.monospace(format!("eye {x:8.decimals$} {y:8.decimals$} {z:8.decimals$} {unit}"))
            .on_hover_text(
                "Position of the eye in the axes and unit of the scene's file, as in --eye.",
            );
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
            if let Some(hint) = capture_hint {
                ui.colored_label(super::theme::WARNING, hint).on_hover_text(
                    "Outside of the headbox the scene is shown without light. Enter captures the headbox that was placed (N), \
                     or one about the eye.",
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
