//! Camera poses of photographs (E2), estimated by an installed COLMAP: the program `colmap` or,
//! where it is absent, the Python package `pycolmap`.
//!
//! The model is stored next to the photographs as `sparse/0`, where
//! [`ImageSet::open`](super::ImageSet::open) looks for it, completely or not at all. COLMAP chooses
//! the axes and the unit of such a model.

use crate::views::color_images::read_size;
use headbox_core::files::StagingFolder;
use std::collections::VecDeque;
use std::fs;
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// File extensions of images that both COLMAP and this crate read.
const EXTENSIONS: [&str; 6] = ["jpg", "jpeg", "png", "tif", "tiff", "bmp"];

/// Maximum number of photographs for exhaustive matching; larger sets match neighbours by name.
const ALL_PAIRS: usize = 200;

/// Runs a step by pycolmap, with the arguments of the program `colmap`.
const PYCOLMAP_STEP: &str = include_str!("align_pycolmap.py");

/// Number of output lines kept for the error message.
const MESSAGE_LINES: usize = 4;

/// Step of the alignment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlignStep {
    /// Feature extraction in each photograph.
    Features,
    /// Feature matching between pairs of photographs.
    Matches,
    /// Pose estimation of each photograph.
    Poses,
}

/// Result of an alignment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Alignment {
    /// Number of photographs with a pose.
    pub posed: usize,
    /// Number of photographs in the folder.
    pub photographs: usize,
    /// Folder of the model.
    pub model: PathBuf,
}

/// Error of aligning photographs.
#[derive(Debug, thiserror::Error)]
pub enum AlignError {
    /// COLMAP is not installed.
    #[error(
        "COLMAP, which estimates the camera poses, is not installed (Debian: apt install colmap, or for python3: \
                 pip install pycolmap); install it, or provide cameras in transforms.json or a COLMAP model"
    )]
    NotInstalled,
    /// The folder has a model, which is not replaced.
    #[error("{}: a model exists and is used without aligning; remove it to align again", .0.display())]
    Exists(PathBuf),
    /// Fewer than three photographs.
    #[error("{}: {count} photographs, but at least three are needed ({})", folder.display(), EXTENSIONS.join(", "))]
    TooFewPhotographs {
        /// The folder.
        folder: PathBuf,
        /// Number of photographs.
        count: usize,
    },
    /// A COLMAP command failed.
    #[error("colmap {step} failed: {message}")]
    Failed {
        /// COLMAP command.
        step: &'static str,
        /// Last lines of its output.
        message: String,
    },
    /// COLMAP succeeded without a model.
    #[error("COLMAP found no poses: no two photographs overlap enough")]
    NoModel,
    /// A file cannot be read or written.
    #[error("{}: {cause}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Error of the operating system.
        cause: io::Error,
    },
}

/// Progress callback: step, number of units done, and total.
pub type AlignProgress<'a> = dyn FnMut(AlignStep, usize, usize) + 'a;

/// Estimates the poses of the photographs in a folder (or in its subfolder `images`) and stores the
/// model there as `sparse/0`.
///
/// # Errors
/// [`AlignError`]; the folder is then unchanged.
pub fn align(folder: &Path, progress: &mut AlignProgress<'_>) -> Result<Alignment, AlignError> {
    let io = |path: &Path| {
        let path = path.to_owned();
        move |cause| AlignError::Io { path, cause }
    };
    let sparse = folder.join("sparse");
    if sparse.exists() {
        return Err(AlignError::Exists(sparse));
    }
    let images = [folder.join("images"), folder.to_owned()]
        .into_iter()
        .find(|path| path.is_dir());
    let images = images.unwrap_or_else(|| folder.to_owned());
    let files = list_photographs(&images).map_err(io(&images))?;
    let photographs = files.len();
    if photographs < 3 {
        return Err(AlignError::TooFewPhotographs {
            folder: images,
            count: photographs,
        });
    }
    let engine = Engine::find().ok_or(AlignError::NotInstalled)?;
    // In the same folder, so that the result can be renamed into place.
    let work = StagingFolder::create_in(folder).map_err(io(folder))?;
    let database = work.path().join("database.db");
    let models = work.path().join("sparse");
    fs::create_dir(&models).map_err(io(&models))?;

    let mut colmap = ColmapRunner {
        engine,
        database: &database,
        photographs,
        progress,
    };
    // With a single camera, COLMAP skips photographs of another size, such as upright ones.
    let one_camera = if have_one_size(&files) { "1" } else { "0" };
    let cameras = [
        "--ImageReader.single_camera",
        one_camera,
        "--ImageReader.camera_model",
        "SIMPLE_RADIAL",
    ];
    let mut extract = vec!["--image_path".into(), images.as_os_str().to_owned()];
    extract.extend(cameras.map(Into::into));
    colmap.run(
        "feature_extractor",
        AlignStep::Features,
        Some("Extraction"),
        &extract,
    )?;
    let matcher = if photographs <= ALL_PAIRS {
        "exhaustive_matcher"
    } else {
        "sequential_matcher"
    };
    colmap.run(matcher, AlignStep::Matches, Some("Matching"), &[])?;
    let map = [
        "--image_path".into(),
        images.into(),
        "--output_path".into(),
        models.as_os_str().to_owned(),
    ];
    match colmap.run("mapper", AlignStep::Poses, None, &map) {
        // Some versions report failure when there is no model.
        Err(AlignError::Failed { message, .. })
            if message.contains("failed to create sparse model") => {}
        result => result?,
    }

    let (posed, best) = largest_model(&models)
        .map_err(io(&models))?
        .ok_or(AlignError::NoModel)?;
    let ready = work.path().join("ready");
    fs::create_dir(&ready)
        .and_then(|()| fs::rename(&best, ready.join("0")))
        .map_err(io(&best))?;
    fs::rename(&ready, &sparse).map_err(io(&sparse))?;
    Ok(Alignment {
        posed,
        photographs,
        model: sparse.join("0"),
    })
}

