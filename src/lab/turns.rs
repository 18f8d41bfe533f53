//! Times taken in turns: what slows the machine for a while slows all that is compared, and what
//! the one leaves in the caches every other finds there.

/// Does every way once a round, one after another, every other round backwards (A B C, C B A, ...).
/// Returns what `run` made of each way, by way and round; where it makes nothing, the way sits out.
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

/// The least of some times, which says most: what a busy machine adds is never negative.
pub fn least(times: &[f64]) -> Option<f64> {
    times.iter().copied().reduce(f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_take_turns_and_may_sit_out() {
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
