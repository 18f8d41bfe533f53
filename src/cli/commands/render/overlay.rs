//! `headbox render --overlay`: what a frame is made of, painted as the window paints it.

use super::RenderCommand;
use crate::args::DefaultCamera;
use crate::commands::images::is_image_set;
use crate::commands::render::geometry::texturing_of;
use crate::commands::view::ToShow;
use crate::output::{print_json, save_picture};
use crate::words::UsageError;
use anyhow::{anyhow, bail};
use headbox_core::camera::Camera;
use headbox_core::container::Container;
use headbox_cube::pack::CubeLdi;
use headbox_ldi::scene_source::SceneSource;
use headbox_viewer::{FrameReport, FrameRequest, FrameSource, Refinement, SettingValues};
use image::RgbImage;
use serde_json::json;
use std::path::Path;
use std::sync::Arc;

impl RenderCommand {
    /// Draws one frame with an overlay of the window's, by whatever shows the file there, and says
    /// what its colours mean.
    pub(super) fn render_overlay(&self, overlay: &str) -> anyhow::Result<()> {
        let [file] = self.files.as_slice() else {
            return Err(UsageError("--overlay is for one file or folder".into()).into());
        };
        let name = file.to_string_lossy();
        let is_set = is_image_set(&name);
        if !is_set && Container::peek_kind(file).ok().flatten().is_none() {
            // What is no file of ours the reader of cubes names best.
            CubeLdi::read(file)?;
        }
        let texturing = texturing_of(self.variant.as_deref(), is_set)?;
        if texturing.is_none() && (self.variant.is_some() || self.geometry.are_given()) {
            let message = "--overlay takes --variant geometry-blended and its kin alone, of a folder of images with depth, and what is for them";
            return Err(UsageError(message.into()).into());
        }
        let source = SceneSource {
            name: name.into_owned(),
            options: <_>::default(),
            light: <_>::default(),
        };
        let mut shown = ToShow {
            source,
            is_set,
            live: false,
            set: self.images,
            texturing,
            geometry: self.geometry.clone(),
        }
        .open(Path::new("."))?;
        let start = shown.start_pose().camera(1024, 768)?;
        let camera = self
            .camera
            .camera(&shown.file_frame(), &DefaultCamera::like(&start))?;
        let (picture, report) = painted(&mut *shown, &camera, overlay)?;
        save_picture(&self.output, &picture)?;
        let hex = |[r, g, b]: [u8; 3]| format!("#{r:02x}{g:02x}{b:02x}");
        if self.json {
            let legend = report
                .legend
                .iter()
                .map(|swatch| json!({"color": hex(swatch.color), "label": swatch.label}));
            let figures = report
                .figures
                .iter()
                .map(|figure| (figure.name.to_owned(), json!(figure.value)));
            print_json(&json!({
                "overlay": overlay, "size": [camera.width(), camera.height()], "legend": legend.collect::<Vec<_>>(),
                "figures": figures.collect::<serde_json::Map<_, _>>(),
            }));
        } else {
            println!(
                "{}: {}x{}, overlay {overlay}",
                self.output.display(),
                camera.width(),
                camera.height()
            );
            report
                .legend
                .iter()
                .for_each(|swatch| println!("  {}  {}", hex(swatch.color), swatch.label));
        }
        Ok(())
    }
}

/// A frame with an overlay, as good as it gets.
fn painted(
    source: &mut dyn FrameSource,
    camera: &Camera,
    overlay: &str,
) -> anyhow::Result<(RgbImage, FrameReport)> {
    let settings = source.settings();
    let mut values = SettingValues::initial(&settings);
    values
        .set_text(&settings, "overlay", overlay)
        .map_err(|error| UsageError(error.to_string()))?;
    let request = FrameRequest {
        camera: *camera,
        settings: Arc::new(values),
        moving: false,
    };
    let mut pixels = vec![[0; 4]; camera.width() as usize * camera.height() as usize];
    loop {
        let report = source
            .render(&request, &mut pixels)
            .map_err(|error| anyhow!(error))?;
        match report.refinement {
            Refinement::Done => {
                let bytes = pixels.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
                let picture = RgbImage::from_raw(camera.width(), camera.height(), bytes);
                let Some(picture) = picture else {
                    bail!("the frame has no pixels")
                };
                return Ok((picture, report));
            }
            Refinement::Next => {}
            Refinement::Later(pause) => std::thread::sleep(pause),
        }
    }
}
