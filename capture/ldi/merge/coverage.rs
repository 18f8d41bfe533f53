//! Coverage: the alpha of a depth pixel.
//!
//! A ray that hits a surface anywhere in a pixel makes a sample that stands for the whole pixel.
//! Where the surface ends inside the pixel, or is smaller than it, as a leaf is, the sample must
//! let through the background, and no more than that: behind a crown of leaves lie more leaves,
//! some of which no ray has hit. So [`PACKET`] rays from the centre go through each pixel that
//! contains the rim of a surface, and the alpha of a sample is the share of the rays reaching it
//! that end at it. Seen from the centre, the pixel then has exactly the mixture of colours that its
//! rays hit. A sample that the centre does not see gets the share of the pixel that it fills,
//! whatever is in front of it.
//!
//! A surface has a rim only where some neighbouring pixel has no sample of it; everything else
//! covers its whole pixel. Cheaper estimates cannot distinguish a rim from a surface that few rays
//! hit (docs/decisions/0020).

use glam::Vec3;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::samples::{DepthPixel, LayeredDepthImage};
use headbox_trace::bvh::{HitPacket, PACKET, Ray, RayPacket, Tracer};
use headbox_trace::sampler::{random4, unit_float};
use rayon::prelude::*;

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
}

/// Minimum number of rays that must reach a sample for its share of them to count.
const ENOUGH_RAYS: u32 = 4;

/// Maximum gap, in bins, between samples that follow each other in depth.
const DEPTH_RUN_GAP: u16 = 2;

/// Minimum share of a pixel over which a surface stays within its bins. A surface that the centre
/// sees edge-on leaves them before it crosses the pixel.
const LEAST_REACHABLE: f64 = 0.05;

impl AlphaMeasure<'_> {
    /// The alphas of all samples, in their order: measured in the pixels (x, y) that `is_selected`
    /// accepts, unchanged elsewhere.
    pub(crate) fn alphas(&self, is_selected: impl Fn(u32, u32) -> bool + Sync) -> Vec<u8> {
        let row = |y: u32| {
            let mut alphas = Vec::new();
            for x in 0..self.face.size_px {
                if is_selected(x, y) {
                    self.measure_pixel(x, y, &mut alphas);
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

    /// Appends the alphas of a pixel's samples.
    fn measure_pixel(&self, x: u32, y: u32, alphas: &mut Vec<u8>) {
        let samples = self.face.pixel(x, y);
        let before = alphas.len();
        alphas.resize(before + samples.len(), 255);
        let is_rim = |sample: &DepthPixel| self.is_rim(x, y, sample);
        if !samples.iter().any(is_rim) {
            return;
        }
        let first = self.face.offsets[(y * self.face.size_px + x) as usize] as usize;
        let spans = &self.spans[first..first + samples.len()];
        let visible_counts = self.count_visible_from_centre(x, y, spans);
        let mut reaching = PACKET as u32;
        for i in (0..samples.len()).rev() {
            if reaching >= ENOUGH_RAYS || is_rim(&samples[i]) {
                let share = if reaching >= ENOUGH_RAYS {
                    (f64::from(visible_counts[i]) + 0.5) / f64::from(reaching)
                } else {
                    self.filled_share(x, y, spans[i])
                };
                let reachable = if is_in_depth_run(spans, i) {
                    self.reachable_share(x, y, &samples[i], spans[i])
                } else {
                    1.0
                };
                let alpha = (share / reachable).min(1.0);
                alphas[before + i] = (alpha * 255.0).round() as u8;
            }
            reaching -= visible_counts[i];
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

    /// Counts the pixel's rays that end at each sample. A ray that ends at a surface without a
    /// sample counts for the sample nearest to that depth.
    fn count_visible_from_centre(&self, x: u32, y: u32, spans: &[BinSpan]) -> Vec<u32> {
        let mut hits = [HitPacket::MISS];
        self.tracer.closest_packets(
            &[self.rays(x, y, self.half_size_m as f32, f32::INFINITY)],
            &mut hits,
        );
        let mut counts = vec![0; spans.len()];
        for t in hits[0].t.into_iter().filter(|t| t.is_finite()) {
            let bin = self.bins.place(1.0 / t).0;
            let distance =
                |[first, last]: &BinSpan| first.saturating_sub(bin).max(bin.saturating_sub(*last));
            if let Some(nearest) = (0..spans.len()).min_by_key(|&i| distance(&spans[i])) {
                counts[nearest] += 1;
            }
        }
        counts
    }

    /// Share of the pixel's rays that hit something within the span; at least half a ray's.
    fn filled_share(&self, x: u32, y: u32, span: BinSpan) -> f64 {
        let [t_max, t_min] = self.inverse_depth_range(span).map(|q| (1.0 / q) as f32);
        let hits = self
            .tracer
            .occluded_packet(&self.rays(x, y, t_min, t_max))
            .count_ones();
        (f64::from(hits) + 0.5) / PACKET as f64
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

    /// The rays from the centre through a pixel. Their directions have eye depth 1, so that `t` is
    /// eye depth.
    fn rays(&self, x: u32, y: u32, t_min: f32, t_max: f32) -> RayPacket {
        // An additive-recurrence set (R2, Roberts 2018), shifted at random.
        const STEPS: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];
        let face = self.face.face;
        let shift = random4([face.index() as u32, x, y, 0xc0]).map(unit_float);
        let mut packet = RayPacket::EMPTY;
        for k in 0..PACKET {
            let [jx, jy] = [0, 1].map(|c| (f64::from(shift[c]) + k as f64 * STEPS[c]).fract());
            let direction = face
                .direction(f64::from(x) + jx, f64::from(y) + jy, self.face.size_px)
                .as_vec3();
            packet.set(
                k,
                &Ray {
                    origin: Vec3::ZERO,
                    direction,
                    t_min,
                    t_max,
                },
            );
        }
        packet
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
