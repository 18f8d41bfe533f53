//! Half planes, boundaries and divisions of rows, compared with angles in `f64`.

use super::*;
use headbox_core::random::Rng;

#[test]
fn diamond_angles_grow_with_angle_and_invert() {
    let mut last = -1.0;
    for i in 0..400 {
        let angle = f64::from(i) * std::f64::consts::TAU / 400.0;
        let diamond = diamond_angle(DVec2::from_angle(angle));
        assert!(diamond > last && (0.0..4.0).contains(&diamond), "{angle}");
        // Rounding of a few operations on numbers up to 4.
        assert!((unit_vector(diamond) - DVec2::from_angle(angle)).length() < 1e-14);
        last = diamond;
    }
    assert_eq!(diamond_angle(DVec2::new(1.0, -1e-300)), 0.0);
}

#[test]
fn histogram_is_divided_equally_from_empty_gap() {
    let mut histogram = AngleHistogram::default();
    histogram.clear();
    let mut angles = vec![1.0];
    histogram.divide(3, &mut angles);
    assert!(angles.is_empty(), "no weight");
    for i in 0..1000 {
        histogram.add(unit_vector(0.5 + f64::from(i) / 1000.0), 7);
    }
    histogram.divide(4, &mut angles);
    // A bin is 4 / BINS wide.
    let expected = [0.75, 1.0, 1.25, 3.0];
    assert!(
        angles.len() == 4
            && angles
                .iter()
                .zip(expected)
                .all(|(a, b)| (a - b).abs() < 0.002),
        "{angles:?}"
    );
    histogram.divide(1, &mut angles);
    assert!(angles.is_empty());
}

/// Creates a random camera, its eye and baseline, and a half plane through the baseline.
fn random_boundary(random: &mut Rng) -> (Camera, DVec3, Baseline, Boundary) {
    let eye = random.in_cube(0.5);
    let forward = random.in_cube(1.0);
    let fov_deg = random.between(40.0, 100.0);
    let camera = Camera::look_at(eye, eye + forward, DVec3::Y, fov_deg, [64, 48]).expect("valid");
    let baseline = Baseline::new(eye);
    let angle = random.between(0.0, 4.0);
    let boundary = Boundary::new(angle, &baseline, &camera, random.between(0.5, 6.0));
    (camera, eye, baseline, boundary)
}

/// Rounding error, in units of a direction's coordinates.
const ROUNDING: f64 = 1e-9;

