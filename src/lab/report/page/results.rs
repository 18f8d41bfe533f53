//! `docs/results.md`: the short page of a report. Each scene has a chart, a table and three
//! sentences; the papers' numbers follow. All other rows are in the report's JSON and CSV files.

use super::figures::{short, slugs};
use super::format::{bytes, ms, times};
use super::promises;
use crate::report::contender::contender_list::{CLIPPING, NEAREST_SPRITES, OPAQUE_PACKING};
use crate::report::row::{Report, Row, SceneFacts, chosen, smallest};
use crate::stats::pareto_front;
use crate::table::{Table, figure};
use crate::walk::WalkReport;
use std::fmt::Write;

/// A number of a paper that a report reproduces.
struct PaperNumber {
    /// Identifier in our list of the papers' numbers.
    id: &'static str,
    /// Description of the quantity.
    what: &'static str,
    /// Value of the paper.
    theirs: f64,
    /// Reads our value from a report.
    ours: fn(&Report, &SceneFacts) -> Option<f64>,
}

/// Returns the ratio of the times of two variants of a group.
fn ratio(report: &Report, facts: &SceneFacts, group: &str, over: &str, under: &str) -> Option<f64> {
    let time = |variant: &str| Some(report.find(&facts.scene, group, variant)?.time_ratio);
    Some(time(over)? / time(under)?)
}

/// Numbers of the papers. S: Shade et al. 1998; P: Popescu et al. 1998; R: Rafferty et al. 1998.
const PAPER_NUMBERS: [PaperNumber; 19] = [
    PaperNumber {
        id: "S-N10",
        what: "depth pixels over occupied pixels (S: barnyard)",
        theirs: 1.24,
        ours: |_, facts| Some(facts.depth_complexity()),
    },
    PaperNumber {
        id: "P-N1",
        what: "the same (P: one-storey house)",
        theirs: 1.26,
        ours: |_, f| Some(f.depth_complexity()),
    },
    PaperNumber {
        id: "R-N2",
        what: "the same (R: 13 images)",
        theirs: 1.39,
        ours: |_, f| Some(f.depth_complexity()),
    },
    PaperNumber {
        id: "P-N1",
        what: "share of samples in layer 1 (P)",
        theirs: 0.791,
        ours: |_, facts| Some(facts.layer_share(0)),
    },
    PaperNumber {
        id: "R-N2",
        what: "share of samples in layers 4 and beyond (R)",
        theirs: 0.027,
        ours: |_, facts| Some(facts.layer_share(3)),
    },
    PaperNumber {
        id: "S-N5",
        what: "share of depth pixels in near segments (S: tree)",
        theirs: 0.064,
        ours: |_, f| Some(f.near_share),
    },
    PaperNumber {
        id: "S-N4",
        what: "rays for each depth pixel kept (S: tree; ours with novelty stopping)",
        theirs: 15.0,
        ours: |_, facts| Some(facts.rays_per_depth_pixel),
    },
    PaperNumber {
        id: "S-N6",
        what: "time without clipping over time with it (S: 2 to 4)",
        theirs: 3.0,
        ours: |report, facts| ratio(report, facts, CLIPPING, "off", "on"),
    },
    PaperNumber {
        id: "R-N6",
        what: "share of depth pixels that clipping leaves (R, P: one half)",
        theirs: 0.5,
        ours: |report, facts| {
            let row = report.find(&facts.scene, CLIPPING, "on")?;
            Some(row.depth_pixels_in / row.depth_pixels.max(1) as f64)
        },
    },
    PaperNumber {
        id: "P-N7",
        what: "efficiency of parallel warping (P: 3.45 times faster on 4 processors)",
        theirs: 0.86,
        ours: |report, facts| {
            let one = report.first(&facts.scene, "threads", true)?;
            let all = report.first(&facts.scene, "threads", false)?;
            Some(one.time_ratio / all.time_ratio / all.threads as f64)
        },
    },
    PaperNumber {
        id: "P-N4",
        what: "bytes for each depth pixel, tables included (P: 13 to 14)",
        theirs: 13.5,
        ours: |report, facts| {
            let row = report.find(&facts.scene, "representation", "LDI")?;
            Some(row.bytes as f64 / row.depth_pixels.max(1) as f64)
        },
    },
    PaperNumber {
        id: "S-N1",
        what: "sprites: two-pass over no parallax, time (S: 30 Hz to 16 Hz)",
        theirs: 1.88,
        ours: |report, facts| ratio(report, facts, "sprites", "two-pass", "homography"),
    },
    PaperNumber {
        id: "S-N1",
        what: "sprites: crude one-pass over no parallax, time (S: 30 Hz to 21 Hz)",
        theirs: 1.43,
        ours: |report, facts| ratio(report, facts, "sprites", "one-pass", "homography"),
    },
    PaperNumber {
        id: "S-N2",
        what: "sprites, nearest sampling: two-pass over no parallax, time (S: 47 Hz to 20 Hz)",
        theirs: 2.35,
        ours: |report, facts| ratio(report, facts, NEAREST_SPRITES, "two-pass", "homography"),
    },
    PaperNumber {
        id: "S-N2",
        what: "sprites, nearest sampling: crude one-pass over no parallax, time (S: 47 Hz to 24 Hz)",
        theirs: 1.96,
        ours: |report, facts| ratio(report, facts, NEAREST_SPRITES, "one-pass", "homography"),
    },
    PaperNumber {
        id: "S-N2",
        what: "sprites, two-pass: bilinear over nearest sampling, time",
        theirs: 1.25,
        ours: |report, facts| ratio(report, facts, "sprite sampling", "bilinear", "nearest"),
    },
    PaperNumber {
        id: "P-N8",
        what: "all layers over one depth image, time (P, serial)",
        theirs: 1.8,
        ours: |report, facts| {
            let one = report.first(&facts.scene, "layers", false)?;
            Some(1.0 / one.time_ratio)
        },
    },
    PaperNumber {
        id: "P-N8",
        what: "all layers over one depth image, samples (P: 189,688 to 256x256)",
        theirs: 2.89,
        ours: |report, facts| {
            let one = report.first(&facts.scene, "layers", false)?;
            let all = report.first(&facts.scene, "layers", true)?;
            Some(all.depth_pixels as f64 / one.depth_pixels.max(1) as f64)
        },
    },
    PaperNumber {
        id: "S-N7",
        what: "time with depth pixels of 24 bytes over that with packed ones (S: 20 bytes to 8), opaque rectangles",
        theirs: 1.25,
        ours: |report, facts| {
            let variant = "24 bytes, nothing quantised";
            Some(
                report
                    .find(&facts.scene, OPAQUE_PACKING, variant)?
                    .time_ratio,
            )
        },
    },
];

