//! First lines of a summary: recommendation, error and cost.

use super::figures::short;
use super::format::{bytes, list, ms, times};
use crate::report::row::{Report, Row, SceneFacts, chosen, smallest};
use std::fmt::Write;

/// Formats the header of the report and five lines of results. Ranges are over the scenes.
pub(crate) fn brief(report: &Report) -> String {
    let scenes: Vec<SceneRows> = report
        .scenes
        .iter()
        .filter_map(|facts| SceneRows::new(report, facts))
        .collect();
    let mut text = conditions(report);
    if scenes.is_empty() {
        return text;
    }
    let values = |pick: &dyn Fn(&SceneRows) -> f64| scenes.iter().map(pick).collect::<Vec<f64>>();
    let flip = range(&values(&|s| s.best.flip), |v| format!("{v:.3}"));
    let psnr = range(&values(&|s| s.best.psnr_db), |v| format!("{v:.1}"));
    let own = own_errors(&scenes);
    let worst = values(&|s| s.best.worst.flip)
        .into_iter()
        .fold(0.0, f64::max);
    let holes = scenes
        .iter()
        .filter_map(|s| s.best.hole_fraction)
        .reduce(f64::max);
    let holes = holes.map_or(String::new(), |share| {
        format!("; at most {:.3} % of the pixels are holes", share * 100.0)
    });
    let time = range(&values(&|s| s.best.ms_median), ms);
    let size = range(&values(&|s| s.best.bytes as f64), |v| bytes(v as u64));
    let captures: Vec<f64> = scenes.iter().filter_map(|s| s.best.capture_s).collect();
    let capture = if captures.is_empty() {
        String::new()
    } else {
        format!(
            " It is captured in {}.",
            range(&captures, |s| format!("{s:.1} s"))
        )
    };
    let _ = writeln!(
        text,
        "- **What should I use?** {}.",
        recommendation(&scenes)
    );
    let _ = writeln!(
        text,
        "- **How good is it?** FLIP {flip}, PSNR {psnr} dB{own}; the worst frame has FLIP {worst:.3}{holes}."
    );
    let _ = writeln!(
        text,
        "- **What does it cost?** {time} a frame, {size} in memory.{capture}"
    );
    let _ = writeln!(text, "- **And without it?** {}", fastest_traced(&scenes));
    let _ = writeln!(text, "- **If memory is short?** {}", smaller_rows(&scenes));
    text
}

/// Formats the PSNR without the noise of truth, if it differs.
fn own_errors(scenes: &[SceneRows]) -> String {
    /// Smallest difference that is reported, dB.
    const DIFFERENCE: f64 = 0.5;
    let own: Option<Vec<f64>> = scenes.iter().map(|s| s.best.own_psnr_db).collect();
    let differs = |own: &Vec<f64>| {
        scenes
            .iter()
            .zip(own)
            .any(|(s, own)| own - s.best.psnr_db > DIFFERENCE)
    };
    own.filter(differs).map_or(String::new(), |own| {
        let range = range(&own, |v| format!("{v:.1}"));
        format!(" ({range} without the noise of truth)")
    })
}

/// Representations of a scene and the recommended one.
struct SceneRows<'a> {
    name: &'a str,
    rows: Vec<&'a Row>,
    best: &'a Row,
}

impl<'a> SceneRows<'a> {
    fn new(report: &'a Report, facts: &'a SceneFacts) -> Option<Self> {
        let rows: Vec<&Row> = report.group(&facts.scene, "representation").collect();
        let best = chosen(&rows)?;
        Some(Self {
            name: short(&facts.scene),
            rows,
            best,
        })
    }
}

/// Formats the scenes, sizes, eyes and threads of the report.
fn conditions(report: &Report) -> String {
    let machine = &report.machine;
    let eyes: usize = report
        .scenes
        .iter()
        .map(|facts| facts.error_eyes().count())
        .sum();
    let scenes = match report.scenes.as_slice() {
        [one] => format!("{} ({} triangles)", short(&one.scene), one.triangles),
        many => format!("{} scenes", many.len()),
    };
    format!(
        "Measured: {scenes}, {}, {eyes} eyes, {} threads of {}.\n\n",
        sizes(&report.scenes),
        machine.threads,
        machine.processor
    )
}

/// Lists the distinct sizes of frames and faces.
fn sizes(scenes: &[SceneFacts]) -> String {
    let mut sizes: Vec<String> = Vec::new();
    for facts in scenes {
        let [width, height] = facts.frame_px;
        let size = format!(
            "frames of {width}x{height} px from faces of {} px",
            facts.face_size_px
        );
        if !sizes.contains(&size) {
            sizes.push(size);
        }
    }
    list(sizes)
}

/// Formats the recommended variant, or each with its scenes if they differ.
fn recommendation(scenes: &[SceneRows]) -> String {
    let mut choices: Vec<(&str, Vec<String>)> = Vec::new();
    for scene in scenes {
        match choices
            .iter_mut()
            .find(|(variant, _)| *variant == scene.best.variant)
        {
            Some((_, names)) => names.push(scene.name.to_owned()),
            None => choices.push((&scene.best.variant, vec![scene.name.to_owned()])),
        }
    }
    match choices.as_slice() {
        [(variant, _)] => format!("**{variant}**"),
        _ => list(
            choices
                .into_iter()
                .map(|(variant, names)| format!("**{variant}** for {}", list(names)))
                .collect(),
        ),
    }
}

/// Compares the fastest variant that traces with the recommended one.
fn fastest_traced(scenes: &[SceneRows]) -> String {
    let against = scenes.iter().filter_map(|scene| {
        let traced = scene.rows.iter().filter(|row| row.traces);
        let row = traced.min_by(|a, b| a.ms_median.total_cmp(&b.ms_median))?;
        let ratio = times(row.ms_median / scene.best.ms_median);
        Some(format!(
            "{} by {} takes {ratio} (FLIP {:.3})",
            scene.name, row.variant, row.flip
        ))
    });
    let against: Vec<String> = against.collect();
    if against.is_empty() {
        "Nothing that traces was measured.".into()
    } else {
        format!("{}.", against.join("; "))
    }
}

/// Lists the smallest of the exact variants where it is smaller than the recommended one.
fn smaller_rows(scenes: &[SceneRows]) -> String {
    let small = scenes.iter().filter_map(|scene| {
        let row = smallest(&scene.rows).filter(|row| row.bytes < scene.best.bytes)?;
        Some(format!(
            "**{}** for {} ({}, FLIP {:.3})",
            row.variant,
            scene.name,
            bytes(row.bytes),
            row.flip
        ))
    });
    let small: Vec<String> = small.collect();
    if small.is_empty() {
        "Nothing as exact is smaller.".into()
    } else {
        format!("{}.", list(small))
    }
}

/// Formats a range as `least to most`, or as one value if both have the same format.
fn range(values: &[f64], write: impl Fn(f64) -> String) -> String {
    let least = write(values.iter().copied().fold(f64::INFINITY, f64::min));
    let most = write(values.iter().copied().fold(f64::NEG_INFINITY, f64::max));
    if least == most {
        most
    } else {
        format!("{least} to {most}")
    }
}
