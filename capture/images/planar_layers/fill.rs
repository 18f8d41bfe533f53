//! Push-pull hole filling: extends values smoothly to unknown pixels through an image pyramid
//! (Gortler et al. 1996).

/// A pyramid level of values with weights; weight 0 where unknown.
#[derive(Clone, Debug)]
struct Level {
    pub width: usize,
    pub height: usize,
    /// Weighted mean and weight (0..=1) of each pixel.
    values: Vec<[f32; 2]>,
}

/// Weight of a prior of 0, which unknown pixels approach far from known ones.
const PRIOR: f32 = 1e-3;

/// Extends known values, which stay unchanged, to all pixels of an image.
pub(super) fn smoothly(known: &[Option<f32>], width: usize) -> Vec<f32> {
    let height = known.len() / width.max(1);
    let values = known
        .iter()
        .map(|value| value.map_or([0.0; 2], |value| [value, 1.0]))
        .collect();
    let mut levels = vec![Level {
        width,
        height,
        values,
    }];
    while let Some(last) = levels.last().filter(|last| last.width.max(last.height) > 1) {
        let halved = last.halved();
        levels.push(halved);
    }
    let mut above: Option<(Level, Vec<f32>)> = None;
    while let Some(level) = levels.pop() {
        let filled = (0..level.values.len()).map(|i| {
            let [value, weight] = level.values[i];
            let around = above
                .as_ref()
                .map_or(0.0, |(above, filled)| above.between(filled, i, level.width));
            value * weight + around * (1.0 - weight)
        });
        let filled: Vec<f32> = filled.collect();
        above = Some((level, filled));
    }
    above.map(|(_, filled)| filled).unwrap_or_default()
}

impl Level {
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let of = |i: usize| {
            let (x, y) = (i % width * 2, i / width * 2);
            let (mut sum, mut weight) = (0.0, 0.0);
            for (x, y) in [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)] {
                if x < self.width && y < self.height {
                    let [value, own] = self.values[y * self.width + x];
                    sum += value * own;
                    weight += own;
                }
            }
            [
                if weight > 0.0 {
                    sum / (weight + PRIOR)
                } else {
                    0.0
                },
                weight.min(1.0),
            ]
        };
        Self {
            width,
            height,
            values: (0..width * height).map(of).collect(),
        }
    }

    /// Samples this level bilinearly at a pixel of the finer one.
    fn between(&self, filled: &[f32], fine: usize, fine_width: usize) -> f32 {
        let along = |k: usize, side: usize| {
            let at = ((k as f32 + 0.5) / 2.0 - 0.5).clamp(0.0, (side - 1) as f32);
            let low = at as usize;
            (low, (low + 1).min(side - 1), at - low as f32)
        };
        let (x0, x1, u) = along(fine % fine_width, self.width);
        let (y0, y1, v) = along(fine / fine_width, self.height);
        let row =
            |y: usize| filled[y * self.width + x0] * (1.0 - u) + filled[y * self.width + x1] * u;
        row(y0) * (1.0 - v) + row(y1) * v
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values_unchanged_others_interpolated() {
        let (width, height) = (37, 23);
        let truth = |i: usize| (i % width) as f32 * 0.5 + (i / width) as f32;
        let known: Vec<Option<f32>> = (0..width * height)
            .map(|i| (i % 7 == 0 || i % 11 == 3).then(|| truth(i)))
            .collect();
        let filled = smoothly(&known, width);
        assert_eq!(filled.len(), known.len());
        for (i, (filled, known)) in filled.iter().zip(&known).enumerate() {
            assert!(known.is_none_or(|known| known == *filled), "{i}: {filled}");
            assert!(
                (filled - truth(i)).abs() < 4.0,
                "{i}: {filled} for {}",
                truth(i)
            );
        }
        assert!(smoothly(&[None; 12], 4).iter().all(|value| *value == 0.0));
        assert!(smoothly(&[], 0).is_empty());
        assert_eq!(smoothly(&[Some(3.0)], 1), [3.0]);
    }
}
