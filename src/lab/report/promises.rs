//! Promises of the README, tested against the rows of a report.

use super::figures::short;
use super::row::{Report, Row, SceneFacts};
use crate::table::{Table, figure};

/// A sentence's part and the figure that it stands or falls with.
pub struct Promise {
    /// Words of the README.
    pub says: &'static str,
    /// Quantity measured in each scene.
    pub what: &'static str,
    /// The figure; `None` where a scene cannot tell.
    pub of: fn(&Report, &SceneFacts) -> Option<f64>,
    /// Condition of the promise.
    pub keeps: PromiseCondition,
    /// True for a time: it is shown, and decides nothing.
    pub is_time: bool,
}

/// When figures keep a promise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PromiseCondition {
    /// Each scene's lies between these.
    Within([f64; 2]),
    /// The largest of all scenes is at most so many times the least.
    Alike(f64),
}

impl PromiseCondition {
    /// Returns true if the figures of all scenes keep the promise; false if there are none.
    pub fn hold(self, figures: &[f64]) -> bool {
        match self {
            Self::Within([least, most]) => {
                !figures.is_empty() && figures.iter().all(|v| (least..=most).contains(v))
            }
            Self::Alike(times) => {
                let least = figures.iter().copied().fold(f64::INFINITY, f64::min);
                let most = figures.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                !figures.is_empty() && figures.iter().all(|v| *v > 0.0) && most <= least * times
            }
        }
    }

    fn words(self) -> String {
        match self {
            Self::Within([least, most]) if least == f64::NEG_INFINITY => format!("at most {most}"),
            Self::Within([least, most]) if most == f64::INFINITY => format!("at least {least}"),
            Self::Within([least, most]) => format!("{least} to {most}"),
            Self::Alike(times) => format!("the largest at most {times} times the least"),
        }
    }
}

fn ldi<'a>(report: &'a Report, facts: &SceneFacts) -> Option<&'a Row> {
    report.find(&facts.scene, "representation", "LDI")
}

/// All that the README promises and a report can measure.
pub const PROMISES: [Promise; 6] = [
    Promise {
        says: "without holes",
        what: "share of the LDI's pixels that are holes, %",
        of: |report, facts| Some(ldi(report, facts)?.hole_fraction? * 100.0),
        keeps: PromiseCondition::Within([f64::NEG_INFINITY, 0.1]),
        is_time: false,
    },
    Promise {
        says: "with parallax",
        what: "FLIP in a corner of the headbox, the LDI's over a cube map's",
        of: |report, facts| {
            let corner = |row: &Row| Some(row.displacement.last()?.flip);
            Some(
                corner(ldi(report, facts)?)?
                    / corner(report.find(&facts.scene, "representation", "cube map")?)?,
            )
        },
        keeps: PromiseCondition::Within([0.0, 1.0]),
        is_time: false,
    },
    Promise {
        says: "a frame rate that depends neither on the number of triangles",
        what: "nanoseconds of a frame for each depth pixel in view, one thread",
        of: |report, facts| {
            let row = report.find(&facts.scene, "threads", "1 thread")?;
            Some(row.ms_median * 1e6 / row.depth_pixels_in)
        },
        keeps: PromiseCondition::Alike(4.0),
        is_time: true,
    },
    Promise {
        says: "nor on the lighting",
        what: "time of a frame whose depth pixels were lit with four times the samples, over the default's",
        of: |report, facts| {
            Some(
                report
                    .find(&facts.scene, "light samples", "16 per depth pixel")?
                    .time_ratio,
            )
        },
        keeps: PromiseCondition::Within([0.9, 1.1]),
        is_time: true,
    },
    Promise {
        says: "traced until its own error lies 10 dB below what is measured",
        what: "by how much it does, dB",
        of: |_, facts| Some(facts.margin_db),
        keeps: PromiseCondition::Within([10.0, f64::INFINITY]),
        is_time: false,
    },
    Promise {
        says: "a built-in scene of half a million triangles",
        what: "triangles of builtin:tree",
        of: |_, facts| (facts.scene == "builtin:tree").then_some(facts.triangles as f64),
        keeps: PromiseCondition::Within([5e5, f64::INFINITY]),
        is_time: false,
    },
];

impl Promise {
    /// The figures of the scenes that have one.
    pub fn figures(&self, report: &Report) -> Vec<f64> {
        report
            .scenes
            .iter()
            .filter_map(|facts| (self.of)(report, facts))
            .collect()
    }
}

/// A table of all promises that a report can tell of.
pub fn table(report: &Report) -> Table {
    let names = report.scenes.iter().map(|facts| short(&facts.scene));
    let mut table = Table::new(
        ["README", "measured"]
            .into_iter()
            .chain(names)
            .chain(["kept if", ""]),
    );
    for promise in PROMISES {
        let figures = report
            .scenes
            .iter()
            .map(|facts| (promise.of)(report, facts).map_or("-".into(), figure));
        let kept = match promise.figures(report).as_slice() {
            [] => "not measured",
            found if promise.keeps.hold(found) => "kept",
            _ => "**not kept**",
        };
        let ends = [format!("*{}*", promise.says), promise.what.into()];
        table.row(
            ends.into_iter()
                .chain(figures)
                .chain([promise.keeps.words(), kept.into()]),
        );
    }
    table
}

/// Names the broken promises of the README; those of time are left to the reader, since a busy
/// machine breaks them.
pub fn broken(report: &Report) -> Vec<&'static str> {
    let told = |promise: &&Promise| !promise.figures(report).is_empty();
    let broken = |promise: &&Promise| !promise.keeps.hold(&promise.figures(report));
    PROMISES
        .iter()
        .filter(|promise| !promise.is_time)
        .filter(told)
        .filter(broken)
        .map(|promise| promise.says)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn promises_can_be_broken() {
        let at_most = PromiseCondition::Within([f64::NEG_INFINITY, 0.1]);
        assert!(at_most.hold(&[0.0, 0.1]) && !at_most.hold(&[0.0, 0.11]) && !at_most.hold(&[]));
        assert!(!at_most.hold(&[f64::NAN]));
        assert!(
            PromiseCondition::Alike(3.0).hold(&[1.0, 2.9])
                && !PromiseCondition::Alike(3.0).hold(&[1.0, 3.1, 2.0])
        );
        assert!(
            !PromiseCondition::Alike(3.0).hold(&[])
                && !PromiseCondition::Alike(3.0).hold(&[f64::NAN])
        );
    }
}
