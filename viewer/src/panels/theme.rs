//! Colours and spacing: dark, so that the frame is the brightest part of the window.

use egui::{Color32, Context, CornerRadius, Stroke, TextStyle, Theme, Visuals};
use std::num::NonZeroUsize;

/// Background of the frame.
pub(crate) const BACKDROP: Color32 = Color32::from_gray(16);
/// Background of panels.
pub(crate) const PANEL: Color32 = Color32::from_rgb(27, 29, 33);
/// Selection, and the eye in the insets.
pub(crate) const ACCENT: Color32 = Color32::from_rgb(96, 165, 250);
/// Warnings: the edge of the headbox, errors.
pub(crate) const WARNING: Color32 = Color32::from_rgb(248, 113, 113);
/// The headbox to be captured next.
pub(crate) const NEXT: Color32 = Color32::from_rgb(250, 204, 21);
/// Background of the progress strip.
pub(crate) const STRIP: Color32 = Color32::from_rgb(22, 36, 58);
/// Text of labels: lighter than egui's, which is hard to read beside a bright frame.
const TEXT: Color32 = Color32::from_gray(190);
/// Secondary text.
const WEAK: Color32 = Color32::from_gray(150);
/// Background of the selected item.
const SELECTED: Color32 = Color32::from_rgb(30, 74, 130);
/// Background of insets: dark enough for their text over a white frame.
pub(crate) const INSET: Color32 = Color32::from_black_alpha(190);
/// Text of insets.
pub(crate) const INSET_TEXT: Color32 = Color32::from_gray(225);
/// Background of legends.
pub(crate) const LEGEND: Color32 = Color32::from_black_alpha(190);
/// Lines of drawings.
pub(crate) const LINE: Color32 = Color32::from_gray(150);
/// Secondary lines; never text.
pub(crate) const FAINT: Color32 = Color32::from_gray(95);

/// Colours of the stages in the chart, which differ in lightness as well as in hue (Tol's "bright"
/// scheme, reordered).
pub(crate) const STAGES: [Color32; 7] = [
    Color32::from_rgb(68, 119, 170),
    Color32::from_rgb(204, 187, 68),
    Color32::from_rgb(238, 102, 119),
    Color32::from_rgb(34, 136, 51),
    Color32::from_rgb(102, 204, 238),
    Color32::from_rgb(170, 51, 119),
    Color32::from_rgb(187, 187, 187),
];

/// Interpolates between two colours; `share` of `b`, 0 to 1.
pub(crate) fn mix(a: Color32, b: Color32, share: f64) -> Color32 {
    a.lerp_to_gamma(b, share.clamp(0.0, 1.0) as f32)
}

/// Installs the theme.
pub(crate) fn install(ctx: &Context) {
    // A pass moves the eye and executes keys, so it must run once per frame, even where egui would
    // run another pass to measure a new list.
    if let Some(once) = NonZeroUsize::new(1) {
        ctx.options_mut(|options| options.max_passes = once);
    }
    ctx.set_theme(Theme::Dark);
    ctx.style_mut_of(Theme::Dark, |style| {
        let mut visuals = Visuals::dark();
        visuals.panel_fill = PANEL;
        visuals.window_fill = PANEL;
        visuals.widgets.noninteractive.fg_stroke.color = TEXT;
        visuals.weak_text_color = Some(WEAK);
        visuals.selection.bg_fill = SELECTED;
        visuals.selection.stroke = Stroke::new(1.0, Color32::WHITE);
        visuals.slider_trailing_fill = true;
        // A click anywhere in its row folds a heading.
        visuals.collapsing_header_frame = true;
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

#[cfg(test)]
mod tests {
    use super::*;
    use egui::Style;

    /// Relative luminance (WCAG 2.1).
    fn luminance(color: Color32) -> f64 {
        let linear = |c: u8| {
            let c = f64::from(c) / 255.0;
            if c <= 0.04045 {
                c / 12.92
            } else {
                ((c + 0.055) / 1.055).powf(2.4)
            }
        };
        0.2126 * linear(color.r()) + 0.7152 * linear(color.g()) + 0.0722 * linear(color.b())
    }

    fn contrast(a: Color32, b: Color32) -> f64 {
        let [a, b] = [a, b].map(luminance);
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn contrast_equals_wcag() {
        assert!((contrast(Color32::WHITE, Color32::BLACK) - 21.0).abs() < 1e-9);
        assert!((contrast(Color32::from_gray(118), Color32::WHITE) - 4.54).abs() < 0.01);
    }

    /// Minimum contrast of text: 4.5:1 by WCAG 2.1 AA.
    #[test]
    fn text_contrast_is_sufficient() {
        let ctx = Context::default();
        install(&ctx);
        let style: std::sync::Arc<Style> = ctx.style_of(Theme::Dark);
        let visuals = &style.visuals;
        let widgets = &visuals.widgets;
        let mut pairs = vec![
            ("label", visuals.text_color(), PANEL),
            ("weak", visuals.weak_text_color(), PANEL),
            ("strong", visuals.strong_text_color(), PANEL),
            ("warning", WARNING, PANEL),
            ("accent", ACCENT, PANEL),
            (
                "chosen",
                visuals.selection.stroke.color,
                visuals.selection.bg_fill,
            ),
            ("strip", Color32::WHITE, STRIP),
            // Insets and legends may cover any frame; their background is brightest over white.
            ("inset", INSET_TEXT, over_white(INSET)),
            ("legend", Color32::WHITE, over_white(LEGEND)),
            ("start page", visuals.text_color(), BACKDROP),
            ("start page, weak", visuals.weak_text_color(), BACKDROP),
        ];
        for (name, widget) in [
            ("button", &widgets.inactive),
            ("button under the pointer", &widgets.hovered),
            ("pressed button", &widgets.active),
            ("open list", &widgets.open),
        ] {
            pairs.push((name, widget.text_color(), widget.weak_bg_fill));
            pairs.push((name, widget.text_color(), widget.bg_fill));
        }
        pairs.push((
            "field",
            widgets.inactive.text_color(),
            visuals.extreme_bg_color,
        ));
        let poor: Vec<_> = pairs
            .iter()
            .map(|&(name, a, b)| (name, contrast(a, b)))
            .filter(|(_, c)| *c < 4.5)
            .collect();
        assert!(poor.is_empty(), "{poor:?}");
    }

    fn over_white(color: Color32) -> Color32 {
        let left = 255 - color.a();
        Color32::from_rgb(color.r() + left, color.g() + left, color.b() + left)
    }
}
