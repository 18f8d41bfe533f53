//! Coverage: the alpha of a depth pixel.
//!
//! A ray that hits a surface anywhere in a pixel makes a sample that stands for the whole pixel.
//! Where the surface ends inside the pixel, or is smaller than it, as a leaf is, the sample must
//! let through the background, and no more than that: behind a crown of leaves lie more leaves,
//! some of which no ray has hit. So [`PACKET`] rays from the centre go through each pixel that
//! contains the rim of a surface, and the alpha of a sample is the share of the rays reaching it
//! that end at it. Seen from the centre, the pixel then has exactly the mixture of colours that its
//! rays hit. A sample that the centre does not see gets the share of the pixel that it fills,
//! whatever is in front of it, and also where the centre would see only the back of a single-sided
//! surface.
//!
//! A surface has a rim only where some neighbouring pixel has no sample of it; everything else
//! covers its whole pixel. Cheaper estimates cannot distinguish a rim from a surface that few rays
//! hit (docs/decisions/0020). Triangles smaller than a pixel, such as far leaves, gravel or chain
//! link, have rims that no neighbour betrays, because it holds other ones at the same depth. A ray
//! through each pixel finds them: a block of pixels in which one passes a surface without a rim, or
//! in which most of those through rims pass, is measured as a whole, with [`SPARSE_PACKETS`] times
//! as many rays (docs/decisions/0068). What its rays meet where the capture met nothing counts for
//! the block's samples (docs/decisions/0071).

use super::centre_rays::CentreRays;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::samples::{DepthPixel, LayeredDepthImage};
use headbox_trace::bvh::{PACKET, Ray, RayPacket, Tracer};
use rayon::prelude::*;
use std::borrow::Cow;

/// First and last depth bin of the samples that a depth pixel was merged from.
pub(crate) type BinSpan = [u16; 2];

/// Measurement of the alphas of a face.
pub(crate) struct AlphaMeasure<'a> {
    pub(crate) tracer: &'a Tracer,
    pub(crate) bins: &'a DepthBins,
    /// Half of the headbox's edge, metres: rays start where it ends.
    pub(crate) half_size_m: f64,
    pub(crate) face: &'a LayeredDepthImage,
    /// Bin spans of the face's samples.
    pub(crate) spans: &'a [BinSpan],
    /// True if the scene has single-sided materials.
    pub(crate) has_single_sided: bool,
}

/// Side of the blocks of pixels that are searched for sparse surfaces, with one ray a pixel.
const BLOCK: u32 = 8;

/// Number of packets through a pixel of a sparse surface.
const SPARSE_PACKETS: usize = 4;

/// Distance in depth, bins, beyond which a sample does not belong to the surface that a ray hits.
const MAX_GAP: u16 = 8;

/// Minimum number of rays that must reach a sample for its share of them to count.
const ENOUGH_RAYS: u32 = 4;

/// Maximum gap, in bins, between samples that follow each other in depth.
const DEPTH_RUN_GAP: u16 = 2;

/// Minimum share of a pixel over which a surface stays within its bins. A surface that the centre
/// sees edge-on leaves them before it crosses the pixel.
const LEAST_REACHABLE: f64 = 0.05;

/// Rays from the centre through a pixel, by the samples at which they end.
#[derive(Clone, Default)]
struct PixelRays {
    /// Number of rays but those that count for samples of other pixels.
    count: u32,
    /// Number of the pixel's rays that end at each sample.
    visible: Vec<u32>,
    /// Number of rays of other pixels that count for each sample.
    added: Vec<u32>,
}

