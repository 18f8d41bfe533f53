//! From accumulators to depth pixels: clusters of bounded depth span, and what a cluster becomes.
//!
//! Neighbouring bins are joined once, pairwise, from the far end: a surface that straddles a bin's border becomes one
//! depth pixel, a cluster spans at most two bins, and nothing chains.

use super::accumulate::{Accumulator, DepthBins};
use super::shade::{Lit, Shader};
use super::{DepthPixel, EncodedNormal};
use crate::capture::rig::Face;
use crate::capture::srgb8_from_linear;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// What becomes of samples at similar depth in one pixel: the papers disagree (inventory D1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MergeRule {
    /// One depth pixel with their mean depth and colour, weighted by the rays that saw them (Shade et al.; default).
    #[default]
    Average,
    /// The surface that was sampled with the smallest area wins (Rafferty et al.).
    SmallerArea,
    /// Surfaces whose colours differ are kept apart, otherwise the first stays; first in the order of ray keys, so that
    /// the rule has one outcome (Popescu et al.).
    ColorsApart,
}

/// Colours closer than this in every channel (sRGB levels) count as equal for [`MergeRule::ColorsApart`].
const SAME_COLOR_LEVELS: u8 = 16;

/// Turns the accumulators of one pixel (sorted by bin and class) into depth pixels, farthest first, appended to `out`.
pub fn depth_pixels_of(
    pixel: &[Accumulator],
    place: (Face, u32, u32),
    rule: MergeRule,
    bins: &DepthBins,
    shader: &Shader,
    out: &mut Vec<DepthPixel>,
) {
    let first = out.len();
    for cluster in (Clusters { rest: pixel }) {
        match rule {
            MergeRule::Average => out.push(average(cluster, place, bins, shader)),
            MergeRule::SmallerArea => {
                let best = cluster.iter().min_by(|a, b| a.area.total_cmp(&b.area).then(a.key.cmp(&b.key)));
                out.extend(best.map(|best| average(std::slice::from_ref(best), place, bins, shader)));
            }
            MergeRule::ColorsApart => colors_apart(cluster, place, bins, shader, out),
        }
    }
    out[first..].sort_by(|a, b| a.inverse_depth.total_cmp(&b.inverse_depth));
}

/// Iterates over the clusters of a pixel, farthest first.
struct Clusters<'a> {
    rest: &'a [Accumulator],
}

impl<'a> Iterator for Clusters<'a> {
    type Item = &'a [Accumulator];

    fn next(&mut self) -> Option<Self::Item> {
        let bin = self.rest.first()?.bin;
        let in_bin = |bin: u16| self.rest.partition_point(|a| a.bin <= bin);
        let mut end = in_bin(bin);
        if let Some(next_bin) = bin.checked_add(1) {
            let next_end = in_bin(next_bin);
            let close = |next: &[Accumulator]| mean_position(next) - mean_position(&self.rest[..end]) < 1.0;
            if next_end > end && close(&self.rest[end..next_end]) {
                end = next_end;
            }
        }
        let (cluster, rest) = self.rest.split_at(end);
        self.rest = rest;
        Some(cluster)
    }
}

/// Mean position in bins over all samples.
fn mean_position(cluster: &[Accumulator]) -> f64 {
    let samples: u64 = cluster.iter().map(|a| u64::from(a.count)).sum();
    let sum: f64 = cluster.iter().map(|a| f64::from(a.bin) * f64::from(a.count) + a.offset_sum as f64 / 65_536.0).sum();
    sum / samples as f64
}

fn average(cluster: &[Accumulator], place: (Face, u32, u32), bins: &DepthBins, shader: &Shader) -> DepthPixel {
    let samples: u64 = cluster.iter().map(|a| u64::from(a.count)).sum();
    let mut color = Vec3::ZERO;
    let mut normal = (0, Vec3::Z);
    for acc in cluster {
        let weight = acc.count as f32 / samples as f32;
        let lit = light(acc, place, weight, shader);
        color += lit.color * weight;
        if acc.count > normal.0 {
            normal = (acc.count, lit.normal);
        }
    }
    depth_pixel(cluster, color, normal.1, bins)
}

fn colors_apart(
    cluster: &[Accumulator],
    place: (Face, u32, u32),
    bins: &DepthBins,
    shader: &Shader,
    out: &mut Vec<DepthPixel>,
) {
    let first = out.len();
    let mut in_key_order: Vec<&Accumulator> = cluster.iter().collect();
    in_key_order.sort_unstable_by_key(|a| a.key);
    for acc in in_key_order {
        let lit = light(acc, place, 1.0, shader);
        let candidate = depth_pixel(std::slice::from_ref(acc), lit.color, lit.normal, bins);
        let same = |kept: &DepthPixel| {
            (0..3).all(|c| kept.color_srgb[c].abs_diff(candidate.color_srgb[c]) < SAME_COLOR_LEVELS)
        };
        if !out[first..].iter().any(same) {
            out.push(candidate);
        }
    }
}

/// Lights a part of a cluster with its share of the light samples, at least one.
fn light(acc: &Accumulator, (face, x, y): (Face, u32, u32), weight: f32, shader: &Shader) -> Lit {
    let samples = (shader.samples as f32 * weight).ceil() as u32;
    shader.shade(acc, face, x, y, samples)
}

fn depth_pixel(cluster: &[Accumulator], color: Vec3, normal: Vec3, bins: &DepthBins) -> DepthPixel {
    // Half a step of the offset keeps the inverse depth positive even in the first bin.
    let position = mean_position(cluster) + 0.5 / 65_536.0;
    let [r, g, b] = color.to_array().map(srgb8_from_linear);
    DepthPixel {
        inverse_depth: bins.inverse_depth(position) as f32,
        normal: EncodedNormal::new(normal),
        color_srgb: [r, g, b, 255],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::sampler::RayKey;

    fn acc(bin: u16, offset: u64, count: u32) -> Accumulator {
        Accumulator {
            key: RayKey(0),
            offset_sum: offset * u64::from(count),
            albedo_sum: [0; 3],
            count,
            area: 1.0,
            primitive: 0,
            barycentric: [0; 2],
            link: 0,
            bin,
            class: 0,
        }
    }

    fn cluster_sizes(pixel: &[Accumulator]) -> Vec<usize> {
        Clusters { rest: pixel }.map(<[_]>::len).collect()
    }

    #[test]
    fn a_surface_across_a_border_is_one_cluster_and_nothing_chains() {
        assert_eq!(cluster_sizes(&[acc(3, 65_000, 4), acc(4, 100, 4)]), [2], "straddles the border");
        assert_eq!(cluster_sizes(&[acc(3, 100, 4), acc(4, 65_000, 4)]), [1, 1], "more than a bin apart");
        assert_eq!(cluster_sizes(&[acc(3, 9, 1), acc(5, 9, 1)]), [1, 1], "a bin between them");
        let chain: Vec<_> = (0..10).map(|bin| acc(bin, if bin % 2 == 0 { 40_000 } else { 20_000 }, 1)).collect();
        assert!(cluster_sizes(&chain).iter().all(|&size| size <= 2), "a cluster spans at most two bins");
        assert_eq!(cluster_sizes(&[acc(u16::MAX, 1, 1)]), [1]);
        assert_eq!(cluster_sizes(&[]), [0; 0]);
    }
}
