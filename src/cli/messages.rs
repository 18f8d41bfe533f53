//! Error messages: an error and its causes on one line.

use std::fmt::Write;
use std::path::Path;

/// A mistake in what the user asked for, as opposed to a failure in doing it: exit code 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct UsageError(pub(super) String);

/// An error and its causes as one sentence. A cause that an outer error has already said is not
/// said again.
pub(super) fn sentence(error: &anyhow::Error) -> String {
    let mut said = String::new();
    for cause in error.chain() {
        let words = cause.to_string();
        if said.is_empty() {
            said = words;
        } else if !said.contains(&words) {
            // Writing to a string cannot fail.
            let _ = write!(said, ": {words}");
        }
    }
    // A file without a name is said to be one.
    if said.starts_with(": ") {
        format!("''{said}")
    } else {
        said
    }
}

/// Formats a count: `1 file`, `2 files`.
pub(super) fn counted(count: impl Into<u64>, thing: &str) -> String {
    let count = count.into();
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

/// A file's name as a shell takes it.
pub(super) fn quoted(path: &Path) -> String {
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
            assert_eq!(quoted(Path::new(name)), said);
        }
        assert_eq!(
            [counted(0_u32, "file"), counted(1_u32, "file")],
            ["0 files", "1 file"]
        );
    }

    #[test]
    fn causes_are_not_repeated() {
        let cause = || std::io::Error::other("disk on fire");
        assert_eq!(
            sentence(&Outer { source: cause() }.into()),
            "a.ldi: disk on fire"
        );
        let wrapped: anyhow::Result<()> = Err(cause()).context("b.png could not be read");
        assert_eq!(
            sentence(&wrapped.unwrap_err()),
            "b.png could not be read: disk on fire"
        );
    }
}
