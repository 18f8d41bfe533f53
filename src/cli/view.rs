//! `headbox view`.

use super::UsageError;
use super::args::{FrameArgs, Names, by_name, parse_size};
use super::geometry::{GEOMETRY_ALONE, GeometryArgs, open_geometry, texturing_of};
use super::images::{self, SetArgs, is_image_set};
use super::output::print_json;
use super::progress::Bar;
use crate::view::{SceneLibrary, open, open_source, show_cube, show_geometry};
use crate::view_geometry::GeometrySettings;
use anyhow::Context;
use clap::Args;
use headbox_viewer::{Exit, FrameSource, ReplayMode, Stereo, ViewerOptions};
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Args)]
pub(super) struct View {
    /// A .ldi, .sprite, .lumi or .house file, a folder of images with depth, or a scene (.obj, .gltf, .glb, builtin:NAME) to capture while looking around; the
    /// start page if absent
    file: Option<String>,
    /// Of a folder of images: draw it by view-dependent geometry, such as geometry-averaged, instead of a cube LDI
    #[arg(long, value_name = "NAME")]
    variant: Option<String>,
    #[command(flatten)]
    geometry: GeometryArgs,
    #[command(flatten)]
    frame: FrameArgs,
    /// Replay this path or camera file
    #[arg(long, value_name = "PATH.json")]
    path: Option<PathBuf>,
    /// Replay every pose once, however long its frame takes, instead of by the path's times
    #[arg(long, requires = "path")]
    every_pose: bool,
    /// Close the window when the path has ended
    #[arg(long, requires = "path")]
    exit_after_path: bool,
    /// Close the window after so many frames
    #[arg(long, value_name = "N", conflicts_with = "exit_after_path")]
    frames: Option<u64>,
    /// Close the window when the view cannot become better: a capture or an error map is complete
    #[arg(long, conflicts_with_all = ["exit_after_path", "frames"])]
    when_refined: bool,
    /// Save a picture of the window here, then close it
    #[arg(long, value_name = "OUT.png")]
    screenshot: Option<PathBuf>,
    /// Size of the window, points
    #[arg(long, value_name = "WxH", default_value = "1280x800", value_parser = parse_size)]
    window_size: (u32, u32),
    /// Set a control of the panel, such as kernel=paper or overlay=error
    #[arg(long, value_name = "ID=VALUE", value_parser = parse_pair)]
    set: Vec<(String, String)>,
    /// Compare with this other value of a control, left and right of a divider
    #[arg(long, value_name = "ID=VALUE", value_parser = parse_pair)]
    compare: Vec<(String, String)>,
    /// Two eyes side by side
    #[arg(long, value_parser = by_name(STEREO))]
    stereo: Option<Stereo>,
    /// Render fewer pixels while the eye moves, if a frame would take longer than so many milliseconds; 0 for all pixels always
    #[arg(long, value_name = "MS", default_value_t = ViewerOptions::MOVING_LIMIT_MS, value_parser = parse_limit)]
    moving_limit: f64,
    /// Show the frame alone
    #[arg(long)]
    no_panels: bool,
    /// Folder for saved frames, cameras, paths and captures
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
    /// Print what was measured as one JSON object on standard output, once the window is closed
    #[arg(long)]
    json: bool,
}

/// How two eyes stand beside each other.
const STEREO: Names<Stereo> = &[
    ("cross", "The right eye's view on the left", Stereo::CrossEyed),
    ("parallel", "The left eye's view on the left", Stereo::Parallel),
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

/// Frames after which a picture without a path is taken: the first may be of a window that still takes its size.
const FRAMES_BEFORE_PICTURE: u64 = 3;

impl View {
    pub(super) fn run(&self) -> anyhow::Result<()> {
        let options = self.options()?;
        let source = self.file.as_deref().map(|file| self.source(file)).transpose()?;
        let summary = headbox_viewer::run(source, options)?;
        if self.json {
            print_json(&serde_json::to_value(summary)?);
        }
        Ok(())
    }

    fn source(&self, file: &str) -> anyhow::Result<Box<dyn FrameSource>> {
        let is_set = is_image_set(file);
        if let Some(texturing) = texturing_of(self.variant.as_deref(), is_set)? {
            let (geometry, start) = open_geometry(Path::new(file), &self.geometry)?;
            let start =
                start.with_context(|| format!("{file}: its middle view is no perspective picture to start at"))?;
            let settings = GeometrySettings { texturing, ..self.geometry.settings() };
            return Ok(show_geometry(geometry, Path::new(file), &start, settings));
        }
        if self.variant.is_some() || self.geometry.are_given() {
            return Err(UsageError(GEOMETRY_ALONE.into()).into());
        }
        if !is_set {
            return Ok(open_source(self.frame.source(file), &self.out)?);
        }
        let bar = Bar::new();
        let cube = images::cube(Path::new(file), &SetArgs::default(), &bar)?;
        bar.finish();
        Ok(show_cube(cube, Path::new(file)))
    }

    fn options(&self) -> Result<ViewerOptions, UsageError> {
        if self.file.is_none() && (self.path.is_some() || self.frames.is_some() || self.when_refined) {
            return Err(UsageError("--path, --frames and --when-refined need a file to show".into()));
        }
        let (width, height) = self.window_size;
        let with_path = self.path.is_some();
        let exit = match (self.exit_after_path, self.frames, &self.screenshot) {
            (true, ..) => Exit::AfterPath,
            (_, Some(frames), _) => Exit::AfterFrames(frames),
            _ if self.when_refined => Exit::WhenRefined,
            (.., Some(_)) if with_path => Exit::AfterPath,
            (.., Some(_)) if self.file.is_some() => Exit::AfterFrames(FRAMES_BEFORE_PICTURE),
            (.., Some(_)) => Exit::AfterThumbnails,
            _ => Exit::Never,
        };
        Ok(ViewerOptions {
            started: Instant::now(),
            library: Some(Box::new(SceneLibrary { output_dir: self.out.clone() })),
            window_size_points: [width as f32, height as f32],
            panels: !self.no_panels,
            settings: self.set.clone(),
            compare: (!self.compare.is_empty()).then(|| self.compare.clone()),
            stereo: self.stereo.unwrap_or_default(),
            moving_limit_ms: (self.moving_limit > 0.0).then_some(self.moving_limit),
            path: self.path.clone(),
            replay: if self.every_pose { ReplayMode::EveryPose } else { ReplayMode::InTime },
            output_dir: self.out.clone(),
            screenshot: self.screenshot.clone(),
            exit,
            ..ViewerOptions::default()
        })
    }
}

/// Opens the window on a file, and returns when it is closed.
pub(super) fn show(file: &Path) -> anyhow::Result<()> {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let source = open(&file.to_string_lossy(), folder)?;
    let library = Some(Box::new(SceneLibrary { output_dir: folder.into() }) as Box<dyn headbox_viewer::Library>);
    headbox_viewer::run(
        Some(source),
        ViewerOptions { library, output_dir: folder.into(), ..ViewerOptions::default() },
    )?;
    Ok(())
}
