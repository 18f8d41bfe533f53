//! Push-pull hole filling: extends values smoothly to unknown pixels through an image pyramid
//! (Gortler et al. 1996).

use headbox_core::image::mip::{MipLevel, OddEdge};
use std::iter::successors;

/// Weighted mean and weight (0..=1) of each pixel; weight 0 where unknown.
type Level = MipLevel<[f32; 2]>;

/// Weight of a prior of 0, which unknown pixels approach far from known ones.
const PRIOR: f32 = 1e-3;

/// Extends known values, which stay unchanged, to all pixels of an image.
pub(super) fn smoothly(known: &[Option<f32>], width: usize) -> Vec<f32> {
    let height = known.len() / width.max(1);
    let values = known
        .iter()
        .map(|value| value.map_or([0.0; 2], |value| [value, 1.0]))
        .collect();
    let finest = Level {
        size: [width, height],
        texels: values,
    };
    let levels = successors(Some(finest), |level| {
        let can_be_halved = level.size.iter().any(|side| *side > 1);
        can_be_halved.then(|| level.halved(OddEdge::Pad([0.0; 2]), weighted_mean))
    });
    let mut levels: Vec<Level> = levels.collect();
    let mut above: Option<(Level, Vec<f32>)> = None;
    while let Some(level) = levels.pop() {
        let filled = (0..level.texels.len()).map(|i| {
            let [value, weight] = level.texels[i];
            let around = above.as_ref().map_or(0.0, |(above, filled)| {
                sample(filled, above.size, i, level.size[0])
            });
            value * weight + around * (1.0 - weight)
        });
        let filled: Vec<f32> = filled.collect();
        above = Some((level, filled));
    }
    above.map(|(_, filled)| filled).unwrap_or_default()
}

/// Returns the weighted mean of four values and the prior, and the sum of their weights, at most 1.
fn weighted_mean(four: [[f32; 2]; 4]) -> [f32; 2] {
    let (mut sum, mut weight) = (0.0, 0.0);
    for [value, own] in four {
        sum += value * own;
        weight += own;
    }
    let mean = if weight > 0.0 {
        sum / (weight + PRIOR)
    } else {
        0.0
    };
    [mean, weight.min(1.0)]
}

/// Samples a level bilinearly at a pixel of the finer one.
fn sample(filled: &[f32], [width, height]: [usize; 2], fine: usize, fine_width: usize) -> f32 {
    let along = |k: usize, side: usize| {
        let position = ((k as f32 + 0.5) / 2.0 - 0.5).clamp(0.0, (side - 1) as f32);
        let low = position as usize;
        (low, (low + 1).min(side - 1), position - low as f32)
    };
    let (x0, x1, u) = along(fine % fine_width, width);
    let (y0, y1, v) = along(fine / fine_width, height);
    let row = |y: usize| filled[y * width + x0] * (1.0 - u) + filled[y * width + x1] * u;
    row(y0) * (1.0 - v) + row(y1) * v
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
