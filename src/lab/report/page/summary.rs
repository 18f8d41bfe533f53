//! The summary: sentences derived from the rows.

use super::brief::brief;
use super::figures::short;
use super::format::{bytes, list, ms, times};
use crate::report::contender::wall::CURVE;
use crate::report::rival::KernelTime;
use crate::report::row::{Report, Row, SceneFacts, chosen, smallest};
use crate::report::truth_samples::MARGIN_DB;
use crate::stats::pareto_front;
use std::fmt::Write;

/// Difference within which the errors of points of a sampling curve are equal, dB.
const EQUAL_DB: f64 = 0.5;

/// Formats `summary.md`.
pub fn summary(report: &Report) -> String {
    let mut text = String::from("# Speed against error\n\n");
    text += &brief(report);
    text += "\nThe details: ";
    text += &preamble(report);
    for facts in &report.scenes {
        let _ = write!(text, "\n## {}\n\n", short(&facts.scene));
        text += &scene(report, facts);
    }
    text
}

/// Formats commit, seed and machine.
fn preamble(report: &Report) -> String {
    let machine = &report.machine;
    let load = machine.load_hundredths.map_or(String::new(), |load| {
        format!(
            ", load {:.2} when it began (times of a busy machine scatter; ratios were taken frame by frame in turns)",
            f64::from(load) / 100.0
        )
    });
    format!(
        "`headbox report{}`, commit {}, seed {}: {} threads of {} ({}, {}){load}.\n",
        report.size_flag(),
        report.commit,
        report.seed,
        machine.threads,
        machine.processor,
        machine.simd,
        machine.system,
    )
}

/// Formats all sentences of a scene.
fn scene(report: &Report, facts: &SceneFacts) -> String {
    let mut text = conditions(facts);
    text += "\n";
    let rows: Vec<&Row> = report.group(&facts.scene, "representation").collect();
    text += &recommendation(&rows);
    text += &ldi_against_others(&rows);
    text += &ldi_against_rays(facts);
    text += &displacement(report, &facts.scene);
    text += &other_resources(report, &facts.scene, &rows);
    text += &ldi_stability(&rows, facts);
    text += &sampling_curve(report, &facts.scene);
    text += "\nEach approximation against the same without it:\n\n";
    for group in report
        .groups(&facts.scene)
        .into_iter()
        .filter(|group| *group != "representation")
    {
        let rows: Vec<&Row> = report.group(&facts.scene, group).collect();
        text += &group_sentence(group, &rows);
    }
    text
}

/// Formats sizes, eyes and the standard error of truth.
fn conditions(facts: &SceneFacts) -> String {
    let [width, height] = facts.frame_px;
    let margin_db = facts.margin_db;
    let noise = if margin_db >= MARGIN_DB {
        format!("lies {margin_db:.1} dB or more below every error that is measured with it.")
    } else {
        let side = if margin_db < 0.0 { "above" } else { "below" };
        format!(
            "lies only {:.1} dB {side} the least error, because the number of rays is limited: its noise is part of all errors.",
            margin_db.abs()
        )
    };
    format!(
        "{} triangles; faces of {} px; {} eyes, frames of {width}x{height} px. Truth has {} rays per pixel; its \
         standard error {noise}\n",
        facts.triangles,
        facts.face_size_px,
        facts.error_eyes().count(),
        facts.truth_samples_range(),
    )
}

/// Recommends the fastest variant, and lists the Pareto front of time and error.
fn recommendation(rows: &[&Row]) -> String {
    let at: Vec<[f64; 2]> = rows.iter().map(|row| [row.ms_median, row.flip]).collect();
    let front: Vec<&Row> = pareto_front(&at).into_iter().map(|i| rows[i]).collect();
    let names = front.iter().map(|row| {
        format!(
            "**{}** ({}, FLIP {:.3})",
            row.variant,
            ms(row.ms_median),
            row.flip
        )
    });
    let mut text = format!(
        "Nothing is both faster and more exact than {}.\n",
        list(names.collect())
    );
    if let Some(fast) = chosen(rows) {
        let _ = writeln!(
            text,
            "To look around, use **{}**: of all that does not trace rays for each frame, none within 10 % of the least \
             error is faster ({}, FLIP {:.3}, PSNR {:.1} dB{}, {}).",
            fast.variant,
            ms(fast.ms_median),
            fast.flip,
            fast.psnr_db,
            fast.own_psnr_db
                .map(|db| format!(", {db:.1} without the noise of truth"))
                .unwrap_or_default(),
            bytes(fast.bytes),
        );
        text += &least_flicker(fast, rows);
    }
    text
}

