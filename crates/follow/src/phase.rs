//! Where in the learned action the worker is now: a Bayes filter over the phase of the motion model.
//!
//! The action of duration `T` is cut into bins of `bin_s`. Between two samples the belief moves forward by the time that
//! passed, spread by the worker's freedom to be a little faster or slower (a rate between `1 - rate_spread` and
//! `1 + rate_spread`), and a small share `restart` goes to every bin alike, so that a worker who stops and starts anew is
//! found again. A sample multiplies the belief by the Gaussian density of the observed posture under the model's mean
//! and covariance at each bin (prediction and update of the histogram filter, Thrun, Burgard and Fox 2005, §4.1).
//!
//! The filter also answers "none of it": when even the best bin is further than `match_sigma` standard deviations from the
//! sample, [`PhaseEstimate::matches`] is false and the caller must not lean on the model.
//!
//! Cost: `O(bins * D)` per sample (the covariances are factored once), no allocation after construction.

use core::time::Duration;

use nalgebra::{Cholesky, SMatrix, SVector};

use crate::error::Error;

/// Least spread of one step, in bins. A worker who is steadily slower than shown drifts by a quarter of a bin per frame; with
/// half of this the filter would lag behind by twice as much, with double it would take over twice the noise of the picture.
const LEAST_SPREAD_BINS: f64 = 0.6;

/// Settings of the phase filter.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhaseParams {
    /// Width of one phase bin, seconds. Half of it is the resolution of the estimate; 0.02 s is below one video frame.
    pub bin_s: f64,
    /// Relative spread of the worker's speed, a fraction of the demonstrated speed.
    pub rate_spread: f64,
    /// Share of the belief that is spread over all bins per second.
    pub restart_per_s: f64,
    /// Distance in standard deviations beyond which a sample is "not this action".
    pub match_sigma: f64,
}

impl Default for PhaseParams {
    fn default() -> Self {
        Self { bin_s: 0.02, rate_spread: 0.15, restart_per_s: 0.05, match_sigma: 6.0 }
    }
}

/// The filter's answer after one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhaseEstimate {
    /// Time within the action, seconds in `[0, T)`.
    pub phase_s: f64,
    /// Standard deviation of the phase, seconds.
    pub sigma_s: f64,
    /// Mahalanobis distance of the sample from the model at that phase.
    pub distance_sigma: f64,
    /// Whether the sample lies within `match_sigma` of the model.
    pub matches: bool,
}

/// Histogram filter over the phase of a `D`-dimensional motion.
#[derive(Debug, Clone)]
pub struct PhaseFilter<const D: usize> {
    params: PhaseParams,
    cyclic: bool,
    means: Vec<SVector<f64, D>>,
    covariances: Vec<SMatrix<f64, D, D>>,
    belief: Vec<f64>,
    moved: Vec<f64>,
    last: Option<Duration>,
    carry_s: f64,
}

