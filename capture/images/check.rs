//! Whether the views of a set agree with each other.

use super::view::{FARTHEST_M, LoadedView, View};
use super::{ImageSet, ImagesError};
use crate::readers::text;
use headbox_core::statistics::median;

/// How well two neighbouring views agree where both know a depth.
#[derive(Clone, Debug, PartialEq)]
pub struct Residual {
    /// The first view's name.
    pub from: String,
    /// The second's.
    pub to: String,
    /// Share of the first view's points that the second sees at all (0..=1).
    pub overlap: f64,
    /// Median of |depth found / depth expected - 1| over these; NaN without overlap.
    pub relative_depth: f64,
    /// Median difference of colours there, levels of 255; NaN without overlap.
    pub color_levels: f64,
}

/// What a check of a set found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CheckReport {
    /// Neighbours in the set's order that have depth.
    pub residuals: Vec<Residual>,
    /// Median over all views that were loaded of depth that ends somewhere, metres; NaN without any.
    pub median_depth_m: f64,
    /// Share of pixels of known depth.
    pub depth_share: f64,
    /// What is wrong, a sentence each.
    pub warnings: Vec<String>,
}

/// A pixel in every so many rows and columns is looked at.
const STEP: u32 = 8;

/// Neighbours whose depths differ by more than this, relative, disagree: ten times what a depth sensor errs by.
const DISAGREE: f64 = 0.1;

/// Neighbours' eyes so many times as far apart as they see can hardly see the same.
const FAR_APART: f64 = 10.0;

/// Looks whether all files are there, as large as they should be by what their headers say; then [`check_neighbors`].
///
/// # Errors
/// [`ImagesError`] of the first view whose files are not there, or that cannot be loaded.
pub fn check(
    set: &ImageSet,
    most: usize,
    look: &mut dyn FnMut(&str),
) -> Result<CheckReport, ImagesError> {
    set.views.iter().try_for_each(View::check_files)?;
    check_neighbors(set, most, look)
}

/// Loads at most `most` pairs of neighbours that have depth, evenly over the set, and compares them. `look` is told of every view that was
/// loaded; files of others are not looked at.
///
/// # Errors
/// [`ImagesError`] of the first view that cannot be loaded.
pub fn check_neighbors(
    set: &ImageSet,
    most: usize,
    look: &mut dyn FnMut(&str),
) -> Result<CheckReport, ImagesError> {
    let mut report = CheckReport {
        warnings: duplicates(&set.views),
        ..CheckReport::default()
    };
    let views: Vec<&View> = set.with_depth().collect();
    let (mut depths, mut known, mut pixels) = (Vec::new(), 0u64, 0u64);
    let pairs = views.len().saturating_sub(1);
    let chosen = (0..pairs.min(most)).map(|i| i * pairs / pairs.min(most).max(1));
    let single = if pairs == 0 { views.first() } else { None };
    let mut last: Option<(usize, LoadedView)> = None;
    let mut unknown = Vec::new();
    let mut gather = |view: &LoadedView, name: &str| {
        let before = known;
        gather(view, &mut depths, &mut known, &mut pixels);
        if known == before {
            unknown.push(name.to_owned());
        }
    };
    for i in chosen {
        let a = match last.take() {
            Some((j, view)) if j == i => view,
            _ => load(views[i], look)?,
        };
        let b = load(views[i + 1], look)?;
        gather(&a, &views[i].name);
        let residual = compare(&a, &b, &views[i].name, &views[i + 1].name);
        if residual.relative_depth > DISAGREE {
            report.warnings.push(format!(
                "{} and {} disagree: where both see a point their depths differ by {:.0} %; a pose, the depth's unit or its \
                 kind may be wrong",
                residual.from,
                residual.to,
                residual.relative_depth * 100.0
            ));
        }
        report.residuals.push(residual);
        last = Some((i + 1, b));
    }
    if let Some(view) = single {
        gather(&load(view, look)?, &view.name);
    }
    let unknown = text::first_of(&unknown);
    report.warnings.extend(
        unknown.map(|which| {
            format!("depth of no pixel is known (all are zero, or no numbers): {which}")
        }),
    );
    report.median_depth_m = median(depths).unwrap_or(f64::NAN);
    report.depth_share = known as f64 / pixels.max(1) as f64;
    if report.median_depth_m > 500.0 || report.median_depth_m < 0.01 {
        report.warnings.push(format!(
            "half of all depths lie beyond {:.3} m: the unit of the depth pictures may be wrong",
            report.median_depth_m
        ));
    }
    report.warnings.extend(other_units(&views, &report));
    Ok(report)
}

