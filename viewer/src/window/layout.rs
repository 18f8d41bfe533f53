//! Layout: the panels around the frame, and the parts of the window's state that each shows and
//! changes.

use crate::input::keymap::Command;
use crate::panels::side::{bookmarks, camera, display, headbox, record, source, statistics};
use crate::panels::{button, section, status, theme};
use crate::window::app::Viewer;
use egui::{Area, Button, Context, Frame, Id, Label, Panel, RichText, ScrollArea, Ui, vec2};
use headbox_core::file_frame::FileFrame;

/// Initial width of the side panel, points.
const WIDTH_POINTS: f32 = 290.0;

/// Window width below which the panel lies over the frame instead of beside it, points.
const NARROW_POINTS: f32 = 640.0;

/// Height of the button that unfolds the panel over the frame, with its margin, points.
const UNFOLD_POINTS: f32 = 30.0;
/// Upper bound of that button's width, points.
pub(crate) const UNFOLD_WIDTH_POINTS: f32 = 60.0;

/// Returns true if the panel lies over the frame instead of beside it.
pub(crate) fn is_narrow(ctx: &Context) -> bool {
    ctx.content_rect().width() < NARROW_POINTS
}

impl Viewer {
    /// Shows the panels, unless they are hidden or there is no source.
    pub(crate) fn panels(&mut self, ui: &mut Ui, now_s: f64) {
        if !self.show_panels || self.info.is_none() {
            return;
        }
        if is_narrow(ui.ctx()) {
            return self.panel_over_frame(ui.ctx(), now_s);
        }
        Panel::bottom("status").resizable(false).show(ui, |ui| {
            let frame = self
                .info
                .as_ref()
                .map_or_else(FileFrame::default, |info| info.file_frame);
            let shown = self.shown.as_ref();
            let outside = self.info.as_ref().is_some_and(|info| {
                let bounds = info.headboxes.as_ref().and(info.bounds);
                bounds.is_some_and(|bounds| !bounds.contains(self.eye.pose.eye))
            });
            let hint = if self.headbox.placed.is_some() {
                Some("Enter captures the placed headbox")
            } else {
                outside.then_some("outside of the headbox: Enter captures here")
            };
            status::show(ui, &self.eye.pose, &frame, shown, &self.path_recorder, hint);
        });
        Panel::left("panel")
            .resizable(true)
            .default_size(WIDTH_POINTS)
            .show(ui, |ui| {
                ScrollArea::vertical()
                    .auto_shrink(false)
                    .show(ui, |ui| self.side_panel(ui, now_s));
            });
    }

    /// Shows a button in the corner of the frame and, if it was pressed, the panel over the frame:
    /// the layout of a narrow window.
    fn panel_over_frame(&mut self, ctx: &Context, now_s: f64) {
        let screen = ctx.content_rect();
        let corner = screen.min + vec2(4.0, 4.0);
        Area::new(Id::unique("unfold"))
            .fixed_pos(corner)
            .constrain(false)
            .show(ctx, |ui| {
                let (text, tip) = if self.panel_unfolded {
                    ("Fold", "Folds the panel away.")
                } else {
                    ("Panel", "Shows the panel.")
                };
                if ui.add(Button::new(text)).on_hover_text(tip).clicked() {
                    self.panel_unfolded = !self.panel_unfolded;
                }
            });
        let size = vec2(
            WIDTH_POINTS.min(screen.width() - 24.0),
            screen.height() - UNFOLD_POINTS - 12.0,
        );
        if !self.panel_unfolded || size.x < 100.0 || size.y < 60.0 {
            return;
        }
        let frame = Frame::new()
            .fill(theme::PANEL)
            .inner_margin(6.0)
            .corner_radius(4.0);
        Area::new(Id::unique("panel over frame"))
            .fixed_pos(corner + vec2(0.0, UNFOLD_POINTS))
            .show(ctx, |ui| {
                frame.show(ui, |ui| {
                    ui.set_width(size.x - 12.0);
                    ScrollArea::vertical()
                        .max_height(size.y - 12.0)
                        .show(ui, |ui| self.side_panel(ui, now_s));
                });
            });
    }

    /// Shows the contents of the side panel.
    fn side_panel(&mut self, ui: &mut Ui, now_s: f64) {
        let Some(info) = &self.info else { return };
        ui.add_space(6.0);
        ui.add(Label::new(RichText::new(&info.title).heading().strong()).wrap())
            .on_hover_text("What is shown.");
        ui.horizontal_wrapped(|ui| {
            if self.start_page.has_library {
                let tip =
                    "Goes back to the page with all scenes and the files opened last (Backspace).";
                button(ui, "Start page", tip, Command::Start, &mut self.commands);
                let tip = "Opens another file (O); files can also be dropped here.";
                button(ui, "Open…", tip, Command::ShowOpen, &mut self.commands);
            }
            button(
                ui,
                "Keys",
                "Lists the keys (F1).",
                Command::ToggleKeys,
                &mut self.commands,
            );
            button(
                ui,
                "Hide",
                "Hides the panels (H brings them back).",
                Command::TogglePanels,
                &mut self.commands,
            );
        });
        ui.add_space(4.0);
        self.visitor_sections(ui, now_s);
        ui.add_space(4.0);
        self.expert_sections(ui, now_s);
        ui.add_space(6.0);
    }

    /// Shows what every visitor needs: headbox, camera, exposure, quality, what is shown.
    fn visitor_sections(&mut self, ui: &mut Ui, now_s: f64) {
        let navigation = self.navigation();
        let Some(info) = &self.info else { return };
        if let Some(headboxes) = &info.headboxes {
            section(ui, "Headbox", true, |ui| {
                headbox::show(
                    ui,
                    &mut self.headbox,
                    headboxes,
                    &info.file_frame,
                    &mut self.commands,
                );
            });
        }
        let (display, sets) = (&mut self.display, &mut self.sets);
        section(ui, "Camera", true, |ui| {
            camera::show(
                ui,
                &mut self.eye,
                info,
                navigation,
                now_s,
                &mut self.commands,
            );
        });
        section(ui, "Picture", true, |ui| {
            source::choose_set(ui, sets, display.compare);
            let values = sets.edited(display.compare);
            source::picture(ui, info, values, &mut self.commands);
            display::show(ui, display, sets, self.policy.moving_scale());
        });
        let values = sets.edited(display.compare);
        source::groups(ui, info, values, false, &mut self.commands);
    }

    /// Shows the folded sections.
    fn expert_sections(&mut self, ui: &mut Ui, now_s: f64) {
        let Some(info) = &self.info else { return };
        section(ui, "Bookmarks", false, |ui| {
            bookmarks::show(ui, &self.bookmarks, &mut self.commands);
        });
        section(ui, "Record", false, |ui| {
            record::show(
                ui,
                &mut self.path_recorder,
                self.exporting,
                now_s,
                &mut self.commands,
            );
        });
        section(ui, "Position and speed", false, |ui| {
            let (bounds, frame) = (self.headbox.bounds(info), &info.file_frame);
            camera::show_numbers(ui, &mut self.eye, bounds.as_ref(), frame, now_s);
        });
        let values = self.sets.edited(self.display.compare);
        source::groups(ui, info, values, true, &mut self.commands);
        section(ui, "Display", false, |ui| {
            display::show_details(ui, &mut self.display);
        });
        section(ui, "Statistics", false, |ui| {
            statistics::show(ui, info, self.shown.as_ref(), &self.history);
        });
    }
}
