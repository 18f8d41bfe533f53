//! Peeled tiles against the definition, splat by splat.

use super::mean::{BLOCK, OPAQUE, RAMP_START, blend_surfaces};
use super::peel::{BACKGROUND_TOLERANCE, Peel, RowMask};
use super::tile_splat::{SplatKind, TILE_ROWS, TileSplat};
use super::{Canvas, Splats, SurfaceCanvas, Tents, Tolerance};
use crate::render::canvas::linear::LinearLight;
use crate::render::footprint::tent::{ONE, PEAK_STEPS, TOP};
use fearless_simd::{Level, dispatch};
use headbox_core::random::Rng;
use headbox_core::simd;

const TOLERANCE: Tolerance = Tolerance {
    relative: 0.05,
    least: 0.001,
};

/// Background of each row of a tile.
type TileBackground = [([[u8; 4]; BLOCK], [f32; BLOCK]); TILE_ROWS];

/// Colours with coverage, 0..255, and inverse depths, row by row.
type PeeledRows = Vec<([u32; BLOCK], [f32; BLOCK])>;

fn peel_tile(
    level: Level,
    splats: &[TileSplat],
    background: Option<&TileBackground>,
) -> (RowMask, PeeledRows) {
    let mut peel = Peel::default();
    let row_background = |row: usize| background.map(|rows| (&rows[row].0, &rows[row].1));
    let light = LinearLight::tables();
    let touched =
        dispatch!(level, simd => peel.draw(simd, splats, row_background, TOLERANCE, light));
    let rows = touched
        .rows()
        .map(|row| (*peel.result(row).0, *peel.result(row).1))
        .collect();
    (touched, rows)
}

/// A splat in one pixel: weight, colour and inverse depth, and where it lies.
type PixelSplat = (u32, [u8; 3], f32, Option<Place>);

/// Position of a splat relative to a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    Quadrant { is_left: bool, is_above: bool },
    Rim,
}

/// Returns the place of a splat of a kind. `across`, `down`: position of the pixel from its centre.
fn place(kind: SplatKind, across: i32, down: i32) -> Option<Place> {
    match kind {
        SplatKind::Translucent => None,
        SplatKind::Rim => Some(Place::Rim),
        SplatKind::Opaque => Some(Place::Quadrant {
            is_left: across > 0,
            is_above: down > 0,
        }),
    }
}

/// Returns true if splats are in all quadrants around a pixel, or in two that touch if it is a rim.
fn is_surrounded(splats: &[PixelSplat]) -> bool {
    let has = |is_left, is_above| {
        let place = Some(Place::Quadrant { is_left, is_above });
        splats.iter().any(|splat| splat.3 == place)
    };
    let is_rim = splats.iter().any(|splat| splat.3 == Some(Place::Rim));
    let side = |is_first| {
        (
            has(is_first, false) && has(is_first, true),
            has(false, is_first) && has(true, is_first),
        )
    };
    let [(left, above), (right, below)] = [side(true), side(false)];
    left && right || is_rim && (left || right || above || below)
}

/// Returns the mean of splats, and their coverage, 0..255.
fn mean(splats: &[PixelSplat]) -> [u8; 4] {
    let weight: u32 = splats.iter().map(|splat| splat.0).sum();
    if weight == 0 {
        return [0; 4];
    }
    let channel = |i: usize| {
        let sum: f64 = splats
            .iter()
            .map(|(weight, color, ..)| f64::from(*weight) * f64::from(color[i]))
            .sum();
        (sum / f64::from(weight)).round() as u8
    };
    let start = f64::from(RAMP_START);
    let share = match f64::from(weight) {
        weight if weight <= start => weight / f64::from(ONE),
        weight => {
            let along = (weight - start) / (f64::from(OPAQUE) - start);
            let first = start / f64::from(ONE);
            (first + (1.0 - first) * along).min(1.0)
        }
    };
    let share = (share * 255.0).round() as u8;
    let share = if is_surrounded(splats) {
        share.saturating_mul(2)
    } else {
        share
    };
    [channel(0), channel(1), channel(2), share]
}

