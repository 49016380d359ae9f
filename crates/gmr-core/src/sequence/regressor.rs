//! Queries of a joined motion.

use super::prediction::{Phase, SequencePrediction};
use crate::error::{Error, Result, check_len};
use crate::regress::{Prediction, Regressor};
use crate::segment::MotionElement;

/// An [`ElementSequence`](super::ElementSequence) prepared for queries; a query allocates nothing.
///
/// ```
/// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
/// # fn main() -> Result<(), gmr_core::Error> {
/// # let mixture = Mixture::new(MixtureParts {
/// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
/// # })?;
/// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
/// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
/// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
/// let sequence = ElementSequence::new(parts)?;
/// let regressor = sequence.regressor()?;
/// let mut out = regressor.prediction();
/// regressor.predict_into(0.75, &mut out)?;
/// assert!((out.mean()[0] - 1.5).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct SequenceRegressor {
    pub(super) elements: Vec<MotionElement>,
    pub(super) regressors: Vec<Regressor>,
    pub(super) blend_s: f64,
}

impl SequenceRegressor {
    /// Space for the results and the work of a query.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// let regressor = sequence.regressor()?;
    /// let mut out = regressor.prediction();
    /// assert_eq!(out.mean(), [0.0]); // nothing asked yet
    /// # Ok(())
    /// # }
    /// ```
    pub fn prediction(&self) -> SequencePrediction {
        let work: Vec<Prediction> = self.regressors.iter().map(Regressor::prediction).collect();
        let d = self.regressors[0].outputs().len();
        SequencePrediction {
            mean: vec![0.0; d],
            velocity: vec![0.0; d],
            covariance: vec![0.0; d * d],
            phase: Phase::Before,
            element: 0,
            log_density: f64::NEG_INFINITY,
            work,
        }
    }

    /// The elements in order.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// let regressor = sequence.regressor()?;
    /// assert_eq!(regressor.elements()[0].end_s, 1.0);
    /// # Ok(())
    /// # }
    /// ```
    pub fn elements(&self) -> &[MotionElement] {
        &self.elements
    }

    /// Mean, velocity and covariance at `time_s` on the motion's clock. Allocates nothing.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// let regressor = sequence.regressor()?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_into(0.75, &mut out)?;
    /// assert!((out.mean()[0] - 1.5).abs() < 1e-12 && (out.velocity()[0] - 2.0).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// A time that is not finite, or a prediction made for another sequence.
    pub fn predict_into(&self, time_s: f64, out: &mut SequencePrediction) -> Result<()> {
        check_len("sequence prediction", self.regressors.len(), out.work.len())?;
        if !time_s.is_finite() {
            return Err(Error::NotFinite { what: "time_s", index: 0, value: time_s });
        }
        let last = self.elements.len() - 1;
        let (start, end) = (self.elements[0].start_s, self.elements[last].end_s);
        out.phase = if time_s < start {
            Phase::Before
        } else if time_s > end {
            Phase::After
        } else {
            Phase::Within
        };
        let t = time_s.clamp(start, end);
        let index = self.elements.partition_point(|e| e.end_s <= t).min(last);
        out.element = index;
        let half = 0.5 * self.blend_s;
        // The neighbour whose joint window contains t, and the boundary between the two.
        let neighbour = if index > 0 && t < self.elements[index].start_s + half {
            Some((index - 1, index, self.elements[index].start_s))
        } else if index < last && t > self.elements[index].end_s - half {
            Some((index, index + 1, self.elements[index].end_s))
        } else {
            None
        };
        if let Some((from, to, boundary)) = neighbour {
            self.query(from, t, &mut out.work)?;
            self.query(to, t, &mut out.work)?;
            let s = ((t - (boundary - half)) / self.blend_s).clamp(0.0, 1.0);
            let w = s * s * s * (s * (s * 6.0 - 15.0) + 10.0);
            let slope = 30.0 * s * s * (1.0 - s) * (1.0 - s) / self.blend_s;
            let (a, b) = (&out.work[from], &out.work[to]);
            out.log_density = (1.0 - w) * a.log_density() + w * b.log_density();
            let d = out.mean.len();
            for i in 0..d {
                let gap = b.mean()[i] - a.mean()[i];
                out.mean[i] = w.mul_add(gap, a.mean()[i]);
                let (va, vb) = (a.jacobian()[i], b.jacobian()[i]);
                out.velocity[i] = slope.mul_add(gap, w.mul_add(vb - va, va));
                for j in 0..d {
                    let other = b.mean()[j] - a.mean()[j];
                    let (ca, cb) = (a.covariance()[i * d + j], b.covariance()[i * d + j]);
                    out.covariance[i * d + j] = (w * (1.0 - w)) * (gap * other) + w.mul_add(cb - ca, ca);
                }
            }
        } else {
            self.query(index, t, &mut out.work)?;
            let a = &out.work[index];
            out.mean.copy_from_slice(a.mean());
            out.velocity.copy_from_slice(a.jacobian());
            out.covariance.copy_from_slice(a.covariance());
            out.log_density = a.log_density();
        }
        if out.phase != Phase::Within {
            out.velocity.fill(0.0);
        }
        Ok(())
    }

    fn query(&self, element: usize, t: f64, work: &mut [Prediction]) -> Result<()> {
        let local = t - self.elements[element].start_s;
        self.regressors[element].predict_with_jacobian_into(&[local], &mut work[element])
    }
}
