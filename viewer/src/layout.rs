//! Which panels surround the frame, and what of the window's state each shows and changes.

use crate::{
    app::Viewer,
    keymap::Command,
    panels::{button, camera, display, record, section, source, statistics, status},
};
use egui::{Panel, RichText, ScrollArea, Ui};

/// Width of the side panel at first, points.
const WIDTH_POINTS: f32 = 290.0;

impl Viewer {
    /// Shows them, if they are wanted and there is something to show.
    pub(crate) fn panels(&mut self, ui: &mut Ui, now_s: f64) {
        if !self.show_panels || self.info.is_none() {
            return;
        }
        Panel::bottom("status")
            .resizable(false)
            .show(ui, |ui| status::show(ui, &self.eye.pose, self.shown.as_ref(), &self.tape));
        Panel::left("panel").resizable(true).default_size(WIDTH_POINTS).show(ui, |ui| {
            ScrollArea::vertical().auto_shrink(false).show(ui, |ui| self.side(ui, now_s));
        });
    }

    /// The side panel, from top to bottom.
    fn side(&mut self, ui: &mut Ui, now_s: f64) {
        let Some(info) = &self.info else { return };
        ui.add_space(6.0);
        ui.label(RichText::new(&info.title).heading().strong()).on_hover_text("What is shown.");
        ui.add_space(4.0);
        source::show(ui, &info.settings, &mut self.sets, self.display.compare, &mut self.commands);
        section(ui, "Statistics", true, |ui| statistics::show(ui, self.shown.as_ref(), &self.history));
        section(ui, "Camera", true, |ui| {
            camera::show(ui, &mut self.eye, info.bounds.as_ref(), now_s, &mut self.commands);
        });
        section(ui, "Display", true, |ui| {
            display::show(ui, &mut self.display, &mut self.sets, self.policy.moving_scale());
        });
        section(ui, "Record", false, |ui| {
            record::show(ui, &mut self.tape, self.exporting, &self.options.output_dir, now_s, &mut self.commands);
        });
        ui.add_space(6.0);
        ui.horizontal(|ui| {
            let open = self.start_page.has_library();
            if open
                && ui.button("Open…").on_hover_text("Opens another file (O); files can also be dropped here.").clicked()
            {
                self.commands.push(Command::ShowOpen);
            }
            button(ui, "Keys", "Lists the keys (F1).", Command::ToggleKeys, &mut self.commands);
            button(ui, "Hide", "Hides the panels (H brings them back).", Command::TogglePanels, &mut self.commands);
        });
    }
}
