//! Sequential random generator of the workspace: SplitMix64 (Steele, Lea and Flood 2014) as a
//! counter-based generator. The n-th number of a stream is a hash of the stream's key and n, so the
//! same seed gives the same scene everywhere, and a part that draws more numbers does not disturb
//! later parts. Samplers, which need the n-th number of millions of streams, hash coordinates
//! instead (`random4`).

use glam::DVec3;

/// Golden-ratio increment of SplitMix64.
const INCREMENT: u64 = 0x9E37_79B9_7F4A_7C15;

/// Finaliser of SplitMix64.
pub fn hash(value: u64) -> u64 {
    let z = (value ^ (value >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Converts a hash to a number in 0..1.
pub fn unit(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1_u64 << 53) as f64
}

/// Stream of random numbers.
#[derive(Clone, Debug)]
pub struct Rng {
    key: u64,
    counter: u64,
}

impl Rng {
    /// Creates the stream of a seed; similar seeds give unrelated streams.
    pub fn new(seed: u64) -> Self {
        Self::keyed(hash(seed ^ INCREMENT))
    }

    /// Creates SplitMix64 with this state.
    pub fn keyed(key: u64) -> Self {
        Self { key, counter: 0 }
    }

    /// Returns an independent stream for part `part`; it does not depend on numbers drawn from
    /// `self`.
    pub fn fork(&self, part: u64) -> Self {
        Self {
            key: hash(self.key ^ hash(part.wrapping_add(INCREMENT))),
            counter: 0,
        }
    }

    /// Draws 64 uniform bits.
    pub fn bits(&mut self) -> u64 {
        self.counter = self.counter.wrapping_add(INCREMENT);
        hash(self.key.wrapping_add(self.counter))
    }

    /// Draws a number uniformly from 0..1.
    pub fn unit(&mut self) -> f64 {
        unit(self.bits())
    }

    /// Draws one of `0..count`; 0 if `count` is 0.
    pub fn below(&mut self, count: u64) -> u64 {
        self.bits() % count.max(1)
    }

    /// Draws a number uniformly from `low..high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Draws a point uniformly from the cube from `-half` to `half`.
    pub fn in_cube(&mut self, half: f64) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| self.between(-half, half)))
    }

    /// Draws a point uniformly from the unit ball.
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
    fn numbers_match_splitmix64() {
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
