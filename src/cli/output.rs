//! Standard output, and the resources used by the process.

use super::words::UsageError;
use headbox_core::{files, image_file as picture};
use headbox_export::film;
use headbox_scene::scene::Scene;
use image::codecs::jpeg::JpegEncoder;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// True if standard output carries a file (`-o -`): messages then go to standard error.
static STDOUT_IS_OUTPUT: AtomicBool = AtomicBool::new(false);

/// Prints one JSON object on standard output.
pub(super) fn print_json(value: &serde_json::Value) {
    println!("{value:#}");
}

/// Prints on standard output. Where nobody reads it any more, the program ends: quietly if a reader
/// has gone, as `head` does, else with a sentence.
pub(super) fn print_text(text: std::fmt::Arguments<'_>) {
    if STDOUT_IS_OUTPUT.load(Ordering::Relaxed) {
        eprint!("{text}");
        return;
    }
    if let Err(error) = std::io::stdout().write_fmt(text) {
        if error.kind() == std::io::ErrorKind::BrokenPipe {
            std::process::exit(0);
        }
        eprintln!("error: standard output could not be written: {error}");
        std::process::exit(1);
    }
}

/// Prints what a loader met and survived to standard error.
pub(super) fn print_notes(scene: &Scene) {
    for note in &scene.summary.notes {
        eprintln!("note: {note}");
    }
}

/// Peak and present resident memory of this process in bytes, where the system tells (Linux).
pub(super) fn memory_bytes() -> Option<(u64, u64)> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let field = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name))?;
        Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
    };
    Some((field("VmHWM:")?, field("VmRSS:")?))
}

/// Peak resident memory in MiB.
pub(super) fn peak_rss_mb() -> Option<f64> {
    memory_bytes().map(|(peak, _)| peak as f64 / 1_048_576.0)
}

/// Extensions of a kind of output: they select the format.
pub(super) struct Endings {
    what: &'static str,
    allowed: &'static [&'static str],
}

/// Extensions of frames: levels first, of which all but JPEG keeps every bit, then linear radiance.
const OF_FRAMES: [&str; 9] = [
    "png", "jpg", "jpeg", "webp", "tif", "tiff", "bmp", "tga", "exr",
];
/// Pictures.
pub(super) const PICTURE: Endings = Endings {
    what: "a picture",
    allowed: OF_FRAMES.split_at(8).0,
};
/// Frames: pictures, or linear radiance.
pub(super) const FRAME: Endings = Endings {
    what: "a frame",
    allowed: &OF_FRAMES,
};
/// Pictures of the window.
#[cfg(feature = "viewer")]
pub(super) const WINDOW: Endings = Endings {
    what: "a picture of the window",
    allowed: &["png"],
};
/// Depth.
pub(super) const DEPTH: Endings = Endings {
    what: "a picture of depth",
    allowed: &["exr"],
};
/// Cube LDIs.
pub(super) const CUBE: Endings = Endings {
    what: "a cube LDI",
    allowed: &["ldi"],
};
/// Parts of cube LDIs.
pub(super) const SHARD: Endings = Endings {
    what: "a shard of a capture",
    allowed: &["shard"],
};
/// Sprites with depth.
pub(super) const SPRITES: Endings = Endings {
    what: "sprites with depth",
    allowed: &["sprite"],
};
/// Lumigraphs.
pub(super) const LUMIGRAPH: Endings = Endings {
    what: "a lumigraph",
    allowed: &["lumi"],
};
/// Houses.
pub(super) const HOUSE: Endings = Endings {
    what: "a house",
    allowed: &["house"],
};
/// Plans of houses.
pub(super) const PLAN: Endings = Endings {
    what: "a plan",
    allowed: &["svg"],
};
/// Camera paths.
pub(super) const PATH: Endings = Endings {
    what: "a camera path",
    allowed: &["json"],
};
/// Extensions of exports.
pub(super) const EXPORT: Endings = Endings {
    what: "an export",
    allowed: &["html", "glb", "ply", "exr"],
};
/// Films of a path.
pub(super) const FILM: Endings = Endings {
    what: "a film",
    allowed: &film::ENDINGS,
};
/// Pages of text.
pub(super) const PAGE: Endings = Endings {
    what: "a page",
    allowed: &["md"],
};

impl Endings {
    fn allow(&self, path: &Path) -> Result<(), UsageError> {
        let ending = path.extension().unwrap_or_default();
        if self
            .allowed
            .iter()
            .any(|allowed| ending.eq_ignore_ascii_case(allowed))
        {
            return Ok(());
        }
        let allowed: Vec<String> = self
            .allowed
            .iter()
            .map(|allowed| format!(".{allowed}"))
            .collect();
        let (path, what) = (path.display(), self.what);
        Err(UsageError(match allowed.as_slice() {
            [only] => format!("{path}: the ending of {what} is {only}"),
            _ => format!(
                "{path}: the ending of {what} is one of {}, and decides the format",
                allowed.join(", ")
            ),
        }))
    }
}

