//! Standard output, output files, and the memory used by the process.

use super::args::StrictArgs;
use super::messages::{UsageError, escape_controls, join_lines};
use headbox_core::files;
use headbox_core::image::{codec, png_chunks};
use headbox_core::memory;
use headbox_export::film;
use headbox_scene::scene::Scene;
use image::codecs::jpeg::JpegEncoder;
use std::fmt::Display;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

/// True if standard output carries a file (`-o -`): messages then go to standard error.
static STDOUT_IS_OUTPUT: AtomicBool = AtomicBool::new(false);

/// True if standard output was closed when the process began.
static STDOUT_WAS_CLOSED: AtomicBool = AtomicBool::new(false);

/// Tests whether standard output is closed, before `main`: Rust's runtime then opens the null
/// device in its place, and all output would be lost without an error.
#[cfg(unix)]
#[ctor::ctor(unsafe)]
fn test_stdout() {
    use std::os::fd::AsFd;
    let copy = std::io::stdout().as_fd().try_clone_to_owned();
    STDOUT_WAS_CLOSED.store(copy.is_err(), Ordering::Relaxed);
}

/// Returns an error if standard output is closed.
pub(super) fn check_stdout() -> std::io::Result<()> {
    if STDOUT_WAS_CLOSED.load(Ordering::Relaxed) {
        return Err(std::io::Error::other("it is closed"));
    }
    Ok(())
}

/// Prints one JSON object on standard output.
pub(super) fn print_json(value: &serde_json::Value) {
    println!("{value:#}");
}

/// Prints on standard output, with control characters escaped. Ends the program if that fails.
pub(super) fn print_text(text: std::fmt::Arguments<'_>) {
    if STDOUT_IS_OUTPUT.load(Ordering::Relaxed) {
        print_error_text(text);
        return;
    }
    print_bytes(escape_controls(&text.to_string()).as_bytes());
}

/// Writes to standard output. Ends the program if that fails.
pub(super) fn print_bytes(bytes: &[u8]) {
    if let Err(error) = check_stdout().and_then(|()| std::io::stdout().write_all(bytes)) {
        report_failure(&error);
        files::remove_unfinished();
        std::process::exit(FAILURE.into());
    }
}

/// Exit code of a command that failed.
pub(super) const FAILURE: u8 = 1;

/// Reports that standard output cannot be written: quietly if its reader has closed the pipe, as
/// `head` does.
pub(super) fn report_failure(error: &std::io::Error) -> ExitCode {
    if error.kind() != std::io::ErrorKind::BrokenPipe {
        eprintln!("error: standard output cannot be written: {error}");
    }
    FAILURE.into()
}

/// Writes all that is left for standard output, and returns the exit code of success or failure.
pub(super) fn flush() -> ExitCode {
    match std::io::stdout().flush() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => report_failure(&error),
    }
}

/// Prints on standard error, with control characters escaped. A closed standard error is ignored.
pub(super) fn print_error_text(text: std::fmt::Arguments<'_>) {
    let text = text.to_string();
    let _ = std::io::stderr().write_all(escape_controls(&text).as_bytes());
}

/// Prints notes on standard error, one line each.
pub(super) fn print_notes(notes: impl IntoIterator<Item: Display>) {
    for note in notes {
        eprintln!("note: {}", join_lines(&note.to_string()));
    }
}

/// Prints warnings on standard error, one line each.
pub(super) fn print_warnings(warnings: impl IntoIterator<Item: Display>) {
    for warning in warnings {
        eprintln!("warning: {}", join_lines(&warning.to_string()));
    }
}

/// Warns of an image file that is cut short.
pub(super) fn print_damage(path: &Path, image: &codec::Decoded) {
    let damage = image.damage.as_ref();
    print_warnings(damage.map(|damage| format!("{}: {damage}", path.display())));
}

/// Peak resident memory in MiB.
pub(super) fn peak_rss_mb() -> Option<f64> {
    memory::peak_and_resident().map(|[peak, _]| peak as f64 / 1_048_576.0)
}

/// A kind of output file, with the extensions that select its format.
pub(super) struct OutputKind {
    what: &'static str,
    allowed: &'static [&'static str],
}

