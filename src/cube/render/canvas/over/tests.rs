//! Every shape of splat against a painter that takes one pixel after the other.

use super::*;
use headbox_core::random::Rng;
use headbox_core::simd;

const WIDTH: u32 = 40;
const ROWS: Range<u32> = 5..19;

/// Splats in and around the band: sizes up to seven pixels, a half of them opaque.
fn splats(random: &mut Rng) -> Box<Splats> {
    let mut splats = Box::new(Splats::new());
    splats.len = 3 * LANES - 5;
    for i in 0..splats.len {
        (splats.x[i], splats.y[i]) = (random.between(-3.0, 43.0) as f32, random.between(2.0, 22.0) as f32);
        splats.radius_x[i] = 0.5 + random.below(4) as f32 + random.between(0.0, 0.4) as f32;
        splats.radius_y[i] = random.between(0.5, 3.0) as f32;
        let alpha = if random.below(2) == 0 { 255 } else { random.below(255) as u8 };
        let [r, g, b] = [0; 3].map(|_: u8| random.below(256) as u8);
        splats.color[i] = u32::from_ne_bytes([r, g, b, alpha]);
    }
    splats
}

/// Of a splat, the share of 256 with which it goes over a pixel, without its own alpha.
fn weight(shape: Shape, splats: &Splats, i: usize, [column, row]: [i32; 2]) -> u32 {
    let (x, y) = (splats.x[i], splats.y[i]);
    let (middle_x, middle_y) = (x.floor() as i32, y.floor() as i32);
    let is_inside =
        (column as f32 + 0.5 - x).abs() < splats.radius_x[i] && (row as f32 + 0.5 - y).abs() < splats.radius_y[i];
    let is_whole = match shape {
        Shape::Rectangle => is_inside,
        Shape::Plus => is_inside && (column == middle_x || row == middle_y),
        Shape::Point => [column, row] == [middle_x, middle_y],
        Shape::Soft => {
            // A Gaussian of a quarter of the width, rounded to 1, 1/2 and 1/4 in the logarithm.
            let class = (splats.radius_x[i] as i32).min(3);
            let (dx, dy) = ((column - middle_x).abs(), (row - middle_y).abs());
            if dx.max(dy) > class {
                return 0;
            }
            let sigma = f64::from(2 * class + 1) / 4.0;
            let octaves = f64::from(dx * dx + dy * dy) / (2.0 * sigma * sigma) / std::f64::consts::LN_2;
            return 256 >> octaves.round().min(2.0) as u32;
        }
    };
    if is_whole { 256 } else { 0 }
}

#[test]
fn every_shape_is_painted_as_pixel_after_pixel() {
    for shape in [Shape::Rectangle, Shape::Plus, Shape::Point, Shape::Soft] {
        let mut random = Rng::keyed(8);
        let batches: Vec<Box<Splats>> = (0..6).map(|_| splats(&mut random)).collect();
        let mut expected = vec![[0u8; 4]; WIDTH as usize * ROWS.len()];
        for (batch, i) in batches.iter().flat_map(|batch| (0..batch.count()).map(move |i| (batch, i))) {
            let [r, g, b, alpha] = batch.color[i].to_ne_bytes();
            let own = u32::from(alpha) + u32::from(alpha >> 7);
            for (at, pixel) in expected.iter_mut().enumerate() {
                let place = [at as i32 % WIDTH as i32, at as i32 / WIDTH as i32 + ROWS.start as i32];
                // Ties go toward what is blended in.
                let weight = weight(shape, batch, i, place) * own / 256;
                for (there, source) in pixel.iter_mut().zip([r, g, b, 255]) {
                    let half = if source > *there { 128 } else { 127 };
                    *there = ((u32::from(*there) * (256 - weight) + u32::from(source) * weight + half) >> 8) as u8;
                }
            }
        }
        for level in simd::levels() {
            let mut canvas = OverCanvas { shape, ..OverCanvas::default() };
            canvas.clear(WIDTH, ROWS);
            batches.iter().for_each(|batch| canvas.draw(batch, level));
            for row in 0..ROWS.len() {
                let mut found = vec![[0; 4]; 31];
                canvas.resolve(row, 7, &mut found, level);
                let start = row * WIDTH as usize + 7;
                let expected = expected[start..start + 31].iter().map(|pixel| straight(*pixel));
                assert!(found.into_iter().eq(expected), "{shape:?}, row {row}");
            }
        }
    }
}

