//! `headbox view`.

use super::args::frame_of;
use crate::capture::scene::FileFrame;
use crate::packed::PackedCube;
use crate::splat::SplatKernel;
use crate::warp::{RenderSettings, Renderer};
use clap::Args;
use glam::DVec3;
use headbox_viewer::{EyeBounds, Figure, FrameReport, FrameRequest, FrameSource, Pose, Setting, Stage, ViewerOptions};
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(super) struct View {
    /// A .ldi file
    file: PathBuf,
    /// Save a picture of the window here, then close it
    #[arg(long, value_name = "OUT.png")]
    screenshot: Option<PathBuf>,
}

impl View {
    pub(super) fn run(&self) -> anyhow::Result<()> {
        show(&self.file, self.screenshot.clone())
    }
}

/// Opens the window on a file, and returns when it is closed.
pub(super) fn show(file: &Path, screenshot: Option<PathBuf>) -> anyhow::Result<()> {
    let source = CubeSource::new(PackedCube::read(file)?, file);
    let mut options = ViewerOptions::default();
    if screenshot.is_some() {
        options.exit = headbox_viewer::Exit::AfterFrames(3);
        options.screenshot = screenshot;
    }
    headbox_viewer::run(Some(Box::new(source)), options)?;
    Ok(())
}

/// A cube LDI, shown from anywhere inside its headbox.
struct CubeSource {
    cube: PackedCube,
    title: String,
    renderer: Renderer,
}

impl CubeSource {
    fn new(cube: PackedCube, file: &Path) -> Self {
        Self { cube, title: format!("{} (cube LDI)", file.display()), renderer: Renderer::new() }
    }
}

impl FrameSource for CubeSource {
    fn title(&self) -> String {
        self.title.clone()
    }

    fn start_pose(&self) -> Pose {
        let centre = self.cube.info.centre;
        Pose::looking_at(centre, centre + DVec3::NEG_Z, 60.0)
    }

    fn bounds(&self) -> Option<EyeBounds> {
        let info = &self.cube.info;
        Some(EyeBounds { centre: info.centre, half_size: DVec3::splat(info.half_size_m) })
    }

    fn file_frame(&self) -> FileFrame {
        frame_of(&self.cube.info)
    }

    fn settings(&self) -> Vec<Setting> {
        let names = SplatKernel::ALL.map(|(name, _)| name);
        vec![Setting::choice("kernel", "Footprints", "How samples become pixels (no unit)", &names)]
    }

    fn render(&mut self, request: &FrameRequest, pixels: &mut [[u8; 4]]) -> Result<FrameReport, String> {
        let choice = request.settings.choice("kernel").map_err(|error| error.to_string())?;
        let kernel = SplatKernel::ALL.get(choice).map_or(SplatKernel::default(), |&(_, kernel)| kernel);
        let settings = RenderSettings { kernel, ..RenderSettings::default() };
        let (frame, stats) = self.renderer.render(&self.cube, &request.camera, &settings);
        pixels.copy_from_slice(&frame.color);
        let figure = |name, value: u64| Figure { name, value: value as f64, unit: "" };
        Ok(FrameReport {
            stages: vec![
                Stage { name: "clear", ms: stats.clear_ms },
                Stage { name: "warp", ms: stats.warp_ms },
                Stage { name: "finish", ms: stats.finish_ms },
            ],
            figures: vec![
                figure("depth pixels in", stats.depth_pixels_in),
                figure("depth pixels splatted", stats.splatted),
                figure("hole pixels", stats.hole_pixels),
            ],
            converging: false,
        })
    }
}
