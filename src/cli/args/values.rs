//! Parsers of values, and refusals of options that do not apply.

use crate::messages::UsageError;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::file_frame::UpAxis;

/// Parses three finite numbers, `X,Y,Z`.
pub(crate) fn parse_vector(text: &str) -> Result<DVec3, String> {
    let parts: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match parts.as_deref() {
        Ok(&[x, y, z]) if [x, y, z].iter().all(|c| c.is_finite()) => Ok(DVec3::new(x, y, z)),
        _ => Err("give three finite numbers separated by commas, such as 0.5,1.6,-2".into()),
    }
}

/// Parses a positive, finite length.
pub(crate) fn parse_length(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(length) if length > 0.0 && f64::is_finite(length) => Ok(length),
        _ => Err("give a finite number greater than 0".into()),
    }
}

/// Parses an image size, `WIDTHxHEIGHT`.
pub(crate) fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let allowed = 1..=Camera::MAX_SIDE_PX;
    match parse_sides(text) {
        Some((w, h)) if allowed.contains(&w) && allowed.contains(&h) => Ok((w, h)),
        _ => Err(format!(
            "give WIDTHxHEIGHT in pixels, each from 1 to {}, such as 1024x768",
            Camera::MAX_SIDE_PX
        )),
    }
}

/// Parses two integers, `AxB`.
pub(crate) fn parse_sides(text: &str) -> Option<(u32, u32)> {
    let (a, b) = text.split_once(['x', 'X'])?;
    Some((a.parse().ok()?, b.parse().ok()?))
}

/// Parses an up axis.
pub(crate) fn parse_up(text: &str) -> Result<UpAxis, String> {
    match text {
        "y" => Ok(UpAxis::Y),
        "z" => Ok(UpAxis::Z),
        _ => Err("give y or z".into()),
    }
}

/// Key and value.
pub(crate) type Pair<'t> = (&'t str, &'t str);

/// Splits `NAME@KEY=VALUE@KEY=VALUE` into the name, which may contain an `@` that no key follows,
/// and the pairs of keys and values.
pub(crate) fn split_settings<'t>(
    text: &'t str,
    keys: &[&str],
) -> Result<(&'t str, Vec<Pair<'t>>), String> {
    let first = keys
        .iter()
        .filter_map(|key| text.find(&format!("@{key}=")))
        .min();
    let (name, rest) = text.split_at(first.unwrap_or(text.len()));
    let pair = |part: &'t str| {
        part.split_once('=')
            .ok_or_else(|| format!("{part}: give one of {}=", keys.join("=, ")))
    };
    let pairs: Result<_, _> = rest.split('@').skip(1).map(pair).collect();
    Ok((name, pairs?))
}

/// Parses the name of a unit of length; returns metres.
pub(crate) fn parse_unit(text: &str) -> Result<f64, String> {
    let unit = UNITS
        .iter()
        .find(|(name, ..)| *name == text)
        .map(|(.., metres)| *metres);
    unit.ok_or_else(|| {
        let names: Vec<_> = UNITS.iter().map(|(name, ..)| *name).collect();
        format!("give one of {}", names.join(", "))
    })
}

/// Table of named values: name, help text, value.
pub(crate) type Names<T> = &'static [(&'static str, &'static str, T)];

/// Creates a parser of the names in a table.
pub(crate) fn by_name<T: Copy + Send + Sync + 'static>(
    names: Names<T>,
) -> impl TypedValueParser<Value = T> {
    let possible = names.iter().map(|(name, help, _)| {
        if help.is_empty() {
            PossibleValue::new(name)
        } else {
            PossibleValue::new(name).help(help)
        }
    });
    let find = |name: String| {
        names
            .iter()
            .find(|(known, ..)| *known == name)
            .map(|(.., value)| *value)
    };
    PossibleValuesParser::new(possible).try_map(move |name| find(name).ok_or("not one of them"))
}

/// Refuses the first given flag as meaningless for a kind of input.
pub(crate) fn refuse_given(
    kind: &str,
    flags: impl IntoIterator<Item = (&'static str, bool)>,
) -> Result<(), UsageError> {
    match flags.into_iter().find(|(_, is_given)| *is_given) {
        Some((flag, _)) => Err(UsageError(format!(
            "{flag} has no meaning for {kind}; leave it out"
        ))),
        None => Ok(()),
    }
}

/// Refuses the first given flag as one for another kind of input.
pub(crate) fn refuse_misplaced(
    kind: &str,
    flags: impl IntoIterator<Item = (&'static str, bool)>,
) -> Result<(), UsageError> {
    match flags.into_iter().find(|(_, is_given)| *is_given) {
        Some((flag, _)) => Err(UsageError(format!("{flag} is for {kind}; leave it out"))),
        None => Ok(()),
    }
}

/// Units of a file's lengths, metres.
pub(crate) const UNITS: Names<f64> = &[
    ("m", "", 1.0),
    ("dm", "", 0.1),
    ("cm", "", 0.01),
    ("mm", "", 0.001),
    ("in", "", 0.0254),
    ("ft", "", 0.3048),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_sane_values_parse() {
        assert_eq!(
            parse_vector("-1, 2.5,3e2"),
            Ok(DVec3::new(-1.0, 2.5, 300.0))
        );
        for bad in ["", "1,2", "1,2,3,4", "nan,0,0", "inf,0,0", "a,b,c"] {
            assert!(parse_vector(bad).is_err(), "{bad}");
        }
        assert!(
            parse_length("0").is_err()
                && parse_length("-1").is_err()
                && parse_length("nan").is_err()
        );
        assert_eq!(parse_size("640x480"), Ok((640, 480)));
        for bad in ["0x4", "640", "x", "99999x9", "-1x5"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }
}
