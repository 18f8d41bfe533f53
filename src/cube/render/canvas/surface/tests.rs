//! Peeled tiles against the definition, splat by splat.

use super::mean::{BLOCK, MIN_SHARE, OPAQUE, together};
use super::peel::{GROUND_PART, Peel, Tolerance, Touched};
use super::piece::{Piece, TILE_ROWS};
use super::{Canvas, Splats, SurfaceCanvas, Tents};
use crate::render::canvas::linear::LinearLight;
use crate::render::footprint::tent::{ONE, PEAK_STEPS, TOP};
use fearless_simd::{Level, dispatch};
use headbox_core::random::Rng;
use headbox_core::simd;

const TOLERANCE: Tolerance = Tolerance {
    relative: 0.05,
    least: 0.001,
};

/// Of each row of a tile, what lies under it.
type Ground = [([[u8; 4]; BLOCK], [f32; BLOCK]); TILE_ROWS];

/// Colours with shares of 255, and inverse depths, row by row.
type Shown = Vec<([u32; BLOCK], [f32; BLOCK])>;

fn peeled(level: Level, pieces: &[Piece], ground: Option<&Ground>) -> (Touched, Shown) {
    let mut peel = Peel::default();
    let under = |row: usize| ground.map(|ground| (&ground[row].0, &ground[row].1));
    let touched =
        dispatch!(level, simd => peel.draw(simd, pieces, under, TOLERANCE, LinearLight::tables()));
    let shown = touched
        .rows()
        .map(|row| (*peel.shown(row).0, *peel.shown(row).1))
        .collect();
    (touched, shown)
}

/// A splat in one pixel: weight, colour and inverse depth.
type Splat = (u32, [u8; 3], f32);

/// The mean of splats, and the share of 255 that they have.
fn mean(splats: &[Splat]) -> [u8; 4] {
    let weight: u32 = splats.iter().map(|(weight, ..)| weight).sum();
    if weight == 0 {
        return [0; 4];
    }
    let channel = |i: usize| {
        let sum: f64 = splats
            .iter()
            .map(|(weight, color, _)| f64::from(*weight) * f64::from(color[i]))
            .sum();
        (sum / f64::from(weight)).round() as u8
    };
    let share = (weight.min(OPAQUE) * 255 / OPAQUE).max(MIN_SHARE) as u8;
    [channel(0), channel(1), channel(2), share]
}

/// The largest inverse depth in front of a surface with which it is still one.
fn reach(q: f32, relative: f32) -> f32 {
    q + (q * relative).max(TOLERANCE.least)
}

/// What splats show in a pixel, and a colour under them: the definition. And the inverse depth in front.
fn of_pixel(
    splats: impl IntoIterator<Item = Splat>,
    ground: Option<([u8; 3], f32)>,
) -> ([u8; 4], f32) {
    let splats = splats.into_iter().map(|splat| (splat, TOLERANCE.relative));
    let ground = ground.map(|(color, q)| ((ONE, color, q), TOLERANCE.relative * GROUND_PART));
    let mut left: Vec<(Splat, f32)> = splats
        .chain(ground)
        .filter(|((weight, ..), _)| *weight > 0)
        .collect();
    let mut surfaces = [[0; 4]; 3];
    let nearest = |left: &[(Splat, f32)]| left.iter().map(|((.., q), _)| *q).fold(-1.0, f32::max);
    let front = nearest(&left).max(0.0);
    for surface in &mut surfaces[..2] {
        let nearest = nearest(&left);
        let (on_it, behind): (Vec<_>, Vec<_>) = left
            .into_iter()
            .partition(|((.., q), relative)| nearest <= reach(*q, *relative));
        *surface = mean(
            &on_it
                .into_iter()
                .map(|(splat, _)| splat)
                .collect::<Vec<_>>(),
        );
        left = behind;
    }
    surfaces[2] = mean(&left.into_iter().map(|(splat, _)| splat).collect::<Vec<_>>());
    (together(surfaces, LinearLight::tables()), front)
}

