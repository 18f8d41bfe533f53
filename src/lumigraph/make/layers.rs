//! Placement of disparity layers, and classification of surfaces (L2, L4, L5; C22).

use crate::bounds::optimal_disparity;
use serde::{Deserialize, Serialize};

/// Layer of surfaces in a range of disparity (1 / depth beyond the camera plane, 1/m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisparityLayer {
    /// Disparity of the farthest surface.
    pub min: f64,
    /// Disparity of the nearest surface.
    pub max: f64,
}

impl DisparityLayer {
    /// Returns the disparity at which the layer is drawn.
    pub fn drawn(&self) -> f64 {
        optimal_disparity(self.range())
    }

    /// Returns the smallest and the largest disparity.
    pub fn range(&self) -> [f64; 2] {
        [self.min, self.max]
    }

    /// Returns the layer from the far end of this one to the near end of `nearer`.
    pub fn through(&self, nearer: &Self) -> Self {
        Self {
            min: self.min,
            max: nearer.max,
        }
    }
}

/// Placement of layers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Placement {
    /// Equal parts of the range of disparity (Eq. 6).
    Uniform,
    /// By the disparities that occur: the widest layer is as narrow as the number of layers allows.
    #[default]
    Histogram,
}

/// Divides a range of disparity into `count` equal layers, from far to near (Eq. 6).
pub fn uniform([min, max]: [f64; 2], count: usize) -> Vec<DisparityLayer> {
    let end = |i: usize| {
        if i == count {
            max
        } else {
            min + (max - min) * i as f64 / count as f64
        }
    };
    (0..count)
        .map(|i| DisparityLayer {
            min: end(i),
            max: end(i + 1),
        })
        .collect()
}

/// Places at most `count` layers that contain all `disparities`, from far to near, each no wider
/// than its surfaces. Empty layers are left out.
pub fn place(disparities: &[f32], count: usize, placement: Placement) -> Vec<DisparityLayer> {
    let mut sorted: Vec<f32> = disparities
        .iter()
        .copied()
        .filter(|d| *d > 0.0 && d.is_finite())
        .collect();
    sorted.sort_unstable_by(f32::total_cmp);
    sorted.dedup();
    let (Some(&first), Some(&last)) = (sorted.first(), sorted.last()) else {
        return Vec::new();
    };
    let count = count.max(1);
    match placement {
        Placement::Uniform => {
            let parts = uniform([f64::from(first), f64::from(last)], count);
            let mut rest = sorted.as_slice();
            let layer = |(i, part): (usize, &DisparityLayer)| {
                let own = if i + 1 == count {
                    rest.len()
                } else {
                    rest.partition_point(|d| f64::from(*d) < part.max)
                };
                let (own, others) = rest.split_at(own);
                rest = others;
                enclosing(own)
            };
            parts.iter().enumerate().filter_map(layer).collect()
        }
        Placement::Histogram => cover(&sorted, min_width(&sorted, count)),
    }
}

/// Returns the layer that just contains ascending disparities.
fn enclosing(sorted: &[f32]) -> Option<DisparityLayer> {
    Some(DisparityLayer {
        min: f64::from(*sorted.first()?),
        max: f64::from(*sorted.last()?),
    })
}

/// Covers ascending disparities with the fewest layers of at most `width`: each begins at the
/// farthest disparity that is left.
fn cover(sorted: &[f32], width: f64) -> Vec<DisparityLayer> {
    let mut layers = Vec::new();
    let mut rest = sorted;
    while let Some(&first) = rest.first() {
        let own = rest.partition_point(|d| f64::from(*d) - f64::from(first) <= width);
        let (own, others) = rest.split_at(own.max(1));
        layers.extend(enclosing(own));
        rest = others;
    }
    layers
}

