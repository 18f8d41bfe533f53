//! Samples and accumulators of ray hits.
//!
//! Everything in an accumulator is a sum of integers or the minimum of a total order, so that the
//! result does not depend on the order in which rays arrive, on threads, or on how a capture is cut
//! into shards.

use glam::Vec3;
use headbox_core::cube_face::Face;
use headbox_trace::bvh::Tracer;
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

/// Number of bits of an [`Accumulator::class`] for the direction of the normal.
const DIRECTION_BITS: u32 = 7;

/// The part of a class that all samples of a surface share, whatever small errors their normals
/// have: material and side.
pub(crate) fn material_and_side(class: u16) -> u16 {
    class >> DIRECTION_BITS
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
    /// Kind of surface: material, side (front or back) and direction of the normal. Samples of
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

    /// The class of a surface: 8 bits of material, the side, and the direction of its normal, each
    /// component in halves. So the sides of a box and its bevels are of different classes, while
    /// upright walls whose normals have small errors are not.
    pub fn class(material: u32, back: bool, normal: Vec3) -> u16 {
        let halves = |c: f32| (2.0 * c + 2.5) as u32;
        let direction = halves(normal.x) + 5 * halves(normal.y) + 25 * halves(normal.z);
        (material << (DIRECTION_BITS + 1) | u32::from(back) << DIRECTION_BITS | direction) as u16
    }

    /// The class of the surface that a ray hits, and the dot product of the ray's direction and the
    /// triangle's normal.
    #[inline]
    pub fn class_of_hit(tracer: &Tracer, direction: Vec3, primitive: u32) -> (u16, f32) {
        let normal = tracer.geometric_normal(primitive);
        let cos = normal.dot(direction);
        let is_back = cos > 0.0;
        let material = tracer.scene().triangles[primitive as usize].material;
        let class = Self::class(material, is_back, if is_back { -normal } else { normal });
        (class, cos)
    }

    /// Returns true if the representative was hit from the back of its triangle.
    pub fn is_back(&self) -> bool {
        self.class >> DIRECTION_BITS & 1 != 0
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
    fn class_holds_material_side_and_direction() {
        use glam::vec3;
        let class = |normal: Vec3| Accumulator::class(5, true, normal.normalize());
        // Upright, with small errors.
        let wall = class(vec3(0.0, 0.0, 1.0));
        assert_eq!(wall, 5 << 8 | 128 | (4 * 25 + 2 * 5 + 2));
        assert_eq!(class(vec3(-0.01, 1e-6, 1.0)), wall);
        // The other sides of a box, bevels and a corner.
        let others = [
            vec3(1.0, 0.0, 0.0),
            vec3(0.0, 1.0, 0.0),
            vec3(0.0, 0.0, -1.0),
            vec3(0.0, 1.0, 1.0),
            vec3(1.0, 0.0, 1.0),
            vec3(1.0, 1.0, 1.0),
        ];
        for (i, &other) in others.iter().enumerate() {
            assert!(class(other) != wall, "{other}");
            assert!(others[..i].iter().all(|&it| class(it) != class(other)));
            assert_eq!(material_and_side(class(other)), material_and_side(wall));
        }
        assert_ne!(
            material_and_side(wall),
            material_and_side(Accumulator::class(5, false, vec3(0.0, 0.0, 1.0)))
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
