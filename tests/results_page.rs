//! The page of results is what the command makes of its own file, and nothing else.

use headbox::report::figures::figures;
use headbox::report::promises::PROMISES;
use headbox::report::results;
use headbox::report::row::Report;
use std::path::Path;

fn docs(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs").join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
fn the_page_and_its_charts_come_from_the_report_beside_them() {
    let report: Report = serde_json::from_str(&docs("results/report.json")).expect("a report");
    let remake = "remake it: headbox report --results docs/results/report.json -o docs/results.md";
    assert!(docs("results.md") == results::page(&report), "{remake}");
    for figure in figures(&report) {
        assert!(docs(&format!("results/{}.svg", figure.name)) == figure.chart.draw().to_svg(), "{remake}");
    }
}

/// Words of a text, with single spaces between them.
fn words(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn the_readme_says_what_the_report_shows() {
    let report: Report = serde_json::from_str(&docs("results/report.json")).expect("a report");
    let readme = words(&docs("../README.md"));
    for promise in PROMISES {
        assert!(readme.contains(promise.says), "the README no longer says \"{}\"", promise.says);
        let figures = promise.figures(&report);
        assert!(promise.keeps.hold(&figures), "{}: {figures:?}", promise.says);
    }
    // Whatever else carries a unit of measurement would be a figure that nothing stands behind.
    let measured = ["ms", "dB", "FLIP", "fps", "Mrays/s", "%"];
    let allowed = ["10 dB below", "prints FLIP, PSNR and SSIM"];
    let rest = allowed.iter().fold(readme, |text, known| text.replace(known, ""));
    let trimmed = |word: &str| word.trim_matches(|c: char| !c.is_alphanumeric() && c != '%').to_owned();
    let figure = rest.split(' ').find(|word| measured.contains(&trimmed(word).as_str()) || word.ends_with('%'));
    assert_eq!(figure, None, "a measured figure in the README");
}
