//! The fastest point of the sampling curve on this machine (L6).
//!
//! Along the curve fewer images need more layers, for the same bound on the error. Which point draws fastest nobody can compute, so
//! points are timed: all cameras, every second, every fourth and so on, each with the layers that it needs. Nor are all points equally
//! good, whatever the curve says: of those that a budget of time allows, with as many layers more, the one that errs least is kept.

use super::bounds::{detail, min_layers};
use crate::make::layers::Placement;
use crate::render::render::LumigraphRenderer;
use super::settings::LumigraphSettings;
use super::{Lumigraph, LumigraphError, MAX_LAYERS, RawLumigraph};
use headbox_core::camera::Camera;
use headbox_core::statistics::median;
use headbox_core::metrics;
use headbox_core::metrics::MetricError;
use headbox_core::progress::Progress;
use image::RgbImage;
use serde::{Deserialize, Serialize};

/// A point of the sampling curve.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// Columns and rows of cameras.
    pub cameras: [usize; 2],
    /// Layers of disparity, at most.
    pub layers: usize,
    /// Median time of a frame, ms; 0 before it was taken.
    pub ms: f64,
    /// How far its frames are from what they should be, as a PSNR in dB, if they were compared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_db: Option<f64>,
}

/// Frames of which a point's time is the median, in as many rounds.
const ROUNDS: usize = 11;

/// Layers that a point is tried with where time allows more than the curve asks for, in multiples of these.
const MORE_LAYERS: [usize; 3] = [1, 2, 4];

/// Four times as many as a byte tells apart: what frames are compared with if nothing else tells what they should show.
const FINEST_LAYERS: usize = 1020;

impl RawLumigraph {
    /// The points of the minimum sampling curve that these images hold, most cameras first, for frames of a focal length in pixels
    /// (Eq. 7): every first, second, fourth camera and so on, as long as the outermost stay.
    pub fn curve(&self, frame_focal_px: f64) -> Vec<CurvePoint> {
        let (grid, Some(range)) = (self.grid(), self.range()) else { return Vec::new() };
        let finest = detail(1.0 / grid.focal_px(), 1.0 / frame_focal_px, None);
        let counts = [grid.columns().len(), grid.rows().len()];
        let keeps_ends = |step: usize| counts.iter().all(|count| (count - 1).is_multiple_of(step));
        let longest = counts[0].max(counts[1]).saturating_sub(1).max(1);
        let points = (1..=longest).filter(|step| keeps_ends(*step)).filter_map(|step| {
            let [columns, rows] = counts.map(|count| every(count, step));
            let spacing = self.with_cameras(&columns, &rows).ok()?.grid().spacing();
            let layers = min_layers(1.0, range, spacing, finest).ceil().clamp(1.0, MAX_LAYERS as f64) as usize;
            Some(CurvePoint { cameras: [columns.len(), rows.len()], layers, ms: 0.0, psnr_db: None })
        });
        points.collect()
    }

    /// The lumigraph of a point of the curve.
    ///
    /// # Errors
    /// As [`Self::layered`]; [`LumigraphError::NoCameras`] if the images do not hold the point.
    pub fn at(&self, point: &CurvePoint, placement: Placement) -> Result<Lumigraph, LumigraphError> {
        let numbers = |of: usize, all: usize| match (of, all) {
            (1, 1) => Ok(vec![0]),
            (2.., 2..) if (all - 1).is_multiple_of(of - 1) => Ok(every(all, (all - 1) / (of - 1))),
            _ => Err(LumigraphError::NoCameras),
        };
        let columns = numbers(point.cameras[0], self.grid().columns().len())?;
        let rows = numbers(point.cameras[1], self.grid().rows().len())?;
        self.with_cameras(&columns, &rows)?.layered(point.layers, placement)
    }

    /// Times the points of the curve on frames of these cameras, in turns, and keeps the fastest. Its
    /// [`LumigraphInfo::curve`](super::LumigraphInfo::curve) tells all of them.
    ///
    /// # Errors
    /// As [`Self::at`]; [`LumigraphError::NothingSeen`] if there is no point.
    pub fn fastest(
        &self,
        frames: &[Camera],
        placement: Placement,
        progress: &dyn Progress,
    ) -> Result<Lumigraph, LumigraphError> {
        let mut points = self.curve(longest_focal_px(frames));
        let lumigraphs = points.iter().map(|point| self.at(point, placement)).collect::<Result<Vec<_>, _>>()?;
        progress.begin("timing", "points", (ROUNDS * points.len()) as u64);
        let times = in_turns(&lumigraphs, frames, progress);
        for (point, ms) in points.iter_mut().zip(times) {
            point.ms = ms;
        }
        let best = (0..points.len()).min_by(|&a, &b| points[a].ms.total_cmp(&points[b].ms));
        let best = best.and_then(|best| lumigraphs.into_iter().nth(best));
        let mut fastest = best.ok_or(LumigraphError::NothingSeen)?;
        fastest.info.curve = points;
        Ok(fastest)
    }

