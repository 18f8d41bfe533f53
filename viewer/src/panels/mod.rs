//! What surrounds the frame. Each panel is a file: a function of the state it shows, which it changes in place or asks to
//! change by a [`Command`](crate::keymap::Command).

pub(crate) mod camera;
pub(crate) mod chart;
pub(crate) mod display;
pub(crate) mod divider;
pub(crate) mod inset;
pub(crate) mod keys;
pub(crate) mod legend;
pub(crate) mod messages;
pub(crate) mod open;
pub(crate) mod record;
pub(crate) mod room_map;
pub(crate) mod source;
pub(crate) mod start;
pub(crate) mod statistics;
pub(crate) mod status;
pub(crate) mod theme;

use crate::{app::Viewer, keymap::Command};
use egui::{Align2, Button, CollapsingHeader, Context, RichText, Ui, Window};

/// Width of the side panel at first, points.
pub(crate) const WIDTH_POINTS: f32 = 290.0;

/// The side panel, from top to bottom.
pub(crate) fn side(ui: &mut Ui, viewer: &mut Viewer, now_s: f64) {
    let Some(info) = &viewer.info else { return };
    ui.add_space(6.0);
    ui.label(RichText::new(&info.title).heading().strong()).on_hover_text("What is shown.");
    ui.add_space(4.0);
    source::show(ui, &info.settings, &mut viewer.sets, viewer.display.compare, &mut viewer.commands);
    section(ui, "Statistics", true, |ui| statistics::show(ui, viewer.shown.as_ref(), &viewer.history));
    section(ui, "Camera", true, |ui| {
        camera::show(ui, &mut viewer.eye, info.bounds.as_ref(), now_s, &mut viewer.commands);
    });
    section(ui, "Display", true, |ui| {
        display::show(ui, &mut viewer.display, &mut viewer.sets, viewer.policy.moving_scale());
    });
    section(ui, "Record", false, |ui| {
        record::show(ui, &mut viewer.tape, viewer.exporting, &viewer.options.output_dir, now_s, &mut viewer.commands);
    });
    ui.add_space(6.0);
    ui.horizontal(|ui| {
        let open = viewer.start_page.has_library();
        if open && ui.button("Open…").on_hover_text("Opens another file (O); files can also be dropped here.").clicked()
        {
            viewer.commands.push(Command::ShowOpen);
        }
        button(ui, "Keys", "Lists the keys (F1).", Command::ToggleKeys, &mut viewer.commands);
        button(ui, "Hide", "Hides the panels (H brings them back).", Command::TogglePanels, &mut viewer.commands);
    });
}

/// A window over the frame, at first in the middle of it.
pub(crate) fn dialog<'a>(ctx: &Context, title: &'a str, open: &'a mut bool) -> Window<'a> {
    let middle = ctx.content_rect().center();
    Window::new(title).open(open).collapsible(false).pivot(Align2::CENTER_CENTER).default_pos(middle)
}

/// A part of the side panel that can be folded away.
pub(crate) fn section(ui: &mut Ui, title: &str, open: bool, contents: impl FnOnce(&mut Ui)) {
    CollapsingHeader::new(RichText::new(title).strong()).default_open(open).show(ui, contents);
}

/// A button that asks for a command.
pub(crate) fn button(ui: &mut Ui, text: &str, tooltip: &str, command: Command, commands: &mut Vec<Command>) {
    enabled_button(ui, true, text, tooltip, command, commands);
}

/// A button that may be greyed out.
pub(crate) fn enabled_button(
    ui: &mut Ui,
    enabled: bool,
    text: &str,
    tooltip: &str,
    command: Command,
    commands: &mut Vec<Command>,
) {
    let response = ui.add_enabled(enabled, Button::new(text)).on_hover_text(tooltip).on_disabled_hover_text(tooltip);
    if response.clicked() {
        commands.push(command);
    }
}
