//! Panels around the frame. Each is a file: a function of the state it shows, which it changes in
//! place or by a [`Command`](crate::input::keymap::Command).

pub(crate) mod dialogs;
pub(crate) mod overlay;
pub(crate) mod side;
pub(crate) mod start;
pub(crate) mod status;
pub(crate) mod theme;

use crate::input::keymap::Command;
use egui::{Align2, Button, CollapsingHeader, Context, RichText, Ui, Window};

/// Creates a window over the frame, initially in its centre.
pub(crate) fn dialog<'a>(ctx: &Context, title: &'a str, open: &'a mut bool) -> Window<'a> {
    let middle = ctx.content_rect().center();
    Window::new(title)
        .open(open)
        .collapsible(false)
        .pivot(Align2::CENTER_CENTER)
        .default_pos(middle)
}

/// Shows a collapsible section of the side panel.
pub(crate) fn section(ui: &mut Ui, title: &str, open: bool, contents: impl FnOnce(&mut Ui)) {
    CollapsingHeader::new(RichText::new(title).strong())
        .default_open(open)
        .show(ui, contents);
}

/// Shows a button that issues a command.
pub(crate) fn button(
    ui: &mut Ui,
    text: &str,
    tooltip: &str,
    command: Command,
    commands: &mut Vec<Command>,
) {
    enabled_button(ui, true, text, tooltip, command, commands);
}

/// Shows a button that may be disabled.
pub(crate) fn enabled_button(
    ui: &mut Ui,
    enabled: bool,
    text: &str,
    tooltip: &str,
    command: Command,
    commands: &mut Vec<Command>,
) {
    let response = ui
        .add_enabled(enabled, Button::new(text))
        .on_hover_text(tooltip)
        .on_disabled_hover_text(tooltip);
    if response.clicked() {
        commands.push(command);
    }
}