/// Recommends the variant with the least flicker that does not trace, if it is another one.
fn least_flicker(chosen: &Row, rows: &[&Row]) -> String {
    let Some(flicker) = chosen.flicker else {
        return String::new();
    };
    let steadiest = rows
        .iter()
        .filter(|row| !row.traces && row.flip <= chosen.flip * 1.1)
        .filter_map(|row| Some((row, row.flicker?)))
        .min_by(|a, b| a.1.total_cmp(&b.1));
    match steadiest {
        Some((row, least)) if least < 0.9 * flicker => format!(
            "If it has to be steady, use **{}**: its error changes by {:.1} levels from frame to frame, that one's by {:.1}.\n",
            row.variant,
            least * 255.0,
            flicker * 255.0,
        ),
        _ => String::new(),
    }
}

/// Compares the LDI with all other representations.
fn ldi_against_others(rows: &[&Row]) -> String {
    let Some(ldi) = rows.iter().find(|row| row.baseline) else {
        return String::new();
    };
    let mut text = String::new();
    for row in rows.iter().filter(|row| !row.variant.starts_with("LDI")) {
        let ratio = row.flip / ldi.flip;
        let error = match ratio {
            r if (0.995..1.005).contains(&r) => "the same error".to_owned(),
            r if r < 1.0 => format!("a smaller error by a factor of {:.2}", 1.0 / r),
            r => format!("a larger error by a factor of {r:.2}"),
        };
        let _ = writeln!(
            text,
            "- Against the LDI, {} takes {} and has {error} (FLIP {:.3} for {:.3}, PSNR {:.1} for {:.1} dB).",
            row.variant,
            times(row.time_ratio),
            row.flip,
            ldi.flip,
            row.psnr_db,
            ldi.psnr_db,
        );
    }
    text
}

/// Compares the LDI with Embree's primary rays.
fn ldi_against_rays(facts: &SceneFacts) -> String {
    let Some(rival) = &facts.rival else {
        return String::new();
    };
    let kernel = |k: &KernelTime| format!("{} {:.2} ({})", k.kernel, k.over_rays, ms(k.ms_median));
    format!(
        "A frame over embree primary rays of the same eyes ({} by Embree {} on {} threads, hits alone): {}.\n",
        ms(rival.ms_median),
        rival.version,
        rival.threads,
        list(rival.kernels.iter().map(kernel).collect()),
    )
}

/// Compares the LDI with a cube map on the line from the centre to a corner.
fn displacement(report: &Report, scene: &str) -> String {
    let flip = |variant: &str| report.displacement_flip(scene, variant);
    match (flip("LDI"), flip("cube map")) {
        (Some(ldi), Some(map)) => format!(
            "\nFrom the centre to a corner of the headbox the LDI's FLIP goes from {:.3} to {:.3}, a cube map's from {:.3} to \
             {:.3}.{}\n",
            ldi[0],
            ldi[1],
            map[0],
            map[1],
            crossing(report, scene).map_or(String::new(), |share| format!(
                " If the eye stays within {:.0} % of the way, a cube map will do; beyond, use the LDI.",
                share * 100.0
            ))
        ),
        _ => String::new(),
    }
}

/// Returns the position on the line from the centre (0) to a corner (1) up to which a cube map is
/// more exact than the LDI; `None` if the errors do not cross.
fn crossing(report: &Report, scene: &str) -> Option<f64> {
    let line = |variant: &str| Some(&report.find(scene, "representation", variant)?.displacement);
    let (ldi, map) = (line("LDI")?, line("cube map")?);
    let lead: Vec<(f64, f64)> = map
        .iter()
        .zip(ldi)
        .map(|(m, l)| (m.share, m.flip - l.flip))
        .collect();
    let cross = lead
        .windows(2)
        .find(|pair| pair[0].1 < 0.0 && pair[1].1 >= 0.0)?;
    let ((near, before), (far, after)) = (cross[0], cross[1]);
    Some(near + (far - near) * before / (before - after))
}

/// Recommends a variant where memory is scarce, and rays where capture time is.
fn other_resources(report: &Report, scene: &str, rows: &[&Row]) -> String {
    let mut text = String::new();
    if let Some(small) = smallest(rows) {
        let smallest_scene = rows
            .iter()
            .filter(|row| row.traces)
            .map(|row| row.bytes)
            .min();
        let traced = smallest_scene.filter(|scene| *scene < small.bytes);
        let _ = writeln!(
            text,
            "Where memory is short, use **{}**: of all that does not trace rays for each frame, none within 10 % of the least \
             error is smaller ({}, FLIP {:.3}).{}",
            small.variant,
            bytes(small.bytes),
            small.flip,
            traced.map_or(String::new(), |scene| format!(
                " To trace rays takes the scene itself, {}.",
                bytes(scene)
            )),
        );
    }
    let rays: Vec<&Row> = report
        .group(scene, "rays")
        .chain(report.find(scene, "novelty stopping", "on"))
        .collect();
    let least = rays
        .iter()
        .map(|row| row.flip)
        .fold(f64::INFINITY, f64::min);
    let close = rays.iter().filter(|row| row.flip <= least * 1.1);
    let quickest = close
        .filter_map(|row| Some((row, row.capture_s?)))
        .min_by(|a, b| a.1.total_cmp(&b.1));
    if let Some((row, seconds)) = quickest {
        let name = if row.group == "rays" {
            format!("**{}** rays", row.variant)
        } else {
            "the **default**".into()
        };
        let _ = writeln!(
            text,
            "Where capture time is short, capture with {name}: {seconds:.1} s, and within 10 % of the least error that more \
             rays reach (FLIP {:.3} for {least:.3}).",
            row.flip
        );
    }
    text
}