/// Returns the largest inverse depth that belongs to one surface with `q`.
fn reach(q: f32, relative: f32) -> f32 {
    q + (q * relative).max(TOLERANCE.least)
}

/// Returns the least [`reach`] of splats on the surface of a background that is in front.
fn reach_at_background(q: f32) -> f32 {
    q + q * (TOLERANCE.relative * (1.0 - BACKGROUND_TOLERANCE))
}

/// Returns the result of a pixel by definition, and the inverse depth of its front surface.
/// `background`: an opaque colour.
fn expected_pixel(
    splats: impl IntoIterator<Item = PixelSplat>,
    background: Option<([u8; 3], f32)>,
) -> ([u8; 4], f32) {
    let splats = splats.into_iter().map(|splat| (splat, TOLERANCE.relative));
    let background_relative = TOLERANCE.relative * BACKGROUND_TOLERANCE;
    let background = background.map(|(color, q)| ((ONE, color, q, None), background_relative));
    let mut remaining: Vec<(PixelSplat, f32)> = splats
        .chain(background)
        .filter(|((weight, ..), _)| *weight > 0)
        .collect();
    let mut surfaces = [[0; 4]; 3];
    let nearest = |splats: &[(PixelSplat, f32)]| {
        let inverse_depths = splats.iter().map(|(splat, _)| splat.2);
        inverse_depths.fold(-1.0, f32::max)
    };
    let without_tolerance = |splats: Vec<(PixelSplat, f32)>| -> Vec<PixelSplat> {
        splats.into_iter().map(|(splat, _)| splat).collect()
    };
    let front = nearest(&remaining).max(0.0);
    let is_background_front = background.is_some_and(|((_, _, q, _), _)| front <= q);
    let mut nearer: Vec<PixelSplat> = Vec::new();
    for (i, surface) in surfaces[..2].iter_mut().enumerate() {
        let nearest = nearest(&remaining);
        let (on_surface, behind): (Vec<_>, Vec<_>) =
            remaining.into_iter().partition(|((_, _, q, _), relative)| {
                let is_splat = *relative == TOLERANCE.relative;
                let least_reach = if i == 0 && is_background_front && is_splat {
                    reach_at_background(nearest)
                } else {
                    nearest
                };
                least_reach <= reach(*q, *relative)
            });
        let on_surface = without_tolerance(on_surface);
        nearer.extend(&on_surface);
        *surface = mean(&on_surface);
        if i == 1 && !on_surface.is_empty() && is_surrounded(&nearer) {
            surface[3] = 255;
        }
        remaining = behind;
    }
    surfaces[2] = mean(&without_tolerance(remaining));
    (blend_surfaces(surfaces, LinearLight::tables()), front)
}

/// Returns the largest difference of two colours, levels.
fn max_difference(a: [u8; 4], b: [u8; 4]) -> u8 {
    a.iter().zip(b).map(|(a, b)| a.abs_diff(b)).fold(0, u8::max)
}

fn weight(splat: &TileSplat, column: usize, row: usize) -> u32 {
    let height = |[first, step]: [i32; 2], line: usize| {
        (TOP - (first + line as i32 * step).abs())
            .max(0)
            .cast_unsigned()
    };
    let is_inside = (splat.rows[0]..splat.rows[1]).contains(&(row as u16));
    let peak = (splat.peak * height(splat.down, row)) >> 15;
    if is_inside {
        (peak * height(splat.across, column) + (1 << 23)) >> 24
    } else {
        0
    }
}

