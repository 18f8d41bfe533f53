//! `docs/results.md`: a report as a page, beside the papers' numbers.

use super::field::CLIPPING;
use super::figures::{short, slugs};
use crate::report::promises;
use super::row::{Report, Row, SceneFacts};
use crate::report::summary;
use crate::stats::pareto_front;
use crate::table::{Table, figure};
use crate::walk::WalkReport;
use std::fmt::Write;

/// A number in a paper that a report has a counterpart for.
struct Claim {
    /// Its number in our list of the papers' numbers.
    id: &'static str,
    /// What it is.
    what: &'static str,
    /// The paper's figure.
    theirs: f64,
    /// Ours.
    ours: fn(&Report, &SceneFacts) -> Option<f64>,
}

fn ratio(report: &Report, facts: &SceneFacts, group: &str, over: &str, under: &str) -> Option<f64> {
    let of = |variant: &str| Some(report.find(&facts.scene, group, variant)?.time_ratio);
    Some(of(over)? / of(under)?)
}

/// S: Shade et al. 1998; P: Popescu et al. 1998; R: Rafferty et al. 1998.
const CLAIMS: [Claim; 19] = [
    Claim {
        id: "S-N10",
        what: "depth pixels over occupied pixels (S: barnyard)",
        theirs: 1.24,
        ours: |_, facts| Some(facts.depth_complexity()),
    },
    Claim { id: "P-N1", what: "the same (P: one-storey house)", theirs: 1.26, ours: |_, f| Some(f.depth_complexity()) },
    Claim { id: "R-N2", what: "the same (R: 13 images)", theirs: 1.39, ours: |_, f| Some(f.depth_complexity()) },
    Claim {
        id: "P-N1",
        what: "share of samples in layer 1 (P)",
        theirs: 0.791,
        ours: |_, facts| Some(facts.layers[0] as f64 / facts.layers.iter().sum::<u64>().max(1) as f64),
    },
    Claim {
        id: "R-N2",
        what: "share of samples in layers 4 and beyond (R)",
        theirs: 0.027,
        ours: |_, facts| Some(facts.layers[3] as f64 / facts.layers.iter().sum::<u64>().max(1) as f64),
    },
    Claim {
        id: "S-N5",
        what: "share of depth pixels in near segments (S: tree)",
        theirs: 0.064,
        ours: |_, f| Some(f.near_share),
    },
    Claim {
        id: "S-N4",
        what: "rays for each depth pixel kept (S: tree; ours with novelty stopping)",
        theirs: 15.0,
        ours: |_, facts| Some(facts.rays_per_depth_pixel),
    },
    Claim {
        id: "S-N6",
        what: "time without clipping over time with it (S: 2 to 4)",
        theirs: 3.0,
        ours: |report, facts| ratio(report, facts, CLIPPING, "off", "on"),
    },
    Claim {
        id: "R-N6",
        what: "share of depth pixels that clipping leaves (R, P: one half)",
        theirs: 0.5,
        ours: |report, facts| {
            let row = report.find(&facts.scene, CLIPPING, "on")?;
            Some(row.depth_pixels_in / row.depth_pixels.max(1) as f64)
        },
    },
    Claim {
        id: "P-N7",
        what: "efficiency of parallel warping (P: 3.45 times faster on 4 processors)",
        theirs: 0.86,
        ours: |report, facts| {
            let one = report.group(&facts.scene, "threads").find(|row| row.baseline)?;
            let all = report.group(&facts.scene, "threads").find(|row| !row.baseline)?;
            Some(one.time_ratio / all.time_ratio / all.threads as f64)
        },
    },
    Claim {
        id: "P-N4",
        what: "bytes for each depth pixel, tables included (P: 13 to 14)",
        theirs: 13.5,
        ours: |report, facts| {
            let row = report.find(&facts.scene, "representation", "LDI")?;
            Some(row.bytes as f64 / row.depth_pixels.max(1) as f64)
        },
    },
    Claim {
        id: "S-N1",
        what: "sprites: two-pass over no parallax, time (S: 30 Hz to 16 Hz)",
        theirs: 1.88,
        ours: |report, facts| ratio(report, facts, "sprites", "two-pass", "homography"),
    },
    Claim {
        id: "S-N1",
        what: "sprites: crude one-pass over no parallax, time (S: 30 Hz to 21 Hz)",
        theirs: 1.43,
        ours: |report, facts| ratio(report, facts, "sprites", "one-pass", "homography"),
    },
    Claim {
        id: "S-N2",
        what: "sprites, nearest sampling: two-pass over no parallax, time (S: 47 Hz to 20 Hz)",
        theirs: 2.35,
        ours: |report, facts| ratio(report, facts, "sprites, nearest sampling", "two-pass", "homography"),
    },
    Claim {
        id: "S-N2",
        what: "sprites, nearest sampling: crude one-pass over no parallax, time (S: 47 Hz to 24 Hz)",
        theirs: 1.96,
        ours: |report, facts| ratio(report, facts, "sprites, nearest sampling", "one-pass", "homography"),
    },
    Claim {
        id: "S-N2",
        what: "sprites, two-pass: bilinear over nearest sampling, time",
        theirs: 1.25,
        ours: |report, facts| ratio(report, facts, "sprite sampling", "bilinear", "nearest"),
    },
    Claim {
        id: "P-N8",
        what: "all layers over one depth image, time (P, serial)",
        theirs: 1.8,
        ours: |report, facts| {
            let one = report.group(&facts.scene, "layers").find(|row| !row.baseline)?;
            Some(1.0 / one.time_ratio)
        },
    },
    Claim {
        id: "P-N8",
        what: "all layers over one depth image, samples (P: 189,688 to 256x256)",
        theirs: 2.89,
        ours: |report, facts| {
            let one = report.group(&facts.scene, "layers").find(|row| !row.baseline)?;
            let all = report.group(&facts.scene, "layers").find(|row| row.baseline)?;
            Some(all.depth_pixels as f64 / one.depth_pixels.max(1) as f64)
        },
    },
    Claim {
        id: "S-N7",
        what: "time with depth pixels of 24 bytes over that with packed ones (S: 20 bytes to 8), opaque rectangles",
        theirs: 1.25,
        ours: |report, facts| {
            let group = "depth pixel, opaque rectangles";
            Some(report.find(&facts.scene, group, "24 bytes, nothing quantised")?.time_ratio)
        },
    },
];

