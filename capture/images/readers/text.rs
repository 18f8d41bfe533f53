//! Numbers in plain text files, and names of files in sentences.

use crate::ImagesError;
use std::path::Path;

/// All numbers of a text file, in whatever lines; exactly `count` of them.
pub(super) fn numbers(path: &Path, count: usize, what: &str) -> Result<Vec<f64>, ImagesError> {
    let text = std::fs::read_to_string(path).map_err(|cause| ImagesError::io(path, cause))?;
    let numbers: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
    match numbers {
        Ok(numbers) if numbers.len() == count && numbers.iter().all(|n| n.is_finite()) => {
            Ok(numbers)
        }
        _ => Err(ImagesError::field(
            path,
            what,
            format!("must hold {count} finite numbers"),
        )),
    }
}

/// The name of a file without its folder.
pub(super) fn file_name(path: &Path) -> String {
    path.file_name()
        .map(|name| name.to_string_lossy().into_owned())
        .unwrap_or_default()
}

/// The first of some names, and how many more there are; `None` of none.
pub(crate) fn first_of(names: &[String]) -> Option<String> {
    let (first, more) = names.split_first()?;
    Some(if more.is_empty() {
        first.clone()
    } else {
        format!("{first} and {} more", more.len())
    })
}
