//! Bookmarks panel: named views of the file.

use crate::input::keymap::Command;
use crate::panels::button;
use crate::playback::bookmarks::Bookmarks;
use egui::{Button, Key, TextEdit, Ui, vec2};

/// Shows the list, and a field for the name of a new bookmark.
pub(crate) fn show(ui: &mut Ui, bookmarks: &Bookmarks, commands: &mut Vec<Command>) {
    for (index, bookmark) in bookmarks.list().iter().enumerate() {
        ui.horizontal(|ui| {
            let remove = ui
                .small_button("Remove")
                .on_hover_text("Removes this bookmark.");
            if remove.clicked() {
                commands.push(Command::RemoveBookmark(index));
            }
            let key = if index < 9 {
                format!("{}  ", index + 1)
            } else {
                String::new()
            };
            let row = Button::selectable(false, format!("{key}{}", bookmark.name))
                .truncate()
                .min_size(vec2(ui.available_width(), 0.0));
            let tip = "Goes to this view (its number key).";
            if ui.add(row).on_hover_text(tip).clicked() {
                commands.push(Command::GoToBookmark(index));
            }
        });
    }
    let id = ui.scope_id().with("bookmark name");
    let mut name: String = ui.data_mut(|data| data.get_temp(id).unwrap_or_default());
    let mut added = Vec::new();
    ui.horizontal(|ui| {
        let field = TextEdit::singleline(&mut name)
            .hint_text("Name")
            .desired_width(150.0);
        let field = ui.add(field).on_hover_text("Name of a new bookmark.");
        if field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter)) {
            added.push(Command::AddBookmark(name.clone()));
        }
        let add = Command::AddBookmark(name.clone());
        button(ui, "Add", "Bookmarks this view (M).", add, &mut added);
    });
    if !added.is_empty() {
        name.clear();
    }
    commands.extend(added);
    ui.data_mut(|data| data.insert_temp(id, name));
}
