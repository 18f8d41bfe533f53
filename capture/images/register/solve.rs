//! Sparse normal equations of the shared unknowns and six unknowns of each view, solved by
//! conjugate gradients.

/// Number of unknowns that all views share: four of the lens, six of the offset.
pub(super) const SHARED_UNKNOWNS: usize = 10;

/// Number of unknowns of a view: a small turn (radians) and a small step (metres), in the axes of
/// its camera.
pub(super) const VIEW_UNKNOWNS: usize = 6;

/// Number of unknowns of a pair of views.
pub(super) const PAIR_UNKNOWNS: usize = SHARED_UNKNOWNS + 2 * VIEW_UNKNOWNS;

/// Contribution of a pair of views to the normal equations.
#[derive(Clone)]
pub(super) struct PairBlock {
    pub(super) views: [usize; 2],
    /// Upper triangle of J^T W J.
    pub(super) matrix: [[f64; PAIR_UNKNOWNS]; PAIR_UNKNOWNS],
    /// J^T W r.
    pub(super) gradient: [f64; PAIR_UNKNOWNS],
}

impl PairBlock {
    pub(super) fn new(views: [usize; 2]) -> Self {
        Self {
            views,
            matrix: [[0.0; PAIR_UNKNOWNS]; PAIR_UNKNOWNS],
            gradient: [0.0; PAIR_UNKNOWNS],
        }
    }

    /// Adds a weighted equation `row . x = -residual`.
    pub(super) fn add(&mut self, row: &[f64; PAIR_UNKNOWNS], residual: f64, weight: f64) {
        for i in 0..PAIR_UNKNOWNS {
            let scaled = row[i] * weight;
            self.gradient[i] += scaled * residual;
            for j in i..PAIR_UNKNOWNS {
                self.matrix[i][j] += scaled * row[j];
            }
        }
    }

    /// Adds the product of the block, without its diagonal, and `x` to `y`.
    fn add_product(&self, x: &[f64], y: &mut [f64]) {
        let indices: [usize; PAIR_UNKNOWNS] = std::array::from_fn(|i| self.index(i));
        let own = indices.map(|index| x[index]);
        let mut sums = [0.0; PAIR_UNKNOWNS];
        for (i, row) in self.matrix.iter().enumerate() {
            for j in i + 1..PAIR_UNKNOWNS {
                sums[i] += row[j] * own[j];
                sums[j] += row[j] * own[i];
            }
        }
        indices
            .into_iter()
            .zip(sums)
            .for_each(|(index, sum)| y[index] += sum);
    }

    /// Returns the global index of the block's unknown.
    fn index(&self, i: usize) -> usize {
        match i {
            0..SHARED_UNKNOWNS => i,
            _ => {
                SHARED_UNKNOWNS
                    + self.views[(i - SHARED_UNKNOWNS) / VIEW_UNKNOWNS] * VIEW_UNKNOWNS
                    + (i - SHARED_UNKNOWNS) % VIEW_UNKNOWNS
            }
        }
    }
}

/// Solves (A + diag(prior) + damping diag(A)) x = -b for the `free` unknowns; the others are 0. A
/// prior is the weight and the current value of its unknown.
pub(super) fn solve(
    blocks: &[PairBlock],
    prior: &[[f64; 2]],
    damping: f64,
    free: &dyn Fn(usize) -> bool,
) -> Vec<f64> {
    let count = prior.len();
    let mut right: Vec<f64> = prior
        .iter()
        .map(|[weight, value]| -weight * value)
        .collect();
    let mut diagonal: Vec<f64> = prior.iter().map(|[weight, _]| *weight).collect();
    for block in blocks {
        for i in 0..PAIR_UNKNOWNS {
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
        blocks.iter().for_each(|block| block.add_product(x, &mut y));
        (0..count).filter(|&i| !free(i)).for_each(|i| y[i] = 0.0);
        y
    };
    conjugate_gradients(&product, right, &diagonal, free)
}

/// Target reduction of the residual's square: coarse, because each step linearises again.
const PRECISION: f64 = 1e-10;

/// Solves for the `free` unknowns with the diagonal as preconditioner; the others are 0.
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
    let target = size * PRECISION;
    for _ in 0..4 * count.min(500) {
        if size <= target {
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

    /// Random equations of a chain of views are solved by the vector that generated them.
    #[test]
    fn random_chain_solved() {
        let mut random = Rng::new(5);
        let mut number = || random.unit() - 0.5;
        let views = 6;
        let truth: Vec<f64> = (0..SHARED_UNKNOWNS + VIEW_UNKNOWNS * views)
            .map(|_| number())
            .collect();
        let mut blocks: Vec<PairBlock> =
            (0..views - 1).map(|i| PairBlock::new([i, i + 1])).collect();
        for block in &mut blocks {
            for _ in 0..60 {
                let row: [f64; PAIR_UNKNOWNS] = std::array::from_fn(|_| number());
                let value: f64 = (0..PAIR_UNKNOWNS)
                    .map(|i| row[i] * truth[block.index(i)])
                    .sum();
                block.add(&row, -value, 2.0);
            }
        }
        let prior = vec![[0.0; 2]; truth.len()];
        let solution = solve(&blocks, &prior, 0.0, &|_| true);
        // The residual's length shrinks by 1e-5 at least.
        for (solved, truth) in solution.iter().zip(&truth) {
            assert!((solved - truth).abs() < 2e-5, "{solved} {truth}");
        }
        assert!(
            solve(&blocks, &prior, 0.0, &|i| i >= SHARED_UNKNOWNS)[..SHARED_UNKNOWNS]
                .iter()
                .all(|&x| x == 0.0)
        );
    }
}
