//! What a query of a joined motion answers.

use serde::{Deserialize, Serialize};

use crate::regress::Prediction;

/// Where a query lies in the motion.
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
/// regressor.predict_into(3.0, &mut out)?;
/// // The end of the motion, held: 1 + 2 * 0.5.
/// assert_eq!(out.phase(), Phase::After);
/// assert!((out.mean()[0] - 2.0).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Before the motion: the answer is its first point, at rest.
    Before,
    /// Within the motion.
    Within,
    /// After the motion: the answer is its last point, at rest.
    After,
}

/// Result and working space of a query; made once by [`SequenceRegressor::prediction`](super::SequenceRegressor::prediction).
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
#[derive(Debug, Clone, PartialEq)]
pub struct SequencePrediction {
    pub(super) mean: Vec<f64>,
    pub(super) velocity: Vec<f64>,
    pub(super) covariance: Vec<f64>,
    pub(super) phase: Phase,
    pub(super) element: usize,
    pub(super) log_density: f64,
    /// One prediction per element, because elements may differ in their number of components.
    pub(super) work: Vec<Prediction>,
}

impl SequencePrediction {
    /// Mean `m(t)`, `(d)`.
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
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Velocity `dm/dt`, `(d)`, per second; zero outside the motion.
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
    /// assert!((out.velocity()[0] - 2.0).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn velocity(&self) -> &[f64] {
        &self.velocity
    }

    /// Covariance, `(d, d)`.
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
    /// assert!((out.covariance()[0] - 1.0).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn covariance(&self) -> &[f64] {
        &self.covariance
    }

    /// Whether the query lay before, within or after the motion.
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
    /// assert_eq!(out.phase(), Phase::Within);
    /// # Ok(())
    /// # }
    /// ```
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Log density of the time under the element (blended in a joint): how usual this moment is.
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
    /// // ln N(0.75 | 0.5, 1)
    /// assert!((out.log_density() + 0.918_938_533_204_672_7 + 0.031_25).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn log_density(&self) -> f64 {
        self.log_density
    }

    /// Index of the element the query fell into.
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
    /// assert_eq!(out.element(), 0);
    /// # Ok(())
    /// # }
    /// ```
    pub fn element(&self) -> usize {
        self.element
    }
}