impl<const D: usize> PhaseFilter<D> {
    /// Samples `model` (time in seconds to mean and covariance) over `[0, duration_s)`.
    ///
    /// # Errors
    /// [`Error::Parameter`] for settings out of range or a duration shorter than two bins.
    pub fn new(
        duration_s: f64,
        cyclic: bool,
        params: PhaseParams,
        mut model: impl FnMut(f64) -> (SVector<f64, D>, SMatrix<f64, D, D>),
    ) -> Result<Self, Error> {
        let positive = |name: &'static str, value: f64, limit: f64| {
            if value > 0.0 && value <= limit {
                Ok(())
            } else {
                Err(Error::Parameter { name, value, expected: format!("in (0, {limit}]") })
            }
        };
        positive("phase.bin_s", params.bin_s, 1.0)?;
        positive("phase.rate_spread", params.rate_spread, 1.0)?;
        positive("phase.restart_per_s", params.restart_per_s, 1.0)?;
        positive("phase.match_sigma", params.match_sigma, 1e3)?;
        if !(duration_s >= 2.0 * params.bin_s && duration_s.is_finite()) {
            let expected = format!("at least two bins of {} s", params.bin_s);
            return Err(Error::Parameter { name: "duration_s", value: duration_s, expected });
        }
        let bins = (duration_s / params.bin_s).round() as usize;
        let params = PhaseParams { bin_s: duration_s / bins as f64, ..params };
        let (means, covariances) = (0..bins).map(|i| model((i as f64 + 0.5) * params.bin_s)).unzip();
        let uniform = vec![1.0 / bins as f64; bins];
        Ok(Self {
            params,
            cyclic,
            means,
            covariances,
            moved: uniform.clone(),
            belief: uniform,
            last: None,
            carry_s: 0.0,
        })
    }

    /// Forgets where the worker was.
    pub fn reset(&mut self) {
        let share = 1.0 / self.belief.len() as f64;
        self.belief.fill(share);
        self.last = None;
        self.carry_s = 0.0;
    }

    /// Takes the posture `observed` (with covariance `noise`) seen at `captured` and says where in the action it is.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for NaN or infinite input, [`Error::TimeRunsBackwards`] for a sample older than the last one.
    pub fn update(
        &mut self,
        captured: Duration,
        observed: &SVector<f64, D>,
        noise: &SMatrix<f64, D, D>,
    ) -> Result<PhaseEstimate, Error> {
        if !observed.iter().chain(noise.iter()).all(|v| v.is_finite()) {
            return Err(Error::NotFinite { what: "observed posture" });
        }
        if let Some(last) = self.last {
            let elapsed = captured.checked_sub(last).ok_or(Error::TimeRunsBackwards { last, captured })?;
            self.advance(elapsed.as_secs_f64());
        }
        self.last = Some(captured);

        let mut best = f64::NEG_INFINITY;
        for (i, (mean, covariance)) in self.means.iter().zip(&self.covariances).enumerate() {
            let fit = Fit::new(observed - mean, covariance + noise)
                .ok_or(Error::NotPositiveDefinite { what: "model plus measurement covariance", index: i })?;
            self.moved[i] = fit.log_density;
            best = best.max(fit.log_density);
        }
        // Scaled by the best density, so that a far sample cannot underflow the whole belief.
        let mut total = 0.0;
        for (belief, log_density) in self.belief.iter_mut().zip(&self.moved) {
            *belief *= (log_density - best).exp();
            total += *belief;
        }
        if total > f64::MIN_POSITIVE {
            self.belief.iter_mut().for_each(|b| *b /= total);
        } else {
            let share = 1.0 / self.belief.len() as f64;
            self.belief.fill(share);
        }
        Ok(self.estimate(observed, noise))
    }

    /// Moves the belief forward by `elapsed_s` and spreads it.
    fn advance(&mut self, elapsed_s: f64) {
        let bins = self.belief.len();
        self.carry_s += elapsed_s;
        let steps = (self.carry_s / self.params.bin_s).floor();
        self.carry_s -= steps * self.params.bin_s;
        let steps = (steps as usize).min(10 * bins);
        let sigma_bins = (self.params.rate_spread * elapsed_s / self.params.bin_s).max(LEAST_SPREAD_BINS);
        let radius = ((3.0 * sigma_bins).ceil() as isize).min(bins as isize / 2).max(1);
        let kernel = |k: isize| (-0.5 * (k as f64 / sigma_bins).powi(2)).exp();
        let norm: f64 = (-radius..=radius).map(kernel).sum();
        self.moved.fill(0.0);
        for (i, &mass) in self.belief.iter().enumerate() {
            if mass <= 0.0 {
                continue;
            }
            for k in -radius..=radius {
                let to = i as isize + steps as isize + k;
                let to = if self.cyclic { to.rem_euclid(bins as isize) } else { to.clamp(0, bins as isize - 1) };
                self.moved[to as usize] += mass * kernel(k) / norm;
            }
        }
        let restart = (self.params.restart_per_s * elapsed_s).min(1.0);
        let floor = restart / bins as f64;
        for (belief, moved) in self.belief.iter_mut().zip(&self.moved) {
            *belief = (1.0 - restart) * moved + floor;
        }
    }

    /// Mean and spread of the belief around its highest bin (the circular neighbourhood, so that nothing breaks at T).
    fn estimate(&self, observed: &SVector<f64, D>, noise: &SMatrix<f64, D, D>) -> PhaseEstimate {
        let bins = self.belief.len();
        let peak = (0..bins).fold(0, |best, i| if self.belief[i] > self.belief[best] { i } else { best });
        let window = (0.25 / self.params.bin_s).ceil() as isize;
        let window = window.min((bins as isize - 1) / 2);
        let (mut mass, mut first, mut second) = (0.0, 0.0, 0.0);
        for k in -window..=window {
            let i = peak as isize + k;
            let i = if self.cyclic { i.rem_euclid(bins as isize) } else { i };
            if let Some(b) = usize::try_from(i).ok().and_then(|i| self.belief.get(i)) {
                mass += b;
                first += b * k as f64;
                second += b * (k * k) as f64;
            }
        }
        let shift = first / mass;
        let variance = (second / mass - shift * shift).max(0.0) + 1.0 / 12.0;
        let duration = bins as f64 * self.params.bin_s;
        let phase = (peak as f64 + 0.5 + shift) * self.params.bin_s + self.carry_s;
        let phase_s = if self.cyclic { phase.rem_euclid(duration) } else { phase.clamp(0.0, duration) };
        let nearest = ((phase_s / self.params.bin_s) as usize).min(bins - 1);
        let distance_sigma = Fit::new(observed - self.means[nearest], self.covariances[nearest] + noise)
            .map_or(f64::INFINITY, |fit| fit.distance);
        PhaseEstimate {
            phase_s,
            sigma_s: variance.sqrt() * self.params.bin_s,
            distance_sigma,
            matches: distance_sigma <= self.params.match_sigma,
        }
    }
}

