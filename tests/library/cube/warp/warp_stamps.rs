//! The fixed stamps of Rafferty et al. (R7, R12): pixels covered by one sample.

use crate::common::capture::one_layer;
use glam::{DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::random::Rng;
use headbox_cube::model::samples::{DepthPixel, EncodedNormal};
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_cube::render::{RenderSettings, Renderer};

const WIDTH: u32 = 23;
const HEIGHT: u32 = 17;

/// One sample, one metre in front of the centre.
fn one_sample() -> CubeLdi {
    let ldi = one_layer(DVec3::ZERO, 9, &[Face::NegZ], |_, x, y| {
        let normal = EncodedNormal::new(glam::Vec3::Z);
        (x == 4.5 && y == 4.5).then_some(DepthPixel {
            inverse_depth: 1.0,
            normal,
            color_srgb: [10, 200, 30, 255],
        })
    });
    CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).expect("valid")
}

/// Pixels of a stamp about the sample at (x, y), by definition.
fn stamp(kernel: SplatKernel, x: f64, y: f64) -> Vec<[i64; 2]> {
    let (column, row) = (x.floor() as i64, y.floor() as i64);
    let around = |columns: std::ops::RangeInclusive<i64>, rows: std::ops::RangeInclusive<i64>| {
        rows.flat_map(|dy| columns.clone().map(move |dx| [column + dx, row + dy]))
            .collect::<Vec<_>>()
    };
    // The two columns whose centres are nearest to the sample.
    let two = |v: f64| if v - v.floor() < 0.5 { -1..=0 } else { 0..=1 };
    match kernel {
        SplatKernel::Point => vec![[column, row]],
        SplatKernel::Plus => {
            vec![
                [column, row - 1],
                [column - 1, row],
                [column, row],
                [column + 1, row],
                [column, row + 1],
            ]
        }
        SplatKernel::Square2 => around(two(x), two(y)),
        SplatKernel::Square3 => around(-1..=1, -1..=1),
        SplatKernel::Paper | SplatKernel::Opaque | SplatKernel::Tent | SplatKernel::Ellipse => {
            unreachable!()
        }
    }
}

#[test]
fn a_plus_has_five_pixels_and_squares_have_one_four_and_nine() {
    let (cube, mut renderer, mut random) = (one_sample(), Renderer::new(), Rng::keyed(9));
    let kernels = [
        (SplatKernel::Point, 1),
        (SplatKernel::Plus, 5),
        (SplatKernel::Square2, 4),
        (SplatKernel::Square3, 9),
    ];
    let (mut inside, mut cut) = (0, 0);
    for _ in 0..300 {
        let eye = dvec3(
            random.between(-0.35, 0.35),
            random.between(-0.3, 0.3),
            random.between(-0.2, 0.2),
        );
        let camera =
            Camera::look_at(eye, eye - DVec3::Z, DVec3::Y, 30.0, [WIDTH, HEIGHT]).expect("valid");
        let [x, y, _] = camera.project(-DVec3::Z).expect("in front");
        // Closer to a border of pixels, or of half pixels, rounding decides.
        if [x, y]
            .iter()
            .any(|v| (2.0 * v - (2.0 * v).round()).abs() < 1e-3)
        {
            continue;
        }
        for (kernel, count) in kernels {
            let settings = RenderSettings {
                kernel,
                ..RenderSettings::default()
            };
            let (frame, _) = renderer.render_with_stats(&cube, &camera, &settings);
            let covered = (0..frame.color.len()).filter(|&i| frame.coverage[i].splat_share() > 0);
            let mut covered: Vec<[i64; 2]> = covered
                .map(|i| [i as i64 % i64::from(WIDTH), i as i64 / i64::from(WIDTH)])
                .collect();
            covered.sort_by_key(|p| [p[1], p[0]]);
            let mut expected = stamp(kernel, x, y);
            assert_eq!(expected.len(), count);
            expected.retain(|p| {
                (0..WIDTH.into()).contains(&p[0]) && (0..HEIGHT.into()).contains(&p[1])
            });
            assert_eq!(covered, expected, "{kernel:?} at ({x}, {y})");
            assert!(covered.iter().all(|p| frame.color
                [p[1] as usize * WIDTH as usize + p[0] as usize]
                == [10, 200, 30, 255]));
            if expected.len() == count {
                inside += 1;
            } else {
                cut += 1;
            }
        }
    }
    assert!(
        inside > 400 && cut > 20,
        "{inside} stamps inside the frame, {cut} across its border"
    );
}
