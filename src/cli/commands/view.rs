//! `headbox view`.

use super::images::is_image_set;
use crate::args::{Names, SourceArgs, by_name, parse_size, refuse_given};
use crate::commands::capture::place::HeadboxArgs;
use crate::commands::capture::{Preset, PresetArgs};
use crate::commands::images;
use crate::commands::render::geometry::{
    GEOMETRY_ALONE, GeometryArgs, open_geometry, parse_texturing,
};
use crate::commands::render::layers;
use crate::image_set::SetArgs;
use crate::messages::{UsageError, shell_quote};
use crate::output::{Outputs, WINDOW, output_name, parent_folder, print_json};
use crate::progress::Bar;
use anyhow::Context;
use clap::Args;
use headbox_core::camera::Camera;
use headbox_core::inputs::HOMES;
use headbox_images::{ImageSet, View, read_sparse_points};
use headbox_ldi::from_images::{ImageSetCapture, NearestImages};
use headbox_photos::cache;
use headbox_photos::view_geometry::view::GeometryView;
use headbox_photos::view_geometry::{GeometrySettings, Texturing};
use headbox_viewer::{
    Exit, FrameSource, PendingSource, ReplayMode, Stereo, ViewerError, ViewerOptions,
};
use headbox_window::{
    CaptureOptions, Marks, SceneLibrary, is_captured, open, open_source, show_cube, show_live,
    show_marks, show_photographs, show_view,
};
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::{Duration, Instant};

#[derive(Args)]
pub(crate) struct ViewCommand {
    /// Input: a .ldi, .sprite, .lumi or .house file, a deep .exr, a home (Home.xml, .sh3d, .toml)
    /// to walk in, a folder of images, or a scene (.obj, .gltf, .glb, .ply, .stl, builtin:NAME) to
    /// capture while looking around; or several .ldi and .sprite files, folders of images with
    /// depth and models of one world, composed as by render; the start page by default
    #[arg(value_name = "FILE")]
    files: Vec<String>,
    /// Folder of images: draw it by view-dependent geometry, such as geometry-averaged, instead of
    /// a cube LDI
    #[arg(long, value_name = "NAME")]
    variant: Option<String>,
    /// Folder of images with depth: show a cube LDI of only the images nearest to the view, rebuilt
    /// as the eye moves, anywhere; --set images=N selects their number, 1 to 16, 3 by default
    #[arg(long, conflicts_with = "variant")]
    live: bool,
    #[command(flatten)]
    geometry: GeometryArgs,
    #[command(flatten)]
    images: SetArgs,
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    headbox: HeadboxArgs,
    #[command(flatten)]
    preset: PresetArgs,
    /// Path or camera file to replay
    #[arg(long, value_name = "PATH.json")]
    path: Option<PathBuf>,
    /// Replay every pose once, regardless of frame times, instead of by the times of the path
    #[arg(long, requires = "path")]
    every_pose: bool,
    /// Close the window at the end of the path
    #[arg(long, requires = "path")]
    exit_after_path: bool,
    /// Close the window after N frames
    #[arg(long, value_name = "N", conflicts_with = "exit_after_path")]
    frames: Option<u64>,
    /// Close the window when refinement is complete: of a capture or an error map
    #[arg(long, conflicts_with_all = ["exit_after_path", "frames"])]
    when_refined: bool,
    /// Save an image of the window to this file, then close the window
    #[arg(long, value_name = "OUT.png")]
    screenshot: Option<PathBuf>,
    /// Size of the window, points
    #[arg(long, value_name = "WxH", default_value = "1280x800", value_parser = parse_size)]
    window_size: (u32, u32),
    /// Set a control of the panel, such as kernel=paper or overlay=error
    #[arg(long, value_name = "ID=VALUE", value_parser = parse_pair)]
    set: Vec<(String, String)>,
    /// Compare with another value of a control, left and right of a divider
    #[arg(long, value_name = "ID=VALUE", value_parser = parse_pair)]
    compare: Vec<(String, String)>,
    /// Show both eyes side by side
    #[arg(long, value_parser = by_name(STEREO))]
    stereo: Option<Stereo>,
    /// Time limit of a frame while the eye moves, milliseconds, 4 to 100, above which fewer pixels
    /// are rendered; 0 always renders all pixels
    #[arg(long, value_name = "MS", default_value_t = ViewerOptions::MOVING_LIMIT_MS, value_parser = parse_limit)]
    moving_limit: f64,
    /// Show only the frame, without panels
    #[arg(long)]
    no_panels: bool,
    /// Folder for saved frames, cameras, paths and captures
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
    /// Print measurements as one JSON object on standard output when the window closes
    #[arg(long)]
    json: bool,
}

