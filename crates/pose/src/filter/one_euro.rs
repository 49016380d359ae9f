//! The 1 euro filter (Casiez, Roussel, Vogel, CHI 2012): an exponential low-pass whose cut-off rises with speed.
//!
//! ```text
//! alpha(f) = 1 / (1 + 1 / (2 pi f dt))
//! speed <- low-pass of (x - x_before) / dt with f_speed
//! y <- y + alpha(f_min + beta |speed|) (x - y)
//! ```

use std::f64::consts::TAU;

use crate::{Error, Result};

/// Parameters of [`OneEuro`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OneEuroParams {
    /// Cut-off at rest, Hz: lower is calmer.
    pub min_cutoff_hz: f64,
    /// Rise of the cut-off with speed, Hz per (unit/s): higher lags less.
    pub beta: f64,
    /// Cut-off of the speed estimate, Hz.
    pub speed_cutoff_hz: f64,
}

impl Default for OneEuroParams {
    /// For pixels: 1.7 Hz at rest, which halves the jitter of a 30 Hz detector, and 24 Hz at 300 px/s.
    fn default() -> Self {
        Self { min_cutoff_hz: 1.7, beta: 0.075, speed_cutoff_hz: 4.0 }
    }
}

/// A 1 euro filter of one coordinate.
///
/// ```
/// use pose::{OneEuro, OneEuroParams};
/// let mut filter = OneEuro::new(OneEuroParams { min_cutoff_hz: 1.0, beta: 0.0, speed_cutoff_hz: 1.0 }).unwrap();
/// assert_eq!(filter.update(0.1, 2.0), 2.0);
/// // alpha = 1 / (1 + 1 / (2 pi 0.1)) = 0.3859
/// assert!((filter.update(0.1, 3.0) - 2.3859).abs() < 1e-4);
/// ```
#[derive(Debug, Clone)]
pub struct OneEuro {
    params: OneEuroParams,
    state: Option<State>,
}

#[derive(Debug, Clone, Copy)]
struct State {
    raw: f64,
    value: f64,
    speed: f64,
}

impl OneEuro {
    /// A filter without a past.
    ///
    /// # Errors
    /// [`Error::Parameter`] when a cut-off is not positive or `beta` is negative.
    pub fn new(params: OneEuroParams) -> Result<Self> {
        let bad = |field, expected, got: f64| Err(Error::Parameter { field, expected, got: got.to_string() });
        for (field, f) in [("min_cutoff_hz", params.min_cutoff_hz), ("speed_cutoff_hz", params.speed_cutoff_hz)] {
            if !(f > 0.0 && f.is_finite()) {
                return bad(field, "above 0 Hz", f);
            }
        }
        if !(params.beta >= 0.0 && params.beta.is_finite()) {
            return bad("beta", "0 or more", params.beta);
        }
        Ok(Self { params, state: None })
    }

    /// Takes a sample `dt_s` after the one before; the first passes unchanged.
    pub fn update(&mut self, dt_s: f64, x: f64) -> f64 {
        let alpha = |f_hz: f64| 1.0 / (1.0 + 1.0 / (TAU * f_hz * dt_s));
        let state = match self.state {
            None => State { raw: x, value: x, speed: 0.0 },
            Some(s) => {
                let speed = s.speed + alpha(self.params.speed_cutoff_hz) * ((x - s.raw) / dt_s - s.speed);
                let cutoff = self.params.min_cutoff_hz + self.params.beta * speed.abs();
                State { raw: x, value: s.value + alpha(cutoff) * (x - s.value), speed }
            }
        };
        self.state = Some(state);
        state.value
    }

    /// Lag on a ramp of this speed, s, once the speed estimate has settled: the time by which the answer trails.
    ///
    /// For an exponential filter that is `dt (1 - alpha) / alpha = 1 / (2 pi f_c)` at any sampling rate.
    pub fn lag_s(&self, speed: f64) -> f64 {
        1.0 / (TAU * (self.params.min_cutoff_hz + self.params.beta * speed.abs()))
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        self.state = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Judge: the ramp itself. After settling the answer trails by exactly the stated lag.
        #[test]
        fn the_stated_lag_is_the_measured_one(
            speed in -500.0..500.0_f64, rate_hz in 10.0..240.0_f64, min_cutoff_hz in 0.5..5.0_f64, beta in 0.0..0.1_f64,
        ) {
            let mut filter = OneEuro::new(OneEuroParams { min_cutoff_hz, beta, speed_cutoff_hz: 4.0 }).unwrap();
            let dt = 1.0 / rate_hz;
            let mut out = 0.0;
            let n = (20.0 * rate_hz) as i32;
            for i in 0..=n {
                out = filter.update(dt, speed * f64::from(i) * dt);
            }
            let trail = speed * f64::from(n) * dt - out;
            prop_assert!((trail - speed * filter.lag_s(speed)).abs() < 1e-6 * (1.0 + speed.abs()));
        }
    }

    #[test]
    fn nan_parameters_are_refused() {
        let p = OneEuroParams::default();
        assert!(OneEuro::new(OneEuroParams { beta: f64::NAN, ..p }).is_err());
        assert!(OneEuro::new(OneEuroParams { min_cutoff_hz: 0.0, ..p }).is_err());
        assert!(OneEuro::new(OneEuroParams { speed_cutoff_hz: -1.0, ..p }).is_err());
    }

    /// Closed form of two steps, from the equations of the paper.
    #[test]
    fn the_cutoff_follows_the_low_passed_speed_and_a_reset_forgets_it() {
        let mut filter = OneEuro::new(OneEuroParams { min_cutoff_hz: 1.0, beta: 0.5, speed_cutoff_hz: 1.0 }).unwrap();
        let alpha = |f_hz: f64| 1.0 / (1.0 + 1.0 / (TAU * f_hz * 0.1));
        filter.update(0.1, 0.0);
        let speed = alpha(1.0) * 10.0;
        let expected = alpha(1.0 + 0.5 * speed);
        assert!((filter.update(0.1, 1.0) - expected).abs() < 1e-12);
        filter.reset();
        assert!((filter.update(0.1, 7.0) - 7.0).abs() < 1e-12);
    }
}