/// Poses in millimetres beside depth in metres make neighbours that see nothing of each other.
fn other_units(views: &[&View], report: &CheckReport) -> Option<String> {
    let apart = median(
        views
            .windows(2)
            .map(|pair| pair[0].pose.eye.distance(pair[1].pose.eye)),
    )?;
    let none_agree = report
        .residuals
        .iter()
        .all(|residual| residual.relative_depth.is_nan());
    (none_agree && apart > FAR_APART * report.median_depth_m).then(|| {
        format!(
            "neighbours stand {apart:.3} m apart (median) and see nothing of each other, as half of all depths lie within {:.3} m: poses and \
             depth may be in different units, such as millimetres and metres",
            report.median_depth_m
        )
    })
}

fn load(view: &View, look: &mut dyn FnMut(&str)) -> Result<LoadedView, ImagesError> {
    look(&view.name);
    view.load()
}

/// Views with the same pose as another one.
fn duplicates(views: &[View]) -> Vec<String> {
    let mut order: Vec<&View> = views.iter().collect();
    order.sort_by(|a, b| {
        // Of a camera that turns in one place all eyes are the same.
        let key = |view: &View| {
            (
                view.pose.eye.to_array(),
                view.pose.world_from_eye.to_cols_array(),
            )
        };
        key(a)
            .partial_cmp(&key(b))
            .unwrap_or(std::cmp::Ordering::Equal)
    });
    let same = order
        .windows(2)
        .filter(|pair| pair[0].pose == pair[1].pose && pair[0].lens == pair[1].lens);
    let same: Vec<String> = same
        .map(|pair| format!("{} and {}", pair[0].name, pair[1].name))
        .collect();
    text::first_of(&same)
        .map(|which| format!("views with the same pose: {which}"))
        .into_iter()
        .collect()
}

fn gather(view: &LoadedView, depths: &mut Vec<f64>, known: &mut u64, pixels: &mut u64) {
    for_each_looked_at(view, |x, y| {
        *pixels += 1;
        if let Some(depth) = view.depth_at(x, y) {
            *known += 1;
            // How far the sky is says nothing of units.
            depths.extend((depth < FARTHEST_M).then_some(f64::from(depth)));
        }
    });
}

fn for_each_looked_at(view: &LoadedView, mut visit: impl FnMut(u32, u32)) {
    let [width, height] = view.size_px;
    for y in (STEP / 2..height).step_by(STEP as usize) {
        for x in (STEP / 2..width).step_by(STEP as usize) {
            visit(x, y);
        }
    }
}

/// Points of `a` looked up in `b`. A point that `b` sees something else in front of is hidden there, and does not count.
fn compare(a: &LoadedView, b: &LoadedView, from: &str, to: &str) -> Residual {
    let (mut relative, mut levels, mut points, mut seen) = (Vec::new(), Vec::new(), 0u64, 0u64);
    for_each_looked_at(a, |x, y| {
        let Some(point) = a.point_at(x, y) else {
            return;
        };
        points += 1;
        let Some([bx, by, expected]) = b.lens.project(b.pose.to_eye(point), b.size_px) else {
            return;
        };
        if !(bx >= 0.0 && by >= 0.0 && bx < f64::from(b.size_px[0]) && by < f64::from(b.size_px[1]))
        {
            return;
        }
        let Some(found) = b.depth_at(bx as u32, by as u32) else {
            return;
        };
        let error = (f64::from(found) / expected - 1.0).abs();
        seen += 1;
        relative.push(error);
        if error < DISAGREE / 4.0
            && let Some(color) = b.color_at([bx, by])
        {
            let own = a.color[y as usize * a.size_px[0] as usize + x as usize];
            levels.push(
                (0..3)
                    .map(|c| (color[c] - f64::from(own[c])).abs())
                    .sum::<f64>()
                    / 3.0,
            );
        }
    });
    Residual {
        from: from.into(),
        to: to.into(),
        overlap: seen as f64 / points.max(1) as f64,
        relative_depth: median(relative).unwrap_or(f64::NAN),
        color_levels: median(levels).unwrap_or(f64::NAN),
    }
}
