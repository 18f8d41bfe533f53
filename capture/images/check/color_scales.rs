//! Unit of depth by colours: cameras that move sideways along a wall see the same depth in any
//! unit, but not the same colours.

use crate::view::{LoadedView, MAX_DEPTH_M};

/// Number of factors on either side of 1.
const SIDE: usize = 48;

/// Factors in each doubling.
const PER_DOUBLING: f64 = 8.0;

/// Number of sampled columns and rows of a view.
const SAMPLES: u32 = 64;

/// Colour difference above which views disagree, levels of 255.
const MAX_LEVELS: f64 = 6.0;

/// Colour difference above which views disagree even if no factor on depth explains it.
const MAX_UNEXPLAINED: f64 = 48.0;

/// Factor by which the difference shrinks with the right unit.
const IMPROVEMENT: f64 = 0.4;

/// Share of the sampled points that both views see, at least.
const OVERLAP: f64 = 0.3;

/// Relative depth difference above which a point is hidden.
const HIDDEN: f64 = 0.05;

/// Colour differences of neighbours for factors on depth.
#[derive(Default)]
pub(super) struct ColorScales {
    /// For each pair, the mean difference of each factor, levels; NaN without overlap.
    pairs: Vec<Vec<f64>>,
}

impl ColorScales {
    /// Compares the points of `a` with the colours of `b` where they project to.
    pub(super) fn add(&mut self, a: &LoadedView, b: &LoadedView) {
        let levels = (0..=2 * SIDE).map(|i| mean_levels(a, b, factor(i)));
        self.pairs.push(levels.collect());
    }

    /// Returns a warning if colours agree only with another unit, or with none.
    pub(super) fn describe(&self) -> Option<String> {
        let means: Vec<f64> = (0..=2 * SIDE)
            .map(|i| {
                let known = self
                    .pairs
                    .iter()
                    .map(|pair| pair[i])
                    .filter(|it| !it.is_nan());
                let known: Vec<f64> = known.collect();
                // Factors for which few pairs overlap are no evidence.
                if known.len() * 2 > self.pairs.len() {
                    known.iter().sum::<f64>() / known.len() as f64
                } else {
                    f64::NAN
                }
            })
            .collect();
        let given = means.get(SIDE).copied().filter(|it| *it > MAX_LEVELS)?;
        let smallest = means.iter().copied().fold(f64::INFINITY, f64::min);
        // Repeated textures agree for several factors: the one nearest to 1 is taken.
        let limit = 1.5 * smallest + 1.0;
        let good = (0..means.len()).filter(|&i| means[i] <= limit);
        let mut best = good.min_by_key(|i| i.abs_diff(SIDE))?;
        while let Some(lower) = [best.wrapping_sub(1), best + 1]
            .into_iter()
            .find(|&i| means.get(i).is_some_and(|it| *it < means[best]))
        {
            best = lower;
        }
        let levels = means[best];
        if levels < IMPROVEMENT * given && best.abs_diff(SIDE) > 1 {
            return Some(format!(
                "colours of the same points differ by {given:.0} levels of 255, but only by {levels:.0} if depth is multiplied by \
                 the factor {:.2}: the unit of depth or of the poses may be wrong",
                factor(best)
            ));
        }
        (given > MAX_UNEXPLAINED).then(|| {
            format!(
                "colours of the same points differ by {given:.0} levels of 255 on average: the poses, the unit of depth or its \
                 kind may be wrong, or exposures differ"
            )
        })
    }
}

fn factor(index: usize) -> f64 {
    ((index as f64 - SIDE as f64) / PER_DOUBLING).exp2()
}

/// Returns the mean colour difference of the points that both see, with depth times `factor`; NaN
/// if they are few.
fn mean_levels(a: &LoadedView, b: &LoadedView, factor: f64) -> f64 {
    let [width, height] = a.size_px;
    let step = [width, height].map(|side| side.div_ceil(SAMPLES).max(1) as usize);
    let mut points = 0usize;
    let mut seen = 0usize;
    let mut sum = 0.0;
    for y in (step[1] as u32 / 2..height).step_by(step[1]) {
        for x in (step[0] as u32 / 2..width).step_by(step[0]) {
            let Some(depth) = a.depth_at(x, y).filter(|depth| *depth < MAX_DEPTH_M) else {
                continue;
            };
            points += 1;
            let ray = a
                .lens
                .ray([f64::from(x) + 0.5, f64::from(y) + 0.5], a.size_px);
            let point = a.pose.to_world(ray * f64::from(depth) * factor);
            let Some([bx, by, expected]) = b.lens.project(b.pose.to_eye(point), b.size_px) else {
                continue;
            };
            let [columns, rows] = b.size_px.map(f64::from);
            if !(bx >= 0.0 && by >= 0.0 && bx < columns && by < rows) {
                continue;
            }
            let Some(actual) = b.depth_at(bx as u32, by as u32) else {
                continue;
            };
            if (f64::from(actual) * factor / expected - 1.0).abs() > HIDDEN {
                continue;
            }
            if let Some(color) = b.color_at([bx, by]) {
                let own = a.color[y as usize * width as usize + x as usize];
                let differences = (0..3).map(|c| (color[c] - f64::from(own[c])).abs());
                sum += differences.sum::<f64>() / 3.0;
                seen += 1;
            }
        }
    }
    if seen as f64 > OVERLAP * points.max(1) as f64 {
        sum / seen as f64
    } else {
        f64::NAN
    }
}
