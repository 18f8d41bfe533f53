//! Kind and unit of depth that no file specifies, by the depth itself.
//!
//! Depth files do not state whether they hold distances along the viewing axis or along the ray,
//! nor their unit. A wrong kind bends planes, and a wrong unit lets neighbouring views disagree
//! about the points that both see. Both are only corrected if the depth agrees much better than
//! with what the format says, and every correction is noted.

#[cfg(test)]
mod tests;

use crate::cameras::lens::Lens;
use crate::depth::{DepthSource, has_proportions};
use crate::depth_files;
use crate::views::seen_points::{SeenPoints, sampled_pixels, sampling_step};
use crate::views::view::{LoadedView, MAX_DEPTH_M, View};
use crate::{ImageSet, ImagesError};
use glam::DMat3;
use headbox_core::depth_kind::DepthKind;
use headbox_core::read_note::ReadNote;
use headbox_core::statistics::median;
use rayon::prelude::*;

/// Number of sampled columns and rows of a view.
const SAMPLES: u32 = 48;

/// Largest distance in the set's order of two views that are compared.
const MAX_STRIDE: usize = 10;

/// Relative differences of depth below which views agree.
const AGREEMENT: f64 = 0.02;

/// Factor by which the differences shrink with the right kind or unit.
const IMPROVEMENT: f64 = 0.25;

/// Share of the points of a view that the other sees, at least.
const OVERLAP: f64 = 0.2;

/// Usual units of depth, relative to the assumed one: integers in 1/5000 m (TUM), 1/10000,
/// 1/6553.5 (Replica), 1/4000 and 1/8000 (RealSense), 1/256 (KITTI), and centimetres. Not metres:
/// then the poses are in millimetres.
pub(crate) const INTEGER_FACTORS: [f64; 7] =
    [0.2, 0.1, 1.0 / 6.5535, 0.25, 0.125, 1000.0 / 256.0, 10.0];

/// The same of floating-point numbers: millimetres, centimetres and decimetres.
pub(crate) const FLOAT_FACTORS: [f64; 3] = [0.001, 0.01, 0.1];

/// Notes depth of other sizes than the images, and corrects the kind and the unit of depth where
/// they are assumed.
pub(crate) fn examine(set: &mut ImageSet) {
    note_sizes(set);
    let is_assumed = |view: &View| {
        let depth = view.depth.as_ref();
        depth.is_some_and(|depth| depth.assumed.kind || depth.assumed.unit)
            && view.has_own_depth()
            && matches!(view.lens, Lens::Pinhole(_))
            // Wide images already have distances.
            && (view.source.is_none() || depth.is_some_and(|it| it.kind == DepthKind::EyeDepth))
    };
    // Views along the axis of their image.
    let is_front = |view: &View| {
        view.source
            .is_none_or(|source| source.source_from_view == DMat3::IDENTITY)
    };
    let views = set.views.iter();
    let assumed: Vec<&View> = views
        .filter(|view| is_assumed(view) && is_front(view))
        .collect();
    let Ok(mut pairs) = load_pairs(&assumed) else {
        // Loading reports it.
        return;
    };
    let all = assumed.len();
    let is_ray = find_kind(&mut pairs) == DepthKind::RayDistance;
    let Some(source) = assumed.first().and_then(|view| view.depth.clone()) else {
        return;
    };
    let is_float = matches!(
        crate::depth::extension(&source.path).as_str(),
        "exr" | "npy" | "tif" | "tiff"
    );
    let factors: Vec<f64> = if is_float {
        FLOAT_FACTORS
            .iter()
            .chain(&INTEGER_FACTORS)
            .copied()
            .collect()
    } else {
        INTEGER_FACTORS.to_vec()
    };
    let factor = source.assumed.unit.then(|| find_unit(&pairs, &factors));
    let factor = factor.flatten();
    if is_ray {
        set.notes.push(format!(
            "depth is taken as the distance along the ray, not along the viewing axis: planes are flat and neighbouring views \
             agree only then ({all} views)"
        ).into());
    }
    if let Some(factor) = factor {
        set.notes.push(format!(
            "depth is multiplied by the factor {factor:.4}: no file states its unit, and neighbouring views agree only then; {} \
             ({all} views)",
            describe_unit(&source, factor)
        ).into());
    }
    for view in set.views.iter_mut().filter(|view| is_assumed(view)) {
        let Some(depth) = &mut view.depth else {
            continue;
        };
        if is_ray && depth.assumed.kind {
            depth.kind = DepthKind::RayDistance;
        }
        if let Some(factor) = factor.filter(|_| depth.assumed.unit) {
            depth.unit_m *= factor as f32;
            depth.float_unit_m *= factor as f32;
        }
    }
}