fn list_photographs(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut photographs = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path
            .extension()
            .is_some_and(|e| EXTENSIONS.iter().any(|known| e.eq_ignore_ascii_case(known)))
        {
            photographs.push(path);
        }
    }
    Ok(photographs)
}

/// Returns true if all readable photographs have the same size; COLMAP skips unreadable ones.
fn have_one_size(photographs: &[PathBuf]) -> bool {
    let mut sizes = photographs.iter().filter_map(|path| read_size(path).ok());
    sizes
        .next()
        .is_none_or(|first| sizes.all(|size| size == first))
}

/// Returns the number of photographs and the folder of the largest of the disconnected models.
fn largest_model(models: &Path) -> io::Result<Option<(usize, PathBuf)>> {
    let mut best: Option<(usize, PathBuf)> = None;
    for entry in fs::read_dir(models)? {
        let model = entry?.path();
        let Ok(bytes) = fs::read(model.join("images.bin")) else {
            continue;
        };
        // The file starts with the number of photographs.
        let count = bytes
            .first_chunk()
            .map_or(0, |first| u64::from_le_bytes(*first)) as usize;
        let is_better =
            |(most, path): &(usize, PathBuf)| count > *most || (count == *most && model < *path);
        if count > 0 && best.as_ref().is_none_or(is_better) {
            best = Some((count, model));
        }
    }
    Ok(best)
}

/// Installation of COLMAP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Engine {
    /// The program `colmap`.
    Program,
    /// The package `pycolmap` of `python3`.
    Python,
}

impl Engine {
    /// Finds an installation, the program first.
    fn find() -> Option<Self> {
        let run = |program: &str, arguments: &[&str]| {
            Command::new(program)
                .args(arguments)
                .env("QT_QPA_PLATFORM", "offscreen")
                .stdin(Stdio::null())
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .status()
        };
        if !matches!(run("colmap", &["help"]), Err(cause) if cause.kind() == io::ErrorKind::NotFound)
        {
            return Some(Self::Program);
        }
        run("python3", &["-c", "import pycolmap"])
            .is_ok_and(|status| status.success())
            .then_some(Self::Python)
    }

    /// The command line of a step, without its arguments.
    fn command(self, step: &str) -> Command {
        let mut command;
        match self {
            Self::Program => command = Command::new("colmap"),
            Self::Python => {
                command = Command::new("python3");
                command.args(["-c", PYCOLMAP_STEP]);
            }
        }
        command.arg(step);
        command
    }
}

/// Runs COLMAP commands on one database.
struct ColmapRunner<'a, 'b> {
    engine: Engine,
    database: &'a Path,
    photographs: usize,
    progress: &'a mut AlignProgress<'b>,
}

impl ColmapRunner<'_, '_> {
    /// Runs a command without a GPU. The option was renamed in COLMAP 3.12.
    fn run(
        &mut self,
        command: &'static str,
        step: AlignStep,
        gpu_section: Option<&str>,
        arguments: &[std::ffi::OsString],
    ) -> Result<(), AlignError> {
        // pycolmap is told by the script.
        let gpu_section = gpu_section.filter(|_| self.engine == Engine::Program);
        let option =
            |prefix: &str| gpu_section.map(|section| format!("--{prefix}{section}.use_gpu"));
        match self.run_once(command, step, option("Sift"), arguments) {
            Err(AlignError::Failed { message, .. })
                if gpu_section.is_some() && message.contains("use_gpu") =>
            {
                self.run_once(command, step, option("Feature"), arguments)
            }
            result => result,
        }
    }