/// Creates tents at random positions, some near each other in depth, some far apart.
fn random_splats(random: &mut Rng, count: usize) -> Vec<TileSplat> {
    let mut uniform = || random.below(1 << 20) as f64 / f64::from(1 << 20);
    let mut splat = |_| {
        let mut profile = |length: f64| {
            let centre = uniform() * length;
            let radius = 0.75 + 2.0 * uniform();
            let step = f64::from(TOP) / radius;
            let lines = [
                (centre - radius).max(0.0) as u16,
                (centre + radius).ceil().min(length) as u16,
            ];
            ([((0.5 - centre) * step) as i32, step as i32], lines)
        };
        let (across, _) = profile(BLOCK as f64);
        let (down, rows) = profile(TILE_ROWS as f64);
        let color = [0; 3].map(|_: u8| (uniform() * 256.0) as u8);
        let kinds = [SplatKind::Translucent, SplatKind::Opaque, SplatKind::Rim];
        let kind = kinds[(uniform() * 3.0) as usize];
        let inverse_depth = ((uniform() * 4.0).floor() + 1.0 + 0.03 * uniform()) as f32;
        TileSplat {
            across,
            down,
            peak: (uniform() * f64::from(ONE * PEAK_STEPS)) as u32,
            color,
            kind,
            inverse_depth,
            rows,
        }
    };
    (0..count).map(&mut splat).collect()
}

/// Creates a background plane in half the tile, behind some of the splats.
fn half_background() -> TileBackground {
    let half = |row: usize| {
        std::array::from_fn(|i| {
            [
                200,
                7 * row as u8,
                30 * i as u8,
                if i < 4 { 255 } else { 0 },
            ]
        })
    };
    std::array::from_fn(|row| (half(row), [2.5; BLOCK]))
}

/// Tolerated error of three colours mixed by tables of 12 bits, from means rounded to whole levels.
const LEVELS: u8 = 2;

#[test]
fn tiles_match_definition_in_any_order() {
    let mut random = Rng::keyed(3);
    let background = half_background();
    for count in [1, 2, 7, 60, 700] {
        let mut splats = random_splats(&mut random, count);
        for background in [None, Some(&background)] {
            let (touched, rows) = peel_tile(Level::baseline(), &splats, background);
            for (row, (colors, inverse_depths)) in touched.rows().zip(&rows) {
                for i in 0..BLOCK {
                    let pixel_splats = splats.iter().map(|splat| {
                        let position =
                            |[first, step]: [i32; 2], line: usize| first + line as i32 * step;
                        let place = place(
                            splat.kind,
                            position(splat.across, i),
                            position(splat.down, row),
                        );
                        (
                            weight(splat, i, row),
                            splat.color,
                            splat.inverse_depth,
                            place,
                        )
                    });
                    let opaque = background
                        .filter(|rows| rows[row].0[i][3] == 255)
                        .map(|rows| {
                            let [r, g, b, _] = rows[row].0[i];
                            ([r, g, b], rows[row].1[i])
                        });
                    let (expected, front) = expected_pixel(pixel_splats, opaque);
                    let color = colors[i].to_le_bytes();
                    assert!(
                        max_difference(color, expected) <= LEVELS,
                        "{count}: {color:?} for {expected:?} at {i}, {row}"
                    );
                    assert_eq!((color[3], inverse_depths[i]), (expected[3], front));
                }
            }
            for level in simd::levels() {
                splats.reverse();
                splats.rotate_left(count / 3);
                assert_eq!(
                    peel_tile(level, &splats, background),
                    (touched, rows.clone()),
                    "{level:?}"
                );
            }
        }
    }
}

/// Splats of the pixel in the first column and row of a tile.
#[derive(Default)]
struct FirstPixel(Vec<TileSplat>);

impl FirstPixel {
    fn add(&mut self, color: [u8; 3], weight: u32, inverse_depth: f32) {
        self.0.push(TileSplat {
            across: [0, TOP],
            down: [0, TOP],
            peak: weight * PEAK_STEPS,
            color,
            kind: SplatKind::Translucent,
            inverse_depth,
            rows: [0, 1],
        });
    }

    fn color(&self) -> [u8; 4] {
        peel_tile(simd::level(), &self.0, None).1[0].0[0].to_le_bytes()
    }
}