/// Describes the unit that a factor on a source's unit gives.
fn describe_unit(source: &DepthSource, factor: f64) -> String {
    let unit_m = f64::from(source.unit_m) * factor;
    let float_unit_m = f64::from(source.float_unit_m) * factor;
    format!("a step of integers is {unit_m:.3e} m, 1 of other numbers {float_unit_m:.3e} m")
}

/// Notes how many views have depth of another resolution or orientation than their image.
fn note_sizes(set: &mut ImageSet) {
    let mut scaled = Vec::new();
    let mut turned = Vec::new();
    let size = |view: &View| {
        let depth = view.depth.as_ref().filter(|_| view.has_own_depth())?;
        depth_files::read_size(&depth.path).ok().flatten()
    };
    let sizes: Vec<_> = set.views.par_iter().map(size).collect();
    for (view, size) in set.views.iter().zip(sizes) {
        let image_px = view.file_size_px();
        let Some(size) = size.filter(|size| *size != image_px) else {
            continue;
        };
        if has_proportions(size, image_px) {
            scaled.push((view, size));
        } else if view.depth_turn(size).is_ok_and(|turn| turn.is_some()) {
            turned.push((view, size));
        }
    }
    let kinds = [
        (scaled, "is interpolated to the pixels of the image"),
        (turned, "is turned like its image, by the EXIF orientation"),
    ];
    for (views, what) in kinds {
        if views.is_empty() {
            continue;
        }
        let names: Vec<String> = views
            .iter()
            .map(|(view, [width, height])| {
                let [w, h] = view.file_size_px();
                format!("{} ({width}x{height} pixels for {w}x{h})", view.name)
            })
            .collect();
        let sentence = format!(
            "depth of {} of {} views {what}",
            names.len(),
            set.views.len()
        );
        set.notes.push(ReadNote::with_names(&sentence, &names, 1));
    }
}

/// Loads the depth of two pairs of views, or of the only view, without their colours.
fn load_pairs(views: &[&View]) -> Result<Vec<Vec<LoadedView>>, ImagesError> {
    let stride = (views.len() / 10).clamp(1, MAX_STRIDE);
    let starts = match views.len() {
        0 => return Ok(Vec::new()),
        1 => return Ok(vec![vec![load(views[0])?]]),
        2 => vec![0],
        count => vec![0, (count - 1) / 2],
    };
    let pair = |start: usize| {
        let second = (start + stride).min(views.len() - 1);
        [views[start], views[second]]
            .into_par_iter()
            .map(load)
            .collect()
    };
    starts.into_par_iter().map(pair).collect()
}

fn load(view: &View) -> Result<LoadedView, ImagesError> {
    let depth = view.load_depth()?;
    let distorted = LoadedView {
        size_px: view.file_size_px(),
        lens: view.lens,
        pose: view.pose,
        color: vec![[255; 4]; depth.len()],
        depth,
    };
    Ok(match &view.source {
        Some(source) => source.rectified(&distorted, view),
        None => distorted.undistorted(),
    })
}

/// Returns the depth of a view along the viewing axis if it is stored as distances along the ray.
fn along_axis(view: &LoadedView) -> Vec<f32> {
    let [width, _] = view.size_px;
    let convert = |(i, depth): (usize, &f32)| {
        let [x, y] = [i as u32 % width, i as u32 / width];
        depth / ray_length(&view.lens, view.size_px, x, y) as f32
    };
    view.depth.iter().enumerate().map(convert).collect()
}

