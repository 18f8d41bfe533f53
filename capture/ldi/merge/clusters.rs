//! Merges the surface samples of a pixel into depth pixels, by clusters of bounded depth span.
//!
//! Neighbouring bins are joined pairwise, in one pass from the far end: a surface that straddles a
//! bin's border becomes one depth pixel, a cluster spans at most two bins, and clusters never
//! chain.

use super::coverage::BinSpan;
use super::shares::ShareMeasure;
use crate::light::shade::SurfaceSample;
use glam::Vec3;
use headbox_core::color::tone::ToneMap;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::parameters::MergeRule;
use headbox_cube::model::samples::{DepthPixel, EncodedNormal};

/// Colours closer than this in every channel (sRGB levels) count as equal for
/// [`MergeRule::ColorsApart`].
pub(crate) const SAME_COLOR_LEVELS: u8 = 16;

/// Merging of the surface samples of a pixel into depth pixels.
pub(crate) struct PixelMerger<'a> {
    pub(crate) rule: MergeRule,
    pub(crate) tone: ToneMap,
    pub(crate) bins: &'a DepthBins,
    /// Measures how much of a pixel each surface covers; without it, the number of rays tells.
    pub(crate) shares: Option<&'a ShareMeasure<'a>>,
}

impl PixelMerger<'_> {
    /// Merges the surface samples of a pixel (sorted by bin and class) into depth pixels. They are
    /// appended to `out`, farthest first, each with the bins of its cluster. Their alpha is
    /// measured later ([`super::coverage`]).
    pub(crate) fn merge(
        &self,
        pixel: [u32; 2],
        samples: &[SurfaceSample],
        out: &mut Vec<(DepthPixel, BinSpan)>,
    ) {
        let first = out.len();
        for cluster in (Clusters { rest: samples }) {
            let span = [cluster[0].bin, cluster[cluster.len() - 1].bin];
            match self.rule {
                MergeRule::Average => out.push((self.average(pixel, cluster), span)),
                MergeRule::SmallerArea => {
                    let best = cluster
                        .iter()
                        .min_by(|a, b| a.area.total_cmp(&b.area).then(a.key.cmp(&b.key)));
                    out.extend(best.map(|best| (self.single(best), span)));
                }
                MergeRule::ColorsApart => {
                    let split = self.split_by_color(cluster);
                    out.extend(split.into_iter().map(|depth_pixel| (depth_pixel, span)));
                }
            }
        }
        out[first..].sort_by(|(a, _), (b, _)| a.inverse_depth.total_cmp(&b.inverse_depth));
    }

    /// The mean of a cluster.
    fn average(&self, pixel: [u32; 2], cluster: &[SurfaceSample]) -> DepthPixel {
        let measured = self
            .shares
            .and_then(|shares| shares.ray_counts(pixel, cluster, self.tone));
        let color = match measured {
            Some(counts) => mean_color(cluster.iter().zip(counts)),
            None => mean_color(cluster.iter().map(|sample| (sample, sample.count))),
        };
        self.depth_pixel(cluster, color)
    }

    /// A depth pixel of one sample.
    fn single(&self, sample: &SurfaceSample) -> DepthPixel {
        self.depth_pixel(std::slice::from_ref(sample), sample.color())
    }

    /// A depth pixel of a colour (linear, exposed) with the mean depth of a cluster, and the plane
    /// normal of the sample with most rays. The plane's normal determines how far apart neighbours
    /// lie in a frame; a shading normal of a file may lean by 45 degrees, at the corners of a box.
    fn depth_pixel(&self, cluster: &[SurfaceSample], color: Vec3) -> DepthPixel {
        let most_rays = cluster
            .iter()
            .min_by_key(|sample| (std::cmp::Reverse(sample.count), sample.key));
        let normal = most_rays.map_or(Vec3::Z, |sample| sample.plane_normal);
        // Half a step of the offset keeps the inverse depth positive even in the first bin.
        let position = mean_position(cluster) + 0.5 / 65_536.0;
        let [r, g, b] = self.tone.levels(color);
        DepthPixel {
            inverse_depth: self.bins.inverse_depth(position) as f32,
            normal: EncodedNormal::new(normal),
            color_srgb: [r, g, b, 255],
        }
    }

    /// Builds a depth pixel for each colour of a cluster, from the first ray of that colour.
    fn split_by_color(&self, cluster: &[SurfaceSample]) -> Vec<DepthPixel> {
        let mut out: Vec<DepthPixel> = Vec::new();
        let mut in_key_order: Vec<&SurfaceSample> = cluster.iter().collect();
        in_key_order.sort_unstable_by_key(|sample| sample.key);
        for sample in in_key_order {
            let candidate = self.single(sample);
            let is_same = |other: &DepthPixel| {
                (0..3).all(|c| {
                    other.color_srgb[c].abs_diff(candidate.color_srgb[c]) < SAME_COLOR_LEVELS
                })
            };
            if !out.iter().any(is_same) {
                out.push(candidate);
            }
        }
        out
    }
}

