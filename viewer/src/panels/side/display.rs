//! Display panel: resolution, stereo, comparison.

use crate::input::steering::SettingSets;
use crate::window::options::ViewerOptions;
use crate::window::views::Stereo;
use egui::{Checkbox, Slider, Ui};
use std::sync::Arc;

/// State of the panel.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Display {
    /// Render fewer pixels while the eye moves, if frames would take longer than `target_ms`.
    pub lower_resolution: bool,
    /// Time limit of a frame while the eye moves, ms.
    pub target_ms: f64,
    pub stereo: Stereo,
    /// Distance between the two eyes, metres.
    pub separation_m: f64,
    /// Show A and B side by side.
    pub compare: bool,
    /// Share of the frame's width that shows A.
    pub divider: f32,
    /// Show the headbox and the floor plan in the corner.
    pub insets: bool,
}

impl Display {
    /// Initial state. `moving_limit_ms` is the time limit of a frame while the eye moves, ms;
    /// `None` always renders all pixels.
    pub(crate) fn new(stereo: Stereo, moving_limit_ms: Option<f64>) -> Self {
        Self {
            lower_resolution: moving_limit_ms.is_some(),
            target_ms: moving_limit_ms.unwrap_or(ViewerOptions::MOVING_LIMIT_MS),
            stereo,
            separation_m: 0.063,
            compare: false,
            divider: 0.5,
            insets: true,
        }
    }
}

/// Shows quality, stereo and comparison. `moving_scale` is the current scale while moving.
pub(crate) fn show(ui: &mut Ui, display: &mut Display, sets: &mut SettingSets, moving_scale: f64) {
    let text = if display.lower_resolution && moving_scale < 1.0 {
        format!(
            "Fewer pixels while moving (now {:.0} %)",
            moving_scale * 100.0
        )
    } else {
        "Fewer pixels while moving".into()
    };
    ui.add(Checkbox::new(&mut display.lower_resolution, text)).on_hover_text(
        "Renders at a share (in % of each side) of the window's pixels while the eye moves, if frames take longer than \
         the limit under Display and fewer pixels save time; at rest every pixel is rendered.",
    );
    ui.horizontal(|ui| {
        ui.label("Stereo");
        for stereo in Stereo::ALL {
            let tip = match stereo {
                Stereo::Off => "One eye (X switches).",
                Stereo::CrossEyed => "Two views, the right eye's on the left: cross your eyes (X switches).",
                Stereo::Parallel => {
                    "Two views, the left eye's on the left: for lenses, or a distant gaze (X switches)."
                }
            };
            ui.selectable_value(&mut display.stereo, stereo, stereo.name()).on_hover_text(tip);
        }
    });
    if display.stereo != Stereo::Off {
        ui.add(
            Slider::new(&mut display.separation_m, 0.001..=1.0)
                .logarithmic(true)
                .suffix(" m")
                .max_decimals(3)
                .text("Eyes apart"),
        )
        .on_hover_text("Distance between the two eyes in metres (a person's: 0.063 m).");
    }
    let before = display.compare;
    ui.add(Checkbox::new(&mut display.compare, "Compare A with B"))
        .on_hover_text(
            "Shows two sets of settings left and right of a divider that can be dragged (B).",
        );
    if display.compare && !before {
        // B starts as a copy of A, so that the images differ only by later changes.
        (sets.b, sets.edits_b) = (Arc::clone(&sets.a), true);
    }
}

/// Shows the time limit of frames, and the insets.
pub(crate) fn show_details(ui: &mut Ui, display: &mut Display) {
    ui.add_enabled(
        display.lower_resolution,
        Slider::new(&mut display.target_ms, 4.0..=100.0).logarithmic(true).suffix(" ms").max_decimals(0).text("Limit"),
    )
    .on_hover_text("The longest a frame should take while the eye moves, in milliseconds (16 ms: 60 frames a second).");
    ui.add(Checkbox::new(&mut display.insets, "Headbox and plan"))
        .on_hover_text("Shows in the corner where the eye is in the headbox (sizes in metres), and on the plan.");
}
