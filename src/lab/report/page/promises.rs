//! Claims of the README, tested against the rows of a report.

use super::figures::short;
use crate::report::row::{Report, Row, SceneFacts};
use crate::table::{Table, figure};

/// A claim of the README and the measured value that it depends on.
pub struct Promise {
    /// Words of the README.
    pub says: &'static str,
    /// Description of the value.
    pub quantity: &'static str,
    /// Reads the value of a scene; `None` if the scene has none.
    pub value: fn(&Report, &SceneFacts) -> Option<f64>,
    /// Condition on the values of all scenes.
    pub condition: PromiseCondition,
    /// True for a time, which is shown but not tested.
    pub is_time: bool,
}

/// Condition on the values of all scenes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PromiseCondition {
    /// Each value is between these bounds, inclusive.
    Within([f64; 2]),
    /// The largest value is at most this multiple of the least.
    Alike(f64),
}

impl PromiseCondition {
    /// Returns true if `figures`, one value per scene, satisfy the condition; false without values.
    pub fn holds(self, figures: &[f64]) -> bool {
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

    fn describe(self) -> String {
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

/// Claims of the README that a report can test.
pub const PROMISES: [Promise; 6] = [
    Promise {
        says: "without holes",
        quantity: "share of the LDI's pixels that are holes, %",
        value: |report, facts| Some(ldi(report, facts)?.hole_fraction? * 100.0),
        condition: PromiseCondition::Within([f64::NEG_INFINITY, 0.1]),
        is_time: false,
    },
    Promise {
        says: "with parallax",
        quantity: "FLIP in a corner of the headbox, the LDI's over a cube map's",
        value: |report, facts| {
            let corner = |row: &Row| Some(row.displacement.last()?.flip);
            Some(
                corner(ldi(report, facts)?)?
                    / corner(report.find(&facts.scene, "representation", "cube map")?)?,
            )
        },
        condition: PromiseCondition::Within([0.0, 1.0]),
        is_time: false,
    },
    Promise {
        says: "a frame rate that depends neither on the number of triangles",
        quantity: "nanoseconds of a frame for each depth pixel in view, one thread",
        value: |report, facts| {
            let row = report.find(&facts.scene, "threads", "1 thread")?;
            Some(row.ms_median * 1e6 / row.depth_pixels_in)
        },
        condition: PromiseCondition::Alike(4.0),
        is_time: true,
    },
    Promise {
        says: "nor on the lighting",
        quantity: "time of a frame whose depth pixels were lit with four times the samples, over the default's",
        value: |report, facts| {
            Some(
                report
                    .find(&facts.scene, "light samples", "16 per depth pixel")?
                    .time_ratio,
            )
        },
        condition: PromiseCondition::Within([0.9, 1.1]),
        is_time: true,
    },
    Promise {
        says: "traced until its own error lies 10 dB below what is measured",
        quantity: "by how much it does, dB",
        value: |_, facts| Some(facts.margin_db),
        condition: PromiseCondition::Within([10.0, f64::INFINITY]),
        is_time: false,
    },
    Promise {
        says: "a built-in scene of half a million triangles",
        quantity: "triangles of builtin:tree",
        value: |_, facts| (facts.scene == "builtin:tree").then_some(facts.triangles as f64),
        condition: PromiseCondition::Within([5e5, f64::INFINITY]),
        is_time: false,
    },
];

impl Promise {
    /// Returns the values of the scenes that have one.
    pub fn figures(&self, report: &Report) -> Vec<f64> {
        report
            .scenes
            .iter()
            .filter_map(|facts| (self.value)(report, facts))
            .collect()
    }
}

/// Formats a table of all claims with their values.
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
            .map(|facts| (promise.value)(report, facts).map_or("-".into(), figure));
        let verdict = match promise.figures(report).as_slice() {
            [] => "not measured",
            figures if promise.condition.holds(figures) => "kept",
            _ => "**not kept**",
        };
        let ends = [format!("*{}*", promise.says), promise.quantity.into()];
        table.row(
            ends.into_iter()
                .chain(figures)
                .chain([promise.condition.describe(), verdict.into()]),
        );
    }
    table
}

/// Returns the README's words of false claims, apart from times, which a busy machine distorts.
pub fn broken(report: &Report) -> Vec<&'static str> {
    let is_broken = |promise: &&Promise| {
        let figures = promise.figures(report);
        !promise.is_time && !figures.is_empty() && !promise.condition.holds(&figures)
    };
    PROMISES
        .iter()
        .filter(is_broken)
        .map(|promise| promise.says)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn promises_can_be_broken() {
        let at_most = PromiseCondition::Within([f64::NEG_INFINITY, 0.1]);
        assert!(at_most.holds(&[0.0, 0.1]) && !at_most.holds(&[0.0, 0.11]) && !at_most.holds(&[]));
        assert!(!at_most.holds(&[f64::NAN]));
        assert!(
            PromiseCondition::Alike(3.0).holds(&[1.0, 2.9])
                && !PromiseCondition::Alike(3.0).holds(&[1.0, 3.1, 2.0])
        );
        assert!(
            !PromiseCondition::Alike(3.0).holds(&[])
                && !PromiseCondition::Alike(3.0).holds(&[f64::NAN])
        );
    }
}