/// Extensions of frames: first the pictures, all but JPEG lossless, then linear radiance.
const FRAME_EXTENSIONS: [&str; 9] = [
    "png", "jpg", "jpeg", "webp", "tif", "tiff", "bmp", "tga", "exr",
];
pub(super) const PICTURE: OutputKind = OutputKind::new("a picture", FRAME_EXTENSIONS.split_at(8).0);
pub(super) const FRAME: OutputKind = OutputKind::new("a frame", &FRAME_EXTENSIONS);
#[cfg(feature = "viewer")]
pub(super) const WINDOW: OutputKind = OutputKind::new("a picture of the window", &["png"]);
pub(super) const DEPTH: OutputKind = OutputKind::new("a picture of depth", &["exr"]);
pub(super) const CUBE: OutputKind = OutputKind::new("a cube LDI", &["ldi"]);
pub(super) const SHARD: OutputKind = OutputKind::new("a shard of a capture", &["shard"]);
pub(super) const SPRITES: OutputKind = OutputKind::new("sprites with depth", &["sprite"]);
pub(super) const LUMIGRAPH: OutputKind = OutputKind::new("a lumigraph", &["lumi"]);
pub(super) const HOUSE: OutputKind = OutputKind::new("a house", &["house"]);
pub(super) const PLAN: OutputKind = OutputKind::new("a plan", &["svg"]);
pub(super) const PATH: OutputKind = OutputKind::new("a camera path", &["json"]);
pub(super) const EXPORT: OutputKind = OutputKind::new("an export", &["html", "glb", "ply", "exr"]);
pub(super) const FILM: OutputKind = OutputKind::new("a film", &film::ENDINGS);
pub(super) const PAGE: OutputKind = OutputKind::new("a page", &["md"]);

impl OutputKind {
    const fn new(what: &'static str, allowed: &'static [&'static str]) -> Self {
        Self { what, allowed }
    }

    fn check_extension(&self, path: &Path) -> Result<(), UsageError> {
        if self
            .allowed
            .iter()
            .any(|ending| has_extension(path, ending))
        {
            return Ok(());
        }
        let (path, what, endings) = (path.display(), self.what, self.list());
        Err(UsageError(if self.allowed.len() == 1 {
            format!("{path}: the ending of {what} is {endings}")
        } else {
            format!("{path}: the ending of {what} is one of {endings}, and decides the format")
        }))
    }

    /// Lists the extensions for messages: `.a, .b`.
    fn list(&self) -> String {
        let endings = self.allowed.iter().map(|ending| format!(".{ending}"));
        endings.collect::<Vec<_>>().join(", ")
    }
}

/// Returns true if a file has an extension, in any case.
pub(super) fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension()
        .is_some_and(|ending| ending.eq_ignore_ascii_case(extension))
}

/// Folder of a file, "." for a bare name.
pub(super) fn parent_folder(path: &Path) -> &Path {
    path.parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."))
}

/// Files and folders that a command will write, checked before any work is done. Files are written
/// by [`files::write_whole`].
pub(super) struct Outputs {
    json: bool,
    files: Vec<PathBuf>,
}

/// Canonical path of a file that may not exist yet.
fn canonical_path(path: &Path) -> PathBuf {
    let folder = parent_folder(path);
    let in_folder = || Some(folder.canonicalize().ok()?.join(path.file_name()?));
    path.canonicalize()
        .ok()
        .or_else(in_folder)
        .unwrap_or_else(|| path.into())
}

/// Inputs of a command that reads no files.
pub(super) const NO_INPUTS: [&str; 0] = [];

impl Outputs {
    /// Creates the outputs of a command that reads `inputs`, none of which it will overwrite.
    /// `json` is true if it prints JSON on standard output.
    pub(super) fn new<P: AsRef<Path>>(json: bool, inputs: impl IntoIterator<Item = P>) -> Self {
        for input in inputs {
            files::protect_input(input.as_ref());
            note_if_pipe(input.as_ref());
        }
        Self {
            json,
            files: Vec::new(),
        }
    }

    /// Adds a file; its extension selects the format unless it is streamed.
    pub(super) fn file(mut self, path: &Path, kind: &OutputKind) -> anyhow::Result<Self> {
        self.check(path)?;
        if path.as_os_str() == files::STANDARD_OUTPUT {
            if self.json {
                bail_usage!("-o - and --json both write to standard output; leave one out");
            }
            check_stdout().map_err(|error| cannot_write(path, error))?;
            STDOUT_IS_OUTPUT.store(true, Ordering::Relaxed);
        } else if !files::is_stream(path)? {
            kind.check_extension(path)?;
        }
        let place = canonical_path(path);
        if self.files.contains(&place) {
            bail_usage!("{}: two outputs would be written to it", path.display());
        }
        self.files.push(place);
        Ok(self)
    }

    /// Same as [`Self::file`], for an optional output.
    pub(super) fn maybe_file(
        self,
        path: Option<&PathBuf>,
        kind: &OutputKind,
    ) -> anyhow::Result<Self> {
        match path {
            Some(path) => self.file(path, kind),
            None => Ok(self),
        }
    }