    /// Of the points of the curve for `frames`, with as many layers as the curve asks for and more, the one whose frames come
    /// nearest to the pictures beside them and take `budget_ms` at most; the fastest of all if none does.
    /// [`LumigraphInfo::curve`](super::LumigraphInfo::curve) tells what each took, and how it erred.
    ///
    /// # Errors
    /// As [`Self::fastest`]; [`LumigraphError::Reference`] if a picture has not the size of its frame.
    pub fn nearest_within(
        &self,
        budget_ms: f64,
        frames: &[Camera],
        pictures: &[RgbImage],
        placement: Placement,
        progress: &dyn Progress,
    ) -> Result<Lumigraph, LumigraphError> {
        let mut points: Vec<CurvePoint> = Vec::new();
        for point in self.curve(longest_focal_px(frames)) {
            let layers = MORE_LAYERS.map(|times| (times * point.layers).min(MAX_LAYERS - 1));
            points.extend(layers.map(|layers| CurvePoint { layers, ..point.clone() }));
        }
        points.dedup();
        progress.begin("timing", "points", (ROUNDS * points.len()) as u64);
        let mut best: Option<(Lumigraph, usize)> = None;
        for i in 0..points.len() {
            // One after the other: with all their layers together they would fill the memory.
            let lumigraph = self.at(&points[i], placement)?;
            points[i].ms = in_turns(std::slice::from_ref(&lumigraph), frames, progress)[0];
            points[i].psnr_db = Some(psnr_db(&lumigraph, frames, pictures)?);
            if best.as_ref().is_none_or(|(_, best)| points[i].is_better(&points[*best], budget_ms)) {
                best = Some((lumigraph, i));
            }
        }
        let (mut nearest, _) = best.ok_or(LumigraphError::NothingSeen)?;
        nearest.info.curve = points;
        Ok(nearest)
    }

    /// Frames of all images with many layers: what frames should show if nothing else tells.
    ///
    /// # Errors
    /// As [`Self::layered`].
    pub fn finest(&self, frames: &[Camera]) -> Result<Vec<RgbImage>, LumigraphError> {
        Ok(pictures(&self.layered(FINEST_LAYERS, Placement::Histogram)?, frames))
    }
}

impl CurvePoint {
    /// Whether it serves a budget better than another: within it rather than not, then nearer to what it should be; beyond it, faster.
    fn is_better(&self, other: &Self, budget_ms: f64) -> bool {
        match (self.ms <= budget_ms, other.ms <= budget_ms) {
            (true, true) => self.psnr_db > other.psnr_db,
            (false, false) => self.ms < other.ms,
            (is_within, _) => is_within,
        }
    }
}

/// The paper's experiment: points of the curve as they are.
const UNMERGED: LumigraphSettings = LumigraphSettings { merge: false, ..LumigraphSettings::USUAL };

fn longest_focal_px(frames: &[Camera]) -> f64 {
    frames.iter().map(Camera::focal_px).fold(f64::MIN_POSITIVE, f64::max)
}

/// Median times of the frames of each, ms, drawn in turns.
fn in_turns(lumigraphs: &[Lumigraph], frames: &[Camera], progress: &dyn Progress) -> Vec<f64> {
    let mut renderer = LumigraphRenderer::new();
    let mut times = vec![Vec::new(); lumigraphs.len()];
    for _ in 0..ROUNDS {
        for (lumigraph, times) in lumigraphs.iter().zip(&mut times) {
            times.extend(frames.iter().map(|camera| renderer.render(lumigraph, camera, &UNMERGED).1.frame_ms));
            progress.advance(1);
        }
    }
    times.into_iter().map(|times| median(times).unwrap_or(0.0)).collect()
}

/// PSNR of all frames together.
fn psnr_db(lumigraph: &Lumigraph, frames: &[Camera], expected: &[RgbImage]) -> Result<f64, LumigraphError> {
    let share = |(expected, drawn): (&RgbImage, &RgbImage)| Ok(10f64.powf(-metrics::psnr_db(expected, drawn)? / 10.0));
    let drawn = pictures(lumigraph, frames);
    let errors: Result<Vec<f64>, MetricError> = expected.iter().zip(&drawn).map(share).collect();
    let errors = errors.map_err(|_| LumigraphError::Reference)?;
    Ok(-10.0 * (errors.iter().sum::<f64>() / errors.len().max(1) as f64).log10())
}

fn pictures(lumigraph: &Lumigraph, frames: &[Camera]) -> Vec<RgbImage> {
    let mut renderer = LumigraphRenderer::new();
    // A frame has as many pixels as its size says.
    let mut picture = |camera| renderer.render(lumigraph, camera, &UNMERGED).0.to_rgb().unwrap_or_default();
    frames.iter().map(&mut picture).collect()
}