/// A square touches a half plane if its corners lie on both sides of the line, and not all
/// behind the baseline.
#[test]
fn masks_are_pixels_whose_squares_touch_boundary() {
    let mut random = Rng::keyed(21);
    let mut inside = 0;
    let mut outside = 0;
    for _ in 0..400 {
        let (camera, _, baseline, boundary) = random_boundary(&mut random);
        let row = random.below(48) as u32;
        let mask = boundary.mask(&baseline.project_frame_row(&camera, row), 64);
        for x in 0..64 {
            let corners =
                [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(|(right, down)| {
                    let [x, y] = [(x, right), (row, down)]
                        .map(|(c, side)| f64::from(c) + 0.5 + side * boundary.radius_px);
                    boundary.coordinates(baseline.project(camera.direction(x, y)))
                });
            let across = corners.map(|corner| corner.x);
            let least = across.into_iter().fold(f64::MAX, f64::min);
            let most = across.into_iter().fold(f64::MIN, f64::max);
            let along = corners
                .map(|corner| corner.y)
                .into_iter()
                .fold(f64::MIN, f64::max);
            if [least, most, along]
                .iter()
                .any(|border| border.abs() < ROUNDING)
            {
                continue;
            }
            let touches = least < 0.0 && most > 0.0 && along > 0.0;
            assert_eq!(
                mask.contains(&x),
                touches,
                "{x} of row {row}, {mask:?}, {boundary:?}"
            );
            *(if touches { &mut inside } else { &mut outside }) += 1;
        }
    }
    assert!(inside > 500 && outside > 5000, "{inside} {outside}");
}

/// Creates boundaries at ascending diamond angles.
fn boundaries_at(angles: &[f64]) -> Vec<Boundary> {
    let camera = Camera::look_at(DVec3::ZERO, DVec3::X, DVec3::Y, 60.0, [64, 48]).expect("valid");
    let baseline = Baseline::default();
    let boundary = |angle: &f64| Boundary::new(*angle, &baseline, &camera, 1.0);
    angles.iter().map(boundary).collect()
}

/// Checks that the parts cover `range` in order and without gaps.
fn check_cover(parts: &[RowPart], range: &Range<u32>, name: &str) {
    let mut next = range.start;
    for part in parts {
        assert!(
            part.columns.start == next && part.columns.end > next,
            "{name}: {parts:?}"
        );
        next = part.columns.end;
    }
    assert_eq!(next, range.end, "{name}: {parts:?}");
}

#[test]
fn rows_are_divided_by_angle_of_pixel() {
    let mut random = Rng::keyed(24);
    let mut division = RowDivision::default();
    let mut counts = [0; 7];
    for i in 0..500 {
        let mut angles: Vec<f64> = (0..i % 8).map(|_| random.between(0.0, 4.0)).collect();
        angles.sort_unstable_by(f64::total_cmp);
        let boundaries = boundaries_at(&angles);
        let rays = Rays {
            start: random.in_cube(1.0).truncate(),
            step: random.in_cube(0.1).truncate(),
        };
        let range = 3..61;
        let parts = division.divide(&boundaries, &rays, &range);
        check_cover(parts, &range, &format!("{angles:?}, {rays:?}"));
        for part in parts {
            for x in part.columns.clone() {
                let angle = diamond_angle(rays.evaluate(f64::from(x) + 0.5));
                if angles.iter().any(|a| (a - angle).abs() < ROUNDING) {
                    continue;
                }
                let below = angles.iter().filter(|a| **a < angle).count();
                let expected = match below {
                    0 => angles.len().saturating_sub(1),
                    _ => below - 1,
                };
                assert_eq!(part.fragment, expected, "{x}, {angles:?}, {rays:?}");
                counts[expected] += 1;
            }
        }
    }
    assert!(counts.iter().all(|count| *count > 500), "{counts:?}");
}

/// All boundaries cross such a row in the same pixel, on either side of its centre by rounding.
#[test]
fn pixel_on_baseline_lies_in_one_part() {
    let mut random = Rng::keyed(25);
    let mut division = RowDivision::default();
    for i in 0..2000 {
        let mut angles: Vec<f64> = (0..2 + i % 7).map(|_| random.between(0.0, 4.0)).collect();
        angles.sort_unstable_by(f64::total_cmp);
        let boundaries = boundaries_at(&angles);
        let step = random.in_cube(1.0).truncate();
        let column = [0.5, 1.5, 4.5][i % 3];
        let rays = Rays {
            start: step * -column,
            step,
        };
        for range in [0..1, 0..3, 1..2, 0..9] {
            let parts = division.divide(&boundaries, &rays, &range);
            check_cover(parts, &range, &format!("{angles:?}, {rays:?}"));
        }
    }
}

/// Returns true if a square of `radius_px` about the point `w` times a ray may touch a
/// boundary.
fn may_touch(boundary: &Boundary, ray: DVec2, w: f64, radius_px: f64) -> bool {
    let position = boundary.coordinates(ray);
    let reach = boundary.per_px * radius_px * w;
    position.x.abs() <= reach.x && position.y >= -reach.y
}

#[test]
fn extended_zones_are_tight() {
    let mut random = Rng::keyed(22);
    let mut near = 0;
    let mut far = 0;
    for _ in 0..400 {
        let (_, _, baseline, boundary) = random_boundary(&mut random);
        let size = 64;
        let face = Face::ALL[random.below(6) as usize];
        let start = face.direction(0.0, random.between(0.0, 64.0), size);
        let rays = baseline.project_row(
            start,
            face.direction(1.0, 0.0, size) - face.direction(0.0, 0.0, size),
        );
        let w = [random.between(0.1, 2.0), random.between(-0.01, 0.01)];
        let reach_px = random.between(0.0, 3.0);
        let range = 5..60;
        let extended = boundary.extended_zone(&rays, w, reach_px, &range);
        let touches = |x: u32| {
            let x = f64::from(x) + 0.5;
            may_touch(
                &boundary,
                rays.evaluate(x),
                w[0] + w[1] * x,
                reach_px + boundary.radius_px,
            )
        };
        for x in range.clone() {
            assert!(
                extended.contains(&x) || !touches(x),
                "{x} of {extended:?}, {boundary:?}"
            );
            near += u32::from(touches(x));
        }
        assert!(extended.start >= range.start && extended.end <= range.end);
        let inner = extended.start + 2..extended.end.saturating_sub(2);
        assert!(
            inner.clone().all(touches),
            "{inner:?} of {extended:?}, {boundary:?}"
        );
        far += range.len() - extended.len();
    }
    assert!(near > 1000 && far > 5000, "{near} {far}");
}

#[test]
fn boxes_with_point_near_boundary_are_near_it() {
    let mut random = Rng::keyed(23);
    let mut near = 0;
    let mut far = 0;
    for _ in 0..2000 {
        let (camera, eye, baseline, boundary) = random_boundary(&mut random);
        let size = 64;
        let face = Face::ALL[random.below(6) as usize];
        let transfer = Transfer::new(&camera, eye, face, size);
        let bounds =
            [(0.0, 64.0, 16.0), (0.0, 64.0, 16.0), (0.0, 1.0, 0.5)].map(|(from, to, most)| {
                let start = random.between(from, to);
                [start, start + random.between(0.0, most)]
            });
        let radius_px = random.between(0.5, 4.0);
        let is_near = boundary.is_near(
            &boundary.transform_box(&baseline, face, size, &transfer, &bounds),
            radius_px,
        );
        for _ in 0..60 {
            let [x, y, q] = bounds.map(|[from, to]| random.between(from, to));
            let ray = baseline.project(face.direction(x, y, size));
            let w = transfer.map_infinite(x, y).z + transfer.inverse_depth.z * q;
            assert!(
                is_near || !may_touch(&boundary, ray, w, radius_px),
                "({x}, {y}) at {q} of {bounds:?}"
            );
        }
        *(if is_near { &mut near } else { &mut far }) += 1;
    }
    assert!(near > 50 && far > 500, "{near} {far}");
}
