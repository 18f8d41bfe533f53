//! Scan conversion of triangles in exact integers: pixel ranges and edge functions.
//!
//! Corners lie at multiples of 1/256 px. The edge function of an edge from a to b at a point p is
//! `E = (b - a) x (p - a)`, an integer; with the corners in clockwise order on the screen, p lies
//! inside where the functions of all three edges are positive.

use std::ops::Range;

/// Steps per pixel of corner positions.
pub const SUBPIXELS: i32 = 256;

/// Returns the pixels within `clip` along an axis whose centres lie between two positions, 1/256
/// px, both ends included; empty (its start may exceed its end) if there are none.
#[inline(always)]
pub fn pixels_between(least: i32, most: i32, clip: &Range<u32>) -> Range<u32> {
    let first = (least + SUBPIXELS / 2 - 1).div_euclid(SUBPIXELS);
    let end = (most - SUBPIXELS / 2).div_euclid(SUBPIXELS) + 1;
    first.max(clip.start as i32) as u32..end.min(clip.end as i32).max(0) as u32
}

/// Edge function at pixel centres, in units of (1/256 px)^2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EdgeFunction {
    /// Value at the centre of the reference pixel.
    pub value: i64,
    /// Change per 1/256 of a column.
    pub per_column: i64,
    /// Change per 1/256 of a row.
    pub per_row: i64,
}

impl EdgeFunction {
    /// Sets up the function of the edge from `a` to `b`, 1/256 px, at a reference pixel.
    #[inline(always)]
    pub fn new(a: [i32; 2], b: [i32; 2], pixel: [u32; 2]) -> Self {
        let dx = i64::from(b[0]) - i64::from(a[0]);
        let dy = i64::from(b[1]) - i64::from(a[1]);
        let from_a = |axis: usize| {
            i64::from(pixel[axis]) * i64::from(SUBPIXELS) + i64::from(SUBPIXELS / 2)
                - i64::from(a[axis])
        };
        Self {
            value: dx * from_a(1) - dy * from_a(0),
            per_column: -dy,
            per_row: dx,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn range_includes_centres_on_both_ends() {
        let clip = 0..100;
        assert_eq!(pixels_between(128, 384, &clip), 0..2);
        assert_eq!(pixels_between(129, 383, &clip), 1..1);
        assert_eq!(pixels_between(-5000, 127, &clip), 0..0);
        assert_eq!(pixels_between(-5000, -3000, &clip), 0..0);
        assert_eq!(pixels_between(-5000, 1 << 30, &(7..9)), 7..9);
        assert!(pixels_between(5000, 6000, &(7..9)).is_empty());
    }

    #[test]
    fn edge_function_is_cross_product_at_every_pixel() {
        let (a, b) = ([300, -77], [-1000, 12_345]);
        let edge = EdgeFunction::new(a, b, [3, 5]);
        for (x, y) in [(3, 5), (4, 5), (3, 6), (90, 17)] {
            let p = [x, y].map(|pixel| i64::from(pixel) * 256 + 128);
            let [a, b] = [a, b].map(|point| point.map(i64::from));
            let cross = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
            let stepped = edge.value
                + 256 * (edge.per_column * i64::from(x - 3) + edge.per_row * i64::from(y - 5));
            assert_eq!(stepped, cross, "({x}, {y})");
        }
    }

    #[test]
    fn clockwise_triangle_contains_points_right_of_edges() {
        let corners = [[0, 0], [1024, 0], [0, 1024]];
        let inside = |pixel| {
            (0..3).all(|k| EdgeFunction::new(corners[k], corners[(k + 1) % 3], pixel).value > 0)
        };
        assert!(inside([0, 0]) && inside([2, 0]) && !inside([3, 3]));
    }
}
