//! Timing of contenders in turns: a slow phase of the machine affects all of them, and each starts
//! with the caches that another one left.

use std::hint::black_box;
use std::time::Instant;

/// Runs `f` and returns the elapsed time, ms.
pub fn time_ms<T>(f: impl FnOnce() -> T) -> f64 {
    let started = Instant::now();
    black_box(f());
    started.elapsed().as_secs_f64() * 1e3
}

/// Runs each contender once per round, every second round in reverse order (A B C, C B A, ...).
/// Returns the results of `run` by contender and round; a `None` is left out.
pub fn run_in_turns<C, T>(
    contenders: &mut [C],
    rounds: u32,
    mut run: impl FnMut(usize, &mut C) -> Option<T>,
) -> Vec<Vec<T>> {
    let mut results: Vec<Vec<T>> = contenders.iter().map(|_| Vec::new()).collect();
    for round in 0..rounds {
        for turn in 0..contenders.len() {
            let index = if round % 2 == 0 {
                turn
            } else {
                contenders.len() - 1 - turn
            };
            results[index].extend(run(index, &mut contenders[index]));
        }
    }
    results
}

/// Returns the least of some times, the most robust estimate: other load only adds time.
pub fn least(times: &[f64]) -> Option<f64> {
    times.iter().copied().reduce(f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contenders_alternate_in_turns() {
        let mut order = Vec::new();
        let results = run_in_turns(&mut ['a', 'b', 'c'], 3, |index, contender| {
            order.push(*contender);
            (index != 1).then_some(order.len())
        });
        assert_eq!(order.iter().collect::<String>(), "abccbaabc");
        assert_eq!(results, [vec![1, 6, 7], vec![], vec![3, 4, 9]]);
        assert_eq!((least(&[2.0, 1.0]), least(&[])), (Some(1.0), None));
    }
}