    /// Adds a folder.
    pub(super) fn folder(self, path: &Path) -> anyhow::Result<Self> {
        files::check_folder(path).map_err(|error| cannot_write(path, error))?;
        Ok(self)
    }

    /// Adds a folder for the frames of a path. Refuses names with the extension of a picture or a
    /// film, which are mistakes.
    pub(super) fn frame_folder(self, path: &Path) -> anyhow::Result<Self> {
        const UNSUPPORTED: [&str; 14] = [
            "avi", "mov", "mkv", "m4v", "wmv", "flv", "mpg", "mpeg", "ogv", "avif", "exr", "hdr",
            "svg", "jxl",
        ];
        let mut known = PICTURE.allowed.iter().chain(&UNSUPPORTED);
        if !path.is_dir() && known.any(|known| has_extension(path, known)) {
            let (path, films) = (path.display(), FILM.list());
            bail_usage!(
                "{path}: the ending of a film is one of {films}; for a picture of each pose, name a folder"
            );
        }
        self.folder(path)
    }

    /// Prints the notes of the loader, or fails if there are any and reading is strict; protects
    /// all files of an open scene (materials, textures), and checks the outputs again.
    pub(super) fn add_scene(
        &self,
        name: &str,
        scene: &Scene,
        strict: StrictArgs,
    ) -> anyhow::Result<()> {
        strict.report(name, &scene.summary.notes)?;
        scene
            .summary
            .files
            .iter()
            .for_each(|file| files::protect_input(file));
        self.files.iter().try_for_each(|path| self.check(path))
    }

    fn check(&self, path: &Path) -> anyhow::Result<()> {
        files::check(path).map_err(|error| cannot_write(path, error))
    }
}

/// Prints a note if the input is a named pipe: reading waits until something is written to it.
fn note_if_pipe(input: &Path) {
    #[cfg(unix)]
    if std::fs::metadata(input)
        .is_ok_and(|found| std::os::unix::fs::FileTypeExt::is_fifo(&found.file_type()))
    {
        eprintln!(
            "note: {} is a pipe; waiting for what is written to it",
            input.display()
        );
    }
    #[cfg(not(unix))]
    let _ = input;
}

/// Converts an error of writing a file: invalid input to a usage error, others to a failure.
pub(super) fn cannot_write(path: &Path, error: std::io::Error) -> anyhow::Error {
    let name = match path.to_str() {
        Some("") => "the output".into(),
        Some(files::STANDARD_OUTPUT) => "standard output".into(),
        _ => path.display().to_string(),
    };
    let message = format!("{name} cannot be written: {error}");
    if error.kind() == std::io::ErrorKind::InvalidInput {
        UsageError(message).into()
    } else {
        anyhow::anyhow!(message)
    }
}

/// Saves an image, completely or not at all, in the format of its extension; PNG without one.
pub(super) fn save_picture(path: &Path, image: &image::RgbImage) -> anyhow::Result<()> {
    save_picture_with_text(path, image, None)
}

/// Writes an image as [`save_picture`] does; if it is a PNG, with a keyword and a text.
pub(super) fn save_picture_with_text(
    path: &Path,
    image: &image::RgbImage,
    text: Option<(&str, &str)>,
) -> anyhow::Result<()> {
    /// Visually lossless.
    const JPEG_QUALITY: u8 = 95;
    let format = image::ImageFormat::from_path(path).unwrap_or(image::ImageFormat::Png);
    let (width, height) = image.dimensions();
    let written = files::write_whole(path, |w| {
        let encoded = match format {
            image::ImageFormat::Png => {
                let png = codec::png(
                    image.as_raw(),
                    width,
                    height,
                    image::ExtendedColorType::Rgb8,
                );
                let mut png = png.map_err(std::io::Error::other)?;
                if let Some((keyword, text)) = text {
                    png_chunks::add_text(&mut png, keyword, text);
                }
                return w.write_all(&png);
            }
            image::ImageFormat::Jpeg => {
                JpegEncoder::new_with_quality(w, JPEG_QUALITY).encode_image(image)
            }
            format => image.write_to(w, format),
        };
        encoded.map_err(std::io::Error::other)
    });
    written.map_err(|error| cannot_write(path, error))
}

/// Name of an output in messages.
pub(super) fn output_name(output: &Path) -> String {
    if output.as_os_str() == files::STANDARD_OUTPUT {
        "standard output".into()
    } else {
        output.display().to_string()
    }
}

/// Writes a text file, completely or not at all.
pub(super) fn write_text(path: &Path, text: &str) -> anyhow::Result<()> {
    let written = files::write_whole(path, |w| w.write_all(text.as_bytes()));
    written.map_err(|error| cannot_write(path, error))
}
