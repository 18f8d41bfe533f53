//! Samples spread over the parts of a face, any number of them for each part.
//!
//! Along a Morton curve over the pixels, what each part wants is added up, and a part takes as many samples as the sum has passed
//! whole numbers; so they lie as evenly as what is wanted allows. They are numbered in this order, and take the points of an
//! evenly spread sequence by their numbers: neighbours share an evenly spread set of points (Ahmed and Wonka 2020, "Screen-Space
//! Blue-Noise Diffusion of Monte Carlo Sampling Error via Hierarchical Ordering of Pixels").

use crate::surfaces::surface_samples::FaceParts;
use headbox_trace::sampler::{random4, unit_float};

/// The samples of one part: so many from number `first` on, among those of its class.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Share {
    pub(crate) first: u32,
    pub(crate) count: u32,
}

/// Spreads samples over parts that want so many each, by class ([`LitPart::class`](crate::light::shade::LitPart::class), of each part).
pub(crate) fn spread(parts: &FaceParts, classes: &[u16], wanted: &[f32]) -> Vec<Share> {
    let start = |class: u32| (unit_float(random4([class, 0x7368, 0x6172, 0x6521])[0]), 0);
    let mut of_class: Vec<(f32, u32)> = (0..=u32::from(u16::MAX)).map(start).collect();
    let mut shares = vec![Share::default(); wanted.len()];
    let side = parts.size_px.next_power_of_two();
    for place in 0..side * side {
        let [x, y] = [place, place >> 1].map(every_other_bit);
        if x >= parts.size_px || y >= parts.size_px {
            continue;
        }
        for p in parts.range(x, y) {
            let (sum, next) = &mut of_class[usize::from(classes[p])];
            *sum += wanted[p];
            let count = *sum as u32;
            *sum -= count as f32;
            shares[p] = Share {
                first: *next,
                count,
            };
            *next = next.wrapping_add(count);
        }
    }
    shares
}

/// The number that bits 0, 2, 4... of `bits` make.
fn every_other_bit(mut bits: u32) -> u32 {
    bits &= 0x5555_5555;
    bits = (bits | bits >> 1) & 0x3333_3333;
    bits = (bits | bits >> 2) & 0x0f0f_0f0f;
    bits = (bits | bits >> 4) & 0x00ff_00ff;
    (bits | bits >> 8) & 0x0000_ffff
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_morton_curve_meets_every_pixel_once() {
        let places: std::collections::HashSet<[u32; 2]> = (0..4096)
            .map(|place: u32| [place, place >> 1].map(every_other_bit))
            .collect();
        assert!(places.len() == 4096 && places.iter().flatten().all(|&c| c < 64));
        assert_eq!(
            [every_other_bit(0b1_0001), every_other_bit(u32::MAX)],
            [0b101, 0xffff]
        );
    }
}
