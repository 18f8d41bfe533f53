//! Where photographs were taken (E2): found by COLMAP, which is run where it is installed.
//!
//! Its model is put beside the photographs, as `sparse/0`, where [`ImageSet::open`](super::ImageSet::open) looks for it: whole, or
//! not at all. Axes and unit of such a model are what COLMAP makes them.

use crate::color_images::read_size;
use std::collections::VecDeque;
use std::fs;
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Endings of pictures that COLMAP is given and this crate can read.
const ENDINGS: [&str; 6] = ["jpg", "jpeg", "png", "tif", "tiff", "bmp"];
/// So many pictures or fewer are each compared with each; of more, neighbours by name are.
const ALL_PAIRS: usize = 200;
/// Lines of a program that are kept for the case that it fails.
const LAST_WORDS: usize = 4;

/// A step of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlignStep {
    /// Points that can be found again, in each picture.
    Features,
    /// The same points in pairs of pictures.
    Matches,
    /// Where each picture was taken.
    Poses,
}

/// What was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Aligned {
    /// Pictures whose place is known.
    pub found: usize,
    /// Pictures in all.
    pub pictures: usize,
    /// Where the model was put.
    pub model: PathBuf,
}

/// Why photographs could not be aligned.
#[derive(Debug, thiserror::Error)]
pub enum AlignError {
    /// COLMAP is not there.
    #[error(
        "COLMAP is not installed, which finds where photographs were taken (Debian: apt install colmap); or give cameras in \
         transforms.json or a COLMAP model"
    )]
    NotInstalled,
    /// There is a model already, which is not replaced.
    #[error("{}: there is a model already, which is used without aligning; remove it to have it made anew", .0.display())]
    Exists(PathBuf),
    /// Too little to work with.
    #[error("{}: {count} photographs; at least three are needed ({})", folder.display(), ENDINGS.join(", "))]
    FewPictures {
        /// The folder.
        folder: PathBuf,
        /// How many it has.
        count: usize,
    },
    /// COLMAP gave up.
    #[error("colmap {step} failed: {words}")]
    Failed {
        /// The step, by COLMAP's name.
        step: &'static str,
        /// What it said last.
        words: String,
    },
    /// COLMAP ended, and found nothing.
    #[error(
        "COLMAP could not say of any two photographs where they were taken: they show too little of the same things"
    )]
    NoModel,
    /// A file cannot be read or written.
    #[error("{}: {cause}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system says.
        cause: io::Error,
    },
}

/// Is told of each step how much of how much is done.
pub type AlignProgress<'a> = dyn FnMut(AlignStep, usize, usize) + 'a;

/// Finds out where the photographs in a folder (or in `images` in it) were taken, and puts the model there as `sparse/0`.
///
/// # Errors
/// [`AlignError`]; the folder is then what it was.
pub fn align(folder: &Path, progress: &mut AlignProgress<'_>) -> Result<Aligned, AlignError> {
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
    let photographs = pictures_in(&images).map_err(io(&images))?;
    let pictures = photographs.len();
    if pictures < 3 {
        return Err(AlignError::FewPictures {
            folder: images,
            count: pictures,
        });
    }
    // Beside the photographs, so that what is made can be renamed.
    let work = tempfile::Builder::new()
        .prefix(".align-")
        .tempdir_in(folder)
        .map_err(io(folder))?;
    let (database, models) = (work.path().join("database.db"), work.path().join("sparse"));
    fs::create_dir(&models).map_err(io(&models))?;

    let mut colmap = Colmap {
        database: &database,
        pictures,
        progress,
    };
    // COLMAP leaves out what is of another size than its only camera, such as upright pictures among others.
    let one_camera = if of_one_size(&photographs) { "1" } else { "0" };
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
    let matcher = if pictures <= ALL_PAIRS {
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
        // Some versions end as if they had failed where there is nothing to be found.
        Err(AlignError::Failed { words, .. })
            if words.contains("failed to create sparse model") => {}
        result => result?,
    }

    let (found, best) = largest_model(&models)
        .map_err(io(&models))?
        .ok_or(AlignError::NoModel)?;
    let ready = work.path().join("ready");
    fs::create_dir(&ready)
        .and_then(|()| fs::rename(&best, ready.join("0")))
        .map_err(io(&best))?;
    fs::rename(&ready, &sparse).map_err(io(&sparse))?;
    Ok(Aligned {
        found,
        pictures,
        model: sparse.join("0"),
    })
}

fn pictures_in(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut pictures = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path
            .extension()
            .is_some_and(|e| ENDINGS.iter().any(|known| e.eq_ignore_ascii_case(known)))
        {
            pictures.push(path);
        }
    }
    Ok(pictures)
}

/// Whether all pictures can be of one camera. What cannot be read is no reason against it: COLMAP leaves it out.
fn of_one_size(pictures: &[PathBuf]) -> bool {
    let mut sizes = pictures.iter().filter_map(|path| read_size(path).ok());
    sizes
        .next()
        .is_none_or(|first| sizes.all(|size| size == first))
}

