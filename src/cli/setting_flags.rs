//! Flags generated from the settings of views: one table for the command line and the window.

use crate::messages::UsageError;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use headbox_core::view::{Control, Setting, SettingValues, View};
use headbox_photos::view_geometry::view::GeometryView;
use headbox_sprite::view::LayersView;

/// Settings given on the command line, by flag.
#[derive(Clone, Debug, Default)]
pub(crate) struct SettingFlags(Vec<(&'static str, String)>);

/// A flag, its setting, and the name of a kind of input that has it.
type FlagEntry = (&'static str, Setting, String);

/// Table of all settings with flags, in order.
fn table() -> Vec<FlagEntry> {
    let representations = headbox_views::all();
    let files = representations
        .iter()
        .map(|one| (format!(".{}", one.extension), (one.settings)()));
    let others = [
        ("several files".to_owned(), LayersView::layer_settings()),
        (
            "folders of images".to_owned(),
            GeometryView::setting_table(),
        ),
    ];
    let entries = files.chain(others).flat_map(|(kind, settings)| {
        settings
            .into_iter()
            .filter_map(move |setting| Some((setting.flag?, setting, kind.clone())))
    });
    entries.collect()
}

/// Help text of a flag, one line per kind of input that has it.
fn help(flag: &str, table: &[FlagEntry]) -> String {
    let mut parts: Vec<(String, Vec<&str>)> = Vec::new();
    for (_, setting, kind) in table.iter().filter(|(found, ..)| *found == flag) {
        let text = setting.tooltip.trim_end_matches('.');
        let mut text = text.trim_end_matches(" (no unit)").to_owned();
        if let Control::Choice { options, .. } = &setting.control {
            text += &format!(": {}", options.join(", "));
        }
        match parts.iter_mut().find(|(known, _)| *known == text) {
            Some((_, kinds)) => kinds.push(kind),
            None => parts.push((text, vec![kind])),
        }
    }
    let parts = parts
        .into_iter()
        .map(|(text, kinds)| format!("{}: {text}", kinds.join(", ")));
    parts.collect::<Vec<_>>().join("\n")
}

fn is_switch(setting: &Setting) -> bool {
    matches!(setting.control, Control::Toggle { on: false })
}

impl Args for SettingFlags {
    fn augment_args(mut command: Command) -> Command {
        let table = table();
        let mut known = Vec::new();
        for (flag, setting, _) in &table {
            if known.contains(flag) {
                continue;
            }
            known.push(*flag);
            let arg = Arg::new(*flag).long(*flag).help(help(flag, &table));
            let arg = match &setting.control {
                _ if is_switch(setting) => arg.action(ArgAction::SetTrue),
                Control::Number { .. } => arg.value_name("N").allow_hyphen_values(true),
                _ => arg.value_name("NAME"),
            };
            command = command.arg(arg);
        }
        command
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for SettingFlags {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut given: Vec<(&'static str, String)> = Vec::new();
        for (flag, setting, _) in table() {
            if given.iter().any(|(known, _)| *known == flag) {
                continue;
            }
            if is_switch(&setting) {
                if matches.get_flag(flag) {
                    given.push((flag, "on".into()));
                }
            } else if let Some(text) = matches.get_one::<String>(flag) {
                given.push((flag, text.clone()));
            }
        }
        Ok(Self(given))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl SettingFlags {
    /// Returns the text given for a flag.
    pub(crate) fn get(&self, flag: &str) -> Option<&str> {
        let found = self.0.iter().find(|(given, _)| *given == flag);
        found.map(|(_, text)| text.as_str())
    }

    /// Values of a view's settings: the initial ones, replaced by those given.
    ///
    /// # Errors
    /// A flag that the view does not have, or a value that the setting does not have.
    pub(crate) fn values(&self, view: &dyn View) -> Result<SettingValues, UsageError> {
        let settings = view.settings();
        let mut values = SettingValues::initial(&settings);
        for (flag, text) in &self.0 {
            let candidates: Vec<_> = settings
                .iter()
                .filter(|setting| setting.flag == Some(flag))
                .collect();
            if candidates.is_empty() {
                return Err(not_applicable(flag, view.kind(), &settings));
            }
            let is_set = candidates
                .iter()
                .any(|setting| values.set_text(&settings, setting.id, text).is_ok());
            if !is_set {
                return Err(no_such_value(flag, text, &candidates));
            }
        }
        Ok(values)
    }
}

/// Error for a flag that a view does not have.
fn not_applicable(flag: &str, kind: &str, settings: &[Setting]) -> UsageError {
    let mut known: Vec<_> = settings
        .iter()
        .filter_map(|setting| Some(format!("--{}", setting.flag?)))
        .collect();
    known.dedup();
    UsageError(format!(
        "--{flag} does not apply to this view ({kind}); it has {}",
        known.join(", ")
    ))
}

/// Error for a value that none of the settings with a flag accepts.
fn no_such_value(flag: &str, text: &str, settings: &[&Setting]) -> UsageError {
    let mut names = Vec::new();
    for setting in settings {
        match &setting.control {
            Control::Choice { options, .. } => names.extend(options.iter().cloned()),
            Control::Number { range, unit, .. } => {
                let unit = if unit.is_empty() { "" } else { " " }.to_owned() + unit;
                return UsageError(format!(
                    "--{flag} {text}: give a number from {} to {}{unit}",
                    range.start(),
                    range.end()
                ));
            }
            Control::Toggle { .. } | Control::Save { .. } => {
                return UsageError(format!("--{flag} {text}: give on or off"));
            }
        }
    }
    UsageError(format!(
        "there is no {flag} \"{text}\"; there are: {}",
        names.join(", ")
    ))
}