/// Explanation of the columns of a scene's table.
const COLUMNS: &str = "FLIP, PSNR and SSIM are against ray-traced truth, over all eyes. *time* is relative to the row (1), \
frame by frame in turns. *own dB* is PSNR without the noise of truth. *flicker* is the change of the error from frame to frame \
along a path, in levels of 255. No row is both faster and more exact than one with *.";

/// Formats the page. Links to charts and files refer to the adjacent folder `results`;
/// [`super::figures`] and [`WalkReport::chart`] draw the charts.
pub fn page(report: &Report, walk: Option<&WalkReport>) -> String {
    let mut text = String::from(
        "# Results\n\nGenerated by `headbox report --results docs/results/report.json --walk docs/results/walk.json -o \
         docs/results.md`; every figure comes from those two files. All other rows are in \
         [report.csv](results/report.csv); charts of bytes and of eye displacement are in the same folder.\n\n",
    );
    text += &machine(report);
    let _ = write!(text, "\n{COLUMNS}\n");
    for (facts, slug) in report.scenes.iter().zip(slugs(report)) {
        let name = short(&facts.scene);
        let _ = write!(
            text,
            "\n## {name}\n\n![{name}: time against error](results/{slug}-time.svg)\n\n"
        );
        let rows: Vec<&Row> = report.group(&facts.scene, "representation").collect();
        let _ = writeln!(text, "{}", table(&rows));
        text += &sentences(report, facts, &rows);
    }
    if let Some(walk) = walk {
        let _ = write!(text, "\n{}", walk.to_chapter());
    }
    let _ = write!(
        text,
        "\n## Claims of the README\n\n{}",
        promises::table(report)
    );
    text += "\n## Numbers of the papers\n\nRatios only: the papers' times are those of machines of 1998.\n\n";
    let _ = write!(text, "{}", paper_numbers(report));
    text
}

/// Formats one line about the run: commit, seed, machine.
fn machine(report: &Report) -> String {
    let machine = &report.machine;
    let load = machine
        .load_hundredths
        .map(|load| format!(", load {:.2} at the start", f64::from(load) / 100.0));
    format!(
        "`headbox report{}`, commit {}, seed {}, {} threads of {} ({}, {}){}.\n",
        report.size_flag(),
        report.commit,
        report.seed,
        machine.threads,
        machine.processor,
        machine.simd,
        machine.system,
        load.unwrap_or_default(),
    )
}

