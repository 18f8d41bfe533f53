//! Axes: numbers to places, and where the ticks go.

/// How numbers are laid out along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spacing {
    /// Equal differences are equally long.
    Linear,
    /// Equal ratios are equally long.
    Logarithmic,
}

/// Figures have at most this size, and on a logarithmic axis at least its reciprocal; what is beyond does not count.
const LARGEST: f64 = 1e15;

/// The range of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    spacing: Spacing,
    low: f64,
    high: f64,
}

/// A number with a label.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tick {
    pub(super) value: f64,
    pub(super) label: String,
}

impl Scale {
    /// A range that holds all `values` (those that are no figures, and on a logarithmic axis not positive, do not count), with
    /// some air; a linear one begins at 0 if nothing is negative.
    pub(super) fn around(values: impl IntoIterator<Item = f64>, spacing: Spacing) -> Self {
        let logarithmic = spacing == Spacing::Logarithmic;
        let counts = |v: &f64| v.abs() <= LARGEST && (!logarithmic || *v >= LARGEST.recip());
        let [mut low, mut high] = values
            .into_iter()
            .filter(counts)
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
        if low > high {
            [low, high] = if logarithmic { [1.0, 10.0] } else { [0.0, 1.0] };
        }
        if logarithmic {
            let span = (high / low).ln();
            let with_air = |air: f64| Self { spacing, low: low * (-air).exp(), high: high * air.exp() };
            let scale = with_air((span * 0.07).max(0.18));
            // An axis needs two ticks, which are at most a factor of 2.5 apart.
            let least_span = 6.26f64.ln();
            if scale.logarithmic_ticks().len() < 2 { with_air((least_span - span) / 2.0) } else { scale }
        } else {
            let low = if low >= 0.0 { 0.0 } else { low * 1.05 };
            let high = if high - low >= LARGEST.recip() { high + (high - low) * 0.08 } else { low + 1.0 };
            Self { spacing, low, high }
        }
    }

    /// Where a value lies: 0 at the low end, 1 at the high end.
    pub(super) fn place(&self, value: f64) -> f64 {
        match self.spacing {
            Spacing::Linear => (value - self.low) / (self.high - self.low),
            Spacing::Logarithmic => (value / self.low).ln() / (self.high / self.low).ln(),
        }
    }

    /// Round numbers in the range.
    pub(super) fn ticks(&self) -> Vec<Tick> {
        let values = match self.spacing {
            Spacing::Linear => self.linear_ticks(),
            Spacing::Logarithmic => self.logarithmic_ticks(),
        };
        values.into_iter().map(|value| Tick { value, label: label(value) }).collect()
    }

    fn linear_ticks(&self) -> Vec<f64> {
        let rough = (self.high - self.low) / 5.0;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 2.5, 5.0, 10.0].map(|m| m * power).into_iter().find(|step| *step >= rough * 0.999);
        let step = step.unwrap_or(10.0 * power);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
    }

    fn logarithmic_ticks(&self) -> Vec<f64> {
        let decades = (self.high / self.low).log10();
        let multiples: &[f64] = if decades > 2.5 { &[1.0] } else { &[1.0, 2.0, 5.0] };
        let exponents = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
        let all = exponents.flat_map(|e| multiples.iter().map(move |m| m * 10f64.powi(e)));
        all.filter(|v| (self.low..=self.high).contains(v)).collect()
    }
}

/// A number as people write it: no more digits than it needs.
pub(super) fn label(value: f64) -> String {
    let rounded = format!("{value:.6}");
    let short = rounded.trim_end_matches('0').trim_end_matches('.');
    match value.abs() {
        size if size >= 1e6 => format!("{}M", label(value / 1e6)),
        size if size >= 1e4 => format!("{}k", label(value / 1e3)),
        _ if short == "-0" => "0".into(),
        _ => short.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let labels = |scale: &Scale| scale.ticks().into_iter().map(|tick| tick.label).collect::<Vec<_>>();
        assert_eq!(labels(&Scale::around([0.02, 0.23], Spacing::Linear)), ["0", "0.05", "0.1", "0.15", "0.2"]);
        assert_eq!(labels(&Scale::around([0.7, 30.0], Spacing::Logarithmic)), ["1", "2", "5", "10", "20"]);
        assert_eq!(labels(&Scale::around([0.5, 20_000.0], Spacing::Logarithmic)), ["1", "10", "100", "1000", "10k"]);
        for spacing in [Spacing::Linear, Spacing::Logarithmic] {
            for values in
                [vec![], vec![3.0], vec![f64::NAN, 5.0], vec![1e-9, 1e12], vec![0.0, 0.0], vec![-1e308, 1e-308, 1e308]]
            {
                let scale = Scale::around(values, spacing);
                for tick in scale.ticks() {
                    assert!((-1e-9..=1.0 + 1e-9).contains(&scale.place(tick.value)), "{scale:?} {tick:?}");
                }
                assert!(scale.ticks().len() >= 2, "{scale:?}");
            }
        }
    }

    #[test]
    fn numbers_have_no_more_digits_than_they_need() {
        assert_eq!([0.0, 0.25, 1.0, 1500.0, 20_000.0, 2.5e6].map(label), ["0", "0.25", "1", "1500", "20k", "2.5M"]);
    }
}