/// Arrangements of a stereo pair.
const STEREO: Names<Stereo> = &[
    ("cross", "Right eye's view on the left", Stereo::CrossEyed),
    ("parallel", "Left eye's view on the left", Stereo::Parallel),
];

fn parse_pair(text: &str) -> Result<(String, String), String> {
    let (id, value) = text.split_once('=').ok_or("give ID=VALUE")?;
    Ok((id.into(), value.into()))
}

fn parse_limit(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|ms| *ms == 0.0 || (4.0..=100.0).contains(ms))
        .ok_or("give 0, or milliseconds from 4 to 100".into())
}

/// Number of frames before a screenshot without a path: the window may not have its final size in
/// the first ones.
const FRAMES_BEFORE_PICTURE: u64 = 3;

impl ViewCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let inputs = self.files.iter().map(Path::new).chain(self.path.as_deref());
        Outputs::new(self.json, inputs).maybe_file(self.screenshot.as_ref(), &WINDOW)?;
        let mut options = self.options()?;
        let mut source = None;
        let opener = match self.files.as_slice() {
            [] => None,
            [file] => Some((file.clone(), self.opener(file)?)),
            files => Some((files.join(", "), self.layers_opener()?)),
        };
        if let Some((name, opener)) = opener {
            match open_or_defer(&name, opener)? {
                OpenedSource::Ready(opened) => source = Some(opened),
                OpenedSource::Pending(coming) => options.coming = Some(coming),
            }
        }
        let summary = headbox_viewer::run(source, options);
        let summary = summary.map_err(|error| self.with_alternative(error))?;
        if self.json {
            print_json(&serde_json::to_value(summary)?);
        } else if let Some(screenshot) = &self.screenshot {
            println!("{}: a picture of the window", output_name(screenshot));
        }
        Ok(())
    }

    /// Adds to an error without a window how the input can be seen all the same.
    fn with_alternative(&self, error: ViewerError) -> anyhow::Error {
        if !matches!(
            error,
            ViewerError::NoDisplay(_) | ViewerError::NoOpenGl(_) | ViewerError::Window(_)
        ) {
            return error.into();
        }
        let has_page = |file: &&String| {
            let representation = headbox_views::find(Path::new(file));
            let exporters = representation.map_or(&[][..], |found| found.exporters);
            exporters
                .iter()
                .any(|exporter| exporter.extension == "html")
        };
        let page = match self.files.as_slice() {
            [file] => Some(file).filter(has_page),
            _ => None,
        };
        if let Some(file) = page {
            let page = Path::new(file).with_extension("html");
            return anyhow::anyhow!(
                "{error}; see it in a browser: headbox export {file} -o {}; or render images: \
                 headbox render {file} -o frame.png",
                page.display()
            );
        }
        let file_command = match self.files.as_slice() {
            [file] => file_command(file),
            _ => None,
        };
        file_command.map_or_else(
            || {
                anyhow::anyhow!(
                    "{error}; headbox render makes images without a window, and headbox export makes pages for a browser"
                )
            },
            |command| {
                anyhow::anyhow!(
                    "{error}; make a file of it for headbox render and headbox export: {command}"
                )
            },
        )
    }

    /// Creates the function that opens several files as one view.
    ///
    /// # Errors
    /// A usage error if an option does not apply to several files.
    fn layers_opener(&self) -> anyhow::Result<Opener> {
        if self.live || self.variant.is_some() || self.geometry.are_given() {
            bail_usage!(
                "--live, --variant and the options of view-dependent geometry are for one folder of images"
            );
        }
        let is_set = |file: &String| is_image_set(file);
        self.images
            .refuse_without_set(self.files.iter().any(is_set))?;
        let files: Vec<PathBuf> = self.files.iter().map(PathBuf::from).collect();
        let images = self.images;
        Ok(Box::new(move || {
            let view = layers::open(&files, &images)?;
            let names = files.iter().filter_map(|file| file.file_name());
            let names: Vec<_> = names.map(|name| name.to_string_lossy()).collect();
            Ok(show_view(Box::new(view), Path::new(&names.join(" + "))))
        }))
    }

    /// Creates the function that opens a file.
    ///
    /// # Errors
    /// A usage error if an option does not apply to the file.
    fn opener(&self, file: &str) -> anyhow::Result<Opener> {
        let is_set = is_image_set(file);
        if self.live && !is_set {
            bail_usage!("--live is for a folder of images with depth");
        }
        self.images.refuse_without_set(is_set)?;
        let texturing = parse_texturing(self.variant.as_deref(), is_set)?;
        if let (None, Some(variant)) = (texturing, &self.variant) {
            bail_usage!(
                "--variant {variant}: view has geometry-blended and its kin (-averaged, -multi, -single, -nearest) alone, of a folder of \
                 images with depth; what splats look like is a setting (--set kernel=NAME)"
            );
        }
        if texturing.is_none() && self.geometry.are_given() {
            bail_usage!("{GEOMETRY_ALONE}");
        }
        if !is_captured(file) {
            refuse_given(
                "an input that the window does not capture",
                self.capture_flags(),
            )?;
        }
        if !is_set {
            let source = self.source.source(file);
            let options = self.capture_options();
            return Ok(Box::new(move || Ok(open_source(source, options)?)));
        }
        let (folder, set, live) = (PathBuf::from(file), self.images, self.live);
        let geometry = self.geometry.clone();
        Ok(Box::new(move || {
            open_set(&folder, set, live, texturing, &geometry)
        }))
    }

    /// Flags of a capture in the window, each with true if it is given.
    fn capture_flags(&self) -> impl Iterator<Item = (&'static str, bool)> {
        let quality = ("--quality", self.preset.quality.is_some());
        self.headbox.given_flags().into_iter().chain([quality])
    }

    /// Headbox and quality of a capture in the window.
    fn capture_options(&self) -> CaptureOptions {
        CaptureOptions {
            centre: self.headbox.center,
            half_size: self.headbox.half_size,
            quality: self.preset.quality.map(Preset::numbers),
            is_strict: self.images.strict.is_strict(),
        }
    }

    fn options(&self) -> Result<ViewerOptions, UsageError> {
        if self.files.is_empty() {
            refuse_given("the start page", self.capture_flags())?;
        }
        if self.files.is_empty()
            && (self.path.is_some() || self.frames.is_some() || self.when_refined)
        {
            return Err(UsageError(
                "--path, --frames and --when-refined need a file to show".into(),
            ));
        }
        let (width, height) = self.window_size;
        let with_path = self.path.is_some();
        let exit = match (self.exit_after_path, self.frames, &self.screenshot) {
            (true, ..) => Exit::AfterPath,
            (_, Some(frames), _) => Exit::AfterFrames(frames),
            _ if self.when_refined => Exit::WhenRefined,
            (.., Some(_)) if with_path => Exit::AfterPath,
            (.., Some(_)) if !self.files.is_empty() => Exit::AfterFrames(FRAMES_BEFORE_PICTURE),
            (.., Some(_)) => Exit::AfterThumbnails,
            _ => Exit::Never,
        };
        Ok(ViewerOptions {
            started: Instant::now(),
            library: Some(Box::new(SceneLibrary)),
            file: match self.files.as_slice() {
                [file] => Some(PathBuf::from(file)).filter(|file| file.is_file()),
                _ => None,
            },
            name: self.source_name(),
            bookmark_dir: state_folder().map(|folder| folder.join("bookmarks")),
            thumbnail_dir: cache::folder("thumbnails"),
            recent_file: state_folder().map(|folder| folder.join("recent.json")),
            window_size_points: [width as f32, height as f32],
            panels: !self.no_panels,
            settings: self.set.clone(),
            compare: (!self.compare.is_empty()).then(|| self.compare.clone()),
            stereo: self.stereo.unwrap_or_default(),
            moving_limit_ms: (self.moving_limit > 0.0).then_some(self.moving_limit),
            path: self.path.clone(),
            replay: if self.every_pose {
                ReplayMode::EveryPose
            } else {
                ReplayMode::InTime
            },
            output_dir: self.out.clone(),
            screenshot: self.screenshot.clone(),
            exit,
            ..ViewerOptions::default()
        })
    }
}

