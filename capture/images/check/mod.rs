//! Consistency check of the views of a set.

mod color_scales;

use self::color_scales::ColorScales;
use super::depth_evidence::best_factor;
use super::views::view::{LoadedView, MAX_DEPTH_M, View};
use super::{ImageSet, ImagesError};
use crate::readers::text;
use crate::views::seen_points::{SeenPoints, sampled_pixels};
use headbox_core::statistics::median;

/// Disagreement of two neighbouring views where both have depth.
#[derive(Clone, Debug, PartialEq)]
pub struct Residual {
    /// Name of the first view.
    pub from: String,
    /// Name of the second view.
    pub to: String,
    /// Fraction of the first view's points that the second sees (0..=1).
    pub overlap: f64,
    /// Median of |actual depth / expected depth - 1| over these; NaN without overlap.
    pub relative_depth: f64,
    /// Median colour difference of these, levels of 255; NaN without overlap.
    pub color_levels: f64,
}

/// Result of checking a set.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CheckReport {
    /// Residuals of neighbours with depth, in the set's order.
    pub residuals: Vec<Residual>,
    /// Median finite depth of all loaded views, metres; NaN without any.
    pub median_depth_m: f64,
    /// Fraction of pixels with known depth (0..=1).
    pub depth_share: f64,
    /// True if the colours of neighbours agree with another unit of depth only.
    pub is_unit_doubtful: bool,
    /// Warnings, one sentence each.
    pub warnings: Vec<String>,
}

/// Distance of the sampled pixels, in rows and columns.
const STEP: u32 = 8;

/// Relative depth difference above which neighbours disagree: ten times the error of a depth
/// sensor.
const MAX_DIFFERENCE: f64 = 0.1;

/// Distance of neighbouring eyes, in median depths, above which they can hardly overlap.
const MAX_BASELINE: f64 = 10.0;

/// Checks that all files exist and have the right size by their headers, then runs
/// [`check_neighbors`].
///
/// # Errors
/// [`ImagesError`] of the first view whose files are missing or cannot be loaded.
pub fn check(
    set: &ImageSet,
    most: usize,
    on_view: &mut dyn FnMut(&str),
) -> Result<CheckReport, ImagesError> {
    set.views.iter().try_for_each(View::check_files)?;
    check_neighbors(set, most, on_view)
}

/// Compares at most `most` pairs of neighbours with depth, evenly spread over the set. `on_view` is
/// called for every loaded view; files of other views are not read.
///
/// # Errors
/// [`ImagesError`] of the first view that cannot be loaded.
pub fn check_neighbors(
    set: &ImageSet,
    most: usize,
    on_view: &mut dyn FnMut(&str),
) -> Result<CheckReport, ImagesError> {
    let mut report = CheckReport {
        warnings: warn_of_duplicates(&set.views).into_iter().collect(),
        ..CheckReport::default()
    };
    let views: Vec<&View> = set.views_with_depth().collect();
    let mut depths = Vec::new();
    let mut known = 0u64;
    let mut pixels = 0u64;
    let pairs = views.len().saturating_sub(1);
    let chosen = (0..pairs.min(most)).map(|i| i * pairs / pairs.min(most).max(1));
    let single = if pairs == 0 { views.first() } else { None };
    let mut last: Option<(usize, LoadedView)> = None;
    let mut unknown = Vec::new();
    let mut outside = Vec::new();
    let mut scales = ColorScales::default();
    let mut add = |loaded: &LoadedView, view: &View| {
        let before = known;
        add_depths(loaded, &mut depths, &mut known, &mut pixels);
        if known == before {
            unknown.push(view.name.clone());
        }
        outside.extend(describe_outside(loaded, view));
    };
    for i in chosen {
        let a = match last.take() {
            Some((j, view)) if j == i => view,
            _ => load(views[i], on_view)?,
        };
        let b = load(views[i + 1], on_view)?;
        add(&a, views[i]);
        scales.add(&a, &b);
        let residual = compare(&a, &b, &views[i].name, &views[i + 1].name);
        if residual.relative_depth > MAX_DIFFERENCE {
            let factor = best_factor(&a, &b).map_or_else(String::new, |factor| {
                format!("; they agree if depth is multiplied by the factor {factor:.3}")
            });
            report.warnings.push(format!(
                "{} and {} disagree: their depths of the same points differ by {:.0} %; check the poses, the unit of depth \
                                 and its kind{factor}",
                residual.from,
                residual.to,
                residual.relative_depth * 100.0
            ));
        }
        report.residuals.push(residual);
        last = Some((i + 1, b));
    }
    if let Some(view) = single {
        add(&load(view, on_view)?, view);
    }
    if let Some(first) = outside.first() {
        report.warnings.push(format!(
            "depth of {} views contradicts their clip_from_eye_matrix: {first}; check depth_type and the unit of depth",
            outside.len()
        ));
    }
    let doubt = scales.doubt();
    report.is_unit_doubtful = doubt.as_ref().is_some_and(|doubt| doubt.is_of_unit);
    report.warnings.extend(doubt.map(|doubt| doubt.sentence));
    let unknown = text::abbreviate(&unknown);
    report.warnings.extend(
        unknown.map(|which| {
            format!("no pixel has a valid depth (all are zero or not numbers): {which}")
        }),
    );
    report.median_depth_m = median(depths).unwrap_or(f64::NAN);
    report.depth_share = known as f64 / pixels.max(1) as f64;
    if report.median_depth_m > 500.0 || report.median_depth_m < 0.01 {
        report.warnings.push(format!(
            "the median depth is {:.3} m: the unit of the depth images may be wrong",
            report.median_depth_m
        ));
    }
    report.warnings.extend(warn_of_units(&views, &report));
    Ok(report)
}

