//! Paths in the files of a set.

use crate::ImagesError;
use headbox_core::files::{InputFolder, Refusal, find_similar, fold_name};
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

/// Resolves a path in a manifest relative to the manifest's folder. Backslashes are separators if
/// no file has them in its name; a file whose name differs in case alone is found.
///
/// # Errors
/// [`ImagesError::Outside`] for a path out of the set `folder`, unless a file with its end is in
/// the manifest's folder or below.
pub(crate) fn resolve(
    folder: &InputFolder,
    manifest: &Path,
    field: &str,
    written: &str,
) -> Result<PathBuf, ImagesError> {
    let base = manifest.parent().unwrap_or(Path::new(""));
    resolve_in(folder, base, manifest, field, written)
}

/// Same as [`resolve`], relative to the folder `base`.
pub(super) fn resolve_in(
    folder: &InputFolder,
    base: &Path,
    manifest: &Path,
    field: &str,
    written: &str,
) -> Result<PathBuf, ImagesError> {
    if written.is_empty() {
        let cause = "is empty, not a file name";
        return Err(ImagesError::field(manifest, field, cause));
    }
    let outside = || ImagesError::Outside {
        path: manifest.into(),
        field: field.into(),
        leads_to: written.into(),
    };
    match find_file(folder, base, written) {
        Ok(Some(found)) => Ok(found),
        Ok(None) if folder.leads_out(base, written) => Err(outside()),
        Ok(None) => Ok(base.join(written.replace('\\', "/"))),
        Err(Refusal::Outside(_)) => Err(outside()),
        Err(special) => Err(ImagesError::field(manifest, field, special.to_string())),
    }
}

/// Finds `base/written`, or else the file that differs in separators, case and Unicode
/// normalization alone.
pub(super) fn find_file(
    folder: &InputFolder,
    base: &Path,
    written: &str,
) -> Result<Option<PathBuf>, Refusal> {
    let found = folder.find(&[base], written, false, matches_folded);
    Ok(found?.map(|found| found.path))
}

fn matches_folded(written: &str) -> impl Fn(&OsStr) -> bool + use<> {
    let wanted = fold_name(written);
    move |name: &OsStr| fold_name(&name.to_string_lossy()) == wanted
}

/// Finds an image whose name is written without its extension, regardless of case and separators.
pub(super) fn find_without_extension(
    folder: &InputFolder,
    base: &Path,
    stem: &str,
) -> Option<PathBuf> {
    let found = folder.find(&[base], stem, false, |written: &str| {
        let wanted = fold_name(written);
        move |name: &OsStr| {
            let name = fold_name(&name.to_string_lossy());
            let is_image = |rest: &str| {
                let ending = rest.strip_prefix('.');
                ending.is_some_and(|ending| EXTENSIONS.contains(&ending))
            };
            let rest = name.strip_prefix(&wanted);
            rest.is_some_and(|rest| rest.is_empty() || is_image(rest))
        }
    });
    found.ok().flatten().map(|found| found.path)
}

/// Extensions of photographs.
const EXTENSIONS: [&str; 7] = ["jpg", "png", "jpeg", "tif", "tiff", "webp", "ppm"];

/// Returns the image `stem` in a folder, `stem.jpg` if there is none.
pub(super) fn find_image(folder: &Path, stem: &str) -> PathBuf {
    let named = |extension: &str| folder.join(format!("{stem}.{extension}"));
    let capital = EXTENSIONS.map(str::to_uppercase);
    let capital = capital.iter().map(String::as_str);
    EXTENSIONS
        .into_iter()
        .chain(capital)
        .chain(["exr"])
        .map(named)
        .find(|path| path.is_file())
        .unwrap_or_else(|| named("jpg"))
}

