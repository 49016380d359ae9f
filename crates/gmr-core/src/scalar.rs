//! Exponential and logarithm that vectorise and give the same bits on every machine.
//!
//! The platform's `exp` and `ln` are calls into a C library that the compiler cannot vectorise and
//! whose last bit differs between libraries. These two are branch-free fused multiply-adds, so a
//! loop over a slice compiles to vector code and a fit gives the same bytes everywhere. Both
//! are within 2 units in the last place on the ranges stated (tests compare with the C library).

/// `ln 2` in two parts: the high part has 20 trailing zero bits, so `n * LN_2_HI` is exact for
/// every exponent `n`.
const LN_2_HI: f64 = f64::from_bits(0x3fe6_2e42_fee0_0000);
/// The rest of `ln 2` beyond [`LN_2_HI`].
const LN_2_LO: f64 = 1.908_214_929_270_587_7e-10;
/// Adding `1.5 * 2^52` rounds to the nearest integer and leaves that integer in the low bits.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// `exp(x)` for `x <= 0`; below -708 the result, smaller than 1e-307, is flushed to zero.
#[inline(always)]
pub(crate) fn exp_nonpositive(x: f64) -> f64 {
    let shifted = x.mul_add(std::f64::consts::LOG2_E, ROUND);
    let n = shifted - ROUND;
    let r = (-n).mul_add(LN_2_LO, (-n).mul_add(LN_2_HI, x));
    // Taylor series on |r| <= ln(2)/2: the first omitted term is 4e-18.
    let mut p = 1.0 / 6_227_020_800.0;
    p = r.mul_add(p, 1.0 / 479_001_600.0);
    p = r.mul_add(p, 1.0 / 39_916_800.0);
    p = r.mul_add(p, 1.0 / 3_628_800.0);
    p = r.mul_add(p, 1.0 / 362_880.0);
    p = r.mul_add(p, 1.0 / 40_320.0);
    p = r.mul_add(p, 1.0 / 5_040.0);
    p = r.mul_add(p, 1.0 / 720.0);
    p = r.mul_add(p, 1.0 / 120.0);
    p = r.mul_add(p, 1.0 / 24.0);
    p = r.mul_add(p, 1.0 / 6.0);
    p = r.mul_add(p, 0.5);
    p = r.mul_add(p, 1.0);
    p = r.mul_add(p, 1.0);
    let scaled = f64::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 52));
    if x < -708.0 { 0.0 } else { scaled }
}

/// `ln(x)` for positive normal `x`.
#[inline(always)]
pub(crate) fn ln_positive(x: f64) -> f64 {
    let bits = x.to_bits();
    let mantissa = f64::from_bits((bits & 0x000f_ffff_ffff_ffff) | 0x3ff0_0000_0000_0000);
    // 2^52 with the biased exponent in its low bits, minus 2^52 + 1023, is the exponent.
    let exponent = f64::from_bits((bits >> 52) | 0x4330_0000_0000_0000) - 4_503_599_627_371_519.0;
    let high = mantissa > std::f64::consts::SQRT_2;
    let m = if high { 0.5 * mantissa } else { mantissa };
    let e = if high { exponent + 1.0 } else { exponent };
    // ln m = 2 atanh(s), s = (m - 1) / (m + 1), |s| <= 0.1716.
    let f = m - 1.0;
    let s = f / (m + 1.0);
    let z = s * s;
    let mut p = 1.0 / 23.0;
    p = z.mul_add(p, 1.0 / 21.0);
    p = z.mul_add(p, 1.0 / 19.0);
    p = z.mul_add(p, 1.0 / 17.0);
    p = z.mul_add(p, 1.0 / 15.0);
    p = z.mul_add(p, 1.0 / 13.0);
    p = z.mul_add(p, 1.0 / 11.0);
    p = z.mul_add(p, 1.0 / 9.0);
    p = z.mul_add(p, 1.0 / 7.0);
    p = z.mul_add(p, 1.0 / 5.0);
    p = z.mul_add(p, 1.0 / 3.0);
    // f - s f + 2 s z p keeps the leading term exact for m near 1.
    let ln_m = f - s * (f - 2.0 * z * p);
    e.mul_add(LN_2_HI, e.mul_add(LN_2_LO, ln_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_agrees_with_the_c_library_to_two_units_in_the_last_place() {
        for i in 0..200_000 {
            let x = -708.0 * f64::from(i) / 200_000.0;
            let expected = x.exp();
            assert!((exp_nonpositive(x) - expected).abs() <= 2.0 * f64::EPSILON * expected, "{x}");
        }
        assert!(exp_nonpositive(0.0).to_bits() == 1f64.to_bits());
        assert!(exp_nonpositive(-709.0) == 0.0 && exp_nonpositive(f64::NEG_INFINITY) == 0.0);
        assert!(exp_nonpositive(f64::NAN).is_nan());
    }

    #[test]
    fn ln_agrees_with_the_c_library_to_two_units_in_the_last_place() {
        for i in 1..200_000 {
            for x in [f64::from(i) / 1000.0, f64::from(i).powi(40), f64::from(i).powi(-40), 1.0 + 1e-9 * f64::from(i)] {
                let expected = x.ln();
                assert!((ln_positive(x) - expected).abs() <= 2.0 * f64::EPSILON * expected.abs(), "{x}");
            }
        }
        assert!(ln_positive(1.0) == 0.0);
    }
}
