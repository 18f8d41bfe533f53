//! A report of a small scene, end to end: its rows, and the agreement of all text with them.

use headbox::DVec3;
use headbox_lab::machine::Machine;
use headbox_lab::plan::{EyeSet, Plan, Quality, axis_with_most_geometry};
use headbox_lab::report::figures::figures;
use headbox_lab::report::row::{EyeRecord, Report, Row, SceneFacts};
use headbox_lab::report::scene;
use headbox_lab::report::subject::Subject;
use headbox_lab::report::{results, summary};
use headbox_lab::stats::pareto_front;
use headbox_lab::table::figure;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;

use headbox_core::progress::Silent;
use std::sync::{Arc, LazyLock};

const WALL: &str = "from a wall of cameras";
const CURVE: &str = "lumigraph's sampling curve (all layers)";
const CLIPPING: &str = "clipping (one band, 1 thread)";

/// Minimum effort that gives every row.
const TINY: Quality = Quality {
    face_size_px: 16,
    strata: 4,
    rays: 4,
    light_samples: 1,
    baked_samples: 1,
    frame_px: [24, 18],
    uniform_eyes: 1,
    line_eyes: 2,
    path_eyes: 2,
    first_samples: 4,
    most_samples: 64,
    rounds: 1,
    walls: &[2, 4],
    wall_samples: 1,
    variations: true,
};

fn measure_bump(seed: u64) -> (SceneFacts, Vec<Row>) {
    let scene = Arc::new(headbox_scenes::build("bump", 0).expect("built in"));
    let headbox = scene.headbox.expect("it has one");
    let tracer = Arc::new(Tracer::new(scene, headbox.centre));
    let lighting = Lighting::measure(&tracer, 0);
    let ahead = axis_with_most_geometry(&tracer, headbox.centre);
    let plan = Plan::new(TINY, headbox.centre, headbox.half_size_m, ahead, seed).expect("valid");
    let subject = Subject {
        name: "builtin:bump".into(),
        tracer,
        lighting,
        lit: true,
        cube: None,
        sprites: None,
        view: None,
    };
    scene::run(&subject, &plan, None, &Silent).expect("measured")
}

static REPORT: LazyLock<Report> = LazyLock::new(|| {
    let (facts, rows) = measure_bump(3);
    Report {
        version: Report::VERSION,
        machine: Machine::here(),
        commit: "unknown".into(),
        program: "test".into(),
        seed: 3,
        quick: true,
        real: false,
        scenes: vec![facts],
        rows,
    }
});

/// Figures that must not depend on the clock.
fn errors(rows: &[Row]) -> Vec<String> {
    let timeless = |row: &Row| Row {
        ms_median: 0.0,
        ms_quartiles: [0.0; 2],
        time_ratio: 0.0,
        depth_pixels_m_per_s: 0.0,
        capture_s: row.capture_s.map(|_| 0.0),
        ..row.clone()
    };
    rows.iter()
        .map(|row| serde_json::to_string(&timeless(row)).expect("a row"))
        .collect()
}

#[test]
fn two_runs_agree_on_errors_to_the_last_digit() {
    let (facts, rows) = measure_bump(3);
    assert_eq!(errors(&rows), errors(&REPORT.rows));
    assert_eq!(facts, REPORT.scenes[0]);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(3)
        .build()
        .expect("threads");
    let (_, other_seed) = pool.install(|| measure_bump(4));
    assert_ne!(
        errors(&other_seed)[0],
        errors(&rows)[0],
        "another seed has other eyes"
    );
}

