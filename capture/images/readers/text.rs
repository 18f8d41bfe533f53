//! Numbers in plain text files, lists of files, and file names in messages.

use crate::ImagesError;
use headbox_core::files::InputFolder;
use headbox_core::read_note::ReadNote;
use std::path::{Path, PathBuf};

/// Lists the files and folders in a folder, sorted by name.
pub(super) fn list_folder(folder: &Path) -> Result<Vec<PathBuf>, ImagesError> {
    let paths: std::io::Result<Vec<PathBuf>> =
        std::fs::read_dir(folder).and_then(|entries| entries.map(|e| Ok(e?.path())).collect());
    let mut paths = paths.map_err(|cause| ImagesError::io(folder, cause))?;
    paths.sort();
    Ok(paths)
}

/// Reads a file of a set.
pub(crate) fn read_bytes(folder: &InputFolder, file: &Path) -> Result<Vec<u8>, ImagesError> {
    folder
        .read(file)
        .map_err(|cause| ImagesError::io(file, cause))
}

/// Reads a text file of a set, without a byte order mark.
pub(super) fn read_text(folder: &InputFolder, file: &Path) -> Result<String, ImagesError> {
    let text = folder.read_text(file);
    let text = text.map_err(|cause| ImagesError::io(file, cause))?;
    Ok(text
        .strip_prefix('\u{feff}')
        .map(str::to_owned)
        .unwrap_or(text))
}

/// Returns the lines of a text that are not comments, numbered from 1.
pub(super) fn numbered_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .zip(1..)
        .map(|(line, number)| (number, line.trim()))
        .filter(|(_, line)| !line.starts_with('#'))
}

/// Reads a text file of numbers, regardless of line breaks; numbers may be `nan` or infinite.
pub(super) fn read_number_list(folder: &InputFolder, path: &Path) -> Result<Vec<f64>, ImagesError> {
    let text = read_text(folder, path)?;
    let words = text
        .split([' ', '\t', ',', '\r', '\n'])
        .filter(|word| !word.is_empty());
    let numbers: Result<Vec<f64>, _> = words.map(str::parse).collect();
    numbers.map_err(|_| ImagesError::field(path, "the file", "must hold numbers alone"))
}

/// Reads a text file of exactly `count` numbers, regardless of line breaks. `field` names them in
/// errors.
pub(super) fn read_numbers(
    folder: &InputFolder,
    path: &Path,
    count: usize,
    field: &str,
) -> Result<Vec<f64>, ImagesError> {
    let text = read_text(folder, path)?;
    let numbers: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
    match numbers {
        Ok(numbers) if numbers.len() == count && numbers.iter().all(|n| n.is_finite()) => {
            Ok(numbers)
        }
        _ => Err(ImagesError::field(
            path,
            field,
            format!("must hold {count} finite numbers"),
        )),
    }
}

/// Returns the name of a file without its folder.
pub(super) fn file_name(path: &Path) -> String {
    path.file_name()
        .map(|name| name.to_string_lossy().into_owned())
        .unwrap_or_default()
}

/// Note on views that have an image alone.
pub(super) const WITHOUT_DEPTH: &str = "without depth";

/// Creates a note that lists names, and displays the first; `None` if there are no names.
pub(super) fn note_names(sentence: &str, names: &[String]) -> Option<ReadNote> {
    (!names.is_empty()).then(|| ReadNote::with_names(sentence, names, 1))
}

/// Abbreviates a list of names to the first and the number of others; `None` if it is empty.
pub(crate) fn abbreviate(names: &[String]) -> Option<String> {
    let (first, more) = names.split_first()?;
    Some(if more.is_empty() {
        first.clone()
    } else {
        format!("{first} and {} more", more.len())
    })
}