/// The page, with a walk through a house if there is one. Links to charts go to the folder `results` beside it;
/// [`super::figures`] and [`WalkReport::chart`] make them.
pub fn page(report: &Report, walk: Option<&WalkReport>) -> String {
    let mut text = String::from(
        "# Results\n\nMade by `headbox report --results report.json -o docs/results.md` from the file that `headbox report` \
         wrote (with `--walk`, from that of `headbox walk` too); no figure on this page has another source.\n\n",
    );
    text += &summary::preamble(report);
    for (facts, slug) in report.scenes.iter().zip(slugs(report)) {
        let _ = write!(text, "\n## {}\n\n", short(&facts.scene));
        text += &summary::scene(report, facts);
        for (kind, what) in [
            ("time", "time against error"),
            ("displacement", "error against displacement"),
            ("bytes", "bytes against error"),
            ("rays", "capture time against error"),
        ] {
            let shown = kind != "rays" || report.group(&facts.scene, "rays").count() > 1;
            if shown {
                let _ = write!(text, "\n![{}: {what}](results/{slug}-{kind}.svg)\n", short(&facts.scene));
            }
        }
        text += "\n";
        text += &tables(report, facts);
    }
    if let Some(walk) = walk {
        text += "\n";
        text += &walk.to_chapter();
        text += "\n![frame time along the path](results/along-path.svg)\n";
    }
    text += "\n## What the README says\n\n";
    let _ = write!(text, "{}", promises::table(report));
    text += "\n## Beside the papers\n\nRatios only: the papers' times are those of the machines of 1998.\n\n";
    let _ = write!(text, "{}", claims(report));
    text
}

fn tables(report: &Report, facts: &SceneFacts) -> String {
    let (mut text, mut some_tell_own) = (String::new(), false);
    for group in report.groups(&facts.scene) {
        let rows: Vec<&Row> = report.group(&facts.scene, group).collect();
        // A report of before knows nothing of it.
        let tells_own = rows.iter().any(|row| row.own_psnr_db.is_some());
        some_tell_own |= tells_own;
        let columns = [group, "ms", "time", "FLIP", "PSNR dB"].into_iter().chain(tells_own.then_some("own dB"));
        let columns = columns.chain(["SSIM", "holes %", "MB", "capture s", "worst FLIP", "flicker"]);
        let mut table = Table::new(columns);
        let front = pareto_front(&rows.iter().map(|row| [row.ms_median, row.flip]).collect::<Vec<_>>());
        for (i, row) in rows.iter().enumerate() {
            table.row(table_row(row, group == "representation" && front.contains(&i), tells_own));
        }
        let _ = writeln!(text, "{table}");
    }
    text += "(1): the row that the others of its table are compared with; * on the front: nothing in its table is both faster \
             and more exact. Time: over that of (1), frame by frame in turns.";
    if some_tell_own {
        text += " Own: PSNR without what the noise of truth adds to the mean squared error, where anything is left of that; FLIP \
                 and SSIM have that noise in them.";
    }
    text.push('\n');
    text
}

fn table_row(row: &Row, on_front: bool, tells_own: bool) -> impl Iterator<Item = String> {
    let optional = |value: Option<f64>, digits: usize| value.map_or("-".into(), |v| format!("{v:.digits$}"));
    let baseline = if row.baseline { " (1)" } else { "" };
    let front = if on_front { " *" } else { "" };
    let first = [
        format!("{}{baseline}{front}", row.variant),
        format!("{:.2}", row.ms_median),
        format!("{:.2}", row.time_ratio),
        format!("{:.4}", row.flip),
        if row.psnr_db.is_finite() { format!("{:.2}", row.psnr_db) } else { "equal".into() },
    ];
    let rest = [
        format!("{:.4}", row.ssim),
        optional(row.hole_fraction.map(|h| h * 100.0), 3),
        format!("{:.2}", row.bytes as f64 / 1e6),
        optional(row.capture_s, 2),
        format!("{:.4}", row.worst.flip),
        optional(row.flicker.map(|f| f * 255.0), 2),
    ];
    first.into_iter().chain(tells_own.then(|| optional(row.own_psnr_db, 2))).chain(rest)
}

fn claims(report: &Report) -> Table {
    let names = report.scenes.iter().flat_map(|facts| [short(&facts.scene), "ratio"]);
    let mut table = Table::new(["", "", "paper"].into_iter().chain(names));
    for claim in &CLAIMS {
        let ours: Vec<Option<f64>> = report.scenes.iter().map(|facts| (claim.ours)(report, facts)).collect();
        if ours.iter().all(Option::is_none) {
            continue;
        }
        let cells = ours.into_iter().flat_map(|value| match value {
            Some(value) => [figure(value), format!("{:.2}", value / claim.theirs)],
            None => ["-".into(), "-".into()],
        });
        table.row([claim.id.to_owned(), claim.what.into(), figure(claim.theirs)].into_iter().chain(cells));
    }
    table
}