/// Describes depth outside the range of the view's own clip matrix; `None` if it is inside, or
/// without a matrix.
fn describe_outside(loaded: &LoadedView, view: &View) -> Option<String> {
    /// Share of the known depths that may lie outside.
    const MAX_SHARE: f64 = 0.01;
    let range = view.depth.as_ref()?.clip_range()?;
    let [near, far] = range.map(|plane| plane * f64::from(view.depth_scale));
    let mut known = 0u64;
    let mut before = 0u64;
    let mut behind = 0u64;
    for [x, y] in sampled_pixels(loaded.size_px, [STEP; 2]) {
        if let Some(depth) = loaded.depth_at(x, y).map(f64::from) {
            known += 1;
            before += u64::from(depth < near * 0.999);
            behind += u64::from(depth < f64::from(MAX_DEPTH_M) && depth > far * 1.001);
        }
    }
    let share = |count: u64| count as f64 / known.max(1) as f64;
    let describe = |count: u64, what: &str, plane: f64| {
        let percent = share(count) * 100.0;
        format!(
            "{percent:.0} % of {} lies {what} plane of {plane:.3} m",
            view.name
        )
    };
    if share(before) > MAX_SHARE {
        Some(describe(before, "before the near", near))
    } else if share(behind) > MAX_SHARE {
        Some(describe(behind, "behind the far", far))
    } else {
        None
    }
}

/// Returns a warning if the units of poses and depth differ: with poses in millimetres and depth in
/// metres, neighbours do not overlap.
fn warn_of_units(views: &[&View], report: &CheckReport) -> Option<String> {
    let baseline = median(
        views
            .windows(2)
            .map(|pair| pair[0].pose.eye.distance(pair[1].pose.eye)),
    )?;
    let none_agree = report
        .residuals
        .iter()
        .all(|residual| residual.relative_depth.is_nan());
    (none_agree && baseline > MAX_BASELINE * report.median_depth_m).then(|| {
        format!(
            "neighbouring cameras are {baseline:.3} m apart (median) and do not overlap, while the median depth is {:.3} m: \
                         poses and depth may be in different units, such as millimetres and metres",
            report.median_depth_m
        )
    })
}

fn load(view: &View, on_view: &mut dyn FnMut(&str)) -> Result<LoadedView, ImagesError> {
    on_view(&view.name);
    view.load()
}

