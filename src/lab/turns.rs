//! Repeated timing in turns: a slow phase of the machine slows all contenders, and each finds the
//! caches as another left them.

use std::hint::black_box;
use std::time::Instant;

/// Runs `f` and returns the time that it took, ms.
pub fn time_ms<T>(f: impl FnOnce() -> T) -> f64 {
    let started = Instant::now();
    black_box(f());
    started.elapsed().as_secs_f64() * 1e3
}

/// Runs each contender once a round, one after another, every other round backwards (A B C, C B A,
/// ...). Returns the results of `run` by contender and round; a `None` is left out.
pub fn in_turns<W, T>(
    ways: &mut [W],
    rounds: u32,
    mut run: impl FnMut(usize, &mut W) -> Option<T>,
) -> Vec<Vec<T>> {
    let mut made: Vec<Vec<T>> = ways
        .iter()
        .map(|_| Vec::with_capacity(rounds as usize))
        .collect();
    for round in 0..rounds {
        for turn in 0..ways.len() {
            let number = if round % 2 == 0 {
                turn
            } else {
                ways.len() - 1 - turn
            };
            made[number].extend(run(number, &mut ways[number]));
        }
    }
    made
}

/// Returns the least of some times, the most robust estimate: a busy machine only adds to a time.
pub fn least(times: &[f64]) -> Option<f64> {
    times.iter().copied().reduce(f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contenders_take_turns_and_may_sit_out() {
        let mut order = Vec::new();
        let made = in_turns(&mut ['a', 'b', 'c'], 3, |number, way| {
            order.push(*way);
            (number != 1).then_some(order.len())
        });
        assert_eq!(order.iter().collect::<String>(), "abccbaabc");
        assert_eq!(made, [vec![1, 6, 7], vec![], vec![3, 4, 9]]);
        assert_eq!((least(&[2.0, 1.0]), least(&[])), (Some(1.0), None));
    }
}
