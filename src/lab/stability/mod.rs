//! Hard numerical cases: each a measurement with a bound and the bound's reason.
//!
//! `tests/library/stability.rs` holds each case to its bound on a few seeds; `headbox report
//! --stability` measures more of them and writes `STABILITY.md`. A case is a function of a seed, so
//! that whatever it finds can be found again.

mod arithmetic;
mod bed;
mod cameras;
mod eyes;
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
    /// Unique, short.
    pub name: &'static str,
    /// Description of the case.
    pub what: &'static str,
    /// Unit of what is measured.
    pub unit: &'static str,
    /// Upper bound of the measured value; infinite for a known limit, where it need only be
    /// measurable.
    pub bound: f64,
    /// Why this bound and not another.
    pub reason: &'static str,
    /// The measurement; `None` if something could not even be made, which no bound allows.
    pub measure: fn(seed: u64) -> Option<f64>,
}

/// The largest value that a case showed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Worst {
    /// The value; infinite where nothing could be measured.
    pub value: f64,
    /// The first seed that showed it.
    pub seed: u64,
}

impl Case {
    /// The largest value over some seeds, at least one.
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

    /// Returns true if a value is within the bound; NaN and infinity never are.
    pub fn holds(&self, value: f64) -> bool {
        value.is_finite() && value <= self.bound
    }
}

/// A small captured room, for tests elsewhere.
#[cfg(test)]
pub(crate) fn room() -> Option<&'static headbox_cube::pack::CubeLdi> {
    Some(&bed::ROOM.as_ref()?.cube)
}

/// All cases, by topic.
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

/// Parses a page: the name of each case, and whether its bound held. `None` if the text is not such
/// a page.
pub fn verdicts(page: &str) -> Option<Vec<(String, bool)>> {
    let rows = page.lines().filter_map(|line| {
        let mut cells = line.strip_prefix("| ")?.split(" | ");
        let (name, measured) = (cells.next()?, cells.next()?);
        (name != "case" && name != "---")
            .then(|| (name.to_owned(), !measured.ends_with("**exceeded**")))
    });
    let found: Vec<(String, bool)> = rows.collect();
    (!found.is_empty()).then_some(found)
}

/// Differences between the verdicts of two pages, a line each.
pub fn differences(before: &[(String, bool)], now: &[(String, bool)]) -> Vec<String> {
    let word = |verdict: Option<&(String, bool)>| match verdict {
        Some((_, true)) => "held",
        Some((_, false)) => "exceeded",
        None => "absent",
    };
    let mut names: Vec<&String> = before.iter().chain(now).map(|(name, _)| name).collect();
    names.sort_unstable();
    names.dedup();
    let of = |verdicts: &'_ [(String, bool)], name: &String| {
        word(verdicts.iter().find(|(other, _)| other == name))
    };
    let differs = names
        .into_iter()
        .filter(|name| of(before, name) != of(now, name));
    differs
        .map(|name| format!("{name}: {} before, {} now", of(before, name), of(now, name)))
        .collect()
}

/// `STABILITY.md`: every case with its bound, and the worst of some seeds. `progress` is told each
/// case's name.
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
        let found = verdicts(page).expect("a page");
        assert_eq!(found, [("a".into(), true), ("b".into(), false)]);
        assert_eq!(verdicts("nothing"), None);
        let now = [("b".to_owned(), true), ("c".to_owned(), true)];
        let expected = [
            "a: held before, absent now",
            "b: exceeded before, held now",
            "c: absent before, held now",
        ];
        assert_eq!(differences(&found, &now), expected);
        assert!(differences(&found, &found).is_empty());
    }
}
