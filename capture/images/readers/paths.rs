//! Paths in the files of a set.

use crate::ImagesError;
use headbox_core::files;
use std::ffi::OsStr;
use std::path::{Component, Path, PathBuf};

/// Resolves a path in a manifest relative to the manifest's folder. Backslashes are separators if
/// no file has them in its name; a file whose name differs in case alone is found. A path out of
/// that folder is an error unless `allow_outside`.
pub(crate) fn resolve(
    manifest: &Path,
    field: &str,
    written: &str,
    allow_outside: bool,
) -> Result<PathBuf, ImagesError> {
    if written.is_empty() {
        let cause = "is empty, not a file name";
        return Err(ImagesError::field(manifest, field, cause));
    }
    let folder = manifest.parent().unwrap_or(Path::new(""));
    let slashed = written.replace('\\', "/");
    let escapes = |path: &str| {
        let mut depth = 0i32;
        let has_drive = path.get(1..3) == Some(":/");
        has_drive
            || Path::new(path).is_absolute()
            || Path::new(path).components().any(|component| {
                depth += match component {
                    Component::ParentDir => -1,
                    Component::Normal(_) => 1,
                    _ => 0,
                };
                depth < 0
            })
    };
    if (escapes(written) || escapes(&slashed)) && !allow_outside {
        return Err(ImagesError::Outside {
            path: manifest.into(),
            field: field.into(),
            leads_to: written.into(),
        });
    }
    Ok(find_file(folder, written))
}

/// Returns `folder/written`, or else the file that differs in separators and case alone.
pub(super) fn find_file(folder: &Path, written: &str) -> PathBuf {
    let exact = folder.join(written);
    if exact.exists() {
        return exact;
    }
    let slashed = written.replace('\\', "/");
    let ignoring_case = files::find_similar(folder, Path::new(&slashed), |written| {
        let wanted = written.to_lowercase();
        move |name: &OsStr| name.to_string_lossy().to_lowercase() == wanted
    });
    ignoring_case.unwrap_or_else(|| folder.join(slashed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn path_out_of_folder_refused() {
        let manifest = Path::new("/data/set/manifest.json");
        let resolve_path = |written, allow| resolve(manifest, "color", written, allow);
        assert_eq!(
            resolve_path("a/../b.png", false).expect("inside"),
            Path::new("/data/set/a/../b.png")
        );
        for outside in [
            "../b.png",
            "a/../../b.png",
            "/etc/passwd",
            "a\\..\\..\\b.png",
            "C:\\set\\b.png",
        ] {
            let error = resolve_path(outside, false).expect_err(outside).to_string();
            assert!(
                error.contains("manifest.json") && error.contains("color"),
                "{error}"
            );
            assert!(resolve_path(outside, true).is_ok());
        }
        assert!(
            resolve_path("", true)
                .expect_err("no name")
                .to_string()
                .contains("not a file name")
        );
    }

    #[test]
    fn separators_and_case_matched() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::create_dir(folder.path().join("Images")).expect("made");
        for name in ["Images/0.JPG", "Images/a\\b.png"] {
            std::fs::write(folder.path().join(name), b"").expect("written");
        }
        let manifest = folder.path().join("transforms.json");
        let found = |written| {
            let path = resolve(&manifest, "file_path", written, false).expect("inside");
            let relative = path.strip_prefix(folder.path()).expect("inside");
            relative.to_string_lossy().into_owned()
        };
        assert_eq!(found("./images/0.jpg"), "Images/0.JPG");
        assert_eq!(found("images\\0.jpg"), "Images/0.JPG");
        assert_eq!(found("Images/a\\b.png"), "Images/a\\b.png", "as written");
        assert_eq!(found("images\\1.jpg"), "images/1.jpg", "missing");
    }
}