/// Returns the image that a camera of `file` names, with or without its extension, in the folders
/// where photographs lie beside the file, or in the only other folder there that has it.
pub(super) fn find_named_image(
    set: &InputFolder,
    file: &Path,
    name: &str,
) -> Result<Option<PathBuf>, ImagesError> {
    // Programs write paths of their own machine.
    let leads_out = set.leads_out(set.path(), name);
    let last = name.rsplit(['/', '\\']).next().unwrap_or(name);
    let stem = if leads_out { last } else { name };
    let find = |place: &Path| {
        let whole = find_file(set, place, name).map_err(|refusal| match refusal {
            Refusal::Outside(_) => ImagesError::Outside {
                path: file.into(),
                field: "the name of an image".into(),
                leads_to: name.into(),
            },
            special => ImagesError::field(file, name, special.to_string()),
        })?;
        let found = whole.unwrap_or_else(|| find_image(place, stem));
        Ok(if found.is_file() {
            Some(found)
        } else {
            find_without_extension(set, place, stem)
        })
    };
    for place in ["images", "input", ""] {
        let similar = find_similar(set.path(), Path::new(place), matches_folded);
        if let Some(found) = find(&similar.unwrap_or_else(|| set.path().join(place)))? {
            return Ok(Some(found));
        }
    }
    // Masks and depth may have the same names.
    let mut others = Vec::new();
    for entry in fs::read_dir(set.path()).into_iter().flatten().flatten() {
        if entry.path().is_dir() {
            others.extend(find(&entry.path())?);
        }
    }
    Ok(if others.len() == 1 {
        others.pop()
    } else {
        None
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn path_out_of_folder_refused() {
        let manifest = Path::new("/data/set/manifest.json");
        let resolve_path = |written, allow| {
            let folder = InputFolder::allowing_outside(Path::new("/data/set"), allow);
            resolve(&folder, manifest, "color", written)
        };
        for inside in ["a/../b.png", "../b.png"] {
            let path = resolve_path(inside, false).expect("inside");
            assert_eq!(path, Path::new("/data/set").join(inside));
        }
        for outside in [
            "../../b.png",
            "a/../../../b.png",
            "/etc/passwd",
            "a\\..\\..\\..\\b.png",
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
    fn separators_case_and_normalization_matched() {
        let folder = tempfile::tempdir().expect("a folder");
        fs::create_dir(folder.path().join("Images")).expect("made");
        for name in ["Images/0.JPG", "Images/a\\b.png", "Images/u\u{308}.png"] {
            fs::write(folder.path().join(name), b"").expect("written");
        }
        let manifest = folder.path().join("transforms.json");
        let found = |written| {
            let set = InputFolder::new(folder.path());
            let path = resolve(&set, &manifest, "file_path", written).expect("inside");
            let relative = path.strip_prefix(folder.path()).expect("inside");
            relative.to_string_lossy().into_owned()
        };
        assert_eq!(found("./images/0.jpg"), "Images/0.JPG");
        assert_eq!(found("images\\0.jpg"), "Images/0.JPG");
        assert_eq!(found("/home/me/images/0.jpg"), "Images/0.JPG", "moved");
        assert_eq!(found("Images/a\\b.png"), "Images/a\\b.png", "as written");
        assert_eq!(
            found("images/\u{fc}.png"),
            "Images/u\u{308}.png",
            "of macOS"
        );
        assert_eq!(found("images\\1.jpg"), "images/1.jpg", "missing");
    }

    #[test]
    fn image_found_in_any_folder_unless_several_have_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let set = InputFolder::new(folder.path());
        let find =
            || find_named_image(&set, &folder.path().join("cameras.xml"), "DSC_0").expect("inside");
        let photograph = folder.path().join("photos/DSC_0.JPG");
        for path in [&photograph, &folder.path().join("masks/DSC_0.png")] {
            fs::create_dir(path.parent().expect("a folder")).expect("made");
        }
        fs::write(&photograph, b"").expect("written");
        assert_eq!(find(), Some(photograph));
        fs::write(folder.path().join("masks/DSC_0.png"), b"").expect("written");
        assert_eq!(find(), None);
    }

    #[test]
    fn name_without_extension_found_in_any_case() {
        let folder = tempfile::tempdir().expect("a folder");
        let names = ["Images/cam/DSC_0.tif", "Images/1.JPEG", "Images/1.txt"];
        for name in names {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            fs::write(path, b"").expect("written");
        }
        let set = InputFolder::new(folder.path());
        for (stem, expected) in [("cam\\dsc_0", names[0]), ("1", names[1])] {
            let file = folder.path().join("cameras.json");
            let found = find_named_image(&set, &file, stem).expect("inside");
            assert_eq!(found, Some(folder.path().join(expected)));
            let written = format!("images/{stem}");
            let found = find_without_extension(&set, folder.path(), &written);
            assert_eq!(found, Some(folder.path().join(expected)));
        }
    }
}
