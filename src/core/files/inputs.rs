//! Files that an input names, such as textures, material files and the images of a set: where they
//! are searched, and which are refused. This is the only place that decides.
//!
//! | the file, behind all symbolic links, is | action |
//! |---|---|
//! | in the folder of the input or below it | read |
//! | below the folder above it, with no hidden file or folder on the way (`../textures/wood.png`) | read |
//! | in a search folder of the user or below it | read |
//! | elsewhere | refused, unless the user allows it |
//! | a FIFO, a device or a socket | refused |
//!
//! An exporter may have written a path of its own machine. Where that is not a file that may be
//! read, a file with the end of that path, or its name alone, beside the input or below is used.

use super::find_similar;
use std::ffi::OsStr;
use std::fs::{self, Metadata};
use std::io;
use std::path::{Component, Path, PathBuf};
use std::sync::{PoisonError, RwLock};

/// Places outside of the folders of inputs that the user allows.
#[derive(Clone, Debug, Default)]
struct Permissions {
    outside: bool,
    search: Vec<PathBuf>,
}

static PERMISSIONS: RwLock<Permissions> = RwLock::new(Permissions {
    outside: false,
    search: Vec::new(),
});

/// Sets the rule of this process for files that inputs name: whether they may lie anywhere, and
/// folders in which they are searched besides those of the inputs.
pub fn set_permissions(outside: bool, search: Vec<PathBuf>) {
    *PERMISSIONS.write().unwrap_or_else(PoisonError::into_inner) = Permissions { outside, search };
}

/// Why a file that an input names is not read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// It lies outside of the folders that may be read.
    #[error(
        "leads out of the folder, to {}; pass --allow-outside if you trust the file, or its \
         folder with --search", .0.display()
    )]
    Outside(PathBuf),
    /// It is not a regular file.
    #[error("is {kind}, not a regular file: {}", path.display())]
    Special {
        /// The file.
        path: PathBuf,
        /// Its kind, such as a FIFO.
        kind: &'static str,
    },
}

impl From<Refusal> for io::Error {
    fn from(refusal: Refusal) -> Self {
        Self::new(io::ErrorKind::PermissionDenied, refusal)
    }
}

/// A file that an input names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundInput {
    /// Its path.
    pub path: PathBuf,
    /// True if folder or spelling differ from those that are written.
    pub is_renamed: bool,
}

/// Folder of an input, and the files outside of it that may be read.
#[derive(Clone, Debug)]
pub struct InputFolder {
    path: PathBuf,
    search: Vec<PathBuf>,
    /// The folder and the search folders, without symbolic links.
    roots: Vec<PathBuf>,
    /// The folder above, without symbolic links; `None` if it is that of the whole system.
    above: Option<PathBuf>,
    allows_outside: bool,
}

impl InputFolder {
    /// Creates the folder of an input by the rule of this process; an empty path is the current
    /// folder.
    #[must_use]
    pub fn new(path: &Path) -> Self {
        let Permissions { outside, search } = PERMISSIONS
            .read()
            .unwrap_or_else(PoisonError::into_inner)
            .clone();
        Self::with_permissions(path, outside, search)
    }

    /// Creates the folder of an input from which files may be named that lie anywhere, if `allowed`
    /// or if the rule of this process allows it.
    #[must_use]
    pub fn allowing_outside(path: &Path, allowed: bool) -> Self {
        let mut folder = Self::new(path);
        folder.allows_outside |= allowed;
        folder
    }

    fn with_permissions(path: &Path, allows_outside: bool, search: Vec<PathBuf>) -> Self {
        let existing = if path.as_os_str().is_empty() {
            Path::new(".")
        } else {
            path
        };
        let own = existing.canonicalize().ok();
        let above = own.as_deref().and_then(Path::parent);
        let above = above.filter(|above| above.parent().is_some());
        let above = above.map(Path::to_path_buf);
        let canonical_search = search
            .iter()
            .filter_map(|folder| folder.canonicalize().ok());
        Self {
            path: path.into(),
            roots: own.into_iter().chain(canonical_search).collect(),
            above,
            search,
            allows_outside,
        }
    }