fn weight_of(piece: &Piece, column: usize, row: usize) -> u32 {
    let height = |[at, step]: [i32; 2], line: usize| {
        (TOP - (at + line as i32 * step).abs())
            .max(0)
            .cast_unsigned()
    };
    let is_inside = (piece.rows[0]..piece.rows[1]).contains(&(row as u16));
    let peak = (piece.peak * height(piece.down, row)) >> 15;
    if is_inside {
        (peak * height(piece.across, column) + (1 << 23)) >> 24
    } else {
        0
    }
}

/// Tents in random places, near each other in depth and far apart.
fn some_pieces(random: &mut Rng, count: usize) -> Vec<Piece> {
    let mut uniform = || random.below(1 << 20) as f64 / f64::from(1 << 20);
    let mut piece = |_| {
        let mut line = |room: f64| {
            let (middle, radius) = (uniform() * room, 0.75 + 2.0 * uniform());
            let step = f64::from(TOP) / radius;
            let rows = [
                (middle - radius).max(0.0) as u16,
                (middle + radius).ceil().min(room) as u16,
            ];
            ([((0.5 - middle) * step) as i32, step as i32], rows)
        };
        let ((across, _), (down, rows)) = (line(BLOCK as f64), line(TILE_ROWS as f64));
        let color = [0; 4].map(|_: u8| (uniform() * 256.0) as u8);
        let inverse_depth = ((uniform() * 4.0).floor() + 1.0 + 0.03 * uniform()) as f32;
        Piece {
            across,
            down,
            peak: (uniform() * f64::from(ONE * PEAK_STEPS)) as u32,
            color,
            inverse_depth,
            rows,
        }
    };
    (0..count).map(&mut piece).collect()
}

/// Half the tile shows a plane behind some of the splats.
fn some_ground() -> Ground {
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

/// Light of three colours mixed by tables of 12 bits, from means rounded to whole levels.
const LEVELS: u8 = 2;

#[test]
fn tiles_show_what_the_definition_says_at_every_level_in_any_order() {
    let (mut random, ground) = (Rng::keyed(3), some_ground());
    for count in [1, 2, 7, 60, 700] {
        let mut pieces = some_pieces(&mut random, count);
        for ground in [None, Some(&ground)] {
            let (touched, shown) = peeled(Level::baseline(), &pieces, ground);
            for (row, (colors, inverse_depths)) in touched.rows().zip(&shown) {
                for i in 0..BLOCK {
                    let drawn = pieces.iter().map(|piece| {
                        let [r, g, b, _] = piece.color;
                        (weight_of(piece, i, row), [r, g, b], piece.inverse_depth)
                    });
                    let under = ground
                        .filter(|ground| ground[row].0[i][3] == 255)
                        .map(|ground| {
                            let [r, g, b, _] = ground[row].0[i];
                            ([r, g, b], ground[row].1[i])
                        });
                    let (expected, front) = of_pixel(drawn, under);
                    let found = colors[i].to_le_bytes();
                    let apart = found.iter().zip(expected).map(|(a, b)| a.abs_diff(b)).max();
                    assert!(
                        apart <= Some(LEVELS),
                        "{count}: {found:?} for {expected:?} at {i}, {row}"
                    );
                    assert_eq!((found[3], inverse_depths[i]), (expected[3], front));
                }
            }
            for level in simd::levels() {
                pieces.reverse();
                pieces.rotate_left(count / 3);
                assert_eq!(
                    peeled(level, &pieces, ground),
                    (touched, shown.clone()),
                    "{level:?}"
                );
            }
        }
    }
}

/// The pixel in the first column and row of a tile.
#[derive(Default)]
struct Pixel(Vec<Piece>);

impl Pixel {
    fn add(&mut self, [r, g, b]: [u8; 3], weight: u32, inverse_depth: f32) {
        let here = [0, TOP];
        let (peak, color) = (weight * PEAK_STEPS, [r, g, b, 255]);
        self.0.push(Piece {
            across: here,
            down: here,
            peak,
            color,
            inverse_depth,
            rows: [0, 1],
        });
    }

    fn color(&self) -> [u8; 4] {
        peeled(simd::level(), &self.0, None).1[0].0[0].to_le_bytes()
    }
}

#[test]
fn surfaces_are_blended_in_depth_order() {
    let (red, blue, green) = ([250, 0, 0], [0, 0, 250], [0, 250, 0]);
    let mut pixel = Pixel::default();
    pixel.add(blue, ONE, 1.0);
    pixel.add(red, OPAQUE / 2, 2.0);
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
        "green comes between"
    );
    pixel.add(red, ONE, 2.02);
    assert_eq!(pixel.color(), [250, 0, 0, 255]);
}

