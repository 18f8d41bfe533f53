//! From lit parts to depth pixels: clusters of bounded depth span, and what a cluster becomes.
//!
//! Neighbouring bins are joined once, pairwise, from the far end: a surface that straddles a bin's border becomes one
//! depth pixel, a cluster spans at most two bins, and nothing chains.

use super::coverage::BinSpan;
use crate::light::shade::LitPart;
use glam::Vec3;
use headbox_core::tone::ToneMap;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::samples::{DepthPixel, EncodedNormal};

pub(crate) use headbox_cube::model::parameters::MergeRule;

/// Colours closer than this in every channel (sRGB levels) count as equal for [`MergeRule::ColorsApart`].
pub(crate) const SAME_COLOR_LEVELS: u8 = 16;

/// Turns the lit parts of one pixel (sorted by bin and class) into depth pixels, farthest first, appended to `out`, each
/// with the bins of its cluster. Their alpha is still to be measured ([`super::coverage`]).
pub(crate) fn depth_pixels_of(
    pixel: &[LitPart],
    rule: MergeRule,
    tone: ToneMap,
    bins: &DepthBins,
    out: &mut Vec<(DepthPixel, BinSpan)>,
) {
    let first = out.len();
    for cluster in (Clusters { rest: pixel }) {
        let [head, .., tail] = cluster else {
            out.extend(
                cluster
                    .first()
                    .map(|only| (average(cluster, tone, bins), [only.bin; 2])),
            );
            continue;
        };
        let span = [head.bin, tail.bin];
        match rule {
            MergeRule::Average => out.push((average(cluster, tone, bins), span)),
            MergeRule::SmallerArea => {
                let best = cluster
                    .iter()
                    .min_by(|a, b| a.area.total_cmp(&b.area).then(a.key.cmp(&b.key)));
                out.extend(
                    best.map(|best| (average(std::slice::from_ref(best), tone, bins), span)),
                );
            }
            MergeRule::ColorsApart => {
                out.extend(
                    colors_apart(cluster, tone, bins)
                        .into_iter()
                        .map(|kept| (kept, span)),
                );
            }
        }
    }
    out[first..].sort_by(|(a, _), (b, _)| a.inverse_depth.total_cmp(&b.inverse_depth));
}

/// Iterates over the clusters of a pixel, farthest first.
struct Clusters<'a> {
    rest: &'a [LitPart],
}

impl<'a> Iterator for Clusters<'a> {
    type Item = &'a [LitPart];