    /// The folder, as it was named.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Checks that a file may be read. Accepts one that does not exist, which is for its reader to
    /// report.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn check(&self, file: &Path) -> Result<(), Refusal> {
        let Ok(found) = fs::metadata(file) else {
            return Ok(());
        };
        if !found.is_file() {
            return Err(Refusal::Special {
                path: file.into(),
                kind: kind_of(&found),
            });
        }
        match file.canonicalize() {
            Ok(real) if !self.allows_outside && !self.contains(&real) => {
                Err(Refusal::Outside(real))
            }
            _ => Ok(()),
        }
    }

    /// Reads a file, if that is allowed.
    ///
    /// # Errors
    /// I/O errors; a [`Refusal`] in one of kind [`io::ErrorKind::PermissionDenied`].
    pub fn read(&self, file: &Path) -> io::Result<Vec<u8>> {
        self.check(file)?;
        fs::read(file)
    }

    /// Reads a text file in UTF-8, if that is allowed.
    ///
    /// # Errors
    /// Same as [`Self::read`].
    pub fn read_text(&self, file: &Path) -> io::Result<String> {
        self.check(file)?;
        fs::read_to_string(file)
    }

    /// Returns true if a path without symbolic links may be read.
    fn contains(&self, real: &Path) -> bool {
        let is_hidden = |part: Component| part.as_os_str().as_encoded_bytes().starts_with(b".");
        let is_beside = |above: &PathBuf| {
            let below = real.strip_prefix(above);
            below.is_ok_and(|below| !below.components().any(is_hidden))
        };
        self.roots.iter().any(|root| real.starts_with(root))
            || self.above.as_ref().is_some_and(is_beside)
    }

    /// Finds the file that the input calls `written`, relative to one of `bases` or of the search
    /// folders: first as it is written, then with components that `matcher` accepts for those
    /// written (see [`find_similar`]). If `is_moved`, or if the path leads out of the folder, files
    /// with its end are accepted, too, those with more folders first. Quotes and a drive are
    /// ignored and backslashes are separators, if there is no such file otherwise.
    ///
    /// # Errors
    /// [`Refusal`] if files are found, but none that may be read.
    pub fn find<M: Fn(&OsStr) -> bool>(
        &self,
        bases: &[&Path],
        written: &str,
        is_moved: bool,
        matcher: impl Fn(&str) -> M,
    ) -> Result<Option<FoundInput>, Refusal> {
        let folders = || {
            let search = self.search.iter().map(PathBuf::as_path);
            bases.iter().copied().chain(search)
        };
        let clean = written.trim().trim_matches('"').replace('\\', "/");
        if clean.is_empty() {
            return Ok(None);
        }
        let exact = [written, &clean]
            .into_iter()
            .flat_map(|name| folders().map(move |folder| (folder.join(name), false)));
        let parts = normal_parts(&clean);
        let relative = PathBuf::from(without_drive(&clean).trim_start_matches('/'));
        let is_moved = is_moved || bases.iter().all(|base| self.leads_out(base, written));
        let ends = if is_moved { parts.len() } else { 0 };
        let ends = (0..ends).map(|start| parts[start..].iter().collect());
        let names: Vec<PathBuf> = std::iter::once(relative).chain(ends).collect();
        let respelled = names
            .iter()
            .filter(|name| !name.as_os_str().is_empty())
            .flat_map(|name| folders().map(move |folder| (folder, name)))
            .filter_map(|(folder, name)| Some((find_similar(folder, name, &matcher)?, true)));
        let mut refusal = None;
        for (path, is_renamed) in exact.chain(respelled) {
            if fs::metadata(&path).map_or(true, |found| found.is_dir()) {
                continue;
            }
            match self.check(&path) {
                Ok(()) => return Ok(Some(FoundInput { path, is_renamed })),
                Err(error) => {
                    refusal.get_or_insert(error);
                }
            }
        }
        refusal.map_or(Ok(None), Err)
    }

    /// Returns true if `written`, relative to `base`, names a place farther away than the folder
    /// above, by its words alone, and that is not allowed.
    #[must_use]
    pub fn leads_out(&self, base: &Path, written: &str) -> bool {
        if self.allows_outside {
            return false;
        }
        let slashed = written.replace('\\', "/");
        let below = base.strip_prefix(&self.path);
        let start = below.map_or(0, |below| below.components().count() as i32);
        [written, &slashed].into_iter().any(|path| {
            let mut depth = start;
            without_drive(path) != path
                || Path::new(path).has_root()
                || Path::new(path).components().any(|part| {
                    depth += match part {
                        Component::ParentDir => -1,
                        Component::Normal(_) => 1,
                        _ => 0,
                    };
                    depth < -1
                })
        })
    }
}

/// Removes the drive of a path of Windows.
fn without_drive(path: &str) -> &str {
    match path.split_once(':') {
        Some((drive, rest)) if drive.len() == 1 && rest.starts_with(['/', '\\']) => rest,
        _ => path,
    }
}

/// Returns the folders and the name of a path, without those that lead upwards.
fn normal_parts(path: &str) -> Vec<&OsStr> {
    let normal = |part| match part {
        Component::Normal(part) => Some(part),
        _ => None,
    };
    Path::new(without_drive(path))
        .components()
        .filter_map(normal)
        .collect()
}