#[test]
fn surfaces_are_blended_in_depth_order() {
    let red = [250, 0, 0];
    let green = [0, 250, 0];
    let blue = [0, 0, 250];
    let mut pixel = FirstPixel::default();
    pixel.add(blue, ONE, 1.0);
    pixel.add(red, ONE / 2, 2.0);
    let [r, g, b, share] = pixel.color();
    // Half of the light of 250 is 184.
    assert!(
        r.abs_diff(184) <= 2 && g == 0 && b.abs_diff(184) <= 2 && share == 255,
        "half red over blue"
    );
    pixel.add(green, ONE, 1.5);
    let [r, g, b, _] = pixel.color();
    assert!(
        r.abs_diff(184) <= 2 && g.abs_diff(184) <= 2 && b == 0,
        "green between"
    );
    pixel.add(red, ONE, 2.02);
    assert_eq!(pixel.color(), [250, 0, 0, 255]);
}

/// Returns the pixel in column and row 1 with a red splat, of a sixth of the weight there, in each
/// of some quadrants around it, and perhaps a red rim in it, before blue.
fn share_of_red(quadrants: &[[i32; 2]], kind: SplatKind, has_rim: bool) -> [u8; 4] {
    let splat = |center: [i32; 2], kind, color, weight, inverse_depth| {
        let profile = |center: i32| [(-1 - center) * TOP / 4, TOP / 4];
        TileSplat {
            across: profile(center[0]),
            down: profile(center[1]),
            peak: weight * PEAK_STEPS,
            color,
            kind,
            inverse_depth,
            rows: [0, 3],
        }
    };
    let red = [250, 0, 0];
    let mut splats = vec![splat([0, 0], SplatKind::Translucent, [0, 0, 250], ONE, 1.0)];
    splats.extend(
        quadrants
            .iter()
            .map(|quadrant| splat(*quadrant, kind, red, 40, 2.0)),
    );
    if has_rim {
        splats.push(splat([0, 0], SplatKind::Rim, red, 40, 2.0));
    }
    peel_tile(simd::level(), &splats, None).1[1].0[1].to_le_bytes()
}

#[test]
fn pixels_among_samples_of_a_surface_are_covered() {
    let corners = [[-1, -1], [1, -1], [-1, 1], [1, 1]];
    let red = [250, 0, 0, 255];
    let opaque = |quadrants: &[[i32; 2]], has_rim| {
        share_of_red(quadrants, SplatKind::Opaque, has_rim) == red
    };
    assert!(opaque(&corners, false));
    for i in 0..4 {
        let without = corners.into_iter().enumerate().filter(|(k, _)| *k != i);
        let without: Vec<_> = without.map(|(_, corner)| corner).collect();
        assert!(!opaque(&without, false) && opaque(&without, true), "{i}");
    }
    for [i, k] in [[0, 1], [2, 3], [0, 2], [1, 3]] {
        assert!(
            opaque(&[corners[i], corners[k]], true),
            "a rim beside {i} and {k}"
        );
    }
    for [i, k] in [[0, 3], [1, 2]] {
        assert!(
            !opaque(&[corners[i], corners[k]], true),
            "a rim between {i} and {k}"
        );
    }
    assert!(
        share_of_red(&corners, SplatKind::Translucent, false) != red,
        "leaves stay thin"
    );
}

#[test]
fn many_splats_of_one_colour_keep_it() {
    for weight in [1, 3, 37, ONE] {
        let mut pixel = FirstPixel::default();
        for _ in 0..10_000 {
            pixel.add([201, 0, 255], weight, 1.0);
        }
        assert_eq!(pixel.color(), [201, 0, 255, 255]);
    }
}