impl AlphaMeasure<'_> {
    /// The alphas of all samples, in their order.
    pub(crate) fn alphas(&self) -> Vec<u8> {
        let blocks = self.face.size_px.div_ceil(BLOCK);
        let block_row = |row: u32| {
            let top = row * BLOCK;
            let sparse: Vec<Option<Vec<PixelRays>>> = (0..blocks)
                .map(|column| {
                    let pixels = self.block(column * BLOCK, top);
                    self.is_sparse(&pixels)
                        .then(|| self.trace(&pixels, SPARSE_PACKETS))
                })
                .collect();
            let mut alphas = Vec::new();
            for y in top..self.face.size_px.min(top + BLOCK) {
                for x in 0..self.face.size_px {
                    let rays = sparse[(x / BLOCK) as usize].as_ref();
                    let width = BLOCK.min(self.face.size_px - x / BLOCK * BLOCK);
                    let rays = rays.map(|rays| &rays[((y - top) * width + x % BLOCK) as usize]);
                    self.measure_pixel(x, y, rays, &mut alphas);
                }
            }
            alphas
        };
        let rows: Vec<Vec<u8>> = (0..blocks).into_par_iter().map(block_row).collect();
        rows.concat()
    }

    /// The alphas of all samples, in their order: those of rims measured in the pixels (x, y) that
    /// `is_selected` accepts, unchanged elsewhere.
    pub(crate) fn rim_alphas(&self, is_selected: impl Fn(u32, u32) -> bool + Sync) -> Vec<u8> {
        let row = |y: u32| {
            let mut alphas = Vec::new();
            for x in 0..self.face.size_px {
                if is_selected(x, y) {
                    self.measure_pixel(x, y, None, &mut alphas);
                } else {
                    let samples = self.face.pixel(x, y);
                    alphas.extend(samples.iter().map(|sample| sample.color_srgb[3]));
                }
            }
            alphas
        };
        let rows: Vec<Vec<u8>> = (0..self.face.size_px).into_par_iter().map(row).collect();
        rows.concat()
    }

    /// Pixels of the block at (`left`, `top`), row by row.
    fn block(&self, left: u32, top: u32) -> Vec<[u32; 2]> {
        let range = |start: u32| start..self.face.size_px.min(start + BLOCK);
        range(top)
            .flat_map(|y| range(left).map(move |x| [x, y]))
            .collect()
    }

    /// Returns true if surfaces in a block are sparse: of one ray through each pixel one passes the
    /// nearest surface where that has no rim, or more than half do of those through pixels where
    /// that has a rim.
    fn is_sparse(&self, block: &[[u32; 2]]) -> bool {
        let filled: Vec<[u32; 2]> = block
            .iter()
            .copied()
            .filter(|&[x, y]| !self.face.pixel(x, y).is_empty())
            .collect();
        let centre_rays = self.centre_rays();
        let mut passed = Vec::new();
        for pixels in filled.chunks(PACKET) {
            let mut rays = RayPacket::EMPTY;
            for (k, &[x, y]) in pixels.iter().enumerate() {
                let offset = centre_rays.shift([x, y], 0xb10c);
                let range = self.range_from_headbox();
                rays.set(k, &centre_rays.ray([x, y], offset, range));
            }
            let hits = self.tracer.closest_packet(&rays);
            let ends = pixels.iter().zip(hits.t);
            passed.extend(
                ends.filter_map(|(&[x, y], t)| self.passes_nearest(x, y, t).then_some([x, y])),
            );
        }
        let has_rim =
            |&[x, y]: &[u32; 2]| self.face.pixel(x, y).iter().any(|it| self.is_rim(x, y, it));
        if !passed.iter().all(has_rim) {
            return true;
        }
        let nearest_is_rim = |&&[x, y]: &&[u32; 2]| {
            let nearest = self.face.pixel(x, y).last();
            nearest.is_some_and(|sample| self.is_rim(x, y, sample))
        };
        !passed.is_empty() && 2 * passed.len() > filled.iter().filter(nearest_is_rim).count()
    }

    /// Returns true if a ray through a pixel that ends at eye depth `t` passed the nearest surface:
    /// it ends behind the surface's bins, and behind its tangent plane within the pixel.
    fn passes_nearest(&self, x: u32, y: u32, t: f32) -> bool {
        let (Some(sample), Some(span)) = (self.face.pixel(x, y).last(), self.spans(x, y).last())
        else {
            return false;
        };
        let [column, row] = [x, y].map(|pixel| f64::from(pixel) + 0.5);
        let slope = self
            .face
            .inverse_depth_slope(column, row, sample, f64::INFINITY);
        let farthest = f64::from(sample.inverse_depth) * (1.0 - slope.abs().element_sum());
        t.is_infinite() || self.bins.place(1.0 / t).0 < span[0] && 1.0 / f64::from(t) < farthest
    }

    /// Traces rays from the centre through pixels. A ray counts for that sample of its pixel which
    /// is nearest in depth to the surface at which it ends. If that is more than [`MAX_GAP`] bins
    /// away, the nearest sample of all the pixels counts instead, if it is not as far away.
    fn trace(&self, pixels: &[[u32; 2]], packets: usize) -> Vec<PixelRays> {
        let spans: Vec<&[BinSpan]> = pixels.iter().map(|&[x, y]| self.spans(x, y)).collect();
        let mut traced: Vec<PixelRays> = spans
            .iter()
            .map(|spans| PixelRays {
                count: (packets * PACKET) as u32,
                visible: vec![0; spans.len()],
                added: vec![0; spans.len()],
            })
            .collect();
        let mut far = Vec::new();
        for (k, &[x, y]) in pixels.iter().enumerate() {
            for packet in 0..packets {
                let range = self.range_from_headbox();
                let rays = self.centre_rays().packet([x, y], packet, range);
                let hits = self.tracer.closest_packet(&rays);
                for t in hits.t.into_iter().filter(|t| t.is_finite()) {
                    let bin = self.bins.place(1.0 / t).0;
                    match nearest_span(spans[k], bin) {
                        Some((gap, i)) if gap <= MAX_GAP => traced[k].visible[i] += 1,
                        own => far.push((bin, k, own)),
                    }
                }
            }
        }
        for (bin, from, own) in far {
            let near = spans.iter().enumerate().filter_map(|(k, spans)| {
                let (gap, i) = nearest_span(spans, bin)?;
                // Of several the next after the pixel, so that not one gets all rays.
                let steps = (k + pixels.len() - from) % pixels.len();
                (gap <= MAX_GAP).then_some((gap, steps, k, i))
            });
            if let Some((.., k, i)) = near.min() {
                traced[k].added[i] += 1;
                traced[from].count -= 1;
            } else if let Some((_, i)) = own {
                traced[from].visible[i] += 1;
            }
        }
        traced
    }

    /// Appends the alphas of a pixel's samples. `sparse`: rays through a pixel of a sparse block.
    fn measure_pixel(&self, x: u32, y: u32, sparse: Option<&PixelRays>, alphas: &mut Vec<u8>) {
        let samples = self.face.pixel(x, y);
        let before = alphas.len();
        alphas.resize(before + samples.len(), 255);
        let is_rim = |sample: &DepthPixel| sparse.is_some() || self.is_rim(x, y, sample);
        if !samples.iter().any(is_rim) {
            return;
        }
        let packets = if sparse.is_some() { SPARSE_PACKETS } else { 1 };
        let spans = self.spans(x, y);
        let rays = sparse.map_or_else(
            || Cow::Owned(self.trace(&[[x, y]], packets).swap_remove(0)),
            Cow::Borrowed,
        );
        let mut reaching = rays.count;
        for i in (0..samples.len()).rev() {
            if reaching >= ENOUGH_RAYS || is_rim(&samples[i]) {
                let share = if reaching >= ENOUGH_RAYS {
                    let rays = rays.visible[i] + rays.added[i];
                    ray_weight(rays, sparse.is_some()) / f64::from(reaching)
                } else {
                    self.filled_share(x, y, packets, spans[i])
                };
                let reachable = if is_in_depth_run(spans, i) {
                    self.reachable_share(x, y, &samples[i], spans[i])
                } else {
                    1.0
                };
                let alpha = (share / reachable).min(1.0);
                alphas[before + i] = (alpha * 255.0).round() as u8;
            }
            reaching -= rays.visible[i];
        }
    }

    /// Returns true if one of the eight neighbours of pixel (x, y) has no sample near the depth of
    /// `sample`. Surfaces are assumed to continue beyond the face.
    fn is_rim(&self, x: u32, y: u32, sample: &DepthPixel) -> bool {
        let face = self.face;
        let q = f64::from(sample.inverse_depth);
        // A bin, and the change over a pixel (2 / size) of a surface at 50 degrees. Too small a
        // reach only costs time.
        let reach = self.bins.inverse_depth(1.0) + q * 2.4 / f64::from(face.size_px);
        let continues = |other: &DepthPixel| (f64::from(other.inverse_depth) - q).abs() <= reach;
        let around = |c: u32| c.saturating_sub(1)..(c + 2).min(face.size_px);
        // The pixel itself contains the sample.
        around(y).any(|j| around(x).any(|i| !face.pixel(i, j).iter().any(continues)))
    }

    /// Bin spans of a pixel's samples.
    fn spans(&self, x: u32, y: u32) -> &[BinSpan] {
        let first = self.face.offsets[(y * self.face.size_px + x) as usize] as usize;
        &self.spans[first..first + self.face.pixel(x, y).len()]
    }

    /// Share of the pixel's rays that hit something within the span, from either side; at least
    /// part of a ray's.
    fn filled_share(&self, x: u32, y: u32, packets: usize, span: BinSpan) -> f64 {
        let [t_max, t_min] = self.inverse_depth_range(span).map(|q| (1.0 / q) as f32);
        let count = |i| {
            let mut rays = self.centre_rays().packet([x, y], i, [t_min, t_max]);
            let mut hits = self.tracer.occluded_packet(&rays);
            if self.has_single_sided {
                rays.active &= !hits;
                hits |= self.tracer.occluded_packet(&reversed(&rays));
            }
            hits.count_ones()
        };
        let hits: u32 = (0..packets).map(count).sum();
        ray_weight(hits, packets > 1) / (packets * PACKET) as f64
    }

    /// Minimum and maximum inverse depth of a span.
    fn inverse_depth_range(&self, [first, last]: BinSpan) -> [f64; 2] {
        [f64::from(first), f64::from(last) + 1.0].map(|position| self.bins.inverse_depth(position))
    }

    /// Share of the pixel over which the tangent plane of a sample stays within the span.
    fn reachable_share(&self, x: u32, y: u32, sample: &DepthPixel, span: BinSpan) -> f64 {
        let slope = self.face.inverse_depth_slope(
            f64::from(x) + 0.5,
            f64::from(y) + 0.5,
            sample,
            f64::INFINITY,
        );
        let [least, largest] = self.inverse_depth_range(span);
        let over_pixel = f64::from(sample.inverse_depth) * slope.abs().element_sum();
        ((largest - least) / over_pixel).clamp(LEAST_REACHABLE, 1.0)
    }

    /// Distances at which rays from the centre start and end.
    fn range_from_headbox(&self) -> [f32; 2] {
        [self.half_size_m as f32, f32::INFINITY]
    }

    /// Rays from the centre through the pixels.
    fn centre_rays(&self) -> CentreRays {
        CentreRays {
            face: self.face.face,
            size_px: self.face.size_px,
        }
    }
}