impl ViewCommand {
    /// Name of the inputs for their bookmarks: absolute paths, and names of built-in scenes.
    fn source_name(&self) -> Option<String> {
        let absolute = |file: &String| match Path::new(file).canonicalize() {
            Ok(path) => path.display().to_string(),
            Err(_) => file.clone(),
        };
        let names: Vec<_> = self.files.iter().map(absolute).collect();
        (!names.is_empty()).then(|| names.join(" + "))
    }
}

/// Returns the command that makes a file of a scene or a home, which `render` and `export` refuse;
/// `None` for other inputs.
fn file_command(input: &str) -> Option<String> {
    let path = Path::new(input.strip_prefix("builtin:").unwrap_or(input));
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    let (command, made) = if is_captured(input) {
        ("capture", "ldi")
    } else if input.starts_with("builtin:") || HOMES.iter().any(|home| extension == *home) {
        ("house", "house")
    } else {
        return None;
    };
    // The file is written to the current folder: that of the scene may be read-only.
    let output = PathBuf::from(path.file_name()?).with_extension(made);
    let [input, output] = [Path::new(input), &output].map(shell_quote);
    Some(format!("headbox {command} {input} -o {output}"))
}

/// Function that opens a source.
type Opener = Box<dyn FnOnce() -> anyhow::Result<Box<dyn FrameSource>> + Send>;