/// Front, middle and back splats exactly at the tolerance, and infinitely far away.
#[test]
fn splats_at_tolerance_belong_to_surface() {
    let splat_reach = |q| reach(q, TOLERANCE.relative);
    let background_reach = |q| reach(q, TOLERANCE.relative * BACKGROUND_TOLERANCE);
    let half = OPAQUE / 2;
    let quarter = half / 2;
    let [red, green, blue] = [[250, 0, 0], [0, 250, 0], [0, 0, 250]];
    let front_splats = [
        (quarter, red, splat_reach(1.0), None),
        (quarter, blue, 1.0, None),
    ];
    // The nearer of two surfaces slightly within the tolerance, at it, and slightly beyond.
    let around = |border: f32| [border.next_down(), border, border.next_up()];
    // Splats, and the inverse depth of the background, negative for none.
    let mut cases: Vec<(Vec<PixelSplat>, f32)> = vec![(
        [&front_splats[..], &[(ONE, green, 0.0, None)]].concat(),
        0.5,
    )];
    for q in [0.5, 0.01] {
        for front in around(splat_reach(q)) {
            cases.push((
                vec![
                    (half, red, 2.0, None),
                    (half, green, front, None),
                    (half, blue, q, None),
                ],
                -1.0,
            ));
            cases.push((
                [
                    &front_splats[..],
                    &[(half, red, front, None), (quarter, green, q, None)],
                ]
                .concat(),
                -1.0,
            ));
        }
        for front in around(background_reach(q)) {
            cases.push((vec![(half, red, 2.0, None), (half, green, front, None)], q));
            cases.push((vec![(half, green, front, None)], q));
        }
        let border = (reach_at_background(q) - TOLERANCE.least)
            .min(reach_at_background(q) / (1.0 + TOLERANCE.relative));
        for hidden in around(border) {
            cases.push((vec![(half, green, hidden, None)], q));
        }
        assert!(
            reach(border, TOLERANCE.relative) >= q,
            "the whole tolerance would accept it"
        );
    }
    for q in [0.0, 0.01] {
        cases.extend([
            (vec![(half, red, 1.0, None), (half, blue, q, None)], -1.0),
            (vec![(half, red, 1.0, None)], q),
            (vec![(quarter, red, q, None)], q),
            (vec![(half, red, q, None), (quarter, blue, 0.0, None)], -1.0),
        ]);
    }
    let color = [0, 130, 130];
    for (splats, q) in cases {
        let mut pixel = FirstPixel::default();
        for (weight, color, q, _) in &splats {
            pixel.add(*color, *weight, *q);
        }
        let mut background: TileBackground = [([[0; 4]; BLOCK], [-1.0; BLOCK]); TILE_ROWS];
        let has_background = q >= 0.0;
        if has_background {
            background[0].0[0] = [color[0], color[1], color[2], 255];
            background[0].1[0] = q;
        }
        let (expected, front) =
            expected_pixel(splats.iter().copied(), has_background.then_some((color, q)));
        for level in simd::levels() {
            let (_, rows) = peel_tile(level, &pixel.0, Some(&background));
            let color = rows[0].0[0].to_le_bytes();
            assert!(
                max_difference(color, expected) <= LEVELS,
                "{color:?} for {expected:?}: {splats:?} before {q}"
            );
            assert_eq!(
                (color[3], rows[0].1[0]),
                (expected[3], front),
                "{splats:?} before {q}"
            );
        }
    }
}

#[test]
fn touched_rows_are_those_of_each_splat() {
    let splat = |rows| TileSplat {
        rows,
        ..random_splats(&mut Rng::keyed(1), 1)[0]
    };
    let splats = [splat([3, 5]), splat([9, 10]), splat([30, 32])];
    let (touched, _) = peel_tile(Level::new(), &splats, None);
    assert!(touched.rows().eq([3, 4, 9, 30, 31]));
}

