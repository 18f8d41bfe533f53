//! Merging of layers for a frame: as few as its eye position needs (L8, C20).
//!
//! The paper's loop over the layers from back to front, corrected: it includes the nearest layer
//! and returns every merged layer. A wider layer never has a smaller error ([`ErrorBound::error`]),
//! so that merging greedily is optimal; the merged layers of the last frame are the initial guess.

use crate::bounds::ErrorBound;
use crate::make::layers::DisparityLayer;
use std::ops::Range;

/// Merges layers, from far to near: returns consecutive ranges that cover all layers. A layer that
/// exceeds the bound by itself is not merged.
pub fn merge(layers: &[DisparityLayer], bound: &ErrorBound) -> Vec<Range<usize>> {
    let mut merger = Merger::default();
    merger.update(layers, bound);
    merger.merged
}

/// Merging of layers frame after frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct Merger {
    /// Merged layers of the last frame.
    pub(crate) merged: Vec<Range<usize>>,
    /// Ends of the merged layers of the frame before.
    last_ends: Vec<usize>,
    /// Number of bound evaluations for the last frame.
    tests: u64,
}

impl Merger {
    /// Merges as [`merge`], starting from the last frame's result (the paper's limitation 6): an
    /// unchanged end costs two tests per merged layer.
    pub(crate) fn update(&mut self, layers: &[DisparityLayer], bound: &ErrorBound) {
        let count = layers.len();
        let allows = |range: Range<usize>| {
            bound.allows(layers[range.start].through(&layers[range.end - 1]).range())
        };
        self.last_ends.clear();
        self.last_ends
            .extend(self.merged.iter().map(|range| range.end));
        self.merged.clear();
        self.tests = 0;
        let mut first = 0;
        while first < count {
            let hint = self.last_ends.partition_point(|&end| end <= first);
            let hint = self.last_ends.get(hint).copied().unwrap_or(first + 1);
            let end = self.find_end(count, allows, first, hint.min(count));
            self.merged.push(first..end);
            first = end;
        }
    }

