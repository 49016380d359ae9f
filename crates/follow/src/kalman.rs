//! Constant-velocity Kalman predictor: the paper's baseline, and what carries a target over the latency where the motion
//! model does not apply.
//!
//! Each coordinate is filtered on its own, with state (value, rate) and white acceleration of spectral density `q`:
//! F = [1 dt; 0 1], Q = q [dt^3/3 dt^2/2; dt^2/2 dt] (Bar-Shalom, Li and Kirubarajan 2001, §6.2.2).

use core::time::Duration;

use nalgebra::SVector;

use crate::error::Error;

/// Value, rate and their covariance for one coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Channel {
    value: f64,
    rate: f64,
    /// Variance of the value, covariance, variance of the rate.
    covariance: [f64; 3],
}

impl Channel {
    fn predicted(self, dt: f64, q: f64) -> Self {
        let [a, b, c] = self.covariance;
        Self {
            value: self.value + dt * self.rate,
            rate: self.rate,
            covariance: [
                a + 2.0 * dt * b + dt * dt * c + q * dt.powi(3) / 3.0,
                b + dt * c + q * dt * dt / 2.0,
                c + q * dt,
            ],
        }
    }

    fn corrected(self, measured: f64, variance: f64) -> Self {
        let [a, b, c] = self.covariance;
        let (gain_value, gain_rate) = (a / (a + variance), b / (a + variance));
        let innovation = measured - self.value;
        Self {
            value: self.value + gain_value * innovation,
            rate: self.rate + gain_rate * innovation,
            covariance: [(1.0 - gain_value) * a, (1.0 - gain_value) * b, c - gain_rate * b],
        }
    }
}

/// A bank of `D` constant-velocity filters.
///
/// ```
/// use core::time::Duration;
/// use nalgebra::SVector;
/// let mut filter = follow::ConstantVelocity::<1>::new(1.0)?;
/// for i in 0..100u32 {
///     let seen = SVector::from([0.5 * f64::from(i) * 0.02]);
///     filter.update(Duration::from_millis(20) * i, &seen, &SVector::from([1e-6]))?;
/// }
/// let (ahead, rate) = filter.at(Duration::from_millis(1980 + 100)).unwrap();
/// assert!((ahead[0] - 0.5 * 2.08).abs() < 1e-3 && (rate[0] - 0.5).abs() < 1e-3);
/// # Ok::<(), follow::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct ConstantVelocity<const D: usize> {
    acceleration_density: f64,
    state: Option<(Duration, [Channel; D])>,
}

impl<const D: usize> ConstantVelocity<D> {
    /// `acceleration_density`: spectral density of the acceleration, unit^2/s^3. A hand that reaches 3 m/s^2 within a
    /// tenth of a second has about 1 m^2/s^3.
    ///
    /// # Errors
    /// [`Error::Parameter`] unless it is positive and finite.
    pub fn new(acceleration_density: f64) -> Result<Self, Error> {
        if !(acceleration_density > 0.0 && acceleration_density.is_finite()) {
            let expected = "positive and finite".to_owned();
            return Err(Error::Parameter { name: "acceleration_density", value: acceleration_density, expected });
        }
        Ok(Self { acceleration_density, state: None })
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.state = None;
    }

    /// Takes a measurement with its variance per coordinate.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for NaN, infinity or a variance that is not positive, [`Error::TimeRunsBackwards`].
    pub fn update(
        &mut self,
        captured: Duration,
        measured: &SVector<f64, D>,
        variance: &SVector<f64, D>,
    ) -> Result<(), Error> {
        if !(measured.iter().all(|v| v.is_finite()) && variance.iter().all(|v| *v > 0.0 && v.is_finite())) {
            return Err(Error::NotFinite { what: "measurement or its variance" });
        }
        let channels = match &self.state {
            None => core::array::from_fn(|d| Channel {
                value: measured[d],
                rate: 0.0,
                // A hand moves at up to about 1 m/s (or 1 rad/s): the first rate is unknown to that extent.
                covariance: [variance[d], 0.0, 1.0],
            }),
            Some((last, channels)) => {
                let elapsed = captured.checked_sub(*last).ok_or(Error::TimeRunsBackwards { last: *last, captured })?;
                let dt = elapsed.as_secs_f64();
                core::array::from_fn(|d| {
                    channels[d].predicted(dt, self.acceleration_density).corrected(measured[d], variance[d])
                })
            }
        };
        self.state = Some((captured, channels));
        Ok(())
    }