#[test]
fn every_group_has_one_baseline_and_plausible_rows() {
    let report = &*REPORT;
    let groups = report.groups("builtin:bump");
    let expected = [
        "representation",
        "footprints",
        CLIPPING,
        "threads",
        "near/far split",
        "primitives",
        "sampler",
        "rays",
        "layers",
        WALL,
        CURVE,
        "lumigraph's layers, as many as the curve asks for",
    ];
    for expected in expected {
        assert!(groups.contains(&expected), "{expected}: {groups:?}");
    }
    for group in groups {
        let rows: Vec<&Row> = report.group("builtin:bump", group).collect();
        assert!(rows.len() > 1, "{group}: something to compare with");
        let baseline: Vec<&&Row> = rows.iter().filter(|row| row.baseline).collect();
        assert_eq!(baseline.len(), 1, "{group}");
        assert!(
            baseline[0].psnr_to_baseline_db.is_infinite() && baseline[0].time_ratio == 1.0,
            "{group}"
        );
        assert!(
            rows.iter().all(|row| row.eyes == rows[0].eyes),
            "{group}: the same eyes for all"
        );
    }
    for row in &report.rows {
        assert!(
            (0.0..=1.0).contains(&row.flip) && row.psnr_db > 3.0 && row.ms_median > 0.0,
            "{row:?}"
        );
        let on_the_line = if row.eyes == EyeSet::Wall { 0 } else { 2 };
        assert!(
            row.worst.flip >= row.flip
                && row.displacement.len() == on_the_line
                && row.flicker.is_some(),
            "{row:?}"
        );
        // Without noise an error is smaller, except by chance.
        assert!(
            row.own_psnr_db.is_none_or(|own| own > row.psnr_db - 0.3),
            "{row:?}"
        );
    }
    let find =
        |group: &str, variant: &str| report.find("builtin:bump", group, variant).expect(variant);
    assert!(
        find(CLIPPING, "off").psnr_to_baseline_db.is_infinite(),
        "clipping changes no bit"
    );
    assert!(
        find("layers", "the nearest of each pixel (a depth image a face)").depth_pixels
            <= find("layers", "all").depth_pixels
    );
    let (samples, planes) = (
        find("primitives", "samples alone"),
        find("primitives", "planes within 0.5 px"),
    );
    assert!(
        planes.depth_pixels <= samples.depth_pixels && planes.bytes <= samples.bytes,
        "{planes:?}"
    );
    assert_eq!(
        planes.flip,
        find("representation", "LDI, what is flat on planes").flip,
        "one measurement, two groups"
    );
    let warp = report.group("builtin:bump", "incremental warp (single pixels, 1 thread)");
    // Rounding moves few pixels of 24x18 over a border, where they show the neighbour.
    assert!(warp.into_iter().all(|row| row.psnr_to_baseline_db > 25.0));
    let (rays, raster) = (
        find("representation", "1 ray/px, baked light"),
        find("representation", "rasterised, baked light"),
    );
    assert!(
        (rays.psnr_db - raster.psnr_db).abs() < 0.5,
        "{} {}",
        rays.psnr_db,
        raster.psnr_db
    );
    assert!(
        find("threads", "1 thread")
            .psnr_to_baseline_db
            .is_infinite()
    );
    assert!(
        find("depth bins", "8 px of parallax").depth_pixels
            <= find("depth bins", "1 px of parallax").depth_pixels
    );
    assert!(
        find("representation", "cube map").displacement[1].flip
            > find("representation", "cube map").displacement[0].flip
    );
}

#[test]
fn lumigraphs_are_judged_by_eyes_about_their_wall() {
    let facts = &REPORT.scenes[0];
    let walls: Vec<_> = facts
        .eyes
        .iter()
        .filter(|eye| eye.place == "wall")
        .collect();
    assert_eq!(walls.len(), 4);
    assert!(
        facts.eyes[facts.eyes.len() - 2..]
            .iter()
            .all(|eye| eye.place == "path"),
        "the path's are last"
    );
    let along = |eye: &EyeRecord| DVec3::from(eye.offset).dot(DVec3::from(walls[0].forward));
    let before = walls.iter().map(|eye| along(eye)).fold(0.0, f64::max);
    let behind = walls.iter().map(|eye| along(eye)).fold(0.0, f64::min);
    assert!(before > 0.1 && behind < -0.4, "from {behind} to {before}");
    let rows: Vec<&Row> = REPORT.group("builtin:bump", WALL).collect();
    let names: Vec<&str> = rows.iter().map(|row| row.variant.as_str()).collect();
    for expected in [
        "LDI",
        "sprites, two-pass",
        "lumigraph of 4x4 images, layers merged",
    ] {
        assert!(names.contains(&expected), "{expected}: {names:?}");
    }
    let merged = rows
        .iter()
        .find(|row| row.variant.ends_with("merged"))
        .expect("it is there");
    assert!(
        merged.hole_fraction < Some(0.02)
            && merged.psnr_db > 12.0
            && merged.bytes > 4 * 4 * 24 * 18 * 8,
        "{merged:?}"
    );
    // Fewer images need more layers.
    let layers = |row: &&Row| {
        row.variant
            .split(' ')
            .nth(2)
            .and_then(|n| n.parse::<u32>().ok())
            .expect("a number")
    };
    let curve: Vec<u32> = REPORT
        .group("builtin:bump", CURVE)
        .collect::<Vec<_>>()
        .iter()
        .map(layers)
        .collect();
    assert!(curve.len() == 2 && curve[0] > curve[1], "{curve:?}");
    assert!(summary::summary(&REPORT).contains("Of the points of a lumigraph's sampling curve **"));
}

