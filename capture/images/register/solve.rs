//! Sparse normal equations: what all views share first, then six unknowns of each view. Conjugate gradients.

/// Unknowns that all views share.
pub(super) const SHARED: usize = 10;

/// Unknowns of a view: a small turn (radians), and a small step (metres), in the axes of its camera.
pub(super) const OF_VIEW: usize = 6;

/// Unknowns of a pair of views.
pub(super) const OF_PAIR: usize = SHARED + 2 * OF_VIEW;

/// What a pair of views adds to the normal equations.
#[derive(Clone)]
pub(super) struct Block {
    pub(super) views: [usize; 2],
    /// J^T W J, the upper triangle.
    pub(super) matrix: [[f64; OF_PAIR]; OF_PAIR],
    /// J^T W r.
    pub(super) gradient: [f64; OF_PAIR],
}

impl Block {
    pub(super) fn new(views: [usize; 2]) -> Self {
        Self {
            views,
            matrix: [[0.0; OF_PAIR]; OF_PAIR],
            gradient: [0.0; OF_PAIR],
        }
    }

    /// Adds an equation: `row . x = -residual`, weighted.
    pub(super) fn add(&mut self, row: &[f64; OF_PAIR], residual: f64, weight: f64) {
        for i in 0..OF_PAIR {
            let scaled = row[i] * weight;
            self.gradient[i] += scaled * residual;
            for j in i..OF_PAIR {
                self.matrix[i][j] += scaled * row[j];
            }
        }
    }

    /// Adds what the block without its diagonal makes of `x`.
    fn multiply(&self, x: &[f64], y: &mut [f64]) {
        let places: [usize; OF_PAIR] = std::array::from_fn(|i| self.index(i));
        let own = places.map(|at| x[at]);
        let mut sums = [0.0; OF_PAIR];
        for (i, row) in self.matrix.iter().enumerate() {
            for j in i + 1..OF_PAIR {
                sums[i] += row[j] * own[j];
                sums[j] += row[j] * own[i];
            }
        }
        places
            .into_iter()
            .zip(sums)
            .for_each(|(at, sum)| y[at] += sum);
    }

    /// Where the block's unknown stands among all.
    fn index(&self, i: usize) -> usize {
        match i {
            0..SHARED => i,
            _ => SHARED + self.views[(i - SHARED) / OF_VIEW] * OF_VIEW + (i - SHARED) % OF_VIEW,
        }
    }
}

/// Solves (A + diag(prior) + damping diag(A)) x = -b for the unknowns that are `free`; the others are 0.
pub(super) fn solve(
    blocks: &[Block],
    prior: &[[f64; 2]],
    damping: f64,
    free: &dyn Fn(usize) -> bool,
) -> Vec<f64> {
    let count = prior.len();
    // A prior is a weight and what its unknown is by now.
    let mut right: Vec<f64> = prior
        .iter()
        .map(|[weight, value]| -weight * value)
        .collect();
    let mut diagonal: Vec<f64> = prior.iter().map(|[weight, _]| *weight).collect();
    for block in blocks {
        for i in 0..OF_PAIR {
            right[block.index(i)] -= block.gradient[i];
            diagonal[block.index(i)] += block.matrix[i][i] * (1.0 + damping);
        }
    }
    let product = |x: &[f64]| {
        let mut y: Vec<f64> = x
            .iter()
            .zip(&diagonal)
            .map(|(x, extra)| x * extra)
            .collect();
        blocks.iter().for_each(|block| block.multiply(x, &mut y));
        (0..count).filter(|&i| !free(i)).for_each(|i| y[i] = 0.0);
        y
    };
    conjugate_gradients(&product, right, &diagonal, free)
}

/// The residual's square is to shrink by this: the equations are those of a step, and the next step has others.
const PRECISION: f64 = 1e-10;

fn conjugate_gradients(
    product: &dyn Fn(&[f64]) -> Vec<f64>,
    right: Vec<f64>,
    diagonal: &[f64],
    free: &dyn Fn(usize) -> bool,
) -> Vec<f64> {
    let count = right.len();
    let inverse: Vec<f64> = (0..count)
        .map(|i| {
            if free(i) && diagonal[i] > 0.0 {
                1.0 / diagonal[i]
            } else {
                0.0
            }
        })
        .collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut x = vec![0.0; count];
    let mut residual: Vec<f64> = (0..count)
        .map(|i| if inverse[i] > 0.0 { right[i] } else { 0.0 })
        .collect();
    let mut direction: Vec<f64> = residual.iter().zip(&inverse).map(|(r, m)| r * m).collect();
    let mut size = dot(&residual, &direction);
    let enough = size * PRECISION;
    for _ in 0..4 * count.min(500) {
        if size <= enough {
            break;
        }
        let along = product(&direction);
        let step = size / dot(&direction, &along);
        for i in 0..count {
            x[i] += step * direction[i];
            residual[i] -= step * along[i];
        }
        let scaled: Vec<f64> = residual.iter().zip(&inverse).map(|(r, m)| r * m).collect();
        let next = dot(&residual, &scaled);
        for i in 0..count {
            direction[i] = scaled[i] + next / size * direction[i];
        }
        size = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::random::Rng;

    /// Random equations of a chain of views have the solution that made them; what is not free stays.
    #[test]
    fn what_made_the_equations_solves_them() {
        let mut random = Rng::new(5);
        let mut number = || random.unit() - 0.5;
        let views = 6;
        let truth: Vec<f64> = (0..SHARED + OF_VIEW * views).map(|_| number()).collect();
        let mut blocks: Vec<Block> = (0..views - 1).map(|i| Block::new([i, i + 1])).collect();
        for block in &mut blocks {
            for _ in 0..60 {
                let row: [f64; OF_PAIR] = std::array::from_fn(|_| number());
                let value: f64 = (0..OF_PAIR).map(|i| row[i] * truth[block.index(i)]).sum();
                block.add(&row, -value, 2.0);
            }
        }
        let prior = vec![[0.0; 2]; truth.len()];
        let found = solve(&blocks, &prior, 0.0, &|_| true);
        // The residual's length shrinks by 1e-5 at least.
        for (found, truth) in found.iter().zip(&truth) {
            assert!((found - truth).abs() < 2e-5, "{found} {truth}");
        }
        assert!(
            solve(&blocks, &prior, 0.0, &|i| i >= SHARED)[..SHARED]
                .iter()
                .all(|&x| x == 0.0)
        );
    }
}