    /// Finds the end of the merged layer that begins with `first`: by doubling steps from `hint`,
    /// then by bisection.
    fn find_end(
        &mut self,
        count: usize,
        allows: impl Fn(Range<usize>) -> bool,
        first: usize,
        hint: usize,
    ) -> usize {
        let mut fits = |end: usize| {
            self.tests += 1;
            end <= first + 1 || (end <= count && allows(first..end))
        };
        let (mut good, mut bad);
        let mut step = 1;
        if fits(hint) {
            (good, bad) = (hint, hint + step);
            while bad <= count && fits(bad) {
                step *= 2;
                (good, bad) = (bad, bad + step);
            }
            bad = bad.min(count + 1);
        } else {
            (good, bad) = (hint.saturating_sub(step), hint);
            while good > first + 1 && !fits(good) {
                step *= 2;
                (good, bad) = (good.saturating_sub(step), good);
            }
            good = good.max(first + 1);
        }
        while bad - good > 1 {
            let middle = good + (bad - good) / 2;
            if fits(middle) {
                good = middle;
            } else {
                bad = middle;
            }
        }
        good
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::make::layers::uniform;
    use proptest::prelude::*;

    /// Layers of any widths, with gaps between them.
    fn any_layers() -> impl Strategy<Value = Vec<DisparityLayer>> {
        proptest::collection::vec((0.0..0.1f64, 0.0..0.05f64), 1..40).prop_map(|steps| {
            let mut at = 0.01;
            let layer = |(gap, width): (f64, f64)| {
                let min: f64 = at + gap;
                at = min + width;
                DisparityLayer { min, max: at }
            };
            steps.into_iter().map(layer).collect()
        })
    }

    fn any_bound() -> impl Strategy<Value = ErrorBound> {
        (-1.5..20.0f64, 0.0..0.5f64).prop_map(|(behind, tolerance)| ErrorBound {
            focal: 1.0,
            spacing: 1.0,
            behind,
            tolerance,
        })
    }

    /// The fewest merged layers, by dynamic programming over all ways to cut.
    fn fewest(layers: &[DisparityLayer], bound: &ErrorBound) -> usize {
        let mut best = vec![usize::MAX; layers.len() + 1];
        best[0] = 0;
        for end in 1..=layers.len() {
            for first in 0..end {
                if first + 1 == end || bound.allows([layers[first].min, layers[end - 1].max]) {
                    best[end] = best[end].min(best[first] + 1);
                }
            }
        }
        best[layers.len()]
    }

    /// The loop as the correction has it, step by step.
    fn step_by_step(layers: &[DisparityLayer], bound: &ErrorBound) -> Vec<Range<usize>> {
        let mut merged = Vec::new();
        let mut first = 0;
        for i in 1..layers.len() {
            if !bound.allows([layers[first].min, layers[i].max]) {
                merged.push(first..i);
                first = i;
            }
        }
        merged.push(first..layers.len());
        merged
    }

    proptest! {
        #[test]
        fn greedy_merge_is_minimal_partition(layers in any_layers(), bound in any_bound()) {
            let merged = merge(&layers, &bound);
            prop_assert_eq!(&merged, &step_by_step(&layers, &bound));
            prop_assert_eq!(merged.len(), fewest(&layers, &bound));
            prop_assert_eq!((merged[0].start, merged[merged.len() - 1].end), (0, layers.len()));
            prop_assert!(merged.windows(2).all(|pair| pair[0].end == pair[1].start));
        }

        #[test]
        fn from_the_last_frames_layers_comes_the_same(
            layers in any_layers(), bounds in proptest::collection::vec(any_bound(), 1..6), others in any_layers(),
        ) {
            let mut merger = Merger::default();
            for bound in &bounds {
                merger.update(&layers, bound);
                prop_assert_eq!(&merger.merged, &merge(&layers, bound));
                // Another lumigraph in between.
                merger.update(&others, bound);
                prop_assert_eq!(&merger.merged, &merge(&others, bound));
            }
        }
    }

    #[test]
    fn paper_scenes_merge_to_derived_layers() {
        // UV plane, ST plane, F, depths; merged layers at 0, 1, 2, 4 and 8 focal lengths behind 4x4
        // images.
        let scenes = [
            ([200.0, 100.0, 160.0, 183.4, 308.8], [8, 5, 4, 3, 2]),
            ([400.0, 200.0, 300.0, 232.6, 581.8], [18, 9, 7, 4, 3]),
            ([80.0, 40.0, 60.0, 35.4, 134.0], [29, 14, 10, 6, 4]),
        ];
        for ([uv, st, focal, near, far], derived) in scenes {
            let layers = uniform([1.0 / far, 1.0 / near], 256);
            let found = [0.0, 1.0, 2.0, 4.0, 8.0].map(|distance| {
                let bound = ErrorBound {
                    focal,
                    spacing: st / 3.0,
                    behind: distance * focal,
                    tolerance: uv / 256.0,
                };
                merge(&layers, &bound).len()
            });
            assert_eq!(found, derived);
        }
    }

    #[test]
    fn merge_of_none_one_and_strict_bound() {
        let bound = |tolerance, behind| ErrorBound {
            focal: 1.0,
            spacing: 1.0,
            behind,
            tolerance,
        };
        assert!(merge(&[], &bound(1.0, 0.0)).is_empty());
        let layers = uniform([0.1, 1.0], 5);
        assert_eq!(merge(&layers[..1], &bound(0.0, 0.0)), vec![0usize..1; 1]);
        assert_eq!(merge(&layers, &bound(0.0, 0.0)).len(), 5);
        assert_eq!(
            merge(&layers, &bound(1e9, -0.5)),
            vec![0usize..5; 1],
            "in front of the plane, before all layers"
        );
        // Layers that the eye has passed, or is in, stay as they are.
        assert_eq!(merge(&layers, &bound(1e9, -2.0)), [0..2, 2..3, 3..4, 4..5]);
    }

    #[test]
    fn similar_frame_needs_few_tests() {
        let layers = uniform([0.1, 1.0], 4096);
        let mut merger = Merger::default();
        let bound = |behind| ErrorBound {
            focal: 500.0,
            spacing: 0.2,
            behind,
            tolerance: 1.0,
        };
        merger.update(&layers, &bound(0.0));
        let first = merger.tests;
        merger.update(&layers, &bound(0.0));
        assert!(
            merger.tests <= 2 * merger.merged.len() as u64,
            "{} after {first}",
            merger.tests
        );
    }
}