/// The files and folders that a command will write. Checked before any work is done; written by
/// [`files::write_whole`], which has the rule.
pub(super) struct Outputs {
    json: bool,
    files: Vec<PathBuf>,
}

/// A file's name without detours, whether there is such a file or not.
fn place_of(path: &Path) -> PathBuf {
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let in_folder = || Some(folder.canonicalize().ok()?.join(path.file_name()?));
    path.canonicalize()
        .ok()
        .or_else(in_folder)
        .unwrap_or_else(|| path.into())
}

/// For a command that reads no files.
pub(super) const NO_INPUTS: [&str; 0] = [];

impl Outputs {
    /// For a command that reads `inputs`, none of which it will overwrite, and that prints JSON on
    /// standard output or not.
    pub(super) fn new<P: AsRef<Path>>(json: bool, inputs: impl IntoIterator<Item = P>) -> Self {
        for input in inputs {
            files::protect_input(input.as_ref());
            tell_if_waiting(input.as_ref());
        }
        Self {
            json,
            files: Vec::new(),
        }
    }

    /// A file to write, with its format by its ending unless it is streamed.
    pub(super) fn file(mut self, path: &Path, endings: &Endings) -> anyhow::Result<Self> {
        self.check(path)?;
        if path.as_os_str() == files::STANDARD_OUTPUT {
            if self.json {
                return Err(UsageError(
                    "-o - and --json both write to standard output; leave one out".into(),
                )
                .into());
            }
            STDOUT_IS_OUTPUT.store(true, Ordering::Relaxed);
        } else if !files::is_stream(path)? {
            endings.allow(path)?;
        }
        let place = place_of(path);
        if self.files.contains(&place) {
            return Err(UsageError(format!(
                "{}: two outputs would be written to it",
                path.display()
            ))
            .into());
        }
        self.files.push(place);
        Ok(self)
    }

    /// Same as [`Self::file`], for an optional output.
    pub(super) fn maybe_file(
        self,
        path: Option<&PathBuf>,
        endings: &Endings,
    ) -> anyhow::Result<Self> {
        match path {
            Some(path) => self.file(path, endings),
            None => Ok(self),
        }
    }

    /// A folder to write to.
    pub(super) fn folder(self, path: &Path) -> anyhow::Result<Self> {
        files::check_folder(path).map_err(|error| cannot_write(path, error))?;
        Ok(self)
    }

    /// A folder for the frames of a path. What is named as a picture or a film is, is meant to be
    /// one.
    pub(super) fn folder_of_frames(self, path: &Path) -> anyhow::Result<Self> {
        const ELSEWHERE: [&str; 14] = [
            "avi", "mov", "mkv", "m4v", "wmv", "flv", "mpg", "mpeg", "ogv", "avif", "exr", "hdr",
            "svg", "jxl",
        ];
        let ending = path.extension().unwrap_or_default();
        let mut known = PICTURE.allowed.iter().chain(&ELSEWHERE);
        if !path.is_dir() && known.any(|known| ending.eq_ignore_ascii_case(known)) {
            let films: Vec<String> = FILM
                .allowed
                .iter()
                .map(|ending| format!(".{ending}"))
                .collect();
            let (path, films) = (path.display(), films.join(", "));
            let message = format!(
                "{path}: the ending of a film is one of {films}; for a picture of each pose, name a folder"
            );
            return Err(UsageError(message).into());
        }
        self.folder(path)
    }

    /// Tells what the loader met, and checks again now that all files of the scene are known: its
    /// materials, its textures.
    pub(super) fn scene_is_open(&self, scene: &Scene) -> anyhow::Result<()> {
        print_notes(scene);
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

/// Says what will be read from a pipe: nothing happens until something is written to it.
fn tell_if_waiting(input: &Path) {
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

/// Converts a refusal to a usage error, and any other error to a failure.
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

/// Saves an image, whole or not at all, in the format of its ending; PNG where it has none.
pub(super) fn save_picture(path: &Path, image: &image::RgbImage) -> anyhow::Result<()> {
    /// Beyond what is told from the original by eye.
    const JPEG_QUALITY: u8 = 95;
    let format = image::ImageFormat::from_path(path).unwrap_or(image::ImageFormat::Png);
    let (width, height) = image.dimensions();
    let written = files::write_whole(path, |w| {
        let encoded = match format {
            image::ImageFormat::Png => {
                let png = picture::png(
                    image.as_raw(),
                    width,
                    height,
                    image::ExtendedColorType::Rgb8,
                );
                return w.write_all(&png.map_err(std::io::Error::other)?);
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
pub(super) fn name_of(output: &Path) -> String {
    let is_standard = output.as_os_str() == files::STANDARD_OUTPUT;
    if is_standard {
        "standard output".into()
    } else {
        output.display().to_string()
    }
}

/// Writes a text file, whole or not at all.
pub(super) fn write_text(path: &Path, text: &str) -> anyhow::Result<()> {
    let written = files::write_whole(path, |w| w.write_all(text.as_bytes()));
    written.map_err(|error| cannot_write(path, error))
}
