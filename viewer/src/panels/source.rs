//! Settings panel of the source, generated from its settings data.

use super::{button, section};
use crate::input::keymap::Command;
use crate::input::steering::SettingSets;
use crate::thread::exchange::SourceInfo;
use egui::{Checkbox, ComboBox, Slider, Ui};
use headbox_core::view::{Control, Setting, SettingValue, SettingValues};
use std::{ops::RangeInclusive, sync::Arc};

/// Shows the controls by group, in order of first appearance.
pub(crate) fn show(
    ui: &mut Ui,
    info: &SourceInfo,
    sets: &mut SettingSets,
    compare: bool,
    commands: &mut Vec<Command>,
) {
    let settings = &info.settings;
    if compare {
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
    let values = Arc::make_mut(if compare && sets.edits_b {
        &mut sets.b
    } else {
        &mut sets.a
    });
    let mut groups: Vec<(&str, bool)> = Vec::new();
    for setting in settings {
        if groups.iter().all(|(group, _)| *group != setting.group) {
            groups.push((&setting.group, setting.folded));
        }
    }
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
        (Control::Action, _) => button(ui, label, tip, Command::Act(setting.id), commands),
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
    let slider = Slider::new(value, range.clone())
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
