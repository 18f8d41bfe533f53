//! The first lines of a summary: what to use, how good it is, what it costs.

use super::figures::short;
use super::row::{Report, Row, SceneFacts, chosen, smallest};
use super::words::{bytes, list, ms, times};
use std::fmt::Write;

/// Header of the report, and five lines of results. Ranges are over the scenes.
pub(super) fn brief(report: &Report) -> String {
    let scenes: Vec<Scene> = report
        .scenes
        .iter()
        .filter_map(|facts| Scene::of(report, facts))
        .collect();
    let mut text = measured(report);
    if scenes.is_empty() {
        return text;
    }
    let of = |pick: &dyn Fn(&Scene) -> f64| scenes.iter().map(pick).collect::<Vec<f64>>();
    let flip = range(&of(&|s| s.best.flip), |v| format!("{v:.3}"));
    let psnr = range(&of(&|s| s.best.psnr_db), |v| format!("{v:.1}"));
    let own = own_errors(&scenes);
    let worst = of(&|s| s.best.worst.flip).into_iter().fold(0.0, f64::max);
    let holes = scenes
        .iter()
        .filter_map(|s| s.best.hole_fraction)
        .reduce(f64::max);
    let holes = holes.map_or(String::new(), |share| {
        format!("; at most {:.3} % of the pixels are holes", share * 100.0)
    });
    let time = range(&of(&|s| s.best.ms_median), ms);
    let size = range(&of(&|s| s.best.bytes as f64), |v| bytes(v as u64));
    let captures: Vec<f64> = scenes.iter().filter_map(|s| s.best.capture_s).collect();
    let capture = if captures.is_empty() {
        String::new()
    } else {
        format!(
            " It is captured in {}.",
            range(&captures, |s| format!("{s:.1} s"))
        )
    };
    let _ = writeln!(text, "- **What should I use?** {}.", use_what(&scenes));
    let _ = writeln!(
        text,
        "- **How good is it?** FLIP {flip}, PSNR {psnr} dB{own}; the worst frame has FLIP {worst:.3}{holes}."
    );
    let _ = writeln!(
        text,
        "- **What does it cost?** {time} a frame, {size} in memory.{capture}"
    );
    let _ = writeln!(text, "- **And without it?** {}", without(&scenes));
    let _ = writeln!(text, "- **If memory is short?** {}", small(&scenes));
    text
}

/// PSNR without the noise of truth, if that makes a difference.
fn own_errors(scenes: &[Scene]) -> String {
    /// dB.
    const DIFFERENCE: f64 = 0.5;
    let own: Option<Vec<f64>> = scenes.iter().map(|s| s.best.own_psnr_db).collect();
    let matters = |own: &Vec<f64>| {
        scenes
            .iter()
            .zip(own)
            .any(|(s, own)| own - s.best.psnr_db > DIFFERENCE)
    };
    let said = |own: Vec<f64>| {
        format!(
            " ({} without the noise of truth)",
            range(&own, |v| format!("{v:.1}"))
        )
    };
    own.filter(matters).map(said).unwrap_or_default()
}

/// A scene's rows that count here.
struct Scene<'a> {
    name: &'a str,
    rows: Vec<&'a Row>,
    best: &'a Row,
}

impl<'a> Scene<'a> {
    fn of(report: &'a Report, facts: &'a SceneFacts) -> Option<Self> {
        let rows: Vec<&Row> = report.group(&facts.scene, "representation").collect();
        let best = chosen(&rows)?;
        Some(Self {
            name: short(&facts.scene),
            rows,
            best,
        })
    }
}

fn measured(report: &Report) -> String {
    let machine = &report.machine;
    let sizes = range_of_sizes(&report.scenes);
    let eyes: usize = report
        .scenes
        .iter()
        .map(|facts| facts.judged_eyes().count())
        .sum();
    let scenes = match report.scenes.as_slice() {
        [one] => format!("{} ({} triangles)", short(&one.scene), one.triangles),
        many => format!("{} scenes", many.len()),
    };
    format!(
        "Measured: {scenes}, {sizes}, {eyes} eyes, {} threads of {}.\n\n",
        machine.threads, machine.processor
    )
}

/// The sizes of frames and faces, each once.
fn range_of_sizes(scenes: &[SceneFacts]) -> String {
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

/// The choice, with the scenes it is for where they differ.
fn use_what(scenes: &[Scene]) -> String {
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

/// The fastest that traces, against the choice.
fn without(scenes: &[Scene]) -> String {
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

/// The smallest that is as exact, where it is not the choice.
fn small(scenes: &[Scene]) -> String {
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

/// `a`, or `a to b` where least and most read differently.
fn range(values: &[f64], write: impl Fn(f64) -> String) -> String {
    let least = write(values.iter().copied().fold(f64::INFINITY, f64::min));
    let most = write(values.iter().copied().fold(f64::NEG_INFINITY, f64::max));
    if least == most {
        most
    } else {
        format!("{least} to {most}")
    }
}
