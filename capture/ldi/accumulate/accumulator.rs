//! Samples and accumulators of ray hits.
//!
//! Everything in an accumulator is a sum of integers or the minimum of a total order, so that the
//! result does not depend on the order in which rays arrive, on threads, or on how a capture is cut
//! into shards.

use headbox_core::cube_face::Face;
use headbox_trace::sampler::RayKey;

/// The hit of one ray on a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The face whose frustum contains the hit, whichever face the ray left (C13).
    pub face: Face,
    /// Pixel column on that face.
    pub x: u16,
    /// Pixel row on that face.
    pub y: u16,
    /// Depth bin.
    pub bin: u16,
    /// Position in the bin, 1/65,536 of its width.
    pub offset: u16,
    /// Kind of surface: see [`Accumulator::class`].
    pub class: u16,
    /// Albedo, linear, 16 bits a channel.
    pub albedo: [u16; 3],
    /// Triangle.
    pub primitive: u32,
    /// Barycentric weights of vertices 1 and 2, 16 bits each.
    pub barycentric: [u16; 2],
    /// Area in m^2 that a ray of unit solid angle covers there: distance squared over cosine (the
    /// measure of Rafferty's rule "keep the smaller area").
    pub area: f32,
    /// Identity of the ray.
    pub key: RayKey,
}

/// Quantises 0..=1 to 16 bits, as albedo and barycentric weights are stored.
#[inline]
pub(crate) fn to_unorm16(value: f32) -> u16 {
    (value * 65_535.0 + 0.5) as u16
}

/// All samples of one class in one depth bin of one pixel.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
pub struct Accumulator {
    /// The ray of the representative sample: the one with the smallest area, ties broken by key.
    pub key: RayKey,
    /// Sum of positions in the bin.
    pub offset_sum: u64,
    /// Sums of albedo.
    pub albedo_sum: [u64; 3],
    /// Number of samples.
    pub count: u32,
    /// Area of the representative.
    pub area: f32,
    /// Triangle of the representative.
    pub primitive: u32,
    /// Position of the representative on its triangle: barycentric weights of vertices 1 and 2.
    pub barycentric: [u16; 2],
    /// In a tile: the next accumulator of the same pixel, or [`Self::NO_NEXT`]. In a sorted run:
    /// the pixel.
    pub link: u32,
    /// Depth bin.
    pub bin: u16,
    /// Kind of surface: material, side (front or back) and octant of the normal. Samples of
    /// different classes are lit separately, so that a depth pixel never takes light from another
    /// surface, even where their colours are averaged.
    pub class: u16,
}

const _: () = assert!(size_of::<Accumulator>() == 64, "exactly one cache line");

impl Accumulator {
    /// End of a pixel's list.
    pub const NO_NEXT: u32 = u32::MAX;

    /// An accumulator of one sample.
    pub fn new(sample: &Sample) -> Self {
        Self {
            key: sample.key,
            offset_sum: u64::from(sample.offset),
            albedo_sum: sample.albedo.map(u64::from),
            count: 1,
            area: sample.area,
            primitive: sample.primitive,
            barycentric: sample.barycentric,
            link: Self::NO_NEXT,
            bin: sample.bin,
            class: sample.class,
        }
    }

    /// Adds another accumulator of the same pixel, bin and class.
    #[inline]
    pub fn absorb(&mut self, other: &Self) {
        self.offset_sum += other.offset_sum;
        for c in 0..3 {
            self.albedo_sum[c] += other.albedo_sum[c];
        }
        self.count = self.count.saturating_add(other.count);
        if other
            .area
            .total_cmp(&self.area)
            .then(other.key.cmp(&self.key))
            .is_lt()
        {
            self.key = other.key;
            self.area = other.area;
            self.primitive = other.primitive;
            self.barycentric = other.barycentric;
        }
    }

    /// The class of a surface: 12 bits of material, the side, and the octant of its normal.
    pub fn class(material: u32, back: bool, normal: glam::Vec3) -> u16 {
        let octant = u32::from(normal.x < 0.0)
            | u32::from(normal.y < 0.0) << 1
            | u32::from(normal.z < 0.0) << 2;
        (material << 4 | u32::from(back) << 3 | octant) as u16
    }

    /// Returns true if the representative was hit from the back of its triangle.
    pub fn is_back(&self) -> bool {
        self.class & 8 != 0
    }

    /// Sort key of runs: pixel (in `link`), bin, class.
    pub fn run_order(&self) -> (u32, u16, u16) {
        (self.link, self.bin, self.class)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_cube::model::depth_bins::DepthBins;

    const SAMPLE: Sample = Sample {
        face: Face::PosX,
        x: 0,
        y: 0,
        bin: 7,
        offset: 0,
        class: 3,
        albedo: [0; 3],
        primitive: 0,
        barycentric: [0; 2],
        area: 1.0,
        key: RayKey(0),
    };

    #[test]
    fn bins_cover_the_range_and_invert() {
        let bins = DepthBins::new(0.5, 1024);
        for i in 0..5000 {
            let inverse_depth = i as f32 / 5000.0 * 2.0;
            let (bin, offset) = bins.place(inverse_depth);
            let back = bins.inverse_depth(f64::from(bin) + f64::from(offset) / 65_536.0);
            // Half a 1/65,536 of a bin, and f32 rounding of a position of up to 887 bins.
            assert!(
                (back - f64::from(inverse_depth)).abs() < 2.0 / 887.0 * 1e-3,
                "{inverse_depth} {back}"
            );
        }
        assert_eq!(bins.place(f32::NAN).0, 0);
        assert_eq!(bins.place(f32::INFINITY).0, 886);
    }

    #[test]
    fn unorm16_rounds_to_nearest() {
        let step = 1.0 / 65_535.0;
        let values = [0.0, 0.4 * step, 0.6 * step, 0.5, 1.0 - 0.6 * step, 1.0];
        assert_eq!(values.map(to_unorm16), [0, 0, 1, 32_768, 65_534, 65_535]);
    }

    #[test]
    fn class_holds_material_side_and_octant() {
        use glam::vec3;
        assert_eq!(
            Accumulator::class(5, true, vec3(-0.1, 0.5, -0.2)),
            5 << 4 | 8 | 0b101
        );
        assert_eq!(
            Accumulator::class(3, false, vec3(0.0, -1.0, 0.0)),
            3 << 4 | 0b010
        );
        let is_back = |back: bool| {
            let class = Accumulator::class(7, back, vec3(1.0, 1.0, 1.0));
            Accumulator::new(&Sample { class, ..SAMPLE }).is_back()
        };
        assert!(is_back(true) && !is_back(false));
    }

    #[test]
    fn absorption_is_independent_of_order() {
        let sample = |i: u32| Sample {
            offset: (i * 977 % 65_521) as u16,
            albedo: [i as u16, 2, 3],
            primitive: i,
            barycentric: [i as u16, 0],
            area: (i % 5) as f32,
            key: RayKey::new(0, i, 0),
            ..SAMPLE
        };
        let fold = |order: &mut dyn Iterator<Item = u32>| {
            let accumulators: Vec<_> = order.map(|i| Accumulator::new(&sample(i))).collect();
            accumulators.into_iter().reduce(|mut a, b| {
                a.absorb(&b);
                a
            })
        };
        let forward = fold(&mut (0..100)).unwrap();
        assert_eq!(forward, fold(&mut (0..100).rev()).unwrap());
        assert_eq!(
            (forward.count, forward.area, forward.primitive),
            (100, 0.0, 0)
        );
    }
}
