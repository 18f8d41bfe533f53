//! Renderer of a view with its settings, for `headbox render`.

use crate::messages::format_count;
use anyhow::anyhow;
use headbox_core::camera::Camera;
use headbox_core::file_frame::{figure, triple};
use headbox_core::frame::Frame;
use headbox_core::statistics::median;
use headbox_core::view::{
    FrameReport, FrameRequest, OVERLAY, Refinement, Rendered, Setting, SettingValues, View,
};
use image::RgbImage;
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Renderer of a view with its settings.
pub(super) struct ViewRenderer {
    pub(super) view: Box<dyn View>,
    settings: Vec<Setting>,
    values: Arc<SettingValues>,
    /// Index of the frame that is being rendered: several renderings may make one frame.
    pub(super) frame: usize,
    /// Warnings, with the frames that they concern.
    warnings: BTreeMap<String, BTreeSet<usize>>,
}

/// Planes of a frame requested with its colours.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Planes {
    None,
    Coverage,
    /// Coverage and eye depth.
    Depth,
}

/// One rendered pose.
pub(super) struct RenderedPose {
    pub(super) image: RgbImage,
    /// Times of the repetitions, ms.
    pub(super) ms: Vec<f64>,
    pub(super) report: FrameReport,
    /// Coverage and depth, if requested.
    pub(super) planes: Option<Frame>,
}

impl RenderedPose {
    pub(super) fn ms_median(&self) -> f64 {
        median(self.ms.iter().copied()).unwrap_or(f64::NAN)
    }

    pub(super) fn hole_fraction(&self) -> f64 {
        let pixels = f64::from(self.image.width()) * f64::from(self.image.height());
        self.report.hole_pixels as f64 / pixels
    }

    /// Value of a figure of the report.
    pub(super) fn figure(&self, name: &str) -> Option<f64> {
        let mut figures = self.report.figures.iter();
        Some(figures.find(|figure| figure.name == name)?.value)
    }

    /// Times of the stages, by name.
    pub(super) fn stages(&self) -> Value {
        let stages = self.report.stages.iter();
        let stages = stages.map(|stage| (format!("{}_ms", stage.name), json!(stage.ms)));
        Value::Object(stages.collect())
    }

    /// Adds the legend of an overlay and its figures to a JSON object.
    pub(super) fn add_overlay(&self, json: &mut Value) {
        let legend = self.report.legend.iter();
        let legend = legend.map(|line| json!({"color": hex(line.color), "label": line.label}));
        json["legend"] = legend.collect();
        let figures = self.report.figures.iter();
        let figures = figures.map(|figure| (figure.name.to_owned(), json!(figure.value)));
        json["figures"] = Value::Object(figures.collect::<Map<_, _>>());
    }
}

/// Formats a colour as in HTML.
pub(super) fn hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Formats numbers, the successive ones as ranges: `3, 5 to 9`.
fn format_ranges(numbers: &BTreeSet<usize>) -> String {
    let mut ranges: Vec<[usize; 2]> = Vec::new();
    for &number in numbers {
        match ranges.last_mut() {
            Some([_, end]) if *end + 1 == number => *end = number,
            _ => ranges.push([number; 2]),
        }
    }
    let texts: Vec<String> = ranges
        .into_iter()
        .map(|[start, end]| {
            if start == end {
                start.to_string()
            } else {
                format!("{start} to {end}")
            }
        })
        .collect();
    texts.join(", ")
}

impl ViewRenderer {
    pub(super) fn new(view: Box<dyn View>, values: SettingValues) -> Self {
        Self {
            settings: view.settings(),
            view,
            values: Arc::new(values),
            frame: 0,
            warnings: BTreeMap::new(),
        }
    }

    /// Value of the setting with a flag, as text; "" if there is none.
    fn value(&self, flag: &str) -> String {
        let mut settings = self.settings.iter();
        let setting = settings.find(|setting| setting.flag == Some(flag));
        let text = setting.and_then(|setting| self.values.text(setting));
        text.unwrap_or_default()
    }

    /// Name of the variant.
    pub(super) fn variant(&self) -> String {
        self.value("variant")
    }

    /// Name of the overlay.
    pub(super) fn overlay(&self) -> String {
        self.value(OVERLAY)
    }