    /// Value and rate predicted for `time`; `None` before the first measurement.
    pub fn at(&self, time: Duration) -> Option<(SVector<f64, D>, SVector<f64, D>)> {
        let (last, channels) = self.state.as_ref()?;
        let dt = time.as_secs_f64() - last.as_secs_f64();
        let value = SVector::from_fn(|d, _| channels[d].value + dt * channels[d].rate);
        Some((value, SVector::from_fn(|d, _| channels[d].rate)))
    }

    /// Variances of the values predicted for `time`.
    pub fn variance_at(&self, time: Duration) -> Option<SVector<f64, D>> {
        let (last, channels) = self.state.as_ref()?;
        let dt = (time.as_secs_f64() - last.as_secs_f64()).max(0.0);
        Some(SVector::from_fn(|d, _| channels[d].predicted(dt, self.acceleration_density).covariance[0]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two equal steps without a measurement are one step of twice the length: the process noise composes.
    #[test]
    fn prediction_composes() {
        let start = Channel { value: 1.0, rate: -0.3, covariance: [0.2, 0.05, 0.7] };
        let once = start.predicted(0.2, 0.9);
        let twice = start.predicted(0.1, 0.9).predicted(0.1, 0.9);
        for (a, b) in once.covariance.iter().zip(twice.covariance) {
            assert!((a - b).abs() < 1e-14);
        }
        assert!((once.value - twice.value).abs() < 1e-15);
    }

    /// With no process noise and a flat start the filter is the straight-line least-squares fit.
    #[test]
    fn it_is_the_least_squares_line_when_nothing_disturbs() {
        let seen = [0.1, 0.35, 0.3, 0.62, 0.7];
        let mut filter = ConstantVelocity::<1>::new(1e-12).unwrap();
        filter.state = Some((Duration::ZERO, [Channel { value: 0.0, rate: 0.0, covariance: [1e9, 0.0, 1e9] }]));
        for (i, y) in seen.iter().enumerate() {
            let t = Duration::from_millis(100 * i as u64);
            filter.update(t, &SVector::from([*y]), &SVector::from([0.01])).unwrap();
        }
        let n = seen.len() as f64;
        let t_mean = 0.2;
        let y_mean = seen.iter().sum::<f64>() / n;
        let slope = seen.iter().enumerate().map(|(i, y)| (0.1 * i as f64 - t_mean) * (y - y_mean)).sum::<f64>()
            / seen.iter().enumerate().map(|(i, _)| (0.1 * i as f64 - t_mean).powi(2)).sum::<f64>();
        let (value, rate) = filter.at(Duration::from_millis(400)).unwrap();
        assert!((rate[0] - slope).abs() < 1e-6);
        assert!((value[0] - (y_mean + slope * 0.2)).abs() < 1e-6);
    }

    #[test]
    fn nan_never_enters() {
        let mut filter = ConstantVelocity::<2>::new(1.0).unwrap();
        let ones = SVector::from([1.0, 1.0]);
        assert!(filter.update(Duration::ZERO, &SVector::from([f64::NAN, 0.0]), &ones).is_err());
        assert!(filter.update(Duration::ZERO, &ones, &SVector::from([0.0, 1.0])).is_err());
        assert!(filter.at(Duration::ZERO).is_none());
    }
}