fn ray_length(lens: &Lens, size_px: [u32; 2], x: u32, y: u32) -> f64 {
    let position = [f64::from(x) + 0.5, f64::from(y) + 0.5];
    lens.ray(position, size_px).length()
}

/// Returns the kind of depth: distance along the ray if planes are flat or neighbours agree only
/// so, else depth along the viewing axis. Depth of views is along the viewing axis afterwards.
fn find_kind(pairs: &mut [Vec<LoadedView>]) -> DepthKind {
    let shapes: Vec<[f64; 2]> = pairs.iter().flatten().filter_map(flat_shares).collect();
    let mean = |k: usize| shapes.iter().map(|it| it[k]).sum::<f64>() / shapes.len() as f64;
    // NaN without any, which is neither.
    let [flat_eye, flat_ray] = [mean(0), mean(1)];
    let planes = [flat_ray > 0.5 && flat_eye < 0.2, flat_eye > 0.3];
    let eye = disagreement(pairs, 1.0);
    // Only the depth is copied: images may be large.
    let mut stored = Vec::new();
    for view in pairs.iter_mut().flatten() {
        let converted = along_axis(view);
        stored.push(std::mem::replace(&mut view.depth, converted));
    }
    let ray = disagreement(pairs, 1.0);
    let neighbors = match (eye, ray) {
        (Some(eye), Some(ray)) => [
            eye > 0.003 && ray < IMPROVEMENT * eye && ray < AGREEMENT,
            ray > 0.003 && eye < IMPROVEMENT * ray,
        ],
        _ => [false; 2],
    };
    if (planes[0] && !neighbors[1]) || (neighbors[0] && !planes[1]) {
        DepthKind::RayDistance
    } else {
        for (view, depth) in pairs.iter_mut().flatten().zip(stored) {
            view.depth = depth;
        }
        DepthKind::EyeDepth
    }
}

/// Returns the shares of the sampled neighbourhoods that are flat if depth is along the viewing
/// axis, and if it is along the ray; `None` if hardly any neighbourhood is wide enough to tell.
///
/// Inverse depth along the axis is linear on a plane.
fn flat_shares(view: &LoadedView) -> Option<[f64; 2]> {
    /// Smallest relative bend by which the kinds differ.
    const MIN_BEND: f64 = 0.004;
    /// Number of neighbourhoods, at least.
    const MIN_COUNT: usize = 100;
    let [width, height] = view.size_px;
    let reach = (width.max(height) / 8).max(1);
    // Sensors and renderers cut depth off at a range, whose shape is neither.
    let largest = view.depth.iter().copied().filter(|z| z.is_finite());
    let largest = largest.fold(0.0, f32::max);
    let at_largest = view.depth.iter().filter(|z| **z == largest).count();
    let is_cut = at_largest * 50 > view.depth.len();
    let mut count = 0usize;
    let mut flat = [0usize; 2];
    for [x, y] in sampled_pixels(view.size_px, sampling_step(view.size_px, SAMPLES)) {
        for [dx, dy] in [[reach, 0], [0, reach]] {
            if x < dx || y < dy || x + dx >= width || y + dy >= height {
                continue;
            }
            let places = [[x - dx, y - dy], [x, y], [x + dx, y + dy]];
            let depths = places.map(|[x, y]| view.depth_at(x, y));
            let [Some(a), Some(b), Some(c)] = depths else {
                continue;
            };
            if [a, b, c]
                .iter()
                .any(|z| *z >= MAX_DEPTH_M || (is_cut && *z == largest))
            {
                continue;
            }
            let inverse = [a, b, c].map(|z| 1.0 / f64::from(z));
            let lengths = places.map(|[x, y]| ray_length(&view.lens, view.size_px, x, y));
            let bend = |[a, b, c]: [f64; 3]| (a - 2.0 * b + c) / b;
            let difference = bend(lengths).abs();
            if difference < MIN_BEND {
                continue;
            }
            count += 1;
            let as_ray = std::array::from_fn(|i| inverse[i] * lengths[i]);
            for (flat, values) in flat.iter_mut().zip([inverse, as_ray]) {
                *flat += usize::from(bend(values).abs() < IMPROVEMENT * difference);
            }
        }
    }
    (count >= MIN_COUNT).then(|| flat.map(|flat| flat as f64 / count as f64))
}

