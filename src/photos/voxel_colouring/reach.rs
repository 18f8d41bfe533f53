//! Rows and columns of a shell's face that a photograph sees.

use glam::{Vec2, Vec3};
use std::ops::Range;

/// Returns a range outside of which fewer than `least` of the ranges overlap: from the `least`-th
/// start to the `least`-th last end.
pub(super) fn overlap<'a>(
    ranges: impl Iterator<Item = &'a Range<usize>>,
    least: usize,
) -> Range<usize> {
    let (mut starts, mut ends): (Vec<usize>, Vec<usize>) =
        ranges.map(|range| (range.start, range.end)).unzip();
    let Some(last) = starts.len().checked_sub(least) else {
        return 0..0;
    };
    starts.sort_unstable();
    ends.sort_unstable();
    starts
        .get(least.saturating_sub(1))
        .map_or(0..0, |&start| start..ends[last].max(start))
}

/// Returns values that are all non-negative if an image of a size contains the point with
/// homogeneous position (x w, y w, w).
fn bounds(h: Vec3, [width, height]: [f32; 2]) -> [f32; 5] {
    [h.z, h.x, h.y, width * h.z - h.x, height * h.z - h.y]
}

/// Returns the columns of a row with centres inside of an image; `first` and `across` are the
/// homogeneous position (x w, y w, w) at column 0 and its change per column.
pub(super) fn seen_columns(first: Vec3, across: Vec3, size: [f32; 2], side: usize) -> Range<usize> {
    let (mut start, mut end) = (0.0f32, side as f32);
    for (at_0, slope) in bounds(first, size).into_iter().zip(bounds(across, size)) {
        let zero = -at_0 / slope;
        if slope > 0.0 {
            start = start.max(zero.ceil());
        } else if slope < 0.0 {
            end = end.min(zero.floor() + 1.0);
        } else if at_0 < 0.0 {
            return 0..0;
        }
    }
    start as usize..end.max(start) as usize
}

/// Returns the rows of a face that an image shows any part of: clips the face's square by the
/// borders of the image (Sutherland and Hodgman).
pub(super) fn seen_rows(
    [corner, across, down]: &[Vec3; 3],
    size: [f32; 2],
    side: usize,
) -> Range<usize> {
    let far = side as f32;
    let mut polygon = vec![
        Vec2::ZERO,
        Vec2::new(far, 0.0),
        Vec2::splat(far),
        Vec2::new(0.0, far),
    ];
    for rim in 0..5 {
        let inside = |p: Vec2| bounds(*corner + *across * p.x + *down * p.y, size)[rim];
        let mut clipped = Vec::with_capacity(polygon.len() + 1);
        for (k, &b) in polygon.iter().enumerate() {
            let a = polygon[(k + polygon.len() - 1) % polygon.len()];
            let (value_a, value_b) = (inside(a), inside(b));
            if (value_a < 0.0) != (value_b < 0.0) {
                clipped.push(a.lerp(b, value_a / (value_a - value_b)));
            }
            if value_b >= 0.0 {
                clipped.push(b);
            }
        }
        polygon = clipped;
    }
    if polygon.is_empty() {
        return 0..0;
    }
    let (low, high) = polygon.iter().fold((far, 0.0f32), |(low, high), p| {
        (low.min(p.y), high.max(p.y))
    });
    // One more row on each side absorbs rounding; superfluous rows turn out empty column by column.
    (low.floor() as usize).saturating_sub(1)..(high.ceil() as usize + 2).min(side)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seen_range_contains_every_visible_pixel() {
        let (side, size) = (23, [40.0, 30.0]);
        let inside = |h: Vec3| {
            h.z > 0.0 && h.x >= 0.0 && h.y >= 0.0 && h.x < size[0] * h.z && h.y < size[1] * h.z
        };
        for i in 0..500 {
            let at = |k: i32| ((i * 31 + k * 17) % 41) as f32 - 20.0;
            let affine = [
                Vec3::new(at(1) * 4.0, at(2) * 4.0, at(3) / 4.0),
                Vec3::new(at(4), at(5), at(6) / 30.0),
                Vec3::new(at(7), at(8), at(9) / 30.0),
            ];
            let rows = seen_rows(&affine, size, side);
            for row in 0..side {
                let first = affine[0] + affine[2] * row as f32;
                let columns = seen_columns(first, affine[1], size, side);
                for column in 0..side {
                    let h = first + affine[1] * column as f32;
                    // Within a hair of a rim rounding decides.
                    let at_a_rim = bounds(h, size).iter().any(|bound| bound.abs() < 1e-3);
                    assert!(
                        at_a_rim || inside(h) == columns.contains(&column),
                        "{i}: {row} {column}"
                    );
                    assert!(!inside(h) || at_a_rim || rows.contains(&row), "{i}: {row}");
                }
            }
        }
    }

    #[test]
    fn overlap_bounds_ranges() {
        let ranges = [2..9, 4..12, 5..6, 30..31];
        assert_eq!(overlap(ranges.iter(), 1), 2..31);
        assert_eq!(overlap(ranges.iter(), 2), 4..12);
        assert_eq!(overlap(ranges.iter(), 3), 5..9);
        assert_eq!(overlap(ranges.iter(), 5), 0..0);
        assert!(overlap([].iter(), 1).is_empty());
    }
}
