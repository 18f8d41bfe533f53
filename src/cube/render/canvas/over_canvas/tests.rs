//! Every shape against a scalar reference, pixel by pixel.

use super::*;
use headbox_core::random::Rng;
use headbox_core::simd;

const WIDTH: u32 = 40;
const ROWS: Range<u32> = 5..19;

/// Creates splats in and around the band: sizes up to seven pixels, half of them opaque.
fn random_splats(random: &mut Rng) -> Box<Splats> {
    let mut splats = Box::new(Splats::new());
    splats.len = 3 * LANES - 5;
    for i in 0..splats.len {
        splats.x[i] = random.between(-3.0, 43.0) as f32;
        splats.y[i] = random.between(2.0, 22.0) as f32;
        splats.radius_x[i] = 0.5 + random.below(4) as f32 + random.between(0.0, 0.4) as f32;
        splats.radius_y[i] = random.between(0.5, 3.0) as f32;
        let alpha = if random.below(2) == 0 {
            255
        } else {
            random.below(255) as u8
        };
        let [r, g, b] = [0; 3].map(|_: u8| random.below(256) as u8);
        splats.color[i] = u32::from_ne_bytes([r, g, b, alpha]);
    }
    splats
}

/// Returns the weight of a splat in a pixel, in 1/256, without the splat's alpha.
fn weight(shape: SplatShape, splats: &Splats, i: usize, [column, row]: [i32; 2]) -> u32 {
    let (x, y) = (splats.x[i], splats.y[i]);
    let middle_x = x.floor() as i32;
    let middle_y = y.floor() as i32;
    let is_inside = (column as f32 + 0.5 - x).abs() < splats.radius_x[i]
        && (row as f32 + 0.5 - y).abs() < splats.radius_y[i];
    let is_covered = match shape {
        SplatShape::Rectangle => is_inside,
        SplatShape::Plus => is_inside && (column == middle_x || row == middle_y),
        SplatShape::Point => [column, row] == [middle_x, middle_y],
        SplatShape::PaperSquare => {
            // A Gaussian of a quarter of the width, rounded to 1, 1/2 and 1/4 in the logarithm.
            let class = (splats.radius_x[i] as i32).min(3);
            let dx = (column - middle_x).abs();
            let dy = (row - middle_y).abs();
            if dx.max(dy) > class {
                return 0;
            }
            let sigma = f64::from(2 * class + 1) / 4.0;
            let octaves =
                f64::from(dx * dx + dy * dy) / (2.0 * sigma * sigma) / std::f64::consts::LN_2;
            return 256 >> octaves.round().min(2.0) as u32;
        }
    };
    if is_covered { 256 } else { 0 }
}

#[test]
fn every_shape_matches_scalar_reference() {
    for shape in [
        SplatShape::Rectangle,
        SplatShape::Plus,
        SplatShape::Point,
        SplatShape::PaperSquare,
    ] {
        let mut random = Rng::keyed(8);
        let batches: Vec<Box<Splats>> = (0..6).map(|_| random_splats(&mut random)).collect();
        let mut expected = vec![[0u8; 4]; WIDTH as usize * ROWS.len()];
        for (batch, i) in batches
            .iter()
            .flat_map(|batch| (0..batch.count()).map(move |i| (batch, i)))
        {
            let [r, g, b, alpha] = batch.color[i].to_ne_bytes();
            let alpha = u32::from(alpha) + u32::from(alpha >> 7);
            for (index, pixel) in expected.iter_mut().enumerate() {
                let position = [
                    index as i32 % WIDTH as i32,
                    index as i32 / WIDTH as i32 + ROWS.start as i32,
                ];
                // Ties go toward the source.
                let weight = weight(shape, batch, i, position) * alpha / 256;
                for (channel, source) in pixel.iter_mut().zip([r, g, b, 255]) {
                    let half = if source > *channel { 128 } else { 127 };
                    *channel =
                        ((u32::from(*channel) * (256 - weight) + u32::from(source) * weight + half)
                            >> 8) as u8;
                }
            }
        }
        for level in simd::levels() {
            let mut canvas = OverCanvas::new(shape);
            canvas.clear(WIDTH, ROWS, Tolerance::default());
            batches.iter().for_each(|batch| canvas.draw(batch, level));
            for row in 0..ROWS.len() {
                let mut resolved = vec![[0; 4]; 31];
                canvas.resolve(row, 7, &mut resolved, level);
                let start = row * WIDTH as usize + 7;
                let expected = expected[start..start + 31]
                    .iter()
                    .map(|pixel| straight_color(*pixel));
                assert!(resolved.into_iter().eq(expected), "{shape:?}, row {row}");
            }
        }
    }
}