    fn run_once(
        &mut self,
        command: &'static str,
        step: AlignStep,
        gpu_option: Option<String>,
        arguments: &[std::ffi::OsString],
    ) -> Result<(), AlignError> {
        (self.progress)(step, 0, self.photographs);
        let program_error = |cause: io::Error| match cause.kind() {
            io::ErrorKind::NotFound => AlignError::NotInstalled,
            _ => AlignError::Io {
                path: "colmap".into(),
                cause,
            },
        };
        let (lines, writer) = io::pipe().map_err(program_error)?;
        let mut program = self.engine.command(command);
        program
            .arg("--database_path")
            .arg(self.database)
            .args(arguments);
        gpu_option.map(|option| program.args([option.as_str(), "0"]));
        // Without this COLMAP needs a display.
        program
            .env("QT_QPA_PLATFORM", "offscreen")
            .stdin(Stdio::null());
        program
            .stdout(writer.try_clone().map_err(program_error)?)
            .stderr(writer);
        let mut child = program.spawn().map_err(program_error)?;
        // Closes this process's copy of the pipe, so that the pipe ends with the child.
        drop(program);
        let mut last_lines = VecDeque::new();
        for line in BufReader::new(lines).split(b'\n') {
            let line = String::from_utf8_lossy(&line.map_err(program_error)?)
                .trim()
                .to_owned();
            if let Some((done, all)) = parse_progress(step, &line, self.photographs) {
                (self.progress)(step, done.min(all), all);
            }
            if !line.is_empty() {
                last_lines.push_back(line);
                last_lines.drain(..last_lines.len().saturating_sub(MESSAGE_LINES));
            }
        }
        if child.wait().map_err(program_error)?.success() {
            Ok(())
        } else {
            Err(AlignError::Failed {
                step: command,
                message: Vec::from(last_lines).join("; "),
            })
        }
    }
}

/// Parses the progress in a line of COLMAP's output: `Processed file [3/16]`, `Matching block [1/2,
/// 2/2]`, `Registering image #7 (5)`.
fn parse_progress(step: AlignStep, line: &str, photographs: usize) -> Option<(usize, usize)> {
    let number = |text: &str| text.trim().parse::<usize>().ok();
    if step == AlignStep::Poses {
        let (_, rest) = line.split_once("Registering image #")?;
        let (_, count) = rest.split_once('(')?;
        return Some((number(count.split(')').next()?)?, photographs));
    }
    let inside = line.split_once('[')?.1.split(']').next()?;
    let mut index = 0_usize;
    let mut count = 1_usize;
    for part in inside.split(',') {
        let (done, all) = part.split_once('/')?;
        let all = number(all)?;
        index = index * all + number(done)?.checked_sub(1)?;
        count = count.checked_mul(all)?;
    }
    Some((index + 1, count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_parsed_from_output() {
        let features = |line| parse_progress(AlignStep::Features, line, 16);
        assert_eq!(
            features("I20261123 feature.cc:1] Processed file [3/16]"),
            Some((3, 16))
        );
        assert_eq!(features("Processed file [0/16]"), None);
        assert_eq!(features("  Name: a[1].png"), None);
        assert_eq!(
            parse_progress(AlignStep::Matches, "Matching block [2/3, 1/3] in 0.1s", 16),
            Some((4, 9))
        );
        assert_eq!(
            parse_progress(AlignStep::Poses, "Registering image #7 (5)", 16),
            Some((5, 16))
        );
        assert_eq!(
            parse_progress(AlignStep::Poses, "=> Image sees 12 / 40 points", 16),
            None
        );
    }

    #[test]
    fn largest_model_most_photographs() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(largest_model(folder.path()).unwrap(), None);
        for (name, count) in [("0", 3_u64), ("1", 7), ("2", 7), ("3", 0)] {
            fs::create_dir(folder.path().join(name)).unwrap();
            fs::write(
                folder.path().join(name).join("images.bin"),
                count.to_le_bytes(),
            )
            .unwrap();
        }
        assert_eq!(
            largest_model(folder.path()).unwrap(),
            Some((7, folder.path().join("1")))
        );
    }

    #[test]
    fn align_refuses_unsuitable_folders() {
        let folder = tempfile::tempdir().unwrap();
        let silent = &mut |_, _, _| ();
        let error = align(folder.path(), silent).unwrap_err();
        assert!(
            matches!(error, AlignError::TooFewPhotographs { count: 0, .. }),
            "{error}"
        );
        fs::create_dir(folder.path().join("sparse")).unwrap();
        assert!(matches!(
            align(folder.path(), silent),
            Err(AlignError::Exists(_))
        ));
        assert!(matches!(
            align(&folder.path().join("absent"), silent),
            Err(AlignError::Io { .. })
        ));
    }
}