/// Every so many of `count`, from the first on.
fn every(count: usize, step: usize) -> Vec<usize> {
    (0..count).step_by(step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::Bed;
    use crate::{CameraGrid, ErrorBound};
    use headbox_core::progress::Silent;
    use glam::DVec3;

    #[test]
    fn points_lie_on_the_curve_and_the_fastest_is_kept() {
        let bed = Bed::new(CameraGrid::evenly(5, 1.0), CameraGrid::evenly(5, 1.0), [64, 48]);
        let raw = bed.raw();
        let frames = [bed.camera(DVec3::new(0.1, 0.2, 0.0), DVec3::NEG_Z, [40, 30])];
        let points = raw.curve(frames[0].focal_px());
        let cameras: Vec<[usize; 2]> = points.iter().map(|point| point.cameras).collect();
        assert_eq!(cameras, [[5, 5], [3, 3], [2, 2]]);
        let range = raw.range().expect("a range");
        let tolerance = (1.0 / bed.grid.focal_px()).max(1.0 / frames[0].focal_px());
        for point in &points {
            let bound = ErrorBound { focal: 1.0, spacing: 1.0 / (point.cameras[0] - 1) as f64, behind: 0.0, tolerance };
            let share = |layers: usize| [range[0], range[0] + (range[1] - range[0]) / layers as f64];
            assert!(bound.allows(share(point.layers)), "{point:?}");
            assert!(
                point.layers == 1 || !bound.allows(share(point.layers - 1)),
                "{point:?} is on the curve, not above"
            );
        }
        let fastest = raw.fastest(&frames, Placement::Uniform, &Silent).expect("timed");
        let told = &fastest.info.curve;
        assert!(told.len() == 3 && told.iter().all(|point| point.ms > 0.0), "{told:?}");
        let least = told.iter().min_by(|a, b| a.ms.total_cmp(&b.ms)).expect("points");
        assert_eq!([fastest.grid().columns().len(), fastest.grid().rows().len()], least.cameras);
        assert!(fastest.layers().len() <= least.layers);
    }

    #[test]
    fn of_what_a_budget_allows_the_least_error_is_kept() {
        let bed = Bed::new(CameraGrid::evenly(5, 1.0), CameraGrid::evenly(5, 1.0), [64, 48]);
        let raw = bed.raw();
        let frames = [bed.camera(DVec3::new(0.1, 0.2, 0.0), DVec3::NEG_Z, [40, 30])];
        let expected = raw.finest(&frames).expect("frames");
        let within =
            |ms: f64, expected: &[RgbImage]| raw.nearest_within(ms, &frames, expected, Placement::Histogram, &Silent);
        let nearest = within(f64::INFINITY, &expected).expect("a point");
        let curve = &nearest.info.curve;
        assert!(curve.len() > 3, "more layers than the curve asks for are tried: {curve:?}");
        let best = curve.iter().max_by(|a, b| a.psnr_db.partial_cmp(&b.psnr_db).expect("compared")).expect("points");
        assert_eq!(nearest.grid().columns().len(), best.cameras[0]);
        assert!(nearest.layers().len() <= best.layers);
        let least = curve.iter().filter_map(|point| point.psnr_db).fold(f64::INFINITY, f64::min);
        assert!(best.psnr_db > Some(least + 1.0), "points differ: {curve:?}");
        // Where no point is within the budget time alone decides.
        let hurried = within(0.0, &expected).expect("a point");
        let fastest = hurried.info.curve.iter().min_by(|a, b| a.ms.total_cmp(&b.ms)).expect("points");
        assert_eq!(hurried.grid().columns().len(), fastest.cameras[0]);
        let other_size = [RgbImage::new(4, 4)];
        assert_eq!(within(1.0, &other_size).err(), Some(LumigraphError::Reference));
    }

    #[test]
    fn images_that_hold_one_point_or_another_grid() {
        let bed = Bed::new(CameraGrid::evenly(4, 1.0), CameraGrid::evenly(3, 1.0), [16, 12]);
        let raw = bed.raw();
        assert_eq!(raw.curve(10.0).len(), 1, "no other keeps the ends of both");
        let missing = CurvePoint { cameras: [3, 3], layers: 5, ms: 0.0, psnr_db: None };
        assert_eq!(raw.at(&missing, Placement::Uniform).err(), Some(LumigraphError::NoCameras));
        let single = Bed::new(vec![0.0], vec![0.0], [16, 12]).raw();
        assert_eq!(single.curve(10.0), [CurvePoint { cameras: [1, 1], layers: 1, ms: 0.0, psnr_db: None }]);
        assert!(single.fastest(&[], Placement::Uniform, &Silent).is_ok());
    }
}