#[test]
fn straight_colours_are_divided_by_coverage() {
    for share in 1..=255u8 {
        let alpha = if share >= OPAQUE { 255 } else { share };
        assert_eq!(
            straight_color([share, 0, share / 2, share]),
            [255, 0, unpremultiply(share / 2, share), alpha]
        );
    }
    assert_eq!(straight_color([9, 8, 7, 0]), [9, 8, 7, 0]);
}

/// Blends an opaque colour over a pixel with a weight in 1/256.
fn blend_one(pixel: [u8; 4], source: [u8; 4], weight: u16) -> [u8; 4] {
    let level = Level::new();
    dispatch!(level, simd => {
        let mut pixels = [pixel; PIXELS];
        let (source, alpha) = blend_source(simd, u32::from_ne_bytes(source));
        assert_eq!(alpha, 256);
        blend(simd, &mut pixels, source, u16x16::splat(simd, weight));
        assert!(pixels.iter().all(|pixel| *pixel == pixels[0]));
        pixels[0]
    })
}

/// Tolerated mean deviation of many random blends from exact ones, levels: a tenth of the
/// smallest step.
const MEAN_BIAS_LEVELS: f64 = 0.1;

#[test]
fn blends_do_not_drift() {
    let mut random = Rng::keyed(1);
    let mut exact = 128.0;
    let mut pixel = [128, 128, 128, 255];
    let mut bias = 0.0;
    const BLENDS: u32 = 100_000;
    for _ in 0..BLENDS {
        let source = 60 + random.below(120) as u8;
        let shift = 1 + random.below(2) as u16;
        pixel = blend_one(pixel, [source, source, source, 255], 256 >> shift);
        exact += (f64::from(source) - exact) / f64::from(1 << shift);
        bias += f64::from(pixel[0]) - exact;
    }
    let bias = bias / f64::from(BLENDS);
    assert!(bias.abs() < MEAN_BIAS_LEVELS, "{bias}");
}

#[test]
fn colour_blended_over_itself_is_unchanged() {
    for c in 0..=255 {
        for weight in [0, 1, 64, 128, 200, 255, 256] {
            assert_eq!(
                blend_one([c, c, c, 255], [c, c, c, 255], weight),
                [c, c, c, 255]
            );
        }
        assert_eq!(
            blend_one([255 - c, 0, c, 77], [c, c, c, 255], 256),
            [c, c, c, 255]
        );
        assert_eq!(
            blend_one([255 - c, 0, c, 77], [c, c, c, 255], 0),
            [255 - c, 0, c, 77]
        );
    }
}

#[test]
fn paper_squares_are_symmetric() {
    for (class, rows) in STAMPS.iter().enumerate() {
        let weight = |row: usize, column: usize| rows[row][column / PIXELS][column % PIXELS * 4];
        assert_eq!(weight(0, class), 128);
        for row in 0..=class {
            for column in 0..=2 * class {
                assert_eq!(weight(row, column), weight(row, 2 * class - column));
                assert_eq!(weight(row, class + row), weight(row, class - row));
                assert!(weight(row, column) >= 32);
            }
            assert!(
                2 * class == 7 || weight(row, 2 * class + 1) == 0,
                "no weight outside"
            );
        }
    }
}