/// Names the kind of a file that is not regular.
fn kind_of(found: &Metadata) -> &'static str {
    if found.is_dir() {
        return "a folder";
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        let kind = found.file_type();
        if kind.is_fifo() {
            return "a FIFO";
        }
        if kind.is_socket() {
            return "a socket";
        }
    }
    "a device"
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{create_dir_all, write};
    use tempfile::TempDir;

    /// A set in `project/set`, and files around it.
    fn project() -> TempDir {
        let dir = tempfile::tempdir().expect("a folder");
        for file in [
            "project/set/a.png",
            "project/set/tex/b.png",
            "project/textures/c.png",
            "project/.hidden/d.png",
            "far/e.png",
        ] {
            let path = dir.path().join(file);
            create_dir_all(path.parent().expect("a folder")).expect("made");
            write(path, file).expect("written");
        }
        dir
    }

    fn find_in(folder: &InputFolder, written: &str) -> Result<Option<String>, Refusal> {
        let same = |wanted: &str| {
            let wanted = wanted.to_lowercase();
            move |name: &OsStr| name.to_string_lossy().to_lowercase() == wanted
        };
        let found = folder.find(&[folder.path()], written, false, same)?;
        Ok(found.map(|found| fs::read_to_string(found.path).expect("read")))
    }

    #[test]
    fn files_are_found_by_the_rule() {
        let dir = project();
        let far = dir.path().join("far/e.png");
        let far = far.to_str().expect("UTF-8");
        let set = dir.path().join("project/set");
        let strict = InputFolder::with_permissions(&set, false, Vec::new());
        for (written, expected) in [
            ("a.png", "project/set/a.png"),
            ("./TEX/../tex/B.png", "project/set/tex/b.png"),
            ("tex\\b.png", "project/set/tex/b.png"),
            ("../textures/c.png", "project/textures/c.png"),
            ("/home/me/project/tex/b.png", "project/set/tex/b.png"),
            ("C:\\work\\a.png", "project/set/a.png"),
            ("../../../elsewhere/a.png", "project/set/a.png"),
        ] {
            let found = find_in(&strict, written).expect(written);
            assert_eq!(found.as_deref(), Some(expected), "{written}");
        }
        for outside in [far, "../../far/e.png", "../.hidden/d.png"] {
            let error = find_in(&strict, outside).expect_err(outside).to_string();
            assert!(error.contains("--allow-outside"), "{error}");
            assert!(error.contains(".png"), "{error}");
        }
        for missing in ["b.png", "tex/a.png", "/home/me/z.png", "..", ""] {
            assert_eq!(find_in(&strict, missing), Ok(None), "{missing}");
        }
        let search = vec![dir.path().join("far")];
        let searching = InputFolder::with_permissions(&set, false, search);
        let lenient = InputFolder::with_permissions(&set, true, Vec::new());
        for (folder, written) in [(&searching, "e.png"), (&searching, far), (&lenient, far)] {
            let found = find_in(folder, written).expect(written);
            assert_eq!(found.as_deref(), Some("far/e.png"), "{written}");
        }
        assert!(find_in(&searching, "../.hidden/d.png").is_err());
    }

    #[test]
    fn words_that_lead_out_are_known() {
        let set = Path::new("/data/set");
        let folder = InputFolder::with_permissions(set, false, Vec::new());
        let below = set.join("images");
        for (base, written, expected) in [
            (set, "a/../b.png", false),
            (set, "../b.png", false),
            (set, "a/../../../b.png", true),
            (set, "a\\..\\..\\..\\b.png", true),
            (set, "/etc/passwd", true),
            (set, "\\\\server\\b.png", true),
            (set, "C:\\set\\b.png", true),
            (&below, "../../b.png", false),
            (&below, "../../../b.png", true),
        ] {
            assert_eq!(folder.leads_out(base, written), expected, "{written}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_and_special_files_are_refused() {
        use std::os::unix::fs::symlink;
        let dir = project();
        let set = dir.path().join("project/set");
        symlink("../../far", set.join("linked")).expect("a link");
        symlink("../../far/e.png", set.join("f.png")).expect("a link");
        symlink("tex/b.png", set.join("g.png")).expect("a link");
        symlink("/dev/zero", set.join("h.png")).expect("a link");
        let _socket = std::os::unix::net::UnixListener::bind(set.join("i.png")).expect("a socket");
        let strict = InputFolder::with_permissions(&set, false, Vec::new());
        let lenient = InputFolder::with_permissions(&set, true, Vec::new());
        for outside in ["linked/e.png", "f.png"] {
            let error = strict.read(&set.join(outside)).expect_err(outside);
            assert!(error.to_string().contains("--allow-outside"), "{error}");
            assert!(find_in(&strict, outside).is_err());
            assert!(lenient.read(&set.join(outside)).is_ok());
        }
        assert!(strict.read_text(&set.join("g.png")).is_ok());
        for (special, kind) in [("h.png", "a device"), ("i.png", "a socket")] {
            let error = lenient.read(&set.join(special)).expect_err(special);
            assert!(error.to_string().contains(kind), "{error}");
        }
        // A folder that is a link itself is the input's.
        symlink("project/set", dir.path().join("link")).expect("a link");
        let linked = dir.path().join("link");
        let linked = InputFolder::with_permissions(&linked, false, Vec::new());
        assert!(linked.check(&linked.path().join("tex/b.png")).is_ok());
    }
}
