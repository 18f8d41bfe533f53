//! Start page, shown while there is no source.

use crate::input::keymap::Command;
use crate::panels::dialogs::open::row;
use crate::panels::theme;
use crate::playback::recent::RecentFiles;
use crate::source::{Entry, Thumbnail};
use crate::thread::exchange::Location;
use crate::thread::session::Opening;
use egui::{
    Align, Button, Color32, Context, Layout, RichText, Sense, TextureHandle, Ui, UiBuilder, vec2,
};
use std::time::Duration;

/// Size of a card's thumbnail, points.
const CARD_POINTS: egui::Vec2 = vec2(200.0, 150.0);

const CARD_GAP_POINTS: f32 = 24.0;

/// Width of a row of the recent files, points.
const ROW_POINTS: f32 = 420.0;

/// Interval at which the elapsed opening time is updated.
const SECOND: Duration = Duration::from_secs(1);

/// State of the page.
#[derive(Default)]
pub(crate) struct StartPage {
    /// True if this window can open files.
    pub has_library: bool,
    /// Entries with their thumbnails, once these are rendered.
    pub cards: Vec<(Entry, Option<TextureHandle>)>,
}

impl StartPage {
    /// Returns true if there are entries and all have thumbnails.
    pub(crate) fn has_all_thumbnails(&self) -> bool {
        !self.cards.is_empty() && self.cards.iter().all(|(_, picture)| picture.is_some())
    }

    pub(crate) fn set_entries(&mut self, entries: Vec<Entry>) {
        self.cards = entries.into_iter().map(|entry| (entry, None)).collect();
    }

    pub(crate) fn set_thumbnail(&mut self, ctx: &Context, id: &str, thumbnail: &Thumbnail) {
        let card = self.cards.iter_mut().find(|(entry, _)| entry.id == id);
        let texture = thumbnail.texture(ctx, &format!("thumbnail {id}"));
        if let (Some((_, picture)), Some(texture)) = (card, texture) {
            *picture = Some(texture);
        }
    }
}

/// Shows the library and the recent files, or the name of the source that is being opened.
pub(crate) fn show(
    ui: &mut Ui,
    page: &mut StartPage,
    opening: Option<&Opening>,
    recent: &mut RecentFiles,
    commands: &mut Vec<Command>,
) {
    if opening.is_some() || !page.has_library {
        let text = opening.map_or_else(
            || "Opening…".into(),
            |opening| {
                format!(
                    "Opening {}… {} s",
                    opening.name,
                    opening.since.elapsed().as_secs()
                )
            },
        );
        let text = egui::Label::new(RichText::new(text).heading()).wrap();
        ui.centered_and_justified(|ui| ui.add(text));
        ui.ctx().request_repaint_after(SECOND);
        return;
    }
    ui.with_layout(Layout::top_down(Align::Center), |ui| {
        ui.add_space(40.0);
        ui.label(RichText::new("headbox").size(34.0).color(Color32::WHITE));
        ui.label("Choose a scene, open a file, or drop one here.");
        ui.add_space(10.0);
        let tip = "Lists the files of a folder (O).";
        if ui
            .add(Button::new("Open a file…"))
            .on_hover_text(tip)
            .clicked()
        {
            commands.push(Command::ShowOpen);
        }
        ui.add_space(14.0);
        egui::ScrollArea::vertical().show(ui, |ui| {
            recent_files(ui, recent, commands);
            let across = CARD_POINTS.x + CARD_GAP_POINTS;
            let columns =
                ((ui.available_width() / across) as usize).clamp(1, page.cards.len().max(1));
            let margin =
                ((ui.available_width() - across * columns as f32 + CARD_GAP_POINTS) / 2.0).max(0.0);
            for row in page.cards.chunks(columns) {
                ui.horizontal_top(|ui| {
                    ui.spacing_mut().item_spacing.x = 0.0;
                    ui.add_space(margin);
                    for (entry, picture) in row {
                        if card(ui, entry, picture.as_ref()) {
                            commands.push(Command::Open(Location::Entry(entry.id.clone())));
                        }
                        ui.add_space(CARD_GAP_POINTS);
                    }
                });
            }
        });
    });
}

/// Shows the recent files, one row each.
fn recent_files(ui: &mut Ui, recent: &mut RecentFiles, commands: &mut Vec<Command>) {
    let recent = recent.with_thumbnails(ui.ctx());
    if recent.is_empty() {
        return;
    }
    ui.strong("Opened last");
    let width = ROW_POINTS.min(ui.available_width() - 16.0).max(0.0);
    for (path, picture) in recent {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let tip = format!("Opens {}.", path.display());
        let clicked = ui.scope(|ui| {
            ui.set_max_width(width);
            row(ui, picture.as_ref(), &name, &tip)
        });
        if clicked.inner {
            commands.push(Command::Open(Location::File(path)));
        }
    }
    ui.add_space(14.0);
}

/// Shows an entry as a card that is clickable everywhere; returns true if it was clicked.
fn card(ui: &mut Ui, entry: &Entry, picture: Option<&TextureHandle>) -> bool {
    let whole = UiBuilder::new()
        .id_salt(&entry.id)
        .layout(Layout::top_down(Align::Min))
        .sense(Sense::click());
    let card = ui.scope_builder(whole, |ui| {
        ui.set_width(CARD_POINTS.x);
        let (rect, _) = ui.allocate_exact_size(CARD_POINTS, Sense::hover());
        let whole = egui::Rect::from_min_max(egui::Pos2::ZERO, egui::pos2(1.0, 1.0));
        ui.painter().rect_filled(rect, 4.0, Color32::from_gray(34));
        if let Some(picture) = picture {
            ui.painter()
                .image(picture.id(), rect, whole, Color32::WHITE);
        }
        if ui.response().contains_pointer() {
            let stroke = egui::Stroke::new(2.0, theme::ACCENT);
            ui.painter()
                .rect_stroke(rect, 4.0, stroke, egui::StrokeKind::Outside);
        }
        let name = ui
            .add(Button::new(&entry.name))
            .on_hover_text(&entry.description);
        ui.add(egui::Label::new(RichText::new(&entry.description).weak()).wrap());
        ui.add_space(14.0);
        name.clicked()
    });
    let response = card
        .response
        .on_hover_text(format!("Opens {}: {}", entry.name, entry.description));
    response.clicked() || card.inner
}
