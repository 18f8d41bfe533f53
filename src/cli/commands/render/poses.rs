//! `headbox render --path`: a film, or one picture per pose.

use super::RenderCommand;
use crate::args::refuse_given;
use crate::commands::render::FIGURES;
use crate::commands::render::view_renderer::{Planes, ViewRenderer};
use crate::output::{print_json, save_picture, write_text};
use crate::progress::Bar;
use anyhow::{Context, bail};
use headbox_core::camera::Camera;
use headbox_core::file_frame::FileFrame;
use headbox_core::progress::Progress;
use headbox_core::simd;
use headbox_core::statistics::median;
use headbox_core::view::View;
use headbox_export::film;
use headbox_export::film::stereo::View as Projection;
use headbox_scene::camera_path;
use serde_json::json;
use std::path::Path;
use std::time::Instant;

impl RenderCommand {
    /// Frame rate of a film: as requested, else by the times of the path's poses.
    pub(super) fn film_fps(&self, path: &Path, frame: &FileFrame) -> anyhow::Result<u32> {
        let poses = camera_path::read_records(path, frame, f64::from(self.fps()))?;
        let ends = poses.first().zip(poses.last());
        let seconds = ends
            .and_then(|(first, last)| Some(last.time_s? - first.time_s?))
            .filter(|seconds| *seconds > 0.0);
        let from_times = seconds.map(|seconds| {
            ((poses.len() - 1) as f64 / seconds)
                .round()
                .clamp(1.0, 240.0) as u32
        });
        Ok(self.fps.or(from_times).unwrap_or_else(|| self.fps()))
    }

    /// Cameras of a film without `--path`: about the eye of `first` in the headbox, or through all
    /// rooms of a house.
    pub(super) fn film_path(&self, view: &dyn View, first: &Camera) -> anyhow::Result<Vec<Camera>> {
        let places = self.camera.given_flags().into_iter().take(3);
        if view.plan().is_some() {
            refuse_given("a film of a house, which walks through its rooms", places)?;
        }
        if let Some(cameras) = view.film_path(first, self.fps()) {
            return Ok(cameras);
        }
        if view.headbox().is_some() {
            bail_usage!(
                "the eye is not inside the headbox, so that it cannot move about in it; leave out --eye or give --path"
            );
        }
        bail_usage!("a film of this input needs a camera path: give --path");
    }

    pub(super) fn render_film(
        &self,
        renderer: &mut ViewRenderer,
        cameras: &[Camera],
        fps: u32,
    ) -> anyhow::Result<()> {
        let started = Instant::now();
        let Some(first) = cameras.first() else {
            bail!("the path has no poses")
        };
        let size = self.projection().size_px([first.width(), first.height()]);
        let bar = Bar::new();
        bar.begin("frames", "frames", cameras.len() as u64);
        let mut frames = cameras.iter().enumerate().map(|(pose, camera)| {
            renderer.frame = pose;
            let picture = self
                .picture(renderer, camera)
                .map_err(std::io::Error::other);
            bar.advance(1);
            picture
        });
        film::write(
            &self.output,
            size,
            fps,
            cameras.len() as u32,
            self.projection(),
            &mut frames,
        )
        .with_context(|| format!("{} could not be written", self.output.display()))?;
        bar.finish();
        let (count, seconds) = (cameras.len(), started.elapsed().as_secs_f64());
        if self.json {
            print_json(&json!({"frames": count, "fps": fps, "size": size, "seconds": seconds}));
        } else {
            let [width, height] = size;
            println!(
                "{}: {count} frames of {width}x{height} at {fps} a second, in {seconds:.1} s",
                self.output.display()
            );
        }
        Ok(())
    }

    pub(super) fn render_path(
        &self,
        renderer: &mut ViewRenderer,
        cameras: &[Camera],
    ) -> anyhow::Result<()> {
        if self.projection() != Projection::Frame {
            return self.render_views(renderer, cameras);
        }
        let folder = &self.output;
        let mut csv = String::from("pose,ms,depth_pixels_in,splatted,hole_pixels\n");
        let mut times = Vec::with_capacity(cameras.len());
        for (pose, camera) in cameras.iter().enumerate() {
            renderer.frame = pose;
            let rendered = renderer.render(camera, self.repeat, Planes::None)?;
            save_picture(
                &folder.join(format!("frame_{pose:04}.png")),
                &rendered.image,
            )?;
            let ms = rendered.ms_median();
            let [depth_pixels_in, splatted] =
                FIGURES.map(|(_, name)| rendered.figure(name).unwrap_or(0.0));
            let hole_pixels = rendered.report.hole_pixels;
            csv += &format!("{pose},{ms:.4},{depth_pixels_in},{splatted},{hole_pixels}\n");
            times.push(ms);
        }
        write_text(&folder.join("times.csv"), &csv)?;
        let median = median(times.iter().copied()).unwrap_or(f64::NAN);
        let worst = times.iter().copied().fold(f64::NAN, f64::max);
        if self.json {
            print_json(&json!({
                "ms_median": median, "ms": times, "frames": times.len(), "variant": renderer.variant(),
                "threads": rayon::current_num_threads(), "simd": simd::name(simd::level()),
            }));
        } else {
            println!(
                "{}: {} frames, median {median:.2} ms, worst {worst:.2} ms",
                folder.display(),
                times.len()
            );
        }
        Ok(())
    }

    /// Renders a panorama or a stereo picture for each pose.
    fn render_views(&self, renderer: &mut ViewRenderer, cameras: &[Camera]) -> anyhow::Result<()> {
        let started = Instant::now();
        for (pose, camera) in cameras.iter().enumerate() {
            renderer.frame = pose;
            save_picture(
                &self.output.join(format!("frame_{pose:04}.png")),
                &self.picture(renderer, camera)?,
            )?;
        }
        let (frames, seconds) = (cameras.len(), started.elapsed().as_secs_f64());
        if self.json {
            print_json(
                &json!({"frames": frames, "variant": renderer.variant(), "seconds": seconds}),
            );
        } else {
            println!(
                "{}: {frames} frames in {seconds:.1} s",
                self.output.display()
            );
        }
        Ok(())
    }
}
