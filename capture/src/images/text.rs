//! Numbers in plain text files.

use super::ImagesError;
use std::path::Path;

/// All numbers of a text file, in whatever lines; exactly `count` of them.
pub(super) fn numbers(path: &Path, count: usize, what: &str) -> Result<Vec<f64>, ImagesError> {
    let text = std::fs::read_to_string(path).map_err(|cause| ImagesError::io(path, cause))?;
    let numbers: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
    match numbers {
        Ok(numbers) if numbers.len() == count && numbers.iter().all(|n| n.is_finite()) => Ok(numbers),
        _ => Err(ImagesError::field(path, what, format!("must hold {count} finite numbers"))),
    }
}
