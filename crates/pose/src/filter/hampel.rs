//! The Hampel filter: a sample that lies further than `k` scaled median absolute deviations from the median of its window
//! is replaced by that median (Hampel 1974; Pearson 2002 for the form with a moving window).

use std::collections::VecDeque;

use crate::{Error, Result};

/// Median absolute deviation to standard deviation for Gaussian noise, `1 / Phi^-1(3/4)`.
const MAD_TO_SIGMA: f64 = 1.482_602_218_505_602;

/// A Hampel filter of one coordinate with a fixed lag.
///
/// With lag 0 a sample is judged by the past alone; with lag n by as many later samples, at the price of n samples.
///
/// ```
/// use pose::Hampel;
/// let mut filter = Hampel::new(5, 0, 3.0, 0.1).unwrap();
/// let out: Vec<f64> = [1.0, 1.1, 0.9, 1.0, 50.0, 1.1].map(|x| filter.update(x).0).into();
/// assert_eq!(out[4], 1.0);
/// assert_eq!(out[5], 1.1);
/// ```
#[derive(Debug, Clone)]
pub struct Hampel {
    window: VecDeque<f64>,
    length: usize,
    lag: usize,
    threshold_sigma: f64,
    floor: f64,
    sorted: Vec<f64>,
}

impl Hampel {
    /// A window of `length` samples, an answer `lag` samples behind, an outlier above `threshold_sigma` deviations, and
    /// never an outlier within `floor` (unit of the coordinate) of the median: a still point has no deviation at all.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the window is below 3, the lag leaves it, or a threshold is not positive.
    pub fn new(length: usize, lag: usize, threshold_sigma: f64, floor: f64) -> Result<Self> {
        if length < 3 {
            return Err(Error::Parameter { field: "length", expected: "at least 3", got: length.to_string() });
        }
        if lag >= length {
            return Err(Error::Parameter { field: "lag", expected: "below the window length", got: lag.to_string() });
        }
        for (field, x) in [("threshold_sigma", threshold_sigma), ("floor", floor)] {
            if !(x > 0.0 && x.is_finite()) {
                return Err(Error::Parameter { field, expected: "above 0", got: x.to_string() });
            }
        }
        let sorted = Vec::with_capacity(length);
        Ok(Self { window: VecDeque::with_capacity(length), length, lag, threshold_sigma, floor, sorted })
    }

    /// Takes a sample; answers the one `lag` samples back (fewer in the beginning), and whether it was replaced. NaN is an
    /// outlier.
    pub fn update(&mut self, x: f64) -> (f64, bool) {
        if self.window.len() == self.length {
            self.window.pop_front();
        }
        self.window.push_back(x);
        let subject = self.window[self.window.len() - 1 - self.lag.min(self.window.len() - 1)];
        if self.window.len() < 3 {
            return (subject, false);
        }
        let middle = self.median(|v| v);
        let sigma = MAD_TO_SIGMA * self.median(|v| (v - middle).abs());
        let is_near = (subject - middle).abs() <= (self.threshold_sigma * sigma).max(self.floor);
        if is_near { (subject, false) } else { (middle, true) }
    }

    /// Lag at a sampling rate, s.
    pub fn lag_s(&self, rate_hz: f64) -> f64 {
        self.lag as f64 / rate_hz
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        self.window.clear();
    }

    fn median(&mut self, f: impl Fn(f64) -> f64) -> f64 {
        self.sorted.clear();
        self.sorted.extend(self.window.iter().map(|v| f(*v)));
        self.sorted.sort_by(f64::total_cmp);
        let n = self.sorted.len();
        if n % 2 == 1 { self.sorted[n / 2] } else { f64::midpoint(self.sorted[n / 2 - 1], self.sorted[n / 2]) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Judge: the sequence without its outliers.
        #[test]
        fn lone_outliers_of_a_slow_signal_are_replaced(at in 6..30_usize, size in 20.0..1e6_f64, lag in 0..3_usize) {
            let mut filter = Hampel::new(7, lag, 3.0, 2.0).unwrap();
            for i in 0..40 {
                let clean = (i as f64 * 0.2).sin();
                let (out, replaced) = filter.update(if i == at { size } else { clean });
                prop_assert!(out.abs() < 2.0);
                prop_assert_eq!(replaced, i == at + lag);
            }
        }
    }

    #[test]
    fn the_answer_comes_after_the_stated_lag() {
        let mut filter = Hampel::new(5, 2, 3.0, 100.0).unwrap();
        let out: Vec<f64> = (0..6).map(|i| filter.update(f64::from(i)).0).collect();
        assert_eq!(out, [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]);
        assert!((filter.lag_s(30.0) - 2.0 / 30.0).abs() < 1e-15);
        assert!(Hampel::new(2, 0, 3.0, 1.0).is_err() && Hampel::new(5, 5, 3.0, 1.0).is_err());
        assert!(Hampel::new(5, 0, f64::NAN, 1.0).is_err());
    }

    /// Closed form: the window -1, 1, -1, 1, x has the median 1 and the deviation 2, so that 3 * 1.4826 * 2 = 8.896 is the limit.
    #[test]
    fn the_limit_is_in_standard_deviations_and_the_window_has_its_length() {
        for (x, replaced) in [(9.8, false), (9.95, true), (-7.8, false)] {
            let mut filter = Hampel::new(5, 0, 3.0, 0.1).unwrap();
            for before in [-1.0, 1.0, -1.0, 1.0] {
                filter.update(before);
            }
            assert_eq!(filter.update(x).1, replaced, "{x}");
        }
        // What is no number is an outlier too.
        let mut filter = Hampel::new(5, 0, 3.0, 0.1).unwrap();
        let out = [1.0, 1.1, 0.9, f64::NAN, 1.0].map(|x| filter.update(x));
        assert_eq!(out[3..], [(1.05, true), (1.0, false)]);
        // A step is believed when it fills most of the window; after a reset at once.
        let mut filter = Hampel::new(3, 0, 3.0, 0.1).unwrap();
        for _ in 0..10 {
            filter.update(0.0);
        }
        assert_eq!([100.0, 100.0].map(|x| filter.update(x)), [(0.0, true), (100.0, false)]);
        filter.reset();
        assert_eq!(filter.update(-5.0), (-5.0, false));
    }
}
