//! From a network's score to a probability (Platt 1999), and how far off it is.
//!
//! ```text
//! p = 1 / (1 + exp(-(intercept + slope * score)))
//! ```
//!
//! A score says how peaked a map is; how often a keypoint of this score is right must be measured. The fit maximises the
//! likelihood of "right" and "wrong" by Newton's method, with Platt's targets `(n+ + 1)/(n+ + 2)` and `1/(n- + 2)` in the
//! place of 1 and 0, which keep the fit finite when the score separates both perfectly.

use crate::{Error, Result};

/// A logistic map from score to probability.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Log-odds at score 0.
    pub intercept: f64,
    /// Log-odds per unit of score.
    pub slope: f64,
}

impl Calibration {
    /// Probability that a keypoint of this score is where it should be.
    ///
    /// ```
    /// let c = pose::Calibration { intercept: -2.0, slope: 4.0 };
    /// assert_eq!(c.probability(0.5), 0.5);
    /// ```
    pub fn probability(&self, score: f64) -> f64 {
        1.0 / (1.0 + (-(self.intercept + self.slope * score)).exp())
    }

    /// Fits to scores of keypoints that were right or wrong.
    ///
    /// # Errors
    /// [`Error::Length`] when the lengths differ, [`Error::Parameter`] with fewer than two samples or a score that is
    /// not finite.
    pub fn fit(scores: &[f64], right: &[bool]) -> Result<Self> {
        if scores.len() != right.len() {
            return Err(Error::Length { what: "right", expected: scores.len(), got: right.len() });
        }
        if scores.len() < 2 || scores.iter().any(|s| !s.is_finite()) {
            let got = format!("{} samples", scores.len());
            return Err(Error::Parameter { field: "scores", expected: "at least two, all finite", got });
        }
        let positive = right.iter().filter(|r| **r).count() as f64;
        let negative = right.len() as f64 - positive;
        let target = |r: bool| if r { (positive + 1.0) / (positive + 2.0) } else { 1.0 / (negative + 2.0) };
        let mut c = Self { intercept: ((positive + 1.0) / (negative + 1.0)).ln(), slope: 0.0 };
        for _ in 0..NEWTON_STEPS {
            let (mut g0, mut g1, mut h00, mut h01, mut h11) = (0.0, 0.0, RIDGE, 0.0, RIDGE);
            for (s, r) in scores.iter().zip(right) {
                let p = c.probability(*s);
                let (d, w) = (target(*r) - p, p * (1.0 - p));
                g0 += d;
                g1 += d * s;
                h00 += w;
                h01 += w * s;
                h11 += w * s * s;
            }
            let det = h00 * h11 - h01 * h01;
            let step = ((h11 * g0 - h01 * g1) / det, (h00 * g1 - h01 * g0) / det);
            let shrink = (MAX_STEP / step.0.abs().max(step.1.abs())).min(1.0);
            c.intercept += shrink * step.0;
            c.slope += shrink * step.1;
            if step.0.abs().max(step.1.abs()) < 1e-10 {
                break;
            }
        }
        Ok(c)
    }
}

/// Newton's method doubles its digits; ten steps suffice, the rest is for shortened steps.
const NEWTON_STEPS: usize = 100;
/// Keeps the Hessian invertible when all scores are equal; below any information that a sample brings.
const RIDGE: f64 = 1e-9;
/// Longest step in log-odds, so that a flat start does not throw the slope to infinity.
const MAX_STEP: f64 = 4.0;

/// One bin of a reliability diagram.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct ReliabilityBin {
    /// Mean of the probabilities in the bin.
    pub said: f64,
    /// Share that was right.
    pub happened: f64,
    /// Samples.
    pub count: usize,
}

/// Reliability diagram with `bins` bins of equal width, empty ones left out, and the expected calibration error: the mean
/// of `|said - happened|` over samples.
pub fn reliability(probabilities: &[f64], right: &[bool], bins: usize) -> (Vec<ReliabilityBin>, f64) {
    let mut sums = vec![(0.0, 0_usize, 0_usize); bins.max(1)];
    for (p, r) in probabilities.iter().zip(right) {
        let last = sums.len() - 1;
        let bin = &mut sums[((p * bins as f64) as usize).min(last)];
        bin.0 += p;
        bin.1 += usize::from(*r);
        bin.2 += 1;
    }
    let total: usize = sums.iter().map(|s| s.2).sum();
    let diagram: Vec<_> = sums
        .iter()
        .filter(|s| s.2 > 0)
        .map(|(p, r, n)| ReliabilityBin { said: p / *n as f64, happened: *r as f64 / *n as f64, count: *n })
        .collect();
    let error = diagram.iter().map(|b| (b.said - b.happened).abs() * b.count as f64).sum::<f64>() / total.max(1) as f64;
    (diagram, error)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Judge: the logistic law that drew the samples.
    #[test]
    fn the_fit_recovers_the_law_that_made_the_samples() {
        let truth = Calibration { intercept: -1.5, slope: 5.0 };
        let (mut scores, mut right, mut state) = (Vec::new(), Vec::new(), 1_u64);
        for _ in 0..200_000 {
            let mut uniform = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1_u64 << 53) as f64
            };
            let s = uniform();
            right.push(uniform() < truth.probability(s));
            scores.push(s);
        }
        let c = Calibration::fit(&scores, &right).unwrap();
        // Standard errors of both at n = 2e5 are about 0.011 and 0.025; four of them.
        assert!((c.intercept - truth.intercept).abs() < 0.05 && (c.slope - truth.slope).abs() < 0.1, "{c:?}");
        let p: Vec<f64> = scores.iter().map(|s| c.probability(*s)).collect();
        assert!(reliability(&p, &right, 10).1 < 0.005);
        assert!(reliability(&scores, &right, 10).1 > 0.05);
        let (bins, error) = reliability(&[1.0, 0.0], &[true, false], 10);
        assert!(bins.len() == 2 && error.abs() < 1e-12);
    }

    #[test]
    fn separable_and_constant_scores_stay_finite() {
        let c = Calibration::fit(&[0.1, 0.2, 0.8, 0.9], &[false, false, true, true]).unwrap();
        assert!(c.slope.is_finite() && c.slope > 0.0 && c.probability(0.9) < 1.0);
        let c = Calibration::fit(&[0.5; 4], &[true, true, true, false]).unwrap();
        // Nothing but the mean of Platt's targets explains equal scores: three of 4/5 and one of 1/3.
        assert!((c.probability(0.5) - 41.0 / 60.0).abs() < 1e-6, "{c:?}");
        // Two scores are explained exactly: fifty of 1/52 and one of 2/3. Whole Newton steps would leave for infinity.
        let (mut scores, mut right) = (vec![0.0; 50], vec![false; 50]);
        scores.push(1.0);
        right.push(true);
        let c = Calibration::fit(&scores, &right).unwrap();
        assert!(
            (c.probability(0.0) - 1.0 / 52.0).abs() < 1e-6 && (c.probability(1.0) - 2.0 / 3.0).abs() < 1e-6,
            "{c:?}"
        );
        assert!(Calibration::fit(&[0.5], &[true]).is_err());
        assert!(Calibration::fit(&[f64::NAN, 0.1], &[true, false]).is_err());
        assert!(Calibration::fit(&[0.1, 0.1], &[true]).is_err());
    }
}
