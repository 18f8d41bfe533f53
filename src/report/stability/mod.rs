//! Hard numerical cases: each a measurement with a bound and the bound's reason.
//!
//! `tests/library/stability.rs` holds each case to its bound on a few seeds; `headbox report --stability` measures more of
//! them and writes `STABILITY.md`. A case is a function of a seed, so that whatever it finds can be found again.

mod arithmetic;
mod bed;
mod cameras;
mod eyes;
mod layers;
mod places;
mod portals;
mod sprites;

use std::fmt::Write;
use std::ops::Range;

/// One hard case.
pub struct Case {
    /// Unique, short.
    pub name: &'static str,
    /// What is done and what is measured.
    pub what: &'static str,
    /// Unit of what is measured.
    pub unit: &'static str,
    /// What is measured must not exceed this; infinite for a known limit, where it need only be measurable.
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
        let measured = seeds.map(|seed| Worst { value: (self.measure)(seed).unwrap_or(f64::INFINITY), seed });
        let larger = |a: Worst, b: Worst| if b.value > a.value || b.value.is_nan() { b } else { a };
        measured.reduce(larger).unwrap_or(Worst { value: f64::INFINITY, seed: 0 })
    }

    /// Whether a value is within the bound; NaN and infinity never are.
    pub fn holds(&self, value: f64) -> bool {
        value.is_finite() && value <= self.bound
    }
}

/// A small captured room, for tests elsewhere.
#[cfg(test)]
pub(crate) fn room() -> Option<&'static crate::packed::PackedCube> {
    Some(&bed::ROOM.as_ref()?.cube)
}

/// All cases, by topic.
pub fn topics() -> [(&'static str, Vec<Case>); 7] {
    [
        ("Where the eye is", eyes::cases()),
        ("Where the scene is, and how large", places::cases()),
        ("Cameras and sizes", cameras::cases()),
        ("Arithmetic", arithmetic::cases()),
        ("Surfaces and layers", layers::cases()),
        ("Sprites", sprites::cases()),
        ("Portals", portals::cases()),
    ]
}

/// What has no case, and why.
const ABSENT: &str = "\n## Hard cases of the papers that have none here\n\nMerging the layers of a light field seen from before its \
    camera plane, ranking cameras none of which is valid, and triangulating grid points in a line (lumigraphs and \
    view-dependent geometry): nothing of these methods is built.\n";

/// `STABILITY.md`: every case with its bound, and the worst of some seeds. `progress` is told each case's name.
pub fn page(seeds: Range<u64>, mut progress: impl FnMut(&str)) -> (String, bool) {
    let mut text = format!(
        "# Numerical stability\n\nMade by `headbox report --stability`; `cargo test --test library stability` holds every case to its \
         bound on fewer seeds. Measured: the largest value over seeds {} to {}, and the seed that gave it. Levels are those \
         of 8-bit channels.\n",
        seeds.start,
        seeds.end.saturating_sub(1)
    );
    let mut all_hold = true;
    for (topic, cases) in topics() {
        let _ = write!(
            text,
            "\n## {topic}\n\n| case | measured | bound | seed | what, and why this bound |\n|---|---|---|---|---|\n"
        );
        for case in cases {
            progress(case.name);
            let worst = case.worst(seeds.clone());
            let holds = case.holds(worst.value);
            all_hold &= holds;
            let _ = writeln!(
                text,
                "| {} | {} {}{} | {} | {} | {} *{}* |",
                case.name,
                figure(worst.value),
                case.unit,
                if holds { "" } else { " **exceeded**" },
                if case.bound.is_finite() { figure(case.bound) } else { "none: a known limit".into() },
                worst.seed,
                case.what,
                case.reason,
            );
        }
    }
    text += ABSENT;
    (text, all_hold)
}

/// Three digits.
fn figure(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        size if !size.is_finite() => "not measurable".into(),
        size if (0.001..10_000.0).contains(&size) => {
            let text = format!("{value:.3}");
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        }
        _ => format!("{value:.1e}"),
    }
}
