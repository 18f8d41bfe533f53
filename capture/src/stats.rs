//! Medians and other quantiles.

/// The value below which `share` (0..=1) of some values in any order lie, interpolated linearly between neighbours; `None` if
/// there are none. NaN counts as larger than any number.
pub fn quantile(values: &[f64], share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let place = share.clamp(0.0, 1.0) * last as f64;
    let number = (place as usize).min(last);
    let mut values = values.to_vec();
    let (_, &mut below, rest) = values.select_nth_unstable_by(number, f64::total_cmp);
    let between = place - number as f64;
    match rest.iter().copied().min_by(f64::total_cmp) {
        Some(above) if between > 0.0 => Some(below + (above - below) * between),
        _ => Some(below),
    }
}

/// The middle of some values in any order, of an even number the mean of the two in the middle; `None` if there are none.
pub fn median(values: &[f64]) -> Option<f64> {
    quantile(values, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_interpolate() {
        assert_eq!((median(&[]), median(&[7.0]), median(&[3.0, 1.0])), (None, Some(7.0), Some(2.0)));
        let values = [4.0, 1.0, 2.0, 3.0];
        assert_eq!(
            [0.0, 0.25, 0.5, 0.75, 1.0].map(|share| quantile(&values, share)),
            [1.0, 1.75, 2.5, 3.25, 4.0].map(Some)
        );
        assert_eq!(quantile(&[5.0, f64::INFINITY], 0.0), Some(5.0));
    }
}
