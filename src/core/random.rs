//! The workspace's one sequential random generator, SplitMix64 (Steele, Lea and Flood 2014), read
//! as counter-based: the n-th number of a stream is a hash of the stream's key and n. So the same
//! seed gives the same scene everywhere, and a part that draws more numbers does not disturb the
//! parts after it. Samplers, which need the n-th number of millions of streams, hash coordinates
//! instead: `random4`.

use glam::DVec3;

/// The golden-ratio increment of SplitMix64.
const INCREMENT: u64 = 0x9E37_79B9_7F4A_7C15;

/// The finaliser of SplitMix64.
pub fn hash(value: u64) -> u64 {
    let z = (value ^ (value >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// A hash as a number in 0..1.
pub fn unit(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1_u64 << 53) as f64
}

/// A stream of numbers.
#[derive(Clone, Debug)]
pub struct Rng {
    key: u64,
    counter: u64,
}

impl Rng {
    /// The stream of a seed: seeds that differ by little give streams that have nothing to do with
    /// each other.
    pub fn new(seed: u64) -> Self {
        Self::keyed(hash(seed ^ INCREMENT))
    }

    /// SplitMix64 from this state on.
    pub fn keyed(key: u64) -> Self {
        Self { key, counter: 0 }
    }

    /// An independent stream for part `part`; the same whatever was drawn from `self`.
    pub fn fork(&self, part: u64) -> Self {
        Self {
            key: hash(self.key ^ hash(part.wrapping_add(INCREMENT))),
            counter: 0,
        }
    }

    /// 64 uniform bits.
    pub fn bits(&mut self) -> u64 {
        self.counter = self.counter.wrapping_add(INCREMENT);
        hash(self.key.wrapping_add(self.counter))
    }

    /// Uniform in 0..1.
    pub fn unit(&mut self) -> f64 {
        unit(self.bits())
    }

    /// One of `0..count`; 0 of none.
    pub fn below(&mut self, count: u64) -> u64 {
        self.bits() % count.max(1)
    }

    /// Uniform in `low..high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in a cube from `-half` to `half`.
    pub fn in_cube(&mut self, half: f64) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| self.between(-half, half)))
    }

    /// Uniform in the unit ball.
    pub fn in_ball(&mut self) -> DVec3 {
        loop {
            let place = self.in_cube(1.0);
            if place.length_squared() <= 1.0 {
                return place;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_reproducible_independent_uniform() {
        let mut a = Rng::new(1);
        let fork_before = a.fork(3).unit();
        let mean = (0..10_000).map(|_| a.unit()).sum::<f64>() / 10_000.0;
        // The standard error of the mean of 10,000 uniform numbers is 0.0029; this is six of them.
        assert!((mean - 0.5).abs() < 0.018, "{mean}");
        assert_eq!(a.fork(3).unit(), fork_before);
        assert_ne!(Rng::new(1).unit(), Rng::new(2).unit());
        assert_ne!(Rng::new(1).fork(0).unit(), Rng::new(1).fork(1).unit());
    }

    #[test]
    fn numbers_are_those_of_splitmix64() {
        // The first three of the reference implementation (Vigna 2015) from state 1234567.
        let mut rng = Rng::keyed(1_234_567);
        let expected = [
            6_457_827_717_110_365_317,
            3_203_168_211_198_807_973,
            9_817_491_932_198_370_423,
        ];
        assert_eq!([(); 3].map(|()| rng.bits()), expected);
    }
}
