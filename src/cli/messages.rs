//! Texts of messages: errors with their causes, counts, quoted file names.

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
        format!("''{line}")
    } else {
        line
    }
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