    /// Renders a pose `repeat` times, each time until its refinement is done.
    ///
    /// # Errors
    /// The view's own errors, and a usage error if the view has no depth but depth is requested.
    pub(super) fn render(
        &mut self,
        camera: &Camera,
        repeat: u32,
        planes: Planes,
    ) -> anyhow::Result<RenderedPose> {
        let request = FrameRequest {
            depth: planes == Planes::Depth,
            ..FrameRequest::complete(*camera, Arc::clone(&self.values))
        };
        let mut ms = Vec::with_capacity(repeat as usize);
        loop {
            let Rendered { frame, report } =
                self.view.render(&request).map_err(|error| anyhow!(error))?;
            match report.refinement {
                Refinement::Done => ms.push(report.ms),
                Refinement::Next => continue,
                Refinement::Later(pause) => {
                    std::thread::sleep(pause);
                    continue;
                }
            }
            if ms.len() < repeat as usize {
                continue;
            }
            if request.depth && frame.depth_m.is_empty() {
                bail_usage!("--depth does not apply to this view ({})", self.view.kind());
            }
            for warning in &report.warnings {
                let frames = self.warnings.entry(warning.clone()).or_default();
                frames.insert(self.frame);
            }
            return Ok(RenderedPose {
                image: frame.to_rgb()?,
                ms,
                report,
                planes: (planes != Planes::None).then(|| frame.clone()),
            });
        }
    }

    /// Prints the warnings about all frames so far; of several frames with the numbers of those
    /// that they concern, which count from 0 as in the names of files.
    pub(super) fn print_warnings(&self) {
        for (warning, frames) in &self.warnings {
            if self.frame == 0 {
                eprintln!("warning: {warning}");
            } else {
                let (numbers, last) = (format_ranges(frames), self.frame);
                eprintln!("warning: {warning} (frames {numbers} of 0 to {last})");
            }
        }
    }

    /// Statistics of the last frame.
    pub(super) fn statistics(&mut self, camera: &Camera) -> Value {
        let request = FrameRequest::complete(*camera, Arc::clone(&self.values));
        self.view.statistics(&request)
    }

    /// Warns of eyes outside the headbox, whose views the capture does not cover.
    pub(super) fn warn_if_outside(&self, cameras: &[Camera]) {
        let Some(headbox) = self.view.headbox() else {
            return;
        };
        let outside = |camera: &&Camera| {
            let offset = (camera.eye() - headbox.centre).abs().max_element();
            offset > headbox.half_size_m * (1.0 + 1e-9)
        };
        let count = cameras.iter().filter(outside).count();
        if count == 0 {
            return;
        }
        let which = if cameras.len() == 1 {
            "the eye is".into()
        } else {
            format!("{count} of {} eyes are", cameras.len())
        };
        let frame = self.view.file_frame();
        eprintln!(
            "warning: {which} outside the headbox ({} and {} to each side along the axes, in the file's axes and unit). What \
             is seen from there only is missing: expect holes, and surfaces where they are not",
            triple(frame.file_from_world(headbox.centre)),
            figure(headbox.half_size_m / frame.unit_m)
        );
    }

    /// Warns if most of a frame shows nothing, though its eye is not outside a headbox: sprites
    /// have no bounds.
    pub(super) fn warn_if_empty(&self, camera: &Camera, rendered: &RenderedPose) {
        /// Share of a frame without content that no capture is meant to be seen with.
        const MOSTLY_EMPTY: f64 = 0.5;
        let holes = rendered.hole_fraction();
        if holes <= MOSTLY_EMPTY || self.view.headbox().is_some() {
            return;
        }
        let start = self.view.start([camera.width(), camera.height()]);
        let frame = self.view.file_frame();
        let in_file = |point| triple(frame.file_from_world(point));
        eprintln!(
            "warning: {:.0} % of this frame shows nothing. The default view, from about which the input is to be seen, \
             is --eye {} --look-at {}",
            holes * 100.0,
            in_file(start.eye),
            in_file(start.eye + start.forward)
        );
    }

    /// Short description of the representation and its variant.
    pub(super) fn summary(&self) -> String {
        let (count, what) = self.view.primitives();
        let counted = format_count(count, what.trim_end_matches('s'));
        let (kind, variant) = (self.view.kind(), self.variant());
        if kind == what {
            format!("{counted}, {variant}")
        } else {
            format!("{kind} of {counted}, {variant}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn successive_numbers_become_ranges() {
        let format = |numbers: &[usize]| format_ranges(&numbers.iter().copied().collect());
        assert_eq!(format(&[0]), "0");
        assert_eq!(format(&[3, 5, 6, 7, 11, 12]), "3, 5 to 7, 11 to 12");
    }
}
