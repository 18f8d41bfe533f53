//! How errors are said: one sentence of what, where and what to do, each cause once, in the words of users.

use headbox_core::words::plain;
use clap::error::{ContextKind, ContextValue};
use std::error::Error;
use std::fmt::Write;
use std::io::IsTerminal;
use std::path::Path;

/// A mistake in what the user asked for, as opposed to a failure in doing it: exit code 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct UsageError(pub(super) String);

/// An error and its causes as one sentence. A cause that an outer error has already said is not said again.
pub(super) fn sentence(error: &anyhow::Error) -> String {
    let mut said = String::new();
    for cause in error.chain() {
        let words = plain(&cause.to_string());
        if said.is_empty() {
            said = words;
        } else if !said.contains(&words) {
            // Writing to a string cannot fail.
            let _ = write!(said, ": {words}");
        }
    }
    // A file without a name is said to be one.
    if said.starts_with(": ") { format!("''{said}") } else { said }
}

/// So many of something: `1 file`, `2 files`.
pub(super) fn counted(count: impl Into<u64>, thing: &str) -> String {
    let count = count.into();
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

/// A file's name as a shell takes it.
pub(super) fn quoted(path: &Path) -> String {
    let name = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+=:@%,".contains(c);
    if !name.is_empty() && name.chars().all(is_plain) { name } else { format!("'{}'", name.replace('\'', "'\\''")) }
}

/// Says what is wrong with the arguments, in the same words as all else, and ends the program; so it does with what was asked for by
/// `--help`.
pub(super) fn end_with(mut error: clap::Error) -> ! {
    // Advice on how to pass as a file name what was meant as a number.
    error.remove(ContextKind::Suggested);
    if !error.use_stderr() {
        error.exit();
    }
    let rendered = error.render();
    let in_colour = cfg!(unix) && std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    let said = if in_colour { rendered.ansi().to_string() } else { rendered.to_string() };
    eprint!("{}", about_arguments(&error, said));
    std::process::exit(error.exit_code())
}

/// What was said of arguments, with the parser's cause in our words and a tip where another command has such an argument.
fn about_arguments(error: &clap::Error, said: String) -> String {
    let context = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => text.clone(),
        Some(ContextValue::StyledStr(text)) => text.to_string(),
        _ => String::new(),
    };
    if let Some(cause) = error.source().map(ToString::to_string) {
        let ours = about_value(&cause, &context(ContextKind::InvalidValue));
        return ours.map_or(said.clone(), |ours| said.replacen(&format!(": {cause}"), &format!(": {ours}"), 1));
    }
    let is_of_eye = ["headbox truth", "headbox render"].iter().any(|of| context(ContextKind::Usage).contains(of));
    if context(ContextKind::InvalidArg) == "--center" && is_of_eye {
        return said.replacen("\n\nUsage", "\n\n  tip: --eye says where the picture is taken from\n\nUsage", 1);
    }
    said
}

/// What a number is to be; `None` if the cause is in our words already.
fn about_value(cause: &str, value: &str) -> Option<String> {
    /// Limits above this are those of a type, and no limits to a person.
    const NO_LIMIT: u64 = 1 << 53;
    if let Some((low, high)) = cause.split_once(" is not in ").and_then(|(_, range)| range.split_once("..")) {
        let high = match high.strip_prefix('=') {
            Some(high) => high.parse().ok()?,
            None => high.parse::<u64>().ok()?.checked_sub(1)?,
        };
        return Some(match high {
            0..NO_LIMIT => format!("give a whole number from {low} to {high}"),
            _ => format!("give a whole number, {low} or more"),
        });
    }
    let is_negative = value.strip_prefix('-').is_some_and(|digits| digits.parse::<u64>().is_ok());
    let ours = match cause {
        "invalid digit found in string" if is_negative => "give a whole number, 0 or more",
        "invalid digit found in string" | "cannot parse integer from empty string" => "give a whole number",
        "number too large to fit in target type" => "give a smaller number",
        "number too small to fit in target type" => "give a larger number",
        "invalid float literal" | "cannot parse float from empty string" => "give a number",
        "invalid IP address syntax" => "give the address of a network interface, such as 127.0.0.1, or 0.0.0.0 for all",
        _ => return None,
    };
    Some(ours.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context;

    #[derive(Debug, thiserror::Error)]
    #[error("a.ldi: {source}")]
    struct Outer {
        source: std::io::Error,
    }

    #[test]
    fn names_are_quoted_and_things_counted() {
        for (name, said) in [("a/b-1.ldi", "a/b-1.ldi"), ("a b.ldi", "'a b.ldi'"), ("it's", "'it'\\''s'"), ("", "''")] {
            assert_eq!(quoted(Path::new(name)), said);
        }
        assert_eq!([counted(0_u32, "file"), counted(1_u32, "file")], ["0 files", "1 file"]);
    }

    #[test]
    fn ranges_are_said_in_words() {
        let words = |cause| about_value(cause, "x");
        assert_eq!(words("0 is not in 1..=8192").unwrap(), "give a whole number from 1 to 8192");
        assert_eq!(words("0 is not in 2..18446744073709551615").unwrap(), "give a whole number, 2 or more");
        assert_eq!(words("9 is not in 1..9").unwrap(), "give a whole number from 1 to 8");
        assert_eq!(words("give y or z"), None);
    }

    #[test]
    fn every_cause_is_said_once_in_plain_words() {
        let missing = || std::io::Error::from_raw_os_error(2);
        if missing().to_string().starts_with("No such file") {
            let outer = Outer { source: missing() };
            assert_eq!(sentence(&outer.into()), "a.ldi: there is no such file");
            let wrapped: anyhow::Result<()> = Err(missing()).context("b.png could not be read");
            assert_eq!(sentence(&wrapped.unwrap_err()), "b.png could not be read: there is no such file");
        }
        assert_eq!(sentence(&anyhow::anyhow!("odd (os error 7) thing (os error")), "odd thing (os error");
    }
}