/// Of the models that do not hang together the one with most pictures, and how many.
fn largest_model(models: &Path) -> io::Result<Option<(usize, PathBuf)>> {
    let mut best: Option<(usize, PathBuf)> = None;
    for entry in fs::read_dir(models)? {
        let model = entry?.path();
        let Ok(bytes) = fs::read(model.join("images.bin")) else {
            continue;
        };
        // The file begins with their number.
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

struct Colmap<'a, 'b> {
    database: &'a Path,
    pictures: usize,
    progress: &'a mut AlignProgress<'b>,
}

impl Colmap<'_, '_> {
    /// Runs a step without a GPU, of which the option has two names, before COLMAP 3.12 and since.
    fn run(
        &mut self,
        command: &'static str,
        step: AlignStep,
        gpu_option_of: Option<&str>,
        arguments: &[std::ffi::OsString],
    ) -> Result<(), AlignError> {
        let Some(part) = gpu_option_of else {
            return self.run_once(command, step, None, arguments);
        };
        match self.run_once(
            command,
            step,
            Some(&format!("--Sift{part}.use_gpu")),
            arguments,
        ) {
            Err(AlignError::Failed { words, .. }) if words.contains("use_gpu") => self.run_once(
                command,
                step,
                Some(&format!("--Feature{part}.use_gpu")),
                arguments,
            ),
            result => result,
        }
    }

    fn run_once(
        &mut self,
        command: &'static str,
        step: AlignStep,
        gpu_option: Option<&str>,
        arguments: &[std::ffi::OsString],
    ) -> Result<(), AlignError> {
        (self.progress)(step, 0, self.pictures);
        let of_program = |cause: io::Error| match cause.kind() {
            io::ErrorKind::NotFound => AlignError::NotInstalled,
            _ => AlignError::Io {
                path: "colmap".into(),
                cause,
            },
        };
        let (lines, writer) = io::pipe().map_err(of_program)?;
        let mut program = Command::new("colmap");
        program
            .arg(command)
            .arg("--database_path")
            .arg(self.database)
            .args(arguments);
        gpu_option.map(|option| program.args([option, "0"]));
        // It has windows of its own, which nobody is to see.
        program
            .env("QT_QPA_PLATFORM", "offscreen")
            .stdin(std::process::Stdio::null());
        program
            .stdout(writer.try_clone().map_err(of_program)?)
            .stderr(writer);
        let mut child = program.spawn().map_err(of_program)?;
        // Else the pipe would not end with the child.
        drop(program);
        let mut words = VecDeque::new();
        for line in BufReader::new(lines).split(b'\n') {
            let line = String::from_utf8_lossy(&line.map_err(of_program)?)
                .trim()
                .to_owned();
            if let Some((done, all)) = how_far(step, &line, self.pictures) {
                (self.progress)(step, done.min(all), all);
            }
            if !line.is_empty() {
                words.push_back(line);
                words.drain(..words.len().saturating_sub(LAST_WORDS));
            }
        }
        match child.wait().map_err(of_program)?.success() {
            true => Ok(()),
            false => Err(AlignError::Failed {
                step: command,
                words: Vec::from(words).join("; "),
            }),
        }
    }
}

/// What a line says of how much is done: `Processed file [3/16]`, `Matching block [1/2, 2/2]`, `Registering image #7 (5)`.
fn how_far(step: AlignStep, line: &str, pictures: usize) -> Option<(usize, usize)> {
    let number = |text: &str| text.trim().parse::<usize>().ok();
    if step == AlignStep::Poses {
        let (_, rest) = line.split_once("Registering image #")?;
        let (_, count) = rest.split_once('(')?;
        return Some((number(count.split(')').next()?)?, pictures));
    }
    let inside = line.split_once('[')?.1.split(']').next()?;
    let mut so_far = (0_usize, 1_usize);
    for part in inside.split(',') {
        let (done, all) = part.split_once('/')?;
        let (done, all) = (number(done)?, number(all)?);
        so_far = (
            so_far.0 * all + done.checked_sub(1)?,
            so_far.1.checked_mul(all)?,
        );
    }
    Some((so_far.0 + 1, so_far.1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_say_how_far_the_work_is() {
        let features = |line| how_far(AlignStep::Features, line, 16);
        assert_eq!(
            features("I20261123 feature.cc:1] Processed file [3/16]"),
            Some((3, 16))
        );
        assert_eq!(features("Processed file [0/16]"), None);
        assert_eq!(features("  Name: a[1].png"), None);
        assert_eq!(
            how_far(AlignStep::Matches, "Matching block [2/3, 1/3] in 0.1s", 16),
            Some((4, 9))
        );
        assert_eq!(
            how_far(AlignStep::Poses, "Registering image #7 (5)", 16),
            Some((5, 16))
        );
        assert_eq!(
            how_far(AlignStep::Poses, "=> Image sees 12 / 40 points", 16),
            None
        );
    }

    #[test]
    fn the_model_of_most_pictures_is_taken() {
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
    fn a_folder_with_a_model_or_without_pictures_is_left_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let silent = &mut |_, _, _| ();
        let error = align(folder.path(), silent).unwrap_err();
        assert!(
            matches!(error, AlignError::FewPictures { count: 0, .. }),
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