/// Returns the rays of a packet that have an end, from there to their start.
fn reversed(rays: &RayPacket) -> RayPacket {
    let mut backwards = RayPacket::EMPTY;
    for k in 0..PACKET {
        if let Some(ray) = rays.ray(k).filter(|ray| ray.t_max.is_finite()) {
            let from_end = Ray {
                origin: ray.origin + ray.direction * ray.t_max,
                direction: -ray.direction,
                t_min: 0.0,
                t_max: ray.t_max - ray.t_min,
            };
            backwards.set(k, &from_end);
        }
    }
    backwards
}

/// Returns the distance in bins of the span that is nearest to a depth bin, and its number.
fn nearest_span(spans: &[BinSpan], bin: u16) -> Option<(u16, usize)> {
    let gap = |&[first, last]: &BinSpan| first.saturating_sub(bin).max(bin.saturating_sub(last));
    spans.iter().map(gap).zip(0..).min()
}

/// Returns a number of rays as a weight. A sample that none of them meets has a little weight,
/// because rays from elsewhere met it. At rims all samples have half a ray more, because few rays
/// miss some pixels of a rim altogether; sparse surfaces consist of rims and would become too
/// dense.
fn ray_weight(rays: u32, is_sparse: bool) -> f64 {
    if is_sparse {
        f64::from(rays).max(0.25)
    } else {
        f64::from(rays) + 0.5
    }
}

/// Returns true if sample `i` is one of three or more that follow each other in depth with gaps of
/// at most [`DEPTH_RUN_GAP`].
fn is_in_depth_run(spans: &[BinSpan], i: usize) -> bool {
    let follows = |pair: &[BinSpan]| pair[1][0].saturating_sub(pair[0][1]) <= DEPTH_RUN_GAP;
    let before = spans[..=i]
        .windows(2)
        .rev()
        .take_while(|pair| follows(pair))
        .count();
    let after = spans[i..]
        .windows(2)
        .take_while(|pair| follows(pair))
        .count();
    before + after >= 2
}