    fn next(&mut self) -> Option<Self::Item> {
        let bin = self.rest.first()?.bin;
        let in_bin = |bin: u16| self.rest.partition_point(|a| a.bin <= bin);
        let mut end = in_bin(bin);
        if let Some(next_bin) = bin.checked_add(1) {
            let next_end = in_bin(next_bin);
            let close =
                |next: &[LitPart]| mean_position(next) - mean_position(&self.rest[..end]) < 1.0;
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
fn mean_position(cluster: &[LitPart]) -> f64 {
    let samples: u64 = cluster.iter().map(|part| u64::from(part.count)).sum();
    let sum: f64 = cluster
        .iter()
        .map(|part| f64::from(part.position) * f64::from(part.count))
        .sum();
    sum / samples as f64
}

/// One depth pixel with the mean depth and colour, and the normal of the part that most rays saw: that of its plane, which says
/// how far apart its neighbours lie in a frame. What a file says for shading may lean by half a right angle, at the corners of a box.
fn average(cluster: &[LitPart], tone: ToneMap, bins: &DepthBins) -> DepthPixel {
    let samples: u64 = cluster.iter().map(|part| u64::from(part.count)).sum();
    let color: Vec3 = cluster
        .iter()
        .map(|part| part.color() * (part.count as f32 / samples as f32))
        .sum();
    let most_seen = cluster
        .iter()
        .min_by_key(|part| (std::cmp::Reverse(part.count), part.key));
    let normal = most_seen.map_or(Vec3::Z, |part| part.plane_normal);
    // Half a step of the offset keeps the inverse depth positive even in the first bin.
    let position = mean_position(cluster) + 0.5 / 65_536.0;
    let [r, g, b] = tone.levels(color);
    DepthPixel {
        inverse_depth: bins.inverse_depth(position) as f32,
        normal: EncodedNormal::new(normal),
        color_srgb: [r, g, b, 255],
    }
}

fn colors_apart(cluster: &[LitPart], tone: ToneMap, bins: &DepthBins) -> Vec<DepthPixel> {
    let mut out: Vec<DepthPixel> = Vec::new();
    let mut in_key_order: Vec<&LitPart> = cluster.iter().collect();
    in_key_order.sort_unstable_by_key(|part| part.key);
    for part in in_key_order {
        let candidate = average(std::slice::from_ref(part), tone, bins);
        let same = |kept: &DepthPixel| {
            (0..3).all(|c| kept.color_srgb[c].abs_diff(candidate.color_srgb[c]) < SAME_COLOR_LEVELS)
        };
        if !out.iter().any(same) {
            out.push(candidate);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_trace::sampler::RayKey;

    fn acc(bin: u16, offset: u32, count: u32) -> LitPart {
        LitPart {
            key: RayKey(0),
            count,
            area: 1.0,
            bin,
            class: 0,
            position: f32::from(bin) + offset as f32 / 65_536.0,
            albedo: [0; 3],
            primitive: 0,
            barycentric: [0; 2],
            emission: Vec3::ZERO,
            sun: Vec3::ZERO,
            soft: Vec3::ZERO,
            plane_normal: Vec3::Z,
            plane_distance: 1.0,
        }
    }

    fn cluster_sizes(pixel: &[LitPart]) -> Vec<usize> {
        Clusters { rest: pixel }.map(<[_]>::len).collect()
    }

    #[test]
    fn a_surface_across_a_border_is_one_cluster_and_nothing_chains() {
        assert_eq!(
            cluster_sizes(&[acc(3, 65_000, 4), acc(4, 100, 4)]),
            [2],
            "straddles the border"
        );
        assert_eq!(
            cluster_sizes(&[acc(3, 100, 4), acc(4, 65_000, 4)]),
            [1, 1],
            "more than a bin apart"
        );
        assert_eq!(
            cluster_sizes(&[acc(3, 9, 1), acc(5, 9, 1)]),
            [1, 1],
            "a bin between them"
        );
        let chain: Vec<_> = (0..10)
            .map(|bin| acc(bin, if bin % 2 == 0 { 40_000 } else { 20_000 }, 1))
            .collect();
        assert!(
            cluster_sizes(&chain).iter().all(|&size| size <= 2),
            "a cluster spans at most two bins"
        );
        assert_eq!(cluster_sizes(&[acc(u16::MAX, 1, 1)]), [1]);
        assert_eq!(cluster_sizes(&[]), [0; 0]);
    }

    /// A part of an sRGB grey, at a position in bins.
    fn part(position: f32, gray: u8, count: u32, area: f32, key: u64) -> LitPart {
        let emission = Vec3::splat(headbox_core::color::linear_from_srgb8(gray));
        LitPart {
            position,
            emission,
            area,
            key: RayKey(key),
            ..acc(position as u16, 0, count)
        }
    }

    /// What a rule makes of one pixel: position in bins and grey, farthest first; and the bins of each cluster.
    fn merged(pixel: &[LitPart], rule: MergeRule) -> (Vec<(f64, u8)>, Vec<BinSpan>) {
        let bins = DepthBins::new(0.5, 64);
        let mut out = Vec::new();
        depth_pixels_of(pixel, rule, ToneMap::default(), &bins, &mut out);
        let position = |q: f32| f64::from(q) / bins.inverse_depth(1.0);
        let pixels = out
            .iter()
            .map(|(p, _)| (position(p.inverse_depth), p.color_srgb[0]))
            .collect();
        (pixels, out.iter().map(|(_, span)| *span).collect())
    }

    fn assert_merged(pixel: &[LitPart], rule: MergeRule, expected: &[(f64, u8)]) {
        let (found, spans) = merged(pixel, rule);
        assert_eq!(found.len(), expected.len(), "{rule:?}: {found:?}");
        for ((position, gray), (expected_position, expected_gray)) in found.iter().zip(expected) {
            // Half a step of the offset is added; f32 rounds to 1e-6 of a bin here.
            let expected_position = expected_position + 0.5 / 65_536.0;
            assert!(
                (position - expected_position).abs() < 2e-6,
                "{rule:?}: {found:?}, not {expected:?}"
            );
            assert_eq!(gray, expected_gray, "{rule:?}: {found:?}");
        }
        assert!(spans.iter().all(|span| span[1] <= span[0] + 1), "{spans:?}");
    }

    #[test]
    fn the_papers_three_rules_differ_as_they_say() {
        // One cluster across a border of bins: a dark part that three rays saw, and a bright one that one ray saw from nearer.
        let pixel = [part(9.75, 50, 3, 4.0, 7), part(10.25, 200, 1, 1.0, 2)];
        // (3 * 9.75 + 10.25) / 4; the mean of 0.0319 (3 times) and 0.5776 is 0.1683, sRGB 114.
        assert_merged(&pixel, MergeRule::Average, &[(9.875, 114)]);
        assert_merged(&pixel, MergeRule::SmallerArea, &[(10.25, 200)]);
        assert_merged(&pixel, MergeRule::ColorsApart, &[(9.75, 50), (10.25, 200)]);
        assert_eq!(merged(&pixel, MergeRule::Average).1, [[9, 10]]);
        assert_eq!(
            merged(&pixel, MergeRule::ColorsApart).1,
            [[9, 10]; 2],
            "both with the bins of their cluster"
        );
        // What is more than a bin away is another surface under every rule.
        let apart = [part(9.25, 50, 3, 4.0, 7), part(10.75, 50, 1, 1.0, 2)];
        for rule in [
            MergeRule::Average,
            MergeRule::SmallerArea,
            MergeRule::ColorsApart,
        ] {
            assert_merged(&apart, rule, &[(9.25, 50), (10.75, 50)]);
        }
    }

    #[test]
    fn of_equal_areas_and_of_equal_colours_the_first_ray_stays() {
        let of_keys = |a: u64, b: u64, second: u8| {
            [part(9.75, 100, 1, 2.0, a), part(10.25, second, 1, 2.0, b)]
        };
        assert_merged(&of_keys(1, 2, 100), MergeRule::SmallerArea, &[(9.75, 100)]);
        assert_merged(&of_keys(2, 1, 100), MergeRule::SmallerArea, &[(10.25, 100)]);
        let almost = 100 + SAME_COLOR_LEVELS - 1;
        assert_merged(
            &of_keys(1, 2, almost),
            MergeRule::ColorsApart,
            &[(9.75, 100)],
        );
        assert_merged(
            &of_keys(2, 1, almost),
            MergeRule::ColorsApart,
            &[(10.25, almost)],
        );
        assert_merged(
            &of_keys(2, 1, almost + 1),
            MergeRule::ColorsApart,
            &[(9.75, 100), (10.25, almost + 1)],
        );
        // Colours differ if one channel does.
        let mut red = of_keys(1, 2, 100);
        red[1].emission.x = 1.0;
        assert_eq!(merged(&red, MergeRule::ColorsApart).0.len(), 2);
    }

    #[test]
    fn a_mean_has_the_normal_that_most_rays_saw() {
        let mut pixel = [part(9.75, 50, 3, 4.0, 2), part(10.25, 50, 4, 1.0, 7)];
        (pixel[0].plane_normal, pixel[1].plane_normal) = (Vec3::X, Vec3::Y);
        let mut out = Vec::new();
        depth_pixels_of(
            &pixel,
            MergeRule::Average,
            ToneMap::default(),
            &DepthBins::new(0.5, 64),
            &mut out,
        );
        assert_eq!(out[0].0.normal, EncodedNormal::new(Vec3::Y));
        pixel[0].count = 4;
        out.clear();
        depth_pixels_of(
            &pixel,
            MergeRule::Average,
            ToneMap::default(),
            &DepthBins::new(0.5, 64),
            &mut out,
        );
        assert_eq!(
            out[0].0.normal,
            EncodedNormal::new(Vec3::X),
            "of as many the one that was first"
        );
    }
}