/// How well a Gaussian explains a deviation.
struct Fit {
    log_density: f64,
    /// Mahalanobis distance.
    distance: f64,
}

impl Fit {
    fn new<const D: usize>(deviation: SVector<f64, D>, covariance: SMatrix<f64, D, D>) -> Option<Self> {
        let factor = Cholesky::new(covariance)?;
        let mut whitened = deviation;
        factor.l_dirty().solve_lower_triangular_mut(&mut whitened).then_some(())?;
        let squared = whitened.norm_squared();
        let log_det: f64 = factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
        Some(Self { log_density: -0.5 * squared - log_det, distance: squared.sqrt() })
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::TAU;

    use super::*;

    const T: f64 = 3.0;

    fn circle(t: f64) -> SVector<f64, 2> {
        let a = TAU * t / T;
        SVector::from([0.1 * a.cos(), 0.05 * (2.0 * a).sin()])
    }

    fn filter(cyclic: bool) -> PhaseFilter<2> {
        let spread = SMatrix::identity() * 1e-4;
        PhaseFilter::new(T, cyclic, PhaseParams::default(), |t| (circle(t), spread)).unwrap()
    }

    fn circular_gap(a: f64, b: f64) -> f64 {
        ((a - b + T / 2.0).rem_euclid(T) - T / 2.0).abs()
    }

    #[test]
    fn the_phase_of_a_repeated_motion_is_found_and_kept_across_the_seam() {
        let mut filter = filter(true);
        let noise = SMatrix::identity() * 4e-6;
        let offset = 1.234;
        for i in 0..300 {
            let t = f64::from(i) / 30.0;
            let seen = circle(t + offset);
            let estimate = filter.update(Duration::try_from_secs_f64(t).unwrap(), &seen, &noise).unwrap();
            assert!(estimate.matches);
            if i > 15 {
                let gap = circular_gap(estimate.phase_s, t + offset);
                assert!(gap < 0.05, "frame {i}: {gap}");
            }
        }
    }

    #[test]
    fn a_slower_worker_is_followed() {
        let mut filter = filter(true);
        let noise = SMatrix::identity() * 4e-6;
        for i in 0..300 {
            let t = f64::from(i) / 30.0;
            let estimate = filter.update(Duration::try_from_secs_f64(t).unwrap(), &circle(0.85 * t), &noise).unwrap();
            assert!(i < 20 || circular_gap(estimate.phase_s, 0.85 * t) < 0.08);
        }
    }

    #[test]
    fn a_strange_posture_is_not_matched() {
        let mut filter = filter(true);
        let noise = SMatrix::identity() * 4e-6;
        let estimate = filter.update(Duration::ZERO, &SVector::from([0.5, 0.5]), &noise).unwrap();
        assert!(!estimate.matches && estimate.distance_sigma > 30.0);
    }

    #[test]
    fn nan_and_time_running_backwards_are_refused() {
        let mut filter = filter(false);
        let noise = SMatrix::identity() * 4e-6;
        let nan = SVector::from([f64::NAN, 0.0]);
        assert!(matches!(filter.update(Duration::ZERO, &nan, &noise), Err(Error::NotFinite { .. })));
        filter.update(Duration::from_secs(2), &circle(0.0), &noise).unwrap();
        let late = filter.update(Duration::from_secs(1), &circle(0.0), &noise);
        assert!(matches!(late, Err(Error::TimeRunsBackwards { .. })));
    }

    #[test]
    fn settings_out_of_range_name_the_field() {
        let params = PhaseParams { bin_s: f64::NAN, ..PhaseParams::default() };
        let err = PhaseFilter::<2>::new(T, true, params, |t| (circle(t), SMatrix::identity())).unwrap_err();
        assert!(err.to_string().contains("phase.bin_s"), "{err}");
    }
}
