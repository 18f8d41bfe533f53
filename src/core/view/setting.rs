//! Settings of a view as data: the window makes controls and the command line makes flags of them,
//! without knowing their meaning.

use super::EXPOSURE;
use std::{collections::BTreeMap, ops::RangeInclusive};

/// Setting of a view: a control in the window, and a flag of `headbox render` if it names one.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Name in code; unique within a view.
    pub id: &'static str,
    /// Heading above the control.
    pub group: String,
    /// True if the heading is initially folded (the first setting under it decides).
    pub folded: bool,
    /// Text beside the control.
    pub label: String,
    /// Effect, with the unit: shown when the pointer rests on the control.
    pub tooltip: String,
    /// Kind, range and initial value.
    pub control: Control,
    /// Long flag on the command line, without dashes; `None` if only the window has the setting.
    pub flag: Option<&'static str>,
    /// Aliases of options, each with its option.
    pub aliases: &'static [(&'static str, &'static str)],
}

/// Kind of a control.
#[derive(Clone, Debug, PartialEq)]
pub enum Control {
    /// On or off.
    Toggle {
        /// Initial state.
        on: bool,
    },
    /// One of several options.
    Choice {
        /// Names of the options, at least one.
        options: Vec<String>,
        /// Index of the initial option.
        selected: usize,
    },
    /// A number.
    Number {
        /// Initial value.
        value: f64,
        /// Smallest and largest value.
        range: RangeInclusive<f64>,
        /// Smallest change; 1 for whole numbers, 0 for a continuous range.
        step: f64,
        /// Unit as it is printed behind the value, or "".
        unit: &'static str,
        /// True for a logarithmic slider.
        logarithmic: bool,
    },
    /// A button of the window that asks where to save a file, then has the source write it.
    Save {
        /// Start of the proposed name.
        stem: String,
        /// Extension, without the dot.
        extension: &'static str,
    },
}

impl Setting {
    /// Creates a control of any kind, under the heading "View".
    pub fn new(id: &'static str, label: &str, tooltip: &str, control: Control) -> Self {
        Self {
            id,
            group: "View".into(),
            folded: false,
            label: label.into(),
            tooltip: tooltip.into(),
            control,
            flag: None,
            aliases: &[],
        }
    }

    /// Creates a check box.
    pub fn toggle(id: &'static str, label: &str, tooltip: &str, on: bool) -> Self {
        Self::new(id, label, tooltip, Control::Toggle { on })
    }

    /// Creates a choice; the first option is the initial one.
    pub fn choice(id: &'static str, label: &str, tooltip: &str, options: &[&str]) -> Self {
        Self::choice_at(id, label, tooltip, options, 0)
    }

    /// Creates a choice; `options[selected]` is the initial option.
    pub fn choice_at(
        id: &'static str,
        label: &str,
        tooltip: &str,
        options: &[&str],
        selected: usize,
    ) -> Self {
        let options = options.iter().map(ToString::to_string).collect();
        Self::new(id, label, tooltip, Control::Choice { options, selected })
    }

    /// Creates a slider over a continuous range.
    pub fn number(
        id: &'static str,
        label: &str,
        tooltip: &str,
        value: f64,
        range: RangeInclusive<f64>,
        unit: &'static str,
    ) -> Self {
        let control = Control::Number {
            value,
            range,
            step: 0.0,
            unit,
            logarithmic: false,
        };
        Self::new(id, label, tooltip, control)
    }

    /// Creates the slider of the exposure relative to that of the stored colours, for
    /// [`expose`](super::paint::expose).
    pub fn exposure() -> Self {
        /// Maximum change, stops.
        const MAX_STOPS: f64 = 16.0;
        Self::number(
            EXPOSURE,
            "Exposure",
            "Exposure of the frame relative to the file, stops; a file made with --tone hdr keeps \
             light above white.",
            0.0,
            -MAX_STOPS..=MAX_STOPS,
            "stops",
        )
        .with_flag(EXPOSURE)
    }

    /// Creates a slider over whole numbers.
    pub fn count(
        id: &'static str,
        label: &str,
        tooltip: &str,
        value: u32,
        range: RangeInclusive<u32>,
    ) -> Self {
        let range = f64::from(*range.start())..=f64::from(*range.end());
        let control = Control::Number {
            value: value.into(),
            range,
            step: 1.0,
            unit: "",
            logarithmic: false,
        };
        Self::new(id, label, tooltip, control)
    }

