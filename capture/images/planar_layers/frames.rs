//! Selected frames of a sequence: images, depth and relative exposure.

use super::{LayerJob, LayersError, no_view};
use crate::dense_depth::DenseDepth;
use crate::{ImageSet, LoadedView, View, backdrop};
use glam::DVec3;
use headbox_core::statistics::median;
use rayon::prelude::*;

/// A selected frame.
pub(super) struct Frame {
    /// Undistorted view with eye depth, metres, NaN where unknown.
    pub(super) view: LoadedView,
    /// Factors that equalise the levels with the middle frame.
    pub(super) gain: [f32; 3],
}

/// Selected frames of a sequence, with their depth.
pub struct Frames {
    /// Frames, the middle one first.
    pub(super) frames: Vec<Frame>,
    pub(super) names: Vec<String>,
    /// Median distance of the other eyes from the middle one, metres.
    pub(super) baseline_m: f64,
    /// Standard deviation of inverse depth, 1/m; 0 if unknown.
    pub(super) deviation: f32,
}

/// Usable levels for exposure: darker ones are coarsely rounded, brighter ones clipped.
const EXPOSED: std::ops::RangeInclusive<f64> = 16.0..=240.0;

/// Maximum relative difference of the depths of one point in two frames.
const SAME_POINT: f64 = 0.03;

/// Minimum number of points for an exposure estimate.
const MIN_POINTS: usize = 60;

impl Frames {
    /// Chooses frames, reads them, and estimates their depth.
    pub(super) fn load(
        job: &LayerJob,
        set: &ImageSet,
        advance: &dyn Fn(u64),
    ) -> Result<Self, LayersError> {
        let usable =
            |view: &&View| view.pinhole().is_some() && (!job.own_depth || view.depth.is_some());
        let Some(middle) = set.views.get(job.view).filter(usable) else {
            return Err(no_view(set, &(job.view + 1).to_string()));
        };
        let perspective: Vec<&View> = set.views.iter().filter(usable).collect();
        let own = perspective
            .iter()
            .position(|view| std::ptr::eq(*view, middle))
            .unwrap_or(0);
        let near = DenseDepth::default().select_neighbors(&perspective, own, job.others)?;
        if near.is_empty() {
            return Err(LayersError::NoParallax {
                folder: set.folder.clone(),
                name: middle.name.clone(),
            });
        }
        let views: Vec<&View> = std::iter::once(own)
            .chain(near)
            .map(|i| perspective[i])
            .collect();
        let (mut loaded, deviation) = Self::load_depth(job, &views, advance)?;
        mask_backdrop(&mut loaded);
        let distances = views[1..]
            .iter()
            .map(|view| view.color_pose().eye.distance(middle.color_pose().eye));
        let baseline_m = median(distances).unwrap_or(0.0);
        let gains: Vec<[f32; 3]> = loaded
            .par_iter()
            .map(|view| estimate_gain(&loaded[0], view))
            .collect();
        let frames = loaded
            .into_iter()
            .zip(gains)
            .map(|(view, gain)| Frame { view, gain })
            .collect();
        Ok(Self {
            frames,
            names: views.iter().map(|view| view.name.clone()).collect(),
            baseline_m,
            deviation,
        })
    }

    /// Loads depth if all views have usable depth; otherwise estimates it from the images.
    fn load_depth(
        job: &LayerJob,
        views: &[&View],
        advance: &dyn Fn(u64),
    ) -> Result<(Vec<LoadedView>, f32), LayersError> {
        let is_usable =
            |view: &&View| view.depth.is_some() && (job.own_depth || !view.has_own_depth());
        if views.iter().all(is_usable) {
            let loaded: Result<Vec<LoadedView>, _> =
                views.par_iter().map(|view| view.load()).collect();
            let deviation = views
                .first()
                .and_then(|view| view.depth.as_ref()?.estimated_deviation)
                .unwrap_or(0.0);
            return Ok((loaded?, deviation));
        }
        let estimates = DenseDepth::default().find(views, advance)?;
        let deviation = estimates.first().map_or(0.0, |estimate| estimate.deviation);
        Ok((
            estimates
                .into_iter()
                .map(|estimate| estimate.view)
                .collect(),
            deviation,
        ))
    }

    /// Returns the middle frame.
    pub(super) fn middle(&self) -> &Frame {
        &self.frames[0]
    }

    pub(super) fn middle_name(&self) -> &str {
        &self.names[0]
    }

    /// Returns the other frames.
    pub(super) fn others(&self) -> &[Frame] {
        &self.frames[1..]
    }
}

impl Frame {
    /// Projects a point of the world: position, pixels, and eye depth, metres; `None` outside.
    pub(super) fn project(&self, point: DVec3) -> Option<[f64; 3]> {
        project(&self.view, point)
    }

    /// Samples the colour at a position with the exposure of the middle frame; `None` outside.
    pub(super) fn color_at(&self, x: f64, y: f64) -> Option<[f32; 3]> {
        let color = self.view.color_at([x, y])?;
        Some([0, 1, 2].map(|c| color[c] as f32 * self.gain[c]))
    }
}

fn project(view: &LoadedView, point: DVec3) -> Option<[f64; 3]> {
    let [x, y, depth] = view.lens.project(view.pose.to_eye(point), view.size_px)?;
    let [width, height] = view.size_px.map(f64::from);
    (x >= 0.0 && y >= 0.0 && x < width && y < height).then_some([x, y, depth])
}

/// Masks out a dark backdrop, which belongs to no layer.
fn mask_backdrop(views: &mut [LoadedView]) {
    let dark = backdrop::find_threshold(views);
    for view in views {
        let background = backdrop::background_mask(view, dark);
        for (pixel, is_background) in view.color.iter_mut().zip(background) {
            pixel[3] = if is_background { 0 } else { pixel[3] };
        }
    }
}

/// Estimates the factors that equalise a view's levels with the middle one: the median ratio of the
/// levels of common points, per channel.
fn estimate_gain(middle: &LoadedView, view: &LoadedView) -> [f32; 3] {
    /// Distance of sampled pixels, in rows and columns.
    const STEP: usize = 4;
    let [width, height] = middle.size_px;
    let mut ratios = [const { Vec::new() }; 3];
    for y in (0..height).step_by(STEP) {
        for x in (0..width).step_by(STEP) {
            let point = middle.point_at(x, y);
            let Some([px, py, depth]) = point.and_then(|point| project(view, point)) else {
                continue;
            };
            let actual = view.depth_at(px as u32, py as u32).map(f64::from);
            if actual.is_none_or(|actual| (actual / depth - 1.0).abs() > SAME_POINT) {
                continue;
            }
            let own = middle.color[(y * width + x) as usize];
            let Some(other) = view.color_at([px, py]) else {
                continue;
            };
            for c in 0..3 {
                let pair = [f64::from(own[c]), other[c]];
                if pair.iter().all(|level| EXPOSED.contains(level)) {
                    ratios[c].push(pair[0] / pair[1]);
                }
            }
        }
    }
    if ratios.iter().any(|channel| channel.len() < MIN_POINTS) {
        return [1.0; 3];
    }
    ratios.map(|channel| median(channel).unwrap_or(1.0) as f32)
}
