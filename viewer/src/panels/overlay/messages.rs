//! Messages over the frame.

use crate::panels::overlay::strip;
use crate::panels::theme;
use crate::window::messages::{Kind, Messages};
use egui::{Align2, Area, Color32, Context, Frame, Id, Margin, RichText, Stroke, vec2};

const WIDTH_POINTS: f32 = 520.0;

/// Shows the messages, each with a button that dismisses it.
pub(crate) fn show(ctx: &Context, messages: &mut Messages) {
    if messages.iter().len() == 0 {
        return;
    }
    let mut dismissed = None;
    Area::new(Id::unique("messages"))
        .anchor(Align2::RIGHT_TOP, vec2(-12.0, 12.0 + strip::HEIGHT_POINTS))
        .show(ctx, |ui| {
            for (i, message) in messages.iter().enumerate() {
                let color = match message.kind {
                    Kind::Done => theme::ACCENT,
                    Kind::Error => theme::WARNING,
                };
                let frame = Frame::new()
                    .fill(Color32::from_rgba_unmultiplied(22, 23, 26, 235))
                    .stroke(Stroke::new(1.0, color));
                frame
                    .corner_radius(5.0)
                    .inner_margin(Margin::symmetric(10, 7))
                    .show(ui, |ui| {
                        ui.set_max_width(
                            WIDTH_POINTS
                                .min(ctx.content_rect().width() - 48.0)
                                .max(60.0),
                        );
                        ui.horizontal(|ui| {
                            if ui
                                .small_button("Dismiss")
                                .on_hover_text("Takes this message away (Esc: all of them).")
                                .clicked()
                            {
                                dismissed = Some(i);
                            }
                            let times = if message.count > 1 {
                                format!(" ({} times)", message.count)
                            } else {
                                String::new()
                            };
                            ui.add(
                                egui::Label::new(
                                    RichText::new(format!("{}{times}", message.text))
                                        .color(Color32::WHITE),
                                )
                                .wrap(),
                            );
                        });
                    });
            }
        });
    if let Some(index) = dismissed {
        messages.dismiss(index);
    }
}
