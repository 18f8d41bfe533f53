//! List of keys.

use crate::input::keymap::{BINDINGS, MOUSE_HELP};
use egui::{Context, Grid, ScrollArea, Ui, vec2};

/// Minimum width for all three lists side by side, points.
const WIDE_POINTS: f32 = 960.0;
/// Minimum width for the two lists of keys side by side, points.
const HALVES_POINTS: f32 = 600.0;

/// Shows the list in its own window while `open`.
pub(crate) fn show(ctx: &Context, open: &mut bool) {
    // Available size without the title and the borders.
    let room = ctx.content_rect().size() - vec2(40.0, 90.0);
    let height = room.y.max(60.0);
    crate::panels::dialog(ctx, "Keys", open)
        .resizable(false)
        .default_height(height)
        .show(ctx, |ui| {
            ScrollArea::vertical().max_height(height).show(ui, |ui| {
                if room.x >= WIDE_POINTS {
                    ui.horizontal_top(|ui| {
                        keys(ui);
                        mouse(ui);
                    });
                } else if room.x >= HALVES_POINTS {
                    ui.horizontal_top(keys);
                    mouse(ui);
                } else {
                    keys(ui);
                    mouse(ui);
                }
            });
        });
}

/// Shows the keys in two lists.
fn keys(ui: &mut Ui) {
    let half = BINDINGS.len().div_ceil(2);
    for (i, column) in BINDINGS.chunks(half).enumerate() {
        let rows = column.iter().map(|binding| (binding.names(), binding.help));
        list(ui, i, rows);
    }
}

fn mouse(ui: &mut Ui) {
    list(
        ui,
        BINDINGS.len(),
        MOUSE_HELP
            .iter()
            .map(|(what, help)| ((*what).to_owned(), *help)),
    );
}

fn list(ui: &mut Ui, id: usize, rows: impl Iterator<Item = (String, &'static str)>) {
    Grid::new(("keys", id))
        .num_columns(2)
        .spacing([14.0, 3.0])
        .show(ui, |ui| {
            for (keys, help) in rows {
                ui.strong(keys);
                ui.label(help);
                ui.end_row();
            }
        });
    ui.add_space(10.0);
}