/// Iterator over the clusters of a pixel, farthest first.
struct Clusters<'a> {
    rest: &'a [SurfaceSample],
}

impl<'a> Iterator for Clusters<'a> {
    type Item = &'a [SurfaceSample];

    fn next(&mut self) -> Option<Self::Item> {
        let bin = self.rest.first()?.bin;
        let bin_end = |bin: u16| self.rest.partition_point(|a| a.bin <= bin);
        let mut end = bin_end(bin);
        if let Some(next_bin) = bin.checked_add(1) {
            let next_end = bin_end(next_bin);
            let is_close = |next: &[SurfaceSample]| {
                mean_position(next) - mean_position(&self.rest[..end]) < 1.0
            };
            if next_end > end && is_close(&self.rest[end..next_end]) {
                end = next_end;
            }
        }
        let (cluster, rest) = self.rest.split_at(end);
        self.rest = rest;
        Some(cluster)
    }
}

/// Mean position in bins over all rays.
fn mean_position(cluster: &[SurfaceSample]) -> f64 {
    let rays: u64 = cluster.iter().map(|sample| u64::from(sample.count)).sum();
    let sum: f64 = cluster
        .iter()
        .map(|sample| f64::from(sample.position) * f64::from(sample.count))
        .sum();
    sum / rays as f64
}