/// Returns a warning that names views with equal poses.
fn warn_of_duplicates(views: &[View]) -> Option<String> {
    let mut order: Vec<&View> = views.iter().collect();
    order.sort_by(|a, b| {
        // Includes the orientation: a camera that turns in place has one eye position.
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
    let same: Vec<String> = order
        .windows(2)
        .filter(|pair| pair[0].pose == pair[1].pose && pair[0].lens == pair[1].lens)
        .map(|pair| format!("{} and {}", pair[0].name, pair[1].name))
        .collect();
    text::abbreviate(&same).map(|which| format!("views with the same pose: {which}"))
}

fn add_depths(view: &LoadedView, depths: &mut Vec<f64>, known: &mut u64, pixels: &mut u64) {
    for [x, y] in sampled_pixels(view.size_px, [STEP; 2]) {
        *pixels += 1;
        if let Some(depth) = view.depth_at(x, y) {
            *known += 1;
            // Background depth is independent of the unit.
            depths.extend((depth < MAX_DEPTH_M).then_some(f64::from(depth)));
        }
    }
}

/// Compares points of `a` with depth and colour of `b` where they project to.
fn compare(a: &LoadedView, b: &LoadedView, from: &str, to: &str) -> Residual {
    let points = SeenPoints::new(a, b, [STEP; 2], 1.0, true);
    let mut relative = Vec::new();
    let mut levels = Vec::new();
    for point in &points.seen {
        let error = (point.depth_ratio - 1.0).abs();
        relative.push(error);
        if error < MAX_DIFFERENCE / 4.0 {
            levels.extend(point.color_levels(a, b));
        }
    }
    Residual {
        from: from.into(),
        to: to.into(),
        overlap: points.overlap(),
        relative_depth: median(relative).unwrap_or(f64::NAN),
        color_levels: median(levels).unwrap_or(f64::NAN),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ImageSetOptions;
    use image::{ImageBuffer, Luma, RgbImage};
    use serde_json::json;

    /// Warnings about cameras that move sideways along a textured wall two metres away, whose
    /// depth is given as `depth_m`.
    fn check_wall(depth_m: f64) -> String {
        let folder = tempfile::tempdir().expect("a folder");
        let mut frames = Vec::new();
        for i in 0..3u32 {
            let eye = 0.2 * f64::from(i);
            let color = |x: u32, y: u32| {
                let [x, y] = [x, y].map(|at| (f64::from(at) - 31.5) / 40.0 * 2.0);
                let level = |v: f64| (127.0 + 100.0 * v.sin()) as u8;
                image::Rgb([level(8.0 * (x + eye)), level(9.0 * y), 0])
            };
            RgbImage::from_fn(64, 64, color)
                .save(folder.path().join(format!("{i}.png")))
                .expect("written");
            frames.push(json!({
                "file_path": format!("{i}.png"), "depth_file_path": "d.png",
                "transform_matrix": [[1, 0, 0, eye], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
            }));
        }
        let depth = Luma([(depth_m * 1000.0) as u16]);
        ImageBuffer::<Luma<u16>, Vec<u16>>::from_pixel(64, 64, depth)
            .save(folder.path().join("d.png"))
            .expect("written");
        let set = json!({"w": 64, "h": 64, "fl_x": 40, "frames": frames});
        std::fs::write(folder.path().join("transforms.json"), set.to_string()).expect("written");
        let set = ImageSet::open(folder.path(), &ImageSetOptions::default()).expect("opens");
        let report = check(&set, 4, &mut |_| {}).expect("loads");
        assert!(
            report.residuals[0].relative_depth < 1e-6,
            "depth alone agrees"
        );
        report.warnings.join("\n")
    }

    #[test]
    fn colours_show_a_wrong_unit() {
        assert_eq!(check_wall(2.0), "");
        // The usual unit nearest to the factor that was tried, if there is one.
        let wrong = [
            (8.0, "0.25"),
            (4.0, "0.50"),
            (0.5, "4.00"),
            (16.0, "0.125"),
            (10.0, "0.200"),
        ];
        for (depth_m, factor) in wrong {
            let warnings = check_wall(depth_m);
            assert!(
                warnings.contains("colours of the same points"),
                "{depth_m}: {warnings}"
            );
            assert!(
                warnings.contains(&format!("factor {factor}")),
                "{depth_m}: {warnings}"
            );
        }
    }

    #[test]
    fn depth_outside_the_clip_range_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let save = |level: u16| {
            ImageBuffer::<Luma<u16>, Vec<u16>>::from_pixel(16, 16, Luma([level]))
                .save(folder.path().join("d.png"))
                .expect("written");
        };
        RgbImage::new(16, 16)
            .save(folder.path().join("c.png"))
            .expect("written");
        let warnings = |kind: &str, near: f64, far: f64, level: u16| {
            save(level);
            let (a, b) = (
                -(far + near) / (far - near),
                -2.0 * far * near / (far - near),
            );
            let view = json!({
                "projective_camera": {
                    "image_width": 16, "image_height": 16, "depth_type": kind,
                    "clip_from_eye_matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, a, b, 0, 0, -1, 0],
                    "world_from_eye_matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
                },
                "depth_image_file": {
                    "color": {"path": "c.png", "channel_alpha": "CONSTANT_ONE"},
                    "depth": {"path": "d.png", "channel_0": "R"},
                },
            });
            let manifest = json!({"view_groups": [{"views": [view]}]});
            std::fs::write(folder.path().join("manifest.json"), manifest.to_string())
                .expect("written");
            let set = ImageSet::open(folder.path(), &ImageSetOptions::default()).expect("opens");
            check(&set, 4, &mut |_| {})
                .expect("loads")
                .warnings
                .join("\n")
        };
        for kind in ["EYE_Z", "RAY_DEPTH"] {
            assert!(
                warnings(kind, 1.0, 100.0, 32_000).contains("before the near plane of 1.000 m")
            );
            assert!(warnings(kind, 0.01, 0.1, 32_000).contains("behind the far plane of 0.100 m"));
            assert_eq!(warnings(kind, 0.1, 100.0, 32_000), "");
        }
        assert_eq!(warnings("WINDOW_Z", 1.0, 100.0, 32_000), "");
    }
}
