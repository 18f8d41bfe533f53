//! The charts of a report, made from its rows.

use crate::chart::{Axis, Chart, ChartPoint, Series};
use crate::plan::EyeSet;
use crate::report::row::{Report, Row};
use crate::stats::pareto_front;

/// A chart and the name of its file, without extension.
pub struct Figure {
    /// Name of the file, such as `tree-time`.
    pub name: String,
    /// The chart.
    pub chart: Chart,
}

/// Draws all charts of a report, scene after scene.
pub fn figures(report: &Report) -> Vec<Figure> {
    let mut figures = Vec::new();
    for (scene, slug) in report.scenes.iter().zip(slugs(report)) {
        let charts = [
            ("time", cost_chart(report, &scene.scene, Cost::Time)),
            ("displacement", displacement_chart(report, &scene.scene)),
            ("bytes", cost_chart(report, &scene.scene, Cost::Bytes)),
            ("rays", rays_chart(report, &scene.scene)),
        ];
        for (kind, chart) in charts {
            figures.extend(chart.map(|chart| Figure {
                name: format!("{slug}-{kind}"),
                chart,
            }));
        }
    }
    figures
}

/// Returns a file name for each scene: its short name with letters, digits and hyphens only, and a
/// number to distinguish equal names.
pub fn slugs(report: &Report) -> Vec<String> {
    let mut slugs: Vec<String> = Vec::new();
    for facts in &report.scenes {
        let clean: String = short(&facts.scene)
            .chars()
            .map(|c| if c.is_ascii_alphanumeric() { c } else { '-' })
            .collect();
        let count = slugs
            .iter()
            .filter(|s| **s == clean || s.starts_with(&format!("{clean}-")))
            .count();
        slugs.push(if count == 0 {
            clean
        } else {
            format!("{clean}-{}", count + 1)
        });
    }
    slugs
}

