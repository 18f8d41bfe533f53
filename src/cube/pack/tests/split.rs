//! Splits into near and far segments.

use super::super::{CubeLdi, SplatIndexLayout, Split};
use super::{ldi, sample};
use headbox_core::cube_face::Face;
use headbox_core::random::Rng;

/// Cost that [`Split::Auto`] minimises, for a cut after some of 64 bins of inverse depth.
fn expected_touches(inverse_depths: &[f64], cut: f64, half_size: f64) -> f64 {
    let range = |samples: &[f64]| {
        let extreme =
            |pick: fn(f64, f64) -> f64| samples.iter().copied().reduce(pick).unwrap_or(0.0);
        extreme(f64::max) - extreme(f64::min)
    };
    let touches = |samples: Vec<f64>, dq: f64| {
        samples.len() as f64 * (1.15 + 0.5 * half_size * dq).powi(2).min(4.0)
    };
    let (far, near) = inverse_depths.iter().partition(|q| **q < cut);
    let least = inverse_depths.iter().copied().fold(f64::INFINITY, f64::min);
    let all = range(inverse_depths);
    touches(far, cut - least) + touches(near, least + all - cut)
}

#[test]
fn automatic_split_minimises_cost() {
    // A far cloud and fewer near samples, in one row; the headbox is so large that ranges matter.
    for far in [300, 150, 20] {
        let mut random = Rng::keyed(far);
        let mut inverse_depths: Vec<f64> = (0..far).map(|_| random.between(0.2, 0.5)).collect();
        inverse_depths.extend((far..400).map(|_| random.between(0.9, 2.6)));
        inverse_depths
            .iter_mut()
            .for_each(|q| *q = f64::from(*q as f32));
        let mut cube = ldi(20, |face, x, y| match face {
            Face::PosX => vec![sample(
                &mut Rng::keyed(1),
                face,
                inverse_depths[(y * 20 + x) as usize],
            )],
            _ => Vec::new(),
        });
        cube.info.half_size_m = 1.2;
        let packed = CubeLdi::pack(&cube, SplatIndexLayout::Normal, Split::Auto).expect("packs");
        let [far, near] = &packed.segments[..] else {
            panic!("a cut")
        };
        // Any cut between the two segments keeps the same samples.
        let [least, most] = [0.2, 2.6].map(|bound| {
            inverse_depths
                .iter()
                .copied()
                .min_by(|a, b| (a - bound).abs().total_cmp(&(b - bound).abs()))
                .expect("some")
        });
        let cuts = (1..64).map(|i| least + (most - least) * f64::from(i) / 64.0);
        let cost = |cut: f64| expected_touches(&inverse_depths, cut, 1.2);
        let best = cuts
            .clone()
            .min_by(|a, b| cost(*a).total_cmp(&cost(*b)))
            .expect("some");
        assert!(
            f64::from(far.inverse_depth_max) < best && best <= f64::from(near.inverse_depth_min),
            "{best}"
        );
    }
}

#[test]
fn split_that_saves_little_is_omitted() {
    let flat = ldi(20, |face, x, _| match face {
        Face::PosX => vec![sample(&mut Rng::keyed(1), face, 0.5 + 0.01 * f64::from(x))],
        _ => Vec::new(),
    });
    assert_eq!(
        CubeLdi::pack(&flat, SplatIndexLayout::Normal, Split::Auto)
            .expect("packs")
            .segments
            .len(),
        1
    );
}

#[test]
fn split_plane_samples_are_near() {
    let ldi = ldi(4, |face, _, _| {
        [0.5, 0.8, 1.0]
            .map(|q| sample(&mut Rng::keyed(1), face, q))
            .to_vec()
    });
    for depth in [0.0, -1.0, f64::INFINITY, f64::NAN] {
        assert!(
            CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::AtDepth(depth)).is_err(),
            "{depth}"
        );
    }
    let cube = CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::AtDepth(1.25)).expect("packs");
    let ranges = cube
        .segments
        .iter()
        .map(|s| [s.inverse_depth_min, s.inverse_depth_max]);
    assert!(ranges.eq([[0.5, 0.5], [0.8, 1.0]].into_iter().cycle().take(12)));
}