/// Opens a folder of images: by cube LDIs of the images nearest to the eye if `live`, by
/// view-dependent geometry with `texturing`, else as one cube LDI.
fn open_set(
    folder: &Path,
    set: SetArgs,
    live: bool,
    texturing: Option<Texturing>,
    geometry: &GeometryArgs,
) -> anyhow::Result<Box<dyn FrameSource>> {
    let set = set.open_registered(folder)?;
    let marks = Marks::new(&set.views, read_sparse_points(folder)?);
    let source = if live {
        let (near, start) = near_images(folder, set)?;
        show_live(near, folder, &start)?
    } else if let Some(texturing) = texturing {
        let settings = GeometrySettings {
            texturing,
            ..geometry.settings()
        };
        let (geometry, start) = open_geometry(&set, &geometry.resources)?;
        let no_start = || {
            format!(
                "{}: its middle view is no perspective picture to start at",
                folder.display()
            )
        };
        let view = GeometryView::new(geometry, &start.with_context(no_start)?, settings);
        show_view(Box::new(view), folder)
    } else if set.views_with_depth().next().is_none() {
        show_photographs(set, folder)?
    } else {
        let bar = Bar::new();
        let cube = images::cube_from_set(&set, &bar)?;
        bar.finish();
        show_cube(cube, folder)
    };
    Ok(show_marks(source, marks))
}

/// An open source, or one that another thread is opening.
enum OpenedSource {
    Ready(Box<dyn FrameSource>),
    Pending(PendingSource),
}

/// Opens a source on another thread. If that is slow, returns a pending source, so that the window
/// appears first.
fn open_or_defer(name: &str, open: Opener) -> anyhow::Result<OpenedSource> {
    /// Time within which a source is opened before the window, and errors are printed.
    const TIMEOUT: Duration = Duration::from_millis(100);
    // Without a buffer, a result that arrives after the timeout is returned to the sender.
    let (soon_sender, soon) = mpsc::sync_channel(0);
    let (later_sender, later) = mpsc::sync_channel(1);
    let work = move || {
        if let Err(mpsc::SendError(opened)) = soon_sender.send(open()) {
            // Fails only if the window is closed.
            let _ = later_sender.send(opened.map_err(|error| format!("{error:#}")));
        }
    };
    std::thread::Builder::new()
        .name("open".into())
        .spawn(work)
        .context("cannot start a thread")?;
    match soon.recv_timeout(TIMEOUT) {
        Ok(opened) => Ok(OpenedSource::Ready(opened?)),
        Err(_) => Ok(OpenedSource::Pending(PendingSource {
            name: name.to_owned(),
            source: later,
        })),
    }
}

/// Folder of what the window keeps between runs, in the user's state folder; `None` if there is no
/// such folder.
fn state_folder() -> Option<PathBuf> {
    let folder = |key: &str| {
        std::env::var_os(key)
            .map(PathBuf::from)
            .filter(|path| path.is_absolute())
    };
    let state = if cfg!(windows) {
        folder("LOCALAPPDATA")
    } else {
        folder("XDG_STATE_HOME").or_else(|| Some(folder("HOME")?.join(".local/state")))
    };
    Some(state?.join("headbox"))
}

/// Opens the window on a file, and returns when the window is closed.
pub(super) fn show(file: &Path) -> anyhow::Result<()> {
    let folder = parent_folder(file);
    let source = open(&file.to_string_lossy())?;
    let library = Some(Box::new(SceneLibrary) as Box<dyn headbox_viewer::Library>);
    headbox_viewer::run(
        Some(source),
        ViewerOptions {
            library,
            output_dir: folder.into(),
            ..ViewerOptions::default()
        },
    )?;
    Ok(())
}

/// Opens the images of a set for live cube LDIs; returns the camera of its central view, too, or of
/// the first with depth.
fn near_images(folder: &Path, set: ImageSet) -> anyhow::Result<(NearestImages, Camera)> {
    images::views_with_depth(&set)?;
    let start = set
        .central_view()
        .and_then(View::camera)
        .or_else(|| set.views_with_depth().find_map(View::camera));
    let no_start = || {
        format!(
            "{}: it has no perspective picture to start at",
            folder.display()
        )
    };
    let start = start.with_context(no_start)?;
    let job = ImageSetCapture::suggest(&set);
    Ok((
        NearestImages::new(set, job, NearestImages::DEFAULT_BUDGET)?,
        start,
    ))
}
