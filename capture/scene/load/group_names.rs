//! How the faces lie that an OBJ has in groups and objects named after floors and walls: evidence of which way is up.
//!
//! The scene keeps no groups, so this is a pass of its own over the text; it takes place only where a name says something.

use super::lines::{keyword, lines, words};
use super::lying::{FLOORS, Lying, WALLS};
use glam::DVec3;

/// What faces under such names are.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct GroupNames {
    pub(super) floors: Lying,
    pub(super) walls: Lying,
}

impl GroupNames {
    /// Reads the text if it has such names.
    pub(super) fn of(text: &str) -> Self {
        let mut found = Self::default();
        let is_name = |word: &str| matches!(word, "o" | "g");
        let says = |line: &str| {
            let (word, rest) = keyword(line);
            is_name(word) && (is_one_of(rest, &FLOORS) || is_one_of(rest, &WALLS))
        };
        if !text.lines().any(says) {
            return found;
        }
        let (mut positions, mut is_floor, mut is_wall) = (Vec::new(), false, false);
        for (_, line) in lines(text) {
            let (word, rest) = keyword(&line);
            match word {
                "v" => positions.push(position(rest)),
                "o" | "g" => {
                    (is_floor, is_wall) = (is_one_of(rest, &FLOORS), is_one_of(rest, &WALLS));
                }
                "f" if is_floor || is_wall => {
                    let area = area(rest, &positions);
                    if is_floor {
                        found.floors.add(area);
                    } else {
                        found.walls.add(area);
                    }
                }
                _ => {}
            }
        }
        found
    }
}

fn is_one_of(name: &str, known: &[&str]) -> bool {
    let name = name.to_lowercase();
    known.iter().any(|known| name.contains(known))
}

fn position(numbers: &str) -> DVec3 {
    let mut numbers = words(numbers).map(|number| number.parse().unwrap_or(0.0));
    let mut next = || numbers.next().unwrap_or(0.0);
    DVec3::new(next(), next(), next())
}

/// A face's area as a vector along its normal; 0 where a corner is not there.
fn area(corners: &str, positions: &[DVec3]) -> DVec3 {
    let corner = |text: &str| {
        let index: i64 = text.split('/').next()?.parse().ok()?;
        let from_start = if index < 0 {
            positions.len() as i64 + index
        } else {
            index - 1
        };
        positions.get(usize::try_from(from_start).ok()?).copied()
    };
    let corners: Option<Vec<DVec3>> = words(corners).map(corner).collect();
    let corners = corners.unwrap_or_default();
    let Some(first) = corners.first() else {
        return DVec3::ZERO;
    };
    let fan = corners
        .windows(2)
        .map(|pair| (pair[0] - first).cross(pair[1] - first));
    let area = fan.sum::<DVec3>() / 2.0;
    if area.is_finite() { area } else { DVec3::ZERO }
}
