//! Axes: the map from values to positions, and round tick values.

/// An axis of a chart.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Axis {
    /// Quantity and unit.
    pub name: String,
    /// True for a logarithmic axis.
    pub is_logarithmic: bool,
}

impl Axis {
    /// Creates a linear axis.
    pub fn linear(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            is_logarithmic: false,
        }
    }

    /// Creates a logarithmic axis.
    pub fn logarithmic(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            is_logarithmic: true,
        }
    }
}

/// Number of labelled ticks that fit on an axis.
const MAX_TICKS: f64 = 12.0;

/// Map from values to pixels.
pub(super) struct Scale {
    is_logarithmic: bool,
    /// Range of values, or of their logarithms to base 10.
    low: f64,
    high: f64,
    /// Positions of both ends.
    pub(super) pixels: [f64; 2],
}

impl Scale {
    /// Spans all values that the axis can show, with a margin. A linear scale without negative
    /// values starts at 0.
    pub(super) fn new(axis: &Axis, pixels: [f64; 2], values: impl Iterator<Item = f64>) -> Self {
        let is_logarithmic = axis.is_logarithmic;
        // Magnitudes beyond 1e15, and on a logarithmic axis below 1e-15, are not shown.
        let largest = if is_logarithmic { 15.0 } else { 1e15 };
        let start = if is_logarithmic {
            [f64::INFINITY, f64::NEG_INFINITY]
        } else {
            [0.0; 2]
        };
        let values = values.map(|value| if is_logarithmic { value.log10() } else { value });
        let shown = values.filter(|value| value.abs() <= largest);
        let [low, high] = shown.fold(start, |[low, high], value| {
            [low.min(value), high.max(value)]
        });
        if low > high || (!is_logarithmic && high - low < 1e-15) {
            return Self {
                is_logarithmic,
                low: 0.0,
                high: 1.0,
                pixels,
            };
        }
        // Ticks of a short logarithmic axis are at most a factor of 1.5 apart: a factor of 2.5
        // contains two.
        let span = if is_logarithmic {
            (high - low).max(0.4)
        } else {
            high - low
        };
        let margin = |end: f64| {
            if !is_logarithmic && end == 0.0 {
                0.0
            } else {
                0.05 * span
            }
        };
        let missing = 0.5 * (span - (high - low));
        Self {
            is_logarithmic,
            low: low - margin(low) - missing,
            high: high + margin(high) + missing,
            pixels,
        }
    }

    /// Returns the position of a value, not finite if the axis cannot show it.
    pub(super) fn position(&self, value: f64) -> f64 {
        let value = if self.is_logarithmic {
            value.log10()
        } else {
            value
        };
        let [start, end] = self.pixels;
        start + (value - self.low) / (self.high - self.low) * (end - start)
    }

    /// Returns round values within the range.
    pub(super) fn ticks(&self) -> Vec<f64> {
        let span = self.high - self.low;
        if self.is_logarithmic {
            let factors: &[f64] = match MAX_TICKS / span {
                ..3.0 => &[1.0],
                ..10.0 => &[1.0, 2.0, 5.0],
                _ => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0],
            };
            let step = (span / MAX_TICKS).ceil() as usize;
            let exponents = (self.low.floor() as i32..=self.high.ceil() as i32).step_by(step);
            let ticks =
                exponents.flat_map(|e| factors.iter().map(move |factor| factor * 10_f64.powi(e)));
            return ticks
                .filter(|tick| (self.low..=self.high).contains(&tick.log10()))
                .collect();
        }
        let power = 10_f64.powf((span / 5.0).log10().floor());
        let factor = [1.0, 2.0, 2.5, 5.0]
            .into_iter()
            .find(|factor| factor * power >= 0.999 * span / 5.0);
        let step = factor.unwrap_or(10.0) * power;
        let [first, last] =
            [(self.low / step).ceil(), (self.high / step).floor()].map(|i| i as i64);
        (first..=last).map(|i| i as f64 * step).collect()
    }
}

/// Formats a tick without the rounding error of its step.
pub(super) fn tick_label(tick: f64) -> String {
    (tick as f32).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within_range() {
        let cases: [(bool, &[f64], &str); 8] = [
            (false, &[0.02, 0.23], "0 0.05 0.1 0.15 0.2"),
            (true, &[0.7, 30.0], "1 2 5 10 20"),
            (true, &[0.5, 20_000.0], "1 10 100 1000 10000"),
            (true, &[3.0], "2 3 4"),
            (
                true,
                &[1e-9, 1e9],
                "0.00000001 0.000001 0.0001 0.01 1 100 10000 1000000 100000000",
            ),
            (false, &[0.0, f64::NAN, 1e308], "0 0.2 0.4 0.6 0.8 1"),
            (false, &[-5.0, 2.0], "-4 -2 0 2"),
            (true, &[0.0, -1.0], "1 1.5 2 3 4 5 6 8 10"),
        ];
        for (is_logarithmic, values, expected) in cases {
            let axis = Axis {
                name: String::new(),
                is_logarithmic,
            };
            let scale = Scale::new(&axis, [100.0, 0.0], values.iter().copied());
            let ticks = scale.ticks();
            assert!(
                ticks
                    .iter()
                    .all(|tick| (0.0..=100.0).contains(&scale.position(*tick))),
                "{values:?}: {ticks:?}"
            );
            assert_eq!(
                ticks
                    .into_iter()
                    .map(tick_label)
                    .collect::<Vec<_>>()
                    .join(" "),
                expected
            );
        }
    }
}
