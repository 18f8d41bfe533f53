//! Every hard case of STABILITY.md holds its bound. `headbox report --stability` writes the page
//! with more seeds.

use headbox_lab::stability;
use headbox_lab::stability::Case;

/// Seeds of each case in this test; the page has more.
const SEEDS: std::ops::Range<u64> = 0..3;

fn all_hold(topic: usize) {
    let (name, cases) = stability::topics().into_iter().nth(topic).expect("a topic");
    assert!(!cases.is_empty());
    let broken: Vec<String> = cases.iter().filter_map(broken).collect();
    assert!(broken.is_empty(), "{name}:\n{}", broken.join("\n"));
}

fn broken(case: &Case) -> Option<String> {
    let worst = case.worst(SEEDS);
    println!(
        "{}: {} {} (bound {}, seed {})",
        case.name, worst.value, case.unit, case.bound, worst.seed
    );
    (!case.holds(worst.value)).then(|| {
        format!(
            "{}: {} of {} with seed {}",
            case.name, worst.value, case.bound, worst.seed
        )
    })
}

#[test]
fn where_the_eye_is() {
    all_hold(0);
}

#[test]
fn where_the_scene_is_and_how_large() {
    all_hold(1);
}

#[test]
fn cameras_and_sizes() {
    all_hold(2);
}

#[test]
fn arithmetic() {
    all_hold(3);
}

#[test]
fn surfaces_and_layers() {
    all_hold(4);
}

#[test]
fn sprites() {
    all_hold(5);
}

#[test]
fn portals() {
    all_hold(6);
}

#[test]
fn lumigraphs() {
    all_hold(7);
}

#[test]
fn photographs() {
    all_hold(8);
}

#[test]
fn names_are_unique_and_broken_bound_fails() {
    let cases: Vec<Case> = stability::topics()
        .into_iter()
        .flat_map(|(_, cases)| cases)
        .collect();
    let mut names: Vec<&str> = cases.iter().map(|case| case.name).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), cases.len());
    assert_eq!(stability::topics().len(), 9, "every topic has a test above");
    let case = |measure| Case {
        name: "",
        what: "",
        unit: "",
        bound: 1.0,
        reason: "",
        measure,
    };
    let of = |case: Case| case.worst(0..3);
    assert_eq!(
        (
            of(case(|seed| Some(seed as f64))).value,
            of(case(|seed| Some(seed as f64))).seed
        ),
        (2.0, 2)
    );
    assert!(broken(&case(|seed| Some(seed as f64))).is_some());
    assert!(broken(&case(|_| Some(1.0))).is_none());
    assert!(
        broken(&case(|_| None)).is_some(),
        "what cannot be measured does not hold"
    );
    assert!(broken(&case(|seed| Some(if seed == 1 { f64::NAN } else { 0.0 }))).is_some());
}
