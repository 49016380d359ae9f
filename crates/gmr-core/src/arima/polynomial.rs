//! Stationary and invertible polynomials from unconstrained numbers.
//!
//! `tanh` maps each unconstrained number to a partial autocorrelation in (-1, 1); the
//! Durbin-Levinson recursion maps those one to one to the coefficients of a stationary
//! autoregression (Barndorff-Nielsen and Schou 1973; Monahan 1984). A moving average is the same
//! with the sign turned.

/// Largest partial autocorrelation in magnitude. At `1 - 1e-6` each one multiplies the stationary variance by at
/// most 5e5, which the filter carries; a series of a thousand values cannot tell it from one.
const LARGEST: f64 = 1.0 - 1e-6;

/// Coefficients of a stationary autoregression from unconstrained numbers.
pub(super) fn stationary(unconstrained: &[f64], coefficients: &mut [f64]) {
    for k in 0..unconstrained.len() {
        let r = unconstrained[k].tanh() * LARGEST;
        let half = k / 2;
        for i in 0..half {
            let (a, b) = (coefficients[i], coefficients[k - 1 - i]);
            coefficients[i] = a - r * b;
            coefficients[k - 1 - i] = b - r * a;
        }
        if k % 2 == 1 {
            coefficients[half] -= r * coefficients[half];
        }
        coefficients[k] = r;
    }
}

/// Coefficients of an invertible moving average from unconstrained numbers.
pub(super) fn invertible(unconstrained: &[f64], coefficients: &mut [f64]) {
    stationary(unconstrained, coefficients);
    coefficients.iter_mut().for_each(|c| *c = -*c);
}

/// Partial autocorrelations of an autoregression; `None` when it is not stationary.
pub(super) fn partial_autocorrelations(coefficients: &[f64]) -> Option<Vec<f64>> {
    let mut phi = coefficients.to_vec();
    let mut partial = vec![0.0; phi.len()];
    for k in (0..phi.len()).rev() {
        let r = phi[k];
        if !(r.abs() < 1.0) {
            return None;
        }
        partial[k] = r;
        let scale = 1.0 / (1.0 - r * r);
        let previous: Vec<f64> = (0..k).map(|i| (phi[i] + r * phi[k - 1 - i]) * scale).collect();
        phi[..k].copy_from_slice(&previous);
    }
    Some(partial)
}

/// Unconstrained numbers of coefficients, drawn inside the region when they lie outside or on its
/// border; a start value only needs to be near.
pub(super) fn unconstrained_near(coefficients: &[f64], moving_average: bool) -> Vec<f64> {
    let sign = if moving_average { -1.0 } else { 1.0 };
    let mut shrink = 1.0;
    loop {
        // Multiplying the i-th coefficient by s^i moves every root of the polynomial out by 1 / s.
        let mut power = 1.0;
        let moved: Vec<f64> = coefficients
            .iter()
            .map(|c| {
                power *= shrink;
                sign * c * power
            })
            .collect();
        if let Some(partial) = partial_autocorrelations(&moved)
            && partial.iter().all(|r| r.abs() < 0.98)
        {
            return partial.iter().map(|r| r.atanh()).collect();
        }
        shrink *= 0.9;
        if shrink < 1e-3 {
            return vec![0.0; coefficients.len()];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_numbers_give_a_stationary_polynomial_and_come_back() {
        let mut phi = [0.0; 4];
        let x = [0.3, -1.2, 0.7, 0.1];
        stationary(&x, &mut phi);
        let back = partial_autocorrelations(&phi).unwrap();
        for (x, r) in x.iter().zip(back) {
            assert!((x.tanh() * LARGEST - r).abs() < 1e-12);
        }
        // Independent judge: the impulse response of a stationary recursion dies out.
        let mut psi = vec![1.0];
        for t in 1..400 {
            psi.push((0..4.min(t)).map(|i| phi[i] * psi[t - 1 - i]).sum::<f64>());
        }
        assert!(psi[399].abs() < 1e-6);
    }

    #[test]
    fn second_order_matches_the_closed_form() {
        // phi_2 = r_2, phi_1 = r_1 (1 - r_2).
        let mut phi = [0.0; 2];
        stationary(&[0.5, -0.25], &mut phi);
        let (r1, r2) = (0.5f64.tanh() * LARGEST, (-0.25f64).tanh() * LARGEST);
        assert!((phi[1] - r2).abs() < 1e-15 && (phi[0] - r1 * (1.0 - r2)).abs() < 1e-15);
    }

    #[test]
    fn explosive_coefficients_are_not_stationary_but_have_a_start_nearby() {
        for outside in [&[1.2][..], &[-1.2], &[1.0], &[-1.0], &[f64::NAN], &[0.5, 0.6], &[0.1, f64::NAN]] {
            assert_eq!(partial_autocorrelations(outside), None, "{outside:?}");
        }
        assert!(unconstrained_near(&[1.2], false)[0] > 1.0);
        // A start stays away from the border, where the likelihood is flat; what no shrinking mends begins in the middle.
        for near in [[0.999, 0.0], [1.9, -0.95], [40.0, -900.0]] {
            let x = unconstrained_near(&near, false);
            assert!(x.iter().all(|x| x.tanh().abs() < 0.98), "{near:?}: {x:?}");
        }
        assert_eq!(unconstrained_near(&[f64::NAN, 0.3], false), [0.0, 0.0]);
        // Inside, the coefficients come back, each polynomial with its own sign.
        let (mut ar, mut ma) = ([0.0; 3], [0.0; 3]);
        stationary(&unconstrained_near(&[0.5, -0.3, 0.2], false), &mut ar);
        invertible(&unconstrained_near(&[0.4, 0.2, -0.1], true), &mut ma);
        for (found, expected) in ar.iter().zip([0.5, -0.3, 0.2]).chain(ma.iter().zip([0.4, 0.2, -0.1])) {
            assert!((found - expected).abs() < 1e-5, "{found} is not {expected}");
        }
    }

    #[test]
    fn no_number_reaches_the_border_and_every_order_comes_back() {
        for n in 1..8 {
            let x: Vec<f64> = (0..n).map(|i| 1.5 * (i as f64 * 2.1 + 0.4).sin()).collect();
            let mut phi = vec![0.0; n];
            stationary(&x, &mut phi);
            for (x, r) in x.iter().zip(partial_autocorrelations(&phi).unwrap()) {
                assert!((x.tanh() * LARGEST - r).abs() < 1e-11, "{n}");
            }
        }
        let mut phi = [0.0];
        stationary(&[1e9], &mut phi);
        assert!(phi[0] < 1.0 && phi[0] > 1.0 - 1.1e-6);
    }
}
