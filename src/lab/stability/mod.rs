//! Hard numerical cases: measurements with a bound and the reason for the bound.
//!
//! `tests/library/report/stability.rs` tests each case with a few seeds;
//! `headbox report --stability` measures more seeds and writes `STABILITY.md`. A case is a function
//! of a seed, so that its results are reproducible.

mod arithmetic;
mod cameras;
mod eyes;
mod fixtures;
mod layers;
mod lumigraphs;
mod photos;
mod places;
mod portals;
mod sprites;

use crate::machine::{Machine, commit};
use crate::table::{Table, figure};
use std::fmt::Write;
use std::ops::Range;

/// One hard case.
pub struct Case {
    /// Unique short name.
    pub name: &'static str,
    /// Description of the case.
    pub what: &'static str,
    /// Unit of the measured value.
    pub unit: &'static str,
    /// Upper bound of the measured value; infinite for a known limit, where the value need only be
    /// finite.
    pub bound: f64,
    /// Reason for the bound.
    pub reason: &'static str,
    /// Measures the value; `None` if an input could not be created, which exceeds every bound.
    pub measure: fn(seed: u64) -> Option<f64>,
}

/// Largest value of a case.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Worst {
    /// The value; infinite if it could not be measured.
    pub value: f64,
    /// First seed with this value.
    pub seed: u64,
}

impl Case {
    /// Returns the largest value over a non-empty range of seeds.
    pub fn worst(&self, seeds: Range<u64>) -> Worst {
        let measured = seeds.map(|seed| Worst {
            value: (self.measure)(seed).unwrap_or(f64::INFINITY),
            seed,
        });
        let larger = |a: Worst, b: Worst| {
            if b.value > a.value || b.value.is_nan() {
                b
            } else {
                a
            }
        };
        measured.reduce(larger).unwrap_or(Worst {
            value: f64::INFINITY,
            seed: 0,
        })
    }

    /// Returns true if a value is finite and within the bound.
    pub fn holds(&self, value: f64) -> bool {
        value.is_finite() && value <= self.bound
    }
}

/// Returns a small captured room for tests of other modules.
#[cfg(test)]
pub(crate) fn room() -> Option<&'static headbox_cube::pack::CubeLdi> {
    Some(&fixtures::ROOM.as_ref()?.cube)
}

/// Returns all cases by topic.
pub fn topics() -> [(&'static str, Vec<Case>); 9] {
    [
        ("Where the eye is", eyes::cases()),
        ("Where the scene is, and how large", places::cases()),
        ("Cameras and sizes", cameras::cases()),
        ("Arithmetic", arithmetic::cases()),
        ("Surfaces and layers", layers::cases()),
        ("Sprites", sprites::cases()),
        ("Portals", portals::cases()),
        ("Lumigraphs", lumigraphs::cases()),
        ("Photographs", photos::cases()),
    ]
}

/// Parses a page: returns the name of each case and true if its bound held; `None` without cases.
pub fn verdicts(page: &str) -> Option<Vec<(String, bool)>> {
    let rows = page.lines().filter_map(|line| {
        let mut cells = line.strip_prefix("| ")?.split(" | ");
        let (name, measured) = (cells.next()?, cells.next()?);
        (name != "case" && name != "---")
            .then(|| (name.to_owned(), !measured.ends_with("**exceeded**")))
    });
    let verdicts: Vec<(String, bool)> = rows.collect();
    (!verdicts.is_empty()).then_some(verdicts)
}

/// Lists the differences between the verdicts of two pages, a line each.
pub fn differences(before: &[(String, bool)], now: &[(String, bool)]) -> Vec<String> {
    let mut names: Vec<&String> = before.iter().chain(now).map(|(name, _)| name).collect();
    names.sort_unstable();
    names.dedup();
    let verdict = |verdicts: &[(String, bool)], name: &String| match verdicts
        .iter()
        .find(|(other, _)| other == name)
    {
        Some((_, true)) => "held",
        Some((_, false)) => "exceeded",
        None => "absent",
    };
    names
        .into_iter()
        .map(|name| (name, verdict(before, name), verdict(now, name)))
        .filter(|(_, before, now)| before != now)
        .map(|(name, before, now)| format!("{name}: {before} before, {now} now"))
        .collect()
}

/// Measures all cases over `seeds`; returns `STABILITY.md` and true if all bounds hold. `progress`
/// receives the name of each case.
pub fn page(seeds: Range<u64>, mut progress: impl FnMut(&str)) -> (String, bool) {
    let mut text = format!(
        "# Numerical stability\n\nMade by `headbox report --stability`, commit {}, {}; `cargo test --test library stability` holds every case to its \
         bound on fewer seeds. Measured: the largest value over seeds {} to {}, and the seed that gave it. Levels are those \
         of 8-bit channels.\n",
        commit(),
        Machine::here().simd,
        seeds.start,
        seeds.end.saturating_sub(1)
    );
    let mut all_hold = true;
    for (topic, cases) in topics() {
        let mut table = Table::new([
            "case",
            "measured",
            "bound",
            "seed",
            "what, and why this bound",
        ]);
        for case in cases {
            progress(case.name);
            let worst = case.worst(seeds.clone());
            let holds = case.holds(worst.value);
            all_hold &= holds;
            let measured = format!("{} {}", figure(worst.value), case.unit);
            let verdict = if holds { "" } else { " **exceeded**" };
            let bound = if case.bound.is_finite() {
                figure(case.bound)
            } else {
                "none: a known limit".into()
            };
            let why = format!("{} *{}*", case.what, case.reason);
            table.row([
                case.name,
                &(measured.trim_end().to_owned() + verdict),
                &bound,
                &worst.seed.to_string(),
                &why,
            ]);
        }
        // Writing to a string cannot fail.
        let _ = write!(text, "\n## {topic}\n\n{table}");
    }
    (text, all_hold)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verdicts_are_read_from_a_page() {
        let page = "# Numerical stability\n\n| case | measured | bound |\n| --- | --- | --- |\n| a | 1 px | 2 |\n| b | 3 px **exceeded** | 2 |\n";
        let before = verdicts(page).expect("a page");
        assert_eq!(before, [("a".into(), true), ("b".into(), false)]);
        assert_eq!(verdicts("nothing"), None);
        let now = [("b".to_owned(), true), ("c".to_owned(), true)];
        let expected = [
            "a: held before, absent now",
            "b: exceeded before, held now",
            "c: absent before, held now",
        ];
        assert_eq!(differences(&before, &now), expected);
        assert!(differences(&before, &before).is_empty());
    }
}
