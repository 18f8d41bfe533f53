//! Settings panel of the source, generated from its settings data.

use crate::input::keymap::Command;
use crate::input::steering::SettingSets;
use crate::panels::{button, section};
use crate::thread::exchange::SourceInfo;
use egui::{Checkbox, ComboBox, Slider, SliderClamping, Ui};
use headbox_core::view::{Control, EXPOSURE, Setting, SettingValue, SettingValues};
use std::ops::RangeInclusive;

/// Heading of the settings that belong to the picture.
const PICTURE: &str = "View";

/// Range of the exposure's slider, stops. Values beyond can be typed.
const SLIDER_STOPS: RangeInclusive<f64> = -6.0..=6.0;

/// Shows which of the two sets the controls below change, if both are on the screen.
pub(crate) fn choose_set(ui: &mut Ui, sets: &mut SettingSets, compare: bool) {
    if !compare {
        return;
    }
    ui.horizontal(|ui| {
        ui.label("Settings of");
        ui.selectable_value(&mut sets.edits_b, false, "A")
            .on_hover_text("Change what is left of the divider.");
        ui.selectable_value(&mut sets.edits_b, true, "B")
            .on_hover_text("Change what is right of the divider.");
        if ui
            .button("Swap")
            .on_hover_text("Exchanges the settings of A and B.")
            .clicked()
        {
            std::mem::swap(&mut sets.a, &mut sets.b);
        }
    });
}

/// Shows the controls that belong to the picture, the exposure first.
pub(crate) fn picture(
    ui: &mut Ui,
    info: &SourceInfo,
    values: &mut SettingValues,
    commands: &mut Vec<Command>,
) {
    let settings = || {
        info.settings
            .iter()
            .filter(|setting| setting.group == PICTURE)
    };
    let is_exposure = |setting: &&Setting| setting.id == EXPOSURE;
    let first = settings().filter(is_exposure);
    for setting in first.chain(settings().filter(|setting| !is_exposure(setting))) {
        control(ui, info, setting, values, commands);
    }
}

/// Shows the other controls by group, in order of first appearance: those of the groups that are
/// initially folded or unfolded, as `folded` says.
pub(crate) fn groups(
    ui: &mut Ui,
    info: &SourceInfo,
    values: &mut SettingValues,
    folded: bool,
    commands: &mut Vec<Command>,
) {
    let settings = &info.settings;
    let mut groups: Vec<(&str, bool)> = Vec::new();
    for setting in settings {
        if groups.iter().all(|(group, _)| *group != setting.group) {
            groups.push((&setting.group, setting.folded));
        }
    }
    groups.retain(|group| group.0 != PICTURE && group.1 == folded);
    for (group, folded) in groups {
        section(ui, group, !folded, |ui| {
            for setting in settings.iter().filter(|s| s.group == group) {
                control(ui, info, setting, values, commands);
            }
        });
    }
}

fn control(
    ui: &mut Ui,
    info: &SourceInfo,
    setting: &Setting,
    values: &mut SettingValues,
    commands: &mut Vec<Command>,
) {
    let (label, tip) = (setting.label.as_str(), setting.tooltip.as_str());
    match (&setting.control, values.get_mut(setting.id)) {
        (Control::Save { .. }, _) => {
            button(ui, label, tip, Command::AskSave(setting.id), commands);
        }
        (Control::Toggle { .. }, Some(SettingValue::Toggle(on))) => {
            ui.add(Checkbox::new(on, label)).on_hover_text(tip);
        }
        (Control::Choice { options, .. }, Some(SettingValue::Choice(index))) => {
            let chosen = options.get(*index).map_or("", String::as_str);
            let list = ComboBox::new(setting.id, label)
                .selected_text(chosen)
                .show_ui(ui, |ui| {
                    for (i, option) in options.iter().enumerate() {
                        ui.selectable_value(index, i, option)
                            .on_hover_text(info.term(option).unwrap_or(tip));
                    }
                });
            list.response.on_hover_text(tip);
        }
        (Control::Number { range, unit, .. }, Some(SettingValue::Number(value)))
            if setting.id == EXPOSURE =>
        {
            let slider = Slider::new(value, SLIDER_STOPS)
                .clamping(SliderClamping::Never)
                .custom_formatter(|stops, _| format!("{stops:+.1}"))
                .suffix(format!(" {unit}"))
                .text(label);
            ui.add(slider)
                .on_hover_text(format!("{tip} (Keys + and -.)"));
            *value = value.clamp(*range.start(), *range.end());
        }
        (
            Control::Number {
                range,
                step,
                unit,
                logarithmic,
                ..
            },
            Some(SettingValue::Number(value)),
        ) => {
            ui.add(slider(value, range, *step, unit, *logarithmic).text(label))
                .on_hover_text(tip);
        }
        // Unreachable: `values` was created from the same settings.
        _ => {}
    }
}

fn slider<'a>(
    value: &'a mut f64,
    range: &RangeInclusive<f64>,
    step: f64,
    unit: &str,
    logarithmic: bool,
) -> Slider<'a> {
    let suffix = if unit.is_empty() {
        String::new()
    } else {
        format!(" {unit}")
    };
    // Only edited values are rounded: a value that is shown must not change.
    let slider = Slider::new(value, range.clone())
        .clamping(SliderClamping::Edits)
        .logarithmic(logarithmic)
        .suffix(suffix);
    if step == 1.0 {
        slider.integer()
    } else if step > 0.0 {
        slider.step_by(step)
    } else {
        slider.max_decimals(3)
    }
}
