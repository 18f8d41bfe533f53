//! Record panel: saves frames, cameras and paths; loads and replays paths.

use crate::input::keymap::Command;
use crate::panels::{button, enabled_button};
use crate::playback::path_recorder::{PathRecorder, ReplayMode};
use egui::{Checkbox, ProgressBar, TextEdit, Ui};
use std::path::PathBuf;

/// Shows the controls.
pub(crate) fn show(
    ui: &mut Ui,
    recorder: &mut PathRecorder,
    exporting: Option<[usize; 2]>,
    now_s: f64,
    commands: &mut Vec<Command>,
) {
    ui.horizontal(|ui| {
        button(ui, "Save frame…", "Asks where to write the frame as PNG, in pixels of the window (P).", Command::SaveFrame, commands);
        let tip = "Writes eye, look-at point (in the scene file's unit), field of view (degrees) and size (pixels) as \
                   JSON, in the words of the command line (K).";
        button(ui, "Save camera…", tip, Command::SaveCamera, commands);
    });
    ui.horizontal(|ui| {
        let (text, tip) = match recorder.recorded() {
            Some(poses) => (format!("Stop ({poses} poses)"), "Ends the recording (R)."),
            None => (
                "Record".into(),
                "Records the eye's path, 30 poses a second at most (R).",
            ),
        };
        button(ui, &text, tip, Command::ToggleRecording, commands);
        let (text, tip) = if recorder.is_playing() {
            ("Stop replay", "Ends the replay (Space).")
        } else {
            (
                "Replay",
                "Replays the path, at its own speed in seconds or pose by pose (Space).",
            )
        };
        enabled_button(
            ui,
            recorder.path.is_some(),
            text,
            tip,
            Command::TogglePlayback,
            commands,
        );
        ui.add(Checkbox::new(&mut recorder.repeat, "Repeat"))
            .on_hover_text("Replays again and again.");
    });
    ui.horizontal(|ui| {
        ui.selectable_value(&mut recorder.mode, ReplayMode::InTime, "In time")
            .on_hover_text(
                "Replays at the path's own speed, in seconds; frames that are late are left out.",
            );
        ui.selectable_value(&mut recorder.mode, ReplayMode::EveryPose, "Every pose")
            .on_hover_text("Shows each pose once, however many milliseconds its frame takes.");
    });
    match (recorder.progress(now_s), &recorder.path) {
        (Some(share), _) => {
            ui.add(ProgressBar::new(share as f32).desired_height(6.0))
                .on_hover_text("Share of the path replayed.");
        }
        (None, Some(path)) => {
            ui.weak(format!(
                "{} poses, {:.1} s",
                path.poses().len(),
                path.duration_s()
            ))
            .on_hover_text("The path in hand: number of poses and duration in seconds.");
        }
        (None, None) => {}
    }
    path_files(ui, recorder, exporting, commands);
}

fn path_files(
    ui: &mut Ui,
    recorder: &PathRecorder,
    exporting: Option<[usize; 2]>,
    commands: &mut Vec<Command>,
) {
    let has_path = recorder.path.is_some();
    ui.horizontal(|ui| {
        let tip = "Writes the path as JSON: times in seconds, cameras in the words of the command line.";
        enabled_button(ui, has_path, "Save path…", tip, Command::SavePath, commands);
        if exporting.is_some() {
            button(ui, "Stop rendering", "Leaves out the frames not yet written.", Command::CancelExport, commands);
        } else {
            let tip =
                "Renders every pose of the path with the settings of A to a numbered PNG, in pixels of the window.";
            enabled_button(ui, has_path, "Render path…", tip, Command::ExportPath, commands);
        }
    });
    if let Some([done, total]) = exporting {
        ui.add(
            ProgressBar::new(done as f32 / total.max(1) as f32)
                .text(format!("{done} of {total} frames")),
        )
        .on_hover_text("Frames written.");
    }
    let id = ui.scope_id().with("path file");
    let mut file: String = ui.data_mut(|data| data.get_temp(id).unwrap_or_default());
    ui.horizontal(|ui| {
        let field = TextEdit::singleline(&mut file)
            .hint_text("path.json")
            .desired_width(150.0);
        let field = ui.add(field).on_hover_text("A path file (JSON) to load.");
        let enter = field.lost_focus() && ui.input(|i| i.key_pressed(egui::Key::Enter));
        let tip = "Loads the path file named on the left.";
        let load = ui
            .add_enabled(!file.is_empty(), egui::Button::new("Load path"))
            .on_hover_text(tip);
        if load.on_disabled_hover_text(tip).clicked() || (enter && !file.is_empty()) {
            commands.push(Command::LoadPath(PathBuf::from(&file)));
        }
    });
    ui.data_mut(|data| data.insert_temp(id, file));
}
