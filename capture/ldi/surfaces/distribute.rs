//! Distributes light samples over the surface samples of a face, any number for each.
//!
//! The requested numbers are summed along a Morton curve over the pixels. A surface sample takes
//! one light sample for each whole number that its request carries the sum past, so that light
//! samples lie as evenly as the requests allow. Their numbers in this order select the points of an
//! evenly spread sequence: neighbours share an evenly spread set of points (Ahmed and Wonka 2020,
//! "Screen-Space Blue-Noise Diffusion of Monte Carlo Sampling Error via Hierarchical Ordering of
//! Pixels").

use crate::surfaces::surface_samples::FaceSurfaces;
use headbox_trace::sampler::{random4, unit_float};

/// The light samples of one surface sample: `count` numbers from `first` on, counted within its
/// class.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct SampleRange {
    pub(crate) first: u32,
    pub(crate) count: u32,
}

/// Distributes light samples over surface samples. For each, `requested` holds the number that it
/// requests, and `classes` its [`SurfaceSample::class`](crate::light::shade::SurfaceSample::class).
pub(crate) fn distribute_samples(
    surfaces: &FaceSurfaces,
    classes: &[u16],
    requested: &[f32],
) -> Vec<SampleRange> {
    let start = |class: u32| (unit_float(random4([class, 0x7368, 0x6172, 0x6521])[0]), 0);
    let mut class_states: Vec<(f32, u32)> = (0..=u32::from(u16::MAX)).map(start).collect();
    let mut ranges = vec![SampleRange::default(); requested.len()];
    let side = surfaces.size_px.next_power_of_two();
    for code in 0..side * side {
        let [x, y] = [code, code >> 1].map(pack_even_bits);
        if x >= surfaces.size_px || y >= surfaces.size_px {
            continue;
        }
        for i in surfaces.range(x, y) {
            let (sum, next) = &mut class_states[usize::from(classes[i])];
            *sum += requested[i];
            let count = *sum as u32;
            *sum -= count as f32;
            ranges[i] = SampleRange {
                first: *next,
                count,
            };
            *next = next.wrapping_add(count);
        }
    }
    ranges
}

/// Packs bits 0, 2, 4... of `bits`: one coordinate of a Morton code.
fn pack_even_bits(mut bits: u32) -> u32 {
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
    fn morton_curve_meets_every_pixel_once() {
        let pixels: std::collections::HashSet<[u32; 2]> = (0..4096)
            .map(|code: u32| [code, code >> 1].map(pack_even_bits))
            .collect();
        assert!(pixels.len() == 4096 && pixels.iter().flatten().all(|&c| c < 64));
        assert_eq!(
            [pack_even_bits(0b1_0001), pack_even_bits(u32::MAX)],
            [0b101, 0xffff]
        );
    }
}
