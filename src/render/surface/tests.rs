//! Peeled tiles against the definition, splat by splat.

use super::mean::{BLOCK, MIN_SHARE, OPAQUE, together};
use super::peel::{Peel, Tolerance, Touched};
use super::piece::{Piece, TILE_ROWS};
use crate::capture::random::Rng;
use crate::capture::simd;
use crate::render::linear::LinearLight;
use crate::render::tent::{ONE, PEAK_STEPS, TOP};
use fearless_simd::{Level, dispatch};

const TOLERANCE: Tolerance = Tolerance { relative: 0.05, least: 0.001 };

/// Of each row of a tile, what lies under it.
type Ground = [([[u8; 4]; BLOCK], [f32; BLOCK]); TILE_ROWS];

/// Colours with shares of 255, and inverse depths, row by row.
type Shown = Vec<([u32; BLOCK], [f32; BLOCK])>;

fn peeled(level: Level, pieces: &[Piece], ground: Option<&Ground>) -> (Touched, Shown) {
    let mut peel = Peel::default();
    let under = |row: usize| ground.map(|ground| (&ground[row].0, &ground[row].1));
    let touched = dispatch!(level, simd => peel.draw(simd, pieces, under, TOLERANCE, LinearLight::tables()));
    let shown = touched.rows().map(|row| (*peel.shown(row).0, *peel.shown(row).1)).collect();
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
        let sum: f64 = splats.iter().map(|(weight, color, _)| f64::from(*weight) * f64::from(color[i])).sum();
        (sum / f64::from(weight)).round() as u8
    };
    let share = (weight.min(OPAQUE) * 255 / OPAQUE).max(MIN_SHARE) as u8;
    [channel(0), channel(1), channel(2), share]
}

/// What splats show in a pixel: the definition. And the inverse depth in front.
fn of_pixel(mut splats: Vec<Splat>) -> ([u8; 4], f32) {
    splats.retain(|(weight, ..)| *weight > 0);
    let mut surfaces = [[0; 4]; 3];
    let nearest = |splats: &[Splat]| splats.iter().map(|(.., q)| *q).fold(-1.0, f32::max);
    let front = nearest(&splats).max(0.0);
    for surface in &mut surfaces[..2] {
        let nearest = nearest(&splats);
        let on_it = |(.., q): &Splat| nearest <= q + (q * TOLERANCE.relative).max(TOLERANCE.least);
        *surface = mean(&splats.iter().copied().filter(on_it).collect::<Vec<_>>());
        splats.retain(|splat| !on_it(splat));
    }
    surfaces[2] = mean(&splats);
    (together(surfaces, LinearLight::tables()), front)
}

fn weight_of(piece: &Piece, column: usize, row: usize) -> u32 {
    let height = |[at, step]: [i32; 2], line: usize| (TOP - (at + line as i32 * step).abs()).max(0).cast_unsigned();
    let is_inside = (piece.rows[0]..piece.rows[1]).contains(&(row as u16));
    let peak = (piece.peak * height(piece.down, row)) >> 15;
    if is_inside { (peak * height(piece.across, column) + (1 << 23)) >> 24 } else { 0 }
}

/// Tents in random places, near each other in depth and far apart.
fn some_pieces(random: &mut Rng, count: usize) -> Vec<Piece> {
    let mut uniform = || random.below(1 << 20) as f64 / f64::from(1 << 20);
    let mut piece = |_| {
        let mut line = |room: f64| {
            let (middle, radius) = (uniform() * room, 0.75 + 2.0 * uniform());
            let step = f64::from(TOP) / radius;
            let rows = [(middle - radius).max(0.0) as u16, (middle + radius).ceil().min(room) as u16];
            ([((0.5 - middle) * step) as i32, step as i32], rows)
        };
        let ((across, _), (down, rows)) = (line(BLOCK as f64), line(TILE_ROWS as f64));
        let color = [0; 4].map(|_: u8| (uniform() * 256.0) as u8);
        let inverse_depth = ((uniform() * 4.0).floor() + 1.0 + 0.03 * uniform()) as f32;
        Piece { across, down, peak: (uniform() * f64::from(ONE * PEAK_STEPS)) as u32, color, inverse_depth, rows }
    };
    (0..count).map(&mut piece).collect()
}

/// Half the tile shows a plane behind some of the splats.
fn some_ground() -> Ground {
    let half = |row: usize| std::array::from_fn(|i| [200, 7 * row as u8, 30 * i as u8, if i < 4 { 255 } else { 0 }]);
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
                    let under = ground.filter(|ground| ground[row].0[i][3] == 255).map(|ground| {
                        let [r, g, b, _] = ground[row].0[i];
                        (ONE, [r, g, b], ground[row].1[i])
                    });
                    let (expected, front) = of_pixel(drawn.chain(under).collect());
                    let found = colors[i].to_le_bytes();
                    let apart = found.iter().zip(expected).map(|(a, b)| a.abs_diff(b)).max();
                    assert!(apart <= Some(LEVELS), "{count}: {found:?} for {expected:?} at {i}, {row}");
                    assert_eq!((found[3], inverse_depths[i]), (expected[3], front));
                }
            }
            for level in simd::levels() {
                pieces.reverse();
                pieces.rotate_left(count / 3);
                assert_eq!(peeled(level, &pieces, ground), (touched, shown.clone()), "{level:?}");
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
        self.0.push(Piece { across: here, down: here, peak, color, inverse_depth, rows: [0, 1] });
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
    assert!(r.abs_diff(184) <= 2 && g == 0 && b.abs_diff(184) <= 2 && share == 255, "half red over blue");
    pixel.add(green, ONE, 1.5);
    let [r, g, b, _] = pixel.color();
    assert!(r.abs_diff(184) <= 2 && g.abs_diff(184) <= 2 && b == 0, "green comes between");
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

/// The samples of four LDI pixels, in some of which a curtain is in front of the wall, and hides it for good (docs/decisions.md: three
/// surfaces in a pixel).
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