/// Returns the factor of the right unit among usual ones, if neighbours disagree as the depth is,
/// and agree by this one alone.
fn find_unit(pairs: &[Vec<LoadedView>], factors: &[f64]) -> Option<f64> {
    let given = disagreement(pairs, 1.0).unwrap_or(f64::INFINITY);
    if given < 2.0 * AGREEMENT {
        return None;
    }
    let mut found: Vec<(f64, f64)> = factors
        .iter()
        .filter_map(|&factor| Some((disagreement(pairs, factor)?, factor)))
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let &(best, factor) = found.first()?;
    let is_alone = found.get(1).is_none_or(|next| is_worse(next.0, best));
    // A flat minimum is no evidence: without parallax any large factor agrees.
    let is_sharp = [0.5, 2.0]
        .into_iter()
        .filter_map(|times| disagreement(pairs, factor * times))
        .all(|other| is_worse(other, best));
    (best < AGREEMENT && best < IMPROVEMENT * given && is_alone && is_sharp).then_some(factor)
}

/// Returns true if a disagreement is clearly larger than the best one.
fn is_worse(disagreement: f64, best: f64) -> bool {
    disagreement > 2.0 * best + 0.005
}

/// Returns the factor by which the depth of two views agrees best, if they disagree as they are
/// and agree well so.
pub(crate) fn best_factor(a: &LoadedView, b: &LoadedView) -> Option<f64> {
    /// Steps per power of ten, and powers of ten on either side.
    const STEPS: i32 = 60;
    const POWERS: i32 = 3;
    let factors = (-STEPS * POWERS..=STEPS * POWERS)
        .map(|step| 10f64.powf(f64::from(step) / f64::from(STEPS)));
    let measured = factors.filter_map(|factor| {
        let (difference, overlap) = compare(a, b, factor)?;
        (overlap > OVERLAP).then_some((difference, factor))
    });
    let measured: Vec<(f64, f64)> = measured.collect();
    let &(best, factor) = measured.iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    let is_sharp = [0.5, 2.0]
        .into_iter()
        .filter_map(|times| compare(a, b, factor * times))
        .all(|(other, _)| is_worse(other, best));
    let given = compare(a, b, 1.0).map_or(f64::INFINITY, |(difference, _)| difference);
    (best < AGREEMENT && best < IMPROVEMENT * given && is_sharp).then_some(factor)
}

/// Returns the largest median difference of the pairs that overlap; `None` if none does.
fn disagreement(pairs: &[Vec<LoadedView>], factor: f64) -> Option<f64> {
    let compared = pairs.iter().filter_map(|pair| match &pair[..] {
        [a, b] => compare(a, b, factor),
        _ => None,
    });
    let overlapping = compared.filter(|(_, overlap)| *overlap > OVERLAP);
    overlapping
        .map(|(difference, _)| difference)
        .reduce(f64::max)
}

/// Compares the points of `a` with the depth of `b`, both multiplied by `factor`. Returns the
/// median of |actual depth / expected depth - 1|, and the fraction of the points that `b` sees.
fn compare(a: &LoadedView, b: &LoadedView, factor: f64) -> Option<(f64, f64)> {
    let points = SeenPoints::new(a, b, sampling_step(a.size_px, SAMPLES), factor, false);
    let differences = points.seen.iter();
    let differences = differences.map(|point| (point.depth_ratio - 1.0).abs());
    Some((median(differences)?, points.overlap()))
}