#[test]
fn one_colour_stays_one_colour_however_many_splats() {
    for weight in [1, 3, 37, ONE] {
        let mut pixel = Pixel::default();
        for _ in 0..10_000 {
            pixel.add([201, 0, 255], weight, 1.0);
        }
        assert_eq!(pixel.color(), [201, 0, 255, 255]);
    }
}

/// What is in front, in the middle and behind, with splats at the tolerance's very border and infinitely far away.
#[test]
fn borders_of_surfaces_are_part_of_them() {
    let [of_splat, of_ground] =
        [1.0, GROUND_PART].map(|part| move |q| reach(q, TOLERANCE.relative * part));
    let (half, [red, green, blue]) = (OPAQUE / 2, [[250, 0, 0], [0, 250, 0], [0, 0, 250]]);
    let quarter = half / 2;
    let near = [(quarter, red, of_splat(1.0)), (quarter, blue, 1.0)];
    // The nearer of two surfaces a little nearer than the border, on it, and a little beyond.
    let around = |border: f32| [border.next_down(), border, border.next_up()];
    let mut cases: Vec<(Vec<Splat>, f32)> = vec![([&near[..], &[(ONE, green, 0.0)]].concat(), 0.5)];
    for q in [0.5, 0.01] {
        for front in around(of_splat(q)) {
            cases.push((
                vec![(half, red, 2.0), (half, green, front), (half, blue, q)],
                -1.0,
            ));
            cases.push((
                [&near[..], &[(half, red, front), (quarter, green, q)]].concat(),
                -1.0,
            ));
        }
        for front in around(of_ground(q)) {
            cases.push((vec![(half, red, 2.0), (half, green, front)], q));
            cases.push((vec![(half, green, front)], q));
        }
    }
    for q in [0.0, 0.01] {
        cases.extend([
            (vec![(half, red, 1.0), (half, blue, q)], -1.0),
            (vec![(half, red, 1.0)], q),
        ]);
        cases.extend([
            (vec![(quarter, red, q)], q),
            (vec![(half, red, q), (quarter, blue, 0.0)], -1.0),
        ]);
    }
    let under = [0, 130, 130];
    for (splats, q) in cases {
        let mut pixel = Pixel::default();
        splats
            .iter()
            .for_each(|(weight, color, q)| pixel.add(*color, *weight, *q));
        let mut ground: Ground = [([[0; 4]; BLOCK], [-1.0; BLOCK]); TILE_ROWS];
        let is_there = q >= 0.0;
        if is_there {
            (ground[0].0[0], ground[0].1[0]) = ([under[0], under[1], under[2], 255], q);
        }
        let (expected, front) = of_pixel(splats.iter().copied(), is_there.then_some((under, q)));
        for level in simd::levels() {
            let (_, shown) = peeled(level, &pixel.0, Some(&ground));
            let found = shown[0].0[0].to_le_bytes();
            let apart = found.iter().zip(expected).map(|(a, b)| a.abs_diff(b)).max();
            assert!(
                apart <= Some(LEVELS),
                "{found:?} for {expected:?}: {splats:?} before {q}"
            );
            assert_eq!(
                (found[3], shown[0].1[0]),
                (expected[3], front),
                "{splats:?} before {q}"
            );
        }
    }
}

