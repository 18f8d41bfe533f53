//! The frames of a sequence that are used: pictures, depth, and how each was exposed.

use super::{LayerJob, LayersError, no_view};
use crate::dense_depth::DenseDepth;
use crate::{ImageSet, LoadedView, View, backdrop};
use glam::DVec3;
use headbox_core::statistics::median;
use rayon::prelude::*;

/// A frame.
pub(super) struct Frame {
    /// Its lens ideal, its depth what is known of it: eye depth, metres, NaN where unknown.
    pub(super) view: LoadedView,
    /// What its levels are multiplied by to be exposed as the middle one.
    pub(super) gain: [f32; 3],
}

/// The frames of a sequence that layers are made of, with their depth.
pub struct Frames {
    /// The middle one first.
    pub(super) frames: Vec<Frame>,
    pub(super) names: Vec<String>,
    /// Metres between the middle one's eye and the others', the median.
    pub(super) baseline_m: f64,
    /// Standard deviation of inverse depth, 1/m; 0 if not known.
    pub(super) deviation: f32,
}

/// Levels outside tell little of exposure: dark ones are rounded, bright ones clipped.
const EXPOSED: std::ops::RangeInclusive<f64> = 16.0..=240.0;

/// Inverse depths of one point in two frames differ by no more than this share.
const SAME_POINT: f64 = 0.03;

/// Fewest points that exposure is told from.
const LEAST_POINTS: usize = 60;

impl Frames {
    /// Chooses frames, reads them, and finds their depth.
    pub(super) fn load(
        job: &LayerJob,
        set: &ImageSet,
        advance: &dyn Fn(),
    ) -> Result<Self, LayersError> {
        let middle = set
            .views
            .get(job.view)
            .filter(|view| view.pinhole().is_some() && (!job.own_depth || view.depth.is_some()));
        let Some(middle) = middle else {
            return Err(no_view(set, &(job.view + 1).to_string()));
        };
        let usable =
            |view: &&View| view.pinhole().is_some() && (!job.own_depth || view.depth.is_some());
        let perspective: Vec<&View> = set.views.iter().filter(usable).collect();
        let own = perspective
            .iter()
            .position(|view| std::ptr::eq(*view, middle))
            .unwrap_or(0);
        let near = DenseDepth::default().partners(&perspective, own, job.others)?;
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
        let (mut loaded, deviation) = Self::with_depth(job, &views, advance)?;
        forget_backdrop(&mut loaded);
        let apart = views[1..]
            .iter()
            .map(|view| view.color_pose().eye.distance(middle.color_pose().eye));
        let baseline_m = median(apart).unwrap_or(0.0);
        let gains: Vec<[f32; 3]> = loaded
            .par_iter()
            .map(|view| gain(&loaded[0], view))
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

    /// Depth from files, if all of it is to be used; else it is found from the pictures.
    fn with_depth(
        job: &LayerJob,
        views: &[&View],
        advance: &dyn Fn(),
    ) -> Result<(Vec<LoadedView>, f32), LayersError> {
        let is_at_hand =
            |view: &&View| view.depth.is_some() && (job.own_depth || !view.has_own_depth());
        if views.iter().all(is_at_hand) {
            let loaded: Result<Vec<LoadedView>, _> =
                views.par_iter().map(|view| view.load()).collect();
            let deviation = views
                .first()
                .and_then(|view| view.depth.as_ref()?.estimated_deviation)
                .unwrap_or(0.0);
            return Ok((loaded?, deviation));
        }
        let found = DenseDepth::default().find(views, advance)?;
        let deviation = found.first().map_or(0.0, |found| found.deviation);
        Ok((
            found.into_iter().map(|found| found.view).collect(),
            deviation,
        ))
    }

    /// The frame whose layers are made.
    pub(super) fn middle(&self) -> &Frame {
        &self.frames[0]
    }

    pub(super) fn middle_name(&self) -> &str {
        &self.names[0]
    }

    /// The other frames.
    pub(super) fn others(&self) -> &[Frame] {
        &self.frames[1..]
    }
}

impl Frame {
    /// Where it sees a point of the world: position, pixels, and eye depth, metres.
    pub(super) fn place(&self, point: DVec3) -> Option<[f64; 3]> {
        place(&self.view, point)
    }

    /// Its colour at a position as the middle frame would have it; `None` outside.
    pub(super) fn color_at(&self, x: f64, y: f64) -> Option<[f32; 3]> {
        let color = self.view.color_at([x, y])?;
        Some([0, 1, 2].map(|c| color[c] as f32 * self.gain[c]))
    }
}

fn place(view: &LoadedView, point: DVec3) -> Option<[f64; 3]> {
    let [x, y, depth] = view.lens.project(view.pose.to_eye(point), view.size_px)?;
    let [width, height] = view.size_px.map(f64::from);
    (x >= 0.0 && y >= 0.0 && x < width && y < height).then_some([x, y, depth])
}

/// What a dark backdrop shows belongs to no layer.
fn forget_backdrop(views: &mut [LoadedView]) {
    let dark = backdrop::find_threshold(views);
    for view in views {
        let nothing = backdrop::background_mask(view, dark);
        for (pixel, nothing) in view.color.iter_mut().zip(nothing) {
            pixel[3] = if nothing { 0 } else { pixel[3] };
        }
    }
}

/// How much darker a view is than the middle one, channel by channel: the median ratio of the levels in which they show the same points.
fn gain(middle: &LoadedView, view: &LoadedView) -> [f32; 3] {
    /// One pixel of so many along each side is looked at.
    const STEP: usize = 4;
    let [width, height] = middle.size_px;
    let mut ratios = [const { Vec::new() }; 3];
    for y in (0..height).step_by(STEP) {
        for x in (0..width).step_by(STEP) {
            let point = middle.point_at(x, y);
            let Some([px, py, depth]) = point.and_then(|point| place(view, point)) else {
                continue;
            };
            let there = view.depth_at(px as u32, py as u32).map(f64::from);
            if there.is_none_or(|there| (there / depth - 1.0).abs() > SAME_POINT) {
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
    if ratios
        .iter()
        .any(|of_channel| of_channel.len() < LEAST_POINTS)
    {
        return [1.0; 3];
    }
    ratios.map(|of_channel| median(of_channel).unwrap_or(1.0) as f32)
}
