//! A Kalman filter of position and speed, driven by white acceleration (Bar-Shalom, Li, Kirubarajan 2001, 6.3.2).
//!
//! ```text
//! x <- F x,          F = [1 dt; 0 1]
//! P <- F P F' + q,   q = a^2 [dt^4/4 dt^3/2; dt^3/2 dt^2],   a the standard deviation of the acceleration
//! ```
//!
//! Acceleration is constant within one step of `dt` and independent between steps.

/// Position and speed of one coordinate with their covariance.
///
/// ```
/// use pose::Kalman;
/// let mut k = Kalman::new(10.0, 1.0, 5.0);
/// k.predict(0.1, 20.0);
/// let gain = k.variance() / (k.variance() + 1.0);
/// k.update(12.0, 1.0);
/// assert!((k.position() - (10.0 + 2.0 * gain)).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kalman {
    position: f64,
    speed: f64,
    p_xx: f64,
    p_xv: f64,
    p_vv: f64,
}

impl Kalman {
    /// At a first measurement, with unknown speed.
    pub fn new(position: f64, sigma: f64, speed_sigma: f64) -> Self {
        Self { position, speed: 0.0, p_xx: sigma * sigma, p_xv: 0.0, p_vv: speed_sigma * speed_sigma }
    }

    /// Position.
    pub fn position(&self) -> f64 {
        self.position
    }

    /// Speed, per second.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Variance of the position.
    pub fn variance(&self) -> f64 {
        self.p_xx
    }

    /// Moves on by `dt_s`.
    pub fn predict(&mut self, dt_s: f64, acceleration_sigma: f64) {
        let q = acceleration_sigma * acceleration_sigma;
        let (dt2, dt3) = (dt_s * dt_s, dt_s * dt_s * dt_s);
        self.position += dt_s * self.speed;
        self.p_xx += 2.0 * dt_s * self.p_xv + dt2 * self.p_vv + q * dt2 * dt2 / 4.0;
        self.p_xv += dt_s * self.p_vv + q * dt3 / 2.0;
        self.p_vv += q * dt2;
    }

    /// Takes a measurement of the position.
    pub fn update(&mut self, measured: f64, sigma: f64) {
        let s = self.p_xx + sigma * sigma;
        let (gain_x, gain_v) = (self.p_xx / s, self.p_xv / s);
        let innovation = measured - self.position;
        self.position += gain_x * innovation;
        self.speed += gain_v * innovation;
        // (1 - K H) P written out; p_xx stays positive because gain_x is below one.
        self.p_vv -= gain_v * self.p_xv;
        self.p_xv *= 1.0 - gain_x;
        self.p_xx *= 1.0 - gain_x;
    }

    /// Reduces the speed to this share of itself, for coasting without measurements.
    pub fn damp(&mut self, share: f64) {
        self.speed *= share;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Judge: the batch least-squares line through the same points, which is what the filter is without process noise.
        #[test]
        fn without_process_noise_it_is_the_least_squares_line(
            xs in proptest::collection::vec(-50.0..50.0_f64, 3..40), dt in 0.01..0.2_f64,
        ) {
            let mut k = Kalman::new(xs[0], 1.0, 1e5);
            for x in &xs[1..] {
                k.predict(dt, 0.0);
                k.update(*x, 1.0);
            }
            let n = xs.len() as f64;
            let t: Vec<f64> = (0..xs.len()).map(|i| i as f64 * dt).collect();
            let (mt, mx) = (t.iter().sum::<f64>() / n, xs.iter().sum::<f64>() / n);
            let slope = t.iter().zip(&xs).map(|(t, x)| (t - mt) * (x - mx)).sum::<f64>()
                / t.iter().map(|t| (t - mt).powi(2)).sum::<f64>();
            let end = mx + slope * (t[t.len() - 1] - mt);
            // The prior on the speed is worth 1e-10 of a measurement; slopes reach 100 / dt.
            prop_assert!((k.speed() - slope).abs() < 1e-3 * (1.0 + slope.abs()), "{} {slope}", k.speed());
            prop_assert!((k.position() - end).abs() < 1e-3 * (1.0 + slope.abs() * dt), "{} {end}", k.position());
        }
    }

    #[test]
    fn a_ramp_is_followed_without_lag_and_variance_stays_positive() {
        let mut k = Kalman::new(0.0, 2.0, 500.0);
        for i in 1..600 {
            k.predict(1.0 / 30.0, 3000.0);
            assert!(k.variance() > 0.0);
            k.update(f64::from(i) * 10.0, 2.0);
            assert!(k.variance() > 0.0);
        }
        assert!((k.position() - 5990.0).abs() < 1e-6, "{}", k.position());
        assert!((k.speed() - 300.0).abs() < 1e-6);
    }

    /// Closed form of one step: 1 + 0.5^2 2^2 + 8^2 0.5^4 / 4 = 3.
    #[test]
    fn one_step_spreads_the_position_as_the_equations_say() {
        let mut k = Kalman::new(0.0, 1.0, 2.0);
        k.predict(0.5, 8.0);
        assert!((k.variance() - 3.0).abs() < 1e-12);
        k.update(2.0, 1.0);
        let before = k.speed();
        assert!(before > 0.0);
        k.damp(0.25);
        assert!((k.speed() - 0.25 * before).abs() < 1e-12);
    }
}
