//! Headbox panel of a live capture: leave the headbox, capture another one where the eye is, show
//! an earlier one.

use crate::input::bounds::EyeBounds;
use crate::input::keymap::Command;
use crate::input::pose::Pose;
use crate::panels::overlay::inset::edges;
use crate::panels::{button, theme};
use crate::source::Headboxes;
use crate::thread::exchange::SourceInfo;
use egui::{Painter, Rect, Slider, Stroke, Ui, pos2};
use glam::DVec3;
use headbox_core::file_frame::{FileFrame, figure, triple};

/// Ratio of the largest and the smallest half-size of the slider to that of the shown headbox.
const SIZE_RATIO: f64 = 16.0;
/// Depth at which edges are clipped, relative to the box's half-size.
const NEAR_SHARE: f64 = 1e-3;

/// State of the panel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct HeadboxPanel {
    /// True if the eye may leave the headbox.
    pub leaves: bool,
    /// Half-size of the next headbox, metres.
    pub half_size_m: f64,
}

impl HeadboxPanel {
    pub(crate) fn new(info: &SourceInfo) -> Self {
        Self {
            leaves: false,
            half_size_m: info.bounds.map_or(0.0, |b| b.half_size.max_element()),
        }
    }

    /// Box in which the eye stays; `None` if it may go anywhere.
    pub(crate) fn bounds(&self, info: &SourceInfo) -> Option<EyeBounds> {
        info.bounds.filter(|_| !self.leaves)
    }
}

/// Shows the controls; lengths are in the unit of the scene's file.
pub(crate) fn show(
    ui: &mut Ui,
    panel: &mut HeadboxPanel,
    headboxes: &Headboxes,
    frame: &FileFrame,
    commands: &mut Vec<Command>,
) {
    let mut leaves = panel.leaves;
    let tip = "Lets the eye leave the headbox (F). Outside, the scene is shown without light.";
    if ui
        .checkbox(&mut leaves, "Leave the headbox")
        .on_hover_text(tip)
        .changed()
    {
        commands.push(Command::ToggleLeave);
    }
    if let Some(shown) = headboxes.bounds.get(headboxes.shown) {
        let usual = shown.half_size.max_element() / frame.unit_m;
        let mut half_size = panel.half_size_m / frame.unit_m;
        let unit = frame
            .unit_name()
            .map_or(String::new(), |unit| format!(" {unit}"));
        let slider = Slider::new(&mut half_size, usual / SIZE_RATIO..=usual * SIZE_RATIO)
            .logarithmic(true)
            .suffix(unit)
            .custom_formatter(|size, _| figure(size))
            .text("Half-size");
        let tip = "Half of the edge length of the next headbox, in the unit of the scene's file, as in --half-size.";
        if ui.add(slider).on_hover_text(tip).changed() {
            panel.half_size_m = half_size * frame.unit_m;
        }
    }
    let tip = "Captures a headbox of this size about the eye (Enter). The earlier ones keep what was captured.";
    button(ui, "Capture here", tip, Command::CaptureHere, commands);
    if headboxes.bounds.len() < 2 {
        return;
    }
    for (i, bounds) in headboxes.bounds.iter().enumerate() {
        let centre = triple(frame.file_from_world(bounds.centre));
        let half_size = figure(bounds.half_size.max_element() / frame.unit_m);
        let text = format!("{}: {centre} half-size {half_size}", i + 1);
        let label = ui
            .selectable_label(i == headboxes.shown, text)
            .on_hover_text(
                "Shows this headbox: its centre and half-size in the file's axes and unit.",
            );
        if label.clicked() {
            commands.push(Command::ShowHeadbox(i));
        }
    }
}

/// Paints the edges of the headboxes over the frame.
pub(crate) fn paint(painter: &Painter, rect: Rect, headboxes: &Headboxes, pose: &Pose) {
    let painter = painter.with_clip_rect(rect.intersect(painter.clip_rect()));
    let focal_points = f64::from(rect.height()) / 2.0 / (pose.fov_y_deg.to_radians() / 2.0).tan();
    let eye_from_world = pose.world_from_eye().transpose();
    for (i, bounds) in headboxes.bounds.iter().enumerate() {
        let color = if i == headboxes.shown {
            theme::ACCENT
        } else {
            theme::LINE
        };
        let near = bounds.half_size.max_element() * NEAR_SHARE;
        for (a, b) in edges() {
            let [a, b] = [a, b].map(|corner| {
                eye_from_world * (bounds.centre + bounds.half_size * corner - pose.eye)
            });
            let Some([a, b]) = clip(a, b, near) else {
                continue;
            };
            let [a, b] = [a, b].map(|p| {
                let points = p.truncate() * (focal_points / -p.z);
                pos2(
                    rect.center().x + points.x as f32,
                    rect.center().y - points.y as f32,
                )
            });
            painter.line_segment([a, b], Stroke::new(1.5, color));
        }
    }
}

/// Clips a segment in eye space (the eye looks along -Z) at a depth of `near`; `None` if it is
/// nearer everywhere.
fn clip(a: DVec3, b: DVec3, near: f64) -> Option<[DVec3; 2]> {
    let (depth_a, depth_b) = (-a.z, -b.z);
    if depth_a < near && depth_b < near {
        return None;
    }
    let at_near = || a.lerp(b, (near - depth_a) / (depth_b - depth_a));
    Some([
        if depth_a < near { at_near() } else { a },
        if depth_b < near { at_near() } else { b },
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    #[test]
    fn segments_are_clipped_at_the_eye() {
        let ahead = dvec3(1.0, 0.0, -3.0);
        let behind = dvec3(1.0, 0.0, 1.0);
        assert_eq!(clip(ahead, ahead, 0.5), Some([ahead, ahead]));
        assert_eq!(clip(behind, behind, 0.5), None);
        let cut = dvec3(1.0, 0.0, -0.5);
        assert_eq!(clip(behind, ahead, 0.5), Some([cut, ahead]));
        assert_eq!(clip(ahead, behind, 0.5), Some([ahead, cut]));
    }
}