/// A canvas of several tiles, of which the last column and row extend beyond the frame, against the
/// definition.
#[test]
fn tents_are_drawn_in_every_tile_that_they_touch() {
    let mut random = Rng::keyed(8);
    let rows = 5..45;
    let mut canvas = SurfaceCanvas::default();
    for (width, count) in [(16, 150), (20, 8), (20, 150)] {
        let mut splats = Box::new(Splats::new());
        splats.len = count;
        for i in 0..count {
            splats.x[i] = random.between(-1.0, f64::from(width) + 1.0) as f32;
            splats.y[i] = random.between(4.0, 46.0) as f32;
            splats.radius_x[i] = random.between(0.75, 3.0) as f32;
            splats.radius_y[i] = random.between(0.75, 3.0) as f32;
            splats.weight[i] = random.between(0.2, 1.0) as f32;
            splats.inverse_depth[i] = (1 + random.below(4)) as f32;
            splats.color[i] =
                u32::from_ne_bytes([random.below(256) as u8, random.below(256) as u8, 30, 255]);
        }
        let mut tents = Box::<Tents>::default();
        let bounds = [[0.0, width as f32], [5.0, 45.0]];
        dispatch!(simd::level(), simd => tents.fill(simd, &splats, bounds));
        let pixel_splats = |x: i32, y: i32| -> Vec<PixelSplat> {
            let touching = (0..count).filter(|i| {
                tents.columns.touched(*i).contains(&x) && tents.rows.touched(*i).contains(&y)
            });
            let height = |[distance, _]: [i32; 2]| (TOP - distance.abs()).max(0).cast_unsigned();
            let splat = |i: usize| {
                let [across, down] = [
                    tents.columns.starting_at(i, x),
                    tents.rows.starting_at(i, y),
                ];
                let peak = (tents.peak[i] * height(down)) >> 15;
                let weight = (peak * height(across) + (1 << 23)) >> 24;
                let [r, g, b, _] = splats.color[i].to_ne_bytes();
                let place = place(SplatKind::Opaque, across[0], down[0]);
                (weight, [r, g, b], splats.inverse_depth[i], place)
            };
            touching.map(splat).collect()
        };
        for level in simd::levels() {
            canvas.clear(width as u32, rows.clone(), TOLERANCE);
            canvas.draw(&splats, level);
            canvas.flush(level);
            for y in rows.clone() {
                let mut colors = vec![[9; 4]; width as usize];
                let mut depths = vec![9.0; width as usize];
                canvas.resolve(y as usize - 5, 0, &mut colors, level);
                canvas.read_depths(y as usize - 5, 0, &mut depths);
                for x in 0..width {
                    let (expected, front) = expected_pixel(pixel_splats(x, y.cast_signed()), None);
                    let color = colors[x as usize];
                    assert!(
                        max_difference(color, expected) <= LEVELS,
                        "{color:?} for {expected:?} at {x}, {y} of {width}"
                    );
                    assert_eq!(depths[x as usize], front, "{x}, {y} of {width}");
                }
            }
        }
    }
}

#[test]
fn tolerance_grows_with_angle_of_face_pixel() {
    // The sum of 1.5 % and 7.2 / face_px.
    for (face_px, expected) in [(64, 0.1275), (512, 0.029_062_5), (1024, 0.022_031_25)] {
        assert!((SurfaceCanvas::tolerance(face_px) - expected).abs() < 1e-7);
    }
}

/// The samples of four LDI pixels, in some of which a curtain is in front of the wall
/// (docs/decisions/0049).
#[test]
fn opaque_surface_hides_background() {
    let curtain = [250, 0, 0];
    let wall = [0, 0, 250];
    let tree = [0, 250, 0];
    for in_front in 0..16 {
        let mut pixel = FirstPixel::default();
        for ldi_pixel in 0..4 {
            pixel.add(tree, ONE / 4, 1.0);
            pixel.add(wall, ONE / 4, 2.0);
            if in_front >> ldi_pixel & 1 == 1 {
                pixel.add(curtain, ONE / 8, 3.0);
            }
        }
        let [_, green, _, share] = pixel.color();
        assert_eq!((green, share), (0, 255), "{in_front:04b}");
    }
}