/// R-N6 and the rates count a depth pixel once per frame, for any number of bands.
#[test]
fn depth_pixels_count_once_a_frame() {
    let find =
        |group: &str, variant: &str| REPORT.find("builtin:bump", group, variant).expect(variant);
    let (on, off) = (find(CLIPPING, "on"), find(CLIPPING, "off"));
    assert_eq!([on.threads, off.threads], [1, 1]);
    assert_eq!(
        off.depth_pixels_in, off.depth_pixels as f64,
        "without clipping all are looked at, once"
    );
    assert!(
        0.0 < on.depth_pixels_in && on.depth_pixels_in <= off.depth_pixels_in,
        "clipping leaves a part of them"
    );
    for row in &REPORT.rows {
        assert!(
            row.depth_pixels_in <= row.depth_pixels as f64,
            "{}, {}",
            row.group,
            row.variant
        );
    }
    // The default draws in bands; depth pixels in several bands count once.
    assert_eq!(
        find("representation", "LDI").depth_pixels_in,
        on.depth_pixels_in
    );
    let left = results::page(&REPORT, None);
    let left = left
        .lines()
        .find(|line| line.starts_with("| R-N6 |"))
        .expect("a claim");
    let share: f64 = left
        .split('|')
        .nth(4)
        .and_then(|cell| cell.trim().parse().ok())
        .expect("a share");
    assert!(
        (share - on.depth_pixels_in / on.depth_pixels as f64).abs() < 0.006,
        "{left}"
    );
}

#[test]
fn truth_error_matches_report() {
    let facts = &REPORT.scenes[0];
    assert_eq!(facts.eyes.len(), 9);
    assert!(
        facts
            .eyes
            .iter()
            .all(|eye| (4..=64).contains(&eye.truth_samples))
    );
    assert!(
        facts.margin_db >= 10.0 || facts.eyes.iter().any(|eye| eye.truth_samples == 64),
        "{facts:?}"
    );
}

#[test]
fn a_report_survives_its_file() {
    let json = serde_json::to_string(&*REPORT).expect("a report");
    assert_eq!(
        serde_json::from_str::<Report>(&json).expect("reads back"),
        *REPORT
    );
    for key in [
        "machine",
        "commit",
        "seed",
        "rows",
        "ms_median",
        "bytes",
        "flip",
        "psnr_db",
        "ssim",
        "hole_fraction",
    ] {
        assert!(json.contains(&format!("\"{key}\"")), "{key}");
    }
    let csv = REPORT.to_csv();
    let header = csv.lines().next().expect("a header").split(',').count();
    assert_eq!(csv.lines().count(), REPORT.rows.len() + 1);
    for line in csv.lines().filter(|line| !line.contains('"')) {
        assert_eq!(line.split(',').count(), header, "{line}");
    }
}

