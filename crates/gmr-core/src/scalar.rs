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
    let scaled = exp_normal(x);
    if x < -708.0 { 0.0 } else { scaled }
}

/// `exp(x)` for `x` in `(floor, 0]`, zero for all others and for NaN; `floor` is at least -708.
#[inline(always)]
pub(crate) fn exp_above(floor: f64, x: f64) -> f64 {
    let scaled = exp_normal(x);
    if x > floor { scaled } else { 0.0 }
}

/// `exp(x)` for `x` in `[-708, 0]`; anything for others.
#[inline(always)]
fn exp_normal(x: f64) -> f64 {
    let shifted = x.mul_add(std::f64::consts::LOG2_E, ROUND);
    let n = shifted - ROUND;
    let r = (-n).mul_add(LN_2_LO, (-n).mul_add(LN_2_HI, x));
    // exp r = 1 + r + r^2 t(r) on |r| <= ln(2)/2, t of degree 9 nearest in the sense of Chebyshev: 1.3e-17 off. Its terms
    // are gathered in pairs (Estrin 1960), so that few of them wait for each other.
    let (r2, r4) = (r * r, (r * r) * (r * r));
    let t01 = r.mul_add(0.166_666_666_666_666_69, 0.500_000_000_000_000_1);
    let t23 = r.mul_add(0.008_333_333_333_330_062, 0.041_666_666_666_624_13);
    let t45 = r.mul_add(1.984_126_986_305_361_8e-4, 1.388_888_891_721_371_7e-3);
    let t67 = r.mul_add(2.755_726_845_999_706_4e-6, 2.480_152_129_595_437_6e-5);
    let t89 = r.mul_add(2.510_038_549_551_032e-8, 2.762_008_844_540_974_6e-7);
    let t = r4.mul_add(r4.mul_add(t89, r2.mul_add(t67, t45)), r2.mul_add(t23, t01));
    let p = r2.mul_add(t, r) + 1.0;
    f64::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 52))
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
        assert!(exp_above(-70.0, -69.0).to_bits() == exp_nonpositive(-69.0).to_bits());
        assert!([-70.0, -1e3, f64::NEG_INFINITY, f64::NAN].iter().all(|x| exp_above(-70.0, *x) == 0.0));
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
