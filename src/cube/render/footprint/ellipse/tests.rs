//! Gaussians and the rules by which they are averaged, against the formulas.

use super::*;
use headbox_core::simd;

/// Levels of sRGB by which tables and rounding may err.
const LEVELS: u8 = 1;

fn canvas() -> EllipseCanvas {
    let mut canvas = EllipseCanvas { tolerance: 0.01, bin: 0.001, ..EllipseCanvas::default() };
    canvas.clear(20, 4..16);
    canvas
}

fn one(color: [u8; 4], weight: f32, correlation: f32) -> Box<Splats> {
    let mut splats = Box::new(Splats::new());
    splats.len = 1;
    (splats.x[0], splats.y[0], splats.radius_x[0], splats.radius_y[0]) = (9.3, 9.8, 6.0, 4.0);
    (splats.weight[0], splats.correlation[0], splats.inverse_depth[0]) = (weight, correlation, 0.5);
    splats.color[0] = u32::from_ne_bytes(color);
    splats
}

#[test]
fn a_splat_is_a_gaussian_whose_volume_is_its_weight() {
    for (weight, correlation, alpha) in [(0.4, 0.0, 255), (0.7, 0.6, 255), (0.5, -0.8, 100), (1e-4, 0.0, 255)] {
        for level in simd::levels() {
            let mut canvas = canvas();
            canvas.draw(&one([9, 9, 9, alpha], weight, correlation), level);
            let mut sum = 0.0;
            for (i, cell) in canvas.cells.iter().enumerate() {
                // 2.5 deviations to the border.
                let (u, v) = (((i % 20) as f32 + 0.5 - 9.3) / 2.4, ((i / 20) as f32 + 4.5 - 9.8) / 1.6);
                let rest = 1.0 - correlation * correlation;
                let squared = (u * u + v * v - 2.0 * correlation * u * v) / rest;
                // The weight times the area of the bounds of a deviation, over the Gaussian's volume, in spacings of a sample.
                let peak = (weight * 6.25 / (std::f32::consts::TAU * rest.sqrt())).max(0.036);
                let expected =
                    if squared < 6.25 { peak * f32::from(alpha) / 255.0 * (-0.5 * squared).exp() } else { 0.0 };
                assert!((cell.weight - expected).abs() < 1e-5, "{u} {v}: {} {expected}", cell.weight);
                assert!((cell.sum[0] - expected * LINEAR[9]).abs() < 1e-6);
                sum += cell.weight;
            }
            // What 2.5 deviations leave out is exp(-3.125), 4.4 %.
            if weight > 0.1 {
                let volume = weight * 24.0 * f32::from(alpha) / 255.0;
                assert!((sum / volume / (1.0 - (-3.125f32).exp()) - 1.0).abs() < 0.03, "{sum} {volume}");
            }
        }
    }
}

#[test]
fn correlations_stay_below_one() {
    for (correlation, largest) in [(1.5, MAX_CORRELATION), (-1.5, -MAX_CORRELATION)] {
        let drawn = |correlation| {
            let mut canvas = canvas();
            canvas.draw(&one([9, 9, 9, 255], 0.5, correlation), Level::new());
            canvas.cells.iter().map(|cell| cell.weight).collect::<Vec<_>>()
        };
        let found = drawn(correlation);
        assert!(found == drawn(largest) && found.iter().any(|weight| *weight > 0.0));
    }
}

#[test]
fn surfaces_are_apart_by_a_part_of_their_depth_and_a_bin_at_least() {
    // A hundredth of 0.5 is 0.005; of 0.05 less than a bin of 0.001.
    for (q, nearer, is_one) in [(0.5, 0.504, true), (0.5, 0.506, false), (0.05, 0.0508, true), (0.05, 0.0512, false)] {
        let (mut canvas, mut splats) = (canvas(), one([9, 9, 9, 255], 0.5, 0.0));
        for q in [nearer, q] {
            splats.inverse_depth[0] = q;
            canvas.draw(&splats, Level::new());
        }
        let cell = canvas.cells.iter().max_by(|a, b| a.weight.total_cmp(&b.weight)).expect("some");
        assert_eq!((cell.behind == [0.0; 4], cell.inverse_depth), (is_one, nearer), "{q} and {nearer}");
    }
}

