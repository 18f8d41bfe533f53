//! Headbox panel of a live capture: leave the headbox, place and capture another one, show an
//! earlier one.

use crate::input::bounds::EyeBounds;
use crate::input::keymap::Command;
use crate::panels::button;
use crate::source::Headboxes;
use crate::thread::exchange::SourceInfo;
use egui::{Slider, Ui};
use glam::DVec3;
use headbox_core::file_frame::{FileFrame, figure, triple};
use std::ops::RangeInclusive;

/// Ratio of the largest and the smallest half-size of the slider to that of the shown headbox.
const SIZE_RATIO: f64 = 16.0;
/// State of the panel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct HeadboxPanel {
    /// True if the eye may leave the headbox.
    pub leaves: bool,
    /// Half-size of the next headbox, metres.
    pub half_size_m: f64,
    /// Centre of the next headbox, world metres; `None` if it is to be captured about the eye.
    pub placed: Option<DVec3>,
}

impl HeadboxPanel {
    pub(crate) fn new(info: &SourceInfo) -> Self {
        Self {
            leaves: false,
            half_size_m: info.bounds.map_or(0.0, |b| b.half_size.max_element()),
            placed: None,
        }
    }

    /// The next headbox, if it is placed.
    pub(crate) fn next(&self) -> Option<EyeBounds> {
        self.placed.map(|centre| EyeBounds {
            centre,
            half_size: DVec3::splat(self.half_size_m),
        })
    }

    /// Box in which the eye stays; `None` if it may go anywhere.
    pub(crate) fn bounds(&self, info: &SourceInfo) -> Option<EyeBounds> {
        info.bounds.filter(|_| !self.leaves)
    }
}

/// Range of the next headbox's half-size, metres; `None` if no headbox is shown.
pub(crate) fn size_range_m(headboxes: &Headboxes) -> Option<RangeInclusive<f64>> {
    let usual = headboxes
        .bounds
        .get(headboxes.shown)?
        .half_size
        .max_element();
    Some(usual / SIZE_RATIO..=usual * SIZE_RATIO)
}

/// Shows the controls; lengths are in the unit of the scene's file.
pub(crate) fn show(
    ui: &mut Ui,
    panel: &mut HeadboxPanel,
    headboxes: &Headboxes,
    frame: &FileFrame,
    commands: &mut Vec<Command>,
) {
    let mut leaves = panel.leaves;
    let tip = "Lets the eye leave the headbox (F). Outside, the scene is shown without light.";
    if ui
        .checkbox(&mut leaves, "Leave the headbox")
        .on_hover_text(tip)
        .changed()
    {
        commands.push(Command::ToggleLeave);
    }
    if let Some(sizes) = size_range_m(headboxes) {
        let sizes = sizes.start() / frame.unit_m..=sizes.end() / frame.unit_m;
        let mut half_size = panel.half_size_m / frame.unit_m;
        let unit = frame
            .unit_name()
            .map_or(String::new(), |unit| format!(" {unit}"));
        let slider = Slider::new(&mut half_size, sizes)
            .logarithmic(true)
            .suffix(unit)
            .custom_formatter(|size, _| figure(size))
            .text("Half-size");
        let tip = "Half of the edge length of the next headbox, in the unit of the scene's file, as in --half-size.";
        if ui.add(slider).on_hover_text(tip).changed() {
            panel.half_size_m = half_size * frame.unit_m;
        }
    }
    ui.horizontal_wrapped(|ui| {
        let (place, capture) = if panel.placed.is_some() {
            ("Take back", "Capture it")
        } else {
            ("Place here", "Capture here")
        };
        let tip = "Puts the next headbox where the eye is, or takes it back (N). Seen from farther away it has handles: those of its faces size it, the one in its middle moves it.";
        button(ui, place, tip, Command::PlaceHeadbox, commands);
        let tip = "Captures a headbox of this size where it was placed, or about the eye (Enter). The earlier ones keep what was captured.";
        button(ui, capture, tip, Command::CaptureHere, commands);
    });
    if headboxes.bounds.len() < 2 {
        return;
    }
    for (i, bounds) in headboxes.bounds.iter().enumerate() {
        let centre = triple(frame.file_from_world(bounds.centre));
        let half_size = figure(bounds.half_size.max_element() / frame.unit_m);
        let text = format!("{}: {centre} half-size {half_size}", i + 1);
        let label = ui
            .selectable_label(i == headboxes.shown, text)
            .on_hover_text(
                "Shows this headbox: its centre and half-size in the file's axes and unit.",
            );
        if label.clicked() {
            commands.push(Command::ShowHeadbox(i));
        }
    }
}
