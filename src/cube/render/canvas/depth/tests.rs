//! Small canvases, pixel by pixel.

use super::*;

fn one(x: f32, y: f32, [rx, ry]: [f32; 2], inverse_depth: f32) -> Box<Splats> {
    let mut splats = Box::new(Splats::new());
    splats.len = 1;
    (splats.x[0], splats.y[0], splats.radius_x[0], splats.radius_y[0]) = (x, y, rx, ry);
    splats.inverse_depth[0] = inverse_depth;
    splats
}

#[test]
fn a_splat_owns_its_share_and_fills_the_rest_where_nothing_is() {
    let (width, rows) = (12, 3..11);
    let splats = [
        one(5.2, 6.4, [3.0, 2.0], 0.5),
        one(8.1, 7.3, [2.4, 3.1], 0.25),
        one(0.3, 3.2, [1.9, 1.2], 2.0),
        one(11.6, 10.5, [0.4, 0.3], 1.0),
    ];
    for own in [0.5, 0.2] {
        let mut canvas = DepthCanvas::default();
        canvas.clear(width, rows.clone());
        let mut expected = vec![0.0f32; 12 * 8];
        for splat in &splats {
            canvas.draw(splat, own, &PlaneCanvas::default());
            let (x, y, [rx, ry]) = (splat.x[0], splat.y[0], [splat.radius_x[0], splat.radius_y[0]]);
            for (i, pixel) in expected.iter_mut().enumerate() {
                let (dx, dy) = ((i % 12) as f32 + 0.5 - x, (i / 12) as f32 + 3.5 - y);
                let within = |rx: f32, ry: f32| dx.abs() < rx && dy.abs() < ry;
                let is_own = within((rx * own).max(0.5), (ry * own).max(0.5));
                if within(rx + BORDER, ry + BORDER) && (*pixel == 0.0 || is_own) {
                    *pixel = splat.inverse_depth[0];
                }
            }
        }
        for row in 0..8 {
            let mut found = vec![0.0; 9];
            canvas.resolve(row, 2, &mut found);
            let expected: Vec<f32> = expected[row * 12 + 2..row * 12 + 11].iter().map(|q| 1.0 / q).collect();
            assert_eq!(found, expected, "row {row}");
        }
    }
}

#[test]
fn a_pixel_has_the_depth_of_what_covers_half_of_it() {
    let mut canvas = DepthCanvas::default();
    canvas.clear(4, 0..2);
    canvas.draw(&one(1.5, 1.5, [0.5, 0.5], 0.5), 1.0, &PlaneCanvas::default());
    let rim =
        |column: u32, share: u8, inverse_depth: f32| Rim { pixel: [column, 1], color: [0, 0, 0, share], inverse_depth };
    canvas.add_rims(&[rim(0, 1, 0.25), rim(1, 127, 1.0), rim(2, 0, -1.0)]);
    assert_eq!(canvas.inverse_depth[4..], [0.25, 0.5, 0.0, 0.0], "less than half, and nothing before it");
    canvas.add_rims(&[rim(0, 128, 0.2), rim(1, 128, 0.6), rim(1, 255, 0.5), rim(9, 255, 9.0)]);
    assert_eq!(canvas.inverse_depth, [0.0, 0.0, 0.0, 0.0, 0.25, 0.6, 0.0, 0.0], "half, if it is nearer");
}

#[test]
fn some_columns_of_a_frame_are_made_empty() {
    let mut canvas = DepthCanvas::default();
    canvas.clear(6, 0..2);
    canvas.draw(&one(3.0, 1.0, [3.0, 1.0], 0.5), 1.0, &PlaneCanvas::default());
    canvas.clear_spans([6, 2], &|y| [0..1 + y, 3..3, 4..5]);
    assert_eq!(canvas.inverse_depth, [0.0, 0.5, 0.5, 0.5, 0.0, 0.5, 0.0, 0.0, 0.5, 0.5, 0.0, 0.5]);
    canvas.clear_spans([3, 2], &|_| [0..0, 0..0, 0..0]);
    assert_eq!(canvas.inverse_depth, [0.0; 6], "another size is all new");
}
