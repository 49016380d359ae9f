use proptest::prelude::*;

use super::{hash_unit, noise, pulse, soft_limit, step};

/// Largest difference quotient of order `k` that a smooth function may show beside `at`, by central differences.
fn derivative(f: &dyn Fn(f64) -> f64, at: f64, order: u32, h: f64) -> f64 {
    if order == 0 {
        return f(at);
    }
    let g = |x: f64| derivative(f, x, order - 1, h);
    (g(at + h) - g(at - h)) / (2.0 * h)
}

#[test]
fn steps_and_pulses_leave_and_arrive_with_three_vanishing_derivatives() {
    let h = 1e-3_f64;
    for order in 1..=3 {
        for at in [0.2, 0.7] {
            // The fourth derivative of the step is about 840 / 0.5^4; central differences reach 3 h beyond the end.
            let bound = 840.0 / 0.5_f64.powi(4) * (3.0 * h).powi(4 - i32::try_from(order).unwrap());
            assert!(derivative(&|x| step(0.2, 0.7, x), at, order, h).abs() < bound);
            assert!(derivative(&|x| pulse(0.2, 0.7, x), at, order, h).abs() < 8.0 * bound);
        }
    }
    assert!((step(0.2, 0.7, 0.45) - 0.5).abs() < 1e-12);
    assert!((pulse(0.2, 0.7, 0.45) - 1.0).abs() < 1e-12);
}

#[test]
fn noise_is_the_quintic_spline_of_the_lattice() {
    // Cox and de Boor's recursion over uniform knots, written without the closed form.
    fn basis(degree: i32, x: f64) -> f64 {
        if degree == 0 {
            return if (0.0..1.0).contains(&x) { 1.0 } else { 0.0 };
        }
        let d = f64::from(degree);
        (x * basis(degree - 1, x) + (d + 1.0 - x) * basis(degree - 1, x - 1.0)) / d
    }
    for x in [-3.3, 0.0, 0.1, 0.5, 0.999, 7.25] {
        let spline: f64 = (-12..=12).map(|k| hash_unit(5, 2, k) * basis(5, x - k as f64 + 3.0)).sum();
        assert!((noise(5, 2, x) - spline).abs() < 1e-12, "at {x}");
    }
}

proptest! {
    #[test]
    fn noise_stays_within_one(seed: u64, stream in 0_u64..20, x in -1e4..1e4_f64) {
        prop_assert!(noise(seed, stream, x).abs() <= 1.0);
    }

    #[test]
    fn soft_limit_never_passes_its_limit_and_never_falls(x in 0.0..3.0_f64, dx in 0.0..0.5_f64) {
        let y = soft_limit(x, 0.9, 1.0);
        prop_assert!(y <= 1.0 && y <= x);
        prop_assert!(soft_limit(x + dx, 0.9, 1.0) >= y);
    }
}