#[test]
fn surfaces_are_averaged_and_lie_over_what_is_behind() {
    let near = |found: [f32; 4], expected: [f32; 4]| {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{found:?}, not {expected:?}");
    };
    let (red, blue) = ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    let mut cell = Cell::default();
    near(cell.flattened(), [0.0; 4]);
    cell.add(red, 0.46, 0.5, 0.01);
    near(cell.flattened(), [0.5, 0.0, 0.0, 0.5]);
    // The same surface, from either side of its depth: means by weight.
    cell.add(blue, 0.23, 0.505, 0.01);
    near(cell.flattened(), [0.5, 0.0, 0.25, 0.75]);
    cell.add(blue, 0.23, 0.495, 0.01);
    near(cell.flattened(), [0.5, 0.0, 0.5, 1.0]);
    assert_eq!(cell.inverse_depth, 0.505);
    // Far behind what is whole: nothing.
    cell.add([9.0; 3], 0.9, 0.1, 0.01);
    near(cell.flattened(), [0.5, 0.0, 0.5, 1.0]);
    // A nearer one over all of it, which shows where it leaves it open; and at least a twentieth.
    cell.add(red, 0.23, 0.9, 0.01);
    near(cell.flattened(), [0.25 + 0.75 * 0.5, 0.0, 0.75 * 0.5, 1.0]);
    let mut heavy = Cell::default();
    heavy.add(red, 2.5, 0.5, 0.01);
    near(heavy.flattened(), [1.0, 0.0, 0.0, 1.0]);
    // Just as far apart as the tolerance is one surface.
    heavy.add(red, 1.0, 0.75, 0.25);
    assert_eq!((heavy.weight, heavy.behind), (3.5, [0.0; 4]));
    let mut thin = Cell::default();
    thin.add(blue, 1e-3, 0.5, 0.01);
    near(thin.flattened(), [0.0, 0.0, 0.05, 0.05]);
    // Behind what is open, later: over what is behind by its share; both together go on behind the front.
    let mut open = Cell::default();
    open.add(red, 0.46, 0.5, 0.01);
    open.add(blue, 0.25, 0.1, 0.01);
    near(open.flattened(), [0.5, 0.0, 0.25, 0.75]);
    open.add(red, 0.5, 0.1, 0.01);
    near(open.flattened(), [0.5 + 0.5 * 0.5 / 0.625, 0.0, 0.5 * 0.125 / 0.625, 1.0]);
    let mut green = Cell::default();
    green.add([0.0, 1.0, 0.0], 0.46, 0.5, 0.01);
    green.add([0.0, 0.5, 0.0], 0.25, 0.1, 0.01);
    near(green.flattened(), [0.0, 0.5 + 0.25 * 0.5, 0.0, 0.75]);
}

#[test]
fn pixels_are_straight_colours_and_shares() {
    let mut canvas = canvas();
    canvas.cells[5 * 20 + 7].add([LINEAR[180], LINEAR[90], LINEAR[20]], 0.46, 0.5, 0.01);
    let (mut found, mut depths) = ([[0; 4]; 3], [9.0; 3]);
    canvas.resolve(5, 6, &mut found, Level::new());
    canvas.tell_depths(5, 6, &mut depths);
    assert_eq!((found[0], found[2], depths), ([0; 4], [0; 4], [0.0, 0.5, 0.0]));
    assert!(found[1].iter().zip([180, 90, 20, 128]).all(|(a, b)| a.abs_diff(b) <= LEVELS), "{:?}", found[1]);
    assert_eq!(found[1][3], 128, "127.5, rounded");
    canvas.clear_spans([20, 16], &|_| [0..0, 0..0, 0..0]);
    canvas.cells.fill(Cell { weight: 1.0, ..Cell::default() });
    canvas.clear_spans([20, 16], &|y| [y..20, 0..0, 0..0]);
    assert!((0..20 * 16).all(|i| (canvas.cells[i].weight == 0.0) == (i % 20 >= i / 20)));
}
