//! Texts of messages: errors with their causes, counts, quoted file names.

use std::borrow::Cow;
use std::path::Path;

/// Wrong usage, as opposed to a failure of the work: exit code 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct UsageError(pub(super) String);

/// Formats an error and its causes on one line, without causes that an outer error already
/// contains.
pub(super) fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain() {
        let text = cause.to_string();
        if line.is_empty() {
            line = text;
        } else if !line.contains(&text) {
            line = line + ": " + &text;
        }
    }
    // An empty file name is shown as ''.
    if line.starts_with(": ") {
        line.insert_str(0, "''");
    }
    join_lines(&line)
}

/// Escapes line breaks, which the name of a file can contain.
pub(super) fn join_lines(text: &str) -> String {
    text.replace('\n', "\\n")
}

/// Escapes characters that control a terminal or reverse the direction of text, except line breaks
/// and tabs, as `\u001b`: this is also their escape in JSON strings.
pub(super) fn escape_controls(text: &str) -> Cow<'_, str> {
    let is_harmful = |c: char| {
        let is_direction = matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        is_direction || c.is_control() && !matches!(c, '\n' | '\t')
    };
    if !text.contains(is_harmful) {
        return text.into();
    }
    let mut escaped = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_harmful(c) {
            escaped += &format!("\\u{:04x}", u32::from(c));
        } else {
            escaped.push(c);
        }
    }
    escaped.into()
}

/// Formats a count: `1 file`, `2 files`.
pub(super) fn format_count(count: impl Into<u64>, thing: &str) -> String {
    let count = count.into();
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

/// Quotes a file's name for a shell, if necessary.
pub(super) fn shell_quote(path: &Path) -> String {
    let name = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+=:@%,".contains(c);
    if !name.is_empty() && name.chars().all(is_plain) {
        name
    } else {
        format!("'{}'", name.replace('\'', "'\\''"))
    }
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
        for (name, said) in [
            ("a/b-1.ldi", "a/b-1.ldi"),
            ("a b.ldi", "'a b.ldi'"),
            ("it's", "'it'\\''s'"),
            ("", "''"),
        ] {
            assert_eq!(shell_quote(Path::new(name)), said);
        }
        assert_eq!(
            [format_count(0_u32, "file"), format_count(1_u32, "file")],
            ["0 files", "1 file"]
        );
    }

    #[test]
    fn control_characters_are_escaped() {
        assert_eq!(
            escape_controls("a\x1b[31m\u{9b}b\u{202e}\tc\r\nd"),
            "a\\u001b[31m\\u009bb\\u202e\tc\\u000d\nd"
        );
        assert!(matches!(escape_controls("m² \n"), Cow::Borrowed(_)));
        assert_eq!(join_lines("a\nb"), "a\\nb");
    }

    #[test]
    fn causes_are_not_repeated() {
        let cause = || std::io::Error::other("disk on fire");
        assert_eq!(
            one_line(&Outer { source: cause() }.into()),
            "a.ldi: disk on fire"
        );
        let wrapped: anyhow::Result<()> = Err(cause()).context("b.png could not be read");
        assert_eq!(
            one_line(&wrapped.unwrap_err()),
            "b.png could not be read: disk on fire"
        );
    }
}