#[test]
fn sentences_agree_with_rows() {
    let text = summary::summary(&REPORT);
    let mut first = text.lines().filter(|line| !line.is_empty()).skip(1);
    let measured = first.next().expect("what was measured");
    assert!(
        measured.starts_with("Measured: ") && measured.contains(" px from faces of "),
        "{measured}"
    );
    let five: Vec<&str> = first.take_while(|line| line.starts_with("- **")).collect();
    assert_eq!(five.len(), 5, "{five:?}");
    let choice = text
        .lines()
        .find_map(|line| {
            line.strip_prefix("To look around, use **")?
                .split_once("**")
        })
        .expect("a choice")
        .0;
    assert!(five[0].contains(&format!("**{choice}**")), "{}", five[0]);
    let rows: Vec<&Row> = REPORT.group("builtin:bump", "representation").collect();
    let at: Vec<[f64; 2]> = rows.iter().map(|row| [row.ms_median, row.flip]).collect();
    let small = text.lines().find_map(|line| {
        line.strip_prefix("Where memory is short, use **")?
            .split_once("**")
    });
    let named = rows
        .iter()
        .find(|row| row.variant == small.expect("a choice").0)
        .expect("a row");
    let drawn = || rows.iter().filter(|row| !row.traces);
    let least = drawn().map(|row| row.flip).fold(f64::INFINITY, f64::min);
    assert!(
        !named.traces && named.flip <= 1.1 * least,
        "{}",
        named.variant
    );
    assert!(
        drawn().all(|row| row.bytes >= named.bytes || row.flip > 1.1 * least),
        "{}",
        named.variant
    );
    // The five lines name the same variant, or the choice itself.
    assert!(
        five[4].contains(&format!("**{}**", named.variant)) || named.variant == choice,
        "{}",
        five[4]
    );
    let front = pareto_front(&at);
    let sentence = text
        .lines()
        .find(|line| line.starts_with("Nothing is both"))
        .expect("the front");
    for (i, row) in rows.iter().enumerate() {
        let named = sentence.contains(&format!("**{}** (", row.variant));
        assert_eq!(named, front.contains(&i), "{}: {sentence}", row.variant);
        assert!(!named || sentence.contains(&format!("FLIP {:.3}", row.flip)));
    }
    for row in REPORT
        .rows
        .iter()
        .filter(|row| row.group != "representation")
    {
        let line = text
            .lines()
            .find(|line| line.starts_with(&format!("- **{}**", row.group)))
            .expect("a line");
        assert!(
            line.contains(&format!("*{}*", row.variant)),
            "{}: {line}",
            row.variant
        );
        let flip = row.psnr_to_baseline_db.is_infinite()
            || line.contains(&format!("FLIP {:.4}", row.flip));
        assert!(flip, "{}: {line}", row.variant);
    }
}

#[test]
fn charts_and_the_page_show_the_rows() {
    let figures = figures(&REPORT);
    let names: Vec<&str> = figures.iter().map(|figure| figure.name.as_str()).collect();
    assert_eq!(
        names,
        ["bump-time", "bump-displacement", "bump-bytes", "bump-rays"]
    );
    let rows = REPORT.group("builtin:bump", "representation").count();
    let points = |i: usize| {
        figures[i]
            .chart
            .series
            .iter()
            .map(|series| series.points.len())
            .sum::<usize>()
    };
    assert_eq!((points(0), points(2)), (rows, rows));
    assert!(
        figures
            .iter()
            .all(|figure| figure.chart.to_svg().contains("</svg>"))
    );
    let page = results::page(&REPORT, None);
    let own = REPORT
        .find("builtin:bump", "representation", "LDI")
        .and_then(|row| row.own_psnr_db)
        .expect("told");
    assert!(
        page.contains("| own dB |") && page.contains(&format!(" | {own:.2} | ")),
        "{own}"
    );
    for row in REPORT.group("builtin:bump", "representation") {
        let cells = format!(
            "| {:.2} | {:.2} | {:.4} | {:.2} |",
            row.ms_median, row.time_ratio, row.flip, row.psnr_db
        );
        let line = page
            .lines()
            .find(|line| line.starts_with(&format!("| {} ", row.variant)))
            .expect("a line");
        assert!(line.contains(&cells), "{line}");
    }
    assert!(page.contains("(results/bump-time.svg)"));
    let fastest = page.split("**").nth(1).expect("a choice");
    assert!(
        REPORT
            .find("builtin:bump", "representation", fastest)
            .is_some_and(|row| !row.traces),
        "{fastest}"
    );
    let clipping = page
        .lines()
        .find(|line| line.starts_with("| S-N6 |"))
        .expect("a claim");
    let ratio = REPORT
        .find("builtin:bump", CLIPPING, "off")
        .expect("a row")
        .time_ratio;
    assert!(
        clipping.ends_with(&format!("| 3.00 | {} |", figure(ratio))),
        "{clipping}"
    );
}