    /// Creates a button that saves a file of this extension, which is named without its dot.
    pub fn save(
        id: &'static str,
        label: &str,
        tooltip: &str,
        stem: &str,
        extension: &'static str,
    ) -> Self {
        let stem = stem.into();
        Self::new(id, label, tooltip, Control::Save { stem, extension })
    }

    /// Adds a flag on the command line, without dashes.
    #[must_use]
    pub fn with_flag(self, flag: &'static str) -> Self {
        Self {
            flag: Some(flag),
            ..self
        }
    }

    /// Adds aliases of the options of a choice.
    #[must_use]
    pub fn with_aliases(self, aliases: &'static [(&'static str, &'static str)]) -> Self {
        Self { aliases, ..self }
    }

    /// Moves the control under another heading.
    #[must_use]
    pub fn under(mut self, group: &str) -> Self {
        self.group = group.into();
        self
    }

    /// Moves the control under another heading that is initially folded.
    #[must_use]
    pub fn folded_under(self, group: &str) -> Self {
        Self {
            folded: true,
            ..self.under(group)
        }
    }
}

/// Value of a setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SettingValue {
    /// State of a toggle.
    Toggle(bool),
    /// Index of the selected option of a choice.
    Choice(usize),
    /// Value of a number.
    Number(f64),
}

/// Values of all settings of a view, by id.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SettingValues(BTreeMap<&'static str, SettingValue>);

/// Error of reading or setting a value.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SettingError {
    /// There is no setting of this id and kind.
    #[error("there is no {kind} named \"{id}\" among the settings of this view")]
    Unknown {
        /// Requested id.
        id: String,
        /// Requested kind.
        kind: &'static str,
    },
    /// There is no setting of this id.
    #[error("there is no setting \"{id}\" in this view; there are: {known}")]
    NoSuch {
        /// Requested id.
        id: String,
        /// Existing ids.
        known: String,
    },
    /// The text is not a value of the setting.
    #[error("\"{text}\" is not a value of the setting \"{id}\"; expected {expected}")]
    Value {
        /// Id of the setting.
        id: String,
        /// Specified text.
        text: String,
        /// Valid values.
        expected: String,
    },
}

impl SettingError {
    fn unknown(id: &str, kind: &'static str) -> Self {
        let id = id.into();
        Self::Unknown { id, kind }
    }
}

impl From<SettingError> for String {
    fn from(error: SettingError) -> Self {
        error.to_string()
    }
}

impl SettingValues {
    /// Returns the initial values of `settings`.
    pub fn initial(settings: &[Setting]) -> Self {
        let values = settings.iter().filter_map(|setting| {
            let value = match &setting.control {
                Control::Toggle { on } => SettingValue::Toggle(*on),
                Control::Choice { selected, .. } => SettingValue::Choice(*selected),
                Control::Number { value, .. } => SettingValue::Number(*value),
                Control::Save { .. } => return None,
            };
            Some((setting.id, value))
        });
        Self(values.collect())
    }

    /// Returns the state of a toggle.
    ///
    /// # Errors
    /// [`SettingError::Unknown`] if the source declared no such toggle.
    pub fn toggle(&self, id: &str) -> Result<bool, SettingError> {
        match self.0.get(id) {
            Some(SettingValue::Toggle(on)) => Ok(*on),
            _ => Err(SettingError::unknown(id, "toggle")),
        }
    }

    /// Returns the index of the selected option.
    ///
    /// # Errors
    /// [`SettingError::Unknown`] if the source declared no such choice.
    pub fn choice(&self, id: &str) -> Result<usize, SettingError> {
        match self.0.get(id) {
            Some(SettingValue::Choice(index)) => Ok(*index),
            _ => Err(SettingError::unknown(id, "choice")),
        }
    }

    /// Returns the value of a number.
    ///
    /// # Errors
    /// [`SettingError::Unknown`] if the source declared no such number.
    pub fn number(&self, id: &str) -> Result<f64, SettingError> {
        match self.0.get(id) {
            Some(SettingValue::Number(value)) => Ok(*value),
            _ => Err(SettingError::unknown(id, "number")),
        }
    }

    /// Returns the value of a setting in the format of [`Self::set_text`]; `None` for buttons.
    pub fn text(&self, setting: &Setting) -> Option<String> {
        Some(match (self.0.get(setting.id)?, &setting.control) {
            (SettingValue::Choice(index), Control::Choice { options, .. }) => {
                options.get(*index)?.clone()
            }
            (SettingValue::Toggle(on), _) => if *on { "on" } else { "off" }.into(),
            (SettingValue::Number(value), _) => value.to_string(),
            _ => return None,
        })
    }