/// Formats three sentences: the conditions, the recommendation, and the comparison with a cube map
/// and with rays.
fn sentences(report: &Report, facts: &SceneFacts, rows: &[&Row]) -> String {
    let [width, height] = facts.frame_px;
    let mut text = format!(
        "{} triangles, faces of {} px, {} eyes, frames of {width}x{height} px; the standard error of truth ({} rays a \
         pixel) lies at least {:.1} dB below every error.\n",
        facts.triangles,
        facts.face_size_px,
        facts.error_eyes().count(),
        facts.truth_samples_range(),
        facts.margin_db,
    );
    if let (Some(fast), Some(small)) = (chosen(rows), smallest(rows)) {
        let figures = format!(
            "{}, FLIP {:.3}, PSNR {:.1} dB",
            ms(fast.ms_median),
            fast.flip,
            fast.psnr_db
        );
        let choice = if fast.variant == small.variant {
            format!(
                "**{}** is the fastest and the smallest ({figures}, {})",
                fast.variant,
                bytes(small.bytes)
            )
        } else {
            let size = bytes(small.bytes);
            format!(
                "**{}** is the fastest ({figures}) and **{}** the smallest ({size})",
                fast.variant, small.variant
            )
        };
        let _ = writeln!(
            text,
            "Of what does not trace rays for each frame, and within 10 % of the least error, {choice}."
        );
    }
    let flip = |variant: &str| report.displacement_flip(&facts.scene, variant);
    let mut comparisons = Vec::new();
    if let (Some(ldi), Some(map)) = (flip("LDI"), flip("cube map")) {
        comparisons.push(format!(
            "from the headbox's centre to a corner the FLIP of the LDI goes from {:.3} to {:.3}, that of a cube map from {:.3} \
             to {:.3}",
            ldi[0], ldi[1], map[0], map[1],
        ));
    }
    if let Some(rival) = &facts.rival
        && let Some(default) = rival.kernels.first()
    {
        comparisons.push(format!(
            "the default frame ({}) takes {} of Embree's primary rays ({})",
            default.kernel,
            times(default.over_rays),
            ms(rival.ms_median),
        ));
    }
    if let Some(first) = comparisons.first_mut() {
        first[..1].make_ascii_uppercase();
        let _ = writeln!(text, "{}.", comparisons.join("; "));
    }
    text
}

/// Formats the table of a scene's representations.
fn table(rows: &[&Row]) -> Table {
    let names = [
        "representation",
        "ms",
        "time",
        "FLIP",
        "PSNR dB",
        "own dB",
        "SSIM",
        "holes %",
        "MB",
        "capture s",
        "flicker",
    ];
    let mut table = Table::new(names);
    let front = pareto_front(
        &rows
            .iter()
            .map(|row| [row.ms_median, row.flip])
            .collect::<Vec<_>>(),
    );
    let optional =
        |value: Option<f64>, digits: usize| value.map_or("-".into(), |v| format!("{v:.digits$}"));
    for (i, row) in rows.iter().enumerate() {
        let baseline = if row.baseline { " (1)" } else { "" };
        let on_front = if front.contains(&i) { " *" } else { "" };
        table.row([
            format!("{}{baseline}{on_front}", row.variant),
            format!("{:.2}", row.ms_median),
            format!("{:.2}", row.time_ratio),
            format!("{:.4}", row.flip),
            if row.psnr_db.is_finite() {
                format!("{:.2}", row.psnr_db)
            } else {
                "equal".into()
            },
            optional(row.own_psnr_db, 2),
            format!("{:.4}", row.ssim),
            optional(row.hole_fraction.map(|h| h * 100.0), 3),
            format!("{:.2}", row.bytes as f64 / 1e6),
            optional(row.capture_s, 2),
            optional(row.flicker.map(|f| f * 255.0), 2),
        ]);
    }
    table
}

/// Formats the table of the papers' numbers and those of each scene.
fn paper_numbers(report: &Report) -> Table {
    let names = report.scenes.iter().map(|facts| short(&facts.scene));
    let mut table = Table::new(["id", "quantity", "paper"].into_iter().chain(names));
    for number in &PAPER_NUMBERS {
        let ours: Vec<Option<f64>> = report
            .scenes
            .iter()
            .map(|facts| (number.ours)(report, facts))
            .collect();
        if ours.iter().all(Option::is_none) {
            continue;
        }
        let cells = ours
            .into_iter()
            .map(|value| value.map_or("-".into(), figure));
        table.row(
            [
                number.id.to_owned(),
                number.what.into(),
                figure(number.theirs),
            ]
            .into_iter()
            .chain(cells),
        );
    }
    table
}
