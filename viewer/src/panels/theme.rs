//! Colours and spacing: dark and quiet, so that the frame is the brightest thing in the window.

use egui::{Color32, Context, CornerRadius, Stroke, TextStyle, Theme, Visuals};
use std::num::NonZeroUsize;

/// Behind the frame.
pub(crate) const BACKDROP: Color32 = Color32::from_gray(16);
/// Behind panels.
const PANEL: Color32 = Color32::from_rgb(27, 29, 33);
/// What is chosen, and the eye in the insets.
pub(crate) const ACCENT: Color32 = Color32::from_rgb(96, 165, 250);
/// Warnings: the edge of the headbox, errors.
pub(crate) const WARNING: Color32 = Color32::from_rgb(248, 113, 113);
/// Lines of drawings.
pub(crate) const LINE: Color32 = Color32::from_gray(150);
/// Less important lines and text.
pub(crate) const FAINT: Color32 = Color32::from_gray(95);

/// Colours of the stages in the chart, told apart by lightness as well as by hue (Tol's "bright" scheme, reordered).
pub(crate) const STAGES: [Color32; 7] = [
    Color32::from_rgb(68, 119, 170),
    Color32::from_rgb(204, 187, 68),
    Color32::from_rgb(238, 102, 119),
    Color32::from_rgb(34, 136, 51),
    Color32::from_rgb(102, 204, 238),
    Color32::from_rgb(170, 51, 119),
    Color32::from_rgb(187, 187, 187),
];

/// A colour between two.
pub(crate) fn mix(a: Color32, b: Color32, share: f64) -> Color32 {
    a.lerp_to_gamma(b, share.clamp(0.0, 1.0) as f32)
}

/// Sets the window's look.
pub(crate) fn install(ctx: &Context) {
    // A pass moves the eye and obeys keys, so that it must run once per frame, also when a list appears whose size egui
    // would like to try out first.
    if let Some(once) = NonZeroUsize::new(1) {
        ctx.options_mut(|options| options.max_passes = once);
    }
    ctx.set_theme(Theme::Dark);
    ctx.style_mut_of(Theme::Dark, |style| {
        let mut visuals = Visuals::dark();
        visuals.panel_fill = PANEL;
        visuals.window_fill = PANEL;
        // Text of labels: lighter than the default, which is hard to read beside a bright frame.
        visuals.widgets.noninteractive.fg_stroke.color = Color32::from_gray(180);
        visuals.selection.bg_fill = Color32::from_rgb(30, 74, 130);
        visuals.selection.stroke = Stroke::new(1.0, Color32::WHITE);
        visuals.slider_trailing_fill = true;
        visuals.window_corner_radius = CornerRadius::same(6);
        style.visuals = visuals;
        if let Some(small) = style.text_styles.get_mut(&TextStyle::Small) {
            small.size = 11.0;
        }
        style.spacing.item_spacing = egui::vec2(7.0, 5.0);
        style.spacing.slider_width = 110.0;
        style.spacing.combo_width = 140.0;
        style.interaction.selectable_labels = false;
    });
}