#[test]
fn straight_colours_are_exact_divisions_and_blends_that_came_to_rest_are_whole() {
    for share in 1..=255u8 {
        for c in 0..=share {
            let exact = (f64::from(c) * 255.0 / f64::from(share)).round().min(255.0) as u8;
            let [r, g, _, alpha] = straight([c, 0, 0, share]);
            // Halves may go either way.
            assert!(r.abs_diff(exact) <= u8::from(u32::from(c) * 510 % u32::from(share) == 0) && g == 0);
            assert_eq!(alpha, if share >= 252 { 255 } else { share });
        }
    }
    assert_eq!(straight([9, 8, 7, 0]), [9, 8, 7, 0]);
}

/// One pixel blended by a weight in 1/256, and the same pixel by every SIMD level of this machine.
fn blended(there: [u8; 4], source: [u8; 4], weight: u16) -> [u8; 4] {
    let level = Level::new();
    dispatch!(level, simd => {
        let mut pixels = [there; PIXELS];
        let (source, alpha) = source_of(simd, u32::from_ne_bytes(source));
        assert_eq!(alpha, 256);
        blend(simd, &mut pixels, source, u16x16::splat(simd, weight));
        assert!(pixels.iter().all(|pixel| *pixel == pixels[0]));
        pixels[0]
    })
}

/// Levels by which many random blends may lie above or below exact ones, on average: a tenth of the smallest step.
const MEAN_BIAS_LEVELS: f64 = 0.1;

#[test]
fn blends_do_not_drift() {
    let mut random = Rng::keyed(1);
    let (mut exact, mut found, mut bias) = (128.0, [128, 128, 128, 255], 0.0);
    const BLENDS: u32 = 100_000;
    for _ in 0..BLENDS {
        let (source, shift) = (60 + random.below(120) as u8, 1 + random.below(2) as u16);
        found = blended(found, [source, source, source, 255], 256 >> shift);
        exact += (f64::from(source) - exact) / f64::from(1 << shift);
        bias += f64::from(found[0]) - exact;
    }
    let bias = bias / f64::from(BLENDS);
    assert!(bias.abs() < MEAN_BIAS_LEVELS, "{bias}");
}

#[test]
fn blending_a_colour_over_itself_changes_nothing() {
    for c in 0..=255 {
        for weight in [0, 1, 64, 128, 200, 255, 256] {
            assert_eq!(blended([c, c, c, 255], [c, c, c, 255], weight), [c, c, c, 255]);
        }
        assert_eq!(blended([255 - c, 0, c, 77], [c, c, c, 255], 256), [c, c, c, 255]);
        assert_eq!(blended([255 - c, 0, c, 77], [c, c, c, 255], 0), [255 - c, 0, c, 77]);
    }
}

#[test]
fn a_stamp_is_symmetric_and_its_middle_is_opaque() {
    for (class, rows) in STAMPS.iter().enumerate() {
        let at = |row: usize, column: usize| rows[row][column / PIXELS][column % PIXELS * 4];
        assert_eq!(at(0, class), 128);
        for row in 0..=class {
            for column in 0..=2 * class {
                assert_eq!(at(row, column), at(row, 2 * class - column));
                assert_eq!(at(row, class + row), at(row, class - row));
                assert!(at(row, column) >= 32);
            }
            assert!(2 * class == 7 || at(row, 2 * class + 1) == 0, "nothing beyond it");
        }
    }
}
