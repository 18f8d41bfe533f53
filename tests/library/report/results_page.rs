//! `docs/results.md`, its charts and its CSV file are generated from the recorded reports and not
//! edited by hand.

use headbox_lab::report::figures::figures;
use headbox_lab::report::promises::PROMISES;
use headbox_lab::report::results;
use headbox_lab::report::row::Report;
use headbox_lab::walk::WalkReport;
use std::path::Path;

fn docs(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("docs")
        .join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
fn page_and_charts_match_recorded_report() {
    let report: Report = serde_json::from_str(&docs("results/report.json")).expect("a report");
    let has_walk = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("docs/results/walk.json")
        .exists();
    let walk: Option<WalkReport> = has_walk
        .then(|| serde_json::from_str(&docs("results/walk.json")).expect("a report of a walk"));
    let remake = "remake it: headbox report --results docs/results/report.json --walk docs/results/walk.json -o docs/results.md";
    assert!(
        docs("results.md") == results::page(&report, walk.as_ref()),
        "{remake}"
    );
    assert!(docs("results/report.csv") == report.to_csv(), "{remake}");
    if let Some(walk) = walk {
        assert!(
            docs("results/along-path.svg") == walk.chart().to_svg(),
            "{remake}"
        );
    }
    for figure in figures(&report) {
        assert!(
            docs(&format!("results/{}.svg", figure.name)) == figure.chart.to_svg(),
            "{remake}"
        );
    }
}

/// Words of a text, with single spaces between them.
fn words(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// CI measures the promises themselves (`headbox report --quick --promises`).
#[test]
fn readme_states_only_tested_figures() {
    let readme = words(&docs("../README.md"));
    for promise in PROMISES {
        assert!(
            readme.contains(promise.says),
            "the README no longer says \"{}\"",
            promise.says
        );
    }
    // Any other number with a unit would be an untested figure; one is promised above.
    let words: Vec<&str> = readme.split(' ').collect();
    let units = ["ms", "dB", "fps", "times", "Mrays/s", "%"];
    let is_figure = |pair: &&[&str]| {
        let number = pair[0].trim_start_matches('(').parse::<f64>().is_ok() || pair[0] == "FLIP";
        let unit = pair[1].trim_matches(|c: char| !c.is_alphanumeric() && c != '%');
        (number && (units.contains(&unit) || unit.parse::<f64>().is_ok())) || unit.ends_with('%')
    };
    let figures: Vec<&[&str]> = words.windows(2).filter(is_figure).collect();
    assert_eq!(figures, [["10", "dB"]], "measured figures in the README");
}
