//! Owen-scrambled Sobol (0, 2)-sequence in base 2: of 2^k consecutive points starting at a multiple
//! of 2^k, each elementary interval of area 2^-k of the unit square contains one.
//!
//! Scrambling is by a hash of the bits above each bit (Burley 2020, "Practical Hash-based Owen
//! Scrambling"; the hash is Laine and Karras's of 2011). A second use of the sequence for another
//! decision takes the points in another order, which is scrambled likewise, so that blocks of 2^k
//! points stay together and decisions have nothing to do with each other.

/// Returns point `index` of the sequence given by three seeds: the order of the points and the
/// scrambling of the two coordinates. In units of 2^-32.
#[inline]
pub(super) fn point(index: u32, [order, first, second]: [u32; 3]) -> [u32; 2] {
    let index = scramble(index.reverse_bits(), order).reverse_bits();
    // The reversed bits of the Sobol coordinates are the index itself and its product with Pascal's
    // triangle.
    [scramble(index, first), scramble(pascal(index), second)].map(u32::reverse_bits)
}

/// Returns the first coordinate of [`point`].
#[inline]
pub(super) fn first(index: u32, [order, first]: [u32; 2]) -> u32 {
    let index = scramble(index.reverse_bits(), order).reverse_bits();
    scramble(index, first).reverse_bits()
}

/// Multiplies the bits of `index` by Pascal's triangle modulo 2: bit i of the result is the parity
/// of the bits j of `index` for which `i & j == i`.
#[inline]
fn pascal(mut index: u32) -> u32 {
    index ^= index >> 1 & 0x5555_5555;
    index ^= index >> 2 & 0x3333_3333;
    index ^= index >> 4 & 0x0f0f_0f0f;
    index ^= index >> 8 & 0x00ff_00ff;
    index ^ index >> 16
}

/// Permutes numbers such that each bit depends on those below it (Laine and Karras 2011,
/// with the constants of Vegdahl 2021).
#[inline]
fn scramble(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul(seed >> 16 | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^ x.wrapping_mul(0x53a2_2864)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::random4;

    #[test]
    fn elementary_intervals_have_one_point() {
        const BITS: u32 = 8;
        let [order, first, second, _] = random4([1, 2, 3, 4]);
        for block in [0u32, 3, 1 << 20] {
            for across in 0..=BITS {
                let mut seen = [false; 1 << BITS];
                for i in 0..1 << BITS {
                    let [x, y] = point((block << BITS) + i, [order, first, second]);
                    let (column, row) = (
                        u64::from(x) >> (32 - across),
                        u64::from(y) >> (32 - BITS + across),
                    );
                    let cell = column << (BITS - across) | row;
                    assert!(
                        !std::mem::replace(&mut seen[cell as usize], true),
                        "two points in box {cell}, {across}"
                    );
                }
            }
        }
    }

    #[test]
    fn first_matches_point() {
        for index in [0, 1, 77, u32::MAX] {
            assert_eq!(first(index, [5, 6]), point(index, [5, 6, 7])[0]);
        }
    }

    #[test]
    fn decisions_independent() {
        const COUNT: u32 = 1 << 14;
        let at = |i: u32, seed: u32| {
            let [order, first, second, _] = random4([seed, 0, 0, 0]);
            point(i, [order, first, second]).map(|c| f64::from(c) / 4_294_967_296.0 - 0.5)
        };
        for (one, other) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let product: f64 = (0..COUNT)
                .map(|i| at(i, 1)[one] * at(i, 2)[other])
                .sum::<f64>()
                / f64::from(COUNT);
            assert!(
                product.abs() < 4.0 / 12.0 / f64::from(COUNT).sqrt(),
                "correlated: {product}"
            );
        }
    }
}
