//! Roots and powers on vectors of `f32`.
//!
//! The library functions are scalar and differ between platforms; these only use IEEE operations,
//! so that every SIMD level and every platform gives the same bits. Their relative error is below
//! 2.4e-7 for the root and, for bases between 2^-20 and 2^20, below 1e-6 for the power; a test
//! checks these bounds.

use std::f32::consts::LN_2;

use fearless_simd::prelude::*;

/// `x^(1/3)` for normal `x > 0`.
#[inline(always)]
pub(super) fn cbrt<S: Simd>(x: S::f32s) -> S::f32s {
    /// Two thirds of the bits of 1.0, less the bias that makes the first guess best (within 3.5 %;
    /// Kahan).
    const OFFSET: f32 = 709_958_130.0;
    let bits: S::i32s = x.bitcast();
    let guess: S::i32s = (bits.to_float::<S::f32s>() * (1.0 / 3.0) + OFFSET).to_int();
    let guess: S::f32s = guess.bitcast();
    halley(x, halley(x, guess))
}

/// Performs a step of Halley's method for the cube root: the relative error e becomes 2/3 e^3.
#[inline(always)]
fn halley<S: Simd, V: SimdFloat<S, Element = f32>>(x: V, root: V) -> V {
    let cube = root * root * root;
    root * ((cube + x + x) / (cube + cube + x))
}

/// `x^exponent`, and 0 where x is 0 (or subnormal), for `x >= 0` and `|exponent log2(x)| < 126`.
#[inline(always)]
pub(super) fn pow<S: Simd>(simd: S, x: S::f32s, exponent: S::f32s) -> S::f32s {
    let power = exp2::<S>(log2::<S>(x) * exponent);
    x.simd_lt(f32::MIN_POSITIVE)
        .select(S::f32s::splat(simd, 0.0), power)
}

/// Binary logarithm of normal `x > 0`: the exponent, and the series of artanh about 1 for the
/// mantissa.
#[inline(always)]
fn log2<S: Simd>(x: S::f32s) -> S::f32s {
    /// Bits of sqrt(1/2): mantissas are taken in [sqrt(1/2), sqrt(2)), where |s| <= 0.172 and s^11
    /// no longer counts.
    const SQRT_HALF: i32 = 0x3f35_04f3;
    let bits: S::i32s = x.bitcast();
    let exponent = (bits - SQRT_HALF) >> 23;
    let mantissa: S::f32s = (bits - (exponent << 23)).bitcast();
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let s2 = s * s;
    let series = (((s2 * (1.0 / 9.0) + 1.0 / 7.0) * s2 + 1.0 / 5.0) * s2 + 1.0 / 3.0) * s2 + 1.0;
    exponent.to_float::<S::f32s>() + s * series * (2.0 / LN_2)
}

/// `2^x` for |x| < 126: the integer part goes into the exponent, the rest (at most 1/2) through
/// Taylor's series.
#[inline(always)]
fn exp2<S: Simd>(x: S::f32s) -> S::f32s {
    let whole = x.round_ties_even();
    let t = (x - whole) * LN_2;
    let high = ((t * (1.0 / 5040.0) + 1.0 / 720.0) * t + 1.0 / 120.0) * t + 1.0 / 24.0;
    let series = (((high * t + 1.0 / 6.0) * t + 0.5) * t + 1.0) * t + 1.0;
    let scale: S::f32s = ((whole.to_int::<S::i32s>() + 127) << 23).bitcast();
    series * scale
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};

    use super::*;

    /// Halley's last step rounds the cube (of which a third counts), two sums, a quotient and a
    /// product: at most 4 half ulps, 2^-24 each.
    const ROOT_ERROR: f64 = 2.4e-7;
    /// The logarithm is at most 20 in the tested range; half an ulp of it is 2^-20, times ln 2 =
    /// 6.6e-7, and the series of the exponential adds 3 half ulps.
    const POWER_ERROR: f64 = 8.5e-7;

    #[test]
    fn roots_and_powers_match_f64() {
        let level = Level::new();
        for i in 0..100_000 {
            let x = (f64::from(i) * 3.5e-4 - 19.5).exp2() as f32;
            for exponent in [0.7_f32, 1.0, 0.31] {
                let (root, power) = dispatch!(level, simd => scalar(simd, x, exponent));
                let (true_root, true_power) =
                    (f64::from(x).cbrt(), f64::from(x).powf(f64::from(exponent)));
                assert!(
                    (f64::from(root) / true_root - 1.0).abs() < ROOT_ERROR,
                    "cbrt({x}) = {root}"
                );
                assert!(
                    (f64::from(power) / true_power - 1.0).abs() < POWER_ERROR,
                    "{x}^{exponent} = {power}"
                );
            }
        }
        assert_eq!(dispatch!(level, simd => scalar(simd, 0.0, 0.7)).1, 0.0);
        assert_eq!(dispatch!(level, simd => scalar(simd, 1.0, 0.7)), (1.0, 1.0));
    }

    #[inline(always)]
    fn scalar<S: Simd>(simd: S, x: f32, exponent: f32) -> (f32, f32) {
        let x = S::f32s::splat(simd, x);
        (
            cbrt::<S>(x)[0],
            pow(simd, x, S::f32s::splat(simd, exponent))[0],
        )
    }
}
