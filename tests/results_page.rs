//! The page of results is what the command makes of its own file, and nothing else.

use headbox::report::figures::figures;
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
    for facts in &report.scenes {
        assert!(facts.margin_db >= 9.0, "truth is good enough: {}", facts.scene);
    }
}