/// Returns the smallest width at which `count` layers cover ascending disparities.
fn min_width(sorted: &[f32], count: usize) -> f64 {
    let fits = |width: f64| cover(sorted, width).len() <= count;
    if fits(0.0) {
        return 0.0;
    }
    let whole = enclosing(sorted).map_or(0.0, |layer| layer.max - layer.min);
    let (mut too_narrow, mut wide_enough) = (0.0, whole);
    // Resolves the precision of f32 disparities.
    for _ in 0..40 {
        let middle = 0.5 * (too_narrow + wide_enough);
        if fits(middle) {
            wide_enough = middle;
        } else {
            too_narrow = middle;
        }
    }
    wide_enough
}

/// Returns the layer of a disparity, counted from 1 for the farthest; 0 for infinity. A disparity
/// between two layers belongs to the layer with the nearer end.
pub fn classify(layers: &[DisparityLayer], disparity: f32) -> u16 {
    if disparity.is_nan() || disparity <= 0.0 || layers.is_empty() {
        return 0;
    }
    let disparity = f64::from(disparity);
    let nearer = layers.partition_point(|layer| layer.max < disparity);
    let index = match nearer {
        0 => 0,
        end if end == layers.len() => end - 1,
        i if disparity >= layers[i].min
            || layers[i].min - disparity <= disparity - layers[i - 1].max =>
        {
            i
        }
        i => i - 1,
    };
    (index + 1) as u16
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn widest(layers: &[DisparityLayer]) -> f64 {
        layers
            .iter()
            .map(|layer| layer.max - layer.min)
            .fold(0.0, f64::max)
    }

    proptest! {
        #[test]
        fn disparities_lie_in_consecutive_layers(
            disparities in proptest::collection::vec(0.01f32..5.0, 1..60), count in 1usize..20,
        ) {
            for placement in [Placement::Uniform, Placement::Histogram] {
                let layers = place(&disparities, count, placement);
                prop_assert!(layers.len() <= count && !layers.is_empty());
                prop_assert!(layers.windows(2).all(|pair| pair[0].max < pair[1].min));
                for &d in &disparities {
                    let layer = layers[usize::from(classify(&layers, d)) - 1];
                    prop_assert!((layer.min..=layer.max).contains(&f64::from(d)), "{d} in {layer:?}");
                }
            }
        }

        /// Against all ways to cut a few disparities into groups.
        #[test]
        fn no_other_layers_are_narrower(
            disparities in proptest::collection::vec(0.01f32..5.0, 1..9), count in 1usize..5,
        ) {
            let layers = place(&disparities, count, Placement::Histogram);
            let mut sorted = disparities;
            sorted.sort_by(f32::total_cmp);
            let gaps = sorted.len() - 1;
            let best = (0u32..1 << gaps).filter(|cuts| (cuts.count_ones() as usize) < count).map(|cuts| {
                let mut first = 0;
                let mut width = 0.0f64;
                for i in 0..sorted.len() {
                    if i == gaps || cuts >> i & 1 == 1 {
                        width = width.max(f64::from(sorted[i]) - f64::from(sorted[first]));
                        first = i + 1;
                    }
                }
                width
            }).fold(f64::INFINITY, f64::min);
            prop_assert!((widest(&layers) - best).abs() < 1e-6, "{} and {best}", widest(&layers));
            prop_assert!(widest(&layers) <= widest(&place(&sorted, count, Placement::Uniform)) + 1e-9);
        }
    }

    #[test]
    fn layers_of_empty_and_constant_depth() {
        assert!(place(&[], 4, Placement::Histogram).is_empty());
        assert!(place(&[0.0, f32::NAN, -1.0], 4, Placement::Uniform).is_empty());
        for placement in [Placement::Uniform, Placement::Histogram] {
            assert_eq!(
                place(&[0.5; 9], 4, placement),
                [DisparityLayer { min: 0.5, max: 0.5 }],
                "no range at all"
            );
        }
        let layers = [
            DisparityLayer { min: 0.1, max: 0.2 },
            DisparityLayer { min: 0.4, max: 0.5 },
        ];
        let found =
            [0.0, -1.0, f32::NAN, 0.05, 0.15, 0.29, 0.31, 0.45, 9.0].map(|d| classify(&layers, d));
        assert_eq!(found, [0, 0, 0, 1, 1, 1, 2, 2, 2]);
        assert_eq!(classify(&[], 0.3), 0);
    }
}