/// Mean colour of samples with their numbers of rays.
fn mean_color<'a>(samples: impl Iterator<Item = (&'a SurfaceSample, u32)> + Clone) -> Vec3 {
    let rays: u64 = samples.clone().map(|(_, count)| u64::from(count)).sum();
    samples
        .map(|(sample, count)| sample.color() * (count as f32 / rays as f32))
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_trace::sampler::RayKey;

    fn sample_in_bin(bin: u16, offset: u32, count: u32) -> SurfaceSample {
        SurfaceSample {
            count,
            area: 1.0,
            bin,
            position: f32::from(bin) + offset as f32 / 65_536.0,
            plane_normal: Vec3::Z,
            plane_distance: 1.0,
            ..bytemuck::Zeroable::zeroed()
        }
    }

    fn cluster_sizes(pixel: &[SurfaceSample]) -> Vec<usize> {
        Clusters { rest: pixel }.map(<[_]>::len).collect()
    }

    #[test]
    fn clusters_span_a_border_and_never_chain() {
        assert_eq!(
            cluster_sizes(&[sample_in_bin(3, 65_000, 4), sample_in_bin(4, 100, 4)]),
            [2],
            "straddles the border"
        );
        assert_eq!(
            cluster_sizes(&[sample_in_bin(3, 100, 4), sample_in_bin(4, 65_000, 4)]),
            [1, 1],
            "more than a bin apart"
        );
        assert_eq!(
            cluster_sizes(&[sample_in_bin(3, 9, 1), sample_in_bin(5, 9, 1)]),
            [1, 1],
            "a bin between them"
        );
        let chain: Vec<_> = (0..10)
            .map(|bin| sample_in_bin(bin, if bin % 2 == 0 { 40_000 } else { 20_000 }, 1))
            .collect();
        assert!(
            cluster_sizes(&chain).iter().all(|&size| size <= 2),
            "a cluster spans at most two bins"
        );
        assert_eq!(cluster_sizes(&[sample_in_bin(u16::MAX, 1, 1)]), [1]);
        assert_eq!(cluster_sizes(&[]), [0; 0]);
    }

    /// A sample of an sRGB grey at a position in bins.
    fn gray_sample(position: f32, gray: u8, count: u32, area: f32, key: u64) -> SurfaceSample {
        let emission = Vec3::splat(headbox_core::color::linear_from_srgb8(gray));
        SurfaceSample {
            position,
            emission,
            area,
            key: RayKey(key),
            ..sample_in_bin(position as u16, 0, count)
        }
    }

    /// Merging by the number of rays.
    fn merger(rule: MergeRule, bins: &DepthBins) -> PixelMerger<'_> {
        PixelMerger {
            rule,
            tone: ToneMap::default(),
            bins,
            shares: None,
        }
    }

    /// The merged pixel: position in bins and grey of each depth pixel, farthest first, and the
    /// bins of its cluster.
    fn merge(pixel: &[SurfaceSample], rule: MergeRule) -> (Vec<(f64, u8)>, Vec<BinSpan>) {
        let bins = DepthBins::new(0.5, 64);
        let mut out = Vec::new();
        merger(rule, &bins).merge([0, 0], pixel, &mut out);
        let position = |q: f32| f64::from(q) / bins.inverse_depth(1.0);
        let pixels = out
            .iter()
            .map(|(p, _)| (position(p.inverse_depth), p.color_srgb[0]))
            .collect();
        (pixels, out.iter().map(|(_, span)| *span).collect())
    }

    fn assert_merged(pixel: &[SurfaceSample], rule: MergeRule, expected: &[(f64, u8)]) {
        let (merged, spans) = merge(pixel, rule);
        assert_eq!(merged.len(), expected.len(), "{rule:?}: {merged:?}");
        for ((position, gray), (expected_position, expected_gray)) in merged.iter().zip(expected) {
            // Half a step of the offset is added; f32 rounds to 1e-6 of a bin here.
            let expected_position = expected_position + 0.5 / 65_536.0;
            assert!(
                (position - expected_position).abs() < 2e-6,
                "{rule:?}: {merged:?}, not {expected:?}"
            );
            assert_eq!(gray, expected_gray, "{rule:?}: {merged:?}");
        }
        assert!(spans.iter().all(|span| span[1] <= span[0] + 1), "{spans:?}");
    }

    #[test]
    fn merge_rules_differ_as_in_the_papers() {
        // One cluster across a border of bins: a dark sample of three rays, and a bright one of one
        // ray from nearer.
        let pixel = [
            gray_sample(9.75, 50, 3, 4.0, 7),
            gray_sample(10.25, 200, 1, 1.0, 2),
        ];
        // (3 * 9.75 + 10.25) / 4; the mean of 0.0319 (3 times) and 0.5776 is 0.1683, sRGB 114.
        assert_merged(&pixel, MergeRule::Average, &[(9.875, 114)]);
        assert_merged(&pixel, MergeRule::SmallerArea, &[(10.25, 200)]);
        assert_merged(&pixel, MergeRule::ColorsApart, &[(9.75, 50), (10.25, 200)]);
        assert_eq!(merge(&pixel, MergeRule::Average).1, [[9, 10]]);
        assert_eq!(
            merge(&pixel, MergeRule::ColorsApart).1,
            [[9, 10]; 2],
            "both with the bins of their cluster"
        );
        // A sample more than a bin away is another surface under every rule.
        let apart = [
            gray_sample(9.25, 50, 3, 4.0, 7),
            gray_sample(10.75, 50, 1, 1.0, 2),
        ];
        for rule in [
            MergeRule::Average,
            MergeRule::SmallerArea,
            MergeRule::ColorsApart,
        ] {
            assert_merged(&apart, rule, &[(9.25, 50), (10.75, 50)]);
        }
    }

    #[test]
    fn equal_areas_and_colours_keep_the_first_ray() {
        let pixel = |key_a: u64, key_b: u64, gray_b: u8| {
            [
                gray_sample(9.75, 100, 1, 2.0, key_a),
                gray_sample(10.25, gray_b, 1, 2.0, key_b),
            ]
        };
        assert_merged(&pixel(1, 2, 100), MergeRule::SmallerArea, &[(9.75, 100)]);
        assert_merged(&pixel(2, 1, 100), MergeRule::SmallerArea, &[(10.25, 100)]);
        let almost = 100 + SAME_COLOR_LEVELS - 1;
        assert_merged(&pixel(1, 2, almost), MergeRule::ColorsApart, &[(9.75, 100)]);
        assert_merged(
            &pixel(2, 1, almost),
            MergeRule::ColorsApart,
            &[(10.25, almost)],
        );
        assert_merged(
            &pixel(2, 1, almost + 1),
            MergeRule::ColorsApart,
            &[(9.75, 100), (10.25, almost + 1)],
        );
        // Colours differ if one channel does.
        let mut red = pixel(1, 2, 100);
        red[1].emission.x = 1.0;
        assert_eq!(merge(&red, MergeRule::ColorsApart).0.len(), 2);
    }

    #[test]
    fn mean_has_the_normal_of_most_rays() {
        let mut pixel = [
            gray_sample(9.75, 50, 3, 4.0, 2),
            gray_sample(10.25, 50, 4, 1.0, 7),
        ];
        pixel[0].plane_normal = Vec3::X;
        pixel[1].plane_normal = Vec3::Y;
        let bins = DepthBins::new(0.5, 64);
        let normal = |pixel: &[SurfaceSample]| {
            merger(MergeRule::Average, &bins)
                .average([0, 0], pixel)
                .normal
        };
        assert_eq!(normal(&pixel), EncodedNormal::new(Vec3::Y));
        pixel[0].count = 4;
        assert_eq!(
            normal(&pixel),
            EncodedNormal::new(Vec3::X),
            "of equal counts, the first ray's"
        );
    }
}