/// Formats the LDI's worst frame, holes and flicker.
fn ldi_stability(rows: &[&Row], facts: &SceneFacts) -> String {
    let Some(ldi) = rows.iter().find(|row| row.baseline) else {
        return String::new();
    };
    let mut text = format!(
        "The LDI's worst frame is that of eye {} (FLIP {:.3}, PSNR {:.1} dB)",
        ldi.worst.eye, ldi.worst.flip, ldi.worst.psnr_db
    );
    if let Some(holes) = ldi.hole_fraction {
        let _ = write!(
            text,
            "; {:.3} % of the pixels of all its frames are holes",
            holes * 100.0
        );
    }
    text += ".\n";
    if let Some(flicker) = ldi.flicker {
        let _ = writeln!(
            text,
            "Along a smooth path its error changes by {:.1} of 255 levels (root mean square) from frame to frame; the noise of \
             truth makes up at most {:.1} of them.",
            flicker * 255.0,
            facts.truth_flicker * 255.0
        );
    }
    text
}

/// Names the fastest point of a lumigraph's sampling curve, and tests that all points have the same
/// error.
fn sampling_curve(report: &Report, scene: &str) -> String {
    let rows: Vec<&Row> = report.group(scene, CURVE).collect();
    let Some(fastest) = rows
        .iter()
        .min_by(|a, b| a.time_ratio.total_cmp(&b.time_ratio))
        .filter(|_| rows.len() > 1)
    else {
        return String::new();
    };
    let psnr =
        |pick: fn(f64, f64) -> f64, from| rows.iter().map(|row| row.psnr_db).fold(from, pick);
    let least = psnr(f64::min, f64::INFINITY);
    let most = psnr(f64::max, f64::NEG_INFINITY);
    let holds = if most - least <= EQUAL_DB {
        "as the curve promises"
    } else {
        "though the curve promises equal errors"
    };
    format!(
        "\nOf the points of a lumigraph's sampling curve **{}** is drawn fastest ({}); their errors lie within {:.1} dB \
         ({least:.1} to {most:.1}), {holds}.\n",
        fastest.variant,
        ms(fastest.ms_median),
        most - least,
    )
}

/// Compares the rows of a group with its baseline, in one line.
fn group_sentence(group: &str, rows: &[&Row]) -> String {
    let Some(base) = rows.iter().find(|row| row.baseline) else {
        return String::new();
    };
    let others: Vec<String> = rows
        .iter()
        .filter(|row| !row.baseline)
        .map(|row| format!("*{}*: {}", row.variant, difference(row, base)))
        .collect();
    if others.is_empty() {
        return String::new();
    }
    let mut first = format!(
        "{}, FLIP {:.4}, PSNR {:.2} dB",
        ms(base.ms_median),
        base.flip,
        base.psnr_db
    );
    let rays_differ = rows.windows(2).any(|pair| pair[0].rays != pair[1].rays);
    if let Some(seconds) = base.capture_s.filter(|_| rays_differ) {
        let _ = write!(first, ", captured in {seconds:.1} s");
    }
    format!(
        "- **{group}**, *{}* ({first}). {}.\n",
        base.variant,
        others.join("; ")
    )
}

/// Compares a row with its baseline.
fn difference(row: &Row, base: &Row) -> String {
    let mut parts = vec![times(row.time_ratio)];
    if row.psnr_to_baseline_db.is_infinite() {
        parts.push("not a bit of a frame differs".into());
    } else {
        let change = row.psnr_db - base.psnr_db;
        let more = if change < 0.0 { "lower" } else { "higher" };
        parts.push(format!(
            "FLIP {:.4}, PSNR {:.2} dB {more}",
            row.flip,
            change.abs()
        ));
        if row.psnr_to_baseline_db > 35.0 {
            parts.push(format!(
                "{:.0} dB from the other's frames",
                row.psnr_to_baseline_db
            ));
        }
    }
    let size = row.bytes as f64 / base.bytes.max(1) as f64;
    if (size - 1.0).abs() >= 0.01 {
        parts.push(format!("{size:.2} times the bytes"));
    }
    if let (Some(mine), Some(theirs)) = (row.capture_s, base.capture_s)
        && row.rays != base.rays
    {
        parts.push(format!("captured in {mine:.1} s instead of {theirs:.1} s"));
    }
    if let (Some(mine), Some(theirs)) = (row.hole_fraction, base.hole_fraction)
        && (mine - theirs).abs() >= 5e-5
    {
        parts.push(format!(
            "{:.2} % holes instead of {:.2} %",
            mine * 100.0,
            theirs * 100.0
        ));
    }
    parts.join(", ")
}
