//! File names in titles.

use std::path::Path;

/// Name of a file without its folder.
pub(super) fn file_name(file: &Path) -> String {
    file.file_name()
        .unwrap_or(file.as_os_str())
        .to_string_lossy()
        .into_owned()
}