#[test]
fn rows_are_touched_from_the_first_to_the_last_of_each_piece() {
    let piece = |rows| Piece {
        rows,
        ..some_pieces(&mut Rng::keyed(1), 1)[0]
    };
    let (touched, _) = peeled(
        Level::new(),
        &[piece([3, 5]), piece([9, 10]), piece([30, 32])],
        None,
    );
    assert!(touched.rows().eq([3, 4, 9, 30, 31]));
}

/// A frame of tiles, of which the last column and the last row may lie beyond it in part, against the definition.
#[test]
fn tents_show_in_every_tile_that_they_reach() {
    let (mut random, rows) = (Rng::keyed(8), 5..45);
    let mut canvas = SurfaceCanvas {
        tolerance: TOLERANCE.relative,
        bin: TOLERANCE.least,
        ..SurfaceCanvas::default()
    };
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
        let (mut tents, bounds) = (Box::<Tents>::default(), [[0.0, width as f32], [5.0, 45.0]]);
        dispatch!(simd::level(), simd => tents.fill(simd, &splats, bounds));
        let drawn = |x: i32, y: i32| -> Vec<Splat> {
            let touching = (0..count)
                .filter(|i| tents.columns.of(*i).contains(&x) && tents.rows.of(*i).contains(&y));
            let height = |[at, _]: [i32; 2]| (TOP - at.abs()).max(0).cast_unsigned();
            let splat = |i: usize| {
                let peak = (tents.peak[i] * height(tents.rows.from(i, y))) >> 15;
                let weight = (peak * height(tents.columns.from(i, x)) + (1 << 23)) >> 24;
                let [r, g, b, _] = splats.color[i].to_ne_bytes();
                (weight, [r, g, b], splats.inverse_depth[i])
            };
            touching.map(splat).collect()
        };
        for level in simd::levels() {
            canvas.clear(width as u32, rows.clone());
            canvas.draw(&splats, level);
            canvas.settle(level);
            for y in rows.clone() {
                let (mut colors, mut depths) =
                    (vec![[9; 4]; width as usize], vec![9.0; width as usize]);
                canvas.resolve(y as usize - 5, 0, &mut colors, level);
                canvas.tell_depths(y as usize - 5, 0, &mut depths);
                for x in 0..width {
                    let (expected, front) = of_pixel(drawn(x, y.cast_signed()), None);
                    let found = colors[x as usize];
                    let apart = found.iter().zip(expected).map(|(a, b)| a.abs_diff(b)).max();
                    assert!(
                        apart <= Some(LEVELS),
                        "{found:?} for {expected:?} at {x}, {y} of {width}"
                    );
                    assert_eq!(depths[x as usize], front, "{x}, {y} of {width}");
                }
            }
        }
    }
}

#[test]
fn tolerances_grow_with_a_face_pixels_angle() {
    // The sum of 1.5 % and 7.2 / face_px.
    for (face_px, expected) in [(64, 0.1275), (512, 0.029_062_5), (1024, 0.022_031_25)] {
        assert!((SurfaceCanvas::tolerance(face_px) - expected).abs() < 1e-7);
    }
}

/// The samples of four LDI pixels, in some of which a curtain is in front of the wall, and hides it for good (docs/decisions/0049).
#[test]
fn what_is_behind_a_whole_surface_is_hidden_whoever_else_is_in_front() {
    let (curtain, wall, tree) = ([250, 0, 0], [0, 0, 250], [0, 250, 0]);
    for in_front in 0..16 {
        let mut pixel = Pixel::default();
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
