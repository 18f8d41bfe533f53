//! Rows of a frame, put over the environment pixel after pixel.

use super::*;
use headbox_core::random::Rng;
use headbox_core::simd;

/// Levels by which the environment's sixteen samples at a time may differ from one: directions run in f32 along a row.
const LEVELS: u8 = 1;

#[test]
fn what_splats_leave_open_shows_the_environment_pixel_by_pixel() {
    let mut random = Rng::keyed(2);
    // Some texels of it are not known.
    let texels = (0..6 * 16 * 16).map(|i| if i / 16 % 16 < 3 { [0; 4] } else { [(i % 16 * 12) as u8, 90, 200, 255] });
    let environment = Environment { size_px: 16, texels: texels.collect() };
    let camera = Camera::look_at(DVec3::ZERO, DVec3::new(1.0, 0.8, 0.2), DVec3::Y, 100.0, [37, 20]).expect("valid");
    let (width, mut mixed, mut all_holes) = (37, 0, 0);
    for y in 0..20 {
        let resolved: Vec<[u8; 4]> = (0..width)
            .map(|_| {
                let share = [0, 255, random.below(256) as u8][random.below(3) as usize];
                [random.below(256) as u8, random.below(256) as u8, random.below(256) as u8, share]
            })
            .collect();
        let mut holes = 0;
        let expected: Vec<([u8; 3], Coverage, bool)> = (0..)
            .zip(&resolved)
            .map(|(x, &[r, g, b, share])| {
                let seen = environment.sample(camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5).as_vec3());
                let of_splats = Coverage::of_splats(share);
                match (share, seen) {
                    (255, _) => ([r, g, b], Coverage::FULL, true),
                    (0, Some(seen)) => (seen, Coverage::ENVIRONMENT, false),
                    (0, None) => {
                        holes += 1;
                        ([1, 2, 3], Coverage::HOLE, false)
                    }
                    (_, None) => ([r, g, b], of_splats, true),
                    (_, Some(seen)) => {
                        mixed += 1;
                        let shares = [u32::from(share), 255 - u32::from(share)];
                        (LinearLight::tables().mix([[r, g, b], seen], shares), of_splats, true)
                    }
                }
            })
            .collect();
        for level in simd::levels() {
            let (mut colors, mut depths_m) = (resolved.clone(), vec![3.0; width]);
            let mut coverages = vec![Coverage::HOLE; width];
            let background =
                Background { environment: &environment, camera: &camera, hole_color_srgb: [1, 2, 3], level };
            let pixels = Pixels {
                colors: &mut colors,
                coverages: &mut coverages,
                depths_m: &mut depths_m,
                inverse_depths: &mut [],
            };
            assert_eq!(background.put_under(y, pixels), holes);
            for (x, (color, coverage, has_depth)) in expected.iter().enumerate() {
                assert!(
                    (0..3).all(|c| colors[x][c].abs_diff(color[c]) <= LEVELS),
                    "{x}, {y}: {:?} {color:?}",
                    colors[x]
                );
                assert_eq!(
                    (colors[x][3], coverages[x], depths_m[x].is_finite()),
                    (255, *coverage, *has_depth),
                    "{x}, {y}"
                );
            }
        }
        all_holes += holes;
    }
    assert!(mixed > 50 && all_holes > 10, "{mixed} {all_holes}");
}

#[test]
fn pieces_of_depths_are_as_many_as_those_of_colours() {
    assert_eq!(depth_pieces(&mut [0.0; 10], 4, 3).map(|piece| piece.len()).collect::<Vec<_>>(), [4, 4, 2]);
    assert_eq!(depth_pieces(&mut [], 4, 3).map(|piece| piece.len()).collect::<Vec<_>>(), [0, 0, 0]);
}
