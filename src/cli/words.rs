//! How errors are said: one sentence of what, where and what to do, each cause once, in the words of users.

use std::fmt::Write;

/// A mistake in what the user asked for, as opposed to a failure in doing it: exit code 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct UsageError(pub(super) String);

/// An error and its causes as one sentence. A cause that an outer error has already said is not said again.
pub(super) fn sentence(error: &anyhow::Error) -> String {
    let mut said = String::new();
    for cause in error.chain() {
        let words = in_plain_words(&cause.to_string());
        if said.is_empty() {
            said = words;
        } else if !said.contains(&words) {
            // Writing to a string cannot fail.
            let _ = write!(said, ": {words}");
        }
    }
    said
}

/// Without the system's numbers, and with our words for its commonest ones.
fn in_plain_words(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find(" (os error ") {
        let Some(end) = rest[at..].find(')') else { break };
        plain.push_str(&rest[..at]);
        rest = &rest[at + end + 1..];
    }
    plain.push_str(rest);
    const OURS: [(&str, &str); 5] = [
        ("No such file or directory", "there is no such file"),
        ("Is a directory", "it is a folder; give the name of a file"),
        ("Not a directory", "a file stands where a folder is needed"),
        ("Permission denied", "the system does not permit it"),
        ("No space left on device", "the disk is full"),
    ];
    OURS.iter().fold(plain, |plain, (theirs, ours)| plain.replace(theirs, ours))
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