/// Returns a scene's name without folder, extension and `builtin:`.
pub fn short(scene: &str) -> &str {
    let name = scene.strip_prefix("builtin:").unwrap_or(scene);
    let name = name.rsplit(['/', '\\']).next().unwrap_or(name);
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

/// Horizontal axis of a chart of cost against error.
#[derive(Clone, Copy, PartialEq)]
enum Cost {
    Time,
    Bytes,
}

/// Returns the colour of a row by its family: LDI, points, cube map, traced, other.
fn family(row: &Row) -> usize {
    match row.variant.as_str() {
        name if name.starts_with("LDI") => 0,
        name if name.starts_with("points") => 1,
        name if name.starts_with("cube map") => 2,
        _ if row.traces => 6,
        _ => 3,
    }
}

fn cost_chart(report: &Report, scene: &str, cost: Cost) -> Option<Chart> {
    let rows: Vec<&Row> = report.group(scene, "representation").collect();
    let facts = report.scenes.iter().find(|facts| facts.scene == scene)?;
    let [width, height] = facts.frame_px;
    let x = |row: &Row| {
        if cost == Cost::Time {
            row.ms_median
        } else {
            row.bytes as f64 / 1e6
        }
    };
    let at: Vec<[f64; 2]> = rows.iter().map(|row| [x(row), row.flip]).collect();
    let front: Vec<usize> = pareto_front(&at);
    let series: Vec<Series> = rows
        .iter()
        .enumerate()
        .map(|(i, row)| Series {
            name: String::new(),
            points: vec![ChartPoint {
                at: at[i],
                name: row.variant.clone(),
                spread: (cost == Cost::Time).then_some(row.ms_quartiles),
            }],
            joined: false,
            hollow: !front.contains(&i),
            color: family(row),
        })
        .collect();
    let (title, note, name) = match cost {
        Cost::Time => (
            "time against error",
            "Lower left is better. Filled dots: the Pareto front (grey). Thin lines: quartiles over eyes and rounds.",
            format!(
                "time per frame of {width}x{height} px, ms, {} threads",
                report.machine.threads
            ),
        ),
        Cost::Bytes => (
            "bytes against error",
            "Memory that drawing needs. Lower left is better. Filled dots: the Pareto front (grey).",
            "memory, MB".into(),
        ),
    };
    (!rows.is_empty()).then(|| Chart {
        title: format!("{}: {title}", short(scene)),
        note: note.into(),
        x: Axis::logarithmic(name),
        y: flip_axis(),
        series,
        front: front.iter().map(|&i| at[i]).collect(),
    })
}

fn flip_axis() -> Axis {
    Axis::linear("FLIP error (0 = equal)")
}

/// Lines of a displacement chart: group, variant, label.
const LINES: [(&str, &str, &str); 6] = [
    ("representation", "LDI", "LDI"),
    ("representation", "points, 3x3 px", "points, 3x3 px"),
    ("representation", "cube map", "cube map"),
    (
        "representation",
        "1 ray/px, baked light",
        "1 ray/px, baked light",
    ),
    ("sprites", "two-pass", "sprites, two-pass"),
    ("sprites", "homography", "sprites, flat"),
];

fn displacement_chart(report: &Report, scene: &str) -> Option<Chart> {
    let lines = LINES.iter().filter_map(|(group, variant, name)| {
        let row = report.find(scene, group, variant)?;
        let points = row.displacement.iter();
        let points = points.map(|d| ChartPoint::new([d.share, d.flip]));
        let color = match *group {
            "sprites" => 3 + usize::from(*variant == "homography"),
            _ => family(row),
        };
        Some(Series::line(*name, points.collect(), color))
    });
    let series: Vec<Series> = lines.collect();
    (!series.is_empty()).then(|| Chart {
        title: format!("{}: error against eye displacement", short(scene)),
        note: "The eye moves from the centre of the headbox to a corner and looks ahead.".into(),
        x: Axis::linear("displacement (0 = centre, 1 = corner)"),
        y: flip_axis(),
        series,
        front: Vec::new(),
    })
}

fn rays_chart(report: &Report, scene: &str) -> Option<Chart> {
    let mut rows: Vec<&Row> = report
        .group(scene, "rays")
        .filter(|row| row.capture_s.is_some())
        .collect();
    rows.sort_by_key(|row| row.rays);
    let point = |row: &Row, name: String| ChartPoint {
        name,
        ..ChartPoint::new([row.capture_s.unwrap_or(f64::NAN), row.flip])
    };
    let label = |row: &Row| format!("{} ({} rays)", row.variant, count(row.rays.unwrap_or(0)));
    let points = rows.iter().map(|row| point(row, label(row)));
    let mut series = vec![Series::line("", points.collect(), 0)];
    let others = [
        ("sampler", "white noise", 1),
        ("sampler", "centre rays", 2),
        ("novelty stopping", "on", 3),
    ];
    for (group, variant, color) in others {
        let Some(row) = report
            .find(scene, group, variant)
            .filter(|row| row.eyes == EyeSet::All)
        else {
            continue;
        };
        let name = if group == "sampler" {
            variant.into()
        } else {
            "novelty stopping (default)".to_owned()
        };
        series.push(Series {
            name: String::new(),
            points: vec![point(row, name)],
            joined: false,
            hollow: true,
            color,
        });
    }
    (rows.len() > 1).then(|| Chart {
        title: format!("{}: capture time against error", short(scene)),
        note:
            "Stratified captures of more and more rays (strata x rays in each), and others with the default's strata."
                .into(),
        x: Axis::logarithmic("seconds to capture"),
        y: flip_axis(),
        series,
        front: Vec::new(),
    })
}

/// Formats a number of rays in thousands or millions.
fn count(rays: u64) -> String {
    if rays < 1_000_000 {
        format!("{} k", rays / 1000)
    } else {
        format!("{:.1} M", rays as f64 / 1e6)
    }
}