    /// Returns the value of `id` for a control to modify.
    pub fn get_mut(&mut self, id: &str) -> Option<&mut SettingValue> {
        self.0.get_mut(id)
    }

    /// Sets the value of `id` from text: `on` or `off`, the name of an option (any case), or a
    /// number.
    ///
    /// # Errors
    /// [`SettingError`] if `settings` has no such control or the text is not one of its values.
    pub fn set_text(
        &mut self,
        settings: &[Setting],
        id: &str,
        text: &str,
    ) -> Result<(), SettingError> {
        let unknown = || {
            let ids: Vec<&str> = settings.iter().map(|setting| setting.id).collect();
            SettingError::NoSuch {
                id: id.into(),
                known: ids.join(", "),
            }
        };
        let setting = settings.iter().find(|s| s.id == id).ok_or_else(unknown)?;
        let wrong = |expected: String| SettingError::Value {
            id: id.into(),
            text: text.into(),
            expected,
        };
        let value = match &setting.control {
            Control::Toggle { .. } => match text {
                "on" | "true" => SettingValue::Toggle(true),
                "off" | "false" => SettingValue::Toggle(false),
                _ => return Err(wrong("on or off".into())),
            },
            Control::Choice { options, .. } => {
                let alias = setting.aliases.iter().find(|(alias, _)| *alias == text);
                let name = alias.map_or(text, |(_, option)| option);
                let index = options
                    .iter()
                    .position(|option| option.eq_ignore_ascii_case(name));
                SettingValue::Choice(index.ok_or_else(|| wrong(options.join(", ")))?)
            }
            Control::Number { range, .. } => {
                let value = text
                    .parse()
                    .ok()
                    .filter(|value: &f64| range.contains(value));
                let (low, high) = (range.start(), range.end());
                let expected = || format!("a number from {low} to {high}");
                SettingValue::Number(value.ok_or_else(|| wrong(expected()))?)
            }
            Control::Save { .. } => return Err(unknown()),
        };
        self.0.insert(setting.id, value);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> Vec<Setting> {
        vec![
            Setting::toggle(
                "clip",
                "Clipping",
                "Skips what lies outside the view.",
                true,
            ),
            Setting::choice(
                "kernel",
                "Kernel",
                "Shape of the splats.",
                &["Square", "Gauss"],
            )
            .with_aliases(&[("normal", "Gauss")]),
            Setting::number(
                "width",
                "Width",
                "Width of the splats in pixels.",
                1.5,
                0.5..=4.0,
                "px",
            ),
            Setting::save("save", "Save", "Writes the file.", "file", "txt"),
        ]
    }

    #[test]
    fn initial_values_and_typed_access() {
        let values = SettingValues::initial(&settings());
        assert_eq!(values.toggle("clip"), Ok(true));
        assert_eq!(values.choice("kernel"), Ok(0));
        assert_eq!(values.number("width"), Ok(1.5));
        assert!(values.toggle("kernel").is_err(), "the kind must fit");
        assert!(values.number("save").is_err(), "a button has no value");
    }

    #[test]
    fn values_from_text() {
        let (settings, mut values) = (settings(), SettingValues::initial(&settings()));
        for (id, text) in [("clip", "off"), ("kernel", "gauss"), ("width", "2")] {
            values.set_text(&settings, id, text).unwrap();
        }
        values.set_text(&settings, "kernel", "square").unwrap();
        values.set_text(&settings, "kernel", "normal").unwrap();
        let texts = settings[..3].iter().map(|setting| values.text(setting));
        assert!(texts.eq(["off", "Gauss", "2"].map(|text| Some(text.to_owned()))));
        assert_eq!(values.text(&settings[3]), None, "a button");
        assert_eq!(values.toggle("clip"), Ok(false));
        assert_eq!(values.choice("kernel"), Ok(1));
        assert_eq!(values.number("width"), Ok(2.0));
        for (id, text) in [
            ("clip", "2"),
            ("kernel", "disk"),
            ("width", "9"),
            ("width", "NaN"),
            ("save", "on"),
            ("x", "1"),
        ] {
            assert!(values.set_text(&settings, id, text).is_err(), "{id}={text}");
        }
    }
}
