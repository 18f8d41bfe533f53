//! Notes on data that were lost, limited or guessed while a file was read.

use serde::{Deserialize, Serialize};
use std::borrow::Borrow;
use std::fmt;
use std::ops::Deref;

/// A note on one kind of data that was lost, limited or guessed: a sentence, mostly with a count
/// and the names concerned.
///
/// The note is its complete sentence (`&note[..]`, and its text in JSON); it is displayed with the
/// first names only.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub struct ReadNote {
    complete: String,
    /// The sentence with the first names only, if there are more.
    brief: Option<String>,
}

impl ReadNote {
    /// Creates the note `SENTENCE: NAME, NAME`, of whose names `shown` are displayed.
    pub fn with_names<N: AsRef<str>>(sentence: &str, names: &[N], shown: usize) -> Self {
        let join = |names: &[N]| {
            let names: Vec<&str> = names.iter().map(AsRef::as_ref).collect();
            names.join(", ")
        };
        if names.is_empty() {
            return sentence.into();
        }
        let complete = format!("{sentence}: {}", join(names));
        let brief = names.split_at_checked(shown).and_then(|(first, more)| {
            let first = join(first);
            (!more.is_empty()).then(|| format!("{sentence}: {first} and {} more", more.len()))
        });
        Self { complete, brief }
    }
}

impl fmt::Display for ReadNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.brief.as_ref().unwrap_or(&self.complete))
    }
}

impl From<String> for ReadNote {
    fn from(complete: String) -> Self {
        Self {
            complete,
            brief: None,
        }
    }
}

impl From<&str> for ReadNote {
    fn from(complete: &str) -> Self {
        complete.to_owned().into()
    }
}

impl From<ReadNote> for String {
    fn from(note: ReadNote) -> Self {
        note.complete
    }
}

impl Deref for ReadNote {
    type Target = str;

    fn deref(&self) -> &str {
        &self.complete
    }
}

impl Borrow<str> for ReadNote {
    fn borrow(&self) -> &str {
        self
    }
}

/// Notes are equal if their complete sentences are.
impl<T: Borrow<str> + ?Sized> PartialEq<T> for ReadNote {
    fn eq(&self, other: &T) -> bool {
        let other: &str = other.borrow();
        self.complete == other
    }
}

impl Eq for ReadNote {}

/// Strict reading refuses an input, because there are notes on it.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{input}: strict reading refuses it, as not all was read as it is written: {}", join(.notes))]
pub struct StrictError {
    /// Name of the input.
    pub input: String,
    /// Notes on reading it.
    pub notes: Vec<ReadNote>,
}

/// Joins notes for a message.
fn join(notes: &[ReadNote]) -> String {
    let notes: Vec<String> = notes.iter().map(ToString::to_string).collect();
    notes.join("; ")
}

/// Checks that there are no notes on an input.
///
/// # Errors
/// [`StrictError`] if there are.
pub fn refuse(input: &str, notes: &[ReadNote]) -> Result<(), StrictError> {
    if notes.is_empty() {
        return Ok(());
    }
    Err(StrictError {
        input: input.to_owned(),
        notes: notes.to_vec(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_names_are_displayed_and_all_kept() {
        let note = ReadNote::with_names("3 textures left out", &["a", "b", "c"], 2);
        assert_eq!(note.to_string(), "3 textures left out: a, b and 1 more");
        assert_eq!(note, "3 textures left out: a, b, c");
        let json = serde_json::to_string(&note).expect("JSON");
        assert_eq!(json, "\"3 textures left out: a, b, c\"");
        let few = ReadNote::with_names("1 texture left out", &["a"], 2);
        assert_eq!(few.to_string(), "1 texture left out: a");
        let none = ReadNote::with_names::<&str>("nothing", &[], 2);
        assert_eq!(none.to_string(), "nothing");
    }

    #[test]
    fn strict_error_lists_every_note() {
        assert!(refuse("a.obj", &[]).is_ok());
        let notes = ["1 face left out".into(), "Z up assumed".into()];
        let error = refuse("a.obj", &notes).expect_err("refused").to_string();
        assert_eq!(
            error,
            "a.obj: strict reading refuses it, as not all was read as it is written: \
             1 face left out; Z up assumed"
        );
    }
}
